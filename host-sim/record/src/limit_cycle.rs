//! Detection of limit cycles: sustained oscillation of a controlled value around a constant set
//! point.

use serde::Serialize;
use std::collections::VecDeque;

/// Consecutive swings that make a limit cycle: five cycles.
const SWINGS: usize = 10;
/// Consecutive swings that make a limit cycle even if it ends by itself: twenty cycles.
const MANY_SWINGS: usize = 40;
/// Smallest ratio of the last swing to the first: below it the oscillation decays \[-\].
const LASTS: f64 = 0.7;
/// Frequency below which a value that one valve alone lifts or lowers counts as refilled: gas relaxes, or leaks \[Hz\].
const REFILLS_HZ: f64 = 10.0;
/// Longest half cycle in mean ones, unless it is shorter than a rest: jolts from outside are further apart
/// (assumption) \[-\].
const LONGEST_HALF: f64 = 2.5;
/// Time without a turning point after which a value counts as at rest: answers to a jolt have died away, valves that
/// make up for a leak pulse again sooner (assumption) \[s\].
const REST_S: f64 = 0.5;
/// Half cycles without a further turning point for which an oscillation still counts as lasting \[-\].
const LAST_HALVES: f64 = 4.0;

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LimitCycle {
    /// End of the cycle: that of the set point, unless it ended by itself \[s\].
    pub time_s: f64,
    /// Whether it lasted until the set point ended.
    pub lasts: bool,
    pub frequency_hz: f64,
    /// Amplitude: half of the distance between turning points, in the unit of the set point.
    pub amplitude: f64,
}

impl LimitCycle {
    /// Warning about a loop that does not come to rest: its amplitude in words, and the place of the causes.
    pub fn warning(&self, amplitude: &str, causes: &str) -> String {
        let Self { time_s, lasts, frequency_hz, .. } = *self;
        let until = if lasts {
            format!("until its set point ends at {time_s:.1} s, and does not come to rest")
        } else {
            format!("until {time_s:.1} s, and then dies down")
        };
        format!(
            "the loop swings at {frequency_hz:.1} Hz with an amplitude of {amplitude} {until}; {causes}, has the causes"
        )
    }
}

#[derive(Debug, Clone, Copy)]
struct Turn {
    time_s: f64,
    value: f64,
    /// Valves that have been driven since the turning point before: inlet, outlet.
    driven: [bool; 2],
}

/// Finds turning points that lie further apart than the smallest swing.
#[derive(Debug, Clone)]
pub struct Detector {
    least_swing: f64,
    set_point: f64,
    time_s: f64,
    /// Last turning point, or the extreme so far: time \[s\] and value.
    extreme: (f64, f64),
    rising: Option<bool>,
    /// Valves that have been driven since the last turning point: inlet, outlet.
    driven: [bool; 2],
    turns: VecDeque<Turn>,
    /// The limit cycle around the present set point.
    present: Option<LimitCycle>,
    /// The largest limit cycle of earlier set points.
    largest: Option<LimitCycle>,
}

impl Detector {
    /// Detector for a controller's dead zone: swings below its width do not count.
    pub fn new(dead_zone: f64) -> Self {
        Self {
            least_swing: 2.0 * dead_zone,
            set_point: f64::NAN,
            time_s: 0.0,
            extreme: (0.0, 0.0),
            rising: None,
            driven: [false; 2],
            turns: VecDeque::new(),
            present: None,
            largest: None,
        }
    }

