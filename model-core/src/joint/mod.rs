//! A joint: two muscles against each other on one pulley, with an angle and a stiffness.
//!
//! ```text
//! JointSample --both muscles: sensing, supervisor--> one decision: may they? --controller--> four openings
//!                angle --> both lengths --> both estimators                  \-- otherwise both vent
//! ```
//!
//! Each muscle is a [`Core`] with its own sensing, estimator, plausibility monitor and supervisor. Controller, arming
//! and the decision to vent belong to the joint: a venting fault of either muscle, or of the joint itself, opens both
//! outlets in the same step. One muscle is never vented alone, because the other would then throw the arm.
//!
//! One sensor gives the angle, and from it both lengths. Without it there is no fallback: the joint vents.
//!
//! With `joint.lock_s` above 0, a driven joint locks before it vents if link, angle or a digital gas sensor is lost:
//! all four valves are shut. Both muscles then hold the arm as long as their gas lasts, and pressures are still
//! trusted. Every other fault, a pressure beyond its limit and the end of that time vent both.

pub mod allocation;
mod angle;
mod config;
pub mod controller;
mod coordinator;
pub mod encoder;
pub mod gravity;
pub mod guard;
pub mod lock;
pub mod observer;
pub mod pulley;
pub mod reference;
mod set_point;
pub mod swing;

pub use self::config::{JointConfig, JointTuning, Mechanism};
pub use self::encoder::AnglePart;
pub use self::guard::JointFaults;
pub use self::reference::Motion;
pub use self::set_point::{JointError, JointField, JointSetPoint, LONGEST_S};

use self::coordinator::Coordinator;
use crate::config::Config;
use crate::control::{SetPointError, SetPointField};
use crate::parameter::ConfigError;
use crate::safety::supervisor::FirstFailure;
use crate::sample::{AdcCode, Command, Faults, RawCode, Sample, SetPoint, Telemetry};
use crate::step::Core;
use core::borrow::{Borrow, BorrowMut};

/// Inputs of one step of a joint. Arrays hold muscles a and b.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct JointSample {
    /// Pressures.
    pub pressure: [RawCode; 2],
    /// Gas temperatures.
    pub gas: [RawCode; 2],
    /// Angle: a code of the converter, or of an [`Encoder`](encoder::Encoder).
    pub angle: AdcCode,
    /// Whether the run line is open or low.
    pub emergency_stop: bool,
    /// Whether a request of the host has come since the step before.
    pub heard: bool,
    /// Whether the host sends more requests than the board carries out.
    pub flooded: bool,
    /// Steps that were left out before this one.
    pub missed_steps: u8,
}

impl JointSample {
    /// The samples of both muscles. The code of the angle takes the place of their lengths.
    fn muscles(&self) -> [Sample; 2] {
        let [pressure_a, pressure_b] = self.pressure;
        let [gas_a, gas_b] = self.gas;
        let Self { angle, emergency_stop, heard, flooded, missed_steps, .. } = *self;
        [(pressure_a, gas_a), (pressure_b, gas_b)].map(|(pressure, gas)| Sample {
            pressure,
            gas,
            length: angle,
            emergency_stop,
            heard,
            flooded,
            missed_steps,
        })
    }
}

/// Mode of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum JointMode {
    /// Startup check: the joint vents and tests the sensors.
    StartupCheck,
    /// Both inlets closed, both outlets open.
    Vent,
    /// Fixed openings.
    Duty,
    /// Two pressures are followed.
    Pressures,
    /// Torque and stiffness are followed.
    Torque,
    /// Angle and stiffness are followed.
    Angle,
    /// The joint is at its goal, and all valves rest.
    AngleHeld,
    /// All four valves shut, until `joint.lock_s` has passed.
    Locked,
}

impl JointMode {
    /// Every mode and its name; a mode's index here is its number in a trace.
    pub const NAMES: [(Self, &'static str); 8] = [
        (Self::StartupCheck, "startup check"),
        (Self::Vent, "vent"),
        (Self::Duty, "duty"),
        (Self::Pressures, "pressures"),
        (Self::Torque, "torque"),
        (Self::Angle, "angle"),
        (Self::AngleHeld, "angle, held"),
        (Self::Locked, "locked"),
    ];

    /// Name of the mode, as in messages.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(mode, _)| *mode == self).map_or("", |(_, name)| name)
    }
}

