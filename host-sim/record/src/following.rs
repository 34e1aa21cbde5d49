//! How a value follows its set point, gathered step by step: pressure and contraction of a muscle, angle of a joint.

use crate::bandwidth::Bandwidth;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use thermyo_compute::math;
use thermyo_files::number::significant;
use thermyo_scenario::{Chirp, Shape};

/// An error within this fraction of a jump counts as settled, as in `thermyo tune` \[-\].
const SETTLED: f64 = 0.05;
/// Hold that counts: a board gets its set points some steps early, the one of the run's last step too \[s\].
const LEAST_HOLD_S: f64 = 0.01;

/// Errors against a set point, in its unit. Those of a shape count after its first period, in which the value reaches the
/// shape's start.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Followed {
    /// Root-mean-square error.
    pub rms_error: f64,
    /// Mean error over the last tenth of the run, or from the time at which the last jump within it has settled; none
    /// if the run ended before.
    pub steady_error: Option<f64>,
    /// Largest excess over the largest set point, or below the smallest one if the set point falls, relative to the set
    /// point's range, or to the way to the first one if that is longer; for a constant set point, relative to the set
    /// point, and none if that is 0.
    pub overshoot: Option<f64>,
    /// Amplitude of the value over that of a sine of the set point, after its first period \[-\].
    pub gain: Option<f64>,
    /// Phase of the value against that sine; negative if it lags \[deg\].
    pub phase_deg: Option<f64>,
    /// Frequency up to which the gain of a chirp stays above -3 dB, at most the chirp's highest \[Hz\]; none for other
    /// shapes.
    pub bandwidth_hz: Option<f64>,
    /// Longest time from a jump of the set point until the error stays within 5 % of the jump, or within twice the
    /// controller's dead zone \[s\]; none if a jump never settled, or there was none.
    pub settled_s: Option<f64>,
    /// Jumps after which the value did not settle before the next one.
    pub unsettled: u64,
}

impl Followed {
    /// Overshoot, and the figures of a sine, a chirp or jumps, each after a comma.
    pub fn shape_text(&self) -> String {
        let mut line = String::new();
        if let Some(overshoot) = self.overshoot {
            line += &format!(", overshoot {:.1} %", overshoot * 100.0);
        }
        if let (Some(gain), Some(phase_deg)) = (self.gain, self.phase_deg) {
            line += &format!(", gain {}, phase {phase_deg:.0} deg", significant(gain, 3));
        }
        if let Some(hz) = self.bandwidth_hz {
            line += &format!(", gain above -3 dB up to {} Hz", significant(hz, 2));
        }
        if let Some(settled_s) = self.settled_s {
            line += &format!(", settled in {} s", significant(settled_s, 3));
        }
        if self.unsettled > 0 {
            let jumps = if self.unsettled == 1 { "jump" } else { "jumps" };
            line += &format!(", not settled after {} {jumps}", self.unsettled);
        }
        line
    }

    /// Name, value and unit of these figures, for a report.
    pub fn shape_figures(&self) -> Vec<(&'static str, f64, &'static str)> {
        let of_shape = [
            ("Set point, overshoot", self.overshoot.map(|share| 100.0 * share), "%"),
            ("Sine, gain", self.gain, ""),
            ("Sine, phase", self.phase_deg, "deg"),
            ("Chirp, gain above -3 dB up to", self.bandwidth_hz, "Hz"),
            ("Steps, settled in", self.settled_s, "s"),
        ];
        let found = of_shape.into_iter();
        found.filter_map(|(name, value, unit)| Some((name, value?, unit))).collect()
    }
}

/// A shape of the set point, which decides on the figures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reference {
    sine_s: Option<f64>,
    /// A chirp, and the set point about which it swings.
    chirp: Option<(Chirp, f64)>,
    /// Whether the set point jumps and is constant in between.
    jumps: bool,
    /// Error that the controller tolerates at rest, in the set point's unit.
    dead_zone: f64,
    step_s: f64,
    duration_s: f64,
    from_s: f64,
}