    /// Takes the value \[any unit\] at a time \[s\], and the valves that are driven: inlet, outlet.
    pub fn add(&mut self, time_s: f64, set_point: f64, value: f64, driven: [bool; 2]) {
        if set_point != self.set_point {
            self.end_set_point();
            self.set_point = set_point;
            self.turns.clear();
            self.rising = None;
            self.driven = [false; 2];
            self.extreme = (time_s, value);
        }
        self.time_s = time_s;
        self.driven = either(self.driven, driven);
        let beyond = value - self.extreme.1;
        match self.rising {
            None if beyond.abs() > self.least_swing => {
                self.rising = Some(beyond > 0.0);
                self.extreme = (time_s, value);
            }
            None => {}
            Some(rising) => {
                let further = if rising { beyond } else { -beyond };
                if further >= 0.0 {
                    self.extreme = (time_s, value);
                } else if -further > self.least_swing {
                    let (time_s, value) = self.extreme;
                    let driven = std::mem::take(&mut self.driven);
                    self.turns.push_back(Turn { time_s, value, driven });
                    if self.turns.len() > MANY_SWINGS {
                        self.find(MANY_SWINGS, false);
                        self.turns.pop_front();
                    }
                    self.rising = Some(!rising);
                    self.extreme = (time_s, value);
                }
            }
        }
    }

    /// Ends the set point. A cycle that lasted until then counts.
    fn end_set_point(&mut self) {
        self.find(SWINGS, true);
        let Some(mut found) = self.present.take() else { return };
        if self.time_s - found.time_s <= LAST_HALVES * 0.5 / found.frequency_hz {
            found = LimitCycle { time_s: self.time_s, lasts: true, ..found };
        }
        if self.largest.is_none_or(|largest| found.amplitude > largest.amplitude) {
            self.largest = Some(found);
        }
    }

    /// Keeps the last `count` swings if they are a limit cycle that lasts until now.
    fn find(&mut self, count: usize, set_point_ends: bool) {
        let Some(skipped) = self.turns.len().checked_sub(count + 1) else { return };
        let turns: Vec<Turn> = self.turns.iter().skip(skipped).copied().collect();
        let half_s = (turns[count].time_s - turns[0].time_s) / count as f64;
        let swings: Vec<f64> =
            turns.windows(2).map(|pair| (pair[1].value - pair[0].value).abs()).collect();
        let swings_on = swings[count - 1] >= LASTS * swings[0];
        let longest_s =
            turns.windows(2).map(|pair| pair[1].time_s - pair[0].time_s).fold(0.0, f64::max);
        let periodic = longest_s <= REST_S.max(LONGEST_HALF * half_s);
        if !swings_on || !periodic || self.time_s - turns[count].time_s > LAST_HALVES * half_s {
            return;
        }
        let [inlet, outlet] =
            turns[1..].iter().fold([false; 2], |all, turn| either(all, turn.driven));
        if inlet != outlet && 0.5 / half_s < REFILLS_HZ {
            return;
        }
        let amplitude = 0.5 * swings.iter().sum::<f64>() / count as f64;
        let before = self.present.filter(|present| present.amplitude > amplitude);
        self.present = Some(LimitCycle {
            time_s: self.time_s,
            lasts: set_point_ends,
            frequency_hz: before.map_or(0.5 / half_s, |before| before.frequency_hz),
            amplitude: before.map_or(amplitude, |before| before.amplitude),
        });
    }

    /// The largest limit cycle at the end of a run.
    pub fn finish(mut self) -> Option<LimitCycle> {
        self.end_set_point();
        self.largest
    }
}