/// Outputs of one step of a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct JointTelemetry {
    /// Both muscles; their mode and set point only show that the joint drives them.
    pub muscles: [Telemetry; 2],
    /// Mode of the joint.
    pub mode: JointMode,
    /// Measured angle \[rad\].
    pub angle_rad: f32,
    /// Observed speed \[rad/s\].
    pub speed_rad_s: f32,
    /// Angle of the reference \[rad\].
    pub reference_rad: f32,
    /// Torque of both muscles, from pressures and angle \[N m\].
    pub torque_n_m: f32,
    /// Stiffness of both muscles behind shut valves \[N m/rad\].
    pub stiffness_n_m_rad: f32,
    /// Torque that nothing configured explains \[N m\].
    pub disturbance_n_m: f32,
    /// Whether stiffness, or torque too, had to yield to the limits of pressure; never where the joint is not driven.
    pub limited: bool,
    /// Set point of this step: vent or lock if the joint decided so.
    pub set_point: JointSetPoint,
    /// Faults of the joint that are present or latched.
    pub faults: JointFaults,
}

impl JointTelemetry {
    /// Number of the step, the same for both muscles.
    pub fn step(&self) -> u32 {
        let [a, _] = &self.muscles;
        a.step
    }

    /// The sample that the step was computed from.
    pub fn sample(&self) -> JointSample {
        let [a, b] = self.muscles.map(|muscle| muscle.sample);
        JointSample {
            pressure: [a.pressure, b.pressure],
            gas: [a.gas, b.gas],
            angle: a.length,
            emergency_stop: a.emergency_stop,
            heard: a.heard,
            flooded: a.flooded,
            missed_steps: a.missed_steps,
        }
    }

    /// Openings of muscles a and b in this step.
    pub fn commands(&self) -> [Command; 2] {
        let [a, b] = &self.muscles;
        [a.command, b.command]
    }
}

/// Two muscles, one angle, one controller, one decision to vent. `M` is a muscle's core, or a reference to one stored
/// elsewhere: a board has no room to build a whole joint on its stack.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint<M = Core> {
    muscles: [M; 2],
    config: JointConfig,
    coordinator: Coordinator,
}

/// Muscles a and b.
fn both<M: Borrow<Core>>([a, b]: &[M; 2]) -> [&Core; 2] {
    [a.borrow(), b.borrow()]
}

/// Muscles a and b.
fn both_mut<M: BorrowMut<Core>>([a, b]: &mut [M; 2]) -> [&mut Core; 2] {
    [a.borrow_mut(), b.borrow_mut()]
}

impl Joint {
    /// Creates a joint that vents until it has tested its sensors and has a set point. It is armed, like a [`Core`].
    ///
    /// ```
    /// use model_core::joint::{Joint, JointConfig, JointSetPoint, Motion};
    ///
    /// let mut joint = Joint::new(&JointConfig::default())?;
    /// joint.set(JointSetPoint::Angle(Motion::still(0.3, 14.0))).unwrap();
    /// assert!(joint.set(JointSetPoint::Angle(Motion::still(0.9, 14.0))).is_err());
    /// # Ok::<(), model_core::ConfigError>(())
    /// ```
    ///
    /// # Errors
    /// [`ConfigError`] as [`JointConfig::check`].
    #[cold] // Once at a start: as small as can be.
    pub fn new(config: &JointConfig) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self::of(config.muscles.each_ref().map(|muscle| Core::of(muscle, true)), config))
    }

    /// Creates the joint of a board without a configuration. It and its muscles have the default one, and it vents
    /// until it is [restarted](Self::restart_as) with a configuration and armed.
    pub fn unconfigured() -> Self {
        Self::unconfigured_in(|muscle| muscle)
    }
}

impl<M: BorrowMut<Core>> Joint<M> {
    /// Creates a joint from a checked configuration, and muscles that have it.
    #[cold]
    fn of(mut muscles: [M; 2], config: &JointConfig) -> Self {
        let [_, b] = both_mut(&mut muscles);
        b.delay_estimator();
        Self { muscles, config: *config, coordinator: Coordinator::new(config) }
    }

