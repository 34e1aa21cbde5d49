//! A proportional valve: an analogue command, a dead band, and an opening that follows with a lag.
//!
//! A 2/2 seat valve: the preload of its spring takes the first part of the command, and the rest moves the poppet, with
//! the time constant 1/(2 pi f) of its bandwidth f. The lag's equation has a closed solution for a constant command, so
//! that no step is too long.

use std::collections::VecDeque;
use thermyo_compute::math;
use thermyo_scenario::Valve;

/// Times closer than this are the same \[s\].
const EDGE_TOLERANCE_S: f64 = 1e-9;
/// Share of the time constant over which an integrator takes the opening as linear: it deviates by 1/8 of the share's
/// square, 0.8 %, of the remaining way.
const STRAIGHT: f64 = 0.25;
/// Distance from the goal that counts as arrived \[-\].
const ARRIVED: f64 = 1e-4;

#[derive(Debug, Clone)]
pub struct ProportionalValve {
    /// Time for which a command is held \[s\].
    period_s: f64,
    dead_time_s: f64,
    dead_band: f64,
    lag_s: f64,
    opening: f64,
    /// Opening at rest for the command that the poppet feels.
    goal: f64,
    /// Commands that have not arrived: time of arrival \[s\] and goal.
    coming: VecDeque<(f64, f64)>,
    latched: u64,
}

impl ProportionalValve {
    /// A closed valve at time zero.
    pub fn new(valve: &Valve) -> Self {
        Self {
            period_s: 1.0 / valve.pwm_hz,
            dead_time_s: valve.dead_time_s,
            dead_band: valve.dead_band,
            lag_s: 1.0 / (std::f64::consts::TAU * valve.bandwidth_hz),
            opening: 0.0,
            goal: 0.0,
            coming: VecDeque::new(),
            latched: 0,
        }
    }

    /// From time zero on, a command is the mean of a pin over a step.
    pub fn follow_pin(&mut self, step_s: f64) {
        self.period_s = step_s;
    }

    /// Takes `command` for every period that starts before `end`, unless it has one already.
    pub fn latch(&mut self, end_s: f64, command: f64) {
        while self.latched as f64 * self.period_s < end_s - EDGE_TOLERANCE_S {
            let goal = ((command - self.dead_band) / (1.0 - self.dead_band)).clamp(0.0, 1.0);
            let arrival_s = self.latched as f64 * self.period_s + self.dead_time_s;
            if self.coming.back().map_or(self.goal, |last| last.1) != goal {
                self.coming.push_back((arrival_s, goal));
            }
            self.latched += 1;
        }
    }

    /// The next time at which the opening bends, at most `until` \[s\].
    pub fn kink(&self, time_s: f64, until_s: f64) -> f64 {
        let edge = self.coming.front().map_or(until_s, |next| next.0);
        let starts = edge <= time_s + EDGE_TOLERANCE_S;
        let (goal, edge) = match self.coming.front() {
            Some(next) if starts => (next.1, self.coming.get(1).map_or(until_s, |next| next.0)),
            _ => (self.goal, edge),
        };
        let moves = (goal - self.opening).abs() > ARRIVED;
        let straight = if moves { time_s + STRAIGHT * self.lag_s } else { until_s };
        let kink = edge.min(straight);
        if kink > time_s + EDGE_TOLERANCE_S && kink < until_s - EDGE_TOLERANCE_S {
            kink
        } else {
            until_s
        }
    }

    /// Opening at `start` and at `end` \[-\], between which a straight line has the exact mean. Moves the poppet.
    pub fn advance(&mut self, start_s: f64, end_s: f64) -> [f64; 2] {
        let (before, mean) = (self.opening, self.mean(start_s, end_s));
        if (before - self.opening).abs() < ARRIVED {
            return [mean; 2];
        }
        // The chord, shifted onto the mean.
        let shift = mean - 0.5 * (before + self.opening);
        [before + shift, self.opening + shift]
    }

