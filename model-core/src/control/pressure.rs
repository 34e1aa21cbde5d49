//! Pressure: the gas mass that brings the next period's end to the set point, from eq. (6) with the
//! estimated temperature and the measured speed.
//!
//! Gas that has just flowed in is warm, and the rest of a vented gas is cold. Left alone, its pressure drifts to that
//! at the wall's temperature, at constant gas mass and volume:
//!
//! ```text
//! P_end = m R T_wall/V = P T_wall/T        so that m* = P_ref V/(R T_wall) ends at the set point
//! ```
//!
//! The loop aims that far beyond the set point, but by no more than a share of its last step, and lets the pressure
//! relax as far on the other side before it acts again.

use super::chamber_port::{ChamberPort, Feedback};
use super::valve_drive::least_kg;
use crate::config::{Config, ControllerConfig};
use crate::math::{absolute, limit};
use crate::sample::Estimate;

/// State of the pressure loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PressureLoop {
    /// Set point after the rate limit \[Pa\].
    reference_pa: f32,
    /// Flow that the loop has learnt to add \[kg/s\]: for heat to the wall, a leak that is not configured, a wrong
    /// conductance.
    bias_kg_s: f32,
    /// Set point of the period before \[Pa\].
    set_point_pa: f32,
    /// Permitted distance of the pressure from the set point while the gas relaxes \[Pa\].
    band_pa: f32,
    /// Whether the set point has been reached since its last step.
    reached: bool,
    holding: bool,
}

impl PressureLoop {
    /// Creates a loop that starts from the measured pressure: nothing jumps.
    pub fn new(feedback: &Feedback) -> Self {
        Self {
            reference_pa: feedback.pressure_pa,
            bias_kg_s: 0.0,
            set_point_pa: feedback.pressure_pa,
            band_pa: 0.0,
            reached: false,
            holding: false,
        }
    }

    /// Whether the pressure is at its goal and the valves rest.
    pub fn holding(&self) -> bool {
        self.holding
    }

    /// Takes a step of the set point: a share of it is permitted as error while the gas relaxes.
    fn take_step(&mut self, set_point_pa: f32) {
        if set_point_pa != self.set_point_pa {
            self.band_pa = RELAXES * absolute(set_point_pa - self.set_point_pa);
            self.set_point_pa = set_point_pa;
            self.reached = false;
        }
    }

    /// Mass to move in the coming period \[kg\], positive into the muscle; `None` if the valves rest.
    /// `volume_change_m3` is the change of the volume over the last period.
    pub fn period(
        &mut self,
        config: &Config,
        feedback: &Feedback,
        port: &ChamberPort,
        volume_change_m3: f32,
        set_point_pa: f32,
    ) -> Option<f32> {
        let tuning: &ControllerConfig = &config.controller;
        let period_s = port.period_s;
        let most_pa = tuning.pressure_rate_pa_s * period_s;
        let set_point_pa =
            limit(set_point_pa, config.ambient.pressure_pa, config.pressure_limit_pa);
        self.take_step(set_point_pa);
        let change_pa = limit(set_point_pa - self.reference_pa, -most_pa, most_pa);
        let moving = absolute(change_pa) > 0.0;
        self.reference_pa += change_pa;
        let off_pa = absolute(self.reference_pa - feedback.pressure_pa);
        let beyond_pa = limit(falls_pa(feedback), -self.band_pa, self.band_pa);
        // On its way the pressure overshoots its goal a little: most of the band is left for that.
        let aims_pa = if self.reached { beyond_pa } else { 0.25 * beyond_pa };
        let error_pa = self.reference_pa + aims_pa - feedback.pressure_pa;
        // Hysteresis: rest within half of the dead zone, act again outside of it.
        let zone_pa = tuning.pressure_dead_zone_pa;
        let allowed_pa = limit(absolute(beyond_pa), zone_pa, f32::MAX);
        // A moving load, or a leak, takes the pressure beyond what single pulses can hold.
        self.reached &= !moving && off_pa <= LOST * allowed_pa;
        let within = if self.reached {
            arrives(port, self.reference_pa - feedback.pressure_pa, allowed_pa)
        } else {
            arrives(port, error_pa, 0.5 * zone_pa)
        };
        self.holding = within && !moving;
        if self.holding {
            self.reached = true;
            return None;
        }
        let all_kg = port.mass_kg(error_pa, volume_change_m3) - port.in_flight_kg;
        if self.reached {
            // A set point that has been reached is held by single pulses.
            return Some(worth_it(config, feedback, port, all_kg, all_kg));
        }
        let gain = limit(period_s / tuning.pressure_loop_s, 0.0, 1.0);
        self.learn(tuning, feedback, port, error_pa, gain);
        let wanted_kg = port.mass_kg(gain * error_pa, volume_change_m3)
            + self.bias_kg_s * period_s
            + port.leaked_kg
            - port.in_flight_kg;
        Some(worth_it(config, feedback, port, wanted_kg, all_kg))
    }

