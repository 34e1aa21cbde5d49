//! Runs the same short motion before and after tuning.

use super::experiment::{Bench, Record, record};
use serde::Serialize;
use std::f64::consts::TAU;
use thermyo_scenario::DriveKind;
use thermyo_setup::Loaded;
use thermyo_simulation::run::RunError;

const BEFORE_S: f64 = 1.0;
/// Frequency of the sine \[Hz\], and number of periods; the first one does not count.
const SINE_HZ: f64 = 0.5;
const PERIODS: f64 = 3.0;
/// Amplitude of sine and steps, as a fraction of the tested contractions \[-\].
const AMPLITUDE: f64 = 0.3;
/// Duration of each step, and of its last part, which counts as rest \[s\].
const HOLD_S: f64 = 1.5;
const REST_S: f64 = 0.4;
/// An error within this fraction of a step counts as settled \[-\].
const SETTLED: f64 = 0.05;
/// The stroke to which errors are relative, as in `thermyo evaluate control` \[-\].
const STROKE: f64 = 0.3;

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figures {
    /// RMS error of a slow sine, in percent of a stroke of 30 % \[%\].
    pub sine_rms_percent: f64,
    /// Larger of the errors after the two steps, of the same stroke \[%\].
    pub rest_error_percent: f64,
    /// Time until the error stays within 5 % of the step, the slower of the two \[s\].
    pub settled_s: f64,
    /// Overshoot, as a fraction of the step, the larger of the two \[%\].
    pub overshoot_percent: f64,
}

/// One check with its chart's data.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked<F = Figures> {
    pub figures: F,
    /// Time \[s\], set point and measured value: contraction \[-\], or angle \[rad\].
    pub points: Vec<(f64, f64, f64)>,
}

pub fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

pub fn duration_s() -> f64 {
    BEFORE_S + PERIODS / SINE_HZ + 2.0 * HOLD_S
}

/// Moves the muscle within `contractions` that the experiment has reached.
pub fn check(
    loaded: &Loaded,
    [from, to]: [f64; 2],
    rest_m: f64,
    bench: &mut dyn Bench,
) -> Result<Checked, RunError> {
    let (middle, amplitude) = (f64::midpoint(from, to), AMPLITUDE * (to - from));
    let sine_end_s = BEFORE_S + PERIODS / SINE_HZ;
    let sine = |time_s: f64| middle + amplitude * (TAU * SINE_HZ * (time_s - BEFORE_S)).sin();
    let mut profile = vec![(0.0, middle), (BEFORE_S, middle)];
    let points = ((sine_end_s - BEFORE_S) * 100.0).round() as usize;
    profile.extend((1..=points).map(|i| BEFORE_S + i as f64 * 0.01).map(|t| (t, sine(t))));
    let steps = [(middle, middle + amplitude), (middle + amplitude, middle - amplitude)];
    for (i, (_, value)) in steps.iter().enumerate() {
        let start_s = sine_end_s + i as f64 * HOLD_S;
        profile.extend([(start_s + 0.001, *value), (start_s + HOLD_S, *value)]);
    }
    let records = record(loaded, DriveKind::Contraction, profile, bench)?;
    let contraction = |record: &Record| 1.0 - record.length_m / rest_m;
    let within = |from_s: f64, to_s: f64| {
        records.iter().filter(move |record| (from_s..to_s).contains(&record.time_s))
    };
    let counted_from_s = BEFORE_S + 1.0 / SINE_HZ;
    let sine = within(counted_from_s, sine_end_s);
    let square = mean(sine.map(|r| (contraction(r) - r.set_point).powi(2)));
    let mut figures = Figures {
        sine_rms_percent: square.sqrt() / STROKE * 100.0,
        rest_error_percent: 0.0,
        settled_s: 0.0,
        overshoot_percent: 0.0,
    };
    for (i, (before, value)) in steps.into_iter().enumerate() {
        let start_s = sine_end_s + i as f64 * HOLD_S;
        let end_s = start_s + HOLD_S;
        let error = |record: &Record| (contraction(record) - value) / (value - before);
        let settled_s = within(start_s, end_s)
            .filter(|record| error(record).abs() > SETTLED)
            .fold(0.0, |_, record| record.time_s - start_s);
        let overshoot = within(start_s, end_s).map(error).fold(0.0, f64::max);
        let rest = mean(within(end_s - REST_S, end_s).map(|r| contraction(r) - value));
        figures.settled_s = figures.settled_s.max(settled_s);
        figures.overshoot_percent = figures.overshoot_percent.max(100.0 * overshoot);
        figures.rest_error_percent = figures.rest_error_percent.max(rest.abs() / STROKE * 100.0);
    }
    let points = records.iter().map(|r| (r.time_s, r.set_point, contraction(r))).collect();
    Ok(Checked { figures, points })
}
