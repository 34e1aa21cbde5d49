//! The valves' PWM as the board's hardware has it, for boards without pins: a new duty is taken over
//! where the counter wraps, and the counter wraps in the middle between two steps.

use crate::plant::Actuation;
use model_core::{Command, Duty};

/// From a step to the wrap that takes its duties over, in steps.
const WRAP: f64 = 0.5;

/// One slice with both valves' coils.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VirtualPwm {
    period_steps: f64,
    /// Steps since the last wrap, at the time of a step.
    phase: f64,
    /// Coils in the running period.
    coils: (Duty, Duty),
}

impl VirtualPwm {
    /// A counter that wraps behind the first step, with both coils without power until then.
    pub fn new(period_steps: u16) -> Self {
        let period_steps = f64::from(period_steps.max(1));
        Self { period_steps, phase: period_steps - WRAP, coils: Command::VENT.coils() }
    }

    /// What the valves see from a step with this command to the next step.
    pub fn step(&mut self, command: Command) -> Actuation {
        let to_wrap = self.period_steps - self.phase;
        let mut powered = self.powered(self.phase, self.phase + to_wrap.min(1.0));
        self.phase += 1.0;
        if to_wrap < 1.0 {
            self.coils = command.coils();
            self.phase -= self.period_steps;
            let rest = self.powered(0.0, self.phase);
            powered = (powered.0 + rest.0, powered.1 + rest.1);
        }
        Actuation { inlet: powered.0, outlet: 1.0 - powered.1 }
    }

    /// Steps for which each coil is powered between two phases of the running period.
    fn powered(&self, from: f64, to: f64) -> (f64, f64) {
        let overlap = |duty: Duty| {
            let on = self.period_steps * f64::from(duty.0) / f64::from(Duty::FULL.0);
            (to.min(on) - from.min(on)).max(0.0)
        };
        (overlap(self.coils.0), overlap(self.coils.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_period_has_its_duty_and_begins_half_a_step_late() {
        let command = Command { inlet: Duty(12_500), outlet: Duty(40_000) };
        let mut pwm = VirtualPwm::new(10);
        let steps: Vec<Actuation> = (0..30).map(|_| pwm.step(command)).collect();
        assert_eq!(steps[0], Actuation { inlet: 0.5, outlet: 0.5 });
        assert_eq!(steps[1], Actuation { inlet: 1.0, outlet: 0.0 });
        assert_eq!(steps[2].inlet, 1.0);
        assert_eq!(steps[3].inlet, 0.0);
        assert_eq!(steps[2], Actuation { inlet: 1.0, outlet: 0.5 });
        let inlet: f64 = steps[10..20].iter().map(|actuation| actuation.inlet).sum();
        let outlet: f64 = steps[10..20].iter().map(|actuation| actuation.outlet).sum();
        assert!((inlet - 2.5).abs() < 1e-12 && (outlet - 8.0).abs() < 1e-12, "{inlet} {outlet}");
    }

    #[test]
    fn full_and_zero_have_no_gaps() {
        let mut pwm = VirtualPwm::new(10);
        let open = Command { inlet: Duty::FULL, outlet: Duty::ZERO };
        pwm.step(open);
        for _ in 0..25 {
            assert_eq!(pwm.step(open), Actuation { inlet: 1.0, outlet: 0.0 });
        }
    }

    #[test]
    fn a_period_of_one_step_works() {
        let mut pwm = VirtualPwm::new(1);
        let half = Command { inlet: Duty(25_000), outlet: Duty::ZERO };
        pwm.step(half);
        assert_eq!(pwm.step(half).inlet, 0.5);
    }
}