impl Reference {
    /// A shape of this period \[s\] about this set point, none for a table, in a run of steps and a duration \[s\].
    pub fn new(
        shape: Option<Shape>,
        (middle, period_s): (f64, f64),
        dead_zone: f64,
        [step_s, duration_s]: [f64; 2],
    ) -> Self {
        let is = |one| shape == Some(one);
        let moves = shape.is_some_and(|shape| shape != Shape::Constant);
        Self {
            sine_s: is(Shape::Sine).then_some(period_s),
            chirp: is(Shape::Chirp).then(|| (Chirp::new(period_s, duration_s), middle)),
            jumps: [Shape::Constant, Shape::Step, Shape::Staircase].into_iter().any(is),
            dead_zone,
            step_s,
            duration_s,
            from_s: if moves && duration_s >= 2.0 * period_s { period_s } else { 0.0 },
        }
    }

    /// Whole periods of the sine, without the first one \[s\].
    fn counted_s(&self) -> Option<[f64; 2]> {
        let period_s = self.sine_s?;
        let periods = (self.duration_s / period_s + 1e-9).floor();
        (periods >= 2.0).then_some([period_s, periods * period_s])
    }
}

#[derive(Debug, Clone, Copy)]
struct Jump {
    at_s: f64,
    band: f64,
    /// Time at which the error was last beyond the band \[s\].
    beyond_s: f64,
}

/// The figures while a run goes on, in constant memory.
#[derive(Debug, Clone)]
pub struct Following {
    reference: Reference,
    steps: u64,
    squares: f64,
    late_steps: u64,
    late_sum: f64,
    set_points: [f64; 2],
    /// Smallest value since a value was first at or above the set point; largest since a value was first at or below
    /// it.
    values: [f64; 2],
    /// Way from the first value to the first set point.
    way: f64,
    /// Whether the set point was below the first value, or below an earlier set point.
    falls: bool,
    /// Sums of set point and value with sine and cosine.
    sums: [[f64; 2]; 2],
    bandwidth: Option<Bandwidth>,
    before: Option<f64>,
    jump: Option<Jump>,
    settled_s: Option<f64>,
    unsettled: u64,
    last_s: f64,
}

impl Following {
    pub fn new(reference: Reference) -> Self {
        Self {
            reference,
            steps: 0,
            squares: 0.0,
            late_steps: 0,
            late_sum: 0.0,
            set_points: [f64::INFINITY, f64::NEG_INFINITY],
            values: [f64::INFINITY, f64::NEG_INFINITY],
            way: 0.0,
            falls: false,
            sums: [[0.0; 2]; 2],
            bandwidth: reference.chirp.map(Bandwidth::new),
            before: None,
            jump: None,
            settled_s: None,
            unsettled: 0,
            last_s: 0.0,
        }
    }

    /// Takes a step; `vents` is whether the valves vent in it. Returns whether the step counts.
    pub fn add(&mut self, time_s: f64, [set_point, value]: [f64; 2], vents: bool) -> bool {
        if time_s < self.reference.from_s - 0.5 * self.reference.step_s {
            self.before = Some(set_point);
            return false;
        }
        let error = value - set_point;
        if self.steps == 0 {
            self.way = error.abs();
        }
        let [least, most] = self.set_points;
        self.falls |= set_point < most || (self.steps == 0 && error > 0.0);
        self.set_points = [least.min(set_point), most.max(set_point)];
        let [low, high] = self.values;
        if !vents && (error >= 0.0 || low.is_finite()) {
            self.values[0] = low.min(value);
        }
        if error <= 0.0 || high.is_finite() {
            self.values[1] = high.max(value);
        }
        self.steps += 1;
        self.squares += error * error;
        self.add_sine(time_s, [set_point, value]);
        if let Some(bandwidth) = &mut self.bandwidth {
            bandwidth.add(time_s, [set_point, value]);
        }
        if self.reference.jumps {
            self.add_jump(time_s, set_point, value);
        }
        self.add_late(time_s, error);
        self.last_s = time_s;
        true
    }

    fn add_sine(&mut self, time_s: f64, values: [f64; 2]) {
        let (Some(period_s), Some([from_s, to_s])) =
            (self.reference.sine_s, self.reference.counted_s())
        else {
            return;
        };
        // The end of the last period is the start of the next.
        if time_s < from_s - 0.5 * self.reference.step_s
            || time_s > to_s - 0.5 * self.reference.step_s
        {
            return;
        }
        let angle = TAU * time_s / period_s;
        let parts = [math::sin(angle), math::cos(angle)];
        for (sums, value) in self.sums.iter_mut().zip(values) {
            for (sum, part) in sums.iter_mut().zip(parts) {
                *sum += value * part;
            }
        }
    }