    /// Replaces this joint in place by [`new`](Self::new) with another configuration: a board has no memory for a third
    /// joint.
    ///
    /// # Errors
    /// [`ConfigError`] as [`JointConfig::check`]; the joint is then unchanged.
    #[cold]
    pub fn become_new(&mut self, config: &JointConfig) -> Result<(), ConfigError> {
        config.check()?;
        let [a, b] = both_mut(&mut self.muscles);
        let [config_a, config_b] = &config.muscles;
        a.become_of(config_a);
        b.become_of(config_b);
        b.delay_estimator();
        self.config = *config;
        self.coordinator.become_new(config);
        Ok(())
    }

    /// Like [`unconfigured`](Joint::unconfigured), with muscles that are stored where `place` puts them.
    #[cold]
    pub fn unconfigured_in(mut place: impl FnMut(Core) -> M) -> Self {
        let config = JointConfig::default();
        let muscles = config.muscles.each_ref().map(|muscle| Self::placed(muscle, &mut place));
        Self::of(muscles, &config)
    }

    /// Not inlined: the stack has room for one muscle at a time.
    #[inline(never)]
    fn placed(config: &Config, place: &mut impl FnMut(Core) -> M) -> M {
        place(Core::of(config, false))
    }

    /// Whether the joint runs with a configuration that was set.
    pub fn is_configured(&self) -> bool {
        coordinator::is_configured(both(&self.muscles))
    }

    /// Restarts as `other`, with its configuration and, if the joint is armed, its set point. Faults are latched as in
    /// [`Core::restart_as`].
    pub fn restart_as(&mut self, other: &Self) {
        let armed = self.is_armed();
        let others = both(&other.muscles);
        for (muscle, other) in both_mut(&mut self.muscles).into_iter().zip(others) {
            muscle.restart_as(other);
        }
        self.config = other.config;
        self.coordinator.restart_as(both(&self.muscles), &other.coordinator, armed);
    }

    /// Takes over the faults that were latched before the board restarted. They do not state the muscle: both get them.
    pub fn recall(&mut self, first: FirstFailure, latched: Faults) {
        both_mut(&mut self.muscles).into_iter().for_each(|muscle| muscle.recall(first, latched));
        let own = &mut self.coordinator;
        own.latched = own.latched.with(JointFaults::from_failure(latched));
        own.first = Some(first);
    }

    /// The first failure since faults were last cleared, or the last one before that: the faults of both muscles and of
    /// the joint in that step, and the pressure of the muscle that has a fault.
    pub fn first_failure(&self) -> Option<FirstFailure> {
        self.coordinator.first
    }

    /// Faults of muscles and joint that stay until they are cleared.
    pub fn latched(&self) -> Faults {
        self.coordinator.latched(both(&self.muscles))
    }

    /// Accepts set points from now on, with pressures of up to `most_pa` in either muscle \[Pa\]; `None`: up to the
    /// configured maximum. The joint vents until there is a set point.
    ///
    /// # Errors
    /// [`JointError::Range`] for a pressure below a muscle's present one or above its configured maximum, and
    /// [`JointError::Faults`] while faults vent; the arming is then unchanged.
    pub fn arm(&mut self, most_pa: Option<f32>) -> Result<(), JointError> {
        let [a, b] = both_mut(&mut self.muscles);
        match a.may_arm(most_pa).and_then(|_| b.may_arm(most_pa)) {
            Ok(_) if self.coordinator.latched == JointFaults::NONE => {
                // Neither can fail here.
                let _ = a.arm(most_pa).and_then(|()| b.arm(most_pa));
                self.vent();
                Ok(())
            }
            Err(SetPointError::Range { field: SetPointField::Armed, value, minimum, maximum }) => {
                Err(JointError::Range { field: JointField::Armed, value, minimum, maximum })
            }
            _ => Err(self.refusal()),
        }
    }

    /// Vents, and accepts no set point until the joint is [armed](Self::arm).
    pub fn disarm(&mut self) {
        self.coordinator.disarm(&mut both_mut(&mut self.muscles));
    }

    /// Whether set points are accepted.
    pub fn is_armed(&self) -> bool {
        self.armed_pa().is_some()
    }

    /// Highest absolute pressure permitted in either muscle \[Pa\]; `None`: the joint is not armed.
    pub fn armed_pa(&self) -> Option<f32> {
        coordinator::armed_pa(both(&self.muscles))
    }

    /// Vents both muscles, from the next step on.
    pub fn vent(&mut self) {
        self.coordinator.vent(&mut both_mut(&mut self.muscles));
    }

