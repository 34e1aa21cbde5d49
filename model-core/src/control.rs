//! From the set point to the valve openings.
//!
//! ```text
//!            set(kind)                  set(another kind)
//! [Vent] -------------> [Duty | MassFlow | MassFlowCycle] <-------------+
//!   ^  ^                          |        ^                            |
//!   |  |        set(Pressure)     v        | set(another kind)          |
//!   |  |      +-------------> [Pressure: moving] <--> [holding]         |
//!   |  |      |                   |  ^   error within, or beyond,       |
//!   |  |      |  set(Contraction) v  |   the dead zone                  |
//!   |  +------+-------------> [Contraction: moving] <--> [holding] -----+
//!   |                                      five periods within, or a step out of, the dead zone
//!   +--- emergency stop, pressure fault, set(Vent): from everywhere, within one step
//! ```
//!
//! Entering *Pressure* or *Contraction* starts the loop from what is measured (bumpless); the same
//! kind again keeps what it has learnt. *Holding*: both valves closed, the gas locked in, friction
//! keeping the muscle where it is. *Contraction* under an isometric load, or of a vessel, holds.
//!
//! Work is done once per PWM period, at its start; the friction at the estimated wall temperature in
//! the middle of the period before, because an exponential is dear without an FPU.

use crate::body::Shape;
use crate::config::{Config, Reservoir};
use crate::contraction_control::ContractionLoop;
use crate::math::limit;
use crate::pressure_control::PressureLoop;
use crate::sample::{Command, Estimate, SetPoint};
use crate::valve_drive::FlowDrive;

/// What the controller is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Inlet closed, outlet open.
    Vent,
    /// Fixed openings.
    Duty,
    /// A mass flow, constant or in the paper's cycle.
    MassFlow,
    /// The pressure loop acts.
    Pressure,
    /// The pressure is where it should be.
    PressureHeld,
    /// The contraction loop acts.
    Contraction,
    /// The muscle is where it should be.
    ContractionHeld,
}

/// The loop that is closed, if one is.
#[derive(Debug, Clone, Copy, PartialEq)]
enum ActiveLoop {
    Open,
    Pressure(PressureLoop),
    Contraction(ContractionLoop),
}

/// State of the controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Controller {
    shape: Shape,
    set_point: SetPoint,
    drive: FlowDrive,
    active: ActiveLoop,
    command: Command,
    /// Steps since the set point was given; the paper's cycle counts in them.
    age_steps: u32,
    /// Steps until the PWM period ends.
    remaining_steps: u16,
    /// What the estimated wall temperature makes of friction \[-\].
    softening: f32,
    /// Measured length at the start of the last period \[m\].
    length_m: f32,
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

/// The gas at the valves' side of a loop, for one period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Port {
    /// PWM period \[s\].
    pub period_s: f32,
    /// Absolute pressure \[Pa\].
    pub pressure_pa: f32,
    /// Gas volume \[m3\].
    pub volume_m3: f32,
    /// dV/dt from the lengths of two periods, eq. (11) \[m3/s\].
    pub volume_rate_m3_s: f32,
    /// Mass that the last pulse still moves, positive into the muscle \[kg\].
    pub in_flight_kg: f32,
    /// Whether the last period's valve could not pass what was asked.
    pub saturated: bool,
    inflow_k: f32,
    gas_k: f32,
    per_k: f32,
    gas_constant_j_kg_k: f32,
}

impl Port {
    /// Gas mass \[kg\] that a change of pressure \[Pa\] and of volume \[m3\] needs, eq. (6) solved for
    /// it: (V dP/k + P dV)/(R T). T is that of the gas which passes the port: the supply's inwards,
    /// the estimate outwards (the balance (3), where (5) has one T for both).
    pub fn mass_kg(&self, change_pa: f32, change_m3: f32) -> f32 {
        let energy_j = self.volume_m3 * change_pa * self.per_k + self.pressure_pa * change_m3;
        let port_k = if energy_j > 0.0 { self.inflow_k } else { self.gas_k };
        energy_j / (self.gas_constant_j_kg_k * port_k)
    }
}

impl Controller {
    /// A controller that vents.
    pub fn new(config: &Config) -> Self {
        Self {
            shape: Shape::new(&config.body),
            set_point: SetPoint::Vent,
            drive: FlowDrive::new(config),
            active: ActiveLoop::Open,
            command: Command::VENT,
            age_steps: 0,
            remaining_steps: 0,
            softening: config.friction.softening(config.ambient.temperature_k),
            length_m: 0.0,
        }
    }

    /// Changes the set point. The same kind again keeps what its loop has learnt.
    pub fn set(&mut self, set_point: SetPoint) {
        if core::mem::discriminant(&set_point) != core::mem::discriminant(&self.set_point) {
            self.drive.reset();
            self.active = ActiveLoop::Open;
            self.age_steps = 0;
        }
        self.set_point = set_point;
    }

