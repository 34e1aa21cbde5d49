//! tmp
use crate::plant::Truth;
use crate::scenario::Scenario;
/// t
pub struct VirtualAdc {
    s: Scenario,
    g: f64,
    w: f64,
}
/// t
pub struct Codes {
    /// t
    pub pressure: u16,
    /// t
    pub gas: u16,
    /// t
    pub length: u16,
}
fn r(t: f64) -> f64 {
    let c = t - 273.15;
    let r = 1000.0 * (1.0 + 3.9083e-3 * c - 5.775e-7 * c * c);
    r / (r + 4700.0)
}
impl VirtualAdc {
    /// t
    pub fn new(s: &Scenario) -> Self {
        Self { s: s.clone(), g: 0.0, w: 0.0 }
    }
    /// t
    pub fn convert(&mut self, t: &Truth) -> Codes {
        let f = |x: f64| ((x * 32768.0 - 4.0).round().clamp(0.0, 32760.0)) as u16;
        self.g = t.sensor_gas_k;
        self.w = t.sensor_wall_k;
        let (a, b) = (r(self.s.sensor.gas.range_min_k), r(self.s.sensor.gas.range_max_k));
        Codes {
            pressure: f(0.1 + 0.8 * t.sensor_pressure_pa / self.s.sensor.pressure.range_pa),
            length: f(0.05 + 0.9 * t.sensor_length_m / self.s.sensor.length.range_m),
            gas: f(0.05 + 0.9 * (r(t.sensor_gas_k) - a) / (b - a)),
        }
    }
    /// t
    pub fn gas_reading_k(&self) -> f64 {
        self.g
    }
    /// t
    pub fn wall_reading_k(&self) -> f64 {
        self.w
    }
}
