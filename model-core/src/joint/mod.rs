//! A joint: two muscles against each other on one pulley, with an angle and a stiffness.
//!
//! ```text
//! JointSample --both muscles: sensing, supervisor--> one decision: may they? --controller--> four openings
//!                angle --> both lengths --> both estimators                  \-- otherwise both vent
//! ```
//!
//! Each muscle is a [`Core`]: sensing, estimator, plausibility monitor and supervisor are its own. Controller, arming and
//! the decision to vent belong to the joint: a venting fault of either muscle, or of the joint itself, opens both
//! outlets in the same step. One muscle is never vented alone, because the other would then throw the arm.
//!
//! One sensor gives the angle, and the angle both lengths. Without it there is no fallback: the joint
//! vents.
//!
//! With `joint.lock_s` above 0 a joint that is driven locks before it vents, all four valves shut, where link, angle or
//! a digital gas sensor is lost: both muscles then hold the arm as long as their gas does, and pressures are still
//! trusted. Every other fault, a pressure beyond its limit and the end of that time vent both.

pub mod allocation;
mod angle;
mod config;
pub mod controller;
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

use self::angle::AngleLine;
use self::controller::{JointController, Measured};
use self::guard::{Guard, Motions};
use self::lock::LockWatch;
use crate::control::{SetPointError, SetPointField};
use crate::parameter::ConfigError;
use crate::safety::supervisor::FirstFailure;
use crate::sample::{AdcCode, Command, Faults, RawCode, Sample, SetPoint, Telemetry};
use crate::step::{Core, Judged};
use crate::step_counts::timeout_steps;
use core::borrow::{Borrow, BorrowMut};

/// Everything that one step of a joint takes in. Arrays are of muscles a and b.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct JointSample {
    /// Pressures.
    pub pressure: [RawCode; 2],
    /// Gas temperatures.
    pub gas: [RawCode; 2],
    /// Angle: a code of the converter, or of an [`Encoder`](encoder::Encoder).
    pub angle: AdcCode,
    /// The emergency stop line is open or low.
    pub emergency_stop: bool,
    /// A request of the host has come since the step before.
    pub heard: bool,
    /// The host asks more than is carried out.
    pub flooded: bool,
    /// Steps that were left out before this one.
    pub missed_steps: u8,
}

impl JointSample {
    /// The samples of both muscles. The code of the angle stands in place of their lengths'.
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
    /// Startup check: it vents and tests the sensors.
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
    /// The joint is where it should be, and all valves rest.
    AngleHeld,
    /// All four valves shut, until `joint.lock_s` are over.
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

    /// Its name, as in the messages.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|(mode, _)| *mode == self).map_or("", |(_, name)| name)
    }
}

/// Everything that one step of a joint leaves behind.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct JointTelemetry {
    /// Both muscles: their mode and set point only show that the joint drives them.
    pub muscles: [Telemetry; 2],
    /// Mode of the joint.
    pub mode: JointMode,
    /// Measured angle \[rad\].
    pub angle_rad: f32,
    /// Observed speed \[rad/s\].
    pub speed_rad_s: f32,
    /// Angle of the reference \[rad\].
    pub reference_rad: f32,
    /// Torque of both muscles, by pressures and angle \[N m\].
    pub torque_n_m: f32,
    /// Stiffness of both muscles behind shut valves \[N m/rad\].
    pub stiffness_n_m_rad: f32,
    /// Torque that nothing configured explains \[N m\].
    pub disturbance_n_m: f32,
    /// Stiffness, or torque too, had to give way to the limits of pressure.
    pub limited: bool,
    /// The set point of this step: to vent or to lock where the joint decided so.
    pub set_point: JointSetPoint,
    /// Faults of the joint that hold or are latched.
    pub faults: JointFaults,
}