    /// Runs one period of the bias. Anti-windup: nothing is learnt while the valve is fully open, nor from an error
    /// that one period's flow would not close.
    fn learn(
        &mut self,
        tuning: &ControllerConfig,
        feedback: &Feedback,
        port: &ChamberPort,
        error_pa: f32,
        gain: f32,
    ) {
        let small = absolute(error_pa) < LEARNING_BAND * feedback.pressure_pa;
        if !small || port.saturated {
            return;
        }
        let most_kg_s = LARGEST_BIAS * port.mass_kg(feedback.pressure_pa, 0.0);
        let learns_kg_s = port.mass_kg(error_pa, 0.0) * gain / tuning.pressure_reset_s;
        self.bias_kg_s = limit(self.bias_kg_s + learns_kg_s, -most_kg_s, most_kg_s);
    }
}

/// Whether an error \[Pa\] will be within `within_pa` once the gas in flight has arrived.
fn arrives(port: &ChamberPort, error_pa: f32, within_pa: f32) -> bool {
    let left_kg = port.mass_kg(error_pa, 0.0) - port.in_flight_kg;
    absolute(left_kg) <= port.mass_kg(within_pa, 0.0)
}

/// Raises a mass below that of the shortest pulse to it, if that leaves less of the total error: otherwise the pressure
/// would stay where it is.
fn worth_it(
    config: &Config,
    feedback: &Feedback,
    port: &ChamberPort,
    wanted_kg: f32,
    all_kg: f32,
) -> f32 {
    let pulse_kg = ROUNDED * least_kg(config, port.period_s, all_kg, feedback.muscle());
    let too_little = absolute(wanted_kg) < pulse_kg && pulse_kg < 2.0 * absolute(all_kg);
    match too_little {
        true if all_kg > 0.0 => pulse_kg,
        true => -pulse_kg,
        false => wanted_kg,
    }
}

/// Fall of the pressure \[Pa\] until the gas has the temperature of the wall.
fn falls_pa(feedback: &Feedback) -> f32 {
    let Estimate { gas_k, wall_k, .. } = feedback.estimate;
    feedback.pressure_pa * (gas_k - wall_k) / gas_k
}

