//! Contraction: a reference that the muscle can follow, the pressure that it needs, and the gas
//! mass that this pressure and length stand for.
//!
//! The loop closes on gas mass, not on pressure. At a held pressure the muscle is soft (800 N/m near
//! its rest length, where 15 N of friction are 18 mm); at a held mass it is a gas spring
//! (12 000 N/m and more), and what it lacks in length counts as missing gas:
//!
//! ```text
//! F     = load + trim + friction + viscous v + moving mass a      along the reference
//! P_ref = P_amb + (F + bladder)/(-dV/dL)                          force and geometry
//! dm    = (V (P_ref - P)/k + P (V(L_ref) - V(L)))/(R T)           eq. (6), adiabatic
//! ```
//!
//! Friction is a play: it grows with the way since the last turn, up to the Coulomb force at the
//! estimated wall temperature, so that it neither chatters at rest nor jumps at a change of mode.

use super::port::{Feedback, Port};
use crate::config::{Config, ControllerConfig};
use crate::geometry::Geometry;
use crate::math::{absolute, limit};

/// Periods within the dead zone before the valves rest.
const CALM_PERIODS: u8 = 5;
/// The dead zone is left at this multiple of its width \[-\].
const HYSTERESIS: f32 = 2.0;
/// A reference that needs longer than this for a dead zone is at rest \[s\].
const STILL_S: f32 = 0.1;
/// What an error at rest counts more while the loop learns, in dead zones \[-\].
const STICKING: f32 = 2.0;
/// Closer than this to the rest length the load may lie on its stop \[m\].
const STOP_M: f32 = 3.0e-4;

/// What the configuration makes of the period, worked out once: divisions are dear without an FPU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Backward Euler of the reference, x'' = w^2 (target - x) - 2 w (x' - target'): what a period keeps of
    /// its speed \[-\], and the speed that an error \[1/s\] and the target's speed \[-\] give.
    keeps: f32,
    per_error: f32,
    per_target_speed: f32,
    /// Share of an error of the gas mass that one period closes \[-\].
    closes: f32,
}

impl Gains {
    /// For a PWM period \[s\].
    pub fn new(tuning: &ControllerConfig, period_s: f32) -> Self {
        let w = tuning.reference_rad_s;
        let wt = w * period_s;
        let keeps = 1.0 / (1.0 + wt * (2.0 + wt));
        Self {
            keeps,
            per_error: keeps * wt * w,
            per_target_speed: keeps * 2.0 * wt,
            closes: limit(period_s / tuning.length_loop_s, 0.0, 1.0),
        }
    }
}

/// A second-order reference, critically damped.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Reference {
    length_m: f32,
    volume_m3: f32,
    speed_m_s: f32,
    acceleration_m_s2: f32,
    /// Set point of the period before \[m\].
    target_m: f32,
}

impl Reference {
    fn at(geometry: &Geometry, length_m: f32) -> Self {
        let volume_m3 = geometry.volume_m3(length_m);
        Self { length_m, volume_m3, speed_m_s: 0.0, acceleration_m_s2: 0.0, target_m: length_m }
    }

    /// One period towards `target_m`, backward Euler. A set point that moves no faster than the rate
    /// limit is followed without lag, to where it will be at the period's end; a faster one is a
    /// step.
    fn advance(
        &mut self,
        tuning: &ControllerConfig,
        gains: &Gains,
        geometry: &Geometry,
        target_m: f32,
        port: &Port,
    ) {
        let period_s = port.period_s;
        let rest_m = geometry.muscle().rest_length_m;
        let fastest_m_s = tuning.contraction_rate_per_s * rest_m;
        let change_m = target_m - self.target_m;
        let moves = absolute(change_m) <= fastest_m_s * period_s;
        let (ahead_m, target_m_s) =
            if moves { (change_m, change_m * port.pwm_hz) } else { (0.0, 0.0) };
        self.target_m = target_m;
        let error_m = target_m + ahead_m - self.length_m;
        let wanted_m_s = gains.keeps * self.speed_m_s
            + gains.per_error * error_m
            + gains.per_target_speed * target_m_s;
        let wanted_m_s = limit(wanted_m_s, -fastest_m_s, fastest_m_s);
        let most_m_s = tuning.contraction_acceleration_per_s2 * rest_m * period_s;
        // Gaining speed is limited, braking is not: it must not run past its target.
        let gaining = absolute(wanted_m_s) > absolute(self.speed_m_s);
        let speed_m_s = if gaining {
            limit(wanted_m_s, self.speed_m_s - most_m_s, self.speed_m_s + most_m_s)
        } else {
            wanted_m_s
        };
        self.acceleration_m_s2 = (speed_m_s - self.speed_m_s) * port.pwm_hz;
        self.speed_m_s = speed_m_s;
        self.length_m += speed_m_s * period_s;
        self.volume_m3 = geometry.volume_m3(self.length_m);
    }
}

