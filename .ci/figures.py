#!/usr/bin/env python3
"""Measures the figures of docs/figures.md by the commands that .ci/figures.toml names.

    .ci/figures.py                 # runs the quick commands, writes their rows into the page
    .ci/figures.py --check         # ... and fails where a row differs from the page beyond rounding
    .ci/figures.py --all           # every command; textbook, random muscles and published data too
    .ci/figures.py NAME...         # those commands only

Rows of other commands stay as they are. THERMYO is the program to run (default: cargo run --release), and
THERMYO_DATA the folder of the published data (docs/background/validation.md).
"""
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs/figures.md"
TABLE = tomllib.loads((ROOT / ".ci/figures.toml").read_text())
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def missed(figure):
    low, high = figure["minimum"], figure["maximum"]
    return (low is not None and figure["value"] < low) or (high is not None and figure["value"] > high)


def rounded(value, digits):
    if value == 0:
        return "0"
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-3 <= abs(value) < 1e6:
        text = f"{value:.0f}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        return f"{mantissa}e{int(exponent)}"
    if "." not in text and len(text.lstrip("-")) < digits:
        text = f"{float(text):.{digits - len(text.lstrip('-'))}f}"
    return text


def value(spec, outputs):
    """A figure of a row as text, in bold where its own target is missed."""
    output = outputs[spec["from"]]
    if "find" in spec:
        found = [float(match) for match in re.findall(spec["find"], output)]
        figures = [{"value": one, "minimum": None, "maximum": None} for one in found]
    elif "key" in spec:
        result = json.loads(output)
        for key in spec["key"].split("."):
            result = result[key]
        figures = [{"value": result, "minimum": None, "maximum": None}]
    else:
        figures = [
            figure
            for case in json.loads(output)
            if re.fullmatch(spec.get("case", ".*"), case["case"])
            for figure in case["figures"]
            if re.fullmatch(spec["name"], figure["name"])
        ]
    if not figures:
        sys.exit(f"figures.toml: nothing is found for {spec}")
    stated = [one for one in figures if one["minimum"] is not None or one["maximum"] is not None]
    kind = spec.get("stat", "only")
    if kind == "targets":
        return str(len(stated))
    if kind in ("held", "missed"):
        count = sum(missed(one) == (kind == "missed") for one in stated)
        bad = sum(map(missed, stated)) > 0
        return f"**{count}**" if bad else str(count)
    if kind == "only" and len(figures) != 1:
        sys.exit(f"figures.toml: {len(figures)} figures are found for {spec}")
    one = {"only": lambda: figures[0], "max": lambda: max(figures, key=lambda f: f["value"]),
           "min": lambda: min(figures, key=lambda f: f["value"])}[kind]()
    if "maximum" in spec:
        one = one | {"maximum": spec["maximum"]}
    text = rounded(one["value"] * spec.get("scale", 1), spec.get("digits", 2))
    return f"**{text}**" if missed(one) else text


def run(name):
    words = shlex.split(TABLE["command"][name]["run"])
    if words[0] == "thermyo":
        words[:1] = shlex.split(os.environ.get("THERMYO", "cargo run --locked --release --quiet --"))
    words = [os.path.expandvars(word) for word in words]
    print(f"{name}: {shlex.join(words)}", file=sys.stderr)
    if "--out" in words:
        # A sweep keeps the points that it finds there, those of an older program too.
        shutil.rmtree(ROOT / words[words.index("--out") + 1], ignore_errors=True)
    done = subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    # 1: a target is missed, which the page shows.
    if done.returncode not in (0, 1) or not done.stdout:
        sys.exit(f"{name} ended with exit code {done.returncode}")
    return done.stdout


def line(row, values):
    target, figure = (row[part].format(**values) for part in ("target", "figure"))
    return f"| {row['what']} | {target} | {figure} | {row['command']} | {row.get('by_hand', '')} |"


def same(new, old):
    """Equal words, and numbers that differ by no more than their last digit."""
    if NUMBER.sub("#", new) != NUMBER.sub("#", old):
        return False
    for a, b in zip(NUMBER.findall(new), NUMBER.findall(old)):
        mantissa, _, exponent = b.partition("e")
        last = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
        if abs(float(a) - float(b)) > 1.01 * last:
            return False
    return True


def main():
    words = sys.argv[1:]
    check, every = "--check" in words, "--all" in words
    names = [word for word in words if not word.startswith("--")]
    commands = names or [n for n, c in TABLE["command"].items() if every or c.get("quick")]
    outputs = {name: run(name) for name in commands}

    page = PAGE.read_text() if PAGE.exists() else ""
    old = {text.split(" | ")[0][2:]: text for text in page.splitlines() if text.startswith("| ")}
    lines, differs = [], []
    for row in TABLE["row"]:
        specs = row.get("value", {})
        if all(spec["from"] in outputs for spec in specs.values()):
            text = line(row, {key: value(spec, outputs) for key, spec in specs.items()})
            if row["what"] not in old or not same(text, old[row["what"]]):
                differs.append(text)
                old[row["what"]] = text
        elif row["what"] not in old:
            sys.exit(f"the page has no row {row['what']!r}, and its command was not run")
        lines.append(old[row["what"]])
    stale = page.splitlines() != (TABLE["head"].strip() + "\n" + "\n".join(lines)).splitlines()
    if check and (differs or stale):
        print("docs/figures.md is not what was measured; .ci/figures.py writes it:", *differs, sep="\n")
        sys.exit(1)
    if not check:
        PAGE.write_text(TABLE["head"].strip() + "\n" + "\n".join(lines) + "\n")


main()
