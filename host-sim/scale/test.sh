#!/usr/bin/env bash
# 1 000 points on one machine, as a Slurm array and with Dask, a worker of each killed in the middle: the same bytes, and
# the cost of each per point. Arguments: the program and a Python environment with the package `thermyo`
# [default: target/release/thermyo target/python]. Parts that cannot run here are skipped with a message.
set -euo pipefail
cd "$(dirname "$0")/../.."
program=${1:-target/release/thermyo}
environment=${2:-target/python}
program=$(realpath "$program")
folder=$PWD/target/scale
rm -rf "$folder"
mkdir -p "$folder"
cat >"$folder/short.toml" <<'TOML'
[run]
duration_s = 10.0
[plant]
model = "lumped"
TOML
# A point without work shows the cost of the engine.
sed "s/duration_s = .*/duration_s = 0.001/" "$folder/short.toml" >"$folder/nothing.toml"
points=1000
shards=8
study=(
    --lhs "$points" --seed 3
    --vary sensor.gas.time_constant_s=0.1:10:log
    --vary believed.heat.scale=0.7:1.4
    --vary load.force_n=50:150
    --vary supply.pressure_pa=5bar,6bar
)

export TIMEFORMAT=%R
{ time "$program" sweep "$folder/short.toml" "${study[@]}" --quiet --out "$folder/one" >/dev/null; } 2>"$folder/seconds" ||
    { cat "$folder/seconds" && exit 1; }
echo "one machine: $points points in $(<"$folder/seconds") s on $(nproc) cores"
{ time "$program" sweep "$folder/nothing.toml" "${study[@]}" --quiet --out "$folder/none" >/dev/null; } 2>"$folder/seconds"
echo "a point that costs nothing: $(host-sim/scale/per_point.sh "$(<"$folder/seconds")" "$points")"

status=0
host-sim/scale/slurm_one_machine.sh "$folder/slurm" host-sim/scale/test_slurm.sh \
    "$PWD" "$program" "$folder" "$points" "$shards" "${study[@]}" || status=$?
[[ $status == 0 || $status == 77 ]] || exit "$status"

if ! "$environment/bin/python" -c "import thermyo" 2>/dev/null; then
    echo "skipped: no package thermyo in $environment (host-sim/python/test.sh makes it)"
    exit 0
fi
"$environment/bin/python" -m pip install --quiet --disable-pip-version-check dask distributed
"$environment/bin/python" host-sim/scale/test_dask.py "$folder" "${study[@]}"
