#!/usr/bin/env python3
"""The house of the host: lines by crate, circles of imports, and long functions.

Prints the lines of each crate below `host-sim/`, the imports that run in circles within one of them, within model-core
or within protocol, test files that no `tests/main.rs` names, functions of more than 60 lines in the whole project, and
comments that begin without a subject.
Exit code 1: there is a circle, a crate of more than 8 000 lines, such a test, function or comment.

Cargo itself refuses a circle between crates, but for development dependencies: those are looked at here. Within a
crate a module is a file. `pub use` hands names on and is no import; neither is it one that a file uses what the
`mod.rs` or `lib.rs` above it declares: those are one module in two files.
"""

import json
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MOST_LINES = 8000
MOST_FUNCTION_LINES = 60
# Crates of board and host, whose modules are looked at as the host's are; their lines are not counted.
CORES = ["model-core", "protocol"]
# Functions that are longer, and may not grow: the contraction loop's period in parts costs the RP2040 0.1 us a step.
LONGER = {
    ("model-core/src/control/contraction.rs", "period"): 86,
}
COMMENT_OR_TEXT = re.compile(r'//[^\n]*|/\*.*?\*/|r(#*)".*?"\1|"(?:\\.|[^"\\])*"', re.DOTALL)
NO_SUBJECT = re.compile(r"^[^\S\n]*(?://[/!]?|#) (?:What|That of|Those of)\b.*", re.MULTILINE)
QUOTED = re.compile(r"b?'(?:\\.[^']*|[^\\'])'|" + COMMENT_OR_TEXT.pattern, re.DOTALL)
FUNCTION = re.compile(r"^[^\S\n]*(?:[\w()]+ )*fn (\w+)", re.MULTILINE)
USE = re.compile(r"\b(pub(?:\([^)]*\))?\s+)?use\s+([^;]+);")
INLINE = re.compile(r"(?<![\w:$])(?:crate|super|self)(?:::\w+)+")
INLINE_MODULE = re.compile(r"\bmod\s+\w+\s*\{")


def main():
    packages = host_packages()
    wrong = between(packages)
    for name, package in sorted(packages.items()):
        source = Path(package["manifest_path"]).parent / "src"
        count = sum(len(file.read_text().splitlines()) for file in source.rglob("*.rs"))
        print(f"{count:6}  {name}")
        if count > MOST_LINES:
            wrong.append(f"{name}: {count} lines, {MOST_LINES} are allowed")
        wrong += within(name, source)
    wrong += [found for name in CORES for found in within(name, ROOT / name / "src")]
    wrong += unnamed_tests() + long_functions() + comments()
    print("\n".join(wrong) if wrong else "no circle")
    return 1 if wrong else 0


def host_packages():
    """The packages below `host-sim/`, as cargo knows them."""
    line = ["cargo", "metadata", "--locked", "--no-deps", "--format-version", "1"]
    metadata = json.loads(subprocess.run(line, check=True, capture_output=True, cwd=ROOT).stdout)
    below = str(ROOT / "host-sim") + "/"
    return {each["name"]: each for each in metadata["packages"] if each["manifest_path"].startswith(below)}


def within(name, source):
    """Circles between the modules of a crate."""
    found = circles(imports(source, sorted(source.rglob("*.rs"))))
    return [f"{name}: {' <-> '.join(circle)}" for circle in found]


def between(packages):
    """Circles between crates, development dependencies included."""
    graph = {
        name: {needed["name"] for needed in package["dependencies"]} & (packages.keys() - {name})
        for name, package in packages.items()
    }
    return [f"crates: {' <-> '.join(circle)}" for circle in circles(graph)]


def bare(text):
    """The code alone: no comments, no texts, no inline modules (they are tests, or see what their file sees)."""
    text = COMMENT_OR_TEXT.sub(" ", text)
    while found := INLINE_MODULE.search(text):
        depth, end = 1, found.end()
        while depth and end < len(text):
            depth += {"{": 1, "}": -1}.get(text[end], 0)
            end += 1
        text = text[: found.start()] + text[end:]
    return text


def leaves(tree):
    """The paths of a tree of `use`, as lists of names."""
    tree = tree.strip()
    start, brace, rest = tree.partition("{")
    head = [name.strip() for name in start.split("::") if name.strip()]
    if not brace:
        return [[name.split(" as ")[0].strip() for name in head]]
    parts, depth = [""], 0
    for letter in rest[: rest.rindex("}")]:
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [head + leaf for part in parts if part.strip() for leaf in leaves(part)]


