//! Simulation of the plant with the recorded inputs, sampled at the measured times.

use super::balance::{Balance, Failed};
use super::data::{Data, Input, holding};
use thermyo_compute::parallel::Watch;
use thermyo_plant::{Actuation, Truth};
use thermyo_scenario::{PlantKind, Scenario};

/// Longest interval between two samples of a vessel \[s\]: its integrator keeps its tolerance
/// within that.
const LONGEST_VESSEL_STEP_S: f64 = 0.02;
/// Shortest interval between two samples, where rows lie closer \[s\].
const SHORTEST_STEP_S: f64 = 1.0e-4;
/// Fraction of a step by which two times may differ and count as equal.
const SAME: f64 = 1e-6;

/// A recorded experiment, to be simulated with other parameters.
#[derive(Debug, Clone)]
pub struct Experiment<'a> {
    data: &'a Data,
    step_s: f64,
    /// The balance, if measurements of the gas drive the model.
    balance: Option<Balance>,
}

impl<'a> Experiment<'a> {
    /// A moving plant is stepped as in a run of the scenario: stick and slip are resolved to a
    /// step, and another step would shift the fit by more than its error.
    pub fn new(data: &'a Data, scenario: &Scenario) -> Self {
        let longest_s = match scenario.plant.kind {
            PlantKind::Vessel => LONGEST_VESSEL_STEP_S,
            _ => scenario.run.step_s,
        };
        // Rows of regular data fall on steps; other rows are interpolated.
        let spacing_s = data.spacing_s.min(data.end_s()).max(SHORTEST_STEP_S);
        let step_s = spacing_s / (spacing_s / longest_s - SAME).ceil().max(1.0);
        let balance = match &data.input {
            Input::Given(given) => Some(Balance::new(given, step_s, data.end_s())),
            _ => None,
        };
        Self { data, step_s, balance }
    }

    /// The same, with this location factor of the sensor, if measurements of the gas drive the
    /// model.
    pub fn with_location_factor(mut self, factor: f64) -> Self {
        self.balance = self.balance.map(|balance| balance.with_location_factor(factor));
        self
    }

    /// The same, with higher pressures and later readings, if measurements of the gas drive the model.
    pub fn recorded_otherwise(mut self, raised_pa: f64, delay_s: f64) -> Self {
        self.balance = self.balance.map(|balance| balance.recorded_otherwise(raised_pa, delay_s));
        self
    }

    /// Values of the scenario's plant at the measured times, column by column.
    ///
    /// # Errors
    /// If the plant cannot be built, diverges, or is stopped.
    pub fn predict(&self, scenario: &Scenario, watch: &dyn Watch) -> Result<Vec<f64>, Failed> {
        let data = self.data;
        if let Some(balance) = &self.balance {
            let sensor_gas = &data.observed[0].points;
            return balance.sensor_gas(scenario, sensor_gas, watch);
        }
        let mut scenario = scenario.clone();
        scenario.run.step_s = self.step_s;
        let build = match data.input {
            Input::Flows(_) => thermyo_plant::build_driven_by_flows,
            _ => thermyo_plant::build,
        };
        let mut plant = build(&scenario, data.volume.clone()).map_err(Failed::Build)?;
        let mut columns: Vec<Vec<f64>> =
            data.observed.iter().map(|o| Vec::with_capacity(o.points.len())).collect();
        let steps = (data.end_s() / self.step_s - SAME).ceil() as u64;
        let mut before = plant.truth();
        let mut row = 0;
        for step in 0..=steps {
            if watch.stopped() {
                return Err(Failed::Stopped);
            }
            let now = plant.truth();
            let reached = now.time_s + SAME * self.step_s;
            for (observed, column) in data.observed.iter().zip(&mut columns) {
                while let Some((time_s, _)) = observed.points.get(column.len())
                    && *time_s <= reached
                {
                    column.push(between(*time_s, &before, &now, |at| observed.quantity.of(at)));
                }
            }
            before = now;
            if step < steps {
                plant.advance(self.actuation(now.time_s, &mut row)).map_err(Failed::Diverged)?;
            }
        }
        Ok(columns.concat())
    }

    /// Actuation during the step from `time_s`; `row` is where the last call stopped.
    fn actuation(&self, time_s: f64, row: &mut usize) -> Actuation {
        let slack = SAME * self.step_s;
        let values = match &self.data.input {
            Input::Scenario | Input::Given(_) => [0.0; 2],
            Input::Flows(rows) => {
                let end = time_s + self.step_s - slack;
                *row += rows[*row..].iter().take_while(|(time, _)| *time < end).count();
                *row = (*row).min(rows.len() - 1);
                rows[*row].1
            }
            Input::Duties(rows) => holding(rows, row, time_s + slack),
        };
        Actuation { inlet: values[0], outlet: values[1] }
    }
}

/// Value interpolated between two samples of the plant.
fn between(time_s: f64, before: &Truth, now: &Truth, value: impl Fn(&Truth) -> f64) -> f64 {
    let span_s = now.time_s - before.time_s;
    if span_s > 0.0 {
        let share = (time_s - before.time_s) / span_s;
        value(before) + share * (value(now) - value(before))
    } else {
        value(now)
    }
}
