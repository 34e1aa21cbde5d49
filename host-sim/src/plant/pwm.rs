//! A fast switching valve behind a PWM output: latched duty, dead time, finite slew. Or behind a pin that
//! somebody else switches, of whom each step's share is known.

use crate::scenario::Valve;
use std::collections::VecDeque;

/// Times closer than this are the same: steps and periods are multiples of each other only up to
/// rounding \[s\].
const EDGE_TOLERANCE_S: f64 = 1e-9;
/// A pin that was high for more than this share of a step's end is high at its end: a counted time may miss by
/// some cycles.
const HIGH: f64 = 0.999;

/// The valve's opening under PWM.
///
/// As in the board's timer, a new duty takes effect at the next start of a period. The pin's
/// edges reach the poppet after the dead time; the poppet then moves at constant speed.
#[derive(Debug, Clone)]
pub struct PwmValve {
    period_s: f64,
    dead_time_s: f64,
    /// Share of the stroke per time \[1/s\]; infinite for an ideal valve.
    slew: f64,
    opening: f64,
    /// Pulses latched, oldest first; the first belongs to `oldest_period`.
    latched: VecDeque<Pulse>,
    oldest_period: u64,
    /// Whether a period is one step, of which the pin's share is given.
    follows_pin: bool,
}

/// When the pin is high, as shares of the period.
#[derive(Debug, Clone, Copy)]
struct Pulse {
    from: f64,
    until: f64,
}

impl PwmValve {
    /// A closed valve at time zero.
    pub fn new(valve: &Valve) -> Self {
        Self {
            period_s: 1.0 / valve.pwm_hz,
            dead_time_s: valve.dead_time_s,
            slew: 1.0 / valve.switch_time_s,
            opening: 0.0,
            latched: VecDeque::new(),
            oldest_period: 0,
            follows_pin: false,
        }
    }

    /// From time zero on, what is latched is the share of a step for which the pin was high.
    pub fn follow_pin(&mut self, step_s: f64) {
        self.period_s = step_s;
        self.follows_pin = true;
    }

    /// Latches `duty` for every period that starts before `end`, unless one is latched already.
    pub fn latch(&mut self, end_s: f64, duty: f64) {
        while self.oldest_start_s(self.latched.len()) < end_s - EDGE_TOLERANCE_S {
            let duty = duty.clamp(0.0, 1.0);
            // A pin that was low rises within the step and is high at its end; one that was high falls.
            let rises =
                self.follows_pin && self.latched.back().is_none_or(|last| last.until < HIGH);
            let from = if rises && duty > 0.0 { 1.0 - duty } else { 0.0 };
            self.latched.push_back(Pulse { from, until: from + duty });
        }
    }

    /// Start of the period that many after the oldest one latched \[s\].
    fn oldest_start_s(&self, periods_later: usize) -> f64 {
        (self.oldest_period + periods_later as u64) as f64 * self.period_s
    }

    /// Level of the pin as the poppet feels it at a time, and the time of the next edge.
    fn pin(&mut self, time_s: f64) -> (bool, f64) {
        let pin_time = time_s - self.dead_time_s;
        if pin_time < 0.0 {
            return (false, self.dead_time_s);
        }
        while self.latched.len() > 1 && self.oldest_start_s(1) <= pin_time + EDGE_TOLERANCE_S {
            self.latched.pop_front();
            self.oldest_period += 1;
        }
        let pulse = self.latched.front().copied().unwrap_or(Pulse { from: 0.0, until: 0.0 });
        let start = self.dead_time_s + self.oldest_start_s(0);
        let rise = start + pulse.from * self.period_s;
        let fall = start + pulse.until * self.period_s;
        if time_s < rise - EDGE_TOLERANCE_S {
            (false, rise)
        } else if time_s < fall - EDGE_TOLERANCE_S {
            (true, fall)
        } else {
            (false, start + self.period_s)
        }
    }

    /// Mean opening from `start` to `end` \[-\]; moves the poppet.
    pub fn advance(&mut self, start_s: f64, end_s: f64) -> f64 {
        let mut time = start_s;
        let mut integral = 0.0;
        while time < end_s {
            let (on, edge) = self.pin(time);
            // An edge within rounding of `time` must not stall the loop.
            let stop = edge.max(time + EDGE_TOLERANCE_S).min(end_s);
            integral += self.travel(on, stop - time);
            time = stop;
        }
        integral / (end_s - start_s)
    }

