#!/usr/bin/env bash
#SBATCH --job-name=thermyo
#SBATCH --cpus-per-task=1
#SBATCH --requeue
#SBATCH --output=/dev/null
#SBATCH --error=slurm-%A_%a.err
# A sweep as a Slurm array, a shard per task:
#
#     sbatch --array=1-SHARDS slurm_array.sh SHARDS OUT SCENARIO.toml --vary ... [--lhs N]
#
# The same command continues after tasks have died; finished shards end at once. Then
#
#     thermyo sweep --merge OUT/shard-* --out OUT/whole
#
# THERMYO is the program if it is not in the path. docs/how-to/scale.md states sizes.
set -euo pipefail
shards=$1 out=$2
shift 2
exec "${THERMYO:-thermyo}" sweep "$@" --quiet \
    --shard "$SLURM_ARRAY_TASK_ID/$shards" --out "$out/shard-$SLURM_ARRAY_TASK_ID"
