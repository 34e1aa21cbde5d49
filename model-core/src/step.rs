//! The core: one [`Sample`] in, one [`Telemetry`] with its [`Command`] out, once per fixed step.

use crate::body::Shape;
use crate::config::{Config, ConfigError, Load};
use crate::control::{Controller, Feedback};
use crate::estimator::{Estimator, Measurement, Openings};
use crate::front_end::{self, Converter};
use crate::sample::{Command, Duty, Faults, Sample, SetPoint, Telemetry};
use crate::supervisor::Supervisor;

/// Model, estimator, controller and supervisor of one muscle.
#[derive(Debug, Clone, PartialEq)]
pub struct Core {
    config: Config,
    shape: Shape,
    converter: Converter,
    supervisor: Supervisor,
    estimator: Estimator,
    controller: Controller,
    command: Command,
    /// The last step's openings were others than those of the one before.
    turned: bool,
    /// Steps for which the inlet, and the outlet, may still pass gas after their last duty.
    inlet_steps: u16,
    outlet_steps: u16,
    step: u32,
}

impl Core {
    /// A core that vents until it is given a set point.
    ///
    /// # Errors
    /// [`ConfigError`] as [`Config::check`].
    pub fn new(config: &Config) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self {
            config: *config,
            shape: Shape::new(&config.body),
            converter: Converter::new(&config.front_end),
            supervisor: Supervisor::default(),
            estimator: Estimator::new(config),
            controller: Controller::new(config),
            command: Command::VENT,
            turned: false,
            inlet_steps: 0,
            outlet_steps: 0,
            step: 0,
        })
    }

    /// The configuration that the core runs with.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Changes what the core is to do, from the next PWM period on.
    pub fn set(&mut self, set_point: SetPoint) {
        self.controller.set(set_point);
    }

    /// Forgets latched faults whose cause is gone. The set point falls back to venting: nothing
    /// moves because a fault was acknowledged.
    pub fn clear_faults(&mut self) {
        self.supervisor.clear();
        self.controller.set(SetPoint::Vent);
    }

    /// One step.
    pub fn step(&mut self, sample: &Sample) -> Telemetry {
        let pressure_pa = self.converter.pressure_pa(sample.pressure);
        let filling = self.inlet_steps > 0;
        let limit_pa = self.config.pressure_limit_pa;
        let faults = self.supervisor.step(sample, pressure_pa, limit_pa, filling);
        let length_m = self.length_m(sample, pressure_pa, faults);
        let venting = self.supervisor.must_vent();
        if venting {
            self.controller.set(SetPoint::Vent);
        }
        // While venting too: it counts the periods of the PWM, and the hardware goes on with them.
        let wanted = self.controller.step(
            &self.config,
            &Feedback { pressure_pa, length_m, estimate: self.estimator.estimate() },
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
        let frozen = self.estimator.sensor_frozen();
        let faults = if frozen { faults.with(Faults::GAS_SENSOR) } else { faults };
        // A pulse ends late, at most one PWM period after its duty.
        let period = self.config.drive.period_steps;
        let passing = |duty: Duty, steps: u16| {
            if duty > Duty::ZERO { period.saturating_add(1) } else { steps.saturating_sub(1) }
        };
        self.inlet_steps = passing(command.inlet, self.inlet_steps);
        self.outlet_steps = passing(command.outlet, self.outlet_steps);
        self.command = command;
        let telemetry = Telemetry {
            step: self.step,
            sample: *sample,
            pressure_pa,
            length_m,
            estimate: self.estimator.estimate(),
            command,
            faults,
        };
        self.step = self.step.wrapping_add(1);
        telemetry
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

    const HEALTHY: Sample = Sample {
        pressure: AdcCode(7770),
        gas: AdcCode(15_950),
        length: AdcCode(23_757),
        emergency_stop: false,
    };

    #[test]
    fn a_fault_vents_at_once_and_leaves_the_period_in_phase() {
        let mut core = Core::new(&Config::default()).unwrap();
        let fill = SetPoint::Duty(Command { inlet: Duty(20_000), outlet: Duty::ZERO });
        core.set(fill);
        assert_ne!(core.step(&HEALTHY).command, Command::VENT);
        for _ in 1..4 {
            core.step(&HEALTHY);
        }
        let stopped = Sample { emergency_stop: true, ..HEALTHY };
        assert_eq!(core.step(&stopped).command, Command::VENT, "in the middle of a period");
        for _ in 5..17 {
            assert_eq!(core.step(&HEALTHY).command, Command::VENT, "latched");
        }
        core.clear_faults();
        core.set(fill);
        let commands = [17, 18, 19, 20].map(|_| core.step(&HEALTHY).command);
        assert_eq!(commands[..3], [Command::VENT; 3], "the period of step 10 goes on");
        assert_ne!(commands[3], Command::VENT, "step 20 begins a period");
    }
}