def imports(source, files):
    """Which module of a crate imports which, by the names of their files."""
    modules = {}
    for file in files:
        parts = file.relative_to(source).with_suffix("").parts
        if parts == ("main",):
            continue
        modules[parts[:-1] if parts[-1] in ("mod", "lib") else parts] = bare(file.read_text())
    handed_on = {module: {} for module in modules}
    for module, text in modules.items():
        for public, tree in USE.findall(text):
            for leaf in leaves(tree) if public else []:
                handed_on[module][leaf[-1]] = whole(module, leaf, modules)

    def home(path):
        """The module in which the thing at a path lies."""
        for _ in range(8):
            place = next(path[:n] for n in range(len(path), -1, -1) if path[:n] in modules)
            rest = path[len(place) :]
            onward = handed_on[place].get(rest[0]) if rest else None
            globs = handed_on[place].get("*") if rest and onward is None else None
            if onward is None and globs and not re.search(rf"\b{rest[0]}\b", modules[place]):
                onward = globs[:-1] + (rest[0],)
                return home(onward) if onward[: len(place)] != place else place
            if onward is None:
                return place
            path = onward + rest[1:]
        return path[:1]

    graph = {}
    for module, text in modules.items():
        found = [leaf for public, tree in USE.findall(text) if not public for leaf in leaves(tree)]
        found += [path.split("::") for path in INLINE.findall(USE.sub(" ", text))]
        paths = (whole(module, leaf, modules) for leaf in found)
        needed = {home(path) for path in paths if path is not None}
        others = {each for each in needed if each != module[: len(each)]}
        graph["/".join(module) or "lib"] = {"/".join(each) for each in others}
    return graph


def whole(module, leaf, modules):
    """A path from the root of the crate; none for one that leads elsewhere."""
    if leaf[0] == "crate":
        return tuple(name for name in leaf[1:] if name != "self")
    place, names = list(module), list(leaf)
    if names[0] not in ("self", "super"):
        return tuple(place + names) if tuple(place + names[:1]) in modules else None
    while names and names[0] in ("self", "super"):
        if names.pop(0) == "super" and place:
            place.pop()
    return tuple(place + [name for name in names if name != "self"])


def circles(graph):
    """Groups that import each other in a circle."""
    reach = {}
    for start in graph:
        seen, todo = set(), list(graph[start])
        while todo:
            each = todo.pop()
            if each not in seen:
                seen.add(each)
                todo += graph.get(each, ())
        reach[start] = seen
    groups = {tuple(sorted(b for b in reach[a] if a in reach.get(b, ()))) for a in graph if a in reach[a]}
    return sorted(groups)


def unnamed_tests():
    """Files beside a `tests/main.rs` that neither it nor a manifest names: they would never be run."""
    found = []
    for main_file in [ROOT / "tests/tests/main.rs", *(ROOT / "host-sim").glob("**/tests/main.rs")]:
        if "target" in main_file.parts or "node_modules" in main_file.parts:
            continue
        named = main_file.read_text() + (main_file.parent.parent / "Cargo.toml").read_text()
        for file in sorted(main_file.parent.glob("*.rs")):
            known = rf"\bmod {file.stem};|\"tests/{file.name}\""
            if file != main_file and not re.search(known, named):
                found.append(f"{file.relative_to(ROOT)}: {main_file.relative_to(ROOT)} does not name it")
    return found


def comments():
    """Comments that begin with a clause in place of their subject."""
    found = []
    for name in listed("*.rs", "*.py", "*.sh", "*.js", "*.mjs", "*.toml"):
        text = (ROOT / name).read_text()
        for comment in NO_SUBJECT.finditer(text):
            line = text.count("\n", 0, comment.start()) + 1
            found.append(f"{name}:{line}: name the subject first: {comment[0].strip()}")
    return found


def listed(*patterns):
    """Files of the project by pattern."""
    line = ["git", "ls-files", *patterns]
    return subprocess.run(line, check=True, capture_output=True, text=True, cwd=ROOT).stdout.split()


def long_functions():
    """Functions of too many lines. Lines within square brackets are tables of cases, and do not count."""
    found = []
    for name in listed("*.rs"):
        blank = QUOTED.sub(lambda text: re.sub(r"[^\n]", "_", text.group()), (ROOT / name).read_text())
        for function in FUNCTION.finditer(blank):
            count = lines_of(blank, function)
            most = LONGER.get((str(name), function[1]), MOST_FUNCTION_LINES)
            if count > most:
                line = blank.count("\n", 0, function.start()) + 1
                found.append(f"{name}:{line}: {function[1]}: {count} lines, {most} are allowed")
    return found


def lines_of(text, function):
    """Lines of a function from its name to its end; 0 for a declaration."""
    count, depth = 1, {"(": 0, "[": 0, "{": 0}
    opens = {")": "(", "]": "[", "}": "{"}
    for letter in text[function.end() :]:
        if letter in depth:
            depth[letter] += 1
        elif letter in opens:
            depth[opens[letter]] -= 1
            if letter == "}" and depth["{"] == 0:
                return count
        elif letter == ";" and not any(depth.values()):
            return 0
        elif letter == "\n" and depth["["] == 0:
            count += 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
