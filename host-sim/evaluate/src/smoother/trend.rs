//! Smoother of a noisy signal: a local linear trend, forward and back.
//!
//! ```text
//! x' = x + r,   r' = r + w,   w ~ N(0, q^2)    the value, and its rate per step
//! y  = x + v,                 v ~ N(0, R)      a reading
//! ```
//!
//! Where the rate is known to change (a valve opens or shuts) it is reset. Otherwise its variation
//! q maximises the likelihood of the readings (Harvey, "Forecasting, Structural Time Series Models
//! and the Kalman Filter", 1989, section 3.4), once for the readings during flow and once for the
//! others: smooth sections are averaged over many steps, the pressure steps of a pulsed valve are
//! not.

use nalgebra::{Matrix2, Vector2};
use std::f64::consts::TAU;

/// Smallest candidate for q, per reading's deviation and step: an average over seconds.
const LEAST_WANDER: f64 = 1e-4;
const CANDIDATES: i32 = 13;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    pub value: f64,
    pub variance: f64,
    /// Whether the rate after this reading is independent of the rate before it.
    pub turns: bool,
    pub flowing: bool,
}

#[derive(Debug, Clone, Copy)]
struct Passed {
    transition: Matrix2<f64>,
    predicted: Vector2<f64>,
    predicted_covariance: Matrix2<f64>,
    state: Vector2<f64>,
    covariance: Matrix2<f64>,
}

pub fn smooth(readings: &[Reading]) -> Vec<f64> {
    let tried: Vec<(f64, [f64; 2])> = (0..CANDIDATES)
        .map(|i| LEAST_WANDER * 10.0_f64.powf(0.5 * f64::from(i)))
        .map(|wander| (wander, forward(readings, [wander; 2], |_| {})))
        .collect();
    let likeliest = [0, 1].map(|flowing| {
        let best = tried.iter().max_by(|a, b| a.1[flowing].total_cmp(&b.1[flowing]));
        best.map_or(1.0, |(wander, _)| *wander)
    });
    let mut passed = Vec::with_capacity(readings.len());
    forward(readings, likeliest, |step| passed.push(step));
    backward(&passed)
}

/// Runs the filter, with q without flow and with flow; returns the logarithms of the likelihood of
/// the readings of each kind.
fn forward(readings: &[Reading], wander: [f64; 2], mut each: impl FnMut(Passed)) -> [f64; 2] {
    let Some(first) = readings.first() else { return [0.0; 2] };
    let least = readings.iter().map(|r| r.variance).fold(f64::INFINITY, f64::min);
    let wander2 = wander.map(|wander| wander * wander * least);
    // Much larger than any rate: a thousand deviations per step.
    let unknown2 = 1e6 * least;
    let mut state = Vector2::new(first.value, 0.0);
    let mut covariance = Matrix2::new(1e6 * least, 0.0, 0.0, unknown2);
    let mut likelihood = [0.0; 2];
    for reading in readings {
        let kept = if reading.turns { 0.0 } else { 1.0 };
        let transition = Matrix2::new(1.0, 1.0, 0.0, kept);
        state = transition * state;
        covariance = transition * covariance * transition.transpose();
        // The rate changes somewhere within the step, so the value is uncertain too.
        covariance += if reading.turns {
            Matrix2::from_diagonal_element(unknown2)
        } else {
            Matrix2::new(0.0, 0.0, 0.0, wander2[usize::from(reading.flowing)])
        };
        let (predicted, predicted_covariance) = (state, covariance);
        let innovation = reading.value - state[0];
        let variance = covariance[(0, 0)] + reading.variance;
        likelihood[usize::from(reading.flowing)] -=
            0.5 * (innovation * innovation / variance + (TAU * variance).ln());
        let gain = covariance.column(0) / variance;
        state += gain * innovation;
        covariance -= gain * covariance.row(0);
        each(Passed { transition, predicted, predicted_covariance, state, covariance });
    }
    likelihood
}

/// Rauch-Tung-Striebel pass.
fn backward(passed: &[Passed]) -> Vec<f64> {
    let Some(last) = passed.last() else { return Vec::new() };
    let mut state = last.state;
    let mut values = vec![state[0]];
    for pair in passed.windows(2).rev() {
        let (now, next) = (&pair[0], &pair[1]);
        let carried = now.covariance * next.transition.transpose();
        let inverse = next.predicted_covariance.try_inverse().unwrap_or_default();
        state = now.state + carried * inverse * (state - next.predicted);
        values.push(state[0]);
    }
    values.reverse();
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    /// RMS error after smoothing noise of deviation 1 on `truth`, whose rate changes at `turns`.
    fn left(truth: impl Fn(usize) -> f64, turns: impl Fn(usize) -> bool) -> f64 {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
        let readings: Vec<Reading> = (0..4000)
            .map(|i| {
                let noise: f64 = StandardNormal.sample(&mut random);
                Reading { value: truth(i) + noise, variance: 1.0, turns: turns(i), flowing: false }
            })
            .collect();
        let errors = smooth(&readings).into_iter().enumerate().map(|(i, x)| (x - truth(i)).powi(2));
        (errors.sum::<f64>() / 4000.0).sqrt()
    }

    #[test]
    fn smooth_signals_are_averaged_and_jumps_are_followed() {
        // A straight line through 4000 readings: (4/4000)^0.5 at its ends, half of it between.
        let line = left(|i| 0.3 * i as f64, |_| false);
        assert!((0.005..0.06).contains(&line), "{line}");
        let triangle = |i: usize| 2.0 * ((i % 1000) as f64 - 500.0).abs();
        let known = left(triangle, |i| i % 500 == 1);
        assert!((0.05..0.2).contains(&known), "{known}");
        let stairs = left(|i| 100.0 * (i / 10) as f64, |_| false);
        assert!((0.5..1.1).contains(&stairs), "nothing to be averaged: {stairs}");
    }
}