impl JointTelemetry {
    /// Number of the step, the same of both muscles.
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

/// Two muscles, one angle, one controller, one decision to vent. `M` is a muscle's core, or a reference to one that
/// is kept elsewhere: a board has no room to build a whole joint on its stack.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint<M = Core> {
    muscles: [M; 2],
    config: JointConfig,
    line: AngleLine,
    controller: JointController,
    guard: Guard,
    set_point: JointSetPoint,
    /// Steps since it was given.
    set_steps: u32,
    /// The openings of the PWM period under way.
    commands: [Command; 2],
    /// The controller has started from what was measured.
    started: bool,
    /// Its gas while it is locked.
    lock: Option<LockWatch>,
    /// Absolute pressures of both muscles above which it vents, as it was armed for its set point \[Pa\].
    limits_pa: [f32; 2],
    /// Faults that hold now, and those that are latched.
    present: JointFaults,
    latched: JointFaults,
    first: Option<FirstFailure>,
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
    /// A joint that vents until it has tested its sensors and is given a set point. It is armed, as a
    /// [`Core`] is.
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

    /// The joint of a board without a configuration: it and its muscles have the default one, and it vents until it
    /// is [restarted](Self::restart_as) as one that is configured, and armed.
    pub fn unconfigured() -> Self {
        Self::unconfigured_in(|muscle| muscle)
    }
}

impl<M: BorrowMut<Core>> Joint<M> {
    /// With a configuration that holds, and muscles that have it.
    #[cold]
    fn of(mut muscles: [M; 2], config: &JointConfig) -> Self {
        let [_, b] = both_mut(&mut muscles);
        b.delay_estimator();
        Self {
            muscles,
            line: AngleLine::new(config),
            controller: JointController::new(config),
            guard: Guard::new(config),
            set_point: JointSetPoint::Vent,
            set_steps: 0,
            commands: [Command::VENT; 2],
            started: false,
            lock: None,
            limits_pa: [0.0; 2],
            present: JointFaults::NONE,
            latched: JointFaults::NONE,
            first: None,
            config: *config,
        }
    }

    /// Becomes [`new`](Self::new) with another configuration, in its place: a board has no memory for a third joint.
    ///
    /// # Errors
    /// [`ConfigError`] as [`JointConfig::check`]; it is as before then.
    #[cold]
    pub fn become_new(&mut self, config: &JointConfig) -> Result<(), ConfigError> {
        config.check()?;
        let [a, b] = both_mut(&mut self.muscles);
        let [config_a, config_b] = &config.muscles;
        a.become_of(config_a);
        b.become_of(config_b);
        b.delay_estimator();
        self.line = AngleLine::new(config);
        self.controller = JointController::new(config);
        self.guard = Guard::new(config);
        self.set_point = JointSetPoint::Vent;
        self.set_steps = 0;
        self.commands = [Command::VENT; 2];
        self.started = false;
        self.lock = None;
        self.limits_pa = [0.0; 2];
        (self.present, self.latched) = (JointFaults::NONE, JointFaults::NONE);
        self.first = None;
        self.config = *config;
        Ok(())
    }

    /// As [`unconfigured`](Joint::unconfigured), with muscles that are kept where `place` puts them.
    #[cold]
    pub fn unconfigured_in(mut place: impl FnMut(Core) -> M) -> Self {
        let config = JointConfig::default();
        Self::of(config.muscles.each_ref().map(|muscle| place(Core::of(muscle, false))), &config)
    }

    /// Whether somebody has configured it.
    pub fn is_configured(&self) -> bool {
        !self.venting().iter().any(|faults| faults.intersects(Faults::NOT_CONFIGURED))
    }

    /// Restarts as `other`, with its configuration and, where the joint is armed, its set point. What is latched
    /// is latched, as [`Core::restart_as`] has it.
    pub fn restart_as(&mut self, other: &Self) {
        let armed = self.is_armed();
        let others = both(&other.muscles);
        for (muscle, other) in both_mut(&mut self.muscles).into_iter().zip(others) {
            muscle.restart_as(other);
        }
        self.config = other.config;
        self.line = other.line;
        self.controller = other.controller;
        self.guard = other.guard;
        self.set_point = if armed { other.set_point } else { JointSetPoint::Vent };
        self.set_steps = other.set_steps;
        self.note_limits();
        self.commands = [Command::VENT; 2];
        self.started = false;
    }

    /// Keeps the limits of a set point: a fault disarms the muscles, and their supervisors then only have the
    /// configuration's.
    fn note_limits(&mut self) {
        let [a, b] = both(&self.muscles);
        self.limits_pa = [a.supervisor().limit_pa(), b.supervisor().limit_pa()];
    }

