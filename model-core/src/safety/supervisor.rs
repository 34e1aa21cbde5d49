//! The supervisor decides from all faults whether the muscle must vent.
//!
//! | fault | detected | consequence |
//! |---|---|---|
//! | emergency stop | at once | vent, latched |
//! | pressure sensor at a rail | for 10 ms | vent, latched |
//! | pressure sensor noisier than gas can be | ten jerks together, or more than one in five steps for longer | vent, latched |
//! | pressure sensor's code does not change while gas flows | for 60 such steps | vent, latched |
//! | overpressure | for 10 ms | vent, latched |
//! | gas sensor at a rail | at once | shown while it lasts; the estimator goes on without it |
//! | gas sensor noisier than its lag allows | as many jerks | the same |
//! | gas sensor's code does not change | when its element must have moved | the same |
//! | gas sensor contradicts the model | by five deviations over half a second | shown for ten seconds; the one further from ambient is wrong: the sensor is left out, or the estimator starts again |
//! | digital gas part silent | for its `timeout_s` | vent, latched: its bus is broken, and other parts on it may be too |
//! | ... reports that it is broken, or reads outside of its range | twice in a row | vent, latched; once is shown |
//! | digital pressure part silent, at a rail | the same | vent, latched |
//! | length sensor at a rail | at once | shown while it lasts; length from pressure and load |
//! | length sensor noisier than a muscle can move | as many jerks | the same |
//! | length sensor's code does not change while gas flows | for 60 such steps | the same |
//! | a length that the muscle cannot have: 5 % beyond its rest length, or below its shortest | for 10 ms | the same |
//! | link lost | no request of the host for `link.timeout_s` while the core is driven | vent, latched |
//! | missed steps | five close together, or more than one in twenty for longer | vent, latched |
//! | not configured | at the start of a board without a configuration | vent until it is configured |
//! | gas gained, burst, no inflow, no outflow, force | as in [`crate::safety::plausibility`] | vent, latched |
//! | leak | the same | shown for ten seconds |
//! | link flooded | the board drops requests | shown while it lasts |
//!
//! While the pressure is not trusted there is no estimate.
//!
//! A latched fault ends with [`Supervisor::clear`], and only when its cause is gone; a lost link also ends by arming
//! the core again. A venting fault disarms the core. Another configuration or another start of the core does not bypass
//! this: the supervisor outlives both, and after each of them the muscle vents for the 50 ms that the test of the
//! sensors takes.

use crate::config::Config;
use crate::math::is_above;
use crate::sample::{Faults, Sample};
use crate::sensing::{Readings, Validity};
use crate::step_counts::{StepCounts, timeout_steps};

/// Count that a missed step adds; each step takes 1 away.
const LATE_WEIGHT: u32 = 20;
/// Count from which a board is too late, five missed steps together, and the highest count.
const TOO_LATE: u32 = 5 * LATE_WEIGHT;
const LATEST: u32 = 2 * TOO_LATE;

/// Faults that vent and stay latched.
const LATCHING: Faults = Faults::EMERGENCY_STOP
    .with(Faults::PRESSURE_SENSOR)
    .with(Faults::OVERPRESSURE)
    .with(Faults::LINK_LOST)
    .with(Faults::MISSED_STEPS)
    .with(Faults::GAS_GAINED)
    .with(Faults::BURST)
    .with(Faults::NO_INFLOW)
    .with(Faults::NO_OUTFLOW)
    .with(Faults::FORCE)
    .with(Faults::GAS_LOST);
/// Faults that vent.
pub const VENTING: Faults = LATCHING.with(Faults::NOT_CONFIGURED);

/// The first fault that vented, and the faults present with it.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FirstFailure {
    /// Every fault of that step, including those that are only shown.
    pub faults: Faults,
    /// Absolute pressure read in that step \[Pa\].
    pub pressure_pa: f32,
    /// Number of that step.
    pub step: u32,
}

/// State of the core when a step's inputs are checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Activity {
    /// Whether the set point is anything but venting.
    pub driven: bool,
    /// Number of the step.
    pub step: u32,
    /// Faults that the plausibility monitor has found.
    pub found: Faults,
    /// Whether the length is one that the muscle cannot have.
    pub impossible_length: bool,
}

