//! The course that a joint can follow: a set point with limits of torque and of the change of stiffness.

use super::config::{JointTuning, Mechanism};
use crate::math::{absolute, limit, sqrt};

/// Share of the accelerating torque that the reference uses for braking: an assumption, since a braking pulse comes up
/// to a period late, and gravity may keep pulling \[-\].
const BRAKES: f32 = 0.7;

/// Requested motion and stiffness.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Motion {
    /// Angle \[rad\].
    pub angle_rad: f32,
    /// Speed \[rad/s\].
    pub speed_rad_s: f32,
    /// Acceleration \[rad/s2\].
    pub acceleration_rad_s2: f32,
    /// Stiffness behind shut valves \[N m/rad\].
    pub stiffness_n_m_rad: f32,
}

impl Motion {
    /// A motion at rest.
    pub fn still(angle_rad: f32, stiffness_n_m_rad: f32) -> Self {
        Self { angle_rad, speed_rad_s: 0.0, acceleration_rad_s2: 0.0, stiffness_n_m_rad }
    }

    /// Whether it has a speed or an acceleration.
    pub(super) fn moves(&self) -> bool {
        self.speed_rad_s != 0.0 || self.acceleration_rad_s2 != 0.0
    }

    /// Motion `time_s` later \[s\], while the acceleration changes by `gained_rad_s2`.
    fn later(&self, time_s: f32, gained_rad_s2: f32) -> Self {
        let mean_rad_s2 = self.acceleration_rad_s2 + 0.5 * gained_rad_s2;
        let early_rad_s2 = self.acceleration_rad_s2 + (1.0 / 3.0) * gained_rad_s2;
        Self {
            angle_rad: self.angle_rad + time_s * (self.speed_rad_s + 0.5 * early_rad_s2 * time_s),
            speed_rad_s: self.speed_rad_s + mean_rad_s2 * time_s,
            acceleration_rad_s2: self.acceleration_rad_s2 + gained_rad_s2,
            ..*self
        }
    }
}

/// A critically damped follower of second order. The acceleration that it adds to the set point's own is limited. A set
/// point that comes with its speed and acceleration is followed without lag.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    /// Motion at the end of the period under way.
    pub motion: Motion,
    /// Acceleration of the set point at the start of the period before \[rad/s2\].
    wanted_rad_s2: f32,
    /// Change of that acceleration since \[rad/s2\].
    gained_rad_s2: f32,
}

impl Reference {
    /// A reference at rest.
    pub fn still(angle_rad: f32, stiffness_n_m_rad: f32) -> Self {
        Self {
            motion: Motion::still(angle_rad, stiffness_n_m_rad),
            wanted_rad_s2: 0.0,
            gained_rad_s2: 0.0,
        }
    }

    /// Moves by one period \[s\] towards a set point that applies at its start. The stiffness waits while it must not
    /// change.
    pub fn advance(
        &mut self,
        mechanism: &Mechanism,
        tuning: &JointTuning,
        wanted: &Motion,
        period_s: f32,
        stiffens: bool,
    ) {
        let gained_rad_s2 = wanted.acceleration_rad_s2 - self.wanted_rad_s2;
        self.wanted_rad_s2 = wanted.acceleration_rad_s2;
        self.gained_rad_s2 = gained_rad_s2;
        let target = wanted.later(period_s, gained_rad_s2);
        let mean_rad_s2 = wanted.acceleration_rad_s2 + 0.5 * gained_rad_s2;
        let now = self.motion;
        let w = tuning.reference_rad_s;
        // Of x'' = a + w^2 (target - x) + 2 w (v - x') at the period's end, x'' constant within it.
        let wt = w * period_s;
        let free_rad = now.angle_rad + now.speed_rad_s * period_s;
        let pulled = w * w * (target.angle_rad - free_rad)
            + 2.0 * w * (target.speed_rad_s - now.speed_rad_s)
            + mean_rad_s2;
        let acceleration = pulled / (1.0 + wt * (2.0 + 0.5 * wt));
        let most = tuning.reference_torque_n_m / mechanism.inertia_kg_m2;
        // Only as fast towards its target that it can still stop there.
        let left_rad = target.angle_rad - free_rad;
        let stops = sqrt(2.0 * BRAKES * most * absolute(left_rad));
        let fastest = tuning.reference_speed_rad_s;
        let [least, greatest] = if left_rad > 0.0 {
            [-fastest, limit(target.speed_rad_s + stops, 0.0, fastest)]
        } else {
            [limit(target.speed_rad_s - stops, -fastest, 0.0), fastest]
        };
        let speed = limit(now.speed_rad_s + acceleration * period_s, least, greatest);
        let acceleration = (speed - now.speed_rad_s) / period_s;
        // Gaining speed is limited relative to the set point's own acceleration; braking is not: the reference must not
        // run past its target.
        let limited = limit(acceleration, mean_rad_s2 - most, mean_rad_s2 + most);
        let gains = absolute(speed) > absolute(now.speed_rad_s);
        let acceleration = if gains { limited } else { acceleration };
        let speed_rad_s = now.speed_rad_s + acceleration * period_s;
        let faster = if stiffens { tuning.stiffness_rate_n_m_rad_s * period_s } else { 0.0 };
        let missing = wanted.stiffness_n_m_rad - now.stiffness_n_m_rad;
        self.motion = Motion {
            angle_rad: now.angle_rad + 0.5 * (now.speed_rad_s + speed_rad_s) * period_s,
            speed_rad_s,
            // Acceleration at the period's end, when the pressures for it have been reached.
            acceleration_rad_s2: acceleration + 0.5 * gained_rad_s2,
            stiffness_n_m_rad: now.stiffness_n_m_rad + limit(missing, -faster, faster),
        };
    }

