//! f64 functions for everything that a trace depends on: plant, front end, scenario.
//!
//! The platform's functions differ in the last bit between libcs and browsers, and so would traces.
//! The functions here are pure Rust. Correctly rounded functions of IEEE 754, such as `sqrt` and
//! `round`, are std's; `clippy.toml` refuses the rest.

pub use libm::{acos, atan2, cbrt, cos, exp, expm1, hypot, log, pow, sin};

/// Smallest and largest number; infinite if there are no numbers.
pub fn ends(numbers: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let none = [f64::INFINITY, f64::NEG_INFINITY];
    numbers.into_iter().fold(none, |[least, most], x| [least.min(x), most.max(x)])
}

/// Usual distance of numbers from the preceding ones, the median of all distances; 0 for fewer than
/// two.
pub fn usual_distance(numbers: &[f64]) -> f64 {
    let mut distances: Vec<f64> = numbers.windows(2).map(|pair| pair[1] - pair[0]).collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied().unwrap_or_default()
}

/// Median distance of rising numbers that differ; infinite if none do.
pub fn median_distance(numbers: &[f64]) -> f64 {
    let mut distances: Vec<f64> =
        numbers.windows(2).map(|pair| pair[1] - pair[0]).filter(|d| *d > 0.0).collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).copied().unwrap_or(f64::INFINITY)
}

/// Neighbours whose distance exceeds `most`.
pub fn gaps(numbers: &[f64], most: f64) -> impl Iterator<Item = [f64; 2]> {
    let pairs = numbers.windows(2).map(|pair| [pair[0], pair[1]]);
    pairs.filter(move |[before, after]| after - before > most)
}
