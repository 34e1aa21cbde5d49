//! A fast switching valve behind a PWM output, with latched duty, dead time and finite slew; or
//! behind a pin of a board, whose fraction of each step is known.
//!
//! The opening is linear between its kinks, so that an integrator that stops at each of them sees
//! only smooth motion.

use std::collections::VecDeque;
use thermyo_scenario::Valve;

/// Times closer than this are the same: steps and periods are multiples of each other only up to
/// rounding \[s\].
const EDGE_TOLERANCE_S: f64 = 1e-9;
/// A pin that goes low only beyond this fraction of a step is high at its end: a counted time may be off by some
/// cycles.
const HIGH: f64 = 0.999;
/// Pulses of shorter periods are averaged, because their kinks would cost too many steps \[s\].
const SHORTEST_PERIOD_S: f64 = 5.0e-4;

/// The valve's opening under PWM.
///
/// As in the board's timer, a new duty takes effect at the next start of a period. The pin's
/// edges reach the poppet after the dead time; the poppet then moves at constant speed.
#[derive(Debug, Clone)]
pub struct PwmValve {
    period_s: f64,
    dead_time_s: f64,
    /// Fraction of the stroke per time \[1/s\]; infinite for an ideal valve.
    slew: f64,
    opening: f64,
    /// Pulses latched, oldest first; the first belongs to `oldest_period`.
    latched: VecDeque<Pulse>,
    oldest_period: u64,
    /// Whether a period is one step with a given fraction of the pin.
    follows_pin: bool,
}

/// Times at which the pin is high, as fractions of the period.
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

    /// From time zero on, the latched value is the fraction of a step for which the pin was high.
    pub fn follow_pin(&mut self, step_s: f64) {
        self.period_s = step_s;
        self.follows_pin = true;
    }

    /// Latches `duty` for every period that starts before `end`, unless the period has a duty already.
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

    /// Start of the period with this index after the oldest latched one \[s\].
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

    /// The opening's next kink after `time`, at most `until` \[s\]: an edge that reaches the
    /// poppet, or the end of its stroke.
    pub fn kink(&mut self, time_s: f64, until_s: f64) -> f64 {
        if self.period_s < SHORTEST_PERIOD_S {
            return until_s;
        }
        let (on, edge) = self.pin(time_s);
        let arrival = time_s + (f64::from(u8::from(on)) - self.opening).abs() / self.slew;
        let arrives = arrival > time_s + EDGE_TOLERANCE_S && arrival < edge;
        let kink = if arrives { arrival } else { edge };
        // An edge within rounding of either end makes no separate interval.
        let within = kink > time_s + EDGE_TOLERANCE_S && kink < until_s - EDGE_TOLERANCE_S;
        if within { kink } else { until_s }
    }

    /// Opening at `start` and at `end` \[-\], linear in between if there is no kink; its mean is
    /// exact in any case. Moves the poppet.
    pub fn advance(&mut self, start_s: f64, end_s: f64) -> [f64; 2] {
        let mean = self.mean(start_s, end_s);
        if self.period_s < SHORTEST_PERIOD_S {
            return [mean; 2];
        }
        // For an ideal valve the start lies after its jump.
        [2.0 * mean - self.opening, self.opening]
    }

    /// Mean opening from `start` to `end` \[-\]; moves the poppet.
    fn mean(&mut self, start_s: f64, end_s: f64) -> f64 {
        let mut time = start_s;
        let mut integral = 0.0;
        while time < end_s {
            let (on, edge) = self.pin(time);
            // An edge within rounding of `time` must not stall the loop. An edge within rounding of the end belongs to
            // the next interval: otherwise an ideal valve would be shut at the end of a pulse.
            let early = edge < end_s - EDGE_TOLERANCE_S;
            let stop = if early { edge.max(time + EDGE_TOLERANCE_S) } else { end_s };
            integral += self.travel(on, stop - time);
            time = stop;
        }
        integral / (end_s - start_s)
    }

    /// Moves the poppet towards the pin's level; returns the integral of the opening over `duration`.
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
            let opening = valve.mean(start, end);
            if i >= 100 {
                sum += opening / 100.0;
            }
        }
        sum
    }

    #[test]
    fn opening_equals_duty_when_the_stroke_is_complete() {
        // Opening and closing take the same time, so that the losses of both edges cancel.
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
            if valve.mean(start, end) > 0.0 && opened.is_none() {
                opened = Some(i);
            }
        }
        assert_eq!(opened, Some(11));
    }

    /// 20 ms in intervals: the opening is linear from kink to kink, and continuous.
    #[test]
    fn between_kinks_the_opening_is_straight() {
        let mut valve = PwmValve::new(&valve());
        let (mut time, mut kinks, mut integral) = (0.0, Vec::new(), 0.0);
        for step in 1..=20 {
            let until = f64::from(step) * 0.001;
            valve.latch(until, 0.333);
            while time < until {
                let end = valve.kink(time, until);
                let before = valve.opening;
                let mut twin = valve.clone();
                let [from, to] = valve.advance(time, end);
                assert!((from - before).abs() < 1e-9 && to == valve.opening, "{from} for {before}");
                let middle = twin.mean(time, 0.5 * (time + end)) - 0.25 * (3.0 * from + to);
                assert!(middle.abs() < 1e-9, "at {time} s: {middle}");
                integral += 0.5 * (from + to) * (end - time);
                if end < until {
                    kinks.push(end);
                }
                time = end;
            }
        }
        // The pin falls 3.33 ms after it rises; the poppet feels it 1 ms later, and takes 2 ms.
        let expected = [0.00433, 0.00633, 0.01433, 0.01633];
        assert!(kinks.iter().zip(expected).all(|(kink, at)| (kink - at).abs() < 1e-9), "{kinks:?}");
        assert_eq!(kinks.len(), expected.len());
        assert!((integral - 0.00666).abs() < 1e-9, "{integral}");
    }

    #[test]
    fn an_ideal_valve_that_stays_open_is_open_all_the_time() {
        let ideal = Valve { switch_time_s: 0.0, dead_time_s: 0.0, ..valve() };
        let mut valve = PwmValve::new(&ideal);
        for step in 0..1000 {
            let (start, end) = (f64::from(step) * 0.001, f64::from(step + 1) * 0.001);
            valve.latch(end, 1.0);
            assert_eq!(valve.kink(start, end), end);
            assert_eq!(valve.advance(start, end), [1.0; 2], "step {step}");
        }
    }

    /// Ten periods in a step: no kinks, and the same share of the step.
    #[test]
    fn pulses_of_a_short_period_are_averaged() {
        let fast = Valve { switch_time_s: 0.0, dead_time_s: 0.0, pwm_hz: 10_000.0, ..valve() };
        let mut valve = PwmValve::new(&fast);
        valve.latch(0.001, 0.3);
        assert_eq!(valve.kink(0.0, 0.001), 0.001);
        let [from, to] = valve.advance(0.0, 0.001);
        assert!(from == to && (from - 0.3).abs() < 1e-5, "{from}, {to}");
    }

    /// A pulse from 3.25 to 7.5 ms: same duration and time as the pin was high.
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
                    valve.mean(start_s, start_s + 0.25e-3)
                })
                .collect()
        };
        let open = high(&|valve| valve.follow_pin(0.001));
        for (quarter, open) in open.iter().enumerate() {
            let expected = f64::from((13..30).contains(&quarter));
            assert!((open - expected).abs() < 1e-4, "{quarter}: {open}");
        }
        // A valve with its own PWM is unaffected: it waits for its period.
        assert!(high(&|_| ()).iter().all(|open| *open < 1e-4));
    }
}
