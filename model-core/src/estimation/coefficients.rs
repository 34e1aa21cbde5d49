//! Coefficients of the estimator: derived from a configuration once, and never changed by a step.

use super::covariance::Covariance;
use super::energy::Averaging;
use crate::config::{Config, EstimatorConfig};
use crate::math::{limit, sqrt};
use crate::physics::friction::Friction;
use crate::physics::gas::{Gas, Reservoir};
use crate::physics::heat::Heat;
use crate::physics::hysteresis::Law;
use crate::physics::leak::Leak;
use crate::step_counts::StepCounts;

/// How far the element must have moved, in differences that it shows, for a reading that has stood still
/// meanwhile to be a frozen one: three times the width of a code of erratum RP2040-E11, so that an element
/// three times as slow as configured has left it.
const FROZEN: f32 = 30.0;
/// Lowest pressure of gas in a muscle or vessel \[Pa\].
pub const LOWEST_PA: f32 = 5.0e3;
/// Errors of the pressure beyond so many deviations are no noise: the flow has changed.
const NOISE_DEVIATIONS: f32 = 4.0;
/// Averaging time of the mean square of the swing \[s\].
const SWING_S: f32 = 8.0;
/// `place_error_k` of a foil in the middle, with which the stated deviation was tuned \[K\].
const MIDDLE_PLACE_K: f32 = 0.87;
/// Largest factor for a foil off it: nearly all of the covariance, however little of it the agreement leaves \[-\].
const MOST_PLACE: f32 = 6.6;

/// Coefficients of the estimator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coefficients {
    pub counts: StepCounts,
    pub averaging: Averaging,
    pub tuning: EstimatorConfig,
    pub gas: Gas,
    pub ambient: Reservoir,
    pub supply_k: f32,
    pub heat: Heat,
    pub friction: Friction,
    pub hysteresis: Law,
    pub leak: Leak,
    /// A field of its own: a comparison of numbers in every step is dear without an FPU.
    pub leaks: bool,
    pub wall_j_k: f32,
    pub step_s: f32,
    pub interval_s: f32,
    /// Share of a step's inflow in the inflow that stirs the gas.
    pub stirring_share: f32,
    pub per_k_minus_1: f32,
    pub per_cp: f32,
    pub per_cp_supply: f32,
    pub per_cv: f32,
    /// Lag of the element, as configured \[s\].
    pub lag_s: f32,
    /// One over that \[1/s\].
    pub per_lag_s: f32,
    /// Lag of the housing around the element \[s\].
    pub housing_s: f32,
    /// Factor of the covariance in the stated deviation, above 1 where the foil is off the middle \[-\].
    pub place: f32,
    /// Share of an interval in the mean square of the swing.
    pub swing_window: f32,
    /// Movement of the element at which a reading that stands still is a frozen one \[K\].
    pub frozen_k: f32,
    /// Largest error of a pressure that is still its noise \[Pa\].
    pub noise_pa: f32,
    /// The same of a length \[m\].
    pub length_noise_m: f32,
    /// Deviation of the temperature that the noise of one pressure leaves, times pressure over
    /// temperature \[Pa\].
    pub pressure_sd_pa: f32,
    /// Variance of one interval's reading by the difference of the gas around the foil from the mean \[K2\].
    pub bias_k2: f32,
    /// Variance of readings that are averaged over a second \[K2\].
    pub lasting_k2: f32,
}

impl Coefficients {
    #[cold] // Once at a start: as small as can be.
    pub fn new(config: &Config) -> Self {
        let k = config.gas.heat_capacity_ratio;
        let tuning = &config.estimator;
        let counts = StepCounts::new(config.step_s);
        let interval_s = f32::from(counts.interval_steps) * config.step_s;
        let sensors = &config.sensors;
        let lag_s = sensors.gas.time_constant_s;
        let pressure_sd_pa = sqrt(sensors.pressure_part.noise_pa2(&sensors.pressure));
        let gas_noise_k2 = sensors.gas.noise_k * sensors.gas.noise_k;
        let bias_k = tuning.reading_bias_k(lag_s);
        Self {
            counts,
            averaging: Averaging::new(&counts, config.pwm_period_steps),
            tuning: *tuning,
            gas: config.gas,
            ambient: config.ambient.into(),
            supply_k: config.supply.temperature_k,
            heat: config.heat,
            friction: config.friction,
            hysteresis: Law::new(&config.hysteresis, interval_s),
            leak: config.leak,
            leaks: config.leak.leaks(),
            wall_j_k: config.wall.heat_capacity_j_k,
            step_s: config.step_s,
            interval_s,
            stirring_share: 1.0 / f32::from(counts.stirring_steps),
            per_k_minus_1: 1.0 / (k - 1.0),
            per_cp: 1.0 / config.gas.cp_j_kg_k(),
            per_cp_supply: 1.0 / (config.gas.cp_j_kg_k() * config.supply.temperature_k),
            per_cv: (k - 1.0) / config.gas.gas_constant_j_kg_k,
            lag_s,
            per_lag_s: 1.0 / lag_s,
            housing_s: sensors.gas.housing_time_constant_s,
            place: limit(tuning.place_error_k / MIDDLE_PLACE_K, 1.0, MOST_PLACE),
            swing_window: interval_s * (1.0 / SWING_S),
            frozen_k: FROZEN * sensors.gas_element.resolution_k(),
            // Well below any pressure, so that an energy within the noise is none below 0.
            noise_pa: limit(NOISE_DEVIATIONS * pressure_sd_pa, 0.0, 0.5 * LOWEST_PA),
            length_noise_m: sensors.length.resolution_m(),
            // A pressure read too high counts as gas that came in: dT/T = (k-1)/k dP/P is left.
            pressure_sd_pa: (k - 1.0) / k * pressure_sd_pa,
            // Averaging leaves little of the noise. The bias is the same in every reading of a second.
            bias_k2: bias_k * bias_k / interval_s,
            lasting_k2: gas_noise_k2 + bias_k * bias_k,
        }
    }

    /// Covariance before the first reading.
    pub fn initial_covariance(&self) -> Covariance {
        let sd = &self.tuning;
        let variance_k2 = sd.initial_sd_k * sd.initial_sd_k;
        Covariance {
            gas_gas: variance_k2 / (self.ambient.temperature_k * self.ambient.temperature_k),
            wall_wall: variance_k2,
            sensor_sensor: variance_k2,
            scale_scale: sd.heat_scale_sd * sd.heat_scale_sd,
            lag_lag: sd.lag_sd * sd.lag_sd,
            ..Covariance::default()
        }
    }
}
