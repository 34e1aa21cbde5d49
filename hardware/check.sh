#!/usr/bin/env bash
# Checks the valve board: parts, pins and drawings against the schematic, its circuits in ngspice, its electrical rules
# and netlist in KiCad. A part skips itself with a note where its program cannot be had. Under a minute once they are
# installed.
set -euo pipefail
cd "$(dirname "$0")/.."
out=target/hardware
mkdir -p "$out"

python3 hardware/board.py

if ! command -v ngspice >/dev/null; then
    { apt-get update -q && apt-get install -qy --no-install-recommends ngspice; } >/dev/null 2>&1 || true
fi
if command -v ngspice >/dev/null; then
    python3 hardware/simulate.py
else
    echo "skipped: no ngspice (Debian: apt-get install ngspice)"
fi

# Its window may not come up on a busy machine: once more, then a note.
kicad() { hardware/kicad.sh "$1" "$out" || hardware/kicad.sh "$1" "$out"; }
if kicad rules; then
    tail -n 1 "$out/rules.txt"
    if ! grep -Eq "Errors 0( |$)" "$out/rules.txt"; then
        cat "$out/rules.txt"
        exit 1
    fi
    if kicad netlist; then
        python3 hardware/board.py --netlist "$out/netlist.txt"
    else
        echo "skipped: comparison with KiCad's netlist"
    fi
else
    echo "skipped: electrical rules (KiCad 8 or later, or Debian's kicad, xvfb, xdotool and xclip, with kiauto)"
fi
