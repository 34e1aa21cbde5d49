"""Units by FMPy: they are valid, and their runs are the command's."""

import csv
import os
import pathlib
import subprocess
import zipfile

import fmpy
import fmpy.fmi3
import numpy
import pytest
from fmpy.validation import validate_fmu

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCENARIOS = ROOT / "scenarios"
COMMAND = os.environ.get("THERMYO", ROOT / "target" / "release" / "thermyo")


def thermyo(*arguments):
    return subprocess.run([COMMAND, *arguments], cwd=ROOT, capture_output=True, text=True)


def unit(folder, scenario, *options):
    done = thermyo("fmu", scenario, "-o", folder / "unit.fmu", "--quiet", *options)
    assert done.returncode == 0, done.stderr
    return str(folder / "unit.fmu")


def trace(folder, scenario):
    done = thermyo("run", scenario, "--quiet", "--out", folder / "run")
    assert done.returncode == 0, done.stderr
    [name] = (folder / "run").glob("*trace.csv")
    with open(name) as file:
        rows = list(csv.DictReader(file))
    return {name: numpy.array([float(row[name] or "nan") for row in rows]) for name in rows[0]}


def differences(result, expected, every=1):
    """The largest difference of each output, relative to the largest value of its column."""
    found = {}
    for name in set(result.dtype.names) - {"time"}:
        own, column = result[name], expected[name][::every]
        scale = numpy.abs(column).max() or 1.0
        found[name] = numpy.abs(own - column[: len(own)]).max() / scale
    assert len(own) == len(column)
    return found


@pytest.mark.parametrize("options", [(), ("--with-core",)])
@pytest.mark.parametrize("name", sorted(path.stem for path in SCENARIOS.glob("*.toml")))
def test_every_scenario_makes_a_valid_unit(name, options, tmp_path):
    assert validate_fmu(unit(tmp_path, SCENARIOS / f"{name}.toml", *options)) == []


@pytest.mark.parametrize("name", ["nominal", "reproduce", "contraction", "bellows", "joint", "joint_board", "joint_pulley"])
def test_plant_and_core_are_the_run(name, tmp_path):
    scenario = SCENARIOS / f"{name}.toml"
    expected = trace(tmp_path, scenario)
    time = expected["time_s"]
    result = fmpy.simulate_fmu(
        unit(tmp_path, scenario, "--with-core"), stop_time=time[-1], output_interval=time[1] - time[0]
    )
    found = differences(result, expected)
    print(f"{name}: {time[-1]} s, largest relative difference {max(found.values())}")
    assert max(found.values()) < 1e-9, found


def test_a_plant_driven_as_it_was_is_the_run(tmp_path):
    """Its openings change with every period of the PWM: FMPy is slow at events, so that it is not 100 s."""
    scenario = tmp_path / "every_step.toml"
    scenario.write_text('[run]\nduration_s = 20.0\nlog_every = 1\n[plant]\nmodel = "full"\n')
    expected = trace(tmp_path, scenario)
    names = ["time_s", "duty_in", "duty_out"]
    signals = numpy.rec.fromarrays([expected[name] for name in names], names=["time", *names[1:]])
    result = fmpy.simulate_fmu(
        unit(tmp_path, scenario), stop_time=20.0, output_interval=0.001, input=signals
    )
    found = differences(result, expected)
    print(f"plant: 20 s, largest relative difference {max(found.values())}")
    assert max(found.values()) < 1e-9, found


def test_variables_of_a_joint_have_units_and_descriptions(tmp_path):
    for options in ((), ("--with-core",)):
        (tmp_path / "unit.fmu").unlink(missing_ok=True)
        description = fmpy.read_model_description(unit(tmp_path, SCENARIOS / "joint.toml", *options))
        units = {variable.name: variable.unit for variable in description.modelVariables}
        assert all(variable.description for variable in description.modelVariables)
        assert (units["angle_rad"], units["stiffness_n_m_rad"], units["load_n_m"]) == ("rad", "N m/rad", "N m")
        assert (units["speed_rad_s"], units["a_tension_n"], units["b_pressure_pa"]) == ("rad/s", "N", "Pa")


def test_variables_have_units_and_descriptions(tmp_path):
    for options in ((), ("--with-core",)):
        (tmp_path / "unit.fmu").unlink(missing_ok=True)
        description = fmpy.read_model_description(unit(tmp_path, SCENARIOS / "nominal.toml", *options))
        units = {variable.name: variable.unit for variable in description.modelVariables}
        assert all(variable.description for variable in description.modelVariables)
        assert (units["pressure_pa"], units["flow_in_kg_s"], units["volume_m3"]) == ("Pa", "kg/s", "m3")
        assert (units["time_s"], units["gas_temperature_k"], units["duty_in"]) == ("s", "K", None)


def test_it_brings_the_tables_that_its_scenario_names(tmp_path):
    with zipfile.ZipFile(unit(tmp_path, SCENARIOS / "bellows.toml")) as archive:
        assert archive.read("resources/table.csv") == (SCENARIOS / "bellows.csv").read_bytes()
        assert b'csv = "table.csv"' in archive.read("resources/plant.toml")


