//! The core: one [`Sample`] in, one [`Telemetry`] with its [`Command`] out, once per fixed step.

use crate::config::{Config, Load};
use crate::control::{Controller, Feedback, SetPointError, SetPointField, Target};
use crate::estimation::{Estimator, LengthSource, Measurement, Openings};
use crate::math::limit;
use crate::parameter::ConfigError;
use crate::physics::chamber::{AnyChamber, Chamber};
use crate::safety::plausibility::PlausibilityMonitor;
use crate::safety::supervisor::{Activity, FirstFailure, State, Supervisor};
use crate::sample::{Command, Duty, Estimate, Faults, Mode, Sample, SetPoint, Telemetry};
use crate::sensing::{Reading, Readings, Sensing};

/// Model, estimator, controller and supervisor of one muscle.
///
/// The small fields come first, within reach of a Cortex-M0+'s short load.
#[derive(Debug, Clone, PartialEq)]
#[repr(C)]
pub struct Core {
    found: Faults,
    /// Absolute pressure of the last reading \[Pa\].
    pressure_pa: f32,
    command: Command,
    step: u32,
    /// Steps during which the inlet, and the outlet, may still pass gas after their last duty.
    inlet_steps: u16,
    outlet_steps: u16,
    /// Steps during which a valve may pass gas after a step that drives it.
    passing_steps: u16,
    /// Whether the last step's openings differ from those of the step before.
    turned: bool,
    /// Highest absolute pressure that set points may request \[Pa\]; `None`: not armed.
    armed_pa: Option<f32>,
    supervisor: Supervisor,
    sensing: Sensing,
    controller: Controller,
    monitor: PlausibilityMonitor,
    estimator: Estimator,
    chamber: AnyChamber,
    config: Config,
}

/// The faults of a step, and what follows from them.
struct Verdict {
    faults: Faults,
    state: State,
    /// Measured length, or the length that the load implies if its sensor is lost \[m\].
    length_m: f32,
    /// Half the width of the wide code in which a measured length lies \[m\].
    length_wide_m: f32,
    length_source: LengthSource,
}

/// The inputs of a step, read and checked.
pub(crate) struct Judged {
    readings: Readings,
    verdict: Verdict,
}

impl Judged {
    /// Faults that hold now or are latched.
    pub(crate) fn faults(&self) -> Faults {
        self.verdict.faults
    }

    /// Whether the startup check is over.
    pub(crate) fn is_checked(&self) -> bool {
        !matches!(self.verdict.state, State::StartupCheck { .. })
    }
}

/// The outputs of the controller, or of the startup check.
struct Action {
    command: Command,
    mode: Mode,
    limited: bool,
}

