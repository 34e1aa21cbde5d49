//! The gas temperature in real time: an extended Kalman filter whose state moves at every step and
//! whose covariance moves once per [`INTERVAL_STEPS`].
//!
//! Pressure P and length (hence volume V) are measured fast and well. With the energy balance (3)
//! they give the enthalpy that came in or left, whatever valve it went through:
//!
//! ```text
//! H = V dP/(k-1) + k/(k-1) P dV + h A (T - T_w) dt      (3), (4)
//! dm = H/(cp T_in) while charging, H/(cp T) while discharging, 0 with both valves closed
//! T = P V/(m R)                                          (1)
//! ```
//!
//! No valve needs to be calibrated; that a valve is open is known from the duty. What drifts, the
//! slow Pt sensor corrects: T_s' = (T - T_s)/tau.
//!
//! | state | error carried in the covariance |
//! |---|---|
//! | m | u = dT/T = -dm/m, relative error of the gas temperature |
//! | T_w | wall temperature \[K\] |
//! | T_s | temperature of the sensor's element \[K\] |
//! | s | scale of the heat transfer h A |
//! | tau | logarithm of the sensor's lag |
//!
//! The matrix of the linearised error over one interval D (x = s h A D/(m cp), M_in the mass that
//! came in):
//!
//! ```text
//! u'   = (1 - x - M_in/m) u + x/T T_w - x (T - T_w)/(s T) s     while gas flows, u otherwise
//! T_w' = s h A D/C_w (T u - T_w) + ... - h_o A D/C_w T_w + Q/(s C_w) s
//! T_s' = D/tau (T u - T_s) - D (T - T_s)/tau ln(tau)
//! ```

use crate::body::Shape;
use crate::config::Config;
use crate::front_end::{CodeSum, Converter};
use crate::math::{CompensatedSum, exp, limit, sqrt};
use crate::sample::{AdcCode, Estimate};

/// Steps per update of the covariance and of the sensor's correction.
pub const INTERVAL_STEPS: u16 = 20;

const OPEN_GAIN: f32 = 1.0;
const CLOSED_GAIN: f32 = 0.01;
const INFLOW_GAIN: f32 = 0.2;
const BOOKING_GAIN: f32 = 0.04;

/// What the estimator needs to know of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// Measured absolute pressure \[Pa\].
    pub pressure_pa: f32,
    /// Measured length \[m\], limited to what the body can have.
    pub length_m: f32,
    /// Raw code of the gas sensor; `None` while the sensor is not to be trusted.
    pub gas: Option<AdcCode>,
    /// The inlet has been driven lately.
    pub charging: bool,
    /// The outlet has been driven lately.
    pub discharging: bool,
}

/// Covariance of the five errors: upper triangle, named by row and column.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Covariance {
    gas_gas: f32,
    gas_wall: f32,
    gas_sensor: f32,
    gas_scale: f32,
    gas_lag: f32,
    wall_wall: f32,
    wall_sensor: f32,
    wall_scale: f32,
    wall_lag: f32,
    sensor_sensor: f32,
    sensor_scale: f32,
    sensor_lag: f32,
    scale_scale: f32,
    scale_lag: f32,
    lag_lag: f32,
}

/// Linearised error dynamics over one interval: the entries that differ from the identity.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Transition {
    gas_gas: f32,
    gas_wall: f32,
    gas_scale: f32,
    wall_gas: f32,
    wall_wall: f32,
    wall_scale: f32,
    sensor_gas: f32,
    sensor_sensor: f32,
    sensor_lag: f32,
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

/// Sums over one interval.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Interval {
    steps: u16,
    gas_k: f32,
    inflow_kg: f32,
    heat_j: f32,
    readings: CodeSum,
    flowing_steps: u16,
}

/// What the end of an interval leaves for the first steps of the next one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Pending {
    transition: Transition,
    product: Product,
    /// Mean gas temperature of the interval \[K\].
    gas_k: f32,
    innovation_k: Option<f32>,
}