    /// Takes over what was latched before the board restarted. It does not say of which muscle: both have it.
    pub fn recall(&mut self, first: FirstFailure, latched: Faults) {
        both_mut(&mut self.muscles).into_iter().for_each(|muscle| muscle.recall(first, latched));
        self.latched = self.latched.with(JointFaults::from_failure(latched));
        self.first = Some(first);
    }

    /// The first failure since faults were last cleared, or the last one before that: the faults of both muscles and
    /// of the joint in that step, and the pressure of the muscle that has one.
    pub fn first_failure(&self) -> Option<FirstFailure> {
        self.first
    }

    /// Faults of muscles and joint that stay until they are cleared.
    pub fn latched(&self) -> Faults {
        let [a, b] = both(&self.muscles);
        let muscles = a.supervisor().latched().with(b.supervisor().latched());
        muscles.with(self.latched.of_failure())
    }

    /// Takes set points from now on, with pressures of no more than `most_pa` in either muscle \[Pa\]; `None`: as
    /// much as the configuration gives. It vents until there is one.
    ///
    /// # Errors
    /// [`JointError::Range`] for a pressure below what a muscle has now or above its configuration's, and
    /// [`JointError::Faults`] while faults vent; it is as armed as before.
    pub fn arm(&mut self, most_pa: Option<f32>) -> Result<(), JointError> {
        let [a, b] = both_mut(&mut self.muscles);
        match a.may_arm(most_pa).and_then(|_| b.may_arm(most_pa)) {
            Ok(_) if self.latched == JointFaults::NONE => {
                // Neither fails now.
                let _ = a.arm(most_pa).and_then(|()| b.arm(most_pa));
                self.vent();
                Ok(())
            }
            Err(SetPointError::Range { field: SetPointField::Armed, value, minimum, maximum }) => {
                Err(JointError::Range { field: JointField::Armed, value, minimum, maximum })
            }
            _ => Err(JointError::Faults(self.venting(), self.latched)),
        }
    }

    /// Vents, and takes no set point until it is [armed](Self::arm).
    pub fn disarm(&mut self) {
        self.vent();
        both_mut(&mut self.muscles).into_iter().for_each(Core::disarm);
    }

    /// Whether set points are taken.
    pub fn is_armed(&self) -> bool {
        self.armed_pa().is_some()
    }

    /// Highest absolute pressure that either muscle may be given \[Pa\]; `None`: it is not armed.
    pub fn armed_pa(&self) -> Option<f32> {
        let [a, b] = both(&self.muscles);
        a.armed_pa().zip(b.armed_pa()).map(|(a, b)| if a < b { a } else { b })
    }

    /// Vents both muscles, from the next step on.
    pub fn vent(&mut self) {
        self.set_point = JointSetPoint::Vent;
        self.started = false;
        both_mut(&mut self.muscles).into_iter().for_each(Core::vent);
    }

    /// Forgets latched faults whose cause is gone, and vents until it is armed and has a set point.
    pub fn clear_faults(&mut self) {
        self.latched = self.present;
        both_mut(&mut self.muscles).into_iter().for_each(Core::clear_faults);
        self.disarm();
    }

    /// The set point.
    pub fn set_point(&self) -> JointSetPoint {
        self.set_point
    }

    /// The configuration that the joint runs with.
    pub fn config(&self) -> &JointConfig {
        &self.config
    }

    fn venting(&self) -> [Faults; 2] {
        let [a, b] = both(&self.muscles);
        [a.supervisor().venting(), b.supervisor().venting()]
    }

