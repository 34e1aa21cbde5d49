//! Heat from gas to wall and from wall to ambient, and the lag of a sensor.

use crate::parameter::parameters;

parameters! {
    /// Heat-transfer coefficients. The jet of an inflow stirs the gas; "ambient air flowing under the
    /// thermal insulation when muscle is moving" (paper, section IV) cools the wall.
    "heat": Heat {
        inner_w_m2_k: 90.0, "W/(m2 K)", 0.0 to 1.0e5, "gas to wall, still gas";
        inner_per_flow: 1.0e5, "W/(m2 K) per kg/s", 0.0 to 1.0e9, "gas to wall, gained per inflow";
        outer_w_m2_k: 8.0, "W/(m2 K)", 0.0 to 1.0e5, "wall to ambient, at rest";
        outer_per_speed: 60.0, "W/(m2 K) per m/s", 0.0 to 1.0e6, "wall to ambient, gained per speed of contraction";
    }
}

parameters! {
    /// The wall, as one body.
    "wall": Wall {
        heat_capacity_j_k: 65.0, "J/K", 0.01 to 1.0e9, "heat capacity of bladder and braid";
    }
}

impl Heat {
    /// Conductance gas to wall \[W/K\] over `surface_m2` at `inflow_kg_s`.
    pub fn inner_w_k(&self, surface_m2: f32, inflow_kg_s: f32) -> f32 {
        let stirred = if inflow_kg_s > 0.0 { self.inner_per_flow * inflow_kg_s } else { 0.0 };
        (self.inner_w_m2_k + stirred) * surface_m2
    }

    /// Conductance wall to ambient \[W/K\] over `surface_m2` at `speed_m_s` (either sign).
    pub fn outer_w_k(&self, surface_m2: f32, speed_m_s: f32) -> f32 {
        let speed = if speed_m_s < 0.0 { -speed_m_s } else { speed_m_s };
        (self.outer_w_m2_k + self.outer_per_speed * speed) * surface_m2
    }
}

/// Advances a first-order lag by `step_s`: d(reading)/dt = (target - reading)/time_constant.
///
/// Bilinear, so that it stays stable at any step: with a = step/(2 time_constant) the reading moves
/// by 2a/(1 + a) of the distance to the target's mean over the step, at most all of it.
pub fn lag_step(reading: f32, target: f32, time_constant_s: f32, step_s: f32) -> f32 {
    let share = step_s / (time_constant_s + 0.5 * step_s);
    let share = if share < 1.0 { share } else { 1.0 };
    reading + share * (target - reading)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn lag_follows_the_exponential(tau in 0.05_f32..20.0) {
            let mut reading = 0.0;
            let steps = (tau * 1000.0) as u32;
            for _ in 0..steps {
                reading = lag_step(reading, 1.0, tau, 0.001);
            }
            let exact = 1.0 - (-f64::from(steps) * 0.001 / f64::from(tau)).exp();
            prop_assert!((f64::from(reading) - exact).abs() < 2e-4, "{reading} for {exact}");
        }

        #[test]
        fn lag_never_overshoots(tau in 0.0_f32..20.0, step in 1.0e-4_f32..1.0) {
            let reading = lag_step(300.0, 310.0, tau, step);
            prop_assert!((300.0..=310.0).contains(&reading));
        }
    }
}
