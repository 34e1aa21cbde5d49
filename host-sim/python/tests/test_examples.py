"""The examples run as they are; each needs an optional package."""

import json
import os
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[3]
EXAMPLES = ROOT / "host-sim" / "python" / "examples"


def run(*arguments, cwd):
    environment = {**os.environ, "MPLBACKEND": "agg", "TMPDIR": str(cwd)}
    done = subprocess.run(
        [sys.executable, *arguments], cwd=cwd, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def folder(tmp_path):
    """A folder from which the scenarios are found as from the checkout."""
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    return tmp_path


def test_figure_5(folder):
    pytest.importorskip("matplotlib")
    text = (EXAMPLES / "figure_5.py").read_text().split('"""\n', 1)[1]
    assert len([line for line in text.splitlines() if line]) <= 10
    run(EXAMPLES / "figure_5.py", cwd=folder)
    assert (folder / "figure_5.png").read_bytes().startswith(b"\x89PNG")


def test_the_environment(folder):
    pytest.importorskip("gymnasium")
    result = run(EXAMPLES / "gym_env.py", cwd=folder)
    assert 0.1 < float(result.split()[2]) < 20.0, result
    sys.path.insert(0, str(EXAMPLES))
    from gym_env import MuscleEnv

    from gymnasium.utils.env_checker import check_env

    check_env(MuscleEnv(), skip_render_check=True)


def test_the_notebook(folder):
    pytest.importorskip("matplotlib")
    cells = json.loads((EXAMPLES / "muscle.ipynb").read_text())["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    on_a_board = [cell for cell in code if '"emulated"' in cell["source"]]
    assert len(on_a_board) == 1 and sum("thermyo.Sweep(" in cell["source"] for cell in code) == 1
    skipped = "THERMYO_SKIP_EMULATOR" in os.environ
    if skipped:
        code = [cell for cell in code if cell not in on_a_board]
    (folder / "notebook.py").write_text("\n".join(cell["source"] for cell in code))
    result = run("notebook.py", cwd=folder)
    assert "scenario: unknown key run.durations; did you mean run.duration_s?" in result
    assert skipped or 155.0 < float(result.split(" kPa")[0].split()[-1]) < 165.0, result
