//! The core: one [`Sample`] in, one [`Telemetry`] with its [`Command`] out, once per fixed step.

use crate::body::Shape;
use crate::config::{Config, ConfigError, Load};
use crate::control::{Controller, Feedback, Mode, SetPoint, SetPointError, Target};
use crate::estimator::{Estimator, Measurement, Openings};
use crate::front_end::{self, Converter};
use crate::sample::{Command, Duty, Faults, Sample, Telemetry};
use crate::supervisor::{Activity, FirstFailure, Supervisor};
use crate::watch::{EMPTY, Watch};

/// Model, estimator, controller and supervisor of one muscle.
#[derive(Debug, Clone, PartialEq)]
pub struct Core {
    config: Config,
    shape: Shape,
    converter: Converter,
    supervisor: Supervisor,
    estimator: Estimator,
    controller: Controller,
    watch: Watch,
    found: Faults,
    command: Command,
    /// The last step's openings were others than those of the one before.
    turned: bool,
    /// Steps for which the inlet, and the outlet, may still pass gas after their last duty.
    inlet_steps: u16,
    outlet_steps: u16,
    step: u32,
}

impl Core {
    /// A core that vents until it has judged its sensors and is given a set point.
    ///
    /// # Errors
    /// [`ConfigError`] as [`Config::check`].
    pub fn new(config: &Config) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self {
            config: *config,
            shape: Shape::new(&config.body),
            converter: Converter::new(&config.front_end),
            supervisor: Supervisor::new(config, true),
            estimator: Estimator::new(config),
            controller: Controller::new(config),
            watch: Watch::new(config),
            found: Faults::NONE,
            command: Command::VENT,
            turned: false,
            inlet_steps: 0,
            outlet_steps: 0,
            step: 0,
        })
    }

    /// The core of a board that nobody has told its configuration: it has the default one, and vents
    /// until it is [restarted](Self::restart_as) as one that is configured.
    ///
    /// # Errors
    /// None: the default configuration holds.
    pub fn unconfigured() -> Result<Self, ConfigError> {
        let config = Config::default();
        Ok(Self { supervisor: Supervisor::new(&config, false), ..Self::new(&config)? })
    }

    /// Starts anew as `other`, with its configuration and its set point. The supervisor stays: what is
    /// latched is latched, what it has counted counts, and the sensors are judged again.
    pub fn restart_as(&mut self, other: Self) {
        *self = Self {
            supervisor: self.supervisor.after_restart(&other.supervisor),
            inlet_steps: self.inlet_steps,
            outlet_steps: self.outlet_steps,
            ..other
        };
    }

    /// The configuration that the core runs with.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The supervisor, for what it has latched.
    pub fn supervisor(&self) -> &Supervisor {
        &self.supervisor
    }

    /// Takes over what was latched before the board restarted.
    pub fn recall(&mut self, first: FirstFailure, latched: Faults) {
        self.supervisor.recall(first, latched);
    }

    /// Changes what the core is to do, from the next PWM period on.
    ///
    /// # Errors
    /// [`SetPointError`] for a value that is no number or out of its range, and for anything but
    /// to vent while faults do; what held before goes on.
    pub fn set(&mut self, set_point: SetPoint) -> Result<(), SetPointError> {
        let target = Target::new(&set_point, &self.config)?;
        let venting = self.supervisor.venting();
        if target != Target::VENT && venting != Faults::NONE {
            return Err(SetPointError::Faults(venting));
        }
        self.controller.set(target);
        Ok(())
    }

    /// Vents, from this step on: what [`SetPoint::Vent`] does from the next PWM period on.
    pub fn vent(&mut self) {
        self.controller.vent();
    }

    /// Forgets latched faults whose cause is gone. The set point falls back to venting: nothing
    /// moves because a fault was acknowledged.
    pub fn clear_faults(&mut self) {
        self.supervisor.clear();
        self.controller.set(Target::VENT);
    }

    /// One step. While the sensors are judged ([`Mode::Judging`]) it vents, and neither estimates nor
    /// counts: step 0 is the first after it.
    pub fn step(&mut self, sample: &Sample) -> Telemetry {
        let pressure_pa = self.converter.pressure_pa(sample.pressure);
        let driven = self.controller.driven();
        // A muscle that is not empty, and that a set point lets out.
        let let_out = driven
            && !self.supervisor.judging()
            && self.command.outlet > Duty::ZERO
            && pressure_pa > EMPTY * self.config.ambient.pressure_pa;
        let activity = Activity {
            flowing: self.inlet_steps > 0 || let_out,
            driven,
            step: self.step,
            found: core::mem::replace(&mut self.found, Faults::NONE),
        };
        let faults = self.supervisor.step(sample, pressure_pa, activity);
        let length_m = self.length_m(sample, pressure_pa, faults);
        if self.supervisor.judging() {
            self.follow(Command::VENT);
            return Telemetry {
                step: self.step,
                sample: *sample,
                pressure_pa,
                length_m,
                estimate: self.estimator.estimate(),
                command: Command::VENT,
                mode: Mode::Judging,
                limited: false,
                faults,
            };
        }
        let venting = self.supervisor.venting() != Faults::NONE;
        if venting {
            self.controller.set(Target::VENT);
        }
        // While venting too: it counts the periods of the PWM, and the hardware goes on with them.
        let wanted = self.controller.step(
            &self.config,
            &Feedback { pressure_pa, length_m, estimate: self.estimator.estimate() },
            sample.missed_steps,
        );
        let command = if venting { Command::VENT } else { wanted };
        let turned = core::mem::replace(&mut self.turned, command.turns(self.command));
        // The gas that this sample has seen went through the openings of the step before.
        self.estimator.step(&Measurement {
            pressure_pa: self.supervisor.pressure_trusted().then_some(pressure_pa),
            length_m,
            wide_pressure: front_end::is_wide(sample.pressure),
            wide_length: front_end::is_wide(sample.length),
            gas: (!faults.intersects(Faults::GAS_SENSOR)).then_some(sample.gas),
            openings: Openings {
                turned,
                driven: self.command.inlet > Duty::ZERO || self.command.outlet > Duty::ZERO,
                charging: self.inlet_steps > 0,
                discharging: self.outlet_steps > 0,
            },
        });
        if let Some(balance) = self.estimator.take_balance() {
            let length_m = (!faults.intersects(Faults::LENGTH_SENSOR)).then_some(length_m);
            self.found = self.watch.add(&self.shape, &balance, length_m);
        }
        let implausible = self.estimator.sensor_implausible();
        let faults = if implausible { faults.with(Faults::GAS_SENSOR) } else { faults };
        self.follow(command);
        let telemetry = Telemetry {
            step: self.step,
            sample: *sample,
            pressure_pa,
            length_m,
            estimate: self.estimator.estimate(),
            command,
            mode: self.controller.mode(),
            limited: self.controller.limited(),
            faults,
        };
        self.step = self.step.wrapping_add(1);
        telemetry
    }

    /// Takes these openings for the ones of this step.
    fn follow(&mut self, command: Command) {
        // A pulse ends late, at most one PWM period after its duty.
        let period = self.config.drive.period_steps;
        let passing = |duty: Duty, steps: u16| {
            if duty > Duty::ZERO { period.saturating_add(1) } else { steps.saturating_sub(1) }
        };
        self.watch.drive(command);
        self.inlet_steps = passing(command.inlet, self.inlet_steps);
        self.outlet_steps = passing(command.outlet, self.outlet_steps);
        self.command = command;
    }

    /// Measured length, or without its sensor the one at which the load balances.
    fn length_m(&self, sample: &Sample, pressure_pa: f32, faults: Faults) -> f32 {
        if !faults.intersects(Faults::LENGTH_SENSOR) {
            return self.shape.limit_length_m(self.converter.length_m(sample.length));
        }
        match (&self.shape, self.config.load) {
            (Shape::Muscle(geometry), Load::Isotonic { force_n }) => {
                geometry.length_for_force_m(pressure_pa - self.config.ambient.pressure_pa, force_n)
            }
            (_, Load::Isometric { length_m }) => self.shape.limit_length_m(length_m),
            (Shape::Vessel { .. }, _) => {
                self.shape.limit_length_m(self.converter.length_m(sample.length))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::AdcCode;

    const HEALTHY: Sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));

    const HALF: SetPoint = SetPoint::Duty { inlet: 0.5, outlet: 0.0 };

    /// A core with this set point.
    fn core_with(set_point: SetPoint) -> Core {
        let mut core = Core::new(&Config::default()).unwrap();
        core.set(set_point).unwrap();
        core
    }

    /// The first telemetry after the sensors have been judged.
    fn judged(core: &mut Core, sample: &Sample) -> Telemetry {
        core::iter::repeat_with(|| core.step(sample))
            .find(|telemetry| telemetry.mode != Mode::Judging)
            .unwrap()
    }

    #[test]
    fn a_start_judges_the_sensors_before_it_counts() {
        let mut core = core_with(HALF);
        let judging = (0..).map(|_| core.step(&HEALTHY)).take_while(|telemetry| {
            assert_eq!(telemetry.step, 0);
            let judging = telemetry.mode == Mode::Judging;
            assert_eq!(judging, telemetry.command == Command::VENT);
            judging
        });
        assert_eq!(judging.count(), usize::from(crate::supervisor::JUDGING_STEPS) - 1);
        assert_eq!(core.step(&HEALTHY).step, 1);
    }

    /// Neither a short nor a pressure above the limit hides behind starts in quick succession.
    #[test]
    fn restarts_do_not_go_round_the_supervisor() {
        let shorted = Sample { pressure: AdcCode(0), ..HEALTHY };
        let high = Sample { pressure: AdcCode(29_300), ..HEALTHY };
        for (sample, fault) in [(shorted, Faults::PRESSURE_SENSOR), (high, Faults::OVERPRESSURE)] {
            for every in [1, 5, 9, 60] {
                let mut core = core_with(HALF);
                for step in 0..1000 {
                    if step % every == 0 {
                        core.restart_as(core_with(HALF));
                    }
                    let telemetry = core.step(&sample);
                    assert_eq!(telemetry.command, Command::VENT, "step {step}, {fault:?}");
                    assert_eq!(telemetry.faults.intersects(fault), step >= 9, "step {step}");
                }
            }
        }
    }

    #[test]
    fn a_restart_with_healthy_sensors_vents_while_it_judges() {
        let mut core = core_with(HALF);
        for step in 0..1000 {
            if step % 9 == 0 {
                core.restart_as(core_with(HALF));
            }
            assert_eq!(core.step(&HEALTHY).command, Command::VENT, "step {step}");
        }
    }

    #[test]
    fn latched_is_latched_whatever_is_started() {
        let mut core = core_with(HALF);
        judged(&mut core, &HEALTHY);
        core.step(&Sample { emergency_stop: true, ..HEALTHY });
        core.restart_as(core_with(HALF));
        for _ in 0..200 {
            let telemetry = core.step(&HEALTHY);
            assert_eq!(telemetry.command, Command::VENT);
            assert_eq!(telemetry.faults, Faults::EMERGENCY_STOP);
        }
        core.clear_faults();
        core.restart_as(core_with(HALF));
        assert_ne!(judged(&mut core, &HEALTHY).command, Command::VENT);
    }

    /// A code that stands still shows while gas is let out too, but not in a muscle that vents anyway.
    #[test]
    fn a_frozen_pressure_shows_while_gas_is_let_out() {
        let full = Sample { pressure: AdcCode(15_000), ..HEALTHY };
        let first = |set_point| {
            let mut core = core_with(set_point);
            judged(&mut core, &full);
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
        assert_ne!(judged(&mut core, &HEALTHY).command, Command::VENT);
        for _ in 1..4 {
            core.step(&HEALTHY);
        }
        let stopped = Sample { emergency_stop: true, ..HEALTHY };
        assert_eq!(core.step(&stopped).command, Command::VENT, "in the middle of a period");
        for _ in 5..17 {
            assert_eq!(core.step(&HEALTHY).command, Command::VENT, "latched");
        }
        core.clear_faults();
        core.set(HALF).unwrap();
        let commands = [17, 18, 19, 20].map(|_| core.step(&HEALTHY).command);
        assert_eq!(commands[..3], [Command::VENT; 3], "the period of step 10 goes on");
        assert_ne!(commands[3], Command::VENT, "step 20 begins a period");
    }
}