/// State of the contraction loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContractionLoop {
    gains: Gains,
    reference: Reference,
    /// Pressure that belongs to the reference \[Pa\].
    pressure_pa: f32,
    /// Friction that the reference has to overcome, positive in contraction \[N\].
    friction_n: f32,
    /// Load that the loop has learnt to add to the configured one \[N\].
    trim_n: f32,
    /// Measured length of the period before \[m\].
    length_m: f32,
    calm_periods: u8,
    holding: bool,
    limited: bool,
}

/// What the loop is to reach.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contracting {
    /// Share of the rest length \[-\].
    pub contraction: f32,
    /// Configured load \[N\].
    pub load_n: f32,
    /// What the estimated wall temperature makes of friction \[-\].
    pub softening: f32,
    /// Highest pressure to go to \[Pa\].
    pub most_pa: f32,
}

impl ContractionLoop {
    /// A loop that starts at the measured length and pressure: nothing jumps.
    pub fn new(
        config: &Config,
        gains: &Gains,
        geometry: &Geometry,
        feedback: &Feedback,
        load_n: f32,
        softening: f32,
    ) -> Self {
        let mut fresh = Self {
            gains: *gains,
            reference: Reference::at(geometry, feedback.length_m),
            pressure_pa: feedback.pressure_pa,
            friction_n: 0.0,
            trim_n: 0.0,
            length_m: feedback.length_m,
            calm_periods: 0,
            holding: false,
            limited: false,
        };
        fresh.take_over(config, geometry, feedback, load_n, softening);
        fresh
    }

    /// Whether the load at the goal needs more pressure than there may be.
    pub fn limited(&self) -> bool {
        self.limited
    }

    /// Whether the muscle is where it should be and the valves rest.
    pub fn holding(&self) -> bool {
        self.holding
    }

    /// Takes the measured force for the one wanted: friction explains what it can, the trim the
    /// rest. On its stop the load says nothing.
    fn take_over(
        &mut self,
        config: &Config,
        geometry: &Geometry,
        feedback: &Feedback,
        force_n: f32,
        softening: f32,
    ) {
        let most_friction_n = config.controller.friction_gain * softening * config.friction.force_n;
        let gauge_pa = feedback.pressure_pa - config.ambient.pressure_pa;
        let holds_n = geometry.force_n(gauge_pa, feedback.length_m) - force_n - self.trim_n;
        self.friction_n = limit(holds_n, -most_friction_n, most_friction_n);
        if feedback.length_m < geometry.muscle().rest_length_m - STOP_M {
            let most_n = config.controller.load_limit_n;
            self.trim_n = limit(self.trim_n + holds_n - self.friction_n, -most_n, most_n);
        }
        self.pressure_pa = feedback.pressure_pa;
    }

