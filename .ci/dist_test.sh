#!/usr/bin/env bash
# Tries the release of `.ci/dist.py` as a user would: in an empty folder, without Rust or this checkout.
set -euo pipefail
cd "$(dirname "$0")/.."
checkout=$PWD
box=$(mktemp -d)
clean() {
    thermyo board emulated unplug >/dev/null || true
    rm -rf "$box"
}
trap clean EXIT
mkdir "$box/home" "$box/tmp"
cp -r target/dist "$box/dist"
cd "$box"

# Node.js runs the emulated board; whatever else is there, cargo is not.
mkdir bin
ln -s "$(command -v node)" bin/node
at_home() { env -i PATH="$box/bin:/usr/bin:/bin" HOME="$box/home" TMPDIR="$box/tmp" "$@"; }
thermyo() { at_home "$box/dist/thermyo" "$@"; }
step() { printf '\n--- %s\n' "$*"; }
refuse() {
    echo "$*" >&2
    exit 1
}

step "checksums"
(cd dist && sha256sum --check --quiet SHA256SUMS && ls -s --block-size=KiB)

step "one static program, without paths of this machine"
if readelf --program-headers dist/thermyo | grep INTERP; then
    refuse "thermyo needs a dynamic linker"
fi
for place in "$checkout" "${CARGO_HOME:-$HOME/.cargo}"; do
    if grep --files-with-matches --recursive --fixed-strings "$place" dist; then
        refuse "$place is in there"
    fi
done

step "thermyo"
thermyo --quiet
test -s out/reproduce/report.html
# The report's figures are those of the program that this checkout's command is.
"$checkout/target/release/thermyo" --quiet --out of-checkout >/dev/null
cmp out/reproduce/trace.csv of-checkout/trace.csv

step "the playground, unpacked for a web host"
python3 -m zipfile --extract dist/thermyo-playground.zip site
test -s site/playground/index.html
test -s site/playground/thermyo.wasm

step "thermyo run --board emulated"
printf '[run]\nduration_s = 2.0\n' >short.toml
thermyo run short.toml --board emulated --quiet
thermyo check scenarios/contraction.toml --quiet

step "thermyo board emulated"
thermyo board emulated info
thermyo board emulated config write scenarios/contraction.toml

step "thermyo flash"
for board in pico:RPI-RP2 pico2:RP2350; do
    mkdir "drive-${board%:*}"
    echo "Board-ID: ${board#*:}" >"drive-${board%:*}/INFO_UF2.TXT"
    thermyo flash "drive-${board%:*}" --dry-run
    test ! -e "drive-${board%:*}/thermyo.uf2"
    # The shipped file equals the one that the program would write.
    thermyo flash "drive-${board%:*}" --quiet
    cmp "drive-${board%:*}/thermyo.uf2" "dist/thermyo-${board%:*}.uf2"
done

step "thermyo fmu, thermyo playground"
thermyo fmu scenarios/reproduce.toml --with-core --out again.fmu --quiet
cmp again.fmu dist/reproduce.fmu
thermyo playground --out page --quiet
test -s page/thermyo.wasm

step "a cache that is of no use, a machine without Node.js"
echo >home/file
if env -i PATH="$box/bin" XDG_CACHE_HOME="$box/home/file" dist/thermyo run short.toml --board emulated --quiet 2>said; then
    refuse "it ran"
fi
grep --quiet "home/file.*XDG_CACHE_HOME" said
if env -i PATH=/nowhere HOME="$box/home" dist/thermyo run short.toml --board emulated --quiet 2>said; then
    refuse "it ran"
fi
grep --quiet "install Node.js 18 or newer" said

step "the Python package"
if ! at_home python3 -m venv env 2>/dev/null; then
    echo "skipped: python3 has no venv (Debian: apt-get install python3-venv)"
    exit 0
fi
env/bin/python -m pip install --quiet --disable-pip-version-check dist/thermyo-*.whl
at_home env/bin/python - <<'PYTHON'
import thermyo

print(thermyo.run("scenarios/contraction.toml")["summary"]["rmse_k"])
with thermyo.Board("emulated") as board:
    print(board.info())
PYTHON
