//! All of a joint except its muscles: one angle, one controller, and one decision to drive both or to vent both.

use super::angle::AngleLine;
use super::controller::{JointController, Measured};
use super::guard::{Guard, Motions};
use super::lock::LockWatch;
use super::{
    JointConfig, JointFaults, JointMode, JointSample, JointSetPoint, JointTelemetry, Mechanism,
};
use crate::safety::supervisor::FirstFailure;
use crate::sample::{Command, Faults, Mode, Sample, Telemetry};
use crate::step::{Core, Judged};
use crate::step_counts::timeout_steps;

/// Muscles a and b, which are stored elsewhere.
type Muscles<'a> = [&'a mut Core; 2];

/// Muscles a and b, read only.
fn shared<'a>([a, b]: &'a Muscles) -> [&'a Core; 2] {
    [a, b]
}

/// Venting faults of each muscle.
pub(super) fn venting([a, b]: [&Core; 2]) -> [Faults; 2] {
    [a.supervisor().venting(), b.supervisor().venting()]
}

/// Whether both muscles have a configuration that was set.
pub(super) fn is_configured(muscles: [&Core; 2]) -> bool {
    !venting(muscles).iter().any(|faults| faults.intersects(Faults::NOT_CONFIGURED))
}

/// Highest absolute pressure permitted in either muscle \[Pa\]; `None` if one of them is not armed.
pub(super) fn armed_pa([a, b]: [&Core; 2]) -> Option<f32> {
    a.armed_pa().zip(b.armed_pa()).map(|(a, b)| if a < b { a } else { b })
}