fn either([a, b]: [bool; 2], [c, d]: [bool; 2]) -> [bool; 2] {
    [a || c, b || d]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;
    use thermyo_compute::math;

    fn found(value: impl Fn(f64) -> f64, set_point: impl Fn(f64) -> f64) -> Option<LimitCycle> {
        found_in(2.0, value, set_point)
    }

    fn found_in(
        duration_s: f64,
        value: impl Fn(f64) -> f64,
        set_point: impl Fn(f64) -> f64,
    ) -> Option<LimitCycle> {
        let mut detector = Detector::new(0.1);
        for step in 0..(1000.0 * duration_s) as u32 {
            let time_s = 0.001 * f64::from(step);
            detector.add(time_s, set_point(time_s), value(time_s), [true; 2]);
        }
        detector.finish()
    }

    #[test]
    fn what_swings_on_is_found_with_its_frequency_and_amplitude() {
        let swing = |t: f64| 5.0 + 0.5 * math::sin(TAU * 19.0 * t);
        let cycle = found(swing, |_| 5.0).unwrap();
        assert!((cycle.frequency_hz - 19.0).abs() < 0.2, "{cycle:?}");
        assert!((cycle.amplitude - 0.5).abs() < 0.01 && cycle.lasts, "{cycle:?}");
        // The cycle ended with its set point, not with the run.
        let until = |t: f64| if t < 1.0 { swing(t) } else { 5.0 };
        let cycle = found(until, |t| if t < 1.0 { 5.0 } else { 6.0 }).unwrap();
        assert!((cycle.time_s - 0.999).abs() < 1e-9 && cycle.lasts, "{cycle:?}");
        // The cycle ended by itself, after 28 cycles.
        let cycle = found(|t| swing(t.min(1.5)), |_| 5.0).unwrap();
        assert!((cycle.amplitude - 0.5).abs() < 0.01 && cycle.time_s < 1.51, "{cycle:?}");
        assert!(!cycle.lasts, "{cycle:?}");
    }

    #[test]
    fn what_dies_away_or_is_small_or_follows_its_set_point_is_none() {
        let swing = |t: f64| math::sin(TAU * 19.0 * t);
        assert_eq!(found(|t| math::exp(-3.0 * t) * swing(t), |_| 0.0), None, "dies away");
        assert_eq!(found(|t| 0.09 * swing(t), |_| 0.0), None, "within the dead zone");
        assert_eq!(found(swing, swing), None, "follows");
        assert_eq!(found(|t| swing(t.min(1.0)), |_| 0.0), None, "has come to rest");
    }

    /// The angle of a joint at rest, in tenths of a dead zone, under load steps at 4, 8 and 12 s. Each was answered by
    /// swings that die away; together they were once a limit cycle of 0.4 Hz.
    #[test]
    fn answers_to_jolts_are_none() {
        const TURNS: [(f64, f64); 15] = [
            (0.0, 0.0),
            (0.03, -0.36),
            (0.075, 0.21),
            (0.12, -0.09),
            (4.0, 0.0),
            (4.065, 3.87),
            (4.145, 0.08),
            (4.18, 0.38),
            (4.25, -0.16),
            (8.0, 0.1),
            (8.075, -9.49),
            (8.155, -0.93),
            (8.195, -1.66),
            (12.07, 4.56),
            (12.2, 0.6),
        ];
        let angle = |t: f64| {
            let next = TURNS.iter().position(|turn| turn.0 > t).unwrap_or(TURNS.len());
            let (from, to) = (TURNS[next - 1], TURNS[next.min(TURNS.len() - 1)]);
            let share = if to.0 > from.0 { (t - from.0) / (to.0 - from.0) } else { 1.0 };
            from.1 + share * (to.1 - from.1)
        };
        assert_eq!(found_in(16.0, angle, |_| 0.0), None);
        // Unequal halves are no jolts.
        let unequal = |t: f64| if (t * 5.0).fract() < 0.1 { 1.0 } else { 0.0 };
        assert!(found_in(8.0, unequal, |_| 0.0).is_some());
    }

    /// A pressure that falls while its gas cools, or leaks, and that only the inlet lifts now and then. With a leak
    /// that needs a pulse in every other period it does not come to rest.
    #[test]
    fn what_one_valve_refills_now_and_then_is_none() {
        let found = |hz: f64, driven: fn(bool) -> [bool; 2]| {
            let mut detector = Detector::new(0.1);
            for step in 0..6000 {
                let time_s = 0.001 * f64::from(step);
                let phase = (time_s * hz).fract();
                detector.add(time_s, 5.0, 5.0 - phase, driven(phase < 0.1));
            }
            detector.finish().is_some()
        };
        let inlet = |lifts| [lifts, false];
        let both = |lifts: bool| [lifts, !lifts];
        assert_eq!([found(4.8, inlet), found(4.8, both), found(35.0, inlet)], [false, true, true]);
    }
}
