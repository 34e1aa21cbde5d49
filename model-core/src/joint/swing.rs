//! Swing of an arm on the gas spring of its muscles, until a torque that answers it acts.
//!
//! ```text
//! w^2 = K/J     e(t + D) = e cos(w D) + e'/w sin(w D)     e'(t + D/2) = e' cos(w D/2) - e w sin(w D/2)
//! ```
//!
//! Behind late valves a small arm turns round before the torque arrives: a torque for the position that its present
//! speed would lead to drives the swing. The error is predicted for the end of the delay D, its rate for the middle of
//! it. A small part of a swing may just as well be a lasting error: up to half a radian it only continues with its
//! rate.

use crate::math::{inverse_sqrt, limit};

/// Farthest prediction of a swing, a quarter of it: beyond, its frequency is not known well enough \[rad\].
pub const FARTHEST_RAD: f32 = 1.5;
/// Smallest square of a swing's frequency, for an arm without a spring \[rad2/s2\].
const SLOWEST_RAD2_S2: f32 = 1.0;

/// An error and its rate at the time when a torque acts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swing {
    /// Error at the end of the delay \[rad\].
    pub error_rad: f32,
    /// Rate in the middle of the delay \[rad/s\].
    pub rate_rad_s: f32,
    /// Time in which the swing advances by a radian \[s\].
    pub radian_s: f32,
}

impl Swing {
    /// Predicts an error \[rad\] and its rate \[rad/s\] on a spring over inertia \[1/s2\], a delay later \[s\].
    ///
    /// ```
    /// use model_core::joint::swing::Swing;
    ///
    /// // 5 N m/rad and 0.001 kg m2, 15 ms: 1.06 rad of the swing.
    /// let swing = Swing::after([0.1, 0.0], 5000.0, 0.015);
    /// assert!((swing.error_rad - 0.0489).abs() < 1e-3 && (swing.rate_rad_s + 3.577).abs() < 1e-2);
    /// ```
    pub fn after([error_rad, rate_rad_s]: [f32; 2], spring_rad2_s2: f32, delay_s: f32) -> Self {
        let spring_rad2_s2 = limit(spring_rad2_s2, SLOWEST_RAD2_S2, f32::MAX);
        let radian_s = inverse_sqrt(spring_rad2_s2);
        let half_s = 0.5 * limit(delay_s, 0.0, FARTHEST_RAD * radian_s);
        // Sine over its angle, and cosine, of half the way: the series to 3e-4.
        let square = spring_rad2_s2 * half_s * half_s;
        let sine = 1.0 - (1.0 / 6.0) * square * (1.0 - 0.05 * square);
        let cosine = 1.0 - 0.5 * square * (1.0 - (1.0 / 12.0) * square);
        let moved = half_s * sine;
        // Share by the whole way: from half a radian on, in full from a radian on.
        let share = limit((4.0 * square - 0.25) * (1.0 / 0.75), 0.0, 1.0);
        let turned_rad = share * error_rad;
        Self {
            error_rad: error_rad - 2.0 * turned_rad * square * sine * sine
                + 2.0 * rate_rad_s * moved * cosine,
            rate_rad_s: rate_rad_s * cosine - turned_rad * spring_rad2_s2 * moved,
            radian_s,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_is_that_of_a_spring(
            error in -1.0_f32..1.0, rate in -30.0_f32..30.0, w in 1.0_f64..200.0, delay in 0.0_f64..0.03,
        ) {
            let found = Swing::after([error, rate], (w * w) as f32, delay as f32);
            let turn = (w * delay).min(1.5);
            let (e, v) = (f64::from(error), f64::from(rate));
            let share = ((turn * turn - 0.25) / 0.75).clamp(0.0, 1.0);
            let expected = e * (1.0 - share * (1.0 - turn.cos())) + v / w * turn.sin();
            let half = v * (0.5 * turn).cos() - share * e * w * (0.5 * turn).sin();
            let size = e.abs() + v.abs() / w + 1e-6;
            prop_assert!((f64::from(found.error_rad) - expected).abs() < 1e-3 * size, "{found:?}");
            prop_assert!((f64::from(found.rate_rad_s) - half).abs() < 1e-3 * size * w, "{found:?}");
            prop_assert!((f64::from(found.radian_s) * w - 1.0).abs() < 1e-3, "{found:?}");
        }
    }

    /// An arm without a spring keeps its speed.
    #[test]
    fn without_a_spring_it_goes_on() {
        let found = Swing::after([0.1, 2.0], 0.0, 0.02);
        assert!((found.error_rad - 0.14).abs() < 1e-4 && (found.rate_rad_s - 2.0).abs() < 2e-3);
    }
}