/// Inputs of a step that describe the board itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BoardState {
    /// Whether the run line is open or low.
    pub emergency_stop: bool,
    /// Whether a request of the host has come since the step before.
    pub heard: bool,
    /// Whether the host sends more requests than the board carries out.
    pub flooded: bool,
    /// Steps that were left out before this one.
    pub missed_steps: u8,
}

impl From<&Sample> for BoardState {
    fn from(sample: &Sample) -> Self {
        let Sample { emergency_stop, heard, flooded, missed_steps, .. } = *sample;
        Self { emergency_stop, heard, flooded, missed_steps }
    }
}

/// Limits that follow from the configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Limits {
    pressure_pa: f32,
    counts: StepCounts,
    /// Steps of silence after which the link is lost; `None`: it is never lost.
    silent_steps: Option<u32>,
    configured: bool,
    /// Whether the gas sensor is a digital part.
    digital_gas: bool,
}

/// State of the supervisor, which decides what the core may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// Startup check: the core vents and tests the sensors.
    StartupCheck {
        /// Steps of the check that are left, at least 1.
        left_steps: u16,
        /// Venting faults so far, including those from before a restart.
        causes: Faults,
    },
    /// No fault vents: the set point is followed.
    Ready,
    /// The core vents.
    Venting {
        /// The venting faults, at least one.
        causes: Faults,
    },
}

impl State {
    /// The state after the startup check.
    fn after_check(causes: Faults) -> Self {
        if causes == Faults::NONE { Self::Ready } else { Self::Venting { causes } }
    }

    /// Faults for which the core vents.
    pub fn causes(self) -> Faults {
        match self {
            Self::StartupCheck { causes, .. } | Self::Venting { causes } => causes,
            Self::Ready => Faults::NONE,
        }
    }

    /// The same state with other venting faults.
    fn with_causes(self, causes: Faults) -> Self {
        match self {
            Self::StartupCheck { left_steps, .. } => Self::StartupCheck { left_steps, causes },
            Self::Ready | Self::Venting { .. } => Self::after_check(causes),
        }
    }

    /// The state after one more step, with these venting faults.
    fn next(self, causes: Faults) -> Self {
        match self {
            Self::StartupCheck { left_steps, .. } if left_steps > 1 => {
                Self::StartupCheck { left_steps: left_steps - 1, causes }
            }
            _ => Self::after_check(causes),
        }
    }
}

/// Monitors the inputs and decides whether the core must vent.
///
/// The fields of every step come first, within reach of a Cortex-M0+'s short load.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Supervisor {
    state: State,
    /// Faults of the last step.
    present: Faults,
    silent_steps: u32,
    overpressure_steps: u32,
    impossible_length_steps: u32,
    late: u32,
    pressure_trusted: bool,
    limits: Limits,
    first: Option<FirstFailure>,
}

impl Supervisor {
    /// Creates a supervisor without any step; `configured`: whether the board has a configuration that was set.
    ///
    /// ```
    /// use model_core::safety::supervisor::Supervisor;
    /// use model_core::{Config, Faults};
    ///
    /// let board = Supervisor::new(&Config::default(), false);
    /// assert_eq!(board.venting(), Faults::NOT_CONFIGURED);
    /// ```
    pub fn new(config: &Config, configured: bool) -> Self {
        let counts = StepCounts::new(config.step_s);
        let timeout_s = config.link.timeout_s;
        let silent_steps = (timeout_s > 0.0).then(|| timeout_steps(timeout_s, config.step_s));
        let digital_gas = config.sensors.gas_element.is_digital();
        let present = Faults::NOT_CONFIGURED.when(!configured);
        Self {
            limits: Limits {
                pressure_pa: config.pressure_limit_pa,
                counts,
                silent_steps,
                configured,
                digital_gas,
            },
            state: State::StartupCheck { left_steps: counts.startup_steps, causes: present },
            present,
            first: None,
            pressure_trusted: false,
            overpressure_steps: 0,
            impossible_length_steps: 0,
            silent_steps: 0,
            late: 0,
        }
    }

    /// Returns the supervisor after the core restarts with the supervisor `other`; it keeps all counts and latched
    /// faults, and the startup check begins again.
    pub fn after_restart(&self, other: &Self) -> Self {
        let causes = self.latched().with(other.state.causes());
        Self {
            limits: other.limits,
            state: other.state.with_causes(causes),
            present: self.present.of(LATCHING).with(other.present),
            silent_steps: 0,
            ..*self
        }
    }

