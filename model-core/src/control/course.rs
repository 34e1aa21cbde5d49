//! The course of a set point between its values.
//!
//! A host sends values at its own rate, some 20 to 200 times a second; a loop acts at the starts of its own periods. In
//! a period the last value would change by none, one or two intervals of the host, and the speed of the set point would
//! jump accordingly. A value therefore counts from the step in which it came, and continues from there at the speed
//! since the previous value until the next one is due.
//!
//! Values that come irregularly, because a host or its line is busy, were meant for other times. Only half of the
//! change in each is then taken, and it continues for another half interval.
//!
//! A joint accelerates more within an interval than a muscle with a load does. Its course bends: a value continues with
//! speed and acceleration, both from a filter whose memory fades. A value that follows a rest has neither, and a value
//! that the joint could not have reached by its acceleration leaves the speed unchanged: both are steps. A course
//! without further values stops after one interval, or slows down within another half if values come irregularly.

use crate::math::{absolute, limit};

/// Longest interval between two values of a moving set point \[s\]: 20 values a second.
const LONGEST_S: f32 = 0.05;
/// Longest interval for a course that bends: values that come 20 times a second may be 5 ms late.
const LONGEST_BENT_S: f32 = 0.055;
/// Interval whose value has half the weight in the filter of a course that bends: the longer the interval, the less it
/// matters that a value is some milliseconds late \[s\].
const HALF_S: f32 = 0.011;
/// Share of its speed by which a late value may seem faster or slower.
const LATE: f32 = 1.0;
/// Share of the change in an irregular value, and in its speed, that is taken. Simulated with 10 and 20 kg on a sine of
/// 13.5 mm, values up to 1, 3 and 8 ms late, four seeds: 0.23, 0.31 and 0.65 mm off; taking all of it leaves 0.28, 0.53
/// and 1.09 mm, three tenths with a tenth of the speed 0.8 mm.
const NEW: f32 = 0.5;
/// Number of values that count as irregular after one at another interval.
const IRREGULAR: u8 = 20;

/// Timing of the loop that the course serves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// Steps in the loop's period, and their reciprocal.
    period_steps: u16,
    per_steps: f32,
    /// Steps within which a moving set point has another value.
    longest_steps: u16,
    /// Bend of the course; `None` for a straight one.
    bends: Option<Bends>,
}

/// Limits of a course that bends.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Bends {
    /// Square of the interval whose value has half the weight, in periods.
    half_squared: f32,
    /// Largest change, per period, of the change in a period.
    most: f32,
}

impl Pace {
    /// Pace of a straight course in steps of `step_s`.
    pub fn new(period_steps: u16, step_s: f32) -> Self {
        Self::within(LONGEST_S, period_steps, step_s)
    }

    /// Pace of a course that bends in steps of `step_s`, for a set point that accelerates by up to `most_per_s2`.
    pub fn bending(period_steps: u16, step_s: f32, most_per_s2: f32) -> Self {
        let period_s = f32::from(period_steps) * step_s;
        let half = HALF_S / period_s;
        let bends = Bends { half_squared: half * half, most: most_per_s2 * period_s * period_s };
        Self { bends: Some(bends), ..Self::within(LONGEST_BENT_S, period_steps, step_s) }
    }

    fn within(longest_s: f32, period_steps: u16, step_s: f32) -> Self {
        Self {
            period_steps,
            per_steps: 1.0 / f32::from(period_steps),
            // A cast saturates.
            longest_steps: ((longest_s / step_s + 0.5) as u16).max(period_steps),
            bends: None,
        }
    }
}

/// Set point of a period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Value at its start.
    pub value: f32,
    /// Change within the period.
    pub change: f32,
    /// Change of that from period to period.
    pub bend: f32,
    /// Whether it has a new value or continues to move.
    pub moves: bool,
    /// Whether it has changed by more than a motion does.
    pub steps: bool,
}

