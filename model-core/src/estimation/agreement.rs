//! How far the gas sensor's readings and the model agree.
//!
//! The covariance counts every error that the tuning allows for, and so is too cautious on a muscle
//! that follows the model well. The innovations tell: what is left of them after half a second of
//! averaging is what the sensor's lag has left of an error of the gas temperature. Where it is small
//! while gas flows, so is the deviation that the estimator states; at rest every model agrees.

use crate::config::EstimatorConfig;
use crate::math::limit;
use crate::step_counts::StepCounts;

/// Error of the gas, lasting for a second, at which the covariance is taken at its word \[K\].
const AGREEMENT_K: f32 = 0.36;
/// Readings that disagree count for no more than such an error: the covariance is cautious, and what they
/// teach is uncertain by itself (`update_deviation`) \[K\].
const DISAGREEMENT_K: f32 = 0.14;
/// Part of the ADC's LSB that stays in the innovations of a perfect model, a quarter of a code \[K\].
const FLOOR_K: f32 = 0.004;

/// Running measure of the innovations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Agreement {
    /// Share of an innovation that enters each of the two averages in series: half a second.
    smoothing: f32,
    /// Share that enters the mean square: five seconds.
    window: f32,
    smooth_k: f32,
    smoother_k: f32,
    mean_square_k2: f32,
}

impl Agreement {
    /// Before the first reading: none.
    pub fn new(lag_s: f32, counts: &StepCounts) -> Self {
        Self {
            smoothing: 1.0 / f32::from(counts.half_second_intervals),
            window: 1.0 / f32::from(counts.five_seconds_intervals),
            smooth_k: 0.0,
            smoother_k: 0.0,
            mean_square_k2: unknown_k2(lag_s),
        }
    }

    /// Takes the innovation of one interval \[K\], in which gas has flowed or not; without a reading the
    /// agreement fades.
    pub fn add(&mut self, innovation_k: Option<f32>, lag_s: f32, moved: bool) {
        let square_k2 = match innovation_k {
            Some(innovation_k) => {
                self.smooth_k += self.smoothing * (innovation_k - self.smooth_k);
                self.smoother_k += self.smoothing * (self.smooth_k - self.smoother_k);
                limit(self.smooth_k2(), 0.0, left_k2(DISAGREEMENT_K, lag_s))
            }
            None => unknown_k2(lag_s),
        };
        if moved || square_k2 > self.mean_square_k2 {
            self.mean_square_k2 += self.window * (square_k2 - self.mean_square_k2);
        }
    }

    /// Square of the innovations' average over the last half second \[K2\].
    pub fn smooth_k2(&self) -> f32 {
        self.smoother_k * self.smoother_k
    }

    /// How far they disagree, from 0 (readings and model agree) to 1: that share of the deviation is to be stated.
    pub fn share(&self, lag_s: f32) -> f32 {
        limit((self.mean_square_k2 - FLOOR_K * FLOOR_K) / unknown_k2(lag_s), 0.0, 1.0)
    }
}

/// Mean square of the innovations at which the share is 1 \[K2\].
fn unknown_k2(lag_s: f32) -> f32 {
    left_k2(AGREEMENT_K, lag_s)
}

/// Mean square of the innovations that such an error of the gas leaves \[K2\].
fn left_k2(error_k: f32, lag_s: f32) -> f32 {
    let left_k = error_k * EstimatorConfig::left_by_lag(lag_s);
    left_k * left_k
}

#[cfg(test)]
mod tests {
    use super::*;

    fn agreement() -> Agreement {
        Agreement::new(3.0, &StepCounts::new(0.001))
    }

    fn share_after(innovation_k: Option<f32>, intervals: usize) -> f32 {
        let mut agreement = agreement();
        for _ in 0..intervals {
            agreement.add(innovation_k, 3.0, true);
        }
        agreement.share(3.0)
    }

    #[test]
    fn agreement_has_to_be_shown() {
        assert!(share_after(Some(0.0), 0) > 0.95);
        assert!((0.6..0.7).contains(&share_after(Some(0.0), 100)), "two seconds");
        assert_eq!(share_after(Some(0.0), 3000), 0.0);
        let most = (DISAGREEMENT_K / AGREEMENT_K).powi(2);
        assert!((0.9 * most..most).contains(&share_after(Some(0.1), 3000)));
        assert!((0.03..0.04).contains(&share_after(Some(0.0175), 3000)), "half of 0.14 K/4");
    }

    #[test]
    fn rest_proves_nothing() {
        let mut agreement = agreement();
        for _ in 0..3000 {
            agreement.add(Some(0.0), 3.0, false);
        }
        assert!(agreement.share(3.0) > 0.95);
        for _ in 0..3000 {
            agreement.add(Some(0.0), 3.0, true);
        }
        assert_eq!(agreement.share(3.0), 0.0);
        for _ in 0..3000 {
            agreement.add(Some(0.1), 3.0, false);
        }
        assert!(agreement.share(3.0) > 0.1, "a contradiction counts at rest too");
    }

    #[test]
    fn it_fades_without_readings() {
        let mut agreement = agreement();
        for step in 0..6000 {
            agreement.add((step < 3000).then_some(0.0), 3.0, step < 3000);
        }
        assert!(agreement.share(3.0) > 0.95);
    }
}