    /// What the controller is doing.
    pub fn mode(&self) -> Mode {
        match (self.set_point, &self.active) {
            (SetPoint::Vent, _) => Mode::Vent,
            (SetPoint::Duty(_), _) => Mode::Duty,
            (SetPoint::MassFlow { .. } | SetPoint::MassFlowCycle { .. }, _) => Mode::MassFlow,
            (SetPoint::Pressure { .. }, ActiveLoop::Pressure(active)) if active.holding() => {
                Mode::PressureHeld
            }
            (SetPoint::Pressure { .. }, _) => Mode::Pressure,
            (SetPoint::Contraction { .. }, ActiveLoop::Contraction(active))
                if !active.holding() =>
            {
                Mode::Contraction
            }
            (SetPoint::Contraction { .. }, _) => Mode::ContractionHeld,
        }
    }

    /// Openings for this step. They change at the start of a PWM period only: in between the
    /// hardware would not take them.
    pub fn step(&mut self, config: &Config, feedback: &Feedback) -> Command {
        if self.remaining_steps == 0 {
            self.remaining_steps = config.drive.period_steps;
            self.command = self.period(config, feedback);
            self.length_m = feedback.length_m;
        } else if self.remaining_steps == config.drive.period_steps / 2 {
            self.softening = config.friction.softening(feedback.estimate.wall_k);
        }
        self.remaining_steps = self.remaining_steps.saturating_sub(1);
        self.age_steps = self.age_steps.wrapping_add(1);
        self.command
    }

    fn period(&mut self, config: &Config, feedback: &Feedback) -> Command {
        let muscle =
            Reservoir { pressure_pa: feedback.pressure_pa, temperature_k: feedback.estimate.gas_k };
        let mass_kg = match self.set_point {
            SetPoint::Vent => return self.drive.direct(Command::VENT),
            SetPoint::Duty(command) => return self.drive.direct(command),
            SetPoint::MassFlow { flow_kg_s } => return self.drive.flow(config, flow_kg_s, muscle),
            SetPoint::MassFlowCycle { flow_kg_s, period_s } => {
                let half_steps = limit(0.5 * period_s / config.step_s + 0.5, 1.0, 1.0e9) as u32;
                let filling = (self.age_steps / half_steps.max(1)).is_multiple_of(2);
                let flow_kg_s = if filling { flow_kg_s } else { -flow_kg_s };
                return self.drive.flow(config, flow_kg_s, muscle);
            }
            SetPoint::Pressure { pressure_pa } => {
                let port = self.port(config, feedback);
                let mut active = match self.active {
                    ActiveLoop::Pressure(active) => active,
                    _ => PressureLoop::new(feedback),
                };
                let mass_kg = active.period(config, feedback, &port, pressure_pa);
                self.active = ActiveLoop::Pressure(active);
                mass_kg
            }
            SetPoint::Contraction { contraction } => {
                let Shape::Muscle(geometry) = self.shape else { return self.drive.closed() };
                let port = self.port(config, feedback);
                let mut active = match self.active {
                    ActiveLoop::Contraction(active) => active,
                    _ => ContractionLoop::new(config, &geometry, feedback, self.softening),
                };
                let mass_kg =
                    active.period(config, &geometry, feedback, &port, contraction, self.softening);
                self.active = ActiveLoop::Contraction(active);
                mass_kg
            }
        };
        match mass_kg {
            Some(mass_kg) => self.drive.mass(config, mass_kg, muscle),
            None => self.drive.closed(),
        }
    }

    fn port(&self, config: &Config, feedback: &Feedback) -> Port {
        let period_s = self.drive.period_s();
        let volume_m3 = self.shape.volume_m3(feedback.length_m);
        // The first period after a start has no length to compare with.
        let volume_rate_m3_s = match &self.shape {
            Shape::Muscle(geometry) if self.length_m > 0.0 => {
                geometry.volume_slope_m2(feedback.length_m) * (feedback.length_m - self.length_m)
                    / period_s
            }
            Shape::Vessel { section_m2, .. } if self.length_m > 0.0 => {
                section_m2 * (feedback.length_m - self.length_m) / period_s
            }
            _ => 0.0,
        };
        Port {
            period_s,
            pressure_pa: feedback.pressure_pa,
            volume_m3,
            volume_rate_m3_s,
            in_flight_kg: self.drive.in_flight_kg(),
            saturated: self.drive.saturated(),
            inflow_k: config.supply.temperature_k,
            gas_k: feedback.estimate.gas_k,
            per_k: 1.0 / config.gas.heat_capacity_ratio,
            gas_constant_j_kg_k: config.gas.gas_constant_j_kg_k,
        }
    }
}
