#!/usr/bin/env bash
# Within Slurm, called by test.sh: an array, a task of it killed in the middle, the array again.
set -euo pipefail
repository=$1 program=$2 folder=$3 points=$4 shards=$5
shift 5
study=("$@")
array() { # OUT SCENARIO
    THERMYO=$program sbatch --quiet --wait --chdir="$folder" --array="1-$shards" \
        "$repository/host-sim/scale/slurm_array.sh" "$shards" "$1" "$2" "${study[@]}" >/dev/null
}
# The first task that has finished ten points or more.
victim() {
    for table in "$folder"/killed/shard-*/unfinished-1/sweep.csv; do
        [[ -f $table && $(wc -l <"$table") -gt 10 ]] || continue
        pgrep --newest --full -- "--out $folder/killed/$(basename "$(dirname "$(dirname "$table")")")\$" && return
    done
    return 1
}
array "$folder/killed" "$folder/short.toml" &
submitted=$!
for _ in {1..600}; do
    if process=$(victim); then
        kill -KILL "$process"
        break
    fi
    sleep 0.05
done
[[ -n ${process:-} ]] || { echo "no task was found to kill"; exit 1; }
wait "$submitted" && { echo "the array does not report that a task died"; exit 1; }
if "$program" sweep --merge "$folder"/killed/shard-* --out "$folder/merged" 2>"$folder/missing.txt"; then
    echo "points of the dead task are not missed"
    exit 1
fi
grep -q "points are missing: point .* = " "$folder/missing.txt"
array "$folder/killed" "$folder/short.toml"
grep -h "are kept; at work when it ended: point" "$folder"/slurm-*.err | tail -n 1
"$program" sweep --merge "$folder"/killed/shard-* --out "$folder/merged" >/dev/null
for file in sweep.csv summary.json report.html; do
    cmp "$folder/merged/$file" "$folder/one/$file"
done
TIMEFORMAT=%R
{ time array "$folder/nothing" "$folder/nothing.toml"; } 2>"$folder/seconds"
cost=$("$repository/host-sim/scale/per_point.sh" "$(<"$folder/seconds")" "$points")
echo "Slurm: $points points in $shards tasks, one of them killed: the bytes of one machine; a point that costs nothing: $cost"