fn gauge_pa([a, b]: [&Core; 2], [of_a, of_b]: [f32; 2]) -> [f32; 2] {
    [of_a - a.config().ambient.pressure_pa, of_b - b.config().ambient.pressure_pa]
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Coordinator {
    line: AngleLine,
    controller: JointController,
    guard: Guard,
    pub(super) set_point: JointSetPoint,
    /// Steps since the set point came.
    set_steps: u32,
    /// The openings of the PWM period under way.
    commands: [Command; 2],
    /// Whether the controller has started from the measured values.
    started: bool,
    /// Gas of the joint while it is locked.
    lock: Option<LockWatch>,
    /// Absolute pressures of both muscles above which the joint vents, as armed for its set point \[Pa\].
    limits_pa: [f32; 2],
    /// Faults that are present, and those that are latched.
    pub(super) present: JointFaults,
    pub(super) latched: JointFaults,
    pub(super) first: Option<FirstFailure>,
}

impl Coordinator {
    /// Creates the coordinator from a checked configuration.
    #[cold]
    pub(super) fn new(config: &JointConfig) -> Self {
        Self {
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
        }
    }

    /// Replaces this by [`new`](Self::new). Not inlined: the stack holds muscles or this, one after the other.
    #[inline(never)]
    pub(super) fn become_new(&mut self, config: &JointConfig) {
        *self = Self::new(config);
    }

    /// Becomes `other` but keeps its own faults, and takes the other's set point if the muscles were armed.
    pub(super) fn restart_as(&mut self, muscles: [&Core; 2], other: &Self, armed: bool) {
        self.line = other.line;
        self.controller = other.controller;
        self.guard = other.guard;
        self.set_point = if armed { other.set_point } else { JointSetPoint::Vent };
        self.set_steps = other.set_steps;
        self.note_limits(muscles);
        self.commands = [Command::VENT; 2];
        self.started = false;
    }

    /// Sets a set point for muscles that are armed.
    pub(super) fn set(&mut self, muscles: [&Core; 2], set_point: JointSetPoint) {
        let kind = core::mem::discriminant::<JointSetPoint>;
        // The guard of a joint that was driven continues while it is locked.
        if kind(&set_point) != kind(&self.set_point) && set_point != JointSetPoint::Lock {
            self.started = false;
        }
        self.note_limits(muscles);
        // A repeated set point keeps its age: a trace only contains changes.
        if set_point != self.set_point {
            self.set_steps = 0;
        }
        self.set_point = set_point;
    }

    /// Keeps the limits of a set point: a fault disarms the muscles, and their supervisors are then left with the
    /// configured limits.
    fn note_limits(&mut self, [a, b]: [&Core; 2]) {
        self.limits_pa = [a.supervisor().limit_pa(), b.supervisor().limit_pa()];
    }

    /// Faults of muscles and joint that stay until they are cleared.
    pub(super) fn latched(&self, [a, b]: [&Core; 2]) -> Faults {
        let muscles = a.supervisor().latched().with(b.supervisor().latched());
        muscles.with(self.latched.of_failure())
    }

    /// Whether faults vent.
    pub(super) fn fails(&self, muscles: [&Core; 2]) -> bool {
        venting(muscles) != [Faults::NONE; 2] || self.latched != JointFaults::NONE
    }

    /// Vents both muscles, from the next step on.
    pub(super) fn vent(&mut self, [a, b]: &mut Muscles) {
        self.set_point = JointSetPoint::Vent;
        self.started = false;
        a.vent();
        b.vent();
    }

    /// Vents both muscles, and accepts no set point until they are armed.
    pub(super) fn disarm(&mut self, muscles: &mut Muscles) {
        self.vent(muscles);
        muscles.iter_mut().for_each(|muscle| muscle.disarm());
    }

    /// Runs one step. During the startup check the joint vents, and neither estimates nor counts steps.
    pub(super) fn step(
        &mut self,
        mechanism: &Mechanism,
        muscles: &mut Muscles,
        sample: &JointSample,
    ) -> JointTelemetry {
        let samples = sample.muscles();
        let latched_before = self.latched(shared(muscles)) != Faults::NONE;
        let (angle_rad, wide_rad) = self.line.read(sample.angle);
        let [length_a_m, length_b_m] = mechanism.lengths_m(angle_rad);
        let [wide_a_m, wide_b_m] = self.controller.ways_m(wide_rad);
        let [sample_a, sample_b] = &samples;
        let [a, b] = &mut *muscles;
        let judged = [
            a.begin(sample_a, Some((length_a_m, wide_a_m))),
            b.begin(sample_b, Some((length_b_m, wide_b_m))),
        ];
        let [judged_a, judged_b] = &judged;
        // The muscles' own openings are not used; their periods continue like the hardware's.
        a.openings(sample_a, judged_a);
        b.openings(sample_b, judged_b);
        let pressure_pa = [a.measured(judged_a), b.measured(judged_b)].map(|one| one.pressure_pa);
        let both = shared(muscles);
        let gauge_pa = gauge_pa(both, pressure_pa);
        self.controller.press(gauge_pa, angle_rad);
        self.watch(mechanism, both, angle_rad, &judged);
        if !latched_before && self.latched(both) != Faults::NONE {
            self.first = Some(self.failure(both, pressure_pa, &judged));
        }
        if self.fails(both) && (armed_pa(both).is_some() || self.set_point != JointSetPoint::Vent) {
            if self.may_lock(mechanism, both, pressure_pa) {
                self.set_point = JointSetPoint::Lock;
                muscles.iter_mut().for_each(|muscle| muscle.disarm());
            } else {
                // Vents both in this step, whichever of the two, or the joint, has the fault.
                self.disarm(muscles);
            }
        }
        let checked = judged.iter().all(Judged::is_checked);
        if checked && self.set_point == JointSetPoint::Lock {
            self.watch_lock(mechanism, muscles, pressure_pa, &judged);
        } else {
            self.lock = None;
        }
        if checked {
            self.drive(mechanism, shared(muscles), angle_rad, &judged);
        }
        self.finish(muscles, angle_rad, gauge_pa, &samples, &judged)
    }

    /// Whether the faults leave the pressures of a driven joint trusted and below their limits, so that shut valves
    /// hold it more safely than open ones.
    #[cold]
    fn may_lock(&self, mechanism: &Mechanism, muscles: [&Core; 2], pressure_pa: [f32; 2]) -> bool {
        const HARMLESS: Faults = Faults::LINK_LOST.with(Faults::GAS_LOST);
        let harmless = [JointFaults::NONE, JointFaults::ANGLE_SENSOR].contains(&self.latched)
            && venting(muscles).iter().all(|faults| faults.without(HARMLESS) == Faults::NONE);
        let trusted = muscles.iter().all(|muscle| muscle.supervisor().pressure_trusted());
        let below = pressure_pa.iter().zip(self.limits_pa).all(|(pa, limit_pa)| *pa < limit_pa);
        let wanted = mechanism.lock_s > 0.0 && self.set_point != JointSetPoint::Vent;
        // Valves that vent until a set point's first period continue to vent.
        let driven = self.started || self.commands != [Command::VENT; 2];
        wanted && driven && harmless && trusted && below
    }

    /// Ends a lock whose time is over, or in which a muscle leaks: both vent in this step.
    #[cold]
    fn watch_lock(
        &mut self,
        mechanism: &Mechanism,
        muscles: &mut Muscles,
        pressure_pa: [f32; 2],
        judged: &[Judged; 2],
    ) {
        let [a, b] = shared(muscles);
        let step_s = a.config().step_s;
        let [judged_a, judged_b] = judged;
        let watch = self.lock.get_or_insert_with(|| {
            let feedback = [a.measured(judged_a), b.measured(judged_b)];
            let wall_k = feedback.map(|one| one.estimate.wall_k);
            LockWatch::new(step_s, feedback.map(|one| one.muscle()), wall_k)
        });
        let leaks = watch.step(pressure_pa)
            || judged.iter().any(|one| one.faults().intersects(Faults::LEAK));
        if leaks || watch.steps() > timeout_steps(mechanism.lock_s, step_s) {
            self.disarm(muscles);
        }
    }

    #[cold]
    fn failure(
        &self,
        [a, b]: [&Core; 2],
        [of_a, of_b]: [f32; 2],
        judged: &[Judged; 2],
    ) -> FirstFailure {
        let [judged_a, judged_b] = judged;
        let faults = judged_a.faults().with(judged_b.faults()).with(self.latched.of_failure());
        // Of the pair, the muscle that has the fault.
        let only_b =
            a.supervisor().latched() == Faults::NONE && b.supervisor().latched() != Faults::NONE;
        FirstFailure { faults, pressure_pa: if only_b { of_b } else { of_a }, step: a.steps() }
    }

    /// Updates observer and faults of the joint.
    fn watch(
        &mut self,
        mechanism: &Mechanism,
        muscles: [&Core; 2],
        angle_rad: f32,
        judged: &[Judged; 2],
    ) {
        // Before it is configured, the type of the angle's sensor is unknown.
        let lost = is_configured(muscles)
            && judged.iter().any(|one| one.faults().intersects(Faults::LENGTH_SENSOR));
        let mut present = JointFaults::ANGLE_SENSOR.when(lost);
        if self.started && !lost && !self.latched.intersects(JointFaults::ANGLE_SENSOR) {
            let torque_n_m = self.controller.observe(mechanism, angle_rad);
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

    /// The openings of this step. Except for venting they change only at the start of a PWM period.
    fn drive(
        &mut self,
        mechanism: &Mechanism,
        [a, b]: [&Core; 2],
        angle_rad: f32,
        judged: &[Judged; 2],
    ) {
        let [judged_a, judged_b] = judged;
        let measured = [(a, judged_a), (b, judged_b)].map(|(muscle, judged)| Measured {
            config: muscle.config(),
            chamber: muscle.chamber(),
            feedback: muscle.measured(judged),
            most_pa: muscle.armed_pa().unwrap_or(0.0),
        });
        let (begins, ends) = (a.begins_period(), a.ends_period());
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
                    let age_s = self.set_steps as f32 * a.config().step_s;
                    self.set_point.after(age_s, mechanism)
                }
                JointSetPoint::Angle(given) => {
                    JointSetPoint::Angle(self.controller.course(mechanism, given, self.set_steps))
                }
                given => given,
            };
            self.commands = self.controller.period(mechanism, &set_point, angle_rad, &measured);
        }
        // One step before a period, and one after its first: the step that begins a period is the longest.
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
        [a, b]: &mut Muscles,
        angle_rad: f32,
        gauge_pa: [f32; 2],
        samples: &[Sample; 2],
        judged: &[Judged; 2],
    ) -> JointTelemetry {
        let [sample_a, sample_b] = samples;
        let [judged_a, judged_b] = judged;
        let [command_a, command_b] = self.commands;
        let muscles = [a.end(sample_a, judged_a, command_a), b.end(sample_b, judged_b, command_b)];
        let mode = self.mode(&muscles);
        let drives = !matches!(mode, JointMode::StartupCheck | JointMode::Vent | JointMode::Locked);
        JointTelemetry {
            mode,
            muscles,
            angle_rad,
            speed_rad_s: self.controller.speed_rad_s(),
            reference_rad: self.controller.reference_rad(),
            torque_n_m: self.controller.torque_n_m(),
            stiffness_n_m_rad: self.controller.stiffness_n_m_rad(gauge_pa),
            disturbance_n_m: self.controller.disturbance_n_m(),
            limited: drives && self.started && self.controller.limited(),
            set_point: self.set_point,
            faults: self.latched,
        }
    }

    fn mode(&self, [a, _]: &[Telemetry; 2]) -> JointMode {
        match self.set_point {
            _ if a.mode == Mode::StartupCheck => JointMode::StartupCheck,
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
