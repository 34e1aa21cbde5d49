//! From the set point to the valve openings.

use crate::body::Shape;
use crate::config::{Config, Load, Reservoir};
use crate::math::limit;
use crate::sample::{Command, Estimate, SetPoint};
use crate::valve_drive::FlowDrive;

/// Time in which the pressure loop closes a small error \[s\]: five PWM periods.
const PRESSURE_LOOP_S: f32 = 0.05;
/// Time in which the length loop closes a small error \[s\].
const LENGTH_LOOP_S: f32 = 0.5;

/// State of the controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Controller {
    shape: Shape,
    set_point: SetPoint,
    drive: FlowDrive,
    command: Command,
    /// Steps since the set point was given; the paper's cycle counts in them.
    age_steps: u32,
    /// Steps until the PWM period ends.
    remaining_steps: u16,
    /// Pressure that the length loop has learnt to add \[Pa\].
    length_trim_pa: f32,
}

/// What the controller acts on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feedback {
    /// Measured absolute pressure \[Pa\].
    pub pressure_pa: f32,
    /// Measured length \[m\].
    pub length_m: f32,
    /// The estimate of the step before.
    pub estimate: Estimate,
}

impl Controller {
    /// A controller that vents.
    pub fn new(config: &Config) -> Self {
        Self {
            shape: Shape::new(&config.body),
            set_point: SetPoint::Vent,
            drive: FlowDrive::new(config),
            command: Command::VENT,
            age_steps: 0,
            remaining_steps: 0,
            length_trim_pa: 0.0,
        }
    }

    /// Changes the set point. The same kind again keeps what its loop has learnt.
    pub fn set(&mut self, set_point: SetPoint) {
        if core::mem::discriminant(&set_point) != core::mem::discriminant(&self.set_point) {
            self.drive.reset();
            self.length_trim_pa = 0.0;
            self.age_steps = 0;
        }
        self.set_point = set_point;
    }

    /// Openings for this step. They change at the start of a PWM period only: in between the
    /// hardware would not take them.
    pub fn step(&mut self, config: &Config, feedback: &Feedback) -> Command {
        if self.remaining_steps == 0 {
            self.remaining_steps = config.drive.period_steps;
            self.command = self.period(config, feedback);
        }
        self.remaining_steps = self.remaining_steps.saturating_sub(1);
        self.age_steps = self.age_steps.wrapping_add(1);
        self.command
    }

    fn period(&mut self, config: &Config, feedback: &Feedback) -> Command {
        let flow_kg_s = match self.set_point {
            SetPoint::Vent => return Command::VENT,
            SetPoint::Duty(command) => return command,
            SetPoint::MassFlow { flow_kg_s } => flow_kg_s,
            SetPoint::MassFlowCycle { flow_kg_s, period_s } => {
                let half_steps = limit(0.5 * period_s / config.step_s + 0.5, 1.0, 1.0e9) as u32;
                let filling = (self.age_steps / half_steps.max(1)).is_multiple_of(2);
                if filling { flow_kg_s } else { -flow_kg_s }
            }
            SetPoint::Pressure { pressure_pa } => self.pressure_flow(config, feedback, pressure_pa),
            SetPoint::Contraction { contraction } => {
                let pressure_pa = self.contraction_pressure(config, feedback, contraction);
                self.pressure_flow(config, feedback, pressure_pa)
            }
        };
        let muscle =
            Reservoir { pressure_pa: feedback.pressure_pa, temperature_k: feedback.estimate.gas_k };
        self.drive.period(config, flow_kg_s, muscle)
    }

    /// Mass flow that closes the pressure error in [`PRESSURE_LOOP_S`], from eq. (6) at constant
    /// volume: m' = V/(k R T) P'.
    fn pressure_flow(&self, config: &Config, feedback: &Feedback, pressure_pa: f32) -> f32 {
        let volume_m3 = self.shape.volume_m3(feedback.length_m);
        let per_pressure = volume_m3
            / (config.gas.heat_capacity_ratio
                * config.gas.gas_constant_j_kg_k
                * feedback.estimate.gas_k);
        per_pressure * (pressure_pa - feedback.pressure_pa) / PRESSURE_LOOP_S
    }

    /// Absolute pressure for a contraction: the static one for the load, trimmed by the length
    /// error's integral.
    fn contraction_pressure(
        &mut self,
        config: &Config,
        feedback: &Feedback,
        contraction: f32,
    ) -> f32 {
        let (Shape::Muscle(geometry), Load::Isotonic { force_n }) = (&self.shape, config.load)
        else {
            return feedback.pressure_pa;
        };
        let rest_m = geometry.muscle().rest_length_m;
        let length_m = geometry.limit_length_m(rest_m * (1.0 - contraction));
        let gauge_pa = geometry.gauge_pressure_for_force_pa(force_n, length_m);
        let period_s = f32::from(config.drive.period_steps) * config.step_s;
        // Pressure per length along the static curve is some 1 MPa/m to 10 MPa/m; the smaller
        // keeps the loop stable at every contraction.
        let error_m = feedback.length_m - length_m;
        self.length_trim_pa =
            limit(self.length_trim_pa + 1.0e6 * error_m * period_s / LENGTH_LOOP_S, -1.0e5, 1.0e5);
        limit(
            config.ambient.pressure_pa + gauge_pa + self.length_trim_pa,
            config.ambient.pressure_pa,
            config.pressure_limit_pa,
        )
    }
}
