//! Pressure: the gas mass that brings the next period's end to the set point, from eq. (6) with the
//! estimated temperature and the measured speed.

use super::port::{Feedback, Port};
use crate::config::{Config, ControllerConfig};
use crate::math::{absolute, limit};

/// State of the pressure loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PressureLoop {
    /// Set point after the rate limit \[Pa\].
    reference_pa: f32,
    /// Flow that the loop has learnt to add: heat to the wall, a leak, a wrong conductance \[kg/s\].
    bias_kg_s: f32,
    holding: bool,
}

impl PressureLoop {
    /// A loop that starts from the measured pressure: nothing jumps.
    pub fn new(feedback: &Feedback) -> Self {
        Self { reference_pa: feedback.pressure_pa, bias_kg_s: 0.0, holding: false }
    }

    /// Whether the pressure is where it should be and the valves rest.
    pub fn holding(&self) -> bool {
        self.holding
    }

    /// Mass to move in the coming period \[kg\], positive into the muscle; `None` to rest.
    /// `volume_change_m3` is what the volume changed by over the last one.
    pub fn period(
        &mut self,
        config: &Config,
        feedback: &Feedback,
        port: &Port,
        volume_change_m3: f32,
        set_point_pa: f32,
    ) -> Option<f32> {
        let tuning: &ControllerConfig = &config.controller;
        let period_s = port.period_s;
        let most_pa = tuning.pressure_rate_pa_s * period_s;
        let set_point_pa =
            limit(set_point_pa, config.ambient.pressure_pa, config.pressure_limit_pa);
        let change_pa = limit(set_point_pa - self.reference_pa, -most_pa, most_pa);
        let moving = absolute(change_pa) > 0.0;
        self.reference_pa += change_pa;
        let error_pa = self.reference_pa - feedback.pressure_pa;
        // Hysteresis: rest within half of the dead zone, act again outside of it.
        let zone_pa = tuning.pressure_dead_zone_pa;
        let within_pa = if self.holding { zone_pa } else { 0.5 * zone_pa };
        self.holding = !moving && absolute(error_pa) <= within_pa && port.in_flight_kg == 0.0;
        if self.holding {
            return None;
        }
        let gain = limit(period_s / tuning.pressure_loop_s, 0.0, 1.0);
        // Anti-windup: nothing is learnt while the valve is fully open, nor from an error that
        // one period's flow would not close.
        let small = absolute(error_pa) < LEARNING_BAND * feedback.pressure_pa;
        let leak_kg = port.mass_kg(error_pa, 0.0);
        if small && !port.saturated {
            let limit_kg_s = LARGEST_BIAS * port.mass_kg(feedback.pressure_pa, 0.0);
            self.bias_kg_s = limit(
                self.bias_kg_s + leak_kg * gain / tuning.pressure_reset_s,
                -limit_kg_s,
                limit_kg_s,
            );
        }
        let wanted_kg = port.mass_kg(gain * error_pa, volume_change_m3) + self.bias_kg_s * period_s
            - port.in_flight_kg;
        Some(wanted_kg)
    }
}

/// Share of the pressure within which the bias learns \[-\].
const LEARNING_BAND: f32 = 0.05;
/// Largest bias: the gas that this share of the pressure is, per second \[1/s\].
const LARGEST_BIAS: f32 = 1.0;