    fn add_jump(&mut self, time_s: f64, set_point: f64, value: f64) {
        let before = self.before.replace(set_point).unwrap_or(value);
        if set_point != before {
            self.end_jump();
            let band = (SETTLED * (set_point - before).abs()).max(2.0 * self.reference.dead_zone);
            self.jump = Some(Jump { at_s: time_s, band, beyond_s: time_s });
        }
        if let Some(jump) = &mut self.jump
            && (value - set_point).abs() > jump.band
        {
            jump.beyond_s = time_s;
        }
    }

    fn add_late(&mut self, time_s: f64, error: f64) {
        let late_s = 0.9 * self.reference.duration_s;
        if time_s < late_s {
            return;
        }
        let settles =
            self.jump.as_ref().is_some_and(|jump| jump.at_s >= late_s && jump.beyond_s == time_s);
        if settles {
            (self.late_steps, self.late_sum) = (0, 0.0);
        } else {
            self.late_steps += 1;
            self.late_sum += error;
        }
    }

    fn end_jump(&mut self) {
        let Some(Jump { at_s, beyond_s, .. }) = self.jump.take() else { return };
        if self.last_s - at_s < LEAST_HOLD_S {
            // At the end of the run there is no time to settle.
        } else if beyond_s >= self.last_s {
            self.unsettled += 1;
        } else {
            let settled_s = beyond_s - at_s;
            self.settled_s = Some(self.settled_s.map_or(settled_s, |most| most.max(settled_s)));
        }
    }

    /// Number of steps that count.
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// The figures so far; none before the first step that counts.
    pub fn figures(&self) -> Option<Followed> {
        if self.steps == 0 {
            return None;
        }
        let mut ended = self.clone();
        ended.end_jump();
        let steps = self.steps as f64;
        let [least, most] = self.set_points;
        let span = if most > least { (most - least).max(self.way) } else { most.abs() };
        let [low, high] = self.values;
        let below = if self.falls { least - low } else { 0.0 };
        let [[set_sin, set_cos], [sin, cos]] = self.sums;
        let size = math::hypot(set_sin, set_cos);
        let phase = math::atan2(cos, sin) - math::atan2(set_cos, set_sin);
        let sine = size > 0.0;
        Some(Followed {
            rms_error: (self.squares / steps).sqrt(),
            steady_error: (self.late_steps > 0).then(|| self.late_sum / self.late_steps as f64),
            overshoot: (span > 0.0).then(|| ((high - most).max(below) / span).max(0.0)),
            gain: sine.then(|| math::hypot(sin, cos) / size),
            phase_deg: sine.then(|| wrapped(phase).to_degrees()),
            bandwidth_hz: self.bandwidth.as_ref().and_then(Bandwidth::hz),
            settled_s: ended.settled_s.filter(|_| ended.unsettled == 0),
            unsettled: ended.unsettled,
        })
    }
}

/// An angle from -pi to pi.
fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A board's set points are two steps early: the jump of the last step used to count as unsettled, which hid the time
    /// of the others.
    #[test]
    fn a_jump_at_the_end_does_not_count() {
        let followed = |end_ms: u32| {
            let reference = Reference::new(Some(Shape::Staircase), (0.0, 4.0), 0.0, [0.001, 1.0]);
            let mut following = Following::new(reference);
            for ms in 0..=end_ms {
                let set_point = |ms: u32| f64::from((ms + 2) / 500);
                let angle = set_point(ms.saturating_sub(100));
                following.add(0.001 * f64::from(ms), [set_point(ms), angle], false);
            }
            following.figures().unwrap()
        };
        let at_end = followed(1000);
        assert_eq!((at_end.unsettled, at_end.settled_s.is_some()), (0, true), "{at_end:?}");
        let later = followed(1050);
        assert!(later.shape_text().ends_with(", not settled after 1 jump"), "{later:?}");
    }
}
