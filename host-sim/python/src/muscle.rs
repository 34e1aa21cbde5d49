//! The plant, a step at a time.

use crate::error::{self, RunError};
use crate::run::plain;
use crate::scenario;
use model_core::Sample;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::sync::{Mutex, MutexGuard, PoisonError};
use thermyo_plant::{Actuation, chamber};
use thermyo_setup::core_config::core_config;
use thermyo_simulation::rig::{MeanFlows, Reader, Rig};
use thermyo_simulation::run;

/// A muscle or vessel whose valves are driven by the caller.
#[pyclass(frozen, module = "thermyo")]
pub struct Muscle {
    moving: Mutex<Moving>,
    step_s: f64,
    rest_length_m: Option<f64>,
}

struct Moving {
    rig: Rig,
    flows: MeanFlows,
    reader: Reader,
    readings: Readings,
}

impl Moving {
    /// Reads the sensors. This draws their noise: once per step.
    fn read(&mut self) -> Readings {
        let sample = self.rig.sample();
        let truth = self.rig.truth();
        let elapsed_s = self.flows.elapsed_s(&self.rig);
        let (flow_in_kg_s, flow_out_kg_s) = self.flows.since(&self.rig, elapsed_s);
        let (measured_pressure_pa, measured_length_m) = self.reader.read(&sample);
        self.readings = Readings {
            sample,
            time_s: truth.time_s,
            pressure_pa: truth.pressure_pa,
            volume_m3: truth.volume_m3,
            length_m: truth.length_m,
            mass_kg: truth.mass_kg,
            flow_in_kg_s,
            flow_out_kg_s,
            gas_temperature_k: truth.gas_temperature_k,
            wall_temperature_k: truth.wall_temperature_k,
            sensor_gas_k: self.rig.gas_reading_k(),
            sensor_wall_k: self.rig.wall_reading_k(),
            measured_pressure_pa,
            measured_length_m,
            code_pressure: sample.pressure.to_bits(),
            code_gas: sample.gas.to_bits(),
            code_length: sample.length.0,
            emergency_stop: sample.emergency_stop,
        };
        self.readings
    }
}

impl Muscle {
    fn moving(&self) -> MutexGuard<'_, Moving> {
        self.moving.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[pymethods]
impl Muscle {
    #[new]
    #[pyo3(signature = (scenario, seed = None))]
    fn new(scenario: &Bound<'_, PyAny>, seed: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let loaded = scenario::load(scenario, seed)?;
        let rig = Rig::new(&loaded).map_err(|build| error::run(run::RunError::Build(build)))?;
        let mut moving = Moving {
            flows: MeanFlows::new(&rig),
            rig,
            reader: Reader::new(&core_config(&loaded.believed)),
            readings: Readings::default(),
        };
        moving.read();
        let rest_length_m = chamber::of(&loaded.plant).map(|chamber| chamber.rest_length());
        let step_s = loaded.plant.run.step_s;
        Ok(Self { moving: Mutex::new(moving), step_s, rest_length_m })
    }

    /// Drives the valves for one step, each open for the given fraction of time.
    fn step(&self, inlet: f64, outlet: f64) -> PyResult<Readings> {
        for (name, share) in [("inlet", inlet), ("outlet", outlet)] {
            if !(0.0..=1.0).contains(&share) {
                let text = format!("{name} = {share}: must be from 0 to 1");
                return Err(PyValueError::new_err(text));
            }
        }
        let mut moving = self.moving();
        moving
            .rig
            .advance(Actuation { inlet, outlet })
            .map_err(|diverged| RunError::new_err(diverged.to_string()))?;
        Ok(moving.read())
    }

    /// The latest readings.
    #[getter]
    fn readings(&self) -> Readings {
        self.moving().readings
    }

    /// Length of a step [s].
    #[getter]
    fn step_s(&self) -> f64 {
        self.step_s
    }

    /// Length at rest [m]; None for a vessel.
    #[getter]
    fn rest_length_m(&self) -> Option<f64> {
        self.rest_length_m
    }

    /// Balance of mass and energy since the start.
    fn ledger<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &self.moving().rig.ledger())
    }
}

/// Readings of the sensors and true values, by the names of trace.csv.
#[pyclass(frozen, from_py_object, module = "thermyo")]
#[derive(Debug, Clone, Copy, Default)]
pub struct Readings {
    pub sample: Sample,
    #[pyo3(get)]
    time_s: f64,
    #[pyo3(get)]
    pressure_pa: f64,
    #[pyo3(get)]
    volume_m3: f64,
    #[pyo3(get)]
    length_m: f64,
    #[pyo3(get)]
    mass_kg: f64,
    #[pyo3(get)]
    flow_in_kg_s: f64,
    #[pyo3(get)]
    flow_out_kg_s: f64,
    #[pyo3(get)]
    gas_temperature_k: f64,
    #[pyo3(get)]
    wall_temperature_k: f64,
    #[pyo3(get)]
    sensor_gas_k: f64,
    #[pyo3(get)]
    sensor_wall_k: f64,
    #[pyo3(get)]
    measured_pressure_pa: f32,
    #[pyo3(get)]
    measured_length_m: f32,
    #[pyo3(get)]
    code_pressure: u16,
    #[pyo3(get)]
    code_gas: u16,
    #[pyo3(get)]
    code_length: u16,
    #[pyo3(get)]
    emergency_stop: bool,
}

#[pymethods]
impl Readings {
    fn __repr__(&self) -> String {
        let Self { time_s, pressure_pa, length_m, gas_temperature_k, .. } = self;
        format!(
            "<Readings at {time_s:.3} s: {pressure_pa:.0} Pa, {length_m:.4} m, gas {gas_temperature_k:.2} K>"
        )
    }
}
