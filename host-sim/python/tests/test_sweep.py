"""Sweeps point by point: the rows of the command's table."""

import os
import signal
import threading
import time

import pytest
import thermyo

SCENARIO = "[run]\nduration_s = 0.5\n"
VARY = ["sensor.gas.time_constant_s=0.1:10:log", "plant.model=lumped,full"]


def test_rows_are_the_commands(command, tmp_path):
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    vary = [word for text in VARY for word in ("--vary", text)]
    result = command("sweep", tmp_path / "scenario.toml", "--lhs", "6", "--seed", "4", *vary, "--out", tmp_path / "out")
    assert result.returncode == 0, result.stderr
    sweep = thermyo.Sweep(SCENARIO, VARY, lhs=6, seed=4)
    lines = [sweep.header] + [sweep.row(point) for point in range(1, len(sweep) + 1)]
    assert "\n".join(lines) + "\n" == (tmp_path / "out" / "sweep.csv").read_text()
    values = sweep.values(1)
    assert values.startswith("sensor.gas.time_constant_s = ") and ", plant.model = " in values


def test_rows_of_a_joint_are_the_commands(command, tmp_path):
    text = '[run]\nduration_s = 0.3\n[plant]\nmodel = "lumped"\n[joint]\n[drive]\nangle_rad = 0.1\n'
    (tmp_path / "scenario.toml").write_text(text)
    vary = ["joint.inertia_kg_m2=0.02,0.05", "joint.b.muscle.bladder_stiffness_n_m=600,700"]
    words = [word for text in vary for word in ("--vary", text)]
    result = command("sweep", tmp_path / "scenario.toml", *words, "--out", tmp_path / "out")
    assert result.returncode == 0, result.stderr
    sweep = thermyo.Sweep(text, vary)
    lines = [sweep.header] + [sweep.row(point) for point in range(1, len(sweep) + 1)]
    assert len(sweep) == 4
    assert "\n".join(lines) + "\n" == (tmp_path / "out" / "sweep.csv").read_text()


def test_rows_are_dicts_too():
    sweep = thermyo.Sweep(SCENARIO, ["supply.pressure_pa=5bar,6bar"])
    record = sweep.record(2)
    assert (record["point"], record["supply.pressure_pa"], record["failure"]) == (2, 600000, None)
    assert record["estimate_rmse_k"] > 0 and "checksum" not in record


def test_seeds_keep_every_digit():
    seeds = [2**53 + 1, 2**53 + 3]
    sweep = thermyo.Sweep(SCENARIO, [f"run.seed={seeds[0]},{seeds[1]}"])
    for point, seed in enumerate(seeds, 1):
        assert sweep.values(point) == f"run.seed = {seed}"
        assert sweep.row(point).startswith(f"{point},{seed},{seed},")


def test_what_cannot_be_varied_says_what_the_command_says():
    for vary, message in [
        (["sensor.gas.span=0:1"], "must have a COUNT"),
        (["sensor.gas.spam=0:1:2"], "unknown key sensor.gas.spam; did you mean sensor.gas.span?"),
        (["sensor.gas.span"], "must be KEY=FROM:TO:COUNT"),
        ([], "^vary is missing: at least one key"),
        (["run.seed=1:2"], "^vary run.seed=1:2: must have a COUNT: KEY=FROM:TO:COUNT; or give lhs N$"),
    ]:
        with pytest.raises(thermyo.ScenarioError, match=message.replace("?", r"\?")):
            thermyo.Sweep(SCENARIO, vary)
    for vary in ("run.seed=1,2", [1], 3):
        with pytest.raises(TypeError, match="^vary: must be a list of texts"):
            thermyo.Sweep(SCENARIO, vary)
    with pytest.raises(IndexError, match="^point -1: must be 1 to 2$"):
        thermyo.Sweep(SCENARIO, ["plant.model=lumped,full"]).row(-1)
    with pytest.raises(ValueError, match="^seed = -1: must be from 0 to "):
        thermyo.Sweep(SCENARIO, ["run.seed=1,2"], seed=-1)
    with pytest.raises(ValueError, match="^lhs = -1: must be from 1 to 10000000$"):
        thermyo.Sweep(SCENARIO, VARY, lhs=-1)
    with pytest.raises(IndexError, match="must be 1 to 2"):
        thermyo.Sweep(SCENARIO, ["sensor.gas.span=0:1:2"]).row(3)


def test_a_point_that_fails_is_a_row(tmp_path):
    (tmp_path / "piston.csv").write_text("time_s,volume_m3\n0,0.001\n1,0.000001\n")
    scenario = {
        "run": {"duration_s": 0.5},
        "plant": {"kind": "vessel"},
        "vessel": {"volume_csv": tmp_path / "piston.csv"},
        "heat": {"model": "adiabatic"},
        "drive": {"kind": "closed"},
    }
    sweep = thermyo.Sweep(scenario, ["run.duration_s=0.5,1"])
    assert sweep.row(1).split(",")[-2] == ""
    assert ',"the plant diverged at ' in sweep.row(2)


@pytest.mark.parametrize("use", [thermyo.run, lambda scenario: thermyo.Sweep(scenario, ["run.seed=1,2"]).row(1)])
def test_ctrl_c_ends_what_takes_long(use):
    # A job in the background starts with this signal ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        use({"run": {"duration_s": 2000.0}, "plant": {"model": "lumped"}})
    assert time.monotonic() - start < 2.0
