//! Covariance of the estimator's five errors, and how it moves: named entries instead of a matrix, so
//! that nothing is multiplied by a zero.

use crate::math::limit;

/// Largest variance of u: a tenth of the gas temperature.
pub const LARGEST_GAS: f32 = 0.01;

/// Covariance of the five errors: upper triangle, named by row and column.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Covariance {
    pub gas_gas: f32,
    pub gas_wall: f32,
    pub gas_sensor: f32,
    pub gas_scale: f32,
    pub gas_lag: f32,
    pub wall_wall: f32,
    pub wall_sensor: f32,
    pub wall_scale: f32,
    pub wall_lag: f32,
    pub sensor_sensor: f32,
    pub sensor_scale: f32,
    pub sensor_lag: f32,
    pub scale_scale: f32,
    pub scale_lag: f32,
    pub lag_lag: f32,
}

/// Linearised error dynamics over one interval: the entries that differ from the identity.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Transition {
    pub gas_gas: f32,
    pub gas_wall: f32,
    pub gas_scale: f32,
    pub wall_gas: f32,
    pub wall_wall: f32,
    pub wall_scale: f32,
    pub sensor_gas: f32,
    pub sensor_sensor: f32,
    pub sensor_lag: f32,
}

impl Transition {
    fn gas_row(&self, gas: f32, wall: f32, scale: f32) -> f32 {
        self.gas_gas * gas + self.gas_wall * wall + self.gas_scale * scale
    }

    fn wall_row(&self, gas: f32, wall: f32, scale: f32) -> f32 {
        self.wall_gas * gas + self.wall_wall * wall + self.wall_scale * scale
    }

    fn sensor_row(&self, gas: f32, sensor: f32, lag: f32) -> f32 {
        self.sensor_gas * gas + self.sensor_sensor * sensor + self.sensor_lag * lag
    }
}

/// M = F P: the rows that F changes, without the entries that P' = M F^T does not ask for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Product {
    pub gas_gas: f32,
    pub gas_wall: f32,
    pub gas_sensor: f32,
    pub gas_scale: f32,
    pub gas_lag: f32,
    pub wall_gas: f32,
    pub wall_wall: f32,
    pub wall_sensor: f32,
    pub wall_scale: f32,
    pub wall_lag: f32,
    pub sensor_gas: f32,
    pub sensor_sensor: f32,
    pub sensor_scale: f32,
    pub sensor_lag: f32,
}

impl Covariance {
    /// M = F P with F = I + `f`, over the entries of F that are not zero.
    pub fn rows(&self, f: &Transition) -> Product {
        let p = self;
        Product {
            gas_gas: p.gas_gas + f.gas_row(p.gas_gas, p.gas_wall, p.gas_scale),
            gas_wall: p.gas_wall + f.gas_row(p.gas_wall, p.wall_wall, p.wall_scale),
            gas_sensor: p.gas_sensor + f.gas_row(p.gas_sensor, p.wall_sensor, p.sensor_scale),
            gas_scale: p.gas_scale + f.gas_row(p.gas_scale, p.wall_scale, p.scale_scale),
            gas_lag: p.gas_lag + f.gas_row(p.gas_lag, p.wall_lag, p.scale_lag),
            wall_gas: p.gas_wall + f.wall_row(p.gas_gas, p.gas_wall, p.gas_scale),
            wall_wall: p.wall_wall + f.wall_row(p.gas_wall, p.wall_wall, p.wall_scale),
            wall_sensor: p.wall_sensor + f.wall_row(p.gas_sensor, p.wall_sensor, p.sensor_scale),
            wall_scale: p.wall_scale + f.wall_row(p.gas_scale, p.wall_scale, p.scale_scale),
            wall_lag: p.wall_lag + f.wall_row(p.gas_lag, p.wall_lag, p.scale_lag),
            sensor_gas: p.gas_sensor + f.sensor_row(p.gas_gas, p.gas_sensor, p.gas_lag),
            sensor_sensor: p.sensor_sensor
                + f.sensor_row(p.gas_sensor, p.sensor_sensor, p.sensor_lag),
            sensor_scale: p.sensor_scale + f.sensor_row(p.gas_scale, p.sensor_scale, p.scale_lag),
            sensor_lag: p.sensor_lag + f.sensor_row(p.gas_lag, p.sensor_lag, p.lag_lag),
        }
    }

