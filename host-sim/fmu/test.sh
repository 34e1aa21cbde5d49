#!/usr/bin/env bash
# Makes units of the repository's scenarios, validates and simulates them with FMPy, and compares with the command. The
# first argument is the folder of a Python environment, made where it is not there [default: target/python].
set -euo pipefail
cd "$(dirname "$0")/../.."
environment=${1:-target/python}
if ! python3 -m venv "$environment" 2>/dev/null; then
    echo "skipped: python3 has no venv (Debian: apt-get install python3-venv)"
    exit 0
fi
"$environment/bin/python" -m pip install --quiet --disable-pip-version-check fmpy pytest numpy
cargo build --locked --release --package host-sim --package thermyo-fmu
"$environment/bin/python" -m pytest --capture=no --quiet host-sim/fmu/test_fmu.py