/// M = F P: the rows that F changes, without the entries that P' = M F^T does not ask for.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Product {
    gas_gas: f32,
    gas_wall: f32,
    gas_sensor: f32,
    gas_scale: f32,
    gas_lag: f32,
    wall_gas: f32,
    wall_wall: f32,
    wall_sensor: f32,
    wall_scale: f32,
    wall_lag: f32,
    sensor_gas: f32,
    sensor_sensor: f32,
    sensor_scale: f32,
    sensor_lag: f32,
}

/// State of the estimator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimator {
    // Constants of the configuration, worked out once.
    shape: Shape,
    converter: Converter,
    config: Config,
    per_k_minus_1: f32,
    per_cp: f32,
    per_gas_constant: f32,
    // State.
    mass_kg: CompensatedSum,
    gas_k: f32,
    wall_k: f32,
    housing_k: f32,
    sensor_k: f32,
    scale: f32,
    lag_s: f32,
    covariance: Covariance,
    gas_sd_k: f32,
    smooth_k: [f32; 2],
    disagreement: f32,
    // Since the last step.
    pressure_pa: f32,
    volume_m3: f32,
    pressure_gain: f32,
    surface_m2: f32,
    inflow_kg_s: f32,
    entering: bool,
    // Since the last interval.
    length_m: f32,
    wall_w_k: f32,
    interval: Interval,
    pending: Pending,
    started: bool,
}

impl Estimator {
    /// An estimator that starts with the first measurement.
    pub fn new(config: &Config) -> Self {
        let k = config.gas.heat_capacity_ratio;
        let sd = &config.estimator;
        let initial = sd.initial_sd_k * sd.initial_sd_k;
        let relative = initial / (config.ambient.temperature_k * config.ambient.temperature_k);
        Self {
            shape: Shape::new(&config.body),
            converter: Converter::new(&config.front_end),
            config: *config,
            per_k_minus_1: 1.0 / (k - 1.0),
            per_cp: 1.0 / config.gas.cp_j_kg_k(),
            per_gas_constant: 1.0 / config.gas.gas_constant_j_kg_k,
            mass_kg: CompensatedSum::new(1.0),
            gas_k: config.ambient.temperature_k,
            wall_k: config.ambient.temperature_k,
            housing_k: config.ambient.temperature_k,
            sensor_k: config.ambient.temperature_k,
            scale: 1.0,
            lag_s: config.gas_sensor.time_constant_s,
            covariance: Covariance {
                gas_gas: relative,
                wall_wall: initial,
                sensor_sensor: initial,
                scale_scale: sd.heat_scale_sd * sd.heat_scale_sd,
                lag_lag: sd.lag_sd * sd.lag_sd,
                ..Covariance::default()
            },
            gas_sd_k: sd.initial_sd_k,
            smooth_k: [0.0; 2],
            disagreement: 0.04/config.gas_sensor.time_constant_s/config.gas_sensor.time_constant_s,
            pressure_pa: 0.0,
            volume_m3: 0.0,
            pressure_gain: OPEN_GAIN,
            surface_m2: 0.0,
            inflow_kg_s: 0.0,
            entering: false,
            length_m: 0.0,
            wall_w_k: 0.0,
            interval: Interval::default(),
            pending: Pending::default(),
            started: false,
        }
    }

    /// The estimate after the last step.
    pub fn estimate(&self) -> Estimate {
        Estimate {
            gas_k: self.gas_k,
            gas_sd_k: self.gas_sd_k,
            wall_k: self.wall_k,
            sensor_k: self.sensor_k,
            mass_kg: self.mass_kg.value(),
            heat_scale: self.scale,
            sensor_lag_s: self.lag_s,
        }
    }

    /// One step.
    pub fn step(&mut self, measurement: &Measurement) {
        let pressure_pa = limit(measurement.pressure_pa, 1.0, 1.0e9);
        let volume_m3 = self.shape.volume_m3(measurement.length_m);
        if !self.started {
            self.start(pressure_pa, volume_m3, measurement);
        }
        self.propagate(pressure_pa, volume_m3, measurement);
        if let Some(code) = measurement.gas {
            self.interval.readings.add(code);
        }
        self.advance_covariance(measurement.length_m);
    }