    /// P' = M F^T, upper triangle.
    pub fn columns(&mut self, m: &Product, f: &Transition) {
        self.gas_gas = m.gas_gas + f.gas_row(m.gas_gas, m.gas_wall, m.gas_scale);
        self.gas_wall = m.gas_wall + f.wall_row(m.gas_gas, m.gas_wall, m.gas_scale);
        self.gas_sensor = m.gas_sensor + f.sensor_row(m.gas_gas, m.gas_sensor, m.gas_lag);
        self.gas_scale = m.gas_scale;
        self.gas_lag = m.gas_lag;
        self.wall_wall = m.wall_wall + f.wall_row(m.wall_gas, m.wall_wall, m.wall_scale);
        self.wall_sensor = m.wall_sensor + f.sensor_row(m.wall_gas, m.wall_sensor, m.wall_lag);
        self.wall_scale = m.wall_scale;
        self.wall_lag = m.wall_lag;
        self.sensor_sensor =
            m.sensor_sensor + f.sensor_row(m.sensor_gas, m.sensor_sensor, m.sensor_lag);
        self.sensor_scale = m.sensor_scale;
        self.sensor_lag = m.sensor_lag;
    }

    /// P' = (I - K H) P for a reading of the sensor; `rest` = R/(P_ss + R), so that the sensor's
    /// own entries shrink by a product and never by a difference.
    pub fn reduce(&mut self, gas: f32, wall: f32, scale: f32, lag: f32, rest: f32) {
        let p = *self;
        self.gas_gas -= gas * p.gas_sensor;
        self.gas_wall -= gas * p.wall_sensor;
        self.gas_scale -= gas * p.sensor_scale;
        self.gas_lag -= gas * p.sensor_lag;
        self.wall_wall -= wall * p.wall_sensor;
        self.wall_scale -= wall * p.sensor_scale;
        self.wall_lag -= wall * p.sensor_lag;
        self.scale_scale -= scale * p.sensor_scale;
        self.scale_lag -= scale * p.sensor_lag;
        self.lag_lag -= lag * p.sensor_lag;
        self.gas_sensor *= rest;
        self.wall_sensor *= rest;
        self.sensor_sensor *= rest;
        self.sensor_scale *= rest;
        self.sensor_lag *= rest;
    }

    /// Scale and lag keep that share of their errors.
    pub fn forget(&mut self, keep: f32) {
        self.gas_scale *= keep;
        self.gas_lag *= keep;
        self.wall_scale *= keep;
        self.wall_lag *= keep;
        self.sensor_scale *= keep;
        self.sensor_lag *= keep;
        self.scale_scale *= keep * keep;
        self.scale_lag *= keep * keep;
        self.lag_lag *= keep * keep;
    }

    /// Variances stay positive and bounded, and no correlation exceeds 1. A correlation that does, or
    /// is not a number, is forgotten: whatever went wrong, the filter finds back.
    pub fn limit(&mut self) {
        self.gas_gas = limit(self.gas_gas, 1.0e-9, LARGEST_GAS);
        self.wall_wall = limit(self.wall_wall, 1.0e-5, 1.0e3);
        self.sensor_sensor = limit(self.sensor_sensor, 1.0e-7, 1.0e3);
        self.scale_scale = limit(self.scale_scale, 1.0e-7, 1.0);
        self.lag_lag = limit(self.lag_lag, 1.0e-8, 1.0);
        for (covariance, a, b) in [
            (&mut self.gas_wall, self.gas_gas, self.wall_wall),
            (&mut self.gas_sensor, self.gas_gas, self.sensor_sensor),
            (&mut self.gas_scale, self.gas_gas, self.scale_scale),
            (&mut self.gas_lag, self.gas_gas, self.lag_lag),
            (&mut self.wall_sensor, self.wall_wall, self.sensor_sensor),
            (&mut self.wall_scale, self.wall_wall, self.scale_scale),
            (&mut self.wall_lag, self.wall_wall, self.lag_lag),
            (&mut self.sensor_scale, self.sensor_sensor, self.scale_scale),
            (&mut self.sensor_lag, self.sensor_sensor, self.lag_lag),
            (&mut self.scale_lag, self.scale_scale, self.lag_lag),
        ] {
            if !(*covariance * *covariance <= a * b) {
                *covariance = 0.0;
            }
        }
    }
}