    /// Moves the poppet towards the pin's level; integral of the opening over `duration`.
    fn travel(&mut self, on: bool, duration: f64) -> f64 {
        let (target, distance) = if on { (1.0, 1.0 - self.opening) } else { (0.0, self.opening) };
        let needed = distance / self.slew;
        let start = self.opening;
        if needed <= duration {
            self.opening = target;
            0.5 * (start + target) * needed + target * (duration - needed)
        } else {
            self.opening += (target - start).signum() * self.slew * duration;
            0.5 * (start + self.opening) * duration
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn valve() -> Valve {
        Valve { switch_time_s: 0.002, dead_time_s: 0.001, pwm_hz: 100.0, ..Valve::default() }
    }

    /// Mean opening over the last ten of twenty periods, in steps of 1 ms.
    fn mean(settings: &Valve, duty: f64) -> f64 {
        let mut valve = PwmValve::new(settings);
        let mut sum = 0.0;
        for i in 0..200 {
            let (start, end) = (f64::from(i) * 0.001, f64::from(i + 1) * 0.001);
            valve.latch(end, duty);
            let opening = valve.advance(start, end);
            if i >= 100 {
                sum += opening / 100.0;
            }
        }
        sum
    }

    #[test]
    fn opening_equals_duty_when_the_stroke_is_complete() {
        // Opening and closing take the same time: what one edge loses the other gains.
        for duty in [0.25, 0.333, 0.5, 0.75] {
            assert!((mean(&valve(), duty) - duty).abs() < 1e-6, "duty {duty}");
        }
        assert_eq!(mean(&valve(), 0.0), 0.0);
        assert!((mean(&valve(), 1.0) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn short_pulses_open_partly() {
        // 1 ms of 10 ms reaches half of the stroke: a triangle, 1 ms up, 1 ms down, peak 0.5.
        assert!((mean(&valve(), 0.1) - 0.05).abs() < 1e-6);
        // An ideal valve has no such loss.
        let ideal = Valve { switch_time_s: 0.0, dead_time_s: 0.0, ..valve() };
        assert!((mean(&ideal, 0.1) - 0.1).abs() < 1e-6);
    }

    #[test]
    fn a_duty_waits_for_its_period_and_the_dead_time() {
        let mut valve = PwmValve::new(&valve());
        let mut opened = None;
        for i in 0..30 {
            let (start, end) = (f64::from(i) * 0.001, f64::from(i + 1) * 0.001);
            // Raised at 3 ms: the next period starts at 10 ms, the poppet moves from 11 ms.
            valve.latch(end, if i < 3 { 0.0 } else { 1.0 });
            if valve.advance(start, end) > 0.0 && opened.is_none() {
                opened = Some(i);
            }
        }
        assert_eq!(opened, Some(11));
    }

    /// A pulse from 3.25 to 7.5 ms: as long, and at the same time, as the pin was high.
    #[test]
    fn a_pin_is_followed_within_its_steps() {
        let ideal = Valve { switch_time_s: 0.0, dead_time_s: 0.0, ..valve() };
        let mut shares = [0.0; 12];
        shares[3..8].copy_from_slice(&[0.75, 1.0, 1.0, 1.0, 0.5]);
        let high = |follow: &dyn Fn(&mut PwmValve)| -> Vec<f64> {
            let mut valve = PwmValve::new(&ideal);
            follow(&mut valve);
            (0..48)
                .map(|quarter| {
                    let start_s = f64::from(quarter) * 0.25e-3;
                    valve.latch(
                        (f64::from(quarter / 4) + 1.0) * 0.001,
                        shares[quarter as usize / 4],
                    );
                    valve.advance(start_s, start_s + 0.25e-3)
                })
                .collect()
        };
        let open = high(&|valve| valve.follow_pin(0.001));
        for (quarter, open) in open.iter().enumerate() {
            let expected = f64::from((13..30).contains(&quarter));
            assert!((open - expected).abs() < 1e-4, "{quarter}: {open}");
        }
        // A PWM of its own knows nothing of this: it waits for its period.
        assert!(high(&|_| ()).iter().all(|open| *open < 1e-4));
    }
}
