//! Lags of the four sensors, the same in every plant.

use super::Truth;
use super::lag::Lag;
use thermyo_compute::math;
use thermyo_scenario::Scenario;

/// Inputs of the sensing elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposure {
    /// Gas around the element \[K\].
    pub gas_k: f64,
    /// Wall around the wall sensor \[K\].
    pub wall_k: f64,
    pub pressure_pa: f64,
    pub length_m: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensors {
    housing: Lag,
    gas: Lag,
    wall: Lag,
    pressure: Lag,
    length: Lag,
    film: Option<Film>,
}

/// An element whose lag is the resistance of the gas film around it: the lag is longer in thin gas.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Film {
    exponent: f64,
    /// Density at which the element has the scenario's time constant, times the gas constant
    /// \[Pa/K\].
    reference: f64,
    time_constant_s: f64,
    step_s: f64,
}

impl Film {
    fn time_constant_s(&self, exposure: &Exposure) -> f64 {
        let thinning = self.reference / (exposure.pressure_pa / exposure.gas_k);
        self.time_constant_s * math::pow(thinning, self.exponent)
    }
}

impl Sensors {
    /// Sensors at rest in `start`; `housing_s` is the time constant of the housing \[s\].
    pub fn new(scenario: &Scenario, housing_s: f64, start: &Exposure) -> Self {
        let sensor = &scenario.sensor;
        let film = (sensor.gas.density_exponent > 0.0).then(|| Film {
            exponent: sensor.gas.density_exponent,
            reference: start.pressure_pa / start.gas_k,
            time_constant_s: sensor.gas.time_constant_s,
            step_s: scenario.run.step_s,
        });
        let lag = |time_constant, initial| Lag::new(time_constant, scenario.run.step_s, initial);
        Self {
            housing: lag(housing_s, start.gas_k),
            gas: lag(sensor.gas.time_constant_s, start.gas_k),
            wall: lag(sensor.wall.time_constant_s, start.wall_k),
            pressure: lag(sensor.pressure.time_constant_s, start.pressure_pa),
            length: lag(sensor.length.time_constant_s, start.length_m),
            film,
        }
    }

    /// Takes over the time constants of other sensors; the elements keep their states.
    pub fn retune(&mut self, other: &Self) {
        self.housing.retune(&other.housing);
        self.gas.retune(&other.gas);
        self.wall.retune(&other.wall);
        self.pressure.retune(&other.pressure);
        self.length.retune(&other.length);
        if let (Some(film), Some(other)) = (&mut self.film, &other.film) {
            film.time_constant_s = other.time_constant_s;
            film.step_s = other.step_s;
        }
    }

    /// Advances by one exchange step, with the inputs `now` at its end.
    pub fn advance(&mut self, now: &Exposure) {
        if let Some(film) = &self.film {
            self.gas.set_time_constant(film.time_constant_s(now), film.step_s);
        }
        self.gas.advance(self.housing.advance(now.gas_k));
        self.wall.advance(now.wall_k);
        self.pressure.advance(now.pressure_pa);
        self.length.advance(now.length_m);
    }

    pub fn read(&self, truth: &mut Truth) {
        truth.sensor_gas_k = self.gas.output();
        truth.sensor_wall_k = self.wall.output();
        truth.sensor_pressure_pa = self.pressure.output();
        truth.sensor_length_m = self.length.output();
    }
}
