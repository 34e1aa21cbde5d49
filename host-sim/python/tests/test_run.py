"""Whole runs: the same bytes as the command's."""

import ast
import json
import pathlib
import subprocess
import sys
import threading
import time

import numpy
import pytest
import thermyo


def test_the_import_names_numpy_where_it_is_missing():
    code = "import sys; sys.modules['numpy'] = None; import thermyo"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    last = run.stderr.splitlines()[-1]
    assert run.returncode == 1 and last.startswith("ModuleNotFoundError: ") and "numpy" in last, last


@pytest.mark.parametrize("name", ["nominal", "contraction", "reproduce", "bellows"])
def test_a_run_gives_the_bytes_of_the_command(name, scenarios, command, tmp_path):
    scenario = scenarios / f"{name}.toml"
    assert command("run", scenario, "--quiet", "--out", tmp_path).returncode == 0
    run = thermyo.run(scenario)
    assert thermyo.to_csv(run) == (tmp_path / "trace.csv").read_text()
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert run["summary"].keys() == summary.keys()
    assert run["summary"]["ledger"] == summary["ledger"]


def test_a_joint_runs_as_by_the_command(scenarios, command, tmp_path):
    scenario = scenarios / "joint.toml"
    assert command("run", scenario, "--quiet", "--out", tmp_path).returncode == 0
    run = thermyo.run(scenario)
    assert thermyo.to_csv(run) == (tmp_path / "joint_trace.csv").read_text()
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert run.summary.keys() == summary.keys() and run.summary["rms_error_rad"] == summary["rms_error_rad"]
    assert run.plot().axes[0].get_ylabel() == "angle / rad"
    assert thermyo.check(scenario) == (tmp_path / "scenario.toml").read_text()
    short = {"run": {"duration_s": 0.1}, "joint": {"b": {"muscle": {"bladder_stiffness_n_m": 700.0}}}}
    default, other = (thermyo.run(short, seed=seed)["a_sensor_gas_k"] for seed in (None, 7))
    assert (default != other).any()
    with pytest.raises(thermyo.ScenarioError, match="^scenario: joint.radius_m = 20.0: must be a number from 0.001 to 10 m"):
        thermyo.run({"joint": {"radius_m": 20.0}})


def test_columns_are_arrays_of_float(scenarios):
    run = thermyo.run(scenarios / "nominal.toml")
    columns = {name: column for name, column in run.items() if name != "summary"}
    assert len(columns) == 37
    for name, column in columns.items():
        assert column.dtype == numpy.float64 and column.shape == run["time_s"].shape, name
    assert run["time_s"][0] == 0.0 and run["time_s"][-1] == 100.0


def test_a_run_is_a_table_and_a_figure():
    run = thermyo.run({"run": {"duration_s": 0.5}, "supply": {"pressure_pa": "6 bar"}})
    assert isinstance(run, dict) and isinstance(run, thermyo.Run)
    assert run.summary is run["summary"] and "summary" not in run.columns
    assert repr(run) == f"<thermyo.Run of {len(run['time_s'])} rows and {len(run.columns)} columns>"
    figure = run.plot()
    assert [axis.get_ylabel() for axis in figure.axes][:2] == ["pressure / kPa", "gas_temperature / K"]
    pressure_kpa = figure.axes[0].lines[0].get_ydata()
    assert numpy.allclose(pressure_kpa * 1e3, run["pressure_pa"])
    with pytest.raises(KeyError, match="presure_pa: must be one of time_s, "):
        run.plot("presure_pa")
    pytest.importorskip("pandas")
    table = run.to_pandas()
    assert table.index.name == "time_s" and (table["pressure_pa"].to_numpy() == run["pressure_pa"]).all()


def test_a_seed_takes_the_place_of_the_scenarios():
    scenario = {"run": {"duration_s": 0.1}}
    default, other, again = (thermyo.run(scenario, seed=seed) for seed in (None, 7, 7))
    in_scenario = thermyo.run({"run": {"duration_s": 0.1, "seed": 7}})
    assert thermyo.to_csv(other) == thermyo.to_csv(again) == thermyo.to_csv(in_scenario)
    assert thermyo.to_csv(other) != thermyo.to_csv(default)


def test_it_replays_from_what_python_writes(command, tmp_path):
    scenario = {"run": {"duration_s": 2.0, "log_every": 1}}
    (tmp_path / "trace.csv").write_text(thermyo.to_csv(thermyo.run(scenario)))
    (tmp_path / "scenario.toml").write_text(thermyo.check(scenario))
    replay = command("replay", tmp_path / "trace.csv", "--quiet", "--json", "--out", tmp_path / "replay")
    assert replay.returncode == 0, replay.stderr
    result = json.loads(replay.stdout)
    assert (result["steps"], result["mismatches"]) == (2001, 0)


def test_the_lock_is_let_go_of():
    """Another thread counts while a run goes on."""
    counted, stop = [0], threading.Event()

    def count():
        while not stop.is_set():
            counted[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    thermyo.run({"run": {"duration_s": 20.0}})
    stop.set()
    thread.join()
    assert counted[0] > 20


def test_unequal_columns_are_no_table():
    with pytest.raises(ValueError, match="column b has 3 rows and column a has 2: must be as many"):
        thermyo.to_csv({"a": [1.0, 2.0], "b": [1.0, 2.0, 3.0]})
    assert thermyo.to_csv({"a": [1, 2], "b": [0.5, float("nan")]}) == "a,b\n1,0.5\n2,\n"


def test_a_table_that_is_none_names_the_column():
    for name in ["a,b", "a\nb", 'a"b']:
        with pytest.raises(ValueError, match="must have no comma, quotation mark or line end"):
            thermyo.to_csv({name: [1.0]})
    for column in [None, 1.0, [[1.0], [2.0]], object()]:
        with pytest.raises(TypeError, match="^column a: must be a list or an array of numbers$"):
            thermyo.to_csv({"a": column})
    with pytest.raises(ValueError, match="^column a: could not convert string to float: 'x'$"):
        thermyo.to_csv({"a": [1.0, "x"]})


LARGE = """
import resource, thermyo
resource.setrlimit(resource.RLIMIT_AS, (8 << 30, 8 << 30))
try:
    thermyo.run({"run": {"duration_s": 1e5, "log_every": 1}})
except MemoryError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the limit is that of Linux")
def test_a_run_that_the_memory_does_not_hold_leaves_the_interpreter():
    result = subprocess.run([sys.executable, "-W", "ignore", "-c", LARGE], capture_output=True, text=True)
    assert result.stdout == "100000002 rows of 37 columns: with a larger run.log_every there are fewer\n", result.stderr


def test_every_public_name_has_its_stub():
    text = pathlib.Path(thermyo.__file__).with_name("__init__.pyi").read_text()
    body = ast.parse(text).body
    stubs = {node.name: node for node in body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
    assert stubs.keys() == {name for name in dir(thermyo) if not name.startswith("_")} - {"thermyo"}
    for name in ("Board", "Core", "Muscle", "Output", "Readings", "Stream"):
        stated = {item.name for item in stubs[name].body if isinstance(item, ast.FunctionDef)}
        there = {member for member in dir(getattr(thermyo, name)) if not member.startswith("_")}
        assert there == {member for member in stated if not member.startswith("_")}, name