/// Share of a step of the set point by which the pressure may be off while the gas relaxes \[-\]: within the 2 % that
/// usually count as settled.
const RELAXES: f32 = 0.015;
/// Multiple of the permitted error beyond which the set point has to be reached again.
const LOST: f32 = 2.0;
/// Factor that keeps the shortest pulse from being lost to rounding \[-\].
const ROUNDED: f32 = 1.001;
/// Share of the pressure within which the bias learns \[-\].
const LEARNING_BAND: f32 = 0.05;
/// Largest bias: this share of the pressure, as gas, per second \[1/s\].
const LARGEST_BIAS: f32 = 1.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::valve_drive::OpenFlow;
    use crate::sample::Estimate;

    /// 0.18 l of air at 298 K: mass per pascal by eq. (6) without motion \[kg/Pa\].
    const VOLUME_M3: f32 = 1.8e-4;
    const KG_PER_PA: f32 = VOLUME_M3 / (1.4 * 287.05 * 298.0);
    /// Share of an error that a period of 10 ms closes, the loop's time being 14 ms.
    const GAIN: f32 = 0.01 / 0.014;

    fn feedback(pressure_pa: f32) -> Feedback {
        let estimate = Estimate { gas_k: 298.0, wall_k: 298.0, ..Estimate::default() };
        Feedback { pressure_pa, length_m: 0.27, length_wide_m: 0.0, length_lost: false, estimate }
    }

    fn port(pressure_pa: f32) -> ChamberPort {
        ChamberPort::of_air(pressure_pa, VOLUME_M3)
    }

    /// Pressure change of one period at this pressure \[Pa\] for a set point.
    fn moved_pa(active: &mut PressureLoop, port: &ChamberPort, set_point_pa: f32) -> Option<f32> {
        active
            .period(&Config::default(), &feedback(port.pressure_pa), port, 0.0, set_point_pa)
            .map(|kg| kg / KG_PER_PA)
    }

    fn close(moved_pa: Option<f32>, expected_pa: f32) {
        let moved_pa = moved_pa.unwrap();
        assert!((moved_pa - expected_pa).abs() < 20.0, "{moved_pa} Pa, expected {expected_pa}");
    }

    /// Beyond 5 % of the pressure, or with the valve fully open, nothing is learnt.
    #[test]
    fn a_period_closes_its_share_of_the_error() {
        let started = PressureLoop::new(&feedback(3.0e5));
        for error_pa in [-4.0e4, -1.6e4, 1.6e4, 4.0e4] {
            close(moved_pa(&mut started.clone(), &port(3.0e5), 3.0e5 + error_pa), GAIN * error_pa);
        }
        let saturated = ChamberPort { saturated: true, ..port(3.0e5) };
        let mut active = started;
        for _ in 0..10 {
            close(moved_pa(&mut active, &saturated, 3.1e5), GAIN * 1.0e4);
        }
        let in_flight = ChamberPort { in_flight_kg: 3000.0 * KG_PER_PA, ..port(3.0e5) };
        close(moved_pa(&mut started.clone(), &in_flight, 3.2e5), GAIN * 2.0e4 - 3000.0);
        assert!(moved_pa(&mut started.clone(), &in_flight, 3.0e5).is_some(), "it will be beyond");
        let arrives = ChamberPort { in_flight_kg: 3000.0 * KG_PER_PA, ..port(2.97e5) };
        assert_eq!(moved_pa(&mut started.clone(), &arrives, 3.0e5), None, "it will be there");
        // The growth of the volume is filled: k P dV/V.
        let moved_kg = started.clone().period(
            &Config::default(),
            &feedback(3.0e5),
            &port(3.0e5),
            1.8e-6,
            3.2e5,
        );
        close(moved_kg.map(|kg| kg / KG_PER_PA), GAIN * 2.0e4 + 1.4 * 3.0e5 * 0.01);
    }

    /// A valve whose shortest pulse moves 4 kPa: the pulse is given if more than half of that is missing.
    #[test]
    fn an_error_worth_a_pulse_gets_one() {
        let mut config = Config::default();
        let full_kg = 0.01 * OpenFlow::new(&config, 1.0, feedback(3.0e5).muscle()).kg_s;
        // Shorter than the stroke: w^2/t_s.
        let opening_s = 0.01 * 4000.0 * KG_PER_PA / full_kg;
        config.controller.minimum_pulse_s = (opening_s * config.valve.switch_time_s).sqrt();
        assert!(config.controller.minimum_pulse_s < config.valve.switch_time_s);
        for (error_pa, expected_pa) in [(1900.0, GAIN * 1900.0), (2100.0, 4004.0), (3900.0, 4004.0)]
        {
            let mut active = PressureLoop::new(&feedback(3.0e5));
            let asked =
                active.period(&config, &feedback(3.0e5), &port(3.0e5), 0.0, 3.0e5 + error_pa);
            let moved_pa = asked.unwrap() / KG_PER_PA;
            // The bias begins to learn: a thirtieth of the share.
            assert!((moved_pa / expected_pa - 1.0).abs() < 0.04, "{moved_pa} Pa for {error_pa} Pa");
        }
    }

    /// A leak: the error stays, and in every period the loop adds its share over the reset time, up to the mass of the
    /// gas per second.
    #[test]
    fn a_lasting_error_is_learnt_up_to_a_limit() {
        for error_pa in [-1.4e4, 1.4e4] {
            let mut active = PressureLoop::new(&feedback(3.0e5));
            let learnt_pa = GAIN * error_pa * 0.01 / 0.3;
            for periods in [1.0, 2.0, 3.0] {
                let moved_pa = moved_pa(&mut active, &port(3.0e5), 3.0e5 + error_pa);
                close(moved_pa, GAIN * error_pa + periods * learnt_pa);
            }
            for _ in 0..100 {
                moved_pa(&mut active, &port(3.0e5), 3.0e5 + error_pa);
            }
            let most_pa = 3.0e5 * 0.01 * error_pa.signum();
            close(moved_pa(&mut active, &port(3.0e5), 3.0e5 + error_pa), GAIN * error_pa + most_pa);
        }
    }

    #[test]
    fn a_configured_leak_is_made_up_for_at_once() {
        let leaking = ChamberPort { leaked_kg: 500.0 * KG_PER_PA, ..port(3.0e5) };
        for error_pa in [-1.0e4, 1.0e4] {
            let mut active = PressureLoop::new(&feedback(3.0e5));
            let learnt_pa = GAIN * error_pa * 0.01 / 0.3;
            let moved_pa = moved_pa(&mut active, &leaking, 3.0e5 + error_pa);
            close(moved_pa, GAIN * error_pa + learnt_pa + 500.0);
        }
    }

    /// 1e7 Pa/s are 1 bar in a period; the set point goes neither below the ambient pressure nor above the limit.
    #[test]
    fn the_set_point_is_approached_at_its_rate_and_within_its_bounds() {
        for (start_pa, goal_pa, ways_pa) in [
            (3.0e5, 5.5e5, [1.0e5, 2.0e5, 2.5e5]),
            (5.5e5, 3.0e5, [-1.0e5, -2.0e5, -2.5e5]),
            (2.0e5, 0.0, [101_325.0 - 2.0e5; 3]),
            (6.2e5, 9.0e5, [689_500.0 - 6.2e5; 3]),
        ] {
            let mut active = PressureLoop::new(&feedback(start_pa));
            for way_pa in ways_pa {
                close(moved_pa(&mut active, &port(start_pa), goal_pa), GAIN * way_pa);
            }
        }
    }

    /// The loop first rests within half of its dead zone of 15 mbar, and gives a pulse beyond the whole zone.
    #[test]
    fn a_set_point_that_moves_is_followed_within_the_dead_zone_too() {
        let mut active = PressureLoop::new(&feedback(3.0e5));
        assert_eq!(moved_pa(&mut active, &port(3.0e5), 3.0e5), None);
        assert!(active.holding());
        assert!(moved_pa(&mut active, &port(3.0e5), 3.005e5).is_some(), "it has moved");
        assert!(!active.holding());
        assert_eq!(moved_pa(&mut active, &port(3.0e5), 3.005e5), None);
        for (pressure_pa, holds) in
            [(2.9905e5, true), (2.9895e5, false), (2.997e5, true), (2.998e5, true)]
        {
            moved_pa(&mut active, &port(pressure_pa), 3.005e5);
            assert_eq!(active.holding(), holds, "at {pressure_pa} Pa");
        }
    }

    /// Gas that has reached the set point is warm, or cold: 10 K of 298 are 3.2 % of the pressure, by which it would
    /// drift to the wall's temperature, and 1.5 % of a step of 2 bar are permitted for it, to either side.
    #[test]
    fn gas_that_relaxes_is_let_pass_the_set_point() {
        for side in [-1.0_f32, 1.0] {
            let goal_pa = 4.0e5;
            let start_pa = goal_pa - side * 2.0e5;
            let mut now = feedback(start_pa);
            now.estimate.gas_k = 298.0 + side * 10.0;
            let mut active = PressureLoop::new(&now);
            let mut at = |off_pa: f32, relaxes: bool| {
                now.estimate.gas_k = if relaxes { 298.0 + side * 10.0 } else { 298.0 };
                now.pressure_pa = goal_pa + side * off_pa;
                let port = port(now.pressure_pa);
                let asked = active.period(&Config::default(), &now, &port, 0.0, goal_pa);
                asked.map(|kg| side * kg / KG_PER_PA)
            };
            // At 1 bar a period, it is on its way for two periods; then 0.75 kPa beyond the set point is the goal.
            assert!(at(-2.0e5, true).is_some() && at(-1.0e5, true).is_some());
            assert!(at(-100.0, true).is_some(), "not yet there");
            for off_pa in [750.0, 2900.0, 0.0, -2900.0] {
                assert_eq!(at(off_pa, true), None, "{off_pa} Pa");
            }
            // One pulse takes it to the other side.
            let moved_pa = at(-3100.0, true).unwrap();
            assert!((moved_pa - 6100.0).abs() < 20.0, "{moved_pa} Pa");
            assert_eq!(at(2900.0, true), None);
            // Once the gas is as warm as the wall, only the dead zone is left.
            assert_eq!(at(-1400.0, false), None);
            assert!((at(-1600.0, false).unwrap() - 1600.0).abs() < 20.0);
            // A pressure far off is brought back.
            let moved_pa = at(-8.0e3, true).unwrap();
            assert!((6.0e3..9.0e3).contains(&moved_pa), "{moved_pa} Pa");
        }
    }
}
