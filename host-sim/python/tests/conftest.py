"""Scenarios of the repository, and the command to compare with."""

import os
import pathlib
import subprocess

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]


@pytest.fixture(scope="session")
def scenarios():
    return ROOT / "scenarios"


@pytest.fixture(scope="session")
def command():
    """Runs `thermyo` with arguments; returns its exit code and output."""
    binary = os.environ.get("THERMYO", ROOT / "target" / "release" / "thermyo")

    def run(*arguments, cwd=ROOT):
        return subprocess.run([binary, *arguments], cwd=cwd, capture_output=True, text=True)

    return run
