#!/usr/bin/env bash
# Builds the Python package's wheel, installs it into an empty environment, tests it against the command, and prints
# the speed. The first argument is the environment's folder [default: target/python].
set -euo pipefail
cd "$(dirname "$0")/../.."
environment=${1:-target/python}
if ! python3 -m venv "$environment" 2>/dev/null; then
    echo "skipped: python3 has no venv (Debian: apt-get install python3-venv)"
    exit 0
fi
python=$environment/bin/python
"$python" -m pip install --quiet --disable-pip-version-check maturin pytest numpy pandas matplotlib mcap
# Without it the example is skipped.
"$python" -m pip install --quiet --disable-pip-version-check gymnasium || true

cargo build --locked --release --package host-sim
rm -rf "$environment/wheels"
"$python" -m maturin build --locked --release --manifest-path host-sim/python/Cargo.toml --out "$environment/wheels"
"$python" -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps "$environment"/wheels/thermyo-*.whl

"$python" -m pytest host-sim/python
"$python" host-sim/python/examples/bench.py target/release/thermyo "$environment/bench" \
    scenarios/nominal.toml scenarios/reproduce.toml