    /// Changes what the joint is to do, from the next PWM period on; to vent, from the next step on.
    ///
    /// # Errors
    /// [`JointError`] for a value that is no number or out of its range, and for anything but to vent while faults
    /// do or it is not armed; what held before goes on.
    pub fn set(&mut self, set_point: JointSetPoint) -> Result<(), JointError> {
        set_point.check(&self.config)?;
        if set_point == JointSetPoint::Vent {
            self.vent();
            return Ok(());
        }
        let faults = self.venting();
        if faults != [Faults::NONE; 2] || self.latched != JointFaults::NONE {
            return Err(JointError::Faults(faults, self.latched));
        }
        if !self.is_armed() {
            return Err(JointError::NotArmed);
        }
        if let JointSetPoint::Pressures { pressure_pa } = set_point {
            for (value, muscle) in pressure_pa.into_iter().zip(both(&self.muscles)) {
                if let Some(maximum) = muscle.armed_below(value) {
                    let field = JointField::Pressure;
                    return Err(JointError::Range { field, value, minimum: 0.0, maximum });
                }
            }
        }
        for muscle in both_mut(&mut self.muscles) {
            // Driven, but by the joint: with both valves shut its own controller does nothing.
            let driven = muscle.set(SetPoint::Duty { inlet: 0.0, outlet: 0.0 });
            driven.map_err(|error| match error {
                SetPointError::Faults(_) => JointError::Faults(faults, self.latched),
                _ => JointError::NotArmed,
            })?;
        }
        let kind = core::mem::discriminant::<JointSetPoint>;
        // The guard of a joint that was driven goes on while it is locked.
        if kind(&set_point) != kind(&self.set_point) && set_point != JointSetPoint::Lock {
            self.started = false;
        }
        self.note_limits();
        // Given once more, it is as old as it was: a trace only has those that differ.
        if set_point != self.set_point {
            self.set_steps = 0;
        }
        self.set_point = set_point;
        Ok(())
    }

    /// One step. During the startup check the joint vents, and neither estimates nor counts steps.
    pub fn step(&mut self, sample: &JointSample) -> JointTelemetry {
        let samples = sample.muscles();
        let latched_before = self.latched() != Faults::NONE;
        let (angle_rad, wide_rad) = self.line.read(sample.angle);
        let [length_a_m, length_b_m] = self.config.mechanism.lengths_m(angle_rad);
        let [wide_a_m, wide_b_m] = self.controller.ways_m(wide_rad);
        let [sample_a, sample_b] = &samples;
        let [a, b] = both_mut(&mut self.muscles);
        let judged = [
            a.begin(sample_a, Some((length_a_m, wide_a_m))),
            b.begin(sample_b, Some((length_b_m, wide_b_m))),
        ];
        let [judged_a, judged_b] = &judged;
        // Their own openings are not used; their periods go on as the hardware's do.
        a.openings(sample_a, judged_a);
        b.openings(sample_b, judged_b);
        let pressure_pa = [a.measured(judged_a), b.measured(judged_b)].map(|one| one.pressure_pa);
        let gauge_pa = self.gauge_pa(pressure_pa);
        self.controller.press(gauge_pa, angle_rad);
        self.watch(angle_rad, &judged);
        if !latched_before && self.latched() != Faults::NONE {
            self.first = Some(self.failure(pressure_pa, &judged));
        }
        let fails = self.venting() != [Faults::NONE; 2] || self.latched != JointFaults::NONE;
        if fails && (self.is_armed() || self.set_point != JointSetPoint::Vent) {
            if self.may_lock(pressure_pa) {
                self.set_point = JointSetPoint::Lock;
                both_mut(&mut self.muscles).into_iter().for_each(Core::disarm);
            } else {
                // Vents both in this step, whichever of the two, or the joint, has the fault.
                self.disarm();
            }
        }
        self.count_lock(pressure_pa, &judged);
        if judged.iter().all(Judged::is_checked) {
            self.drive(angle_rad, &judged);
        }
        self.finish(angle_rad, gauge_pa, &samples, &judged)
    }

    fn gauge_pa(&self, pressure_pa: [f32; 2]) -> [f32; 2] {
        let [a, b] = &self.config.muscles;
        let [of_a, of_b] = pressure_pa;
        [of_a - a.ambient.pressure_pa, of_b - b.ambient.pressure_pa]
    }