    /// Forgets latched faults whose cause is gone, and vents until the joint is armed and has a set point.
    pub fn clear_faults(&mut self) {
        self.coordinator.latched = self.coordinator.present;
        both_mut(&mut self.muscles).into_iter().for_each(Core::clear_faults);
        self.disarm();
    }

    /// The set point.
    pub fn set_point(&self) -> JointSetPoint {
        self.coordinator.set_point
    }

    /// The configuration that the joint runs with.
    pub fn config(&self) -> &JointConfig {
        &self.config
    }

    /// The error with the faults that make the joint vent now.
    fn refusal(&self) -> JointError {
        JointError::Faults(coordinator::venting(both(&self.muscles)), self.coordinator.latched)
    }

    /// Changes the set point, from the next PWM period on; venting starts with the next step.
    ///
    /// # Errors
    /// [`JointError`] for a value that is not a number or out of its range, and for any set point but venting while
    /// faults vent or the joint is not armed; the set point before then stays.
    pub fn set(&mut self, set_point: JointSetPoint) -> Result<(), JointError> {
        self.may_set(&set_point)?;
        if set_point == JointSetPoint::Vent {
            self.vent();
            return Ok(());
        }
        for muscle in both_mut(&mut self.muscles) {
            // Driven, but by the joint: with both valves shut its own controller does nothing. This cannot fail here.
            let _ = muscle.set(SetPoint::Duty { inlet: 0.0, outlet: 0.0 });
        }
        self.coordinator.set(both(&self.muscles), set_point);
        Ok(())
    }

    /// Checks whether [`set`](Self::set) would accept this set point now.
    ///
    /// # Errors
    /// As [`set`](Self::set).
    pub fn may_set(&self, set_point: &JointSetPoint) -> Result<(), JointError> {
        set_point.check(&self.config)?;
        if *set_point == JointSetPoint::Vent {
            return Ok(());
        }
        if self.coordinator.fails(both(&self.muscles)) {
            return Err(self.refusal());
        }
        if !self.is_armed() {
            return Err(JointError::NotArmed);
        }
        if let JointSetPoint::Pressures { pressure_pa } = *set_point {
            for (value, muscle) in pressure_pa.into_iter().zip(both(&self.muscles)) {
                if let Some(maximum) = muscle.armed_below(value) {
                    let field = JointField::Pressure;
                    return Err(JointError::Range { field, value, minimum: 0.0, maximum });
                }
            }
        }
        Ok(())
    }

    /// Runs one step. During the startup check the joint vents, and neither estimates nor counts steps.
    pub fn step(&mut self, sample: &JointSample) -> JointTelemetry {
        self.coordinator.step(&self.config.mechanism, &mut both_mut(&mut self.muscles), sample)
    }
}

#[cfg(test)]
mod tests {
    use super::encoder::Encoder;
    use super::*;
    use crate::safety::supervisor::VENTING;
    use crate::sample::{CODE_MAX, Duty};
    use proptest::prelude::*;

    /// 120 kPa in both muscles, at angle 0.
    const HEALTHY: JointSample = JointSample {
        pressure: [RawCode::Adc(AdcCode(7770)); 2],
        gas: [RawCode::Adc(AdcCode(15_950)); 2],
        angle: AdcCode(16_400),
        emergency_stop: false,
        heard: true,
        flooded: false,
        missed_steps: 0,
    };
    const FILLING: JointSetPoint = JointSetPoint::Duty { inlet: [0.5; 2], outlet: [0.0; 2] };

    /// Codes that change, as from healthy channels.
    fn alive(step: u16) -> JointSample {
        let code = |code: u16| AdcCode(code + step % 2);
        JointSample {
            pressure: [code(7770).into(), code(7770).into()],
            angle: code(16_400),
            ..HEALTHY
        }
    }

    /// A joint that fills both muscles.
    fn filling() -> Joint {
        let mut joint = Joint::new(&JointConfig::default()).unwrap();
        while joint.step(&HEALTHY).mode == JointMode::StartupCheck {}
        joint.set(FILLING).unwrap();
        for step in 0..30 {
            joint.step(&alive(step));
        }
        assert_eq!(joint.step(&alive(0)).mode, JointMode::Duty);
        joint
    }

