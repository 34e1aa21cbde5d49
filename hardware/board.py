"""Checks the parts list, the pins and the drawings of the valve board against its schematic.

    python3 hardware/board.py            # exit code 1: something does not agree
    python3 hardware/board.py --write    # writes parts.csv again
    python3 hardware/board.py --netlist FILE    # compares with the netlist that KiCad exported

Pins are compared with the firmware (`firmware/src/board/rp.rs`) and with the wiring table of
`docs/reference/board.md`.
"""

import csv
import io
import re
import sys
from collections import defaultdict
from pathlib import Path

import schematic

HERE = Path(__file__).parent
FIRMWARE = HERE.parent / "firmware/src/board/rp.rs"
DOCUMENT = HERE.parent / "docs/reference/board.md"
JOINT_DOCUMENT = HERE.parent / "docs/how-to/joint.md"
JOINT_LINE = r'#\[cfg\(feature = "joint"\)\]\n.*'
LIST = HERE / "parts.csv"

# Where the firmware names the pins of a net.
FIRMWARE_PINS = {
    r"new_output_ab\(p\.PWM_SLICE0, p\.PIN_(\d+), p\.PIN_(\d+)": ("INLET", "OUTLET"),
    r"serial\(p\.UART0, p\.PIN_(\d+), p\.PIN_(\d+)": ("UART_TX", "UART_RX"),
    r"Spi::new_blocking\(p\.SPI1, p\.PIN_(\d+), p\.PIN_(\d+), p\.PIN_(\d+)": ("SCLK", "SDI", "SDO"),
    r"SpiDevice::new\(Output::new\(p\.PIN_(\d+), Level::High\)\), ready_a": ("CS",),
    r"I2cBus::new\(p\.I2C0, p\.PIN_(\d+), p\.PIN_(\d+)": ("SCL", "SDA"),
    r"pressure: adc::Channel::new_pin\(p\.PIN_(\d+)": ("PRESSURE",),
    r"gas: adc::Channel::new_pin\(p\.PIN_(\d+)": ("GAS",),
    r"length: adc::Channel::new_pin\(p\.PIN_(\d+)": ("LENGTH",),
    r"run_line: Input::new\(p\.PIN_(\d+)": ("RUN_LINE",),
    r"fault_output: Output::new\(p\.PIN_(\d+)": ("FAULT",),
    r"ready_a = Input::new\(p\.PIN_(\d+)": ("DRDY",),
}
LED_ON_THE_PICO = "25"


def parts_list(parts):
    """`parts.csv`: a row for each order number."""
    rows = defaultdict(list)
    for part in parts.values():
        key = (part.fields.get("Manufacturer", ""), part.fields.get("MPN", ""), part.value, part.footprint)
        rows[key].append(part.reference)
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(["references", "quantity", "value", "manufacturer", "part number", "footprint"])
    ordered = ((sorted(references, key=by_number), key) for key, references in rows.items())
    for references, (maker, number, value, footprint) in sorted(ordered, key=lambda row: by_number(row[0][0])):
        out.writerow([" ".join(references), len(references), value, maker, number, footprint])
    return text.getvalue()


def by_number(reference):
    letters, number = re.match(r"([A-Z]+)(\d+)", reference).groups()
    return letters, int(number)


def check_parts(parts):
    for part in parts.values():
        if not part.fields.get("MPN") or not part.fields.get("Manufacturer"):
            yield f"{part.reference}: no manufacturer or part number"
        if not part.footprint and part.reference != "A1":
            yield f"{part.reference}: no footprint"
    if not LIST.exists() or LIST.read_text() != parts_list(parts):
        yield f"{LIST.name} is not that of the schematic: python3 hardware/board.py --write"


