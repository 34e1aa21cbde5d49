//! The model core, a step at a time: the same as on the board.

use crate::error::{self, ScenarioError};
use crate::muscle::Readings;
use crate::scenario;
use crate::set_point::set_point;
use model_core::{Duty, Faults, Telemetry};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use thermyo_record::board_trace::kind_and_values;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::board::{Board, CoreBoard};
use thermyo_simulation::run::SetPoints;

/// Model, estimator, controller and supervisor, configured with the scenario's believed values.
#[pyclass(module = "thermyo")]
pub struct Core {
    board: CoreBoard,
}

#[pymethods]
impl Core {
    #[new]
    #[pyo3(signature = (scenario))]
    fn new(scenario: &Bound<'_, PyAny>) -> PyResult<Self> {
        let loaded = scenario::load(scenario, None)?;
        let mut board = CoreBoard::default();
        board
            .start(&core_config(&loaded.believed), SetPoints::new(&loaded).at(0.0))
            .map_err(|error| ScenarioError::new_err(error.to_string()))?;
        Ok(Self { board })
    }

    /// One step: estimates from these readings, and the duties of the valves. The startup check
    /// runs on the readings of the first call.
    fn step(&mut self, readings: &Readings) -> PyResult<Output> {
        let step = self.board.step(&readings.sample).map_err(error::board)?;
        Ok(Output::new(&step.telemetry.ok_or_else(|| error::silent("step"))?))
    }

    /// Changes the set point from the next PWM period on: one of the keywords, flow and period
    /// together.
    #[pyo3(signature = (*, pressure_pa = None, contraction = None, flow_kg_s = None, period_s = None, duty = None))]
    fn set(
        &mut self,
        pressure_pa: Option<f32>,
        contraction: Option<f32>,
        flow_kg_s: Option<f32>,
        period_s: Option<f32>,
        duty: Option<[f32; 2]>,
    ) -> PyResult<()> {
        let set_point = set_point(pressure_pa, contraction, flow_kg_s, period_s, duty)?;
        self.core()?.set(set_point).map_err(error::set_point)
    }

    /// Arms up to this absolute pressure; required again after a venting fault.
    #[pyo3(signature = (most_pa = None))]
    fn arm(&mut self, most_pa: Option<f32>) -> PyResult<()> {
        self.core()?.arm(most_pa).map_err(error::set_point)
    }

    /// Vents and disarms.
    fn stop(&mut self) -> PyResult<()> {
        self.core()?.disarm();
        Ok(())
    }

    /// Clears latched faults whose cause is gone.
    fn clear(&mut self) -> PyResult<()> {
        self.core()?.clear_faults();
        Ok(())
    }

    /// Highest absolute pressure of set points [Pa]; None if not armed.
    #[getter]
    fn armed_pa(&mut self) -> PyResult<Option<f32>> {
        Ok(self.core()?.armed_pa())
    }
}

impl Core {
    fn core(&mut self) -> PyResult<&mut model_core::Core> {
        self.board.core().map_err(error::board)
    }
}

/// Outputs of a step of the core, by the names of trace.csv.
#[pyclass(frozen, get_all, module = "thermyo")]
pub struct Output {
    /// Fractions of time for which inlet and outlet are open: `muscle.step(*output.duties)`.
    duties: (f64, f64),
    duty_in: f64,
    duty_out: f64,
    step: u32,
    measured_pressure_pa: f32,
    measured_length_m: f32,
    estimate_k: f32,
    estimate_sd_k: f32,
    estimate_valid: bool,
    wall_estimate_k: f32,
    sensor_estimate_k: f32,
    mass_estimate_kg: f32,
    heat_scale: f32,
    sensor_lag_s: f32,
    mode: &'static str,
    limited: bool,
    faults: Vec<&'static str>,
}

impl Output {
    fn new(telemetry: &Telemetry) -> Self {
        let Telemetry { step, estimate, command, limited, .. } = *telemetry;
        let [duty_in, duty_out] = [command.inlet, command.outlet].map(share);
        Self {
            duties: (duty_in, duty_out),
            duty_in,
            duty_out,
            step,
            measured_pressure_pa: telemetry.pressure_pa,
            measured_length_m: telemetry.length_m,
            estimate_k: estimate.gas_k,
            estimate_sd_k: estimate.gas_sd_k,
            estimate_valid: estimate.valid,
            wall_estimate_k: estimate.wall_k,
            sensor_estimate_k: estimate.sensor_k,
            mass_estimate_kg: estimate.mass_kg,
            heat_scale: estimate.heat_scale,
            sensor_lag_s: estimate.sensor_lag_s,
            mode: telemetry.mode.name(),
            limited,
            faults: fault_names(telemetry.faults),
        }
    }
}

#[pymethods]
impl Output {
    fn __repr__(&self) -> String {
        let Self { step, mode, duty_in, duty_out, .. } = self;
        format!("<Output of step {step}: {mode}, in {duty_in:.3}, out {duty_out:.3}>")
    }
}

fn share(duty: Duty) -> f64 {
    f64::from(duty.share())
}

fn fault_names(faults: Faults) -> Vec<&'static str> {
    faults.names().collect()
}

/// Telemetry of a board as a dict, by the names of trace.csv.
pub fn telemetry_dict<'py>(py: Python<'py>, telemetry: &Telemetry) -> PyResult<Bound<'py, PyDict>> {
    let Telemetry { step, sample, estimate, command, .. } = telemetry;
    let dict = PyDict::new(py);
    dict.set_item("step", step)?;
    dict.set_item("measured_pressure_pa", telemetry.pressure_pa)?;
    dict.set_item("measured_length_m", telemetry.length_m)?;
    dict.set_item("estimate_k", estimate.gas_k)?;
    dict.set_item("estimate_sd_k", estimate.gas_sd_k)?;
    dict.set_item("estimate_valid", estimate.valid)?;
    dict.set_item("wall_estimate_k", estimate.wall_k)?;
    dict.set_item("sensor_estimate_k", estimate.sensor_k)?;
    dict.set_item("mass_estimate_kg", estimate.mass_kg)?;
    dict.set_item("heat_scale", estimate.heat_scale)?;
    dict.set_item("sensor_lag_s", estimate.sensor_lag_s)?;
    dict.set_item("duty_in", share(command.inlet))?;
    dict.set_item("duty_out", share(command.outlet))?;
    dict.set_item("set_point", kind_and_values(telemetry.set_point).1)?;
    dict.set_item("mode", telemetry.mode.name())?;
    dict.set_item("limited", telemetry.limited)?;
    dict.set_item("faults", fault_names(telemetry.faults))?;
    dict.set_item("code_pressure", sample.pressure.to_bits())?;
    dict.set_item("code_gas", sample.gas.to_bits())?;
    dict.set_item("code_length", sample.length.0)?;
    dict.set_item("emergency_stop", sample.emergency_stop)?;
    Ok(dict)
}
