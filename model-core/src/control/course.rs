//! The course of a set point between its values.
//!
//! A host sends values when it likes, some 20 to 200 times a second; a loop acts at the starts of its own periods. In a
//! period the last value would change by none, one or two intervals of the host, and the speed of the set point would jump
//! by as much. A value therefore counts from the step in which it came, and goes on from there at the speed since the one
//! before, until the next one is due.
//!
//! Values that come irregularly, because a host or its line has other things to do, were meant for other times. Half of
//! what is new in each is taken then, and it goes on for half an interval more.

use crate::math::absolute;

/// Longest interval between two values of a set point that moves \[s\]: 20 values a second.
const LONGEST_S: f32 = 0.05;
/// Share of what is new in an irregular value, and in its speed. Simulated with 10 and 20 kg on a sine of 13.5 mm, values
/// up to 1, 3 and 8 ms late, four seeds: 0.23, 0.31 and 0.65 mm off; all of it leaves 0.28, 0.53 and 1.09 mm,
/// three tenths with a tenth of the speed 0.8 mm.
const NEW: f32 = 0.5;
/// Values after one at another interval that count as irregular.
const IRREGULAR: u8 = 20;

/// Loop for which the course is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    /// Steps in its period, and the reciprocal.
    period_steps: u16,
    per_steps: f32,
    /// Steps within which a set point that moves has another value.
    longest_steps: u16,
}

impl Pace {
    /// For steps of `step_s`.
    pub fn new(period_steps: u16, step_s: f32) -> Self {
        Self {
            period_steps,
            per_steps: 1.0 / f32::from(period_steps),
            // A cast saturates.
            longest_steps: ((LONGEST_S / step_s + 0.5) as u16).max(period_steps),
        }
    }
}

/// Set point of a period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// At its start.
    pub value: f32,
    /// By how much it changes in the period.
    pub change: f32,
    /// It has a new value, or goes on.
    pub moves: bool,
    /// It has changed by more than a motion does.
    pub steps: bool,
}

/// State of the course.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Course {
    value: f32,
    /// Change in a period: to go on with, and as the last two values have it.
    change: f32,
    rate: f32,
    /// The last value as it is taken while it goes on.
    from: f32,
    /// Steps since the last value came, and between the last ones.
    age_steps: u16,
    interval_steps: u16,
    /// Steps for which it goes on.
    lasts_steps: u16,
    /// The last value came after twice the interval.
    twice: bool,
    /// Values until their times are taken for regular.
    irregular: u8,
}

impl Course {
    /// At rest.
    pub fn at(value: f32, pace: &Pace) -> Self {
        let interval_steps = pace.period_steps;
        let (change, rate, age_steps, lasts_steps) = (0.0, 0.0, u16::MAX, 0);
        Self {
            value,
            change,
            rate,
            from: value,
            age_steps,
            interval_steps,
            lasts_steps,
            twice: false,
            irregular: 0,
        }
    }

    /// One period, at whose start the set point has had that value for so many steps; while it moves it changes by no
    /// more than `fastest` in a period.
    pub fn advance(&mut self, pace: &Pace, value: f32, age_steps: u16, fastest: f32) -> Target {
        let since_steps = self.age_steps.saturating_add(pace.period_steps);
        let gained = value - self.value;
        let mut steps = false;
        if gained == 0.0 {
            self.age_steps = since_steps;
        } else {
            let before_steps = self.interval_steps;
            let interval_steps = since_steps.saturating_sub(age_steps).max(1);
            // One that was due may have been the same as the last: a turn of a sine has two of a value.
            let is_late = self.age_steps >= self.lasts_steps;
            let twice = is_late && interval_steps == before_steps.saturating_mul(2);
            if since_steps > pace.longest_steps {
                self.rate = 0.0;
            } else if !twice || self.twice {
                self.interval_steps = interval_steps;
            }
            self.twice = twice;
            self.irregular = if self.interval_steps == before_steps {
                self.irregular.saturating_sub(1)
            } else {
                IRREGULAR
            };
            self.age_steps = age_steps;
            self.value = value;
            let intervals = if self.interval_steps == pace.period_steps {
                1.0
            } else {
                f32::from(pace.period_steps) / f32::from(self.interval_steps)
            };
            let change = gained * intervals;
            let possible = absolute(change) <= fastest;
            let goes_on = || possible && absolute(change - self.rate) <= fastest * intervals;
            steps = absolute(gained) > fastest && !goes_on();
            let rate = if possible { change } else { 0.0 };
            self.lasts_steps = self.interval_steps;
            if self.irregular == 0 || steps || self.rate == 0.0 {
                (self.rate, self.from) = (rate, value);
            } else {
                self.lasts_steps = self.interval_steps.max(before_steps).saturating_mul(3) / 2;
                let expected = self.from + self.rate / intervals;
                self.from = expected + NEW * (value - expected);
                self.rate += NEW * (rate - self.rate);
            }
            self.change = if steps { 0.0 } else { self.rate };
        }
        let change = if self.age_steps < self.lasts_steps { self.change } else { 0.0 };
        let moves = gained != 0.0 || change != 0.0;
        let value = if change == 0.0 || self.age_steps == 0 && self.irregular == 0 {
            self.value
        } else {
            self.from + change * (f32::from(self.age_steps) * pace.per_steps)
        };
        Target { value, change, moves, steps }
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

    /// Targets of the periods of a set point that has value(n) from the n-th of these steps on.
    fn targets(period: u16, came: &[u16], value: impl Fn(usize) -> f32) -> Vec<(u16, Target)> {
        let pace = Pace::new(period, STEP_S);
        let mut course = Course::at(0.0, &pace);
        let starts = (1..).map(|n| n * period).take_while(|start| *start < 1000);
        let target = |start: u16| {
            let last = came.iter().rposition(|step| *step <= start)?;
            let age = start - came.get(last)?;
            Some((start, course.advance(&pace, value(last), age, FASTEST)))
        };
        starts.filter_map(target).collect()
    }

    /// The last value of a ramp, whose values came in these steps.
    fn ramp(period: u16, came: &[u16]) -> Vec<(u16, Target)> {
        targets(period, came, |n| RATE * f32::from(came[n]))
    }

    fn regular(interval: u16, until: u16) -> Vec<u16> {
        (0..until / interval).map(|n| n * interval).collect()
    }

    proptest! {
        /// Whenever its values come, a ramp is no more than five steps off.
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
                // A value that is late by more than the interval before it stops the course.
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
                // A host that sends less often than the loop acts is known for one after its third value.
                let within = start > 3 * interval.max(period) && start < came[came.len() - 1];
                assert!(target.change != 0.0 || !within, "{period}, {interval}: {start}");
            }
        }
    }

    /// No further than one and a half intervals beyond the last value, and back to it.
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

    /// A step is none of a motion, whatever came before.
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
}