/// State of the course.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Course {
    value: f32,
    /// Change in a period: with which the course continues, and between the last two values.
    change: f32,
    rate: f32,
    /// Change of that from period to period.
    bend: f32,
    /// Last value, as taken for the course to continue from.
    from: f32,
    /// Steps since the last value came, and between the last two.
    age_steps: u16,
    interval_steps: u16,
    /// Steps for which the course continues.
    lasts_steps: u16,
    /// Whether the last value came after twice the interval.
    twice: bool,
    /// Whether the last value began a motion: there is no speed yet.
    begins: bool,
    /// Whether the joint could not have reached the last value.
    leapt: bool,
    /// Values left until their times count as regular.
    irregular: u8,
}

impl Course {
    /// A course at rest.
    pub fn at(value: f32, pace: &Pace) -> Self {
        Self {
            value,
            change: 0.0,
            rate: 0.0,
            bend: 0.0,
            from: value,
            age_steps: u16::MAX,
            interval_steps: pace.period_steps,
            lasts_steps: 0,
            twice: false,
            begins: false,
            leapt: false,
            irregular: 0,
        }
    }

    /// Advances by one period, at whose start the set point has had this value for `age_steps`; while it moves it
    /// changes by no more than `fastest` in a period. Without `BENDS` the course does not bend, and the image has no
    /// code for it.
    pub fn advance<const BENDS: bool>(
        &mut self,
        pace: &Pace,
        value: f32,
        age_steps: u16,
        fastest: f32,
    ) -> Target {
        let bends = pace.bends.as_ref().filter(|_| BENDS);
        let since_steps = self.age_steps.saturating_add(pace.period_steps);
        let gained = value - self.value;
        let mut steps = false;
        if gained == 0.0 {
            self.age_steps = since_steps;
        } else {
            let after_steps = since_steps.saturating_sub(age_steps).max(1);
            let before_steps = self.interval_steps;
            let apart_steps = if bends.is_some() { after_steps } else { since_steps };
            self.time(pace, apart_steps, after_steps);
            self.age_steps = age_steps;
            self.value = value;
            steps = match bends {
                None => self.straight(pace, gained, before_steps, fastest),
                Some(bends) => {
                    let rests = apart_steps > pace.longest_steps;
                    let periods = f32::from(after_steps) * pace.per_steps;
                    self.lasts_steps = self.interval_steps.max(before_steps);
                    self.bent(bends, gained, periods, fastest, rests)
                }
            };
        }
        let moves = gained != 0.0;
        match bends {
            None => self.straight_on(pace, moves, steps),
            Some(_) => self.bent_on(pace, moves, steps),
        }
    }

    /// Returns the place that a straight course has reached.
    fn straight_on(&self, pace: &Pace, has_new: bool, steps: bool) -> Target {
        let change = if self.age_steps < self.lasts_steps { self.change } else { 0.0 };
        let moves = has_new || change != 0.0;
        let value = if change == 0.0 || self.age_steps == 0 && self.irregular == 0 {
            self.value
        } else {
            self.from + change * (f32::from(self.age_steps) * pace.per_steps)
        };
        Target { value, change, bend: 0.0, moves, steps }
    }

    /// Returns the place that a bending course has reached. An irregular value that is late finds the course slower,
    /// but no step back.
    fn bent_on(&self, pace: &Pace, has_new: bool, steps: bool) -> Target {
        let on_time = self.age_steps < self.lasts_steps;
        let late_steps = self.age_steps.saturating_sub(self.lasts_steps);
        let slows_steps = if self.irregular == 0 { 0 } else { self.lasts_steps / 2 };
        if self.rate == 0.0 || !on_time && late_steps >= slows_steps {
            return Target { value: self.value, change: 0.0, bend: 0.0, moves: has_new, steps };
        }
        let on_periods = f32::from(self.age_steps.min(self.lasts_steps)) * pace.per_steps;
        let speed = self.rate + self.bend * on_periods;
        let value = self.from + 0.5 * (self.rate + speed) * on_periods;
        if late_steps == 0 {
            return Target { value, change: speed, bend: self.bend, moves: true, steps };
        }
        let left = 1.0 - f32::from(late_steps) / f32::from(slows_steps);
        let late_periods = f32::from(late_steps) * pace.per_steps;
        let value = value + 0.5 * speed * (1.0 + left) * late_periods;
        Target { value, change: left * speed, bend: 0.0, moves: true, steps }
    }