    /// The work of an interval, spread over four of its steps and kept clear of those in which the
    /// valves' PWM period ends (multiples of ten) and the controller has its own to do.
    fn advance_covariance(&mut self, length_m: f32) {
        match self.interval.steps {
            2 => self.pending.product = self.covariance.rows(&self.pending.transition),
            3 => {
                self.covariance.columns(&self.pending.product, &self.pending.transition);
                self.add_drift();
            }
            4 => {
                let innovation_k = self.pending.innovation_k.take();
                if let Some(innovation_k) = innovation_k {
                    self.correct(innovation_k);
                }
                self.judge(innovation_k);
            }
            INTERVAL_STEPS => self.end_interval(length_m),
            _ => {}
        }
    }

    /// Everything has the sensor's temperature, until something better is known.
    fn start(&mut self, pressure_pa: f32, volume_m3: f32, measurement: &Measurement) {
        if let Some(code) = measurement.gas {
            let reading_k = self.converter.gas_k(code);
            self.gas_k = reading_k;
            self.wall_k = reading_k;
            self.housing_k = reading_k;
            self.sensor_k = reading_k;
        }
        self.mass_kg =
            CompensatedSum::new(pressure_pa * volume_m3 * self.per_gas_constant / self.gas_k);
        self.pressure_pa = pressure_pa;
        self.volume_m3 = volume_m3;
        self.length_m = measurement.length_m;
        self.started = true;
        self.surface_m2 = self.shape.surface_m2(measurement.length_m);
    }

    /// Mass and temperature over one step, from what pressure and volume did.
    fn propagate(&mut self, pressure_pa: f32, volume_m3: f32, measurement: &Measurement) {
        let k = self.config.gas.heat_capacity_ratio;
        self.wall_w_k = self.scale * self.config.heat.inner_w_k(self.surface_m2, self.inflow_kg_s);
        let heat_j = self.wall_w_k * (self.gas_k - self.wall_k) * self.config.step_s;
        self.interval.steps += 1;
        self.interval.heat_j += heat_j;
        // (3), (4) without flow.
        let work_j = self.pressure_pa * (volume_m3 - self.volume_m3);
        let closed_pa = self.pressure_pa
            - (k * work_j + (k - 1.0) * heat_j) * 2.0 / (volume_m3 + self.volume_m3);
        let flowing = measurement.charging || measurement.discharging;
        self.pressure_gain = if flowing {
            OPEN_GAIN
        } else {
            limit(self.pressure_gain / (1.0 + self.pressure_gain), CLOSED_GAIN, 1.0)
        };
        let correction_pa = self.pressure_gain * (pressure_pa - closed_pa);
        self.pressure_pa = closed_pa + correction_pa;
        self.volume_m3 = volume_m3;
        if flowing { self.entering = if measurement.charging && measurement.discharging {
                correction_pa > 0.0
            } else {
                measurement.charging
            };
        }
        let mut inflow_kg_s = 0.0;
        if flowing || self.pressure_gain > BOOKING_GAIN {
            let port_k = if self.entering { self.config.supply.temperature_k } else { self.gas_k };
            let enthalpy_j = correction_pa * volume_m3 * self.per_k_minus_1;
            let change_kg = enthalpy_j * self.per_cp / port_k;
            self.mass_kg.add(change_kg);
            self.interval.flowing_steps += 1;
            if self.entering {
                self.interval.inflow_kg += change_kg;
                inflow_kg_s = change_kg / self.config.step_s;
            }
        }
        self.inflow_kg_s += INFLOW_GAIN * (inflow_kg_s - self.inflow_kg_s);
        self.gas_k = self.temperature_k();
        self.interval.gas_k += self.gas_k;
    }

    /// T = P V/(m R), limited to where air is a gas and the wall is not ash.
    fn temperature_k(&self) -> f32 {
        let product = self.pressure_pa * self.volume_m3 * self.per_gas_constant;
        limit(product / self.mass_kg.value(), 100.0, 1000.0)
    }