impl Core {
    /// Creates a core that vents until it has tested its sensors and has a set point. It is [armed](Self::arm), because
    /// a program that creates a core also drives it.
    ///
    /// ```
    /// use model_core::{Config, Core, SetPoint};
    ///
    /// let mut core = Core::new(&Config::default())?;
    /// core.set(SetPoint::Pressure { pressure_pa: 2.5e5 }).unwrap();
    /// assert!(Core::new(&Config { step_s: f32::NAN, ..Config::default() }).is_err());
    /// # Ok::<(), model_core::ConfigError>(())
    /// ```
    ///
    /// # Errors
    /// [`ConfigError`] as [`Config::check`].
    #[cold] // Once at a start: as small as can be.
    pub fn new(config: &Config) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self::of(config, true))
    }

    /// Creates a core from a checked configuration; `configured`: whether it was set on purpose and is not the default.
    #[cold]
    pub(crate) fn of(config: &Config, configured: bool) -> Self {
        Self {
            config: *config,
            chamber: AnyChamber::new(&config.chamber),
            sensing: config.sensing(),
            supervisor: Supervisor::new(config, configured),
            estimator: Estimator::new(config),
            controller: Controller::new(config),
            monitor: PlausibilityMonitor::new(config),
            found: Faults::NONE,
            pressure_pa: 0.0,
            command: Command::VENT,
            turned: false,
            inlet_steps: 0,
            outlet_steps: 0,
            passing_steps: config.passing_steps(),
            step: 0,
            armed_pa: configured.then(|| config.working_limit_pa()),
        }
    }

    /// Replaces this core in place by [`new`](Self::new) with another configuration.
    ///
    /// # Errors
    /// [`ConfigError`] as [`Config::check`]; the core is then unchanged.
    #[cold]
    pub fn become_new(&mut self, config: &Config) -> Result<(), ConfigError> {
        config.check()?;
        self.become_of(config);
        Ok(())
    }

    /// Whether the core runs with a configuration that was set, and not with the default one.
    pub fn is_configured(&self) -> bool {
        !self.supervisor.venting().intersects(Faults::NOT_CONFIGURED)
    }

    /// Becomes [`of`](Self::of) in place and part by part: a board's stack has no room for a second core.
    #[cold]
    pub(crate) fn become_of(&mut self, config: &Config) {
        self.estimator = Estimator::new(config);
        self.chamber = AnyChamber::new(&config.chamber);
        self.controller = Controller::new(config);
        self.monitor = PlausibilityMonitor::new(config);
        self.supervisor = Supervisor::new(config, true);
        self.sensing = config.sensing();
        self.config = *config;
        self.found = Faults::NONE;
        self.pressure_pa = 0.0;
        self.command = Command::VENT;
        self.turned = false;
        (self.inlet_steps, self.outlet_steps) = (0, 0);
        self.passing_steps = config.passing_steps();
        self.step = 0;
        self.armed_pa = Some(config.working_limit_pa());
    }

    /// Delays the estimator's intervals from now on: see [`Estimator::delay`].
    pub(crate) fn delay_estimator(&mut self) {
        self.estimator.delay();
    }

    /// Creates the core of a board without a configuration. It has the default one and vents until it is
    /// [restarted](Self::restart_as) with a configuration and armed.
    ///
    /// ```
    /// use model_core::{Core, Sample, SetPoint};
    ///
    /// let mut core = Core::unconfigured()?;
    /// core.step(&Sample::default());
    /// assert!(core.set(SetPoint::Pressure { pressure_pa: 2.5e5 }).is_err());
    /// # Ok::<(), model_core::ConfigError>(())
    /// ```
    ///
    /// # Errors
    /// None: the default configuration holds.
    pub fn unconfigured() -> Result<Self, ConfigError> {
        let config = Config::default();
        config.check()?;
        Ok(Self::of(&config, false))
    }

    /// Restarts as `other`, with its configuration and, if the core is armed, its set point. The supervisor stays:
    /// latched faults and those found in the last step are latched, its counters keep their values, and the startup
    /// check begins again. The arming stays too, as far as the new configuration allows.
    pub fn restart_as(&mut self, other: &Self) {
        // Part by part: a board's stack has no room for another core.
        self.estimator = other.estimator;
        self.chamber = other.chamber;
        self.controller = other.controller;
        self.monitor = other.monitor;
        self.supervisor = self.supervisor.after_restart(&other.supervisor);
        self.sensing = self.sensing.after_restart(&other.sensing);
        self.config = other.config;
        self.command = other.command;
        self.turned = other.turned;
        self.outlet_steps = other.outlet_steps;
        self.passing_steps = other.passing_steps;
        self.step = other.step;
        let most_pa = self.config.working_limit_pa();
        self.set_armed(self.armed_pa.map(|armed_pa| limit(armed_pa, 0.0, most_pa)));
        if self.armed_pa.is_none() {
            self.controller.set(Target::VENT);
        }
    }

    /// Accepts set points from now on, up to this absolute pressure \[Pa\]; a little above it the muscle vents. `None`:
    /// up to the configured maximum. A lost link is forgotten. The core vents until there is a set point.
    ///
    /// # Errors
    /// [`SetPointError`] for a pressure below the muscle's present one or above the configured maximum, and while
    /// faults vent; the arming is then unchanged.
    pub fn arm(&mut self, most_pa: Option<f32>) -> Result<(), SetPointError> {
        let armed_pa = self.may_arm(most_pa)?;
        self.supervisor.forget_link();
        self.controller.set(Target::VENT);
        self.set_armed(Some(armed_pa));
        Ok(())
    }

    /// Returns the pressure that [`arm`](Self::arm) would arm for, or its error.
    pub(crate) fn may_arm(&self, most_pa: Option<f32>) -> Result<f32, SetPointError> {
        let maximum = self.config.working_limit_pa();
        let value = most_pa.unwrap_or(maximum);
        let minimum = self.config.ambient.pressure_pa.max(self.pressure_pa);
        // NaN fails both.
        if !(value >= minimum && value <= maximum) {
            return Err(SetPointError::Range {
                field: SetPointField::Armed,
                value,
                minimum,
                maximum,
            });
        }
        match self.supervisor.venting_beside_link() {
            Faults::NONE => Ok(value),
            venting => Err(SetPointError::Faults(venting)),
        }
    }

    /// Vents, and takes no set point until it is [armed](Self::arm).
    pub fn disarm(&mut self) {
        self.vent();
        self.set_armed(None);
    }

    /// Highest absolute pressure that set points may request \[Pa\]; `None`: the core is not armed.
    pub fn armed_pa(&self) -> Option<f32> {
        self.armed_pa
    }

    /// Returns the pressure that the core is armed for, if a value \[Pa\] is above it; `None` if the core is armed for
    /// all that its configuration allows.
    pub(crate) fn armed_below(&self, value: f32) -> Option<f32> {
        let working_pa = self.config.working_limit_pa();
        self.armed_pa.filter(|armed_pa| value > *armed_pa && *armed_pa < working_pa)
    }

    fn set_armed(&mut self, armed_pa: Option<f32>) {
        let config = &self.config;
        let working_pa = config.working_limit_pa();
        let (most_pa, limit_pa) = match armed_pa {
            Some(armed_pa) if armed_pa < working_pa => {
                (armed_pa, armed_pa + config.pressure_margin_pa())
            }
            _ => (working_pa, config.pressure_limit_pa),
        };
        self.armed_pa = armed_pa;
        self.controller.limit_to(most_pa);
        self.supervisor.limit_to(limit_pa);
    }

    /// The configuration that the core runs with.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The supervisor, with the faults that it has latched.
    pub fn supervisor(&self) -> &Supervisor {
        &self.supervisor
    }

    /// Takes over the faults that were latched before the board restarted.
    pub fn recall(&mut self, first: FirstFailure, latched: Faults) {
        self.supervisor.recall(first, latched);
    }

    /// Changes the set point, from the next PWM period on; venting starts with the next step.
    ///
    /// # Errors
    /// [`SetPointError`] for a value that is not a number or out of its range, and for any set point but venting while
    /// faults vent or the core is not armed; the set point before then stays.
    pub fn set(&mut self, set_point: SetPoint) -> Result<(), SetPointError> {
        let target = Target::new(&set_point, &self.config, &self.chamber)?;
        let venting = self.supervisor.venting();
        if target != Target::VENT && venting != Faults::NONE {
            return Err(SetPointError::Faults(venting));
        }
        if set_point != SetPoint::Vent && self.armed_pa.is_none() {
            return Err(SetPointError::NotArmed);
        }
        if let SetPoint::Pressure { pressure_pa: value } = set_point
            && let Some(maximum) = self.armed_below(value)
        {
            let field = SetPointField::Pressure;
            return Err(SetPointError::Range { field, value, minimum: 0.0, maximum });
        }
        self.controller.set(target);
        Ok(())
    }

    /// The set point.
    pub fn set_point(&self) -> SetPoint {
        self.controller.target().set_point()
    }

    /// Vents, from the next step on, as [`SetPoint::Vent`] does.
    pub fn vent(&mut self) {
        self.controller.set(Target::VENT);
    }

    /// Forgets latched faults whose cause is gone. The set point falls back to venting: acknowledging a fault must not
    /// move anything.
    pub fn clear_faults(&mut self) {
        self.supervisor.clear();
        self.controller.set(Target::VENT);
    }

    /// Runs one step. During the startup check ([`Mode::StartupCheck`]) the core vents, and neither estimates nor
    /// counts steps: step 0 is the first after the check.
    pub fn step(&mut self, sample: &Sample) -> Telemetry {
        let judged = self.begin(sample, None);
        let command = self.openings(sample, &judged);
        self.end(sample, &judged, command)
    }

    /// Reads and checks the inputs of a step. `length`: the length \[m\] and half the width of its code \[m\] if a
    /// mechanism measures them; the sample's code, read as a length sensor's, then only shows whether its channel is
    /// healthy.
    #[inline]
    pub(crate) fn begin(&mut self, sample: &Sample, length: Option<(f32, f32)>) -> Judged {
        let mut readings = self.sense(sample);
        if let Some((value, wide)) = length {
            readings.length = Reading { value, wide, ..readings.length };
        }
        let verdict = self.supervise(sample, &readings);
        Judged { readings, verdict }
    }

    /// Returns the openings that the core's own controller requests in this step.
    #[inline]
    pub(crate) fn openings(&mut self, sample: &Sample, judged: &Judged) -> Command {
        match judged.verdict.state {
            State::StartupCheck { .. } => Command::VENT,
            State::Ready | State::Venting { .. } => self.control(sample, &judged.verdict),
        }
    }

    /// Ends a step in which the valves have these openings.
    #[inline]
    pub(crate) fn end(&mut self, sample: &Sample, judged: &Judged, command: Command) -> Telemetry {
        let Judged { readings, verdict } = judged;
        if let State::StartupCheck { .. } = verdict.state {
            self.follow(Command::VENT);
            let mode = Mode::StartupCheck;
            let action = Action { command: Command::VENT, mode, limited: false };
            return self.report(sample, verdict, action);
        }
        let implausible = self.estimate(sample, readings, verdict, command);
        self.follow(command);
        let faults = verdict.faults.with(implausible);
        let (mode, limited) = (self.controller.mode(), self.controller.limited());
        let action = Action { command, mode, limited };
        let telemetry = self.report(sample, &Verdict { faults, ..*verdict }, action);
        self.step = self.step.wrapping_add(1);
        telemetry
    }

    /// The muscle's chamber.
    pub(crate) fn chamber(&self) -> &AnyChamber {
        &self.chamber
    }

    /// Whether the step under way began a PWM period.
    pub(crate) fn begins_period(&self) -> bool {
        self.controller.worked()
    }

    /// Whether the step under way is the last one of a PWM period.
    pub(crate) fn ends_period(&self) -> bool {
        self.controller.ends_period()
    }

    /// Number of the step under way.
    pub(crate) fn steps(&self) -> u32 {
        self.step
    }

    /// Inputs of a mechanism's controller in this step.
    pub(crate) fn measured(&self, judged: &Judged) -> Feedback {
        self.feedback(&judged.verdict)
    }

    fn feedback(&self, verdict: &Verdict) -> Feedback {
        Feedback {
            pressure_pa: self.pressure_pa,
            length_m: verdict.length_m,
            length_wide_m: verdict.length_wide_m,
            length_lost: verdict.length_source != LengthSource::Sensor,
            estimate: self.estimator.estimate(),
        }
    }

    /// Converts the raw codes to readings.
    fn sense(&mut self, sample: &Sample) -> Readings {
        // A set point lets gas out of a muscle that is not empty.
        let let_out = self.controller.driven()
            && matches!(self.supervisor.state(), State::Ready)
            && self.command.outlet > Duty::ZERO
            && self.monitor.has_gas(self.pressure_pa);
        let readings = self.sensing.read(sample, self.inlet_steps > 0 || let_out);
        self.pressure_pa = readings.pressure.value;
        readings
    }

    /// Finds the faults of this step and derives the state, the length and its source from them.
    fn supervise(&mut self, sample: &Sample, readings: &Readings) -> Verdict {
        let read_m = readings.length.value;
        let found = core::mem::replace(&mut self.found, Faults::NONE);
        let activity = Activity {
            driven: self.controller.driven(),
            step: self.step,
            found: found.with(Faults::LEAK.when(self.monitor.leaks())),
            impossible_length: !self.chamber.can_have_length_m(read_m),
        };
        let faults = self.supervisor.step(&sample.into(), readings, activity);
        let (length_m, length_source) = self.length_m(read_m, self.pressure_pa, faults);
        // Also during the startup check: a waiting set point is dropped like one that drives.
        let state = self.supervisor.state();
        if let State::StartupCheck { causes, .. } | State::Venting { causes } = state
            && causes != Faults::NONE
        {
            self.controller.set(Target::VENT);
            if self.armed_pa.is_some() {
                self.set_armed(None);
            }
        }
        let measured = length_source == LengthSource::Sensor;
        let length_wide_m = if measured { readings.length.wide } else { 0.0 };
        Verdict { faults, state, length_m, length_wide_m, length_source }
    }

    /// Returns the openings of this step.
    fn control(&mut self, sample: &Sample, verdict: &Verdict) -> Command {
        let feedback = self.feedback(verdict);
        // While venting too: the controller counts the PWM periods, which continue in the hardware.
        let wanted =
            self.controller.step(&self.config, &self.chamber, &feedback, sample.missed_steps);
        if matches!(verdict.state, State::Ready) { wanted } else { Command::VENT }
    }

    /// Feeds the estimator and the plausibility monitor; returns the gas sensor's fault if its readings contradict the
    /// model.
    fn estimate(
        &mut self,
        sample: &Sample,
        readings: &Readings,
        verdict: &Verdict,
        command: Command,
    ) -> Faults {
        let Verdict { faults, length_m, length_source, .. } = *verdict;
        let turned = core::mem::replace(&mut self.turned, command.turns(self.command));
        let gas_lost = faults.intersects(Faults::GAS_SENSOR);
        if !gas_lost {
            self.sensing.add_gas(sample.gas);
        }
        let gas = if self.estimator.ends_interval() {
            self.sensing.take_gas()
        } else if self.estimator.starts() && !gas_lost {
            self.sensing.last_gas()
        } else {
            None
        };
        // The sample shows the gas that passed the openings of the step before.
        let measurement = Measurement {
            pressure: self.supervisor.pressure_trusted().then_some(readings.pressure),
            length: Reading { value: length_m, ..readings.length },
            length_source,
            gas,
            busy: self.controller.worked(),
            openings: Openings {
                turned,
                driven: self.command.inlet > Duty::ZERO || self.command.outlet > Duty::ZERO,
                charging: self.inlet_steps > 0,
                discharging: self.outlet_steps > 0,
            },
        };
        self.estimator.step(&self.chamber, &measurement);
        if let Some(balance) = self.estimator.take_balance() {
            let length_m = (!faults.intersects(Faults::LENGTH_SENSOR)).then_some(length_m);
            self.found = self.monitor.add(&self.chamber, &balance, length_m);
        }
        Faults::GAS_SENSOR.when(self.estimator.sensor_implausible())
    }

    fn report(&self, sample: &Sample, verdict: &Verdict, action: Action) -> Telemetry {
        let estimate = self.estimator.estimate();
        // Its balance accounts for no leak but the configured one.
        let valid = estimate.valid && !verdict.faults.intersects(Faults::LEAK);
        Telemetry {
            step: self.step,
            sample: *sample,
            pressure_pa: self.pressure_pa,
            length_m: verdict.length_m,
            estimate: Estimate { valid, ..estimate },
            command: action.command,
            mode: action.mode,
            limited: action.limited,
            set_point: self.set_point(),
            faults: verdict.faults,
        }
    }

    /// Records these openings as those of this step.
    fn follow(&mut self, command: Command) {
        let passing_steps = self.passing_steps;
        let passing = |duty: Duty, steps: u16| {
            if duty > Duty::ZERO { passing_steps } else { steps.saturating_sub(1) }
        };
        self.monitor.drive(command);
        self.inlet_steps = passing(command.inlet, self.inlet_steps);
        self.outlet_steps = passing(command.outlet, self.outlet_steps);
        self.command = command;
    }

    /// Measured length; without its sensor the contraction loop's reference, or the length at which the load balances.
    fn length_m(&self, read_m: f32, pressure_pa: f32, faults: Faults) -> (f32, LengthSource) {
        if !faults.intersects(Faults::LENGTH_SENSOR) {
            return (self.chamber.limit_length_m(read_m), LengthSource::Sensor);
        }
        let balance_m = match self.config.load {
            Load::Isometric { length_m } => self.chamber.limit_length_m(length_m),
            Load::Isotonic { force_n } if self.chamber.moves() => {
                if let Some(reference_m) = self.controller.reference_m() {
                    return (reference_m, LengthSource::Reference);
                }
                let gauge_pa = pressure_pa - self.config.ambient.pressure_pa;
                self.chamber.length_for_force_m(gauge_pa, force_n)
            }
            Load::Isotonic { .. } => self.chamber.limit_length_m(read_m),
        };
        (balance_m, LengthSource::Balance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::LinkConfig;
    use crate::physics::chamber::{ChamberConfig, Vessel};
    use crate::sample::{AdcCode, RawCode};
    use crate::sensing::Sensors;
    use crate::sensing::gas::{GasElement, Max31865};

    const HEALTHY: Sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));

    const HALF: SetPoint = SetPoint::Duty { inlet: 0.5, outlet: 0.0 };

    /// A core with this set point.
    fn core_with(set_point: SetPoint) -> Core {
        let mut core = Core::new(&Config::default()).unwrap();
        core.set(set_point).unwrap();
        core
    }

    /// The first telemetry after the startup check.
    fn checked(core: &mut Core, sample: &Sample) -> Telemetry {
        core::iter::repeat_with(|| core.step(sample))
            .take(1000)
            .find(|telemetry| telemetry.mode != Mode::StartupCheck)
            .unwrap()
    }

    /// Nothing is global: two muscles stepped in turns behave like the same two one after the other.
    #[test]
    fn two_muscles_in_one_process_do_not_know_of_each_other() {
        let mut other = Config::default();
        other.ambient.temperature_k = 285.0;
        other.pwm_period_steps = 7;
        let cores = || {
            let cycle = SetPoint::MassFlowCycle { flow_kg_s: 3.6e-4, period_s: 0.4 };
            let mut others = Core::new(&other).unwrap();
            others.set(SetPoint::Pressure { pressure_pa: 2.5e5 }).unwrap();
            [core_with(cycle), others]
        };
        let sample = |core: usize, step: u16| {
            let pressure = 7770 + (step % 700) * if core == 0 { 3 } else { 5 };
            Sample { pressure: AdcCode(pressure).into(), ..HEALTHY }
        };
        let mut together = cores();
        let mut alternating = [Vec::new(), Vec::new()];
        for step in 0..2000 {
            for (i, core) in together.iter_mut().enumerate() {
                alternating[i].push(core.step(&sample(i, step)));
            }
        }
        for (i, mut core) in cores().into_iter().enumerate() {
            let alone: Vec<_> = (0..2000).map(|step| core.step(&sample(i, step))).collect();
            assert_eq!(alone, alternating[i], "muscle {i}");
        }
    }

    #[test]
    fn a_start_tests_the_sensors_before_it_counts() {
        let mut core = core_with(HALF);
        let in_check = (0..1000).map(|_| core.step(&HEALTHY)).take_while(|telemetry| {
            assert_eq!(telemetry.step, 0);
            let in_check = telemetry.mode == Mode::StartupCheck;
            assert_eq!(in_check, telemetry.command == Command::VENT);
            in_check
        });
        assert_eq!(in_check.count(), 49);
        assert_eq!(core.step(&HEALTHY).step, 1);
    }

    /// Starts in quick succession hide neither a short circuit nor a pressure above the limit.
    #[test]
    fn restarts_do_not_go_round_the_supervisor() {
        let shorted = Sample { pressure: AdcCode(0).into(), ..HEALTHY };
        let high = Sample { pressure: AdcCode(29_300).into(), ..HEALTHY };
        for (sample, fault) in [(shorted, Faults::PRESSURE_SENSOR), (high, Faults::OVERPRESSURE)] {
            for every in [1, 5, 9, 60] {
                let mut core = core_with(HALF);
                for step in 0..1000 {
                    if step % every == 0 {
                        core.restart_as(&core_with(HALF));
                    }
                    let telemetry = core.step(&sample);
                    assert_eq!(telemetry.command, Command::VENT, "step {step}, {fault:?}");
                    assert_eq!(telemetry.faults.intersects(fault), step >= 9, "step {step}");
                }
            }
        }
    }

    #[test]
    fn a_restart_with_healthy_sensors_vents_in_the_startup_check() {
        let mut core = core_with(HALF);
        for step in 0..1000 {
            if step % 9 == 0 {
                core.restart_as(&core_with(HALF));
            }
            assert_eq!(core.step(&HEALTHY).command, Command::VENT, "step {step}");
        }
    }

    #[test]
    fn latched_is_latched_whatever_is_started() {
        let mut core = core_with(HALF);
        checked(&mut core, &HEALTHY);
        core.step(&Sample { emergency_stop: true, ..HEALTHY });
        core.restart_as(&core_with(HALF));
        for _ in 0..200 {
            let telemetry = core.step(&HEALTHY);
            assert_eq!(telemetry.command, Command::VENT);
            assert_eq!(telemetry.faults, Faults::EMERGENCY_STOP);
        }
        core.clear_faults();
        core.restart_as(&core_with(HALF));
        assert_eq!(checked(&mut core, &HEALTHY).command, Command::VENT, "not armed");
        core.arm(None).unwrap();
        core.restart_as(&core_with(HALF));
        assert_ne!(checked(&mut core, &HEALTHY).command, Command::VENT);
    }

    /// A frozen code is found while gas is let out too, but not in a muscle that vents anyway.
    #[test]
    fn a_frozen_pressure_shows_while_gas_is_let_out() {
        let full = Sample { pressure: AdcCode(15_000).into(), ..HEALTHY };
        let first = |set_point| {
            let mut core = core_with(set_point);
            checked(&mut core, &full);
            let frozen = |core: &mut Core| {
                let telemetry = core.step(&Sample {
                    length: AdcCode(full.length.0 + core.step as u16 % 2),
                    ..full
                });
                telemetry.faults.intersects(Faults::PRESSURE_SENSOR)
            };
            (0..200).position(|_| frozen(&mut core))
        };
        let steps = first(SetPoint::Duty { inlet: 0.0, outlet: 0.3 }).unwrap();
        assert!((50..=60).contains(&steps), "{steps}");
        assert_eq!(first(SetPoint::Vent), None);
        assert_eq!(first(SetPoint::Duty { inlet: 0.0, outlet: 0.0 }), None);
    }

    #[test]
    fn a_fault_vents_at_once_and_leaves_the_period_in_phase() {
        let mut core = Core::new(&Config::default()).unwrap();
        core.set(HALF).unwrap();
        assert_ne!(checked(&mut core, &HEALTHY).command, Command::VENT);
        for _ in 1..4 {
            core.step(&HEALTHY);
        }
        let stopped = Sample { emergency_stop: true, ..HEALTHY };
        assert_eq!(core.step(&stopped).command, Command::VENT, "in the middle of a period");
        for _ in 5..17 {
            assert_eq!(core.step(&HEALTHY).command, Command::VENT, "latched");
        }
        core.clear_faults();
        core.arm(None).unwrap();
        core.set(HALF).unwrap();
        let commands = [17, 18, 19, 20].map(|_| core.step(&HEALTHY).command);
        assert_eq!(commands[..3], [Command::VENT; 3], "the period of step 10 goes on");
        assert_ne!(commands[3], Command::VENT, "step 20 begins a period");
    }

    const CLOSED: SetPoint = SetPoint::Duty { inlet: 0.0, outlet: 0.0 };

    const STOPPED: Sample = Sample { emergency_stop: true, ..HEALTHY };

    /// A muscle that fills as fast as it can, at the third step of a PWM period of this many.
    fn filling(pwm_period_steps: u16) -> Core {
        let link = LinkConfig { timeout_s: 0.02 };
        let config = Config { pwm_period_steps, link, ..Config::default() };
        let full = SetPoint::Duty { inlet: 1.0, outlet: 0.0 };
        let mut core = checked_core(&config, full, &HEALTHY);
        for _ in 0..3 {
            assert_eq!(core.step(&HEALTHY).command.inlet, Duty::FULL);
        }
        core
    }

    /// No request to vent, clear or arm leaves anything of the period's command: it would stay on the valve for 97 of
    /// the 100 steps of a period.
    #[test]
    fn no_acknowledgement_reopens_the_inlet() {
        type Request = fn(&mut Core);
        let requests: [(&str, Request); 7] = [
            ("clear after a stop", |core| {
                core.step(&STOPPED);
                core.step(&HEALTHY);
                core.clear_faults();
            }),
            ("clear", Core::clear_faults),
            ("arm after a lost link", |core| {
                let silent = Sample { heard: false, ..HEALTHY };
                for _ in 0..20 {
                    core.step(&silent);
                }
                assert_eq!(core.supervisor().latched(), Faults::LINK_LOST);
                core.step(&HEALTHY);
                core.arm(None).unwrap();
            }),
            ("arm for less", |core| core.arm(Some(2.0e5)).unwrap()),
            ("disarm", Core::disarm),
            ("vent", Core::vent),
            ("set to vent", |core| core.set(SetPoint::Vent).unwrap()),
        ];
        for pwm_period_steps in [10, 100, 1000] {
            for (name, request) in &requests {
                let mut core = filling(pwm_period_steps);
                request(&mut core);
                for step in 0..2 * pwm_period_steps {
                    let command = core.step(&HEALTHY).command;
                    assert_eq!(command, Command::VENT, "{name}: {step} of {pwm_period_steps}");
                }
                assert_eq!(core.set_point(), SetPoint::Vent, "{name}");
            }
        }
    }

    /// Nor does a set point from before the stop drive afterwards.
    #[test]
    fn a_fault_in_the_startup_check_disarms() {
        let config = Config::default();
        let mut core = checked_core(&config, HALF, &HEALTHY);
        core.restart_as(&core_with(HALF));
        for _ in 0..5 {
            let telemetry = core.step(&STOPPED);
            assert_eq!((telemetry.mode, telemetry.command), (Mode::StartupCheck, Command::VENT));
        }
        core.step(&HEALTHY);
        core.clear_faults();
        assert_eq!((core.armed_pa(), core.set_point()), (None, SetPoint::Vent));
        let refused = core.set(SetPoint::Pressure { pressure_pa: 2.0e5 });
        assert_eq!(refused, Err(SetPointError::NotArmed));
        for _ in 0..200 {
            assert_eq!(core.step(&HEALTHY).command, Command::VENT);
        }
    }

    /// A core with this configuration and set point whose sensors have passed the startup check with this sample.
    fn checked_core(config: &Config, set_point: SetPoint, sample: &Sample) -> Core {
        let mut core = Core::new(config).unwrap();
        core.set(set_point).unwrap();
        for _ in 1..50 {
            core.step(sample);
        }
        core
    }

    /// The openings that a sample has seen are those of the step before, and the gas that a pulse moves after its duty
    /// counts for one PWM period. An estimator with the same inputs set by hand agrees.
    #[test]
    fn the_estimator_gets_the_openings_that_a_sample_has_seen() {
        let start = Sample::new(AdcCode(11_538), AdcCode(16_200), AdcCode(20_500));
        let mut core = checked_core(&Config::default(), HALF, &start);
        let muscle = AnyChamber::new(&Config::default().chamber);
        let mut estimator = Estimator::new(&Config::default());
        let sensors = Sensors::default();
        let mut sensing = Config::default().sensing();
        let wide_pa = sensors.adc.half_width(sensors.pressure.resolution_pa());
        let wide_m = sensors.adc.half_width(sensors.length.resolution_m());
        for step in 0..300_u16 {
            // Each takes effect at the next multiple of ten.
            match step {
                95 | 195 => core.set(CLOSED).unwrap(),
                145 => core.set(SetPoint::Duty { inlet: 0.0, outlet: 0.5 }).unwrap(),
                _ => {}
            }
            // It fills, stops within a wide code, rests, and empties down to that code.
            let filled = 150 + step.min(50) + step.clamp(60, 100) - 60 - step.clamp(150, 190);
            let wide_length = (20..25).contains(&step);
            let (gas_lost, pressure_lost) = ((30..35).contains(&step), (70..73).contains(&step));
            let sample = Sample::new(
                AdcCode(if pressure_lost { 0 } else { 11_538 + 15 * filled }),
                AdcCode(if gas_lost { 0 } else { 16_200 + step }),
                AdcCode(if wide_length { 20_480 } else { 20_500 - step % 3 }),
            );
            let telemetry = core.step(&sample);
            if !gas_lost {
                sensing.add_gas(sample.gas);
            }
            estimator.step(
                &muscle,
                &Measurement {
                    pressure: (!pressure_lost).then_some(Reading {
                        wide: if (50..=60).contains(&step) || step >= 190 { wide_pa } else { 0.0 },
                        ..Reading::exact(telemetry.pressure_pa)
                    }),
                    length: Reading {
                        wide: if wide_length { wide_m } else { 0.0 },
                        ..Reading::exact(telemetry.length_m)
                    },
                    gas: match step {
                        0 => sensing.last_gas(),
                        _ if step % 40 == 39 => sensing.take_gas(),
                        _ => None,
                    },
                    length_source: LengthSource::Sensor,
                    busy: step % 10 == 0,
                    openings: Openings {
                        turned: [1, 101, 151, 201].contains(&step),
                        driven: (0..=100).contains(&step) || (151..=200).contains(&step),
                        charging: (1..=110).contains(&step),
                        discharging: (0..=10).contains(&step) || (151..=210).contains(&step),
                    },
                },
            );
            assert_eq!(telemetry.estimate, estimator.estimate(), "step {step}");
        }
    }

    /// A pulse counts as filling for the period after its duty: a code frozen for that long in all is one step short if
    /// the core vents 11 steps before the limit, and enough if it vents 10 before.
    #[test]
    fn a_code_that_stands_still_while_the_inlet_passes_gas_is_frozen() {
        let frozen_after = |driven_steps: u16| {
            let mut core = checked_core(&Config::default(), HALF, &HEALTHY);
            (0..200_u16).find(|&step| {
                if step == driven_steps {
                    core.vent();
                }
                core.step(&HEALTHY).faults.intersects(Faults::PRESSURE_SENSOR)
            })
        };
        let whole = crate::sensing::FROZEN_CODES;
        assert_eq!(frozen_after(200), Some(whole), "driven for long");
        assert_eq!(frozen_after(whole - 10), Some(whole), "the pulse's end included");
        assert_eq!(frozen_after(whole - 11), None, "one step less");
    }

    /// Nor does a restart forget a pulse that is still to end, here with a slow PWM.
    #[test]
    fn a_restart_does_not_forget_a_pulse_that_still_ends() {
        let config = Config { pwm_period_steps: 100, ..Config::default() };
        let mut core = checked_core(&config, HALF, &HEALTHY);
        for _ in 0..10 {
            core.step(&HEALTHY);
        }
        core.restart_as(&Core::new(&config).unwrap());
        let frozen = (10..500)
            .find(|_| core.step(&HEALTHY).faults.intersects(Faults::PRESSURE_SENSOR))
            .unwrap();
        assert_eq!(frozen, crate::sensing::FROZEN_CODES);
    }

    #[test]
    fn what_is_asked_to_vent_vents_in_the_middle_of_a_period() {
        let mut core = checked_core(&Config::default(), HALF, &HEALTHY);
        for _ in 0..3 {
            assert_ne!(core.step(&HEALTHY).command, Command::VENT);
        }
        core.vent();
        assert_eq!(core.step(&HEALTHY).command, Command::VENT);
        assert_eq!(core.step(&HEALTHY).mode, Mode::Vent);
    }

    #[test]
    fn while_a_fault_vents_nothing_else_is_taken() {
        let mut core = checked_core(&Config::default(), HALF, &HEALTHY);
        core.step(&Sample { emergency_stop: true, ..HEALTHY });
        let refused = Err(SetPointError::Faults(Faults::EMERGENCY_STOP));
        assert_eq!(core.set(HALF), refused);
        assert_eq!(core.set(SetPoint::Vent), Ok(()));
        core.clear_faults();
        assert_eq!(core.set(HALF), refused, "the line is still open");
        core.step(&HEALTHY);
        core.clear_faults();
        assert_eq!(core.step(&HEALTHY).command, Command::VENT, "nothing moves by itself");
        assert_eq!(core.set(HALF), Err(SetPointError::NotArmed));
        assert_eq!(core.arm(None), Ok(()));
        assert_eq!(core.set(HALF), Ok(()));
    }

    /// After a lost link, arming is enough; other faults stay latched.
    #[test]
    fn a_lost_link_is_forgotten_by_arming() {
        let mut core = checked_core(&Config::default(), CLOSED, &HEALTHY);
        let silent = Sample { heard: false, ..HEALTHY };
        while core.step(&silent).faults == Faults::NONE {}
        assert_eq!(core.armed_pa(), None);
        assert_eq!(core.set(CLOSED), Err(SetPointError::Faults(Faults::LINK_LOST)));
        core.step(&HEALTHY);
        assert_eq!(core.arm(None), Ok(()));
        assert_eq!(core.step(&HEALTHY).faults, Faults::NONE);
        assert_eq!(core.set(CLOSED), Ok(()));
        while core.step(&silent).faults == Faults::NONE {}
        core.step(&Sample { emergency_stop: true, ..HEALTHY });
        core.step(&HEALTHY);
        assert_eq!(core.arm(None), Err(SetPointError::Faults(Faults::EMERGENCY_STOP)));
        let both = Faults::EMERGENCY_STOP.with(Faults::LINK_LOST);
        assert_eq!(core.supervisor().venting(), both, "what is refused forgets nothing");
        assert_eq!(core.armed_pa(), None);
    }

    /// The muscle has 120.03 kPa in these samples.
    #[test]
    fn what_is_armed_takes_no_more_than_it_is_armed_for() {
        let config = Config::default();
        let mut core = checked_core(&config, SetPoint::Vent, &HEALTHY);
        let pressure = |pressure_pa| SetPoint::Pressure { pressure_pa };
        for most_pa in [f32::NAN, 1.1e5, 6.7e5] {
            assert!(core.arm(Some(most_pa)).is_err(), "{most_pa}");
            assert!(core.set(pressure(3.0e5)).is_ok(), "as armed as before");
        }
        core.arm(Some(2.0e5)).unwrap();
        assert_eq!(core.set_point(), SetPoint::Vent, "who arms moves nothing");
        assert_eq!(core.set(pressure(2.0e5)), Ok(()));
        let (field, value) = (SetPointField::Pressure, 2.1e5);
        let refused = SetPointError::Range { field, value, minimum: 0.0, maximum: 2.0e5 };
        assert_eq!(core.set(pressure(value)), Err(refused));
        // It vents 5 % of the gauge pressure above it, 29.4 kPa: 26.7 Pa per code.
        let above = |pa: f32| Sample {
            pressure: AdcCode(7770 + ((pa + 29_408.0 - 120_033.0) / 26.71) as u16).into(),
            ..HEALTHY
        };
        core.set(CLOSED).unwrap();
        for (most_pa, faults) in [(1.97e5, Faults::NONE), (2.03e5, Faults::OVERPRESSURE)] {
            let found = (0..12).map(|_| core.step(&above(most_pa)).faults).last().unwrap();
            assert_eq!(found, faults, "{most_pa}");
        }
        assert_eq!(core.armed_pa(), None);
    }

    #[test]
    fn what_vented_before_the_board_restarted_vents_after_it() {
        let mut before = checked_core(&Config::default(), HALF, &HEALTHY);
        before.step(&Sample { emergency_stop: true, ..HEALTHY });
        let first = before.supervisor().first_failure().unwrap();
        let mut core = core_with(HALF);
        core.recall(first, before.supervisor().latched());
        assert_eq!(checked(&mut core, &HEALTHY).command, Command::VENT);
        assert_eq!(core.supervisor().first_failure(), Some(first));
    }

    /// Also if there was no fault, or none since this start.
    #[test]
    fn who_clears_faults_vents() {
        let mut driving = checked_core(&Config::default(), HALF, &HEALTHY);
        driving.clear_faults();
        assert_eq!(driving.step(&HEALTHY).command, Command::VENT);
        let first = FirstFailure { faults: Faults::BURST, pressure_pa: 2.5e5, step: 9 };
        let mut recalled = core_with(HALF);
        recalled.recall(first, Faults::BURST);
        recalled.clear_faults();
        assert_eq!(checked(&mut recalled, &HEALTHY).command, Command::VENT);
        assert_eq!(recalled.set(HALF), Ok(()), "it has not vented yet");
    }

    #[test]
    fn a_board_without_a_configuration_vents() {
        let mut core = Core::unconfigured().unwrap();
        let telemetry = checked(&mut core, &HEALTHY);
        assert_eq!((telemetry.command, telemetry.faults), (Command::VENT, Faults::NOT_CONFIGURED));
        assert_eq!(core.set(HALF), Err(SetPointError::Faults(Faults::NOT_CONFIGURED)));
        core.restart_as(&core_with(HALF));
        assert_eq!(checked(&mut core, &HEALTHY).command, Command::VENT, "nor armed");
        core.arm(None).unwrap();
        core.restart_as(&core_with(HALF));
        assert_ne!(checked(&mut core, &HEALTHY).command, Command::VENT);
    }

    /// 2.5 bar at 0.27 m.
    const INFLATED: Sample = Sample::new(AdcCode(12_688), AdcCode(15_950), AdcCode(21_545));

    /// Without its sensor the length is where the muscle pulls its load, where it is held, or the shortest one.
    #[test]
    fn a_lost_length_is_that_of_the_load() {
        let config = Config::default();
        let lost = Sample { length: AdcCode(0), ..INFLATED };
        let length_m = |config: &Config, sample: &Sample| {
            let mut core = Core::new(config).unwrap();
            let telemetry = core.step(sample);
            (telemetry.pressure_pa, telemetry.length_m)
        };
        let (pressure_pa, free_m) = length_m(&config, &lost);
        let muscle = AnyChamber::new(&config.chamber);
        let force_n = muscle.force_n(pressure_pa - 101_325.0, free_m);
        assert!((force_n - 100.0).abs() < 0.1, "{force_n} N at {free_m} m");
        assert!((length_m(&config, &INFLATED).1 - 0.27).abs() < 5e-4, "measured");
        let held = Config { load: Load::Isometric { length_m: 0.25 }, ..config };
        assert_eq!(length_m(&held, &lost).1, 0.25);
        let chamber = ChamberConfig::Vessel(Vessel { section_m2: 0.01, surface_m2: 0.1 });
        assert_eq!(length_m(&Config { chamber, ..config }, &lost).1, 1.0e-6, "no less than that");
    }

    #[test]
    fn a_pressure_that_climbs_while_both_valves_are_shut_vents() {
        let climbing = |step: u16| {
            let pressure = AdcCode(12_688 + 10 * step).into();
            Sample { pressure, ..INFLATED }
        };
        let gained = |telemetry: Telemetry| telemetry.faults.intersects(Faults::GAS_GAINED);
        let mut core = checked_core(&Config::default(), CLOSED, &INFLATED);
        // 2 % of the pressure in every 20 ms is 1/k of that more gas.
        let found = (0..600).find(|step| gained(core.step(&climbing(*step)))).unwrap();
        assert!((300..600).contains(&found), "{found}");
        assert_eq!(core.step(&INFLATED).command, Command::VENT);

        // A restart between the step that finds it and the next, which latches it.
        let mut core = checked_core(&Config::default(), CLOSED, &INFLATED);
        assert!((0..found).all(|step| !gained(core.step(&climbing(step)))));
        core.restart_as(&Core::new(&Config::default()).unwrap());
        assert!(gained(core.step(&INFLATED)));
    }

    /// The monitor distinguishes the driven valves: gas that does not move is another fault for each.
    #[test]
    fn a_valve_that_is_driven_and_moves_nothing_vents() {
        for (inlet, outlet, fault) in
            [(0.5, 0.0, Faults::NO_INFLOW), (0.0, 0.5, Faults::NO_OUTFLOW)]
        {
            let set_point = SetPoint::Duty { inlet, outlet };
            let mut core = checked_core(&Config::default(), set_point, &INFLATED);
            let found = (0..2000_u16).find_map(|step| {
                // Codes that change: the channel is alive.
                let pressure = AdcCode(12_688 + step % 2).into();
                let length = AdcCode(21_545 + step % 2);
                let faults = core.step(&Sample { pressure, length, ..INFLATED }).faults;
                (faults != Faults::NONE).then_some(faults)
            });
            assert_eq!(found, Some(fault));
            assert_eq!(core.step(&INFLATED).command, Command::VENT);
        }
    }

    /// 6 bar would hold four times the load there; if the length is lost, it is derived from the load.
    #[test]
    fn an_impossible_force_is_found_where_the_length_is_trusted() {
        let strong = Sample { pressure: AdcCode(25_746).into(), ..INFLATED };
        let lost = Sample { length: AdcCode(0), ..strong };
        for (sample, found) in [(strong, true), (lost, false)] {
            let mut core = checked_core(&Config::default(), CLOSED, &sample);
            let force = (0..3000).any(|_| core.step(&sample).faults.intersects(Faults::FORCE));
            assert_eq!(force, found, "length code {:?}", sample.length);
        }
    }

    #[test]
    fn a_gas_sensor_that_contradicts_the_model_is_shown_and_vents_nothing() {
        let mut core = checked_core(&Config::default(), CLOSED, &INFLATED);
        // 16 K warmer from one step to the next without a cause.
        for (gas, shown) in [(15_950, false), (23_950, true)] {
            let faults = (0..3000_u16).map(|step| {
                let gas = AdcCode(gas + step % 2).into();
                let telemetry = core.step(&Sample { gas, ..INFLATED });
                assert_eq!(telemetry.command, Command::CLOSED);
                telemetry.faults
            });
            let seen = faults.fold(Faults::NONE, Faults::with);
            assert_eq!(seen == Faults::GAS_SENSOR, shown, "{seen}");
        }
    }

    /// A tenth of a second of silence, or a part that reports twice that it is broken. For an element on the converter
    /// both are only shown.
    #[test]
    fn a_digital_gas_sensor_that_is_lost_vents() {
        let gas_element = GasElement::Max31865(Max31865::default());
        let sensors = Sensors { gas_element, ..Sensors::default() };
        let config = Config { sensors, ..Config::default() };
        let sample = |step: u16, reading: u16| {
            let gas = RawCode::of_part(reading, step.is_multiple_of(20));
            Sample { gas, ..INFLATED }
        };
        let healthy = |step: u16| sample(step, 8457 + step / 20 % 2);
        for (silent, expected) in [(true, 100), (false, 40)] {
            let mut core = checked_core(&config, CLOSED, &healthy(0));
            for step in 1..=200 {
                assert_eq!(core.step(&healthy(step)).faults, Faults::NONE);
            }
            let broken = |step| if silent { sample(201, 8457) } else { sample(step, 0) };
            let found = (201..500)
                .find(|step| core.step(&broken(*step)).faults.intersects(Faults::GAS_LOST));
            assert_eq!(found, Some(200 + expected), "silent: {silent}");
            let telemetry = core.step(&broken(501));
            assert_eq!(telemetry.command, Command::VENT);
            assert_eq!(telemetry.faults, Faults::GAS_SENSOR.with(Faults::GAS_LOST));
            core.step(&healthy(520));
            assert_eq!(core.step(&healthy(540)).faults, Faults::GAS_LOST, "latched");
            core.clear_faults();
            assert_eq!(core.step(&healthy(541)).faults, Faults::NONE);
        }
    }

    /// Starts in quick succession do not hide its silence.
    #[test]
    fn a_digital_gas_sensor_that_is_silent_over_starts_vents() {
        let gas_element = GasElement::Max31865(Max31865::default());
        let sensors = Sensors { gas_element, ..Sensors::default() };
        let config = Config { sensors, ..Config::default() };
        let with_gas = |fresh| Sample { gas: RawCode::of_part(8457, fresh), ..INFLATED };
        let mut core = checked_core(&config, CLOSED, &with_gas(true));
        let found = (1..500).find(|step| {
            if step % 60 == 0 {
                let mut other = Core::new(&config).unwrap();
                other.set(CLOSED).unwrap();
                core.restart_as(&other);
            }
            core.step(&with_gas(false)).faults.intersects(Faults::GAS_LOST)
        });
        assert_eq!(found, Some(100));
    }

    /// The pin of a missing sensor may read anything.
    #[test]
    fn a_digital_sensor_does_not_answer_for_the_converter_before_it() {
        let gas_element = GasElement::Max31865(Max31865::default());
        let sensors = Sensors { gas_element, ..Sensors::default() };
        let mut core = Core::unconfigured().unwrap();
        for step in 0..200_u16 {
            core.step(&Sample { gas: AdcCode(8000 * (step % 3)).into(), ..HEALTHY });
        }
        core.restart_as(&Core::new(&Config { sensors, ..Config::default() }).unwrap());
        for step in 0..200 {
            let gas = RawCode::of_part(8457, step % 20 == 0);
            assert_eq!(core.step(&Sample { gas, ..HEALTHY }).faults, Faults::NONE, "{step}");
        }
    }

    #[test]
    fn a_silent_host_vents_what_it_drives() {
        let silent = Sample { heard: false, ..HEALTHY };
        for (set_point, after) in [(CLOSED, Some(499)), (SetPoint::Vent, None)] {
            let mut core = checked_core(&Config::default(), set_point, &HEALTHY);
            let lost = (0..2000).find(|_| core.step(&silent).faults == Faults::LINK_LOST);
            assert_eq!(lost, after, "{set_point:?}");
        }
    }
}