    /// Motion `time_s` after the period \[s\], with the acceleration changing as in the last period.
    pub fn ahead(&self, time_s: f32, period_s: f32) -> Motion {
        self.motion.later(time_s, self.gained_rad_s2 * time_s / period_s)
    }

    /// Whether the reference has arrived at the angle of a set point at rest, to within `within_rad` \[rad\].
    pub fn arrives_at(&self, wanted: &Motion, within_rad: f32) -> bool {
        !wanted.moves() && absolute(wanted.angle_rad - self.motion.angle_rad) <= within_rad
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(wanted: impl Fn(f64) -> Motion, periods: u16) -> (Reference, f64) {
        let (mechanism, tuning) = (Mechanism::default(), JointTuning::default());
        let mut reference = Reference::still(0.0, 14.0);
        let mut most = 0.0_f64;
        for period in 0..periods {
            let t = 0.01 * f64::from(period);
            reference.advance(&mechanism, &tuning, &wanted(t), 0.01, true);
            most = most.max(f64::from(reference.motion.angle_rad));
        }
        (reference, most)
    }

    #[test]
    fn a_step_arrives_without_overshoot() {
        let (reference, most) = run(|_| Motion::still(0.35, 20.0), 40);
        assert!(reference.arrives_at(&Motion::still(0.35, 20.0), 2e-3), "{reference:?}");
        assert_eq!(reference.motion.stiffness_n_m_rad, 20.0);
        assert!((0.348..0.3505).contains(&most), "{most}");
        let (early, _) = run(|_| Motion::still(0.35, 20.0), 3);
        assert!((early.motion.stiffness_n_m_rad - 17.0).abs() < 1e-3, "1 N m/rad a period");
    }

    /// 40 deg with 2 kg at 0.25 m: 0.7 of 17 rad/s2 slow it, and a third more while it settles.
    #[test]
    fn a_heavy_arm_brakes_in_time() {
        let mechanism = Mechanism { inertia_kg_m2: 0.145, ..Mechanism::default() };
        let tuning = JointTuning::default();
        let mut reference = Reference::still(0.0, 14.0);
        let (mut most_rad, mut hardest) = (0.0_f32, 0.0_f32);
        for _ in 0..55 {
            let before = reference.motion.speed_rad_s;
            reference.advance(&mechanism, &tuning, &Motion::still(0.698, 14.0), 0.01, true);
            most_rad = most_rad.max(reference.motion.angle_rad);
            hardest = hardest.max((before - reference.motion.speed_rad_s) / 0.01);
        }
        println!("{hardest} rad/s2, {most_rad} rad");
        assert!((11.0..17.0).contains(&hardest), "{hardest} rad/s2");
        assert!((0.689..0.7).contains(&most_rad), "{most_rad} rad");
    }

    /// 5 Hz, 3 deg: with its derivatives the error stays below 3 %.
    #[test]
    fn a_motion_with_its_derivatives_is_followed() {
        let w = 31.4_f64;
        let size = 0.052_f64;
        let wanted = |t: f64| Motion {
            angle_rad: (size * (w * t).sin()) as f32,
            speed_rad_s: (size * w * (w * t).cos()) as f32,
            acceleration_rad_s2: (-size * w * w * (w * t).sin()) as f32,
            stiffness_n_m_rad: 14.0,
        };
        let mut worst = 0.0_f64;
        for periods in [90, 95, 100, 105] {
            let (reference, _) = run(wanted, periods);
            let expected = size * (w * 0.01 * f64::from(periods)).sin();
            let error = f64::from(reference.motion.angle_rad) - expected;
            worst = worst.max(error.abs());
        }
        assert!((1e-3..0.03).contains(&(worst / size)), "{worst} rad");
    }
}
