#!/usr/bin/env python3
"""Whether the licence of every crate of Cargo.lock lets the project be MIT or Apache-2.0; reads `cargo metadata`.

Prints how many crates there are, and names those whose licence is not known to. Exit code 1: there is one.
"""

import json
import re
import subprocess
import sys

# MPL-2.0: files of such a crate stay under it, unchanged; the rest is not concerned.
ALLOWED = {
    "MIT",
    "MIT-0",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "MPL-2.0",
    "Unicode-3.0",
    "Unlicense",
    "Zlib",
}
TOKEN = re.compile(r"\(|\)|\bAND\b|\bOR\b|/|[\w.+-]+(?: WITH [\w.-]+)?")


def allowed(expression):
    """An SPDX expression, "/" being an old "OR"; AND binds more strongly."""
    words = TOKEN.findall(expression)

    def factor():
        word = words.pop(0)
        if word != "(":
            return word in ALLOWED
        inside = any_of()
        words.pop(0)
        return inside

    def all_of():
        every = factor()
        while words and words[0] == "AND":
            words.pop(0)
            every &= factor()
        return every

    def any_of():
        some = all_of()
        while words and words[0] in ("OR", "/"):
            words.pop(0)
            some |= all_of()
        return some

    return any_of()


def main():
    asked = ["cargo", "metadata", "--locked", "--format-version", "1"]
    packages = json.loads(subprocess.run(asked, check=True, capture_output=True).stdout)["packages"]
    refused = [p for p in packages if not p["license"] or not allowed(p["license"])]
    for package in refused:
        print(f"{package['name']} {package['version']}: {package['license'] or package['license_file']}: not allowed")
    print(f"licences of {len(packages)} crates: {len(refused)} not allowed")
    return 1 if refused else 0


if __name__ == "__main__":
    assert allowed("(MIT OR Apache-2.0) AND Unicode-3.0") and allowed("MIT/GPL-3.0-only") and not allowed("GPL-3.0-only")
    assert not allowed("MIT AND GPL-3.0-only") and allowed("GPL-3.0-only OR MIT AND Zlib")
    sys.exit(main())
