"""Plant and core, a step at a time."""

import numpy
import pytest
import thermyo

COLUMNS = ["time_s", "pressure_pa", "volume_m3", "length_m", "mass_kg", "flow_in_kg_s", "flow_out_kg_s"]
COLUMNS += ["gas_temperature_k", "wall_temperature_k", "sensor_gas_k", "sensor_wall_k", "code_pressure"]
COLUMNS += ["code_gas", "code_length", "measured_pressure_pa", "measured_length_m"]
OUTPUTS = ["estimate_k", "estimate_sd_k", "duty_in", "duty_out", "wall_estimate_k", "sensor_estimate_k"]
OUTPUTS += ["mass_estimate_kg", "heat_scale", "sensor_lag_s", "measured_pressure_pa", "measured_length_m"]
OUTPUTS += ["step", "estimate_valid", "limited"]


def nominal(**tables):
    return {"run": {"duration_s": 2.0, "log_every": 1}, "plant": {"model": "lumped"}, **tables}


@pytest.mark.parametrize("model", ["lumped", "full", "paper"])
def test_plant_and_core_in_a_loop_are_the_run(model):
    """Every cell to the bit."""
    scenario = nominal(plant={"model": model})
    run = thermyo.run(scenario)
    muscle, core = thermyo.Muscle(scenario), thermyo.Core(scenario)
    readings = muscle.readings
    for row in range(len(run["time_s"])):
        output = core.step(readings)
        for name in COLUMNS:
            assert getattr(readings, name) == run[name][row], (name, row)
        for name in OUTPUTS:
            assert getattr(output, name) == run[name][row], (name, row)
        readings = muscle.step(*output.duties)


def test_a_controller_of_ones_own_holds_a_pressure():
    muscle = thermyo.Muscle(nominal())
    readings = muscle.readings
    for _ in range(5000):
        error = (2.0e5 - readings.measured_pressure_pa) / 5.0e4
        readings = muscle.step(min(max(error, 0.0), 1.0), min(max(-error, 0.0), 1.0))
    assert abs(readings.pressure_pa - 2.0e5) < 3.0e3
    assert readings.time_s == pytest.approx(5.0) and muscle.step_s == 0.001
    ledger = muscle.ledger()
    balance = ledger["mass_initial_kg"] + ledger["mass_in_kg"] - ledger["mass_out_kg"]
    assert ledger["mass_kg"] == pytest.approx(balance, rel=1e-9)


def test_the_core_takes_set_points_and_stops():
    muscle, core = thermyo.Muscle(nominal()), thermyo.Core(nominal())

    def steps(count):
        readings = muscle.readings
        for _ in range(count):
            output = core.step(readings)
            readings = muscle.step(*output.duties)
        return output, readings

    core.step(muscle.readings)
    core.set(pressure_pa=1.8e5)
    output, readings = steps(4000)
    # A dead zone of 1.5 kPa, beside up to 1.5 % of the step from ambient by which the gas still relaxes.
    assert abs(readings.pressure_pa - 1.8e5) < 2.7e3 and output.mode.startswith("pressure")
    core.stop()
    assert core.armed_pa is None
    with pytest.raises(thermyo.BoardError, match=r"^the core is not armed: core.arm\(\)$"):
        core.set(pressure_pa=1.8e5)
    output, readings = steps(4000)
    assert output.mode == "vent" and readings.pressure_pa < 1.2e5
    core.arm(1.5e5)
    with pytest.raises(ValueError, match="pressure_pa = 180000: must be from 0 to 150000"):
        core.set(pressure_pa=1.8e5)
    for duty in [(0.1, 0.0), [0.1, 0.0], numpy.array([0.1, 0.0])]:
        core.set(duty=duty)
        assert steps(100)[0].mode == "duty"
    with pytest.raises(ValueError, match="sequence of length 2"):
        core.set(duty=[0.1])


@pytest.mark.parametrize(
    "keywords", [{}, {"pressure_pa": 1e5, "contraction": 0.1}, {"period_s": 2.0}, {"duty": (0, 1), "period_s": 1}]
)
def test_a_set_point_is_one_thing(keywords):
    with pytest.raises(ValueError, match="must be one set point"):
        thermyo.Core({}).set(**keywords)


@pytest.mark.parametrize("duties", [(-0.1, 0.0), (0.0, 1.1), (float("nan"), 0.0)])
def test_duties_are_shares(duties):
    with pytest.raises(ValueError, match="must be from 0 to 1"):
        thermyo.Muscle({}).step(*duties)


def test_a_fault_of_the_scenario_reaches_the_core():
    scenario = nominal(faults={"sensor": {"from_s": 0.5, "pressure": "open"}})
    muscle, core = thermyo.Muscle(scenario), thermyo.Core(scenario)
    readings = muscle.readings
    for _ in range(1000):
        output = core.step(readings)
        readings = muscle.step(*output.duties)
    assert "pressure sensor" in output.faults and output.duties == (0.0, 1.0)
    with pytest.raises(thermyo.BoardError, match="pressure sensor"):
        core.set(pressure_pa=1.5e5)


def test_noise_follows_the_seed():
    def codes(seed):
        muscle = thermyo.Muscle(nominal(), seed=seed)
        return [muscle.step(0.0, 0.0).code_pressure for _ in range(50)]

    assert codes(3) == codes(3) != codes(4)
    assert numpy.std(codes(3)) > 0.0
