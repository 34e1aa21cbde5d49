//! The lags of the four sensors, the same in every plant.

use super::Truth;
use super::lag::Lag;
use crate::scenario::Scenario;

/// What the sensing elements are exposed to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposure {
    /// Gas around the foil \[K\].
    pub gas_k: f64,
    /// Wall around the wall sensor \[K\].
    pub wall_k: f64,
    /// Pressure at the sensor \[Pa\].
    pub pressure_pa: f64,
    /// Length at the potentiometer \[m\].
    pub length_m: f64,
}

/// The four sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensors {
    housing: Lag,
    gas: Lag,
    wall: Lag,
    pressure: Lag,
    length: Lag,
}

impl Sensors {
    /// Sensors at rest in `start`; `housing_s` is the time constant of the foil's housing \[s\].
    pub fn new(scenario: &Scenario, housing_s: f64, start: &Exposure) -> Self {
        let sensor = &scenario.sensor;
        let lag = |time_constant, initial| Lag::new(time_constant, scenario.run.step_s, initial);
        Self {
            housing: lag(housing_s, start.gas_k),
            gas: lag(sensor.gas.time_constant_s, start.gas_k),
            wall: lag(sensor.wall.time_constant_s, start.wall_k),
            pressure: lag(sensor.pressure.time_constant_s, start.pressure_pa),
            length: lag(sensor.length.time_constant_s, start.length_m),
        }
    }

    /// Advances by one exchange step, at the end of which the elements are exposed to `now`.
    pub fn advance(&mut self, now: &Exposure) {
        self.gas.advance(self.housing.advance(now.gas_k));
        self.wall.advance(now.wall_k);
        self.pressure.advance(now.pressure_pa);
        self.length.advance(now.length_m);
    }

    /// Writes the readings into the truth.
    pub fn read(&self, truth: &mut Truth) {
        truth.sensor_gas_k = self.gas.output();
        truth.sensor_wall_k = self.wall.output();
        truth.sensor_pressure_pa = self.pressure.output();
        truth.sensor_length_m = self.length.output();
    }
}
