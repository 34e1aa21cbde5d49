//! The core: one [`Sample`] in, one [`Telemetry`] with its [`Command`] out, once per fixed step.

use crate::body::Shape;
use crate::config::{Config, ConfigError, Load, ValveDrive};
use crate::control::{Controller, Feedback};
use crate::estimator::{Estimator, Measurement};
use crate::front_end::Converter;
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
    inlet: Passage,
    outlet: Passage,
    step: u32,
}

/// What a valve may still let pass after it was driven.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Passage {
    /// Steps until it is surely shut.
    open_steps: u16,
    /// Steps for which it counts as driven lately.
    recent_steps: u16,
}

impl Passage {
    fn drive(&mut self, duty: Duty, drive: &ValveDrive) {
        if duty > Duty::ZERO {
            self.open_steps = drive.closing_steps;
            self.recent_steps = drive.closing_steps.saturating_add(drive.period_steps);
        } else {
            self.open_steps = self.open_steps.saturating_sub(1);
            self.recent_steps = self.recent_steps.saturating_sub(1);
        }
    }
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
            inlet: Passage::default(),
            outlet: Passage::default(),
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
        let faults = self.supervisor.step(sample, pressure_pa, self.config.pressure_limit_pa);
        let length_m = self.length_m(sample, pressure_pa, faults);
        let command = if self.supervisor.must_vent() {
            self.controller.set(SetPoint::Vent);
            Command::VENT
        } else {
            self.controller.step(
                &self.config,
                &Feedback { pressure_pa, length_m, estimate: self.estimator.estimate() },
            )
        };
        // The gas that this sample has seen went through the openings of the step before.
        self.estimator.step(&Measurement {
            pressure_pa,
            length_m,
            gas: (!faults.intersects(Faults::GAS_SENSOR)).then_some(sample.gas),
            charging: self.inlet.recent_steps > 0,
            discharging: self.outlet.recent_steps > 0,
            shut: self.inlet.open_steps == 0 && self.outlet.open_steps == 0,
        });
        self.inlet.drive(command.inlet, &self.config.drive);
        self.outlet.drive(command.outlet, &self.config.drive);
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