    fn end_interval(&mut self, length_m: f32) {
        let interval = self.interval;
        self.interval = Interval::default();
        let steps = f32::from(INTERVAL_STEPS);
        let duration_s = steps * self.config.step_s;
        let gas_k = interval.gas_k / steps;
        let speed_m_s = (length_m - self.length_m) / duration_s;
        self.length_m = length_m;

        let heat = &self.config.heat;
        let surface_m2 = self.shape.surface_m2(length_m);
        let per_wall = 1.0 / heat.wall_heat_capacity_j_k;
        let outer_share = heat.outer_w_k(surface_m2, speed_m_s) * duration_s * per_wall;
        let friction_j = self.config.friction.wall_heat_w(self.wall_k, speed_m_s) * duration_s;
        let housing_s = self.config.gas_sensor.housing_time_constant_s;
        // Means over the interval on both sides: implicit Euler then delays by just the lag.
        self.housing_k += duration_s / (housing_s + duration_s) * (gas_k - self.housing_k);
        let lag_share = duration_s / (self.lag_s + 0.5 * duration_s);
        let inner_j_k = self.wall_w_k * duration_s;
        let flowing = f32::from(interval.flowing_steps) / steps;
        let per_mass = 1.0 / self.mass_kg.value();
        let exchange = inner_j_k * per_mass * self.per_cp * flowing;
        self.pending.gas_k = gas_k;
        self.pending.transition = Transition {
            gas_gas: -limit(exchange + interval.inflow_kg * per_mass, -0.9, 0.9),
            gas_wall: exchange / gas_k,
            gas_scale: -exchange * (gas_k - self.wall_k) / gas_k,
            wall_gas: inner_j_k * per_wall * gas_k,
            wall_wall: -(inner_j_k * per_wall + outer_share),
            wall_scale: interval.heat_j * per_wall,
            sensor_gas: lag_share * gas_k,
            sensor_sensor: -lag_share,
            sensor_lag: -lag_share * (self.housing_k - self.sensor_k),
        };
        let forget = duration_s / self.config.estimator.memory_s;
        self.scale += forget * (1.0 - self.scale);
        self.lag_s += forget * (self.config.gas_sensor.time_constant_s - self.lag_s);
        self.wall_k += (interval.heat_j + friction_j) * per_wall
            - outer_share * (self.wall_k - self.config.ambient.temperature_k);
        let sensor_change_k = lag_share * (self.housing_k - self.sensor_k);
        self.sensor_k += sensor_change_k;
        self.surface_m2 = surface_m2;
        // The mean of the readings belongs to the middle of the interval. Ten milliseconds seem little
        // beside a lag of seconds, but at a stroke's frequency a delay so small looks like a tenth of
        // a second more of lag.
        let middle_k = self.sensor_k - 0.5 * sensor_change_k;
        self.pending.innovation_k =
            self.converter.mean_gas_k(&interval.readings).map(|reading_k| reading_k - middle_k);
    }

    fn add_drift(&mut self) {
        let drift = &self.config.estimator;
        let duration_s = f32::from(INTERVAL_STEPS) * self.config.step_s;
        let relative = drift.gas_drift_k / self.pending.gas_k;
        let p = &mut self.covariance;
        p.gas_gas += relative * relative * duration_s;
        p.wall_wall += drift.wall_drift_k * drift.wall_drift_k * duration_s;
        // Rounding must not starve the sensor's own variance.
        p.sensor_sensor += 1.0e-6;
        // First-order Gauss-Markov: what is not seen again returns to the configured value.
        let forget = duration_s / drift.memory_s;
        p.forget(1.0 - forget);
        p.scale_scale += 2.0 * forget * drift.heat_scale_sd * drift.heat_scale_sd;
        p.lag_lag += 2.0 * forget * drift.lag_sd * drift.lag_sd;
        p.limit();
    }

