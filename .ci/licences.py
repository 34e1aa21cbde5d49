"""The texts of the licences of every crate in a release, for `.ci/dist.py`; reads `cargo metadata`."""

import json
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def metadata(*arguments):
    """The packages, as `cargo metadata` prints them."""
    asked = ["cargo", "metadata", "--locked", "--format-version", "1", *arguments]
    return json.loads(subprocess.run(asked, check=True, capture_output=True, cwd=ROOT).stdout)


# Files or whole folders of a crate that have to be distributed with it.
NAMES = re.compile(r"(un)?licen[cs]e|copying|notice|copyright", re.IGNORECASE)
BSD_3_CLAUSE = """\
Redistribution and use in source and binary forms, with or without modification, are permitted provided that the
following conditions are met:

1. Redistributions of source code must retain the above copyright notice, this list of conditions and the following
   disclaimer.

2. Redistributions in binary form must reproduce the above copyright notice, this list of conditions and the following
   disclaimer in the documentation and/or other materials provided with the distribution.

3. Neither the name of the copyright holder nor the names of its contributors may be used to endorse or promote
   products derived from this software without specific prior written permission.

THIS SOFTWARE IS PROVIDED BY THE COPYRIGHT HOLDERS AND CONTRIBUTORS "AS IS" AND ANY EXPRESS OR IMPLIED WARRANTIES,
INCLUDING, BUT NOT LIMITED TO, THE IMPLIED WARRANTIES OF MERCHANTABILITY AND FITNESS FOR A PARTICULAR PURPOSE ARE
DISCLAIMED. IN NO EVENT SHALL THE COPYRIGHT HOLDER OR CONTRIBUTORS BE LIABLE FOR ANY DIRECT, INDIRECT, INCIDENTAL,
SPECIAL, EXEMPLARY, OR CONSEQUENTIAL DAMAGES (INCLUDING, BUT NOT LIMITED TO, PROCUREMENT OF SUBSTITUTE GOODS OR
SERVICES; LOSS OF USE, DATA, OR PROFITS; OR BUSINESS INTERRUPTION) HOWEVER CAUSED AND ON ANY THEORY OF LIABILITY,
WHETHER IN CONTRACT, STRICT LIABILITY, OR TORT (INCLUDING NEGLIGENCE OR OTHERWISE) ARISING IN ANY WAY OUT OF THE USE
OF THIS SOFTWARE, EVEN IF ADVISED OF THE POSSIBILITY OF SUCH DAMAGE.
"""


def texts(roots, platforms, others):
    """The texts of everything that these packages are made of on these platforms, equal ones once.

    `others` are what no crate is: pairs of a name and a text.
    """
    known = metadata(*(part for platform in platforms for part in ("--filter-platform", platform)))
    packages = {package["id"]: package for package in known["packages"]}
    needs = {node["id"]: node["deps"] for node in known["resolve"]["nodes"]}
    todo = [package["id"] for package in packages.values() if package["name"] in roots]
    within = set()
    while todo:
        package = todo.pop()
        if package not in within:
            within.add(package)
            todo += [d["pkg"] for d in needs[package] if any(kind["kind"] is None for kind in d["dep_kinds"])]
    holders = {}
    for package in (packages[one] for one in within):
        name = f"{package['name']} {package['version']} ({package['license']})"
        for text in texts_of(package):
            holders.setdefault(text, []).append(name)
    for name, text in others:
        holders.setdefault(text, []).append(name)
    parts = sorted((sorted(names), text) for text, names in holders.items())
    return ("\n" + "=" * 100 + "\n\n").join("\n".join(names) + f"\n\n{text}\n" for names, text in parts)


def texts_of(package):
    """The texts in a crate's folder; where it has none, that of its licence."""
    folder = Path(package["manifest_path"]).parent
    if package["source"] is None:
        folder = ROOT
    named = [path for path in folder.iterdir() if NAMES.match(path.name)]
    files = [file for path in named for file in (path.iterdir() if path.is_dir() else [path])]
    if package["license_file"]:
        files.append(folder / package["license_file"])
    if files:
        return sorted({file.read_text(errors="replace").strip() for file in files})
    who = ", ".join(re.sub(r" <.*>", "", author) for author in package["authors"])
    return [standard(package["license"], who or f"the authors of {package['name']}")]


def standard(licence, who):
    """The text of a licence, for what comes without."""
    if "Apache-2.0" in licence:
        return (ROOT / "LICENSE-APACHE").read_text().strip()
    bodies = {"MIT": (ROOT / "LICENSE-MIT").read_text().split("\n\n", 2)[2], "BSD-3-Clause": BSD_3_CLAUSE}
    return f"Copyright (c) {who}\n\n{bodies[licence]}".strip()