    #[test]
    fn a_joint_that_becomes_another_has_nothing_of_before() {
        let mut config = JointConfig::default();
        config.mechanism.lock_s = 0.2;
        config.mechanism.gravity_n_m = 1.0;
        let other = Joint::new(&config).unwrap();
        let mut joint = that_locks_for(0.2);
        joint.set(FILLING).unwrap();
        (0..150).for_each(|step| _ = joint.step(&alive(step)));
        (0..20).for_each(|step| _ = joint.step(&open(alive(step))));
        assert_eq!(joint.set_point(), JointSetPoint::Lock);
        joint.become_new(&config).unwrap();
        assert_eq!(joint, other);
    }

    /// Steps until both vent with this sample. Until then neither does.
    fn vents_after(joint: &mut Joint, broken: impl Fn(JointSample) -> JointSample) -> Option<u16> {
        (0..200).find(|step| {
            let [a, b] = joint.step(&broken(alive(*step))).commands();
            assert_eq!(a == Command::VENT, b == Command::VENT, "step {step}");
            a == Command::VENT
        })
    }

    #[test]
    fn what_vents_one_muscle_vents_both_in_the_same_step() {
        for side in 0..2 {
            let mut joint = filling();
            let found = vents_after(&mut joint, |mut sample| {
                sample.pressure[side] = AdcCode(0).into();
                sample
            });
            assert_eq!(found, Some(9), "muscle {side}");
            assert!(!joint.is_armed());
            let refused = joint.set(FILLING).unwrap_err().to_string();
            let muscle = ["a", "b"][side];
            let expected = format!("vents until this is cleared: muscle {muscle}: pressure sensor");
            assert_eq!(refused, expected, "only where there is a fault");
        }
        let stop = |sample| JointSample { emergency_stop: true, ..sample };
        assert_eq!(vents_after(&mut filling(), stop), Some(0));
    }

    #[test]
    fn a_lost_angle_vents_and_stays_latched() {
        let mut joint = filling();
        assert_eq!(vents_after(&mut joint, open), Some(0));
        let telemetry = joint.step(&HEALTHY);
        assert_eq!(telemetry.faults, JointFaults::ANGLE_SENSOR);
        assert!(joint.arm(None).is_err());
        joint.clear_faults();
        assert_eq!(joint.set(FILLING), Err(JointError::NotArmed));
        assert_eq!(joint.arm(None), Ok(()));
        assert_eq!(joint.set(FILLING), Ok(()));
    }

    /// A joint that locks for this time.
    fn that_locks_for(lock_s: f32) -> Joint {
        let mut config = JointConfig::default();
        config.mechanism.lock_s = lock_s;
        config.muscles.iter_mut().for_each(|muscle| muscle.link.timeout_s = 0.01);
        Joint::new(&config).unwrap()
    }

    fn open(sample: JointSample) -> JointSample {
        JointSample { angle: AdcCode(CODE_MAX), ..sample }
    }

    /// A set point that waits for the test of the sensors drives nothing yet.
    #[test]
    fn a_joint_that_is_not_driven_yet_vents_instead_of_locking() {
        for started in 0..50 {
            let mut joint = that_locks_for(0.2);
            joint.set(FILLING).unwrap();
            (0..started).for_each(|step| _ = joint.step(&alive(step)));
            for step in 0..100 {
                let telemetry = joint.step(&open(alive(step)));
                assert_eq!(telemetry.commands(), [Command::VENT; 2], "{started} and {step} steps");
            }
            assert_eq!((joint.set_point(), joint.is_armed()), (JointSetPoint::Vent, false));
        }
    }

    /// A fault disarms it; it was armed up to 200 kPa, and vents at 5 % of its range above that.
    #[test]
    fn a_locked_joint_vents_above_the_pressure_that_it_was_armed_for() {
        let mut joint = that_locks_for(0.3);
        while joint.step(&HEALTHY).mode == JointMode::StartupCheck {}
        joint.arm(Some(2.0e5)).unwrap();
        joint.set(FILLING).unwrap();
        (0..30).for_each(|step| _ = joint.step(&alive(step)));
        let found = (0..100).find_map(|step| {
            let rising = AdcCode(7770 + 150 * step);
            let pressure = [alive(step).pressure[0], rising.into()];
            let telemetry = joint.step(&open(JointSample { pressure, ..alive(step) }));
            (telemetry.mode == JointMode::Vent).then_some(telemetry.muscles[1].pressure_pa)
        });
        assert!(found.is_some_and(|pa| (229.4e3..232.0e3).contains(&pa)), "{found:?} Pa");
        assert_eq!(joint.latched(), Faults::JOINT_ANGLE);
    }