    /// Whether what fails leaves the pressures of a driven joint trusted and below their limits, so that shut valves
    /// hold it more safely than open ones.
    #[cold]
    fn may_lock(&self, pressure_pa: [f32; 2]) -> bool {
        const HARMLESS: Faults = Faults::LINK_LOST.with(Faults::GAS_LOST);
        let harmless = [JointFaults::NONE, JointFaults::ANGLE_SENSOR].contains(&self.latched)
            && self.venting().iter().all(|faults| faults.without(HARMLESS) == Faults::NONE);
        let trusted =
            both(&self.muscles).iter().all(|muscle| muscle.supervisor().pressure_trusted());
        let below = pressure_pa.iter().zip(self.limits_pa).all(|(pa, limit_pa)| *pa < limit_pa);
        let wanted = self.config.mechanism.lock_s > 0.0 && self.set_point != JointSetPoint::Vent;
        // Valves that vent until a set point's first period go on venting.
        let driven = self.started || self.commands != [Command::VENT; 2];
        wanted && driven && harmless && trusted && below
    }

    /// Ends a lock whose time is over, or in which a muscle leaks: both vent in this step.
    fn count_lock(&mut self, pressure_pa: [f32; 2], judged: &[Judged; 2]) {
        if self.set_point == JointSetPoint::Lock {
            self.watch_lock(pressure_pa, judged);
        } else {
            self.lock = None;
        }
    }

    #[cold]
    fn watch_lock(&mut self, pressure_pa: [f32; 2], judged: &[Judged; 2]) {
        let [config_a, _] = &self.config.muscles;
        let step_s = config_a.step_s;
        let [a, b] = both(&self.muscles);
        let [judged_a, judged_b] = judged;
        let watch = self.lock.get_or_insert_with(|| {
            let feedback = [a.measured(judged_a), b.measured(judged_b)];
            let wall_k = feedback.map(|one| one.estimate.wall_k);
            LockWatch::new(step_s, feedback.map(|one| one.muscle()), wall_k)
        });
        let leaks = watch.step(pressure_pa)
            || judged.iter().any(|one| one.faults().intersects(Faults::LEAK));
        if leaks || watch.steps() > timeout_steps(self.config.mechanism.lock_s, step_s) {
            self.disarm();
        }
    }

    #[cold]
    fn failure(&self, [of_a, of_b]: [f32; 2], judged: &[Judged; 2]) -> FirstFailure {
        let [a, b] = both(&self.muscles);
        let [judged_a, judged_b] = judged;
        let faults = judged_a.faults().with(judged_b.faults()).with(self.latched.of_failure());
        // Of the pair, the one that has the fault.
        let only_b =
            a.supervisor().latched() == Faults::NONE && b.supervisor().latched() != Faults::NONE;
        FirstFailure { faults, pressure_pa: if only_b { of_b } else { of_a }, step: a.steps() }
    }

    /// Observer and faults of the joint.
    fn watch(&mut self, angle_rad: f32, judged: &[Judged; 2]) {
        // The angle's sensor is not known before it is configured.
        let lost = self.is_configured()
            && judged.iter().any(|one| one.faults().intersects(Faults::LENGTH_SENSOR));
        let mut present = JointFaults::ANGLE_SENSOR.when(lost);
        if self.started && !lost && !self.latched.intersects(JointFaults::ANGLE_SENSOR) {
            let torque_n_m = self.controller.observe(&self.config.mechanism, angle_rad);
            present = present.with(self.guard.step(&Motions {
                angle_rad,
                speed_rad_s: self.controller.speed_rad_s(),
                torque_n_m,
                coulomb_n_m: self.controller.coulomb_n_m(),
                disturbance_n_m: self.controller.disturbance_n_m(),
                holds: self.controller.holding(),
            }));
        }
        self.present = present;
        self.latched = self.latched.with(present);
    }