    /// Records the time of a value that came `since_steps` after the last, and in a period that began `after_steps`
    /// after the last value's period.
    fn time(&mut self, pace: &Pace, since_steps: u16, after_steps: u16) {
        let before_steps = self.interval_steps;
        // A value that was due may have equalled the last: a turn of a sine has two equal values.
        let is_late = self.age_steps >= self.lasts_steps;
        let twice = is_late && after_steps == before_steps.saturating_mul(2);
        if since_steps > pace.longest_steps {
            self.rate = 0.0;
        } else if !twice || self.twice {
            self.interval_steps = after_steps;
        }
        self.twice = twice;
        self.irregular = if self.interval_steps == before_steps {
            self.irregular.saturating_sub(1)
        } else {
            IRREGULAR
        };
    }

    /// Takes a value of a straight course; returns whether it is a step.
    fn straight(&mut self, pace: &Pace, gained: f32, before_steps: u16, fastest: f32) -> bool {
        let intervals = if self.interval_steps == pace.period_steps {
            1.0
        } else {
            f32::from(pace.period_steps) / f32::from(self.interval_steps)
        };
        let change = gained * intervals;
        let possible = absolute(change) <= fastest;
        let goes_on = || possible && absolute(change - self.rate) <= fastest * intervals;
        let steps = absolute(gained) > fastest && !goes_on();
        let rate = if possible { change } else { 0.0 };
        self.lasts_steps = self.interval_steps;
        if self.irregular == 0 || steps || self.rate == 0.0 {
            (self.rate, self.from) = (rate, self.value);
        } else {
            self.lasts_steps = self.interval_steps.max(before_steps).saturating_mul(3) / 2;
            let expected = self.from + self.rate / intervals;
            self.from = expected + NEW * (self.value - expected);
            self.rate += NEW * (rate - self.rate);
        }
        self.change = if steps { 0.0 } else { self.rate };
        steps
    }

