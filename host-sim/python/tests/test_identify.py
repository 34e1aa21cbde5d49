"""Identification: the results of the command, from a file or from columns."""

import json

import pytest
import thermyo

TRUE = {"run": {"duration_s": 10.0}, "plant": {"model": "lumped"}}
GUESS = {**TRUE, "heat": {"scale": 0.7}, "identify": {"parameters": ["heat.scale"]}}


@pytest.fixture(scope="module")
def measured():
    run = thermyo.run(TRUE)
    wanted = ("time_s", "sensor_gas_k", "pressure_pa", "length_m", "duty_in", "duty_out")
    return {name: run[name] for name in wanted}


def test_it_finds_what_the_command_finds(measured, command, tmp_path):
    (tmp_path / "data.csv").write_text(thermyo.to_csv(measured))
    (tmp_path / "guess.toml").write_text(thermyo.check(GUESS))
    arguments = (tmp_path / "data.csv", "--config", tmp_path / "guess.toml", "--json", "--quiet")
    result = json.loads(command("identify", *arguments, "--out", tmp_path / "out").stdout)
    found = thermyo.identify(measured, GUESS)
    scenario = found.pop("scenario")
    assert found == result
    assert scenario == (tmp_path / "out" / "identified.toml").read_text()
    found = thermyo.identify(tmp_path / "data.csv", tmp_path / "guess.toml")
    assert found["parameters"] == result["parameters"]
    thermyo.Core(scenario)


def test_data_with_a_mistake_are_refused(measured):
    with pytest.raises(thermyo.ScenarioError, match="^data: unknown column colour"):
        thermyo.identify({**measured, "colour": measured["time_s"]}, GUESS)
    with pytest.raises(thermyo.ScenarioError, match="identify.parameters is missing"):
        thermyo.identify(measured, TRUE)
    found = thermyo.identify(measured, GUESS, against=measured)
    assert found["against"] == found["rmse"]


def test_a_joint_is_identified_as_by_the_command(command, tmp_path):
    joint = {"run": {"duration_s": 12.0}, "plant": {"model": "lumped"}, "joint": {"gravity_n_m": 2.0}}
    joint["drive"] = {"shape": "sine", "amplitude_rad": "30 deg", "period_s": 3.0}
    run = thermyo.run(joint)
    data = {name: run[name] for name in ("time_s", "angle_rad", "a_pressure_pa", "b_pressure_pa")}
    (tmp_path / "data.csv").write_text(thermyo.to_csv(data))
    (tmp_path / "joint.toml").write_text(thermyo.check(joint))
    out = tmp_path / "out"
    options = ("--config", tmp_path / "joint.toml", "--out", out, "--json", "--quiet")
    result = json.loads(command("identify", tmp_path / "data.csv", *options).stdout)
    found = thermyo.identify(data, joint)
    assert found.pop("scenario") == (out / "identified.toml").read_text()
    assert found == result
    with pytest.raises(thermyo.ScenarioError, match="^against: is for one muscle"):
        thermyo.identify(data, joint, against=data)
