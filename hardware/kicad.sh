#!/usr/bin/env bash
# KiCad on the schematic without its windows: `kicad.sh rules`, `netlist` or `plot`, and the folder for the result.
# kicad-cli of KiCad 8 and later does it; KiCad 6 of Debian 12 has none, and kiauto works its window on a virtual
# screen. Exit code 3: neither can be had here.
set -euo pipefail
cd "$(dirname "$0")/.."
task=$1 out=$2
sheet=valve-board.kicad_sch
work=$PWD/target/hardware
mkdir -p "$out" "$work"
out=$(cd "$out" && pwd)

if kicad-cli sch erc --help >/dev/null 2>&1; then
    cd hardware
    case $task in
    rules) kicad-cli sch erc --severity-error --output "$out/rules.txt" "$sheet" ;;
    netlist) kicad-cli sch export netlist --output "$out/netlist.txt" "$sheet" ;;
    plot)
        kicad-cli sch export pdf --no-background-color --output "$out/valve-board.pdf" "$sheet"
        kicad-cli sch export svg --no-background-color --output "$out" "$sheet"
        python3 smaller.py "$out/valve-board.svg"
        ;;
    esac
    exit
fi

there() {
    /usr/bin/python3 -c "import pcbnew" 2>/dev/null &&
        for program in eeschema xdotool xclip Xvfb; do command -v $program >/dev/null || return 1; done
}
if ! there; then
    { apt-get update -q && apt-get install -qy --no-install-recommends kicad xvfb xdotool xclip; } >/dev/null 2>&1 || true
    there || exit 3
fi
if [ ! -e "$work/kiauto" ]; then
    python3 -m pip install --quiet --disable-pip-version-check --target "$work/kiauto" kiauto || exit 3
fi
# A copy, because KiCad writes beside the sheet; a configuration of its own, because it writes there too.
rm -rf "$work/sheet" "$work/made"
mkdir -p "$work/sheet" "$work/config"
cp hardware/valve-board.kicad_* hardware/thermyo.kicad_sym hardware/sym-lib-table "$work/sheet"
export KICAD_CONFIG_HOME=$work/config PYTHONPATH=$work/kiauto:/usr/lib/python3/dist-packages
window() {
    timeout 60 /usr/bin/python3 "$work/kiauto/bin/eeschema_do" "$@" "$work/sheet/$sheet" "$work/made" >"$work/log" 2>&1
}
case $task in
rules)
    # The exit code is the number of violations.
    window run_erc || true
    cp "$work/made/valve-board.erc" "$out/rules.txt" || exit 3
    ;;
netlist) window netlist && cp "$work/made/valve-board.net" "$out/netlist.txt" ;;
plot)
    for format in pdf svg; do
        window export --file_format "$format"
        cp "$work/made/valve-board.$format" "$out"
    done
    python3 hardware/smaller.py "$out/valve-board.svg"
    ;;
esac