    /// Mass to move in the coming period \[kg\], positive into the muscle; `None` to rest.
    pub fn period(
        &mut self,
        config: &Config,
        geometry: &Geometry,
        feedback: &Feedback,
        port: &Port,
        wanted: &Contracting,
    ) -> Option<f32> {
        let Contracting { contraction, load_n, softening, most_pa } = *wanted;
        let tuning = &config.controller;
        let period_s = port.period_s;
        let rest_m = geometry.muscle().rest_length_m;
        let target_m = geometry.limit_length_m(rest_m - rest_m * contraction);
        let moves = target_m != self.reference.target_m;
        // Positive: has to contract.
        let error_m = feedback.length_m - self.reference.length_m;
        let zone_m = tuning.contraction_dead_zone * rest_m;
        let moved_m = feedback.length_m - self.length_m;
        self.length_m = feedback.length_m;
        if self.holding {
            if !moves && absolute(error_m) <= HYSTERESIS * zone_m {
                return None;
            }
            self.holding = false;
            self.calm_periods = 0;
            self.take_over(config, geometry, feedback, load_n, softening);
        }
        let still = !moves
            && absolute(target_m - self.reference.length_m) <= zone_m
            && absolute(error_m) <= zone_m
            && absolute(moved_m) <= zone_m;
        self.calm_periods = if still { self.calm_periods.saturating_add(1) } else { 0 };
        if self.calm_periods >= CALM_PERIODS {
            self.holding = true;
            self.reference = Reference::at(geometry, target_m);
            return None;
        }

        // What is missing of the gas that belongs to the reference of the period before.
        let volume_m3 = port.volume_m3;
        let before_m3 = self.reference.volume_m3;
        let before_pa = self.pressure_pa;
        // Ahead of its reference by that much when the pulse acts: damps the load on its gas spring.
        let ahead_m = (moved_m * port.pwm_hz - self.reference.speed_m_s) * tuning.length_lead_s;
        let ahead_m3 = geometry.volume_slope_m2(feedback.length_m) * ahead_m;
        let missing_m3 = (before_m3 - volume_m3 - ahead_m3) * tuning.length_gain;

        // Anti-windup: nothing is learnt while a valve is fully open, or from more than what
        // friction and load explain at once.
        if !port.saturated {
            let most_m = tuning.learning_band * rest_m;
            // A muscle that sticks near its goal needs as much force as one that sticks far from it.
            let sticks = absolute(self.reference.speed_m_s) * STILL_S < zone_m;
            let extra_m = if !sticks {
                0.0
            } else if error_m > zone_m {
                STICKING * zone_m
            } else if error_m < -zone_m {
                -STICKING * zone_m
            } else {
                0.0
            };
            let learns_m = limit(error_m + extra_m, -most_m, most_m);
            let learnt_n = tuning.load_gain_n_m_s * period_s * learns_m;
            let most_n = tuning.load_limit_n;
            self.trim_n = limit(self.trim_n + learnt_n, -most_n, most_n);
        }

        let start_m = self.reference.length_m;
        self.reference.advance(tuning, &self.gains, geometry, target_m, port);
        let reference = &self.reference;
        let way_n = tuning.presliding_n_m * (start_m - reference.length_m);
        let coulomb_n = tuning.friction_gain * softening * config.friction.force_n;
        self.friction_n = slide(self.friction_n, way_n, coulomb_n);
        let wanted_n = load_n + self.trim_n + self.friction_n
            - softening * tuning.viscous_n_s_m * reference.speed_m_s
            - tuning.moving_mass_kg * reference.acceleration_m_s2;
        let ambient_pa = config.ambient.pressure_pa;
        let gauge_pa = geometry.gauge_pressure_for_force_pa(wanted_n, reference.length_m);
        self.limited = ambient_pa + gauge_pa > most_pa;
        self.pressure_pa = limit(ambient_pa + gauge_pa, ambient_pa, most_pa);

        let gain = self.gains.closes;
        let change_pa = self.pressure_pa - before_pa + gain * (before_pa - feedback.pressure_pa);
        let change_m3 = reference.volume_m3 - before_m3 + gain * missing_m3;
        Some(port.mass_kg(change_pa, change_m3) - port.in_flight_kg)
    }
}

/// Friction after a way, `way_n` its stiffness times the way: it builds up along the way as the
/// bristles of LuGre do (Canudas de Wit et al. 1995), f' = k (1 - f/F sgn x'), backward Euler.
fn slide(friction_n: f32, way_n: f32, coulomb_n: f32) -> f32 {
    let most_n = coulomb_n + absolute(way_n);
    if most_n > 0.0 { (friction_n + way_n) * coulomb_n / most_n } else { 0.0 }
}
