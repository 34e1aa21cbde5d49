//! Comparing signals sampled at equal intervals: correlation, time shift, first harmonic.

use std::f64::consts::TAU;

/// Arithmetic mean; NaN for no values.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Root-mean-square difference of two signals of one length.
pub fn rms_difference(a: &[f64], b: &[f64]) -> f64 {
    let squares: f64 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
    (squares / a.len().min(b.len()) as f64).sqrt()
}

/// Pearson's correlation coefficient of two signals of one length; 0 if one is constant.
pub fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (mean_a, mean_b) = (mean(a), mean(b));
    let mut products = 0.0;
    let mut squares_a = 0.0;
    let mut squares_b = 0.0;
    for (a, b) in a.iter().zip(b) {
        products += (a - mean_a) * (b - mean_b);
        squares_a += (a - mean_a).powi(2);
        squares_b += (b - mean_b).powi(2);
    }
    let scale = (squares_a * squares_b).sqrt();
    if scale > 0.0 { products / scale } else { 0.0 }
}

/// Number of samples by which `late` has to be shifted back for the highest correlation with
/// `early`, searched from `-most` to `most`, and the correlation there. A parabola through the best
/// three gives the fraction of a sample.
pub fn time_shift(early: &[f64], late: &[f64], most: usize) -> (f64, f64) {
    let length = early.len().min(late.len());
    let most = most.min(length / 2) as isize;
    let at = |shift: isize| {
        let overlap = length - shift.unsigned_abs();
        let (from_early, from_late) = (0.max(-shift) as usize, 0.max(shift) as usize);
        correlation(&early[from_early..from_early + overlap], &late[from_late..from_late + overlap])
    };
    let values: Vec<f64> = (-most..=most).map(at).collect();
    let best = (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b])).unwrap_or(0);
    let fraction = match (best.checked_sub(1).map(|i| values[i]), values.get(best + 1)) {
        (Some(before), Some(after)) => {
            let curvature = before - 2.0 * values[best] + after;
            if curvature < 0.0 { 0.5 * (before - after) / curvature } else { 0.0 }
        }
        _ => 0.0,
    };
    (best as f64 - most as f64 + fraction, values[best])
}

/// First harmonic of a signal: a cosine of `frequency_hz`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Harmonic {
    /// Amplitude, in the signal's unit.
    pub amplitude: f64,
    pub phase_rad: f64,
}

/// The component of `values`, sampled every `step_s`, at `frequency_hz`. The values should cover
/// whole periods.
pub fn harmonic(values: &[f64], step_s: f64, frequency_hz: f64) -> Harmonic {
    let mean = mean(values);
    let (mut cosine, mut sine) = (0.0, 0.0);
    for (i, value) in values.iter().enumerate() {
        let angle = TAU * frequency_hz * step_s * i as f64;
        cosine += (value - mean) * angle.cos();
        sine += (value - mean) * angle.sin();
    }
    let scale = 2.0 / values.len() as f64;
    Harmonic { amplitude: scale * cosine.hypot(sine), phase_rad: (-sine).atan2(cosine) }
}

/// Delay of `late` behind `early` at a frequency \[s\], 0 to one period.
pub fn harmonic_delay_s(early: Harmonic, late: Harmonic, frequency_hz: f64) -> f64 {
    (early.phase_rad - late.phase_rad).rem_euclid(TAU) / (TAU * frequency_hz)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(delay_s: f64, amplitude: f64) -> Vec<f64> {
        (0..5000)
            .map(|i| 300.0 + amplitude * (TAU * 0.2 * (i as f64 * 0.01 - delay_s)).sin())
            .collect()
    }

    #[test]
    fn a_known_delay_is_found_both_ways() {
        let (early, late) = (wave(0.0, 10.0), wave(0.634, 2.0));
        let (shift, correlation) = time_shift(&early, &late, 200);
        assert!((shift * 0.01 - 0.634).abs() < 1e-3, "{shift}");
        assert!((0.999..=1.0 + 1e-12).contains(&correlation));
        let (a, b) = (harmonic(&early, 0.01, 0.2), harmonic(&late, 0.01, 0.2));
        assert!((b.amplitude / a.amplitude - 0.2).abs() < 1e-9);
        assert!((harmonic_delay_s(a, b, 0.2) - 0.634).abs() < 1e-9);
    }

    #[test]
    fn opposite_and_unrelated_signals() {
        let rising: Vec<f64> = (0..100).map(f64::from).collect();
        let falling: Vec<f64> = rising.iter().map(|x| -x).collect();
        assert!((correlation(&rising, &falling) + 1.0).abs() < 1e-12);
        assert_eq!(correlation(&rising, &vec![1.0; 100]), 0.0);
        assert!((rms_difference(&[1.0, 2.0], &[1.0, 4.0]) - 2.0_f64.sqrt()).abs() < 1e-12);
    }
}
