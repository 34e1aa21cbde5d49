//! The core's model of a muscle, driven by measured pressure and length. The mass through the port
//! follows from the energy balance, so that neither valves nor flows need to be known.

use super::data::{Given, holding};
use crate::core_model::{HOUSING, Known, MASS, Model, SENSOR, State, WALL, hold_back};
use model_core::Config;
use model_core::physics::chamber::{AnyChamber, Chamber};
use nalgebra::{DMatrix, DVector};
use thermyo_compute::parallel::Watch;
use thermyo_plant::{BuildError, Diverged};
use thermyo_scenario::Scenario;
use thermyo_scenario::profile::Profile;
use thermyo_setup::core_config::core_config;

/// Steps over which surface and speed are constant. With one step, the length's noise would become
/// speed; with twenty, as in the core, the result would shift by 0.25 %.
const INTERVAL_STEPS: usize = 5;
/// States with a fitted start value: gas, wall, sensor.
const STARTS: usize = 3;
/// Time after a pulse during which gas may still flow, since a pulse ends late \[s\].
const LATE_S: f64 = 0.06;

/// Reason why a set of values has no prediction.
#[derive(Debug, thiserror::Error)]
pub enum Failed {
    #[error("{0}")]
    Build(BuildError),
    #[error("{0}")]
    Diverged(Diverged),
    #[error("stopped")]
    Stopped,
}

#[derive(Debug, Clone)]
pub struct Balance {
    start_s: f64,
    start_k: f64,
    step_s: f64,
    /// Inputs without volumes; those follow from the scenario.
    known: Vec<Known>,
    /// How much the gas at the sensor swings, compared with the mean.
    location_factor: f64,
}

impl Balance {
    /// Resamples measurements in equal steps from the first one to `end_s` \[s\].
    pub fn new(given: &Given, step_s: f64, end_s: f64) -> Self {
        let Given { pressure, length, duties, sensor_k } = given;
        let start_s = pressure.points()[0].0;
        let mut row = 0;
        let mut open_until_s = [f64::NEG_INFINITY; 2];
        let steps = ((end_s - start_s) / step_s).ceil() as usize;
        let known = (0..=steps).map(|step| {
            let time_s = start_s + step as f64 * step_s;
            let [charging, discharging] = open_until_s.map(|until_s| time_s <= until_s);
            for (until_s, duty) in open_until_s.iter_mut().zip(holding(duties, &mut row, time_s)) {
                if duty > 0.0 {
                    *until_s = time_s + LATE_S;
                }
            }
            Known {
                pressure_pa: pressure.value(time_s),
                length_m: length.value(time_s),
                volume_m3: 0.0,
                charging,
                discharging,
                hysteresis_j: 0.0,
            }
        });
        let known = known.collect();
        Self { start_s, start_k: *sensor_k, step_s, known, location_factor: 1.0 }
    }

    /// The same, with higher pressures, and with all readings this much later.
    pub fn recorded_otherwise(mut self, raised_pa: f64, delay_s: f64) -> Self {
        self.known.iter_mut().for_each(|known| known.pressure_pa += raised_pa);
        Self { start_s: self.start_s + delay_s, ..self }
    }

    /// The same, with this location factor of the sensor.
    pub fn with_location_factor(self, location_factor: f64) -> Self {
        Self { location_factor, ..self }
    }

    /// Reading of the gas sensor at the times of `points`, by the core's model of the scenario. A
    /// record may begin during a motion, so gas, wall and sensor start at the temperatures that fit
    /// `points` best; their effect is taken as linear.
    ///
    /// # Errors
    /// If a temperature is not finite, or the work is stopped.
    pub fn sensor_gas(
        &self,
        scenario: &Scenario,
        points: &[(f64, f64)],
        watch: &dyn Watch,
    ) -> Result<Vec<f64>, Failed> {
        let config = Config { step_s: self.step_s as f32, ..core_config(scenario) };
        let chamber = AnyChamber::new(&config.chamber);
        let mut known = self.known.clone();
        for known in &mut known {
            known.volume_m3 = f64::from(chamber.volume_m3(known.length_m as f32));
        }
        hold_back(&config, &mut known);
        let model = Model::new(&config).with_location_factor(self.location_factor);
        let readings = |warmer_k: [f64; STARTS]| -> Result<DVector<f64>, Failed> {
            let [gas_k, wall_k, sensor_k] = warmer_k.map(|warmer_k| self.start_k + warmer_k);
            let mut state = State::zeros();
            state[MASS] = model.mass(&known[0], gas_k);
            state[WALL] = wall_k;
            state[HOUSING] = sensor_k;
            state[SENSOR] = sensor_k;
            let readings = self.readings(&model, &known, state, watch)?;
            let at = points.iter().map(|(time_s, _)| readings.value(*time_s));
            Ok(DVector::from_iterator(points.len(), at))
        };
        let even = readings([0.0; STARTS])?;
        let mut effects = DMatrix::zeros(points.len(), STARTS);
        for i in 0..STARTS {
            let mut warmer_k = [0.0; STARTS];
            warmer_k[i] = 1.0;
            effects.set_column(i, &(readings(warmer_k)? - &even));
        }
        let measured = points.iter().map(|(_, reading_k)| *reading_k);
        let left = DVector::from_iterator(points.len(), measured) - &even;
        let squares = effects.tr_mul(&effects);
        // With a record too short to separate them, all start at one temperature.
        let fitted = match squares.cholesky() {
            Some(squares) => even + &effects * squares.solve(&effects.tr_mul(&left)),
            None => even,
        };
        Ok(fitted.iter().copied().collect())
    }

    fn readings(
        &self,
        model: &Model,
        known: &[Known],
        mut state: State,
        watch: &dyn Watch,
    ) -> Result<Profile, Failed> {
        let mut inflow_kg_s = 0.0;
        let mut readings = vec![(self.start_s, state[SENSOR])];
        for first in (0..known.len() - 1).step_by(INTERVAL_STEPS) {
            if watch.stopped() {
                return Err(Failed::Stopped);
            }
            let last = (first + INTERVAL_STEPS).min(known.len() - 1);
            state = model.advance(state, &mut inflow_kg_s, &known[first..=last], |_| {});
            let time_s = self.start_s + last as f64 * self.step_s;
            if !state[SENSOR].is_finite() {
                let state = format!("sensor = {} K, wall = {} K", state[SENSOR], state[WALL]);
                return Err(Failed::Diverged(Diverged { time_s, state }));
            }
            readings.push((time_s, state[SENSOR]));
        }
        Ok(Profile::new(readings).expect("times rise, and every reading is finite"))
    }
}
