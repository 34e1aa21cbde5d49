//! The leak of a stop, by the course of P V once gas and sensor have settled.
//!
//! With the mass m = m_end (1 + leak (t_end - t)), and gas that is r e^(-t/tau) from its wall,
//!
//! ```text
//! ln(P V)/(P V)_end = c - leak t + ln T_w(t) + r e^(-t/tau)
//! ```
//!
//! The sensor's location factor does not matter: a fit of the whole stop, with a free location factor, takes a leak for
//! a small one. tau is marginalised over a grid. The wall's course lies between none and the sensor's, less the rest of
//! its lag: the wall beside the sensor may warm or cool while the rest does not.

use super::{Closed, LAG_OFF};
use nalgebra::{DMatrix, DVector};

/// Part of the wait that is left out, while jets decay and gas relaxes fast.
const LEFT_OUT: f64 = 0.25;
/// Time constants with which gas may relax after that, as shares of the wait. With a longer one the wait is too short.
const RELAXES: [f64; 10] = [0.02, 0.03, 0.05, 0.07, 0.1, 0.14, 0.2, 0.3, 0.4, 0.6];
/// Share of the sensor's course that the whole wall follows; its uncertainty is as large. Assumption.
const WALL: f64 = 0.5;
/// Least variance of ln(P V) and of the reading's logarithm: records have eight digits at the most.
const LEAST_NOISE: f64 = 1e-16;
/// Number of standard deviations below which a leak counts as none.
const SEEN: f64 = 3.0;
/// Smallest temperature change by a leak that is corrected \[K\]: errors of the sensor's model look like a smaller
/// leak.
const LEAST_K: f64 = 0.4;

/// Share of the gas that is lost per second, and its standard deviation \[1/s\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leak {
    pub rate_1_s: f64,
    pub sd_1_s: f64,
}

impl Leak {
    pub const NONE: Self = Self { rate_1_s: 0.0, sd_1_s: 0.0 };

    /// Share of the gas at the start of this time that is lost during it.
    pub fn lost(&self, time_s: f64) -> f64 {
        1.0 - (-self.rate_1_s * time_s).exp()
    }
}

/// A line and a relaxation through values over time; `None` with too few.
struct Line {
    relaxes_s: f64,
    slope_1_s: f64,
    variance: f64,
    /// Sum of the squared residuals over the noise, and the square of the volume in which line and relaxation may lie.
    squares: f64,
    open: f64,
}

fn line(times_s: &[f64], values: &[f64], relaxes_s: f64, most: f64) -> Option<Line> {
    let span_s = times_s.last()? - times_s[0];
    let column = |row: usize, column| match column {
        0 => 1.0,
        1 => (times_s[row] - times_s[0]) / span_s,
        _ => most * (-(times_s[row] - times_s[0]) / relaxes_s).exp(),
    };
    let design = DMatrix::from_fn(times_s.len(), 3, column);
    let values = DVector::from_column_slice(values);
    // Half of neighbours' squared differences: a curve adds next to nothing.
    let pairs = (1..values.len()).map(|row| (values[row] - values[row - 1]).powi(2));
    let noise = (0.5 * pairs.sum::<f64>() / values.len() as f64).max(LEAST_NOISE);
    // The relaxation starts at `most` at the most.
    let mut normal = design.tr_mul(&design);
    normal[(2, 2)] += noise;
    let inverse = normal.cholesky()?.inverse();
    let found = &inverse * design.tr_mul(&values);
    let squares = (&values - &design * &found).norm_squared() / noise + found[2].powi(2);
    let open = noise.powi(3) * inverse.determinant();
    Some(Line {
        relaxes_s,
        slope_1_s: found[1] / span_s,
        variance: noise * inverse[(1, 1)] / (span_s * span_s),
        squares,
        open,
    })
}

/// The leak of a stop, beside a sensor of this lag \[s\]. A leak too small to distinguish from none counts as none,
/// with an uncertainty.
pub fn seen(closed: &Closed, lag_s: f64) -> Leak {
    let Some(leak) = of(closed, lag_s) else { return Leak::NONE };
    let by_leak_k = leak.rate_1_s.abs() * closed.wait_s() * closed.last_k();
    if leak.rate_1_s.abs() > SEEN * leak.sd_1_s && by_leak_k > LEAST_K {
        leak
    } else {
        // Half of the leak, or of its deviation if larger, becomes the deviation.
        Leak { rate_1_s: 0.0, sd_1_s: 0.5 * leak.rate_1_s.abs().max(leak.sd_1_s) }
    }
}

fn of(closed: &Closed, lag_s: f64) -> Option<Leak> {
    let wait_s = closed.wait_s();
    let from =
        |share: f64| (0..closed.rows.len()).find(|row| closed.since_s(*row) > share * wait_s);
    let first = from(LEFT_OUT)?;
    let times_s: Vec<f64> = (0..closed.rows.len()).map(|row| closed.since_s(row)).collect();
    // An interpolated length does not show a leak.
    let shows = |row: &usize| !closed.frozen[*row];
    let late_s: Vec<f64> = (first..times_s.len()).filter(shows).map(|row| times_s[row]).collect();
    let logs: Vec<f64> =
        (first..times_s.len()).filter(shows).map(|row| closed.ratio[row].ln()).collect();
    let swing = closed.ratio[0].ln().abs();
    let lines: Vec<Line> = RELAXES
        .iter()
        .map(|share| share * wait_s)
        .filter_map(|relaxes_s| {
            let left = swing * (-times_s[first] / relaxes_s).exp();
            line(&late_s, &logs, relaxes_s, left)
        })
        .collect();
    let least = lines.iter().map(|line| line.squares).fold(f64::INFINITY, f64::min);
    // Rows that no such course explains count less.
    let per_row = (least / logs.len() as f64).max(1.0);
    let weight = |line: &Line| (-0.5 * (line.squares - least) / per_row).exp() * line.open.sqrt();
    let all: f64 = lines.iter().map(weight).sum();
    if lines.is_empty() {
        return None;
    }
    let mean = |of: &dyn Fn(&Line) -> f64| {
        lines.iter().map(|line| weight(line) * of(line)).sum::<f64>() / all
    };
    let slope_1_s = mean(&|line| line.slope_1_s);
    let variance = mean(&|line| per_row * line.variance + (line.slope_1_s - slope_1_s).powi(2));
    let half = from(0.5)?;
    let readings: Vec<f64> = closed.rows[half..].iter().map(|row| row.sensor_k.ln()).collect();
    let wall = |lag_s: f64| line(&times_s[half..], &readings, lag_s, 1.0);
    let settled = wall(lag_s)?;
    // Readings that still follow the gas, or their own lag, do not show the wall.
    let relaxes_s = mean(&|line| line.relaxes_s);
    let off = [wall((1.0 + LAG_OFF) * lag_s)?, wall(relaxes_s)?]
        .map(|other| other.slope_1_s - settled.slope_1_s);
    let wall_1_s = WALL * settled.slope_1_s;
    let sd_1_s = (variance + settled.variance).sqrt();
    Some(Leak {
        rate_1_s: wall_1_s - slope_1_s,
        sd_1_s: [off[0], off[1], wall_1_s].into_iter().fold(sd_1_s, f64::hypot),
    })
}
