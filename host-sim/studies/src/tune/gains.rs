//! Controller gains from the identified values.
//!
//! Both loops close on gas mass, an integrator behind a delay
//!
//! ```text
//! theta = T/2 + d     half of a PWM period (a pulse acts in its middle, on average) and the valve's delay
//! ```
//!
//! for which SIMC (Skogestad, J. Process Control 13, 2003) with its tightest robust choice tau_c = theta gives K =
//! 1/(tau_c + theta): an error is closed in 2 theta, at a gain margin of 3 and a phase margin of 61 degrees. The
//! integrals only have to remove drifts (heat to the wall, the load), and are [`INTEGRAL`] times slower, which costs 3
//! degrees of phase. The load disturbance estimate moves the length by the gas spring, which is stiffest near the rest
//! length: it is designed for one reset time there.

use super::experiment::Record;
use super::regression::Measure;
use model_core::config::{Config, Load};
use model_core::physics::chamber::{AnyChamber, Chamber};

/// Reset time over the loop's time: 1/20 rad of phase at its corner \[-\].
const INTEGRAL: f64 = 20.0;
/// Least dead zone in standard deviations of the sensor \[-\].
const DEVIATIONS: f64 = 3.0;

/// Standard deviations of single readings at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    pub pressure_pa: f64,
    pub length_m: f64,
}

impl Noise {
    /// Computed from differences of neighbours, so that a drift does not count.
    pub fn new(resting: &[Record]) -> Self {
        let deviation = |of: fn(&Record) -> f64| {
            let pairs = resting.len().saturating_sub(1).max(1) as f64;
            let square: f64 =
                resting.windows(2).map(|pair| (of(&pair[1]) - of(&pair[0])).powi(2)).sum();
            (square / pairs / 2.0).sqrt()
        };
        Self { pressure_pa: deviation(|r| r.pressure_pa), length_m: deviation(|r| r.length_m) }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Basis {
    pub delay_s: Measure,
    /// Force area over the configured one; stiffness scales with it \[-\].
    pub area_scale: Measure,
    pub noise: Noise,
    /// Smallest contraction of the tested stroke, where the gas spring is stiffest \[-\].
    pub smallest: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopGains {
    /// Time in which both loops close an error \[s\].
    pub loop_s: Measure,
    /// Reset time of the pressure loop's integral \[s\].
    pub reset_s: Measure,
    /// Load learnt per error and time: the gas spring's stiffness over one reset time \[N/(m s)\].
    pub load_gain_n_m_s: Measure,
    /// Largest ignored error of the pressure \[Pa\].
    pub pressure_dead_zone_pa: f64,
    /// Largest ignored error of the length, as a fraction of the rest length \[-\].
    pub contraction_dead_zone: f64,
}

impl LoopGains {
    /// Gains for the muscle and valves of `config`, which contains the tuned values.
    pub fn new(basis: &Basis, config: &Config, chamber: &AnyChamber) -> Self {
        let configured = &config.controller;
        let period_s = f64::from(config.pwm_period_steps) * f64::from(config.step_s);
        let twice = basis.delay_s.scaled(2.0, period_s);
        // No loop can be faster than one period.
        let loop_s = Measure { value: twice.value.max(period_s), ..twice };
        let reset_s = loop_s.scaled(INTEGRAL, 0.0);
        let stiffness_n_m = gas_spring_n_m(config, chamber, basis.smallest);
        let load_gain = stiffness_n_m / reset_s.value;
        let relative =
            (loop_s.error / loop_s.value).hypot(basis.area_scale.error / basis.area_scale.value);
        let rest_m = f64::from(chamber.rest_length_m());
        let Noise { pressure_pa, length_m } = basis.noise;
        Self {
            loop_s,
            reset_s,
            load_gain_n_m_s: Measure { value: load_gain, error: load_gain * relative },
            pressure_dead_zone_pa: f64::from(configured.pressure_dead_zone_pa)
                .max(DEVIATIONS * pressure_pa),
            contraction_dead_zone: f64::from(configured.contraction_dead_zone)
                .max(DEVIATIONS * length_m / rest_m),
        }
    }
}

/// Stiffness of the loaded muscle on its enclosed gas \[N/m\]: k P A^2/V plus the stiffness at
/// constant pressure.
fn gas_spring_n_m(config: &Config, chamber: &AnyChamber, contraction: f64) -> f64 {
    let Load::Isotonic { force_n } = config.load else { return 0.0 };
    let length_m = chamber.rest_length_m() * (1.0 - contraction as f32);
    let gauge_pa = chamber.gauge_pressure_for_force_pa(force_n, length_m);
    let pressure_pa = config.ambient.pressure_pa + gauge_pa;
    let slope_m2 = chamber.volume_slope_m2(length_m);
    let gas = config.gas.heat_capacity_ratio * pressure_pa * slope_m2 * slope_m2
        / chamber.volume_m3(length_m);
    f64::from(gas + chamber.stiffness_n_m(gauge_pa, length_m))
}
