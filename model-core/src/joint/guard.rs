//! Faults of the mechanism: an angle that is lost, moves the wrong way, or does not fit the torque.

use super::config::{JointConfig, Mechanism};
use crate::math::absolute;
use crate::sample::{Faults, fault_set};
use crate::step_counts::StepCounts;

/// Way from the angle at arming after which the direction is judged: 3 deg \[rad\].
const JUDGED_RAD: f32 = 0.052;
/// Distance from the start below which nothing counts as moved \[rad\].
const RETURNED_RAD: f32 = 0.1 * JUDGED_RAD;
/// Torque against which a load may move a healthy joint, share of the torque limit \[-\].
const LOADED: f32 = 0.5;
/// Part of a rail's way that counts as on a stop \[rad\].
const STOP_RAD: f32 = 0.02;

/// Faults of a joint, one bit each. All of them vent both muscles and stay latched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct JointFaults(pub u8);

impl JointFaults {
    /// No fault.
    pub const NONE: Self = Self(0);
    /// The angle's code lies at a rail, is frozen or noisy, or implies a length that a muscle cannot have.
    pub const ANGLE_SENSOR: Self = Self(1 << 0);
    /// After arming the angle moved against the torque of the muscles: swapped tubes, valves or sensors, or a load
    /// that is not configured.
    pub const WRONG_WAY: Self = Self(1 << 1);
    /// Angle and pressures imply an unexplained torque beyond `torque_limit_n_m`: a torn or slipping tendon, a
    /// collision, an angle sensor that slips.
    pub const TORQUE: Self = Self(1 << 2);

    /// Every fault and its name, in the order of the bits.
    pub const NAMES: [(Self, &'static str); 3] = [
        (Self::ANGLE_SENSOR, "angle sensor"),
        (Self::WRONG_WAY, "angle goes the wrong way"),
        (Self::TORQUE, "torque"),
    ];

    /// First bit of these faults in [`Faults`].
    const FIRST_BIT: u32 = Faults::JOINT_ANGLE.0.trailing_zeros();

    /// The same faults in a first failure.
    pub const fn of_failure(self) -> Faults {
        Faults((self.0 as u32) << Self::FIRST_BIT)
    }

    /// The joint's faults in a first failure.
    pub const fn from_failure(faults: Faults) -> Self {
        Self((faults.0 >> Self::FIRST_BIT) as u8 & 0b111)
    }
}

fault_set!(JointFaults);

/// State of the joint in one step.
#[derive(Debug, Clone, Copy)]
pub struct Motions {
    /// Measured angle \[rad\].
    pub angle_rad: f32,
    /// Observed speed \[rad/s\].
    pub speed_rad_s: f32,
    /// Torque of muscles and gravity \[N m\].
    pub torque_n_m: f32,
    /// Largest dry friction \[N m\].
    pub coulomb_n_m: f32,
    /// Unexplained torque \[N m\].
    pub disturbance_n_m: f32,
    /// Whether the joint is at its goal and the valves rest.
    pub holds: bool,
}

/// State of the guard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guard {
    torque_limit_n_m: f32,
    half_inertia_kg_m2: f32,
    stops_rad: [f32; 2],
    patience_steps: u16,
    beyond_steps: u16,
    /// Angle at which the joint began to move \[rad\].
    start_rad: f32,
    /// Angle \[rad\] and torque \[N m\] of the step before.
    before_rad: f32,
    before_n_m: f32,
    /// Work of muscles and gravity since then, and the kinetic energy at that point \[J\].
    work_j: f32,
    swing_j: f32,
    /// Whether the joint has moved the right way since it was armed.
    confirmed: bool,
}

impl Guard {
    /// Creates a guard without any step.
    pub fn new(config: &JointConfig) -> Self {
        let [a, _] = &config.muscles;
        let Mechanism { torque_limit_n_m, inertia_kg_m2, minimum_rad, maximum_rad, .. } =
            config.mechanism;
        Self {
            torque_limit_n_m,
            half_inertia_kg_m2: 0.5 * inertia_kg_m2,
            stops_rad: [minimum_rad + STOP_RAD, maximum_rad - STOP_RAD],
            // A tenth of a second.
            patience_steps: StepCounts::new(a.step_s).patience_steps.saturating_mul(10),
            beyond_steps: 0,
            start_rad: 0.0,
            before_rad: 0.0,
            before_n_m: 0.0,
            work_j: 0.0,
            swing_j: 0.0,
            confirmed: false,
        }
    }

    /// Restarts the guard for a joint that begins to move from this angle \[rad\].
    pub fn restart(&mut self, angle_rad: f32) {
        let (start_rad, before_rad) = (angle_rad, angle_rad);
        (self.work_j, self.swing_j) = (0.0, 0.0);
        *self = Self { start_rad, before_rad, confirmed: false, beyond_steps: 0, ..*self };
    }

