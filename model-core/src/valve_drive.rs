//! From a wanted mass flow to valve openings, one PWM period at a time.
//!
//! A valve does not follow a pulse shorter than its switching time. Mass that a period should have
//! moved and did not is carried to the next one: small flows become rare pulses of the shortest
//! length instead of none.

use crate::config::{Config, Reservoir};
use crate::math::limit;
use crate::sample::{Command, Duty};

/// State of the valve layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlowDrive {
    period_s: f32,
    /// Mass still to move, positive into the muscle \[kg\].
    owed_kg: f32,
}

impl FlowDrive {
    /// Nothing owed.
    pub fn new(config: &Config) -> Self {
        Self { period_s: f32::from(config.drive.period_steps) * config.step_s, owed_kg: 0.0 }
    }

    /// Forgets what is owed: a new set point starts clean.
    pub fn reset(&mut self) {
        self.owed_kg = 0.0;
    }

    /// Openings for the coming period that move `flow_kg_s` (negative: out) on average, with the
    /// muscle's gas at the given absolute pressure and temperature.
    pub fn period(&mut self, config: &Config, flow_kg_s: f32, muscle: Reservoir) -> Command {
        self.owed_kg += flow_kg_s * self.period_s;
        let filling = self.owed_kg > 0.0;
        let (upstream, downstream) =
            if filling { (config.supply, muscle) } else { (muscle, config.ambient) };
        let full_kg = self.period_s
            * config.valve.mass_flow_kg_s(
                &config.gas,
                upstream.pressure_pa,
                upstream.temperature_k,
                downstream.pressure_pa,
            );
        // What one open period cannot move is not owed for longer than one more.
        self.owed_kg = limit(self.owed_kg, -2.0 * full_kg, 2.0 * full_kg);
        let wanted_kg = if filling { self.owed_kg } else { -self.owed_kg };
        let share = if full_kg > 0.0 { limit(wanted_kg / full_kg, 0.0, 1.0) } else { 0.0 };
        if share <= 0.0 || share * self.period_s < config.drive.minimum_pulse_s {
            return Command::CLOSED;
        }
        let duty = Duty::from_share(share);
        let moved_kg = duty.share() * full_kg;
        if filling {
            self.owed_kg -= moved_kg;
            Command { inlet: duty, outlet: Duty::ZERO }
        } else {
            self.owed_kg += moved_kg;
            Command { inlet: Duty::ZERO, outlet: duty }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Whatever the flow, its mean arrives and the valves are never open together.
        #[test]
        fn the_mean_flow_arrives(flow in -3.0e-4_f32..3.0e-4, pressure in 1.3e5_f32..5.0e5) {
            let config = Config::default();
            let mut drive = FlowDrive::new(&config);
            let muscle = Reservoir { pressure_pa: pressure, temperature_k: 298.0 };
            let full = |up: Reservoir, down: Reservoir| config.valve.mass_flow_kg_s(
                &config.gas, up.pressure_pa, up.temperature_k, down.pressure_pa);
            let (inlet, outlet) = (full(config.supply, muscle), full(muscle, config.ambient));
            prop_assume!(flow > -0.9 * outlet);
            let mut moved = 0.0;
            let periods = 1000;
            for _ in 0..periods {
                let command = drive.period(&config, flow, muscle);
                prop_assert!(command.inlet == Duty::ZERO || command.outlet == Duty::ZERO);
                let pulse = command.inlet.max(command.outlet).share() * 0.01;
                prop_assert!(pulse == 0.0 || pulse >= 0.0019, "pulse of {pulse} s");
                moved += 0.01 * f64::from(
                    command.inlet.share() * inlet - command.outlet.share() * outlet);
            }
            let wanted = f64::from(flow) * 0.01 * f64::from(periods);
            // One shortest pulse may still be owed.
            let bound = 0.002 * f64::from(inlet.max(outlet)) + 1e-4 * wanted.abs();
            prop_assert!((moved - wanted).abs() <= bound, "{moved} for {wanted}");
        }
    }
}
