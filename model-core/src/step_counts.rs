//! Time in steps: the only place where seconds become steps.

use crate::math::limit;

/// Parts of the covariance's work.
const PARTS: u16 = 20;
/// Steps of an interval of the covariance that are reserved for other work.
const BUSY_STEPS: u16 = 8;

/// Counts that follow from the step's length. Step counts in the core's documentation assume a step of a millisecond.
///
/// Aligned to words: with an alignment to half words, its copies cost the RP2040 0.9 us a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C, align(4))]
pub struct StepCounts {
    /// Steps per balance of the gas: 20 ms.
    pub interval_steps: u16,
    /// Steps per update of the estimate's covariance: 40 ms, and long enough for its work to be done in parts.
    pub update_steps: u16,
    /// Steps after which the zones of the gas move: 10 ms.
    pub move_steps: u16,
    /// Parts of the covariance's work in a step.
    pub parts_per_step: u16,
    /// Steps for which a fault of the pressure channel must last before the muscle is vented: 10 ms, and at least three
    /// steps. One disturbed conversion is no fault.
    pub patience_steps: u16,
    /// Steps after a start for which the muscle vents, whatever is requested, 50 ms: a channel that is shorted, beyond
    /// the limit or noisy shows by then.
    pub startup_steps: u16,
    /// Steps after the valves have shut during which corrections of the energy still count as flow: 25 ms.
    pub late_steps: u16,
    /// Steps over which the energy is averaged while both valves are shut: 0.1 s. With more, the errors of the heat
    /// would show.
    pub shut_steps: u16,
    /// Intervals in a tenth of a second, ...
    pub tenth_intervals: u16,
    /// ... in a second ...
    pub second_intervals: u16,
    /// ... and in ten.
    pub ten_seconds_intervals: u16,
    /// Updates in ten seconds.
    pub ten_seconds_updates: u16,
}

impl StepCounts {
    /// Computes the counts for the checked step of the core \[s\].
    ///
    /// ```
    /// use model_core::step_counts::StepCounts;
    ///
    /// assert_eq!(StepCounts::new(0.001).update_steps, 40);
    /// ```
    pub fn new(step_s: f32) -> Self {
        // Integers: on a processor without floating point they take a tenth of the time.
        let step_ns = (step_s * 1.0e9 + 0.5) as u32;
        let steps = |time_ms: u32, least| count(1_000_000 * time_ms, step_ns, least);
        let interval_steps = steps(20, 10);
        let update_steps = 2 * interval_steps;
        let interval_us = u32::from(interval_steps) * (step_ns / 1000);
        let intervals = |time_ms: u32| count(1000 * time_ms, interval_us, 1);
        Self {
            interval_steps,
            update_steps,
            move_steps: steps(10, 1),
            // By comparison: the optimiser does not see that a divisor would never be zero.
            parts_per_step: if update_steps > PARTS + BUSY_STEPS { 1 } else { 2 },
            patience_steps: steps(10, 3),
            startup_steps: steps(50, 50),
            late_steps: steps(25, 2),
            shut_steps: steps(100, 2),
            tenth_intervals: intervals(100),
            second_intervals: intervals(1000),
            ten_seconds_intervals: intervals(10_000),
            ten_seconds_updates: count(10_000_000, u32::from(update_steps) * (step_ns / 1000), 1),
        }
    }
}

/// Number of steps in a time \[s\], to the nearest; at least one.
pub(crate) fn timeout_steps(timeout_s: f32, step_s: f32) -> u32 {
    limit(timeout_s / step_s + 0.5, 1.0, 1.0e9) as u32
}

/// Number of times that `part` fits into `whole`, to the nearest; at least `least`.
#[inline(never)] // Eleven times: inlined they are 600 bytes of the image.
fn count(whole: u32, part: u32, least: u16) -> u16 {
    let nearest = (whole + part / 2).checked_div(part).unwrap_or(u32::MAX);
    u16::try_from(nearest).unwrap_or(u16::MAX).max(least)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_millisecond_makes_the_documented_counts() {
        let counts = StepCounts::new(0.001);
        assert_eq!(
            [counts.interval_steps, counts.patience_steps, counts.startup_steps],
            [20, 10, 50]
        );
        assert_eq!([counts.late_steps, counts.shut_steps, counts.move_steps], [25, 100, 10]);
        let intervals =
            [counts.tenth_intervals, counts.second_intervals, counts.ten_seconds_intervals];
        assert_eq!(intervals, [5, 50, 500]);
        assert_eq!([counts.update_steps, counts.parts_per_step], [40, 1]);
        assert_eq!(counts.ten_seconds_updates, 250);
    }

    /// For every step length a time stays the same, to a step and to the least count.
    #[test]
    fn other_steps_take_as_long() {
        for step_s in [1.0e-4_f32, 2.5e-4, 5.0e-4, 2.0e-3, 0.01, 0.1] {
            let counts = StepCounts::new(step_s);
            let interval_s = f32::from(counts.interval_steps) * step_s;
            for (steps, time_s, least) in [
                (counts.interval_steps, 0.02, 10),
                (counts.patience_steps, 0.01, 3),
                (counts.startup_steps, 0.05, 50),
                (counts.late_steps, 0.025, 2),
                (counts.shut_steps, 0.1, 2),
                (counts.move_steps, 0.01, 1),
            ] {
                let off_s = f32::from(steps) * step_s - time_s;
                assert!(steps == least || off_s.abs() <= 0.51 * step_s, "{steps} of {step_s} s");
            }
            let shown_s = f32::from(counts.ten_seconds_intervals) * interval_s;
            assert!((shown_s - 10.0).abs() <= 0.51 * interval_s, "{shown_s} s");
        }
    }
}
