"""Errors of a scenario have the messages of the command."""

import pathlib
import types
import warnings

import numpy
import pytest
import thermyo

WRONG = [
    {"run": {"durations": 3}},
    {"run": {"colour": 3}},
    {"runs": {"duration_s": 1}},
    {"run": 3},
    {"muscle": {"zones": -3}},
    {"muscle": {"zones": 2.5}},
    {"heat": {"model": "warm"}},
    {"drive": {"kind": "pressure", "pressure_pa": -1.0}},
    {"plant": {"kind": "table"}},
    {"believed": {"run": {"seed": 3}}},
    {"faults": {"leak": {"from_s": 5.0, "to_s": 2.0}}},
]


def toml(table, path=""):
    """Just enough of TOML for the scenarios above."""
    lines, tables = [], []
    for key, value in table.items():
        if isinstance(value, dict):
            tables.append((f"{path}{key}", value))
        else:
            written = f'"{value}"' if isinstance(value, str) else repr(value)
            lines.append(f"{key} = {written}")
    head = [f"[{path[:-1]}]"] if path else []
    return "\n".join(head + lines + [toml(value, f"{name}.") for name, value in tables])


@pytest.mark.parametrize("scenario", WRONG, ids=str)
def test_a_wrong_dict_raises_what_the_command_says(scenario, command, tmp_path):
    (tmp_path / "scenario").write_text(toml(scenario) + "\n")
    result = command("check", "scenario", cwd=tmp_path)
    assert result.returncode == 2, result
    with pytest.raises(thermyo.ScenarioError) as raised:
        thermyo.check(scenario)
    # The command adds the line; a dict has none.
    place, message = result.stderr.strip().removeprefix("thermyo: ").split(": ", 1)
    assert place.split(":")[0] == "scenario"
    assert str(raised.value) == f"scenario: {message}"
    assert isinstance(raised.value, ValueError)


@pytest.mark.parametrize("scenario", WRONG, ids=str)
def test_everything_that_takes_a_scenario_refuses_it(scenario):
    for use in (thermyo.run, thermyo.Muscle, thermyo.Core):
        with pytest.raises(thermyo.ScenarioError):
            use(scenario)


def test_a_file_a_text_and_a_dict_are_the_same_scenario(tmp_path):
    text = "[run]\nduration_s = 0.2\n[muscle]\nzones = 4\n"
    (tmp_path / "a.toml").write_text(text)
    as_dict = {"run": {"duration_s": numpy.float64(0.2)}, "muscle": {"zones": numpy.int32(4)}}
    forms = (text, tmp_path / "a.toml", str(tmp_path / "a.toml"), as_dict)
    assert len({thermyo.check(scenario) for scenario in forms}) == 1
    assert thermyo.check("") == thermyo.check({})


def test_a_text_with_a_mistake_has_its_line():
    with pytest.raises(thermyo.ScenarioError, match="^scenario:2: unknown key run.durations; did you"):
        thermyo.check("[run]\ndurations = 1\n")


def test_a_file_that_is_not_there_is_said():
    with pytest.raises(thermyo.ScenarioError, match="^nowhere.toml: no such file$"):
        thermyo.run("nowhere.toml")


@pytest.mark.parametrize("value", [None, object(), {1: 2}, b"a\xff"], ids=repr)
def test_what_no_scenario_holds_is_refused(value):
    with pytest.raises(thermyo.ScenarioError, match="^scenario: run.duration_s|^scenario: run = "):
        thermyo.check({"run": {"duration_s": value}})


def endless():
    table, items = {}, []
    table["run"], deep = table, {}
    items.append(items)
    for _ in range(20_000):
        deep = {"run": deep}
    return [table, {"run": items}, deep]


@pytest.mark.parametrize("scenario", endless(), ids=["dict", "list", "deep"])
def test_what_has_no_end_is_refused(scenario):
    with pytest.raises(thermyo.ScenarioError, match="^scenario: run.*: must not be nested more than 32 deep$"):
        thermyo.run(scenario)


def test_a_key_is_a_text_and_no_path():
    for scenario, message in [
        ({1: {}}, "scenario: key 1: must be a text"),
        ({"run": {2: 3}}, "scenario: run: key 2: must be a text"),
        (
            {"run.duration_s": 0.05},
            'scenario: unknown key "run.duration_s": a table is a dict, {"run": {"duration_s": ...}}',
        ),
        (
            {"believed": {"sensor.gas.span": 1}},
            'scenario: believed: unknown key "sensor.gas.span": a table is a dict, {"sensor": {"gas": {"span": ...}}}',
        ),
    ]:
        with pytest.raises(thermyo.ScenarioError) as raised:
            thermyo.check(scenario)
        assert str(raised.value) == message


def test_any_mapping_is_a_dict():
    scenario = types.MappingProxyType({"run": types.MappingProxyType({"duration_s": 0.1})})
    run = thermyo.run(scenario)
    assert thermyo.to_csv(types.MappingProxyType(run)) == thermyo.to_csv(run)


@pytest.mark.parametrize("seed", [-1, 2**64 - 1, 2**70, 1.5, "7", True])
def test_a_seed_is_refused_as_that_of_a_dict(seed):
    for use in (thermyo.run, thermyo.Muscle):
        with pytest.raises(thermyo.ScenarioError, match="^scenario: run.seed = ") as raised:
            use({}, seed=seed)
        with pytest.raises(thermyo.ScenarioError) as in_dict:
            use({"run": {"seed": seed}})
        assert str(raised.value) == str(in_dict.value)


@pytest.mark.parametrize("seed", [2**53 + 1, 2**63 - 1, numpy.int64(7)])
def test_a_seed_keeps_every_digit(seed):
    def trace(seed_of_dict, **keywords):
        return thermyo.to_csv(thermyo.run({"run": {"duration_s": 0.1, "seed": seed_of_dict}}, **keywords))

    assert trace(1, seed=seed) == trace(seed) != trace(seed - 1)


def test_what_makes_no_sense_warns_and_runs(command, tmp_path):
    scenario = {"run": {"duration_s": 0.01}, "supply": {"pressure_pa": 90e3}}
    (tmp_path / "scenario").write_text(toml(scenario) + "\n")
    result = command("check", "--quiet", "scenario", cwd=tmp_path).stderr.strip()
    with pytest.warns(thermyo.ScenarioWarning) as warned:
        thermyo.run(scenario)
    assert str(warned[0].message).split(": ", 1)[1] in result


def test_columns_beside_a_file_and_paths_in_a_dict(tmp_path):
    (tmp_path / "profile.csv").write_text("time_s,value\n0,150e3\n1,200e3\n")
    drive = {"kind": "pressure", "profile_csv": tmp_path / "profile.csv"}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = thermyo.run({"run": {"duration_s": 1.0}, "drive": drive})
    assert run["set_point"][-1] == 200e3
    missing = pathlib.Path("missing.csv")
    with pytest.raises(thermyo.ScenarioError, match="^scenario: drive.profile_csv: missing.csv: no such file"):
        thermyo.check({"drive": {"kind": "pressure", "profile_csv": missing}})


def test_another_type_is_named():
    with pytest.raises(thermyo.ScenarioError, match="^a scenario of type int: must be a path, "):
        thermyo.run(3)