def check_pins(parts):
    """Pins of the Pico: schematic, firmware, document."""
    pico = parts["A1"].pins
    drawn = {name: net for name, net in pico.values() if not net.startswith("Net-") and net != "GND"}
    firmware = FIRMWARE.read_text()
    named = {}
    for pattern, nets in FIRMWARE_PINS.items():
        found = re.search(pattern, firmware)
        if not found:
            yield f"{FIRMWARE.name} has no {pattern}"
            continue
        named |= {f"GP{pin}": net for pin, net in zip(found.groups(), nets)}
    # Pins that only the image of a joint uses are not on this board.
    of_joint = re.findall(JOINT_LINE, firmware)
    for pin in re.findall(r"p\.PIN_(\d+)", "".join(of_joint)):
        if not re.search(rf"^\|.*\bGP{pin} \(", JOINT_DOCUMENT.read_text(), re.MULTILINE):
            yield f"{JOINT_DOCUMENT.name} has no GP{pin}, which the image of a joint uses"
    firmware = re.sub(JOINT_LINE, "", firmware)
    every = {f"GP{pin}" for pin in re.findall(r"p\.PIN_(\d+)", firmware) if pin != LED_ON_THE_PICO}
    for pin in sorted(every - named.keys()):
        yield f"{FIRMWARE.name} uses {pin}, which this check does not know"
    for pin in sorted({p for p in drawn if p.startswith("GP")} | named.keys()):
        if drawn.get(pin) != named.get(pin):
            yield f"{pin}: {drawn.get(pin)} in the schematic, {named.get(pin)} in the firmware"
    wiring = DOCUMENT.read_text().split("## Wiring")[1].split("\n## ")[0]
    stated = {}
    for row in re.findall(r"^\|([^|]*\(\d+\)[^|]*)\|[^|]*\|([^|]*)\|", wiring, re.MULTILINE):
        pins = re.findall(r"(\w+)(?: / \w+)? \((\d+)\)", row[0])
        nets = re.findall(r"`([^`]+)`", row[1])
        stated |= dict(zip(pins, nets, strict=True))
    schematic_pins = {
        (name, number): net for number, (name, net) in pico.items() if not net.startswith("Net-") and net != "GND"
    }
    for pin in sorted(stated.items() ^ schematic_pins.items()):
        where = "the document" if pin in stated.items() else "the schematic"
        yield f"{pin[0][0]} (pin {pin[0][1]}) is {pin[1]} in {where} alone"


def check_drawings(parts):
    """Each reference and value stands in the SVG, as KiCad describes its texts."""
    drawn = set(re.findall(r"<desc>([^<]*)</desc>", (HERE / "valve-board.svg").read_text()))
    # A symbol with several units has a letter behind its reference.
    drawn |= {re.sub(r"[A-Z]$", "", text) for text in drawn}
    for part in parts.values():
        for text in (part.reference, part.value):
            if text.replace("&", "&amp;") not in drawn:
                yield f"{text} is not in valve-board.svg: hardware/kicad.sh plot hardware"


def check_netlist(parts, file):
    """The nets of KiCad, as groups of pins: names of nets without a label differ between its versions."""
    exported = schematic.expression(file.read_text())
    theirs = {
        frozenset(
            (schematic.text(schematic.first(pin, "ref")[1]), schematic.text(schematic.first(pin, "pin")[1]))
            for pin in schematic.every(net, "node")
        )
        for net in schematic.every(schematic.first(exported, "nets"), "net")
    }
    ours = defaultdict(set)
    for part in parts.values():
        for number, (_, net) in part.pins.items():
            ours[net].add((part.reference, number))
    for group in theirs ^ {frozenset(group) for group in ours.values()}:
        yield f"{'only KiCad' if group in theirs else 'only this reader'} connects {sorted(group)}"


def main(arguments):
    parts = schematic.read()
    if arguments == ["--write"]:
        LIST.write_text(parts_list(parts))
        return 0
    if arguments[:1] == ["--netlist"]:
        wrong = list(check_netlist(parts, Path(arguments[1])))
    else:
        wrong = [*check_parts(parts), *check_pins(parts), *check_drawings(parts)]
    print("\n".join(wrong) if wrong else f"{len(parts)} parts agree")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