    /// Takes over the faults that were latched before the board restarted.
    pub fn recall(&mut self, first: FirstFailure, latched: Faults) {
        self.first = Some(first);
        let causes = self.venting().with(latched.of(LATCHING));
        self.state = self.state.with_causes(causes);
    }

    /// The state after the last step, or after a call that changed it since.
    pub fn state(&self) -> State {
        self.state
    }

    /// The first failure since faults were last cleared, or the last one before that.
    pub fn first_failure(&self) -> Option<FirstFailure> {
        self.first
    }

    /// Faults that stay until they are cleared.
    pub fn latched(&self) -> Faults {
        self.venting().of(LATCHING)
    }

    /// Checks the inputs of one step; returns the faults that are present or latched.
    pub fn step(&mut self, board: &BoardState, readings: &Readings, activity: Activity) -> Faults {
        let Activity { driven, step, found, impossible_length } = activity;
        let Readings { pressure, length, gas } = readings;
        let count =
            |condition: bool, steps: u32| if condition { steps.saturating_add(1) } else { 0 };
        self.overpressure_steps =
            count(is_above(pressure.value, self.limits.pressure_pa), self.overpressure_steps);
        self.impossible_length_steps = count(impossible_length, self.impossible_length_steps);
        self.silent_steps = count(driven && !board.heard, self.silent_steps);
        let missed = u32::from(board.missed_steps).saturating_mul(LATE_WEIGHT);
        self.late = self.late.saturating_sub(1).saturating_add(missed).min(LATEST);
        self.pressure_trusted = pressure.validity == Validity::Valid;
        let Limits { counts: StepCounts { patience_steps, .. }, silent_steps, .. } = self.limits;
        let patience_steps = u32::from(patience_steps);
        let length_lost =
            length.validity != Validity::Valid || self.impossible_length_steps >= patience_steps;
        let present = found
            .with(Faults::EMERGENCY_STOP.when(board.emergency_stop))
            .with(Faults::PRESSURE_SENSOR.when(pressure.validity == Validity::Lost))
            .with(Faults::OVERPRESSURE.when(self.overpressure_steps >= patience_steps))
            .with(Faults::GAS_SENSOR.when(*gas != Validity::Valid))
            .with(Faults::GAS_LOST.when(self.limits.digital_gas && *gas == Validity::Lost))
            .with(Faults::LENGTH_SENSOR.when(length_lost))
            .with(
                Faults::LINK_LOST
                    .when(silent_steps.is_some_and(|steps| self.silent_steps >= steps)),
            )
            .with(Faults::MISSED_STEPS.when(self.late >= TOO_LATE))
            .with(Faults::NOT_CONFIGURED.when(!self.limits.configured))
            .with(Faults::LINK_FLOODED.when(board.flooded));
        self.present = present;
        if matches!(self.state, State::Ready) && !present.intersects(VENTING) {
            return present;
        }
        self.change_state(FirstFailure { faults: present, pressure_pa: pressure.value, step })
    }

    /// Takes a step's faults in a state other than [`State::Ready`], or on leaving it; returns the faults that are
    /// present or latched.
    #[inline(never)] // Most steps do without it.
    fn change_state(&mut self, now: FirstFailure) -> Faults {
        let latched = self.latched();
        if latched == Faults::NONE && now.faults.intersects(LATCHING) {
            self.first = Some(now);
        }
        self.state = self.state.next(latched.with(now.faults.of(VENTING)));
        self.faults()
    }

    /// Faults that are present or latched.
    pub fn faults(&self) -> Faults {
        self.venting().with(self.present)
    }

    /// Whether the pressure of the last step is trusted.
    pub fn pressure_trusted(&self) -> bool {
        self.pressure_trusted
    }

    /// Faults for which the muscle must vent.
    pub fn venting(&self) -> Faults {
        self.state.causes()
    }

    /// Absolute pressure above which the muscle vents \[Pa\].
    pub fn limit_pa(&self) -> f32 {
        self.limits.pressure_pa
    }

    /// Sets the absolute pressure above which the muscle vents \[Pa\].
    pub fn limit_to(&mut self, pressure_pa: f32) {
        self.limits.pressure_pa = pressure_pa;
    }