    /// Mean opening from `start` to `end` \[-\]; moves the poppet.
    fn mean(&mut self, start_s: f64, end_s: f64) -> f64 {
        let (mut time, mut integral) = (start_s, 0.0);
        while let Some(&(arrival_s, goal)) = self.coming.front() {
            if arrival_s >= end_s - EDGE_TOLERANCE_S {
                break;
            }
            let stop = arrival_s.max(time);
            integral += self.travel(stop - time);
            self.goal = goal;
            self.coming.pop_front();
            time = stop;
        }
        integral += self.travel(end_s - time);
        integral / (end_s - start_s)
    }

    /// Follows the goal for some time; returns the integral of the opening.
    fn travel(&mut self, duration_s: f64) -> f64 {
        let off = self.opening - self.goal;
        let left = -math::expm1(-duration_s / self.lag_s);
        self.opening -= off * left;
        // A valve that is all but shut passes nothing.
        if self.goal == 0.0 && self.opening < ARRIVED {
            self.opening = 0.0;
        }
        self.goal * duration_s + off * self.lag_s * left
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn valve() -> ProportionalValve {
        ProportionalValve::new(&Valve {
            dead_band: 0.2,
            bandwidth_hz: 40.0,
            dead_time_s: 0.001,
            pwm_hz: 200.0,
            ..Valve::default()
        })
    }

    /// After a command of 0 for one step: 0.6 is half of the range beyond the dead band.
    #[test]
    fn a_step_is_followed_as_by_a_lag() {
        let lag_s = 1.0 / (std::f64::consts::TAU * 40.0);
        let mut valve = valve();
        let mut integral = 0.0;
        for step in 0..40 {
            let (mut time, until) = (f64::from(step) * 0.001, f64::from(step + 1) * 0.001);
            valve.latch(until, if step < 5 { 0.0 } else { 0.6 });
            while time < until {
                let end = valve.kink(time, until);
                let [from, to] = valve.advance(time, end);
                integral += 0.5 * (from + to) * (end - time);
                let after_s = (end - 0.006).max(0.0);
                let exact = -0.5 * math::expm1(-after_s / lag_s);
                assert!((valve.opening - exact).abs() < 1e-9, "{end} s: {}", valve.opening);
                assert!((to - exact).abs() < 0.005, "{end} s: {to} for {exact}");
                let way = 0.5 * (after_s + lag_s * math::expm1(-after_s / lag_s));
                assert!((integral - way).abs() < 1e-9, "{end} s: {integral} for {way}");
                time = end;
            }
        }
    }

    #[test]
    fn within_its_dead_band_it_stays_shut() {
        let mut valve = valve();
        for step in 0..100 {
            let start = f64::from(step) * 0.001;
            valve.latch(start + 0.001, 0.199);
            assert_eq!(valve.kink(start, start + 0.001), start + 0.001);
            assert_eq!(valve.advance(start, start + 0.001), [0.0; 2]);
        }
    }

    /// A sine at the bandwidth passes with 0.707 of its amplitude; each value is one command.
    #[test]
    fn at_its_bandwidth_it_has_lost_3_db() {
        let mut valve = valve();
        valve.follow_pin(1e-4);
        valve.dead_time_s = 0.0;
        let [mut least, mut most] = [1.0_f64, 0.0];
        for step in 0..5000 {
            let start = f64::from(step) * 1e-4;
            let wave = math::sin(std::f64::consts::TAU * 40.0 * start);
            valve.latch(start + 1e-4, 0.6 + 0.2 * wave);
            valve.mean(start, start + 1e-4);
            if step > 2500 {
                (least, most) = (least.min(valve.opening), most.max(valve.opening));
            }
        }
        let height = 0.5 * (most - least) / 0.25;
        assert!((height - 0.5_f64.sqrt()).abs() < 0.005, "{height}");
    }
}
