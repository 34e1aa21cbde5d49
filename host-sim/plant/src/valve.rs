//! The valves of the plant `full`: either kind, behind the interface for an integrator.

use super::proportional::ProportionalValve;
use super::pwm::PwmValve;
use thermyo_scenario::{Valve, ValveKind};

#[derive(Debug, Clone)]
pub enum DrivenValve {
    Switching(PwmValve),
    Proportional(ProportionalValve),
}

impl DrivenValve {
    /// A closed valve at time zero.
    pub fn new(valve: &Valve) -> Self {
        match valve.kind {
            ValveKind::Switching => Self::Switching(PwmValve::new(valve)),
            ValveKind::Proportional => Self::Proportional(ProportionalValve::new(valve)),
        }
    }

    /// From time zero on, the latched value is the fraction of a step for which the pin was high.
    pub fn follow_pin(&mut self, step_s: f64) {
        match self {
            Self::Switching(valve) => valve.follow_pin(step_s),
            Self::Proportional(valve) => valve.follow_pin(step_s),
        }
    }

    /// Latches a command for every period that starts before `end`, unless the period has one
    /// already.
    pub fn latch(&mut self, end_s: f64, command: f64) {
        match self {
            Self::Switching(valve) => valve.latch(end_s, command),
            Self::Proportional(valve) => valve.latch(end_s, command),
        }
    }

    /// The opening's next kink after `time`, at most `until` \[s\].
    pub fn kink(&mut self, time_s: f64, until_s: f64) -> f64 {
        match self {
            Self::Switching(valve) => valve.kink(time_s, until_s),
            Self::Proportional(valve) => valve.kink(time_s, until_s),
        }
    }

    /// Opening at `start` and at `end` \[-\], linear in between if there is no kink; its mean is
    /// exact in any case. Moves the poppet.
    pub fn advance(&mut self, start_s: f64, end_s: f64) -> [f64; 2] {
        match self {
            Self::Switching(valve) => valve.advance(start_s, end_s),
            Self::Proportional(valve) => valve.advance(start_s, end_s),
        }
    }
}