    /// Venting faults, except that of a host that was silent and no longer is.
    pub fn venting_beside_link(&self) -> Faults {
        self.venting().without(Faults::LINK_LOST.without(self.present))
    }

    /// Forgets that the host was silent, if it no longer is.
    pub fn forget_link(&mut self) {
        self.state = self.state.with_causes(self.venting_beside_link());
    }

    /// Forgets the latched faults whose cause is gone.
    pub fn clear(&mut self) {
        self.state = self.state.with_causes(self.present.of(VENTING));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::LinkConfig;
    use crate::sample::{AdcCode, CODE_MAX};
    use crate::sensing::{FROZEN_CODES, Sensing};
    use core::ops::{Deref, DerefMut};

    const PATIENCE_STEPS: u16 = 10;
    const STARTUP_STEPS: u16 = 50;

    const HEALTHY: Sample = Sample::new(AdcCode(10_000), AdcCode(16_000), AdcCode(20_000));
    const IDLE: Activity =
        Activity { driven: false, step: 0, found: Faults::NONE, impossible_length: false };

    /// A supervisor with the sensing before it.
    #[derive(Clone, Copy)]
    struct Bench {
        sensing: Sensing,
        supervisor: Supervisor,
        flowing: bool,
    }

    impl Bench {
        fn new(config: &Config) -> Self {
            Self {
                sensing: config.sensing(),
                supervisor: Supervisor::new(config, true),
                flowing: false,
            }
        }

        /// Runs a step with this sample, but another pressure.
        fn step(&mut self, sample: &Sample, pressure_pa: f32, activity: Activity) -> Faults {
            let mut readings = self.sensing.read(sample, self.flowing);
            readings.pressure.value = pressure_pa;
            self.supervisor.step(&sample.into(), &readings, activity)
        }

        fn after_restart(&self, config: &Config) -> Self {
            let other = Self::new(config);
            Self {
                sensing: self.sensing.after_restart(&other.sensing),
                supervisor: self.supervisor.after_restart(&other.supervisor),
                flowing: false,
            }
        }
    }

    impl Deref for Bench {
        type Target = Supervisor;

        fn deref(&self) -> &Supervisor {
            &self.supervisor
        }
    }

    impl DerefMut for Bench {
        fn deref_mut(&mut self) -> &mut Supervisor {
            &mut self.supervisor
        }
    }

    /// A bench whose sensors have passed the startup check.
    fn checked() -> Bench {
        let mut supervisor = Bench::new(&Config::default());
        for _ in 0..STARTUP_STEPS {
            supervisor.step(&HEALTHY, 2.0e5, IDLE);
        }
        supervisor
    }

    fn must_vent(supervisor: &Supervisor) -> bool {
        supervisor.venting() != Faults::NONE
    }

    #[test]
    fn a_silent_host_vents_only_what_it_drives() {
        let silent = Sample { heard: false, ..HEALTHY };
        let mut supervisor = checked();
        for _ in 0..1000 {
            assert_eq!(supervisor.step(&silent, 2.0e5, IDLE), Faults::NONE, "nothing is driven");
        }
        let driven = Activity { driven: true, ..IDLE };
        for _ in 1..500 {
            assert_eq!(supervisor.step(&silent, 2.0e5, driven), Faults::NONE);
        }
        assert_eq!(supervisor.step(&HEALTHY, 2.0e5, driven), Faults::NONE, "in the last moment");
        for _ in 1..500 {
            supervisor.step(&silent, 2.0e5, driven);
        }
        assert_eq!(supervisor.step(&silent, 2.0e5, driven), Faults::LINK_LOST);
        supervisor.step(&HEALTHY, 2.0e5, IDLE);
        assert!(must_vent(&supervisor), "latched");
        supervisor.clear();
        assert!(!must_vent(&supervisor));

        let autonomous = Config { link: LinkConfig { timeout_s: 0.0 }, ..Config::default() };
        let mut supervisor = Bench::new(&autonomous);
        for _ in 0..10_000 {
            assert_eq!(supervisor.step(&silent, 2.0e5, driven), Faults::NONE);
        }
    }

    #[test]
    fn missed_steps_vent_when_they_come_together() {
        let late = |missed_steps| Sample { missed_steps, ..HEALTHY };
        let mut supervisor = checked();
        assert_eq!(supervisor.step(&late(4), 2.0e5, IDLE), Faults::NONE, "once");
        for _ in 0..80 {
            supervisor.step(&HEALTHY, 2.0e5, IDLE);
        }
        assert_eq!(supervisor.step(&late(4), 2.0e5, IDLE), Faults::NONE, "and again, later");
        assert_eq!(supervisor.step(&late(1), 2.0e5, IDLE), Faults::NONE, "99 of 100");
        assert_eq!(supervisor.step(&late(1), 2.0e5, IDLE), Faults::MISSED_STEPS);
        let mut supervisor = checked();
        assert_eq!(supervisor.step(&late(5), 2.0e5, IDLE), Faults::MISSED_STEPS);
        assert_eq!(supervisor.step(&late(255), 2.0e5, IDLE), Faults::MISSED_STEPS, "no overflow");
    }

    #[test]
    fn the_first_failure_is_kept() {
        let mut supervisor = checked();
        let at = |step| Activity { step, ..IDLE };
        supervisor.step(&Sample { gas: AdcCode(0).into(), ..HEALTHY }, 2.0e5, at(1));
        assert_eq!(supervisor.first_failure(), None, "it vents nothing");
        let stopped = Sample { emergency_stop: true, gas: AdcCode(0).into(), ..HEALTHY };
        supervisor.step(&stopped, 2.0e5, at(2));
        let first = FirstFailure {
            faults: Faults::EMERGENCY_STOP.with(Faults::GAS_SENSOR),
            pressure_pa: 2.0e5,
            step: 2,
        };
        assert_eq!(supervisor.first_failure(), Some(first));
        supervisor.step(&Sample { missed_steps: 9, ..HEALTHY }, 2.0e5, at(3));
        assert_eq!(supervisor.first_failure(), Some(first), "what follows is no cause");
        let mut after = checked();
        after.recall(first, supervisor.latched());
        after.step(&HEALTHY, 2.0e5, at(0));
        assert_eq!(after.venting(), Faults::EMERGENCY_STOP.with(Faults::MISSED_STEPS));
        assert_eq!(after.first_failure(), Some(first));
        after.clear();
        assert!(!must_vent(&after));
    }

    #[test]
    fn emergency_stop_latches_until_cleared() {
        let mut supervisor = checked();
        assert_eq!(supervisor.step(&HEALTHY, 2.0e5, IDLE), Faults::NONE);
        supervisor.step(&Sample { emergency_stop: true, ..HEALTHY }, 2.0e5, IDLE);
        assert!(must_vent(&supervisor));
        supervisor.clear();
        assert!(must_vent(&supervisor), "the line is still open");
        supervisor.step(&HEALTHY, 2.0e5, IDLE);
        assert!(must_vent(&supervisor), "latched");
        supervisor.clear();
        assert!(!must_vent(&supervisor));
    }

    #[test]
    fn pressure_faults_need_patience() {
        let mut supervisor = checked();
        let shorted = Sample { pressure: AdcCode(0).into(), ..HEALTHY };
        for _ in 1..PATIENCE_STEPS {
            supervisor.step(&shorted, 0.0, IDLE);
            assert!(!must_vent(&supervisor));
        }
        supervisor.step(&HEALTHY, 7.5e5, IDLE);
        assert!(!must_vent(&supervisor), "both counters start again");
        for _ in 1..PATIENCE_STEPS {
            supervisor.step(&HEALTHY, 7.5e5, IDLE);
        }
        assert_eq!(supervisor.faults(), Faults::OVERPRESSURE);
        assert!(must_vent(&supervisor));
    }

    /// Each lasts for less than the 10 ms that it needs alone: together they are noise.
    #[test]
    fn a_rail_and_an_overpressure_in_turns_vent_within_three_tenths_of_a_second() {
        for (rail_steps, over_steps) in
            (1..10).flat_map(|rail| (1..10).map(move |over| (rail, over)))
        {
            let mut supervisor = checked();
            let found = (0..300).find(|step| {
                let at_rail = step % (rail_steps + over_steps) < rail_steps;
                let (code, pressure_pa) = if at_rail { (0, -8.7e4) } else { (29_300, 6.9e5) };
                let sample = Sample { pressure: AdcCode(code).into(), ..HEALTHY };
                supervisor.step(&sample, pressure_pa, IDLE);
                must_vent(&supervisor)
            });
            assert!(found.is_some(), "{rail_steps} steps at a rail, {over_steps} above the limit");
        }
    }

    #[test]
    fn temperature_and_length_faults_only_show() {
        let mut supervisor = checked();
        let sample = Sample { gas: AdcCode(0).into(), length: AdcCode(32_760), ..HEALTHY };
        let faults = supervisor.step(&sample, 2.0e5, IDLE);
        assert_eq!(faults, Faults::GAS_SENSOR.with(Faults::LENGTH_SENSOR));
        assert!(!must_vent(&supervisor));
        assert_eq!(supervisor.step(&HEALTHY, 2.0e5, IDLE), Faults::NONE);
    }

    #[test]
    fn a_length_that_cannot_be_needs_patience_and_is_shown() {
        let mut supervisor = checked();
        let impossible = Activity { impossible_length: true, ..IDLE };
        for _ in 1..PATIENCE_STEPS {
            assert_eq!(supervisor.step(&HEALTHY, 2.0e5, impossible), Faults::NONE);
        }
        assert_eq!(supervisor.step(&HEALTHY, 2.0e5, impossible), Faults::LENGTH_SENSOR);
        assert!(!must_vent(&supervisor));
        assert_eq!(supervisor.step(&HEALTHY, 2.0e5, IDLE), Faults::NONE);
    }

    /// Runs this many steps with or without flowing gas; returns the faults after them.
    fn stand(supervisor: &mut Bench, sample: &Sample, steps: u16, flowing: bool) -> Faults {
        supervisor.flowing = flowing;
        for _ in 0..steps {
            supervisor.step(sample, 2.0e5, IDLE);
        }
        supervisor.faults()
    }

    #[test]
    fn a_frozen_pressure_vents_while_gas_flows() {
        let mut supervisor = checked();
        let moved = |by: u16| Sample {
            pressure: AdcCode(10_000 + by).into(),
            length: AdcCode(20_000 + by),
            ..HEALTHY
        };
        assert_eq!(stand(&mut supervisor, &HEALTHY, 200, false), Faults::NONE, "at rest");
        assert_eq!(stand(&mut supervisor, &HEALTHY, FROZEN_CODES - 1, true), Faults::NONE);
        assert_eq!(stand(&mut supervisor, &moved(1), FROZEN_CODES, true), Faults::NONE, "it moved");
        assert_eq!(stand(&mut supervisor, &moved(1), 200, false), Faults::NONE, "nothing flows");
        let both = Faults::PRESSURE_SENSOR.with(Faults::LENGTH_SENSOR);
        assert_eq!(stand(&mut supervisor, &moved(1), 1, true), both);
        assert!(must_vent(&supervisor));
        stand(&mut supervisor, &moved(1), 1, false);
        assert!(!supervisor.pressure_trusted(), "while it stands still");
        assert_eq!(stand(&mut supervisor, &moved(2), 1, false), Faults::PRESSURE_SENSOR, "latched");
        assert!(supervisor.pressure_trusted() && must_vent(&supervisor));
    }

    /// A large muscle fills so slowly that it takes longer than the limit to pass a code of nine LSB.
    #[test]
    fn a_wide_code_is_not_a_frozen_line() {
        let mut supervisor = checked();
        for step in 0..500 {
            let sample = Sample { pressure: AdcCode(12_288).into(), ..HEALTHY };
            let sample = Sample { length: AdcCode(20_000 + step % 2), ..sample };
            assert_eq!(stand(&mut supervisor, &sample, 1, true), Faults::NONE);
        }
    }

    /// A converter without the erratum has no such codes.
    #[test]
    fn without_wide_codes_every_code_that_stands_still_is_frozen() {
        let mut config = Config::default();
        config.sensors.adc.wide_code_lsb = 0.0;
        let mut supervisor = Bench::new(&config);
        let sample = Sample { pressure: AdcCode(12_288).into(), ..HEALTHY };
        let faults = stand(&mut supervisor, &sample, STARTUP_STEPS + FROZEN_CODES, true);
        assert!(faults.intersects(Faults::PRESSURE_SENSOR));
    }

    #[test]
    fn noise_differs_from_motion() {
        let mut supervisor = checked();
        let mut code = 5000_u16;
        for step in 0..500_u16 {
            // A fast fill and a fast vent, with the noise of a healthy channel.
            code = if step % 100 < 50 { code + 180 } else { code - 180 };
            let sample = Sample {
                pressure: AdcCode(code + step % 7).into(),
                length: AdcCode(30_000 - code),
                ..HEALTHY
            };
            assert_eq!(stand(&mut supervisor, &sample, 1, true), Faults::NONE);
        }
        for step in 0..40_u32 {
            let noise = (step * 7919 % 3000) as u16;
            let sample = Sample { length: AdcCode(20_000 + noise), ..HEALTHY };
            supervisor.step(&sample, 2.0e5, IDLE);
        }
        assert_eq!(supervisor.faults(), Faults::LENGTH_SENSOR);
        for step in 0..40_u32 {
            let noise = (step * 7919 % 3000) as u16;
            let sample = Sample { pressure: AdcCode(20_000 + noise).into(), ..HEALTHY };
            supervisor.step(&sample, 2.0e5, IDLE);
        }
        assert_eq!(supervisor.faults(), Faults::PRESSURE_SENSOR);
        assert!(!supervisor.pressure_trusted());
        for _ in 0..60 {
            supervisor.step(&HEALTHY, 2.0e5, IDLE);
        }
        assert!(supervisor.pressure_trusted() && must_vent(&supervisor));
    }

    /// To and fro by a share of the range at every step: the second difference is twice that.
    #[test]
    fn a_jerk_is_two_percent_of_the_range() {
        let faults_at = |percent: f32| {
            let swing = (f32::from(CODE_MAX) * percent / 100.0) as u16;
            let mut supervisor = checked();
            for step in 0..200 {
                let by = swing * (step % 2);
                let sample =
                    Sample::new(AdcCode(10_000 + by), AdcCode(16_000 + by), AdcCode(20_000 + by));
                supervisor.step(&sample, 2.0e5, IDLE);
            }
            supervisor.faults()
        };
        let every = Faults::PRESSURE_SENSOR.with(Faults::GAS_SENSOR).with(Faults::LENGTH_SENSOR);
        assert_eq!([0.95, 1.05].map(faults_at), [Faults::NONE, every]);
    }

    /// A board that was late for long counts as late for a hundred more steps, and no longer.
    #[test]
    fn lateness_is_forgotten_after_a_hundred_steps_in_time() {
        for (steps, late) in [(95, true), (105, false)] {
            let mut supervisor = checked();
            for _ in 0..10 {
                supervisor.step(&Sample { missed_steps: 255, ..HEALTHY }, 2.0e5, IDLE);
            }
            stand(&mut supervisor, &HEALTHY, steps, false);
            supervisor.clear();
            assert_eq!(must_vent(&supervisor), late, "after {steps} steps");
        }
    }

    /// A restart takes the limits of the new configuration, and restarts the host's time.
    #[test]
    fn a_restart_takes_the_new_limits() {
        let pressure_limit_pa = 3.0e5;
        let lower =
            Config { pressure_limit_pa, link: LinkConfig { timeout_s: 0.3 }, ..Config::default() };
        let restarted = checked().after_restart(&lower);
        let mut supervisor = restarted;
        for _ in 0..PATIENCE_STEPS {
            supervisor.step(&HEALTHY, 3.0e5, IDLE);
        }
        assert_eq!(supervisor.faults(), Faults::NONE, "at the limit");
        for _ in 0..PATIENCE_STEPS {
            supervisor.step(&HEALTHY, 3.01e5, IDLE);
        }
        assert_eq!(supervisor.faults(), Faults::OVERPRESSURE);
        let silent = Sample { heard: false, ..HEALTHY };
        let driven = Activity { driven: true, ..IDLE };
        let mut supervisor = restarted;
        for _ in 0..2 {
            for _ in 1..300 {
                assert_eq!(supervisor.step(&silent, 2.0e5, driven), Faults::NONE);
            }
            let again = supervisor.after_restart(&lower);
            assert_eq!(supervisor.step(&silent, 2.0e5, driven), Faults::LINK_LOST);
            supervisor = again;
        }
    }
}
