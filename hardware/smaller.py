"""Makes the SVG file of KiCad a third as large: paths in relative coordinates, no invisible copy of each text."""

import re
import sys
from pathlib import Path


def relative(path):
    """`M x y L x y ...` with differences in the place of further points."""
    points = [tuple(round(float(v)) for v in p) for p in re.findall(r"([-.\d]+)[ ,]+([-.\d]+)", path[1])]
    steps = (f"{b[0] - a[0]} {b[1] - a[1]}" for a, b in zip(points, points[1:]))
    return f'd="M{points[0][0]} {points[0][1]}l' + " ".join(steps) + '"'


file = Path(sys.argv[1])
svg = file.read_text()
svg = re.sub(r"<text [^>]*>[^<]*</text>\s*", "", svg)
svg = re.sub(r' d="(M[-.\d\sL,]+)"', lambda m: " " + relative(m), svg)
svg = re.sub(r"(\d\.\d)\d{5}\b", r"\1", svg)
svg = re.sub(r" date [^<]*", "", svg)
svg = re.sub(r"<g [^>]*>\s*</g>\s*", "", svg)
svg = re.sub(r'" />\s*<path d="(?=[^"]*" />)', "", svg)
file.write_text(svg)
