//! Torque of gravity, with one sine per PWM period instead of two in every step.
//!
//! ```text
//! g(q + d) = g(q) (1 - d^2/2) + g'(q) d        g'' = -g
//! ```

use super::config::Mechanism;
use crate::math::{absolute, sin};
use core::f32::consts::FRAC_PI_2;

/// Way up to which the series holds: its remainder is d^3/6, 0.13 % of the largest torque \[rad\].
const NEAR_RAD: f32 = 0.2;

/// Gravity about an angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gravity {
    about_rad: f32,
    /// Torque \[N m\] there, and its slope \[N m/rad\].
    torque_n_m: f32,
    slope_n_m_rad: f32,
}

impl Gravity {
    /// Not computed yet: far from every angle.
    pub const UNKNOWN: Self = Self { about_rad: f32::MAX, torque_n_m: 0.0, slope_n_m_rad: 0.0 };

    /// Computes gravity about an angle \[rad\].
    #[inline(never)] // In two places: as small as can be.
    pub fn about(mechanism: &Mechanism, about_rad: f32) -> Self {
        let hangs_rad = mechanism.gravity_angle_rad - about_rad;
        Self {
            about_rad,
            torque_n_m: mechanism.gravity_n_m * sin(hangs_rad),
            slope_n_m_rad: -mechanism.gravity_n_m * sin(hangs_rad + FRAC_PI_2),
        }
    }

    /// Torque at an angle \[N m\].
    #[inline(never)]
    pub fn torque_n_m(&self, mechanism: &Mechanism, angle_rad: f32) -> f32 {
        let way_rad = angle_rad - self.about_rad;
        if absolute(way_rad) < NEAR_RAD {
            self.torque_n_m * (1.0 - 0.5 * way_rad * way_rad) + self.slope_n_m_rad * way_rad
        } else {
            // Before the first period's computation, for a reference far from the arm, or for an angle that jumps.
            Self::about(mechanism, angle_rad).torque_n_m
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_series_is_that_of_a_weight_on_an_arm() {
        let mechanism =
            Mechanism { gravity_n_m: 5.0, gravity_angle_rad: 0.4, ..Mechanism::default() };
        let (mut near, mut far) = (0.0_f64, 0.0_f64);
        for about in (-30..30_i8).map(|i| 0.1 * f32::from(i)) {
            let gravity = Gravity::about(&mechanism, about);
            for way in (-50..=50_i8).map(|i| 0.01 * f32::from(i)) {
                let angle_rad = about + way;
                let expected = 5.0 * (0.4 - f64::from(angle_rad)).sin();
                let off = (f64::from(gravity.torque_n_m(&mechanism, angle_rad)) - expected).abs();
                let worst = if way.abs() < 0.2 { &mut near } else { &mut far };
                *worst = worst.max(off);
            }
        }
        assert!((4e-3..6.7e-3).contains(&near), "{near} N m");
        assert!(far < 5e-6, "{far} N m");
    }
}