def test_a_joint_brings_its_tables(tmp_path):
    (tmp_path / "course.csv").write_text("time_s,angle_rad,stiffness_n_m_rad\n0,0,14\n0.5,0.1,16\n1,0,14\n")
    (tmp_path / "load.csv").write_text("time_s,torque_n_m\n0,0\n1,1\n")
    scenario = tmp_path / "driven.toml"
    scenario.write_text(
        "[run]\nduration_s = 1\nlog_every = 1\n[joint]\n[drive]\nprofile_csv = \"course.csv\"\nload_csv = \"load.csv\"\n"
    )
    file = unit(tmp_path, scenario, "--with-core")
    with zipfile.ZipFile(file) as archive:
        assert archive.read("resources/load.csv") == (tmp_path / "load.csv").read_bytes()
        assert b'profile_csv = "profile.csv"' in archive.read("resources/plant_and_core.toml")
    expected = trace(tmp_path, scenario)
    found = differences(fmpy.simulate_fmu(file, stop_time=1.0, output_interval=0.001), expected)
    assert max(found.values()) == 0.0, found


def test_two_of_one_scenario_are_the_same_bytes(tmp_path):
    made = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        made.append(pathlib.Path(unit(tmp_path / name, SCENARIOS / "nominal.toml")).read_bytes())
    assert made[0] == made[1]


@pytest.fixture
def instance(tmp_path):
    """Makes instances on their own, with what they log."""
    made = []

    def make(*options, scenario=SCENARIOS / "contraction.toml", token=None):
        file = unit(tmp_path, scenario, *options)
        description = fmpy.read_model_description(file)
        slave = fmpy.fmi3.FMU3Slave(
            guid=token or description.guid,
            unzipDirectory=fmpy.extract(file, tmp_path / "unit"),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="instance",
        )
        said = []
        slave.said = said
        # Kept: the library calls it.
        slave.ear = fmpy.fmi3.fmi3LogMessageCallback(
            lambda _environment, status, _category, text: said.append((status, text.decode()))
        )
        slave.references = {variable.name: variable.valueReference for variable in description.modelVariables}
        slave.instantiate(logMessage=slave.ear)
        made.append(slave)
        return slave

    yield make
    for slave in made:
        if slave.component:
            slave.freeInstance()


def started(slave, **values):
    slave.enterInitializationMode()
    for name, value in values.items():
        give = slave.setBoolean if isinstance(value, bool) else slave.setFloat64
        give([slave.references[name]], [value])
    slave.exitInitializationMode()
    return slave


DISCARD, ERROR = 2, 3


def test_a_plant_stepped_for_100_s_is_the_run(instance, tmp_path):
    scenario = tmp_path / "every_step.toml"
    text = (SCENARIOS / "nominal.toml").read_text()
    scenario.write_text(text.replace("[run]\n", "[run]\nlog_every = 1\n"))
    expected = trace(tmp_path, scenario)
    slave = started(instance(scenario=scenario))
    names = [name for name in slave.references if name in expected and not name.startswith("duty")]
    references, inputs = [slave.references[name] for name in names], [1, 2]
    rows = [slave.getFloat64(references)]
    for row, duties in enumerate(zip(expected["duty_in"][:-1], expected["duty_out"])):
        slave.setFloat64(inputs, duties)
        slave.doStep(row * 0.001, 0.001)
        rows.append(slave.getFloat64(references))
    assert len(rows) == 100_001
    for name, column in zip(names, numpy.array(rows).T):
        assert numpy.abs(column - expected[name]).max() <= 1e-9 * numpy.abs(expected[name]).max(), name


def test_the_plant_of_a_joint_stepped_is_the_run(instance, tmp_path):
    scenario = tmp_path / "every_step.toml"
    scenario.write_text((SCENARIOS / "joint.toml").read_text().replace("log_every = 5", "log_every = 1"))
    expected = trace(tmp_path, scenario)
    slave = started(instance(scenario=scenario))
    inputs = ["a_duty_in", "a_duty_out", "b_duty_in", "b_duty_out", "load_n_m"]
    names = [name for name in slave.references if name in expected and name not in inputs]
    references = [slave.references[name] for name in names]
    rows = [slave.getFloat64(references)]
    for row in range(len(expected["time_s"]) - 1):
        slave.setFloat64([slave.references[name] for name in inputs], [expected[name][row] for name in inputs])
        slave.doStep(row * 0.001, 0.001)
        rows.append(slave.getFloat64(references))
    assert len(rows) == 6001
    for name, column in zip(names, numpy.array(rows).T):
        assert numpy.abs(column - expected[name]).max() <= 1e-9 * numpy.abs(expected[name]).max(), name


