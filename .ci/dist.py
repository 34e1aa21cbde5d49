#!/usr/bin/env python3
"""Makes what a user downloads, in target/dist: see docs/how-to/release.md.

    .ci/dist.py             makes it
    .ci/dist.py --twice     makes it here and in a copy of this checkout elsewhere; exit code 1: a byte differs
"""

import argparse
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import licences

ROOT = licences.ROOT
OUT = ROOT / "target/dist"
BUILD = ROOT / "target/dist-build"
# The command runs on any Linux, whatever its C library.
STATIC = "x86_64-unknown-linux-musl"
# A shared library runs in programs that use the C library of their machine.
SHARED = "x86_64-unknown-linux-gnu"
WASM = "wasm32-unknown-unknown"
# Names as `thermyo_boards::image` has them, with the target and the arguments of cargo.
IMAGES = {
    "firmware.elf": ("thumbv6m-none-eabi", []),
    "firmware-hil.elf": ("thumbv6m-none-eabi", ["--features", "hil"]),
    "firmware-pico2.elf": ("thumbv8m.main-none-eabihf", ["--no-default-features", "--features", "pico2"]),
    "firmware-joint.elf": ("thumbv6m-none-eabi", ["--features", "joint"]),
    "firmware-joint-pico2.elf": (
        "thumbv8m.main-none-eabihf",
        ["--no-default-features", "--features", "pico2,joint"],
    ),
}
# It writes the wheel's archive: another version may write other bytes.
MATURIN = "maturin==1.16.0"
# Board-ID that a board reports in its boot loader.
BOARDS = {"pico": "RPI-RP2", "pico2": "RP2350"}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--twice", action="store_true", help="makes it in two folders and compares")
    twice = parser.parse_args().twice
    make()
    print((OUT / "SHA256SUMS").read_text(), end="")
    return compare_with_a_second() if twice else 0


def make():
    """Everything."""
    targets = [STATIC, SHARED, WASM, *(target for target, _ in IMAGES.values())]
    if shutil.which("rustup"):
        run("rustup", "target", "add", *sorted(set(targets)))
    shutil.rmtree(OUT, ignore_errors=True)
    OUT.mkdir(parents=True)
    BUILD.mkdir(parents=True, exist_ok=True)
    emulator = node_modules()
    inside = BUILD / "inside.zip"
    archive(inside, {**emulator, **images(), **modules()})
    thermyo = command(inside)
    shutil.copy(thermyo, OUT)
    for board, board_id in BOARDS.items():
        uf2(thermyo, board_id, f"thermyo-{board}.uf2")
        uf2(thermyo, board_id, f"thermyo-{board}-joint.uf2", "--joint")
    playground(thermyo)
    run(thermyo, "fmu", "scenarios/reproduce.toml", "--with-core", "--out", OUT / "reproduce.fmu", "--quiet")
    wheel(inside)
    licence_texts(emulator)
    sums = [f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in sorted(OUT.iterdir())]
    (OUT / "SHA256SUMS").write_text("".join(sums))


def node_modules():
    """The emulator's scripts with the packages that they need."""
    source = ROOT / "host-sim/emulator"
    folder = BUILD / "emulator"
    folder.mkdir(exist_ok=True)
    for name in ("package.json", "package-lock.json"):
        shutil.copy(source / name, folder)
    run("npm", "ci", "--no-audit", "--no-fund", "--ignore-scripts", cwd=folder)
    files = {f"emulator/{path.name}": path for path in source.glob("*.mjs")}
    packages = folder / "node_modules"
    for path in packages.rglob("*"):
        inside = path.relative_to(packages)
        # Each of its modules is there twice; the emulator's scripts take the one kind.
        needed = path.suffix == ".js" and "cjs" not in inside.parts
        if needed or path.name in ("package.json", "LICENSE") and "cjs" not in inside.parts:
            files[f"emulator/node_modules/{inside}"] = path
    return files


def images():
    """The firmware's images, without what only a debugger reads."""
    files = {}
    for name, (target, arguments) in IMAGES.items():
        settings = ["--release", "--config", "profile.release.strip=true"]
        cargo("build", target, *settings, *arguments, cwd=ROOT / "firmware")
        files[f"emulator/{name}"] = BUILD / name
        shutil.copy(BUILD / target / "release/firmware", BUILD / name)
    return files


def modules():
    """The core and the plant for other programs: in a browser, and in a simulator."""
    cargo("build", WASM, "--package", "thermyo-playground", "--profile", "playground")
    cargo("build", SHARED, "--package", "thermyo-fmu", "--profile", "shipped")
    return {
        "thermyo.wasm": BUILD / WASM / "playground/thermyo_playground.wasm",
        "libthermyo_fmu.so": BUILD / SHARED / "shipped/libthermyo_fmu.so",
    }


def archive(path, files):
    """A zip archive that is the same whenever and wherever it is made."""
    with zipfile.ZipFile(path, "w") as zipped:
        for name in sorted(files):
            info = zipfile.ZipInfo(name)
            info.compress_type = zipfile.ZIP_DEFLATED
            zipped.writestr(info, files[name].read_bytes(), compresslevel=9)