    /// Takes a value of a bending course, this many periods after the last; returns whether it is a step.
    fn bent(
        &mut self,
        bends: &Bends,
        gained: f32,
        periods: f32,
        fastest: f32,
        rests: bool,
    ) -> bool {
        let per_period = 1.0 / periods;
        let slope = gained * per_period;
        let possible = absolute(slope) <= fastest;
        let speed = self.rate + self.bend * periods;
        let expected = self.from + 0.5 * (self.rate + speed) * periods;
        let missing = self.value - expected;
        let room = bends.most * periods + LATE * absolute(speed);
        let begins = core::mem::replace(&mut self.begins, rests || !possible);
        let leaps = absolute(missing) * per_period > room;
        let leapt = core::mem::replace(&mut self.leapt, leaps);
        if self.begins {
            (self.from, self.rate, self.bend) = (self.value, 0.0, 0.0);
        } else if begins || leaps && leapt {
            (self.from, self.rate, self.bend) = (self.value, slope, 0.0);
            self.leapt = false;
        } else if leaps {
            (self.from, self.bend) = (self.value, 0.0);
        } else {
            // A second-order filter, whose weights fade by `left` with each value.
            let square = periods * periods;
            let new = square / (square + bends.half_squared);
            let left = 1.0 - new;
            let off = missing * per_period;
            self.from = self.value - left * left * left * missing;
            let rate = speed + 1.5 * new * new * (1.0 + left) * off;
            self.rate = limit(rate, -fastest, fastest);
            self.bend += new * new * new * off * per_period;
        }
        self.begins || leaps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FASTEST: f32 = 2.0;
    const STEP_S: f32 = 0.001;
    /// Change of a ramp in a step.
    const RATE: f32 = 0.05;

    /// Targets of the periods of a set point that has the value `value(n)` from the n-th of these steps on.
    fn targets(period: u16, came: &[u16], value: impl Fn(usize) -> f32) -> Vec<(u16, Target)> {
        let pace = Pace::new(period, STEP_S);
        let mut course = Course::at(0.0, &pace);
        let starts = (1..).map(|n| n * period).take_while(|start| *start < 1000);
        let target = |start: u16| {
            let last = came.iter().rposition(|step| *step <= start)?;
            let age = start - came.get(last)?;
            Some((start, course.advance::<true>(&pace, value(last), age, FASTEST)))
        };
        starts.filter_map(target).collect()
    }

    /// A ramp whose values came in these steps.
    fn ramp(period: u16, came: &[u16]) -> Vec<(u16, Target)> {
        targets(period, came, |n| RATE * f32::from(came[n]))
    }

    fn regular(interval: u16, until: u16) -> Vec<u16> {
        (0..until / interval).map(|n| n * interval).collect()
    }

    proptest! {
        /// Whenever its values come, a ramp is off by no more than five steps.
        #[test]
        fn a_ramp_goes_on_between_its_values(
            period in 5_u16..20,
            intervals in prop::collection::vec(8_u16..12, 60..70),
        ) {
            let came: Vec<u16> = intervals
                .iter()
                .scan(0, |step, interval| { *step += interval; Some(*step) })
                .collect();
            let [.., last] = came[..] else { unreachable!() };
            for (start, target) in ramp(period, &came) {
                let within = start >= came[30] && start < last;
                // A value that is later than the interval before it stops the course.
                if within && target.change != 0.0 {
                    let off = target.value - RATE * f32::from(start);
                    prop_assert!(off.abs() < 5.0 * RATE, "{off} at {start}");
                    let rate = target.change / (RATE * f32::from(period));
                    prop_assert!((0.5..1.6).contains(&rate), "{rate} at {start}");
                }
                prop_assert!(!within || target.value >= RATE * f32::from(start - 13));
                prop_assert!(!target.steps);
            }
        }
    }

    #[test]
    fn values_that_are_regular_never_stop_a_ramp() {
        for (period, interval) in [(10, 10), (10, 20), (12, 10), (5, 10), (10, 50), (7, 3), (4, 33)]
        {
            let came = regular(interval, 600);
            for (start, target) in ramp(period, &came) {
                // A host that sends less often than the loop acts is recognised after its third value.
                let within = start > 3 * interval.max(period) && start < came[came.len() - 1];
                assert!(target.change != 0.0 || !within, "{period}, {interval}: {start}");
            }
        }
    }

    /// No further than one and a half intervals beyond the last value, and then back to it.
    #[test]
    fn a_ramp_that_ends_is_left_when_the_next_value_is_due() {
        for (period, interval) in [(10, 10), (10, 20), (5, 10), (10, 50), (12, 10)] {
            let came = regular(interval, 600);
            let last = came[came.len() - 1];
            let ends = RATE * f32::from(last);
            for (start, target) in ramp(period, &came) {
                let latest = interval + interval / 2;
                assert!(target.value < ends + RATE * f32::from(latest), "{period}, {interval}");
                if start >= last + latest {
                    assert_eq!((target.value, target.change), (ends, 0.0), "{period}, {interval}");
                    assert!(!target.moves || start < last + period, "{period}, {interval}");
                }
            }
        }
    }

    /// A step is not part of a motion, whatever came before.
    #[test]
    fn a_step_does_not_go_on() {
        for (period, interval) in [(10, 10), (10, 20), (5, 10), (10, 50)] {
            let came = regular(interval, 600);
            let value = |n: usize| if came[n] < 300 { 0.02 * f32::from(came[n]) } else { 30.0 };
            let targets = targets(period, &came, value);
            assert_eq!(
                targets.iter().filter(|(_, target)| target.steps).count(),
                1,
                "{period}, {interval}"
            );
            let after =
                |(start, target): &&(u16, Target)| *start > 300 + period && target.value != 30.0;
            assert_eq!(targets.iter().find(after), None, "{period}, {interval}");
        }
    }

    /// Targets of a course that bends, at the starts of periods of 10 steps. Acceleration is limited to 100 /s2.
    fn bent(came: &[u16], value: impl Fn(u16) -> f32) -> Vec<(u16, Target)> {
        let pace = Pace::bending(10, STEP_S, 100.0);
        let mut course = Course::at(value(0), &pace);
        let target = |start: u16| {
            let last = came.iter().copied().rfind(|step| *step <= start)?;
            Some((start, course.advance::<true>(&pace, value(last), start - last, 0.04)))
        };
        (1..100).map(|n| n * 10).filter_map(target).collect()
    }

    /// A sine of 1 Hz, from values 20, 50 and 100 times a second: its speed, of up to 1.26.
    #[test]
    fn a_sine_goes_on_between_its_values() {
        let w = core::f32::consts::TAU;
        for (interval, most) in [(50, 0.4), (20, 0.19), (10, 0.06)] {
            let sine = |step: u16| 0.2 * (w * STEP_S * f32::from(step)).sin();
            let mut worst = 0.0_f32;
            for (start, target) in bent(&regular(interval, 1000), sine) {
                if start > 5 * interval {
                    let exact = 0.2 * w * (w * STEP_S * f32::from(start)).cos();
                    worst = worst
                        .max((target.change / (10.0 * STEP_S) / exact - 1.0).abs() * exact.abs());
                    worst = worst.max((target.value - sine(start)).abs());
                }
            }
            assert!((0.2 * most..most).contains(&worst), "{interval}: {worst}");
        }
    }

    #[test]
    fn a_step_after_a_rest_stays_one() {
        for size in [1e-3_f32, 0.02, 0.039, 0.5] {
            for (_, target) in bent(&regular(20, 1000), |step| if step < 305 { 0.0 } else { size })
            {
                assert!(target.value == 0.0 || target.value == size, "{size}: {target:?}");
                assert_eq!((target.change, target.bend), (0.0, 0.0), "{size}");
            }
        }
    }

    /// A value that no joint reaches by its acceleration is taken, and the speed stays.
    #[test]
    fn a_leap_within_a_motion_has_no_speed() {
        let leaps = |step: u16| 5e-4 * f32::from(step) + if step < 500 { 0.0 } else { 0.03 };
        for (start, target) in bent(&regular(10, 1000), leaps).split_off(5) {
            assert!((target.value - leaps(start)).abs() < 1e-4, "{start}: {target:?}");
            assert!((target.change - 5e-3).abs() < 1e-4, "{start}: {target:?}");
        }
    }

    proptest! {
        /// A slider that is dragged by hand and then left: the course continues for one and a half intervals, and
        /// returns.
        #[test]
        fn a_hand_that_stops_is_not_left_far_behind(
            ways in prop::collection::vec(-0.04_f32..0.04, 20),
            intervals in prop::collection::vec(4_u16..40, 20),
        ) {
            let mut step = 0;
            let came: Vec<u16> = intervals.iter().map(|interval| { step += interval; step }).collect();
            let value = |step: u16| {
                let of = came.iter().take_while(|came| **came <= step).count();
                ways[..of].iter().sum::<f32>()
            };
            for (start, target) in bent(&came, value) {
                let off = (target.value - value(start)).abs();
                prop_assert!(off < 1.25 * 5.5 * 0.04, "{off} at {start}");
                if start > came[19] + 85 {
                    prop_assert_eq!((target.value, target.change), (value(start), 0.0));
                }
            }
        }
    }
}