    fn judge(&mut self, innovation_k: Option<f32>) {
        const SMOOTHING: f32 = 1.0 / 25.0;
        const WINDOW: f32 = 1.0 / 250.0;
        const FLOOR_K: f32 = 0.004;
        const AGREEMENT_K_S: f32 = 0.09;
        let unknown = AGREEMENT_K_S / self.lag_s;
        let square = match innovation_k {
            Some(innovation_k) => {
                self.smooth_k[0] += SMOOTHING * (innovation_k - self.smooth_k[0]);
                self.smooth_k[1] += SMOOTHING * (self.smooth_k[0] - self.smooth_k[1]);
                self.smooth_k[1] * self.smooth_k[1]
            }
            None => unknown * unknown,
        };
        self.disagreement += WINDOW * (square - self.disagreement);
        let share = limit((self.disagreement - FLOOR_K * FLOOR_K) / (unknown * unknown), 0.0, 1.0);
        let k = self.config.gas.heat_capacity_ratio;
        let code_pa = self.config.front_end.pressure_range_pa * (1.0 / (0.8 * 4096.0));
        let noise = (k - 1.0) / k * 0.35 * code_pa / self.pressure_pa;
        self.gas_sd_k = self.gas_k * sqrt(share * self.covariance.gas_gas + noise * noise);
    }

    /// Kalman update with the innovation of one interval's readings of the gas sensor.
    fn correct(&mut self, innovation: f32) {
        let noise_k = self.config.gas_sensor.noise_k;
        let bias_k = self.config.estimator.sensor_bias_k;
        // What is left of the noise after averaging eight conversions over an interval; the bias
        // is the same in every reading of a second or so, and is counted as if it were.
        let readings_per_second = 1.0 / (f32::from(INTERVAL_STEPS) * self.config.step_s);
        let variance = noise_k * noise_k / (8.0 * f32::from(INTERVAL_STEPS))
            + bias_k * bias_k * readings_per_second;
        let p = self.covariance;
        let per_s = 1.0 / (p.sensor_sensor + variance);
        let [gas, wall, sensor, scale, lag] = [
            p.gas_sensor * per_s,
            p.wall_sensor * per_s,
            p.sensor_sensor * per_s,
            p.sensor_scale * per_s,
            p.sensor_lag * per_s,
        ];
        self.covariance.reduce(gas, wall, scale, lag, variance * per_s);

        // u = dT/T = -dm/m
        let relative = limit(gas * innovation, -0.05, 0.05);
        self.mass_kg = CompensatedSum::new(self.mass_kg.value() / (1.0 + relative));
        self.gas_k = self.temperature_k();
        self.wall_k = limit(self.wall_k + wall * innovation, 100.0, 1000.0);
        self.sensor_k += sensor * innovation;
        self.scale = limit(self.scale * exp(limit(scale * innovation, -0.1, 0.1)), 0.2, 5.0);
        self.lag_s = limit(
            self.lag_s * exp(limit(lag * innovation, -0.1, 0.1)),
            0.2 * self.config.gas_sensor.time_constant_s,
            5.0 * self.config.gas_sensor.time_constant_s,
        );
    }
}

impl Covariance {
    /// M = F P with F = I + `f`, over the entries of F that are not zero.
    fn rows(&self, f: &Transition) -> Product {
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
    fn columns(&mut self, m: &Product, f: &Transition) {
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
    fn reduce(&mut self, gas: f32, wall: f32, scale: f32, lag: f32, rest: f32) {
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
    fn forget(&mut self, keep: f32) {
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

    /// Variances stay positive and bounded.
    fn limit(&mut self) {
        self.gas_gas = limit(self.gas_gas, 1.0e-9, 0.01);
        self.wall_wall = limit(self.wall_wall, 1.0e-5, 1.0e3);
        self.sensor_sensor = limit(self.sensor_sensor, 1.0e-7, 1.0e3);
        self.scale_scale = limit(self.scale_scale, 1.0e-7, 0.25);
        self.lag_lag = limit(self.lag_lag, 1.0e-8, 0.25);
    }
}