def command(inside):
    """The command, with all of that inside."""
    package = ["--package", "host-sim", "--bin", "thermyo", "--features", "release"]
    cargo("build", STATIC, *package, "--profile", "shipped", THERMYO_INSIDE=inside)
    return BUILD / STATIC / "shipped/thermyo"


def uf2(thermyo, board_id, name, *arguments):
    """What the command would write to a board."""
    with tempfile.TemporaryDirectory() as drive:
        Path(drive, "INFO_UF2.TXT").write_text(f"Board-ID: {board_id}\n")
        run(thermyo, "flash", drive, *arguments, "--quiet", XDG_CACHE_HOME=BUILD / "cache")
        shutil.copy(Path(drive, "thermyo.uf2"), OUT / name)


def playground(thermyo):
    """The page with core and plant, as a folder for any web host."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder, "playground")
        run(thermyo, "playground", "--out", page, "--quiet", XDG_CACHE_HOME=BUILD / "cache")
        files = {f"playground/{path.relative_to(page)}": path for path in page.rglob("*") if path.is_file()}
        archive(OUT / "thermyo-playground.zip", files)


def wheel(inside):
    """The Python package, with the same inside."""
    environment = BUILD / "python"
    run(sys.executable, "-m", "venv", environment)
    run(environment / "bin/python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", MATURIN)
    maturin = [environment / "bin/python", "-m", "maturin", "build", "--locked", "--profile", "shipped"]
    package = ["--manifest-path", "host-sim/python/Cargo.toml", "--features", "release", "--target", SHARED]
    run(*maturin, *package, "--out", OUT, THERMYO_INSIDE=inside, CARGO_TARGET_DIR=BUILD, **flags(SHARED))


def licence_texts(emulator):
    """The licences of everything that is in it."""
    roots = {"host-sim", "thermyo-fmu", "thermyo-python", "thermyo-playground", "firmware"}
    platforms = sorted({STATIC, SHARED, WASM, *(target for target, _ in IMAGES.values())})
    others = [("musl (MIT)", licences.standard("MIT", "2005-2020 Rich Felker, et al."))]
    for name, path in sorted(emulator.items()):
        if path.name == "LICENSE":
            others.append((f"{path.parent.name} from npm", path.read_text().strip()))
    (OUT / "LICENSES.txt").write_text(licences.texts(roots, platforms, others))
    sysroot = subprocess.run(["rustc", "--print", "sysroot"], check=True, capture_output=True, text=True, cwd=ROOT)
    library = Path(sysroot.stdout.strip(), "share/doc/rust/COPYRIGHT-library.html")
    shutil.copy(library, OUT / "LICENSES-rust-library.html")


def cargo(task, target, *arguments, cwd=ROOT, **variables):
    """A build for a target, without paths of this machine in it."""
    line = ["cargo", task, "--locked", "--quiet", "--target", target, "--target-dir", BUILD, *arguments]
    run(*line, cwd=cwd, **flags(target), **variables)


def flags(target):
    home = Path(os.environ.get("CARGO_HOME") or Path.home() / ".cargo")
    renamed = f"--remap-path-prefix={home}=/cargo --remap-path-prefix={ROOT}=/thermyo"
    # As in `short_paths` of host-sim/boards/src/checkout.rs.
    for source in sorted((home / "registry/src").glob("[!-]*")):
        renamed += f" --remap-path-prefix={source}/="
    return {f"CARGO_TARGET_{target.upper().replace('-', '_').replace('.', '_')}_RUSTFLAGS": renamed}


def run(*line, cwd=ROOT, **variables):
    words = [str(word) for word in line]
    print("+", " ".join(words), flush=True)
    environment = {name: value for name, value in os.environ.items() if not name.endswith("RUSTFLAGS")}
    environment["SOURCE_DATE_EPOCH"] = "315532800"  # The earliest date of a zip archive.
    environment |= {name: str(value) for name, value in variables.items()}
    subprocess.run(words, check=True, cwd=cwd, env=environment)


def compare_with_a_second():
    """The same from a copy of this checkout in another folder."""
    with tempfile.TemporaryDirectory(prefix="somewhere-else-", dir=ROOT / "target") as folder:
        copy = Path(folder, "copy")
        files = subprocess.run(["git", "ls-files", "-z"], check=True, capture_output=True, text=True, cwd=ROOT)
        for name in files.stdout.split("\0"):
            if name and (ROOT / name).is_file():
                (copy / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(ROOT / name, copy / name)
        run(sys.executable, copy / ".ci/dist.py", cwd=copy)
        first, second = ((root / "SHA256SUMS").read_text() for root in (OUT, copy / "target/dist"))
    different = set(first.splitlines()) ^ set(second.splitlines())
    for line in sorted(different, key=lambda line: line.split()[1]):
        print(line)
    print(f"two builds: {len(different) // 2} of {len(first.splitlines())} files differ")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