    /// It locks for 20 ms, and vents for every fault but a lost link, angle or digital part.
    #[test]
    fn a_joint_locks_where_it_is_configured_and_vents_when_the_time_is_over() {
        let locking = || {
            let mut joint = that_locks_for(0.02);
            while joint.step(&HEALTHY).mode == JointMode::StartupCheck {}
            joint.set(FILLING).unwrap();
            (0..30).for_each(|step| _ = joint.step(&alive(step)));
            joint
        };
        let silent = |sample| JointSample { heard: false, ..sample };
        for (angle_lost, after) in [(true, 0), (false, 9)] {
            let mut joint = locking();
            let lost = |sample| if angle_lost { open(sample) } else { silent(sample) };
            let mut modes = (0..100).map(|step| (step, joint.step(&lost(alive(step))).mode));
            let locked = modes.find(|(_, mode)| *mode == JointMode::Locked);
            assert_eq!(locked.map(|(step, _)| step), Some(after));
            let vents = modes.find(|(_, mode)| *mode != JointMode::Locked);
            assert_eq!(vents, Some((after + 20, JointMode::Vent)));
            assert!(matches!(joint.set(JointSetPoint::Lock), Err(JointError::Faults(..))));
        }

        let mut joint = locking();
        assert_eq!(joint.step(&open(alive(0))).commands(), [Command::CLOSED; 2]);
        let torn = |sample: JointSample| JointSample {
            pressure: [sample.pressure[0], AdcCode(0).into()],
            ..open(sample)
        };
        assert_eq!(vents_after(&mut joint, torn), Some(0), "a pressure is trusted no more");
        joint.step(&open(alive(0)));
        assert_eq!(joint.step(&alive(1)).mode, JointMode::Vent, "it does not lock again");

        let mut joint = locking();
        assert_eq!(joint.set(JointSetPoint::Lock), Ok(()));
        let vents = (0..100).find(|step| joint.step(&alive(*step)).mode == JointMode::Vent);
        assert_eq!((vents, joint.is_armed()), (Some(20), false));
        assert_eq!(filling().set(JointSetPoint::Lock), Err(JointError::NeverLocks));
    }

    /// It vents in the startup check, and the gas let out there is no leak.
    #[test]
    fn a_start_locks_after_the_startup_check_for_the_whole_time() {
        let mut joint = that_locks_for(0.1);
        while joint.step(&HEALTHY).mode == JointMode::StartupCheck {}
        for locked in [false, true] {
            joint.set(if locked { JointSetPoint::Lock } else { FILLING }).unwrap();
            (0..30).for_each(|step| _ = joint.step(&alive(step)));
            let mut other = that_locks_for(0.1);
            other.set(JointSetPoint::Lock).unwrap();
            joint.restart_as(&other);
            let modes: Vec<_> = (0..200_u16)
                .map(|step| {
                    let code = AdcCode(12_000 - 60 * step.min(50) + step % 2).into();
                    joint.step(&JointSample { pressure: [code; 2], ..alive(step) }).mode
                })
                .collect();
            let count = |mode| modes.iter().filter(|one| **one == mode).count();
            assert_eq!(
                [JointMode::StartupCheck, JointMode::Locked].map(count),
                [49, 100],
                "locked before: {locked}"
            );
            joint.arm(None).unwrap();
        }
    }

    /// Also after a restart of the board, and under the name of the joint's own fault.
    #[test]
    fn the_first_failure_is_kept_and_another_configuration_forgives_nothing() {
        let mut joint = filling();
        let torn = |sample: JointSample| JointSample {
            pressure: [sample.pressure[0], AdcCode(0).into()],
            ..sample
        };
        vents_after(&mut joint, torn);
        let first = joint.first_failure().unwrap();
        assert_eq!((first.faults, first.pressure_pa < 0.0), (Faults::PRESSURE_SENSOR, true));
        joint.restart_as(&Joint::new(&JointConfig::default()).unwrap());
        assert_eq!(joint.latched(), Faults::PRESSURE_SENSOR);
        assert!(joint.arm(None).is_err());

        let mut joint = filling();
        vents_after(&mut joint, open);
        assert!(joint.first_failure().unwrap().faults.intersects(Faults::JOINT_ANGLE));
        let mut board = Joint::unconfigured();
        board.recall(joint.first_failure().unwrap(), joint.latched());
        board.restart_as(&Joint::new(&JointConfig::default()).unwrap());
        assert_eq!(
            board.arm(None),
            Err(JointError::Faults([Faults::NONE; 2], JointFaults::ANGLE_SENSOR))
        );
    }

