//! Runs the same short motion before and after tuning.

use super::experiment::{Bench, BenchError, Plan, Record, record};
use crate::tune::check::{self, mean};
use model_core::joint::Motion;
use serde::Serialize;
use std::f64::consts::TAU;
use thermyo_compute::math::ends;
use thermyo_joint::JointLoaded;

const BEFORE_S: f64 = 1.0;
/// Frequency of the sine \[Hz\], and number of periods; the first one does not count.
const SINE_HZ: f64 = 1.0;
const PERIODS: f64 = 4.0;
/// Amplitude, and the angle of the rest after it, over the amplitude of the sweeps \[-\].
const AMPLITUDE: f64 = 0.5;
/// Duration of the rest, and of its last part, in which motion counts \[s\].
const REST_S: f64 = 3.0;
const COUNTED_S: f64 = 1.5;

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figures {
    pub sine_rms_rad: f64,
    pub rest_error_rad: f64,
    pub rest_motion_rad: f64,
}

pub type Checked = check::Checked<Figures>;

pub fn duration_s() -> f64 {
    BEFORE_S + PERIODS / SINE_HZ + REST_S
}

/// Moves the joint within the ends that the experiment has reached.
pub fn check(
    loaded: &JointLoaded,
    plan: &Plan,
    bench: &mut dyn Bench,
) -> Result<Checked, BenchError> {
    let [low, high] = plan.ends_rad;
    let [soft, stiff] = plan.stiffness_n_m_rad;
    let stiffness = f64::midpoint(soft, stiff);
    let (middle, amplitude) = (f64::midpoint(low, high), AMPLITUDE * 0.5 * (high - low));
    let end_s = BEFORE_S + PERIODS / SINE_HZ;
    let course = |time_s: f64| {
        let w = TAU * SINE_HZ;
        let (sin, cos) = (w * (time_s - BEFORE_S)).sin_cos();
        let still = |angle: f64| Motion::still(angle as f32, stiffness as f32);
        match time_s {
            t if t < BEFORE_S => still(middle),
            t if t < end_s => Motion {
                speed_rad_s: (amplitude * w * cos) as f32,
                acceleration_rad_s2: (-amplitude * w * w * sin) as f32,
                ..still(middle + amplitude * sin)
            },
            _ => still(middle + amplitude),
        }
    };
    let records = record(loaded, (&course, duration_s()), bench)?;
    let wanted = |record: &Record| f64::from(course(record.time_s).angle_rad);
    let within = |from_s: f64, to_s: f64| {
        records.iter().filter(move |record| (from_s..to_s).contains(&record.time_s))
    };
    let error = |record: &Record| record.angle_rad - wanted(record);
    let moving = || within(BEFORE_S + 1.0 / SINE_HZ, end_s);
    let resting = || within(duration_s() - COUNTED_S, f64::INFINITY).map(error);
    let [low, high] = ends(resting());
    let figures = Figures {
        sine_rms_rad: mean(moving().map(|record| error(record).powi(2))).sqrt(),
        rest_error_rad: mean(resting()),
        rest_motion_rad: 0.5 * (high - low),
    };
    let points = records.iter().map(|one| (one.time_s, wanted(one), one.angle_rad)).collect();
    Ok(Checked { figures, points })
}
