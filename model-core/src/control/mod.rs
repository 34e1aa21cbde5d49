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

mod contraction;
mod port;
mod pressure;

pub use self::port::Feedback;

use self::contraction::{ContractionLoop, Gains};
use self::port::Port;
use self::pressure::PressureLoop;
use crate::body::Shape;
use crate::config::{Config, Reservoir};
use crate::math::limit;
use crate::sample::{Command, SetPoint};
use crate::valve_drive::FlowDrive;
use serde::{Deserialize, Serialize};

/// What the core is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// After a start: it vents and judges the sensors.
    Judging,
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

impl Mode {
    /// Every mode and its name; a mode's number in a trace is its place here.
    pub const NAMES: [(Self, &'static str); 8] = [
        (Self::Judging, "judging the sensors"),
        (Self::Vent, "vent"),
        (Self::Duty, "duty"),
        (Self::MassFlow, "mass flow"),
        (Self::Pressure, "pressure"),
        (Self::PressureHeld, "pressure, held"),
        (Self::Contraction, "contraction"),
        (Self::ContractionHeld, "contraction, held"),
    ];
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
    gains: Gains,
    per_k: f32,
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

impl Controller {
    /// A controller that vents.
    pub fn new(config: &Config) -> Self {
        let drive = FlowDrive::new(config);
        Self {
            shape: Shape::new(&config.body),
            set_point: SetPoint::Vent,
            gains: Gains::new(&config.controller, drive.period_s()),
            drive,
            per_k: 1.0 / config.gas.heat_capacity_ratio,
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
                let change_m3 = self.volume_change_m3(feedback);
                let mass_kg = active.period(config, feedback, &port, change_m3, pressure_pa);
                self.active = ActiveLoop::Pressure(active);
                mass_kg
            }
            SetPoint::Contraction { contraction } => {
                let Shape::Muscle(geometry) = self.shape else { return self.drive.closed() };
                let port = self.port(config, feedback);
                let mut active = match self.active {
                    ActiveLoop::Contraction(active) => active,
                    _ => ContractionLoop::new(
                        config,
                        &self.gains,
                        &geometry,
                        feedback,
                        self.softening,
                    ),
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

    /// What the volume has changed by over the last period, eq. (11) \[m3\].
    fn volume_change_m3(&self, feedback: &Feedback) -> f32 {
        let moved_m = feedback.length_m - self.length_m;
        // The first period after a start has no length to compare with.
        match &self.shape {
            Shape::Muscle(geometry) if self.length_m > 0.0 => {
                geometry.volume_slope_m2(feedback.length_m) * moved_m
            }
            Shape::Vessel { section_m2, .. } if self.length_m > 0.0 => section_m2 * moved_m,
            _ => 0.0,
        }
    }

    fn port(&self, config: &Config, feedback: &Feedback) -> Port {
        let period_s = self.drive.period_s();
        let volume_m3 = self.shape.volume_m3(feedback.length_m);
        Port {
            period_s,
            pwm_hz: self.drive.pwm_hz(),
            pressure_pa: feedback.pressure_pa,
            volume_m3,
            in_flight_kg: self.drive.in_flight_kg(),
            saturated: self.drive.saturated(),
            inflow_k: config.supply.temperature_k,
            gas_k: feedback.estimate.gas_k,
            per_k: self.per_k,
            gas_constant_j_kg_k: config.gas.gas_constant_j_kg_k,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Body, Load};
    use crate::sample::{Duty, Estimate};

    const LENGTH_M: f32 = 0.27;

    fn feedback(pressure_pa: f32, length_m: f32) -> Feedback {
        let estimate = Estimate { gas_k: 298.0, wall_k: 298.0, ..Estimate::default() };
        Feedback { pressure_pa, length_m, estimate }
    }

    /// Runs for some PWM periods; the last openings.
    fn periods(controller: &mut Controller, config: &Config, count: u16, now: Feedback) -> Command {
        let mut command = Command::VENT;
        for _ in 0..count * config.drive.period_steps {
            command = controller.step(config, &now);
        }
        command
    }

    /// A pressure at which the muscle holds its load at [`LENGTH_M`] without friction.
    fn balance_pa(config: &Config) -> f32 {
        let Shape::Muscle(geometry) = Shape::new(&config.body) else { panic!("a muscle") };
        config.ambient.pressure_pa + geometry.gauge_pressure_for_force_pa(100.0, LENGTH_M)
    }

    fn every_set_point() -> [SetPoint; 6] {
        [
            SetPoint::Vent,
            SetPoint::Duty(Command { inlet: Duty(20_000), outlet: Duty::ZERO }),
            SetPoint::MassFlow { flow_kg_s: 1.0e-3 },
            SetPoint::MassFlowCycle { flow_kg_s: 1.0e-3, period_s: 2.0 },
            SetPoint::Pressure { pressure_pa: 4.0e5 },
            SetPoint::Contraction { contraction: 0.2 },
        ]
    }

    fn mode_of(set_point: &SetPoint) -> Mode {
        match set_point {
            SetPoint::Vent => Mode::Vent,
            SetPoint::Duty(_) => Mode::Duty,
            SetPoint::MassFlow { .. } | SetPoint::MassFlowCycle { .. } => Mode::MassFlow,
            SetPoint::Pressure { .. } => Mode::Pressure,
            SetPoint::Contraction { .. } => Mode::Contraction,
        }
    }

    /// Every kind after every kind, and what each drives.
    #[test]
    fn every_transition() {
        let config = Config::default();
        for from in every_set_point() {
            for to in every_set_point() {
                let mut controller = Controller::new(&config);
                controller.set(from);
                periods(&mut controller, &config, 3, feedback(2.0e5, LENGTH_M));
                controller.set(to);
                // Two periods: after the outlet was open to the period's end the inlet waits one.
                let command = periods(&mut controller, &config, 2, feedback(2.0e5, LENGTH_M));
                assert_eq!(controller.mode(), mode_of(&to), "{from:?} to {to:?}");
                let (inlet, outlet) = (command.inlet > Duty::ZERO, command.outlet > Duty::ZERO);
                let expected = if to == SetPoint::Vent { (false, true) } else { (true, false) };
                assert_eq!((inlet, outlet), expected, "{from:?} to {to:?}");
            }
        }
    }

    #[test]
    fn pressure_rests_and_wakes() {
        let config = Config::default();
        let mut controller = Controller::new(&config);
        controller.set(SetPoint::Pressure { pressure_pa: 3.0e5 });
        for (pressure_pa, mode) in [
            (2.9e5, Mode::Pressure),
            (2.992e5, Mode::Pressure),
            (2.993e5, Mode::PressureHeld),
            (2.986e5, Mode::PressureHeld),
            (2.984e5, Mode::Pressure),
            (3.006e5, Mode::PressureHeld),
        ] {
            // The second period has nothing in flight.
            let command = periods(&mut controller, &config, 2, feedback(pressure_pa, LENGTH_M));
            assert_eq!(controller.mode(), mode, "at {pressure_pa} Pa");
            assert!(mode != Mode::PressureHeld || command == Command::CLOSED);
        }
        controller.set(SetPoint::Pressure { pressure_pa: 3.5e5 });
        periods(&mut controller, &config, 1, feedback(3.006e5, LENGTH_M));
        assert_eq!(controller.mode(), Mode::Pressure, "another set point of the same kind");
    }

    #[test]
    fn contraction_rests_and_wakes() {
        let config = Config::default();
        let held = feedback(balance_pa(&config), LENGTH_M);
        let mut controller = Controller::new(&config);
        controller.set(SetPoint::Contraction { contraction: 0.1 });
        // Entered at its goal: nothing moves, and after five calm periods it rests.
        for _ in 0..5 {
            assert_eq!(periods(&mut controller, &config, 1, held), Command::CLOSED);
        }
        assert_eq!(periods(&mut controller, &config, 1, held), Command::CLOSED);
        assert_eq!(controller.mode(), Mode::ContractionHeld);
        let nudged = |by_m: f32| feedback(balance_pa(&config), LENGTH_M + by_m);
        periods(&mut controller, &config, 3, nudged(8.0e-4));
        assert_eq!(controller.mode(), Mode::ContractionHeld, "within twice the dead zone");
        periods(&mut controller, &config, 1, nudged(1.0e-3));
        assert_eq!(controller.mode(), Mode::Contraction, "beyond it");
        periods(&mut controller, &config, 8, held);
        assert_eq!(controller.mode(), Mode::ContractionHeld);
        controller.set(SetPoint::Contraction { contraction: 0.15 });
        let command = periods(&mut controller, &config, 1, held);
        assert_eq!(controller.mode(), Mode::Contraction);
        assert!(command.inlet > Duty::ZERO && command.outlet == Duty::ZERO);
    }

    #[test]
    fn contraction_holds_what_cannot_move() {
        let isometric =
            Config { load: Load::Isometric { length_m: LENGTH_M }, ..Config::default() };
        let vessel = Config {
            body: Body::Vessel { section_m2: 0.01, surface_m2: 0.1 },
            ..Config::default()
        };
        for config in [isometric, vessel] {
            let mut controller = Controller::new(&config);
            controller.set(SetPoint::Contraction { contraction: 0.2 });
            let command = periods(&mut controller, &config, 3, feedback(2.0e5, LENGTH_M));
            assert_eq!(command, Command::CLOSED);
        }
    }

    /// A change of mode at rest moves next to nothing, whatever the load really is.
    #[test]
    fn a_change_of_mode_is_bumpless() {
        let config = Config::default();
        for off_pa in [-4.0e4, -1.0e4, 0.0, 1.0e4, 4.0e4] {
            let now = feedback(balance_pa(&config) + off_pa, LENGTH_M);
            let mut controller = Controller::new(&config);
            controller.set(SetPoint::Pressure { pressure_pa: now.pressure_pa });
            periods(&mut controller, &config, 3, now);
            controller.set(SetPoint::Contraction { contraction: 0.1 });
            for _ in 0..8 {
                let command = periods(&mut controller, &config, 1, now);
                assert_eq!(command, Command::CLOSED, "{off_pa} Pa from balance");
            }
        }
    }

    /// Eq. (6) backwards: dP/dt of the mass that [`Port::mass_kg`] asks for is the one wanted.
    #[test]
    fn mass_is_eq_6_solved_for_it() {
        let config = Config::default();
        let mut controller = Controller::new(&config);
        controller.length_m = LENGTH_M + 1.0e-3;
        let now = feedback(3.0e5, LENGTH_M);
        let port = controller.port(&config, &now);
        let change_m3 = controller.volume_change_m3(&now);
        let mass_kg = port.mass_kg(5_000.0, change_m3);
        let chamber = crate::gas::Chamber {
            pressure_pa: 3.0e5,
            temperature_k: 298.0,
            volume_m3: port.volume_m3,
            volume_rate_m3_s: change_m3 / port.period_s,
            inflow_kg_s: mass_kg / port.period_s,
            outflow_kg_s: 0.0,
        };
        let rate = crate::gas::pressure_rate_adiabatic(&config.gas, &chamber);
        assert!(change_m3 > 1.0e-6, "it contracts");
        assert!((rate * port.period_s / 5_000.0 - 1.0).abs() < 1e-3, "{rate} Pa/s");
    }
}