    #[test]
    fn it_is_armed_for_a_pressure_and_gives_no_more() {
        let mut joint = filling();
        assert_eq!(joint.arm(Some(2.0e5)), Ok(()));
        assert_eq!(joint.armed_pa(), Some(2.0e5));
        let pressures = |pa: f32| JointSetPoint::Pressures { pressure_pa: [1.5e5, pa] };
        assert_eq!(joint.set(pressures(2.0e5)), Ok(()));
        let refused = joint.set(pressures(2.1e5)).unwrap_err().to_string();
        assert_eq!(refused, "pressure_pa = 210000: must be from 0 to 200000");
        joint.set(FILLING).unwrap();
        let refused = joint.arm(Some(1.0e4)).unwrap_err();
        assert!(refused.to_string().starts_with("armed_pa = 10000: must be from"), "{refused}");
        assert_eq!((joint.armed_pa(), joint.set_point()), (Some(2.0e5), FILLING));
    }

    /// Nothing is driven before the sensors are tested, nor after disarming.
    #[test]
    fn it_vents_until_it_may_drive() {
        let mut joint = Joint::new(&JointConfig::default()).unwrap();
        joint.set(FILLING).unwrap();
        let first = joint.step(&HEALTHY);
        assert_eq!(first.mode, JointMode::StartupCheck);
        assert_eq!(first.commands(), [Command::VENT; 2]);
        while joint.step(&HEALTHY).mode == JointMode::StartupCheck {}
        assert_ne!(joint.step(&HEALTHY).commands(), [Command::VENT; 2], "a set point waited");
        joint.disarm();
        assert_eq!(joint.step(&HEALTHY).commands(), [Command::VENT; 2]);
        assert_eq!(joint.set(FILLING), Err(JointError::NotArmed));
    }

    /// An encoder at rest gives two codes; one that falls silent vents after 10 steps.
    #[test]
    fn an_encoder_that_falls_silent_is_a_lost_angle() {
        let mut config = JointConfig { angle_part: AnglePart::As5600, ..JointConfig::default() };
        config.mechanism.sensor_minimum_rad = -core::f32::consts::PI;
        let mut joint = Joint::new(&config).unwrap();
        let mut encoder = Encoder::default();
        // Nothing has been read yet when the board starts.
        for reading in core::iter::repeat_n(None, 5).chain(core::iter::repeat_n(Some(2400), 100)) {
            joint.step(&JointSample { angle: encoder.code(reading), ..HEALTHY });
        }
        joint.set(FILLING).unwrap();
        for step in 0..100 {
            let telemetry =
                joint.step(&JointSample { angle: encoder.code(Some(2400)), ..alive(step) });
            assert_eq!(telemetry.faults, JointFaults::NONE);
            let expected_rad = core::f32::consts::TAU * (2400.0 - 2048.0) / 4096.0;
            assert!((telemetry.angle_rad - expected_rad).abs() < 3e-4, "{}", telemetry.angle_rad);
        }
        let angle = core::cell::RefCell::new(encoder);
        let silent = |sample| JointSample { angle: angle.borrow_mut().code(None), ..sample };
        assert_eq!(vents_after(&mut joint, silent), Some(9));
        assert_eq!(joint.latched(), Faults::JOINT_ANGLE);
    }

    /// The converter's input is at a rail if an encoder gives the angle.
    #[test]
    fn a_joint_that_is_not_configured_judges_no_angle() {
        let mut joint = Joint::unconfigured();
        (0..100).for_each(|step| _ = joint.step(&open(alive(step))));
        joint.restart_as(&Joint::new(&JointConfig::default()).unwrap());
        assert_eq!(joint.latched(), Faults::NONE);
        assert_eq!(joint.step(&open(alive(0))).faults, JointFaults::ANGLE_SENSOR);
    }

