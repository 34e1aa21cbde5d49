"""Reads the netlist and the parts out of `valve-board.kicad_sch`, the one source of the design.

It reads a flat sheet as KiCad 6 and later write it: wires, junctions, labels, power symbols, stacked pins. `check.sh`
compares the netlist with the one of KiCad itself where KiCad is installed.
"""

import math
import re
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

SCHEMATIC = Path(__file__).with_name("valve-board.kicad_sch")


@dataclass
class Part:
    """A part with all its units."""

    reference: str
    value: str
    footprint: str
    fields: dict
    pins: dict = field(default_factory=dict)  # number: (name, net)


def read(path=SCHEMATIC):
    """Parts by reference, each pin with its net."""
    sheet = expression(path.read_text())
    library = {text(s[1]): pins_of(s) for s in first(sheet, "lib_symbols")[1:]}
    parts, pins, named = {}, [], []
    for symbol in every(sheet, "symbol"):
        fields = {text(p[1]): text(p[2]) for p in every(symbol, "property")}
        reference, unit = fields.pop("Reference"), int(first(symbol, "unit")[1])
        at = [float(v) for v in first(symbol, "at")[1:]]
        mirror = first(symbol, "mirror")
        for of, number, name, x, y in library[text(first(symbol, "lib_id")[1])]:
            if of not in (0, unit):
                continue
            place = placed((x, y), at, mirror and mirror[1])
            if reference.startswith("#PWR"):
                named.append((place, name))
            elif not reference.startswith("#"):
                pins.append((place, reference, number, name))
        if not reference.startswith("#") and reference not in parts:
            parts[reference] = Part(reference, fields.pop("Value"), fields.pop("Footprint"), fields)
    named += [(point(first(label, "at")), text(label[1])) for label in every(sheet, "label")]
    for number, net in nets(sheet, pins, named).items():
        reference, pin, name = number
        parts[reference].pins[pin] = (name, net)
    return parts


def nets(sheet, pins, named):
    """The net of each pin. A wire connects at its ends, and where a junction or a label lies on it."""
    wires = [[point(xy) for xy in first(wire, "pts")[1:]] for wire in every(sheet, "wire")]
    inner = [point(first(j, "at")) for j in every(sheet, "junction")] + [place for place, _ in named]
    root = {}

    def find(a):
        root.setdefault(a, a)
        while root[a] != a:
            a = root[a]
        return a

    for a, b in wires:
        root[find(a)] = find(b)
        for p in inner:
            if on(p, a, b):
                root[find(p)] = find(a)
    for place, name in named:
        root[find(place)] = find(name)
    groups = defaultdict(list)
    for place, reference, number, name in pins:
        groups[find(place)].append((reference, number, name))
    names = {find(name): name for _, name in named}
    return {
        pin: names.get(group, "Net-({}-Pad{})".format(*min(members)[:2]))
        for group, members in groups.items()
        for pin in members
    }


def expression(source):
    """Nested lists of an s-expression; strings keep their quotes."""
    stack = [[]]
    for token in re.findall(r'"(?:[^"\\]|\\.)*"|[()]|[^\s()"]+', source):
        if token == "(":
            stack.append([])
        elif token == ")":
            done = stack.pop()
            stack[-1].append(done)
        else:
            stack[-1].append(token)
    return stack[0][0]


def every(node, name):
    return [child for child in node if isinstance(child, list) and child[0] == name]


def first(node, name):
    return next(iter(every(node, name)), None)


def text(token):
    return token.strip('"')


def point(node):
    return round(float(node[1]), 2), round(float(node[2]), 2)


def pins_of(symbol):
    """Unit, number, name and place of each pin of a library symbol, y upwards."""
    found = []
    for unit in every(symbol, "symbol"):
        of = int(text(unit[1]).split("_")[-2])
        for pin in every(unit, "pin"):
            number, name = text(first(pin, "number")[1]), text(first(pin, "name")[1])
            found.append((of, number, name, *map(float, first(pin, "at")[1:3])))
    return found


def placed(pin, at, mirror):
    """Place of a pin on the sheet, y downwards: turned first, then mirrored."""
    x, y, degrees = at
    cos, sin = round(math.cos(math.radians(degrees))), round(math.sin(math.radians(degrees)))
    dx, dy = pin[0] * cos - pin[1] * sin, pin[0] * sin + pin[1] * cos
    if mirror == "y":
        dx = -dx
    if mirror == "x":
        dy = -dy
    return round(x + dx, 2), round(y - dy, 2)


def on(p, a, b):
    """Whether a point lies on a wire, which is horizontal or vertical."""
    return (a[0] == b[0] == p[0] and min(a[1], b[1]) <= p[1] <= max(a[1], b[1])) or (
        a[1] == b[1] == p[1] and min(a[0], b[0]) <= p[0] <= max(a[0], b[0])
    )