    /// The openings of this step. But for venting they change at the start of a PWM period only.
    fn drive(&mut self, angle_rad: f32, judged: &[Judged; 2]) {
        let [a, b] = both(&self.muscles);
        let [config_a, config_b] = &self.config.muscles;
        let [judged_a, judged_b] = judged;
        let measured = [(config_a, a, a.measured(judged_a)), (config_b, b, b.measured(judged_b))]
            .map(|(config, muscle, feedback)| Measured {
                config,
                chamber: muscle.chamber(),
                feedback,
                most_pa: muscle.armed_pa().unwrap_or(0.0),
            });
        let (begins, ends) = (a.begins_period(), a.ends_period());
        let mechanism = &self.config.mechanism;
        if self.set_point == JointSetPoint::Vent {
            self.commands = self.controller.vent();
        } else if self.set_point == JointSetPoint::Lock {
            self.commands = self.controller.lock();
        } else if begins {
            if !self.started {
                self.controller.restart(mechanism, angle_rad, &measured);
                self.guard.restart(angle_rad);
                self.started = true;
            }
            let set_point = match self.set_point {
                JointSetPoint::Angle(given) if given.moves() => {
                    self.controller.leave_course(given.angle_rad);
                    let age_s = self.set_steps as f32 * config_a.step_s;
                    self.set_point.after(age_s, mechanism)
                }
                JointSetPoint::Angle(given) => {
                    JointSetPoint::Angle(self.controller.course(mechanism, given, self.set_steps))
                }
                given => given,
            };
            self.commands = self.controller.period(mechanism, &set_point, angle_rad, &measured);
        }
        // A step ahead, and a step after: the one that begins a period is the longest.
        if ends {
            self.controller.measure(mechanism, angle_rad, &measured);
        } else if !begins {
            self.controller.weigh(mechanism, angle_rad, &measured);
        }
        self.set_steps = self.set_steps.saturating_add(1);
    }

    /// Ends the step of both muscles.
    fn finish(
        &mut self,
        angle_rad: f32,
        gauge_pa: [f32; 2],
        samples: &[Sample; 2],
        judged: &[Judged; 2],
    ) -> JointTelemetry {
        let [sample_a, sample_b] = samples;
        let [judged_a, judged_b] = judged;
        let [command_a, command_b] = self.commands;
        let [a, b] = both_mut(&mut self.muscles);
        let muscles = [a.end(sample_a, judged_a, command_a), b.end(sample_b, judged_b, command_b)];
        JointTelemetry {
            mode: self.mode(&muscles),
            muscles,
            angle_rad,
            speed_rad_s: self.controller.speed_rad_s(),
            reference_rad: self.controller.reference_rad(),
            torque_n_m: self.controller.torque_n_m(),
            stiffness_n_m_rad: self.controller.stiffness_n_m_rad(gauge_pa),
            disturbance_n_m: self.controller.disturbance_n_m(),
            limited: self.controller.limited(),
            set_point: self.set_point,
            faults: self.latched,
        }
    }

    fn mode(&self, [a, _]: &[Telemetry; 2]) -> JointMode {
        match self.set_point {
            _ if a.mode == crate::sample::Mode::StartupCheck => JointMode::StartupCheck,
            JointSetPoint::Vent => JointMode::Vent,
            JointSetPoint::Lock => JointMode::Locked,
            JointSetPoint::Duty { .. } => JointMode::Duty,
            JointSetPoint::Pressures { .. } => JointMode::Pressures,
            JointSetPoint::Torque { .. } => JointMode::Torque,
            JointSetPoint::Angle(_) if self.controller.holding() => JointMode::AngleHeld,
            JointSetPoint::Angle(_) => JointMode::Angle,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::encoder::Encoder;
    use super::*;
    use crate::sample::CODE_MAX;

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

    /// Codes that are alive.
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

    /// Steps until both vent with that sample. Until then neither does.
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

    /// A joint that locks for that time.
    fn that_locks_for(lock_s: f32) -> Joint {
        let mut config = JointConfig::default();
        config.mechanism.lock_s = lock_s;
        config.muscles.iter_mut().for_each(|muscle| muscle.link.timeout_s = 0.01);
        Joint::new(&config).unwrap()
    }

    fn open(sample: JointSample) -> JointSample {
        JointSample { angle: AdcCode(CODE_MAX), ..sample }
    }

    /// A set point that waits for the sensors to be tested drives nothing yet.
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

    /// A fault disarms it; it was armed up to 200 kPa, and vents 5 % of its range above.
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

    /// It locks for 20 ms, and vents for all but a lost link, angle or digital part.
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

    /// Also over a restart of the board, and by the name of the joint's own fault.
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

    /// Nothing is driven before the sensors are tested, nor after it was disarmed.
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

    /// An encoder that stands still has two codes, one that falls silent vents after 10 steps.
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

    /// The converter's input is at a rail where an encoder gives the angle.
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
}