@pytest.mark.parametrize("length_s", [0.0015, 0.0004, 0.0, -0.001, float("nan")])
def test_a_step_of_another_length_is_discarded_and_nothing_is_lost(length_s, instance):
    slave = started(instance())
    slave.doStep(0.0, 0.002)
    before = slave.getFloat64(range(15))
    with pytest.raises(fmpy.fmi1.FMICallException) as raised:
        slave.doStep(0.002, length_s)
    assert raised.value.status == DISCARD
    [(status, text)] = slave.said
    assert status == DISCARD
    assert text.endswith("must be a whole number of steps of 0.001 s, at least one")
    assert slave.getFloat64(range(15)) == before
    slave.doStep(0.002, 0.001)
    assert slave.getFloat64([0]) == [pytest.approx(0.003)]


@pytest.mark.parametrize("from_s", [0.001, 0.003, float("nan")])
def test_a_step_from_another_time_is_an_error(from_s, instance):
    slave = started(instance())
    slave.doStep(0.0, 0.002)
    with pytest.raises(fmpy.fmi1.FMICallException) as raised:
        slave.doStep(from_s, 0.001)
    assert raised.value.status == ERROR
    [(status, text)] = slave.said
    assert status == ERROR and text.endswith("the time is 0.002 s: a unit cannot go back, or leave out time")


def test_a_call_out_of_turn_is_an_error_and_changes_nothing(instance):
    slave = instance()
    with pytest.raises(fmpy.fmi1.FMICallException) as raised:
        slave.doStep(0.0, 0.001)
    assert raised.value.status == ERROR
    started(slave)
    slave.doStep(0.0, 0.002)
    before = slave.getFloat64(range(15))
    with pytest.raises(fmpy.fmi1.FMICallException) as raised:
        slave.enterInitializationMode()
    assert raised.value.status == ERROR
    assert [text.partition(": ")[2] for _, text in slave.said] == [
        "must come after fmi3ExitInitializationMode",
        "must come before the first step, or after fmi3Reset",
    ]
    assert slave.getFloat64(range(15)) == before
    slave.doStep(0.002, 0.001)


def test_values_out_of_their_range_are_refused(instance):
    slave = started(instance())
    for value in (-0.1, 1.1, float("nan")):
        with pytest.raises(fmpy.fmi1.FMICallException):
            slave.setFloat64([slave.references["duty_in"]], [value])
    assert [text for _, text in slave.said[:2]] == [
        "duty_in = -0.1: must be from 0 to 1",
        "duty_in = 1.1: must be from 0 to 1",
    ]
    for reference in (0, slave.references["pressure_pa"], 999):
        with pytest.raises(fmpy.fmi1.FMICallException):
            slave.setFloat64([reference], [1.0])
    assert slave.said[-1] == (ERROR, "value reference 999: no number that can be set")
    with pytest.raises(fmpy.fmi1.FMICallException):
        slave.getFMUState()
    assert slave.said[-1] == (ERROR, "fmi3GetFMUState: this unit has no such thing")


def test_a_set_point_of_the_importer_is_held(instance, tmp_path):
    scenario = tmp_path / "pressure.toml"
    scenario.write_text('[plant]\nmodel = "lumped"\n[drive]\nkind = "pressure"\npressure_pa = 150e3\n')
    slave = started(instance("--with-core", scenario=scenario), follow_scenario=False, set_point=170e3)
    pressure, set_point = slave.references["pressure_pa"], slave.references["set_point"]
    slave.doStep(0.0, 4.0)
    assert slave.getFloat64([pressure]) == [pytest.approx(170e3, abs=2e3)]
    slave.setFloat64([set_point], [200e3])
    slave.doStep(4.0, 4.0)
    assert slave.getFloat64([pressure]) == [pytest.approx(200e3, abs=2e3)]
    slave.setFloat64([set_point], [9e9])
    with pytest.raises(fmpy.fmi1.FMICallException) as raised:
        slave.doStep(8.0, 1.0)
    assert raised.value.status == DISCARD and "set_point = 9000000000: must be from 0 to " in slave.said[-1][1]
    with pytest.raises(fmpy.fmi1.FMICallException):
        slave.setBoolean([slave.references["follow_scenario"]], [True])


def test_a_unit_starts_anew_after_a_reset(instance):
    slave = started(instance("--with-core"))
    outputs = list(range(3, 29))
    slave.doStep(0.0, 1.0)
    first = slave.getFloat64(outputs)
    slave.reset()
    started(slave)
    assert slave.getFloat64([0]) == [0.0]
    slave.doStep(0.0, 1.0)
    assert slave.getFloat64(outputs) == first


def test_another_token_makes_no_instance(instance):
    with pytest.raises(Exception, match="instantiate"):
        instance(token="another")


def test_bad_input_to_the_command_leaves_nothing(tmp_path):
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("[run]\ndurations = 1\n")
    said = thermyo("fmu", wrong, "-o", tmp_path / "wrong.fmu")
    assert said.returncode == 2 and "wrong.toml:2: unknown key run.durations" in said.stderr
    assert not (tmp_path / "wrong.fmu").exists()
    (tmp_path / "there.fmu").write_text("mine")
    said = thermyo("fmu", SCENARIOS / "nominal.toml", "-o", tmp_path / "there.fmu")
    assert said.returncode == 2 and "there.fmu: exists already" in said.stderr
    assert (tmp_path / "there.fmu").read_text() == "mine"