    /// Returns the faults of a step in which the joint is driven.
    pub fn step(&mut self, now: &Motions) -> JointFaults {
        let moved_rad = now.angle_rad - core::mem::replace(&mut self.before_rad, now.angle_rad);
        // The mean of both torques: a torque that follows the angle would turn the angle's noise into work.
        let before_n_m = core::mem::replace(&mut self.before_n_m, now.torque_n_m);
        self.work_j += 0.5 * (before_n_m + now.torque_n_m) * moved_rad;
        if now.holds {
            self.start_rad = now.angle_rad;
        }
        let way_rad = absolute(now.angle_rad - self.start_rad);
        if way_rad < RETURNED_RAD {
            self.work_j = 0.0;
            self.swing_j = self.half_inertia_kg_m2 * now.speed_rad_s * now.speed_rad_s;
        }
        let mut wrong = false;
        if !self.confirmed && way_rad >= JUDGED_RAD {
            // From rest the muscles have done the work of the motion, apart from a load's; an arm that swings through
            // continues against them.
            let loaded_n_m = LOADED * self.torque_limit_n_m + 0.5 * now.coulomb_n_m;
            wrong = self.work_j + self.swing_j < -loaded_n_m * way_rad;
            self.confirmed = self.work_j > 0.0;
        }
        let [least_rad, most_rad] = self.stops_rad;
        let free = now.angle_rad > least_rad && now.angle_rad < most_rad;
        let beyond = free && absolute(now.disturbance_n_m) > self.torque_limit_n_m;
        self.beyond_steps = if beyond { self.beyond_steps.saturating_add(1) } else { 0 };
        JointFaults::WRONG_WAY
            .when(wrong)
            .with(JointFaults::TORQUE.when(self.beyond_steps > self.patience_steps))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guard() -> Guard {
        let mut guard = Guard::new(&JointConfig::default());
        guard.restart(0.1);
        guard
    }

    fn at(angle_rad: f32, torque_n_m: f32, disturbance_n_m: f32) -> Motions {
        let speed_rad_s = 0.0;
        let (coulomb_n_m, holds) = (0.6, false);
        Motions { angle_rad, speed_rad_s, torque_n_m, coulomb_n_m, disturbance_n_m, holds }
    }

    /// A heavy arm at 5 Hz: it turns before it has gone far enough to be judged, swings through its starting angle, and
    /// is braked beyond it by the muscles.
    #[test]
    fn an_arm_that_swings_through_is_braked_and_not_on_the_wrong_way() {
        let mut config = JointConfig::default();
        config.mechanism.inertia_kg_m2 = 0.145;
        let mut guard = Guard::new(&config);
        guard.restart(0.0);
        let w = core::f32::consts::TAU * 5.0;
        for step in 0..200_u16 {
            let phase = w * 1.0e-3 * f32::from(step);
            let size_rad = if step < 100 { 0.045 } else { 0.06 };
            let (angle_rad, speed_rad_s) = (size_rad * phase.sin(), size_rad * w * phase.cos());
            let torque_n_m = -0.145 * w * w * angle_rad;
            let faults = guard.step(&Motions { speed_rad_s, ..at(angle_rad, torque_n_m, 0.0) });
            assert_eq!(faults, JointFaults::NONE, "{step}: {angle_rad} rad");
        }
    }

    /// Found within 5 deg; a load of half the torque limit may move it.
    #[test]
    fn a_motion_against_the_torque_is_the_wrong_way() {
        for (torque_n_m, expected) in [(2.5, true), (-1.5, false), (2.0, false)] {
            let mut guard = guard();
            let found = (0..500).find_map(|step| {
                let angle_rad = 0.1 - 0.001 * step as f32;
                let faults = guard.step(&at(angle_rad, torque_n_m, 0.0));
                faults.intersects(JointFaults::WRONG_WAY).then_some(0.1 - angle_rad)
            });
            assert_eq!(found.is_some(), expected, "{torque_n_m} N m");
            assert!(found.is_none_or(|way| way < 0.087), "{found:?}");
        }
    }

    /// The noise of a held angle, or a vibration about it, is no motion: its work once added up for minutes, until the
    /// first motion of a healthy joint counted as the wrong way.
    #[test]
    fn what_goes_to_and_fro_does_no_work() {
        for (size_rad, holds, away_rad) in
            [(1.5e-3, true, 0.0), (0.025, false, 0.0), (1.5e-3, false, 0.025)]
        {
            let mut guard = guard();
            let mut step = |angle_rad: f32, holds: bool| {
                let torque_n_m = -14.0 * (angle_rad - 0.1);
                guard.step(&Motions { holds, ..at(angle_rad, torque_n_m, 0.0) })
            };
            for turn in [-1.0, 1.0, 0.3, -0.3].into_iter().cycle().take(400_000) {
                step(0.1 + away_rad + size_rad * turn, holds);
            }
            for way in 0..100 {
                let faults = step(0.1 + away_rad + 1.0e-3 * way as f32, false);
                // Its own torque moves it back, and here a load of less than half the limit moves it.
                assert_eq!(faults, JointFaults::NONE, "{size_rad}, {holds}, {away_rad}");
            }
        }
    }

    #[test]
    fn an_unexplained_torque_is_a_fault_after_a_tenth_of_a_second() {
        let found_at = |angle_rad: f32, disturbance_n_m: f32| {
            let mut guard = guard();
            (0..1000).find(|_| {
                guard.step(&at(angle_rad, 0.0, disturbance_n_m)).intersects(JointFaults::TORQUE)
            })
        };
        assert_eq!(found_at(0.1, 4.1), Some(100));
        assert_eq!(found_at(0.1, -4.1), Some(100));
        assert_eq!(found_at(0.1, 3.9), None);
        assert_eq!(found_at(0.79, 9.0), None, "it lies on its stop");
    }

    #[test]
    fn names_are_in_the_order_of_the_bits() {
        let all = JointFaults::NAMES.iter().fold(JointFaults::NONE, |all, (one, _)| all.with(*one));
        assert_eq!(all.to_string(), "angle sensor, angle goes the wrong way, torque");
    }
}