    #[test]
    fn both_lengths_follow_from_the_angle() {
        let mut joint = filling();
        let telemetry = joint.step(&JointSample { angle: AdcCode(23_000), ..HEALTHY });
        let [a, b] = telemetry.muscles.map(|muscle| muscle.length_m);
        let way_m = 0.02 * telemetry.angle_rad;
        assert!((0.4..0.5).contains(&telemetry.angle_rad), "{}", telemetry.angle_rad);
        assert!((a - 0.27 + way_m).abs() < 1e-6 && (b - 0.27 - way_m).abs() < 1e-6, "{a} {b}");
    }

    /// Set points of a test; the last but one is refused.
    fn set_points() -> [JointSetPoint; 7] {
        [
            FILLING,
            JointSetPoint::Pressures { pressure_pa: [2.0e5, 1.5e5] },
            JointSetPoint::Torque { torque_n_m: 1.0, stiffness_n_m_rad: 10.0 },
            JointSetPoint::Angle(Motion::still(0.2, 14.0)),
            JointSetPoint::Lock,
            JointSetPoint::Duty { inlet: [f32::NAN; 2], outlet: [0.0; 2] },
            JointSetPoint::Vent,
        ]
    }

    fn disturbed(kind: u8, sample: JointSample) -> JointSample {
        let [a, b] = sample.pressure;
        match kind {
            0 => open(sample),
            1 => JointSample { pressure: [AdcCode(0).into(), b], ..sample },
            2 => JointSample { pressure: [a, AdcCode(29_300).into()], ..sample },
            3 => JointSample { emergency_stop: true, ..sample },
            4 => JointSample { missed_steps: 9, ..sample },
            5 => JointSample { heard: false, ..sample },
            _ => sample,
        }
    }

    proptest! {
        /// For any requests and readings: only an accepted set point drives, every fault vents both muscles or locks
        /// both, and nothing locks except where, when and for as long as permitted.
        #[test]
        fn what_must_be_still_is_never_driven(
            locks in any::<bool>(),
            turns in prop::collection::vec((0..12_usize, 0..12_u8, 0..60_u16), 1..20),
        ) {
            const LOCKING: Faults = Faults::LINK_LOST.with(Faults::LENGTH_SENSOR);
            let new = || that_locks_for(if locks { 0.02 } else { 0.0 });
            let mut joint = new();
            let (mut given, mut latched, mut locked_steps) = (false, Faults::NONE, 0);
            for (request, disturbance, steps) in turns {
                match request {
                    0 => {
                        joint.clear_faults();
                        (given, latched) = (false, joint.latched());
                    }
                    1 => {
                        joint.disarm();
                        given = false;
                    }
                    2 => {
                        let mut other = new();
                        other.set(FILLING).unwrap();
                        given = joint.is_armed();
                        joint.restart_as(&other);
                    }
                    3 | 4 => if joint.arm(None).is_ok() {
                        (given, latched) = (false, joint.latched());
                    }
                    _ => if joint.set(set_points()[request - 5]).is_ok() {
                        given = joint.set_point() != JointSetPoint::Vent;
                    }
                }
                for step in 0..steps {
                    let telemetry = joint.step(&disturbed(disturbance, alive(step)));
                    let [a, b] = telemetry.commands();
                    let [of_a, of_b] = telemetry.muscles.map(|muscle| muscle.faults);
                    let faults = of_a.with(of_b).with(telemetry.faults.of_failure());
                    let fails = faults.intersects(VENTING) || telemetry.faults != JointFaults::NONE;
                    let locked = telemetry.mode == JointMode::Locked;
                    locked_steps = if locked { locked_steps + 1 } else { 0 };
                    let vents = [a, b] == [Command::VENT; 2];
                    prop_assert!(!locked || locks && given && [a, b] == [Command::CLOSED; 2]);
                    prop_assert!(locked_steps <= 20);
                    prop_assert!(!fails || vents || locked, "{faults}");
                    let locking = LOCKING.with(Faults::JOINT_ANGLE);
                    prop_assert!(!fails || !locked || faults.of(locking) == faults, "{faults}");
                    given &= telemetry.set_point != JointSetPoint::Vent && (!fails || locked);
                    prop_assert!(given || vents, "{:?}", telemetry.mode);
                    let may_fill = given && joint.is_armed() && !fails;
                    prop_assert!(may_fill || a.inlet == Duty::ZERO && b.inlet == Duty::ZERO);
                    prop_assert!(vents || telemetry.mode != JointMode::StartupCheck);
                    prop_assert_eq!(joint.latched().of(latched), latched, "latched stays");
                    latched = joint.latched();
                }
            }
        }
    }
}
