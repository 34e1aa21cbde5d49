//! Loads, friction and masses that are not as configured, steps of the load, gas that relaxes: disturbances that the
//! loops have to observe.

use super::control::rest::{self, Held};
use super::control::{
    Change, Job, Point, STROKE, creepless, isometric, job, load, no_creep, rms_mm, sine,
    stepped_trace,
};
use super::{CaseFigures, Figure};
use thermyo_compute::parallel::{self, Watch};
use thermyo_scenario::{DriveKind, HeatModel};
use thermyo_setup::Loaded;
use thermyo_simulation::board::{Board, CoreBoard};
use thermyo_simulation::run::RunError;

/// Friction, with its surplus at standstill, is a multiple of the configured one.
const TWICE: Change = |s| {
    s.friction.force_n *= 2.0;
    s.friction.stribeck_force_n *= 2.0;
};
const NO_FRICTION: Change = |s| {
    s.friction.force_n = 0.0;
    s.friction.stribeck_force_n = 0.0;
};
const TEN_KG: Change = |s| s.load.mass_kg = 10.0;
const TWICE_THE_FLOW: Change = |s| s.valve.conductance_m3_s_pa *= 2.0;
const HALF_THE_FLOW: Change = |s| s.valve.conductance_m3_s_pa *= 0.5;

fn sines(full: &Loaded) -> Vec<Job<'_>> {
    // Two frequencies; amplitudes as shares of the stroke: 13.5 and 4.5 mm.
    let cases: [(&str, Change, f64, f64, f64); 6] = [
        ("as believed", |_| {}, 0.5, 0.15, 0.1),
        ("friction twice the believed", TWICE, 0.5, 0.15, 0.2),
        ("no friction", NO_FRICTION, 0.5, 0.15, 0.2),
        ("friction twice the believed", TWICE, 2.0, 0.05, 0.5),
        ("10 kg, believed 2", TEN_KG, 2.0, 0.05, 0.5),
        ("friction twice the believed, 200 N", TWICE, 2.0, 0.05, 0.5),
    ];
    let jobs = cases.into_iter().map(|(name, change, hz, amplitude, most_mm)| {
        job(format!("{hz} Hz sine, {name}"), move || {
            let mut loaded = full.unexpected(change);
            if name.ends_with("200 N") {
                loaded = load(&loaded, 200.0);
            }
            let followed = sine(&loaded, hz, amplitude, &mut CoreBoard::default())?;
            let mut figures = vec![Figure::at_most("rms_mm", rms_mm(&loaded, &followed), most_mm)];
            if hz < 1.0 {
                figures.push(Figure::at_most("pulses_per_s", followed.pulses_per_s, 60.0));
            }
            Ok(figures)
        })
    });
    jobs.collect()
}

/// Times of load steps, and the end of the run \[s\].
const LOADS_S: [f64; 5] = [3.0, 6.0, 9.0, 12.0, 15.0];
/// 1 % of the stroke.
const BACK_SHARE: f64 = 0.01;

/// Worst of four load steps: 50 N more, back, 50 N less, back.
#[derive(Debug, Clone, Copy, Default)]
pub struct LoadSteps {
    /// Time until the error stays within 1 % of the stroke \[s\].
    pub back_s: f64,
    /// Error half a second before the next step \[%\] of the stroke.
    pub error_percent: f64,
    /// Pulses per second, from one second after a step on.
    pub late_pulses_per_s: f64,
}

/// Holds the middle of the stroke while the load steps.
pub fn load_steps(loaded: &Loaded, board: &mut dyn Board) -> Result<LoadSteps, RunError> {
    const GOAL: f64 = 0.5 * STROKE;
    let force_n = loaded.plant.load.force_n;
    let forces_n = [force_n + 50.0, force_n, force_n - 50.0, force_n];
    let loads: Vec<(f64, f64)> = LOADS_S.into_iter().zip(forces_n).collect();
    let profile = vec![(0.0, GOAL), (LOADS_S[4], GOAL)];
    let points = stepped_trace(loaded, DriveKind::Contraction, profile, &loads, board)?;
    let mut worst = LoadSteps::default();
    for window in LOADS_S.windows(2) {
        let (from_s, end_s) = (window[0], window[1] - 0.01);
        let within =
            |from_s: f64| points.iter().filter(move |p| p.time_s >= from_s && p.time_s < end_s);
        let off = |p: &&Point| (p.value - GOAL).abs() > BACK_SHARE * STROKE;
        let back_s = within(from_s).filter(off).map(|p| p.time_s - from_s).fold(0.0, f64::max);
        let error = within(end_s - 0.5).map(|p| (p.value - GOAL).abs()).fold(0.0, f64::max);
        let late = within(from_s + 1.0).filter(|p| p.pulse).count() as f64;
        worst.back_s = worst.back_s.max(back_s);
        worst.error_percent = worst.error_percent.max(100.0 * error / STROKE);
        worst.late_pulses_per_s = worst.late_pulses_per_s.max(late / (end_s - from_s - 1.0));
    }
    Ok(worst)
}

/// Seeds of the noise: a single seed shifts the end of a load step by up to half a second where friction holds the
/// muscle.
const SEEDS: std::ops::RangeInclusive<u64> = 1..=6;

/// Worst of [`load_steps`] over the seeds.
fn worst_load_steps(mut loaded: Loaded) -> Result<LoadSteps, RunError> {
    let mut worst = LoadSteps::default();
    for seed in SEEDS {
        loaded.plant.run.seed = seed;
        let steps = load_steps(&loaded, &mut CoreBoard::default())?;
        worst.back_s = worst.back_s.max(steps.back_s);
        worst.error_percent = worst.error_percent.max(steps.error_percent);
        worst.late_pulses_per_s = worst.late_pulses_per_s.max(steps.late_pulses_per_s);
    }
    Ok(worst)
}

fn loads(full: &Loaded) -> Vec<Job<'_>> {
    let cases: [(&str, Change); 7] = [
        ("as believed", |_| {}),
        ("friction twice the believed", TWICE),
        ("no friction", NO_FRICTION),
        ("10 kg, believed 2", TEN_KG),
        ("creep that is only believed", no_creep),
        ("conductance twice the believed", TWICE_THE_FLOW),
        ("conductance half the believed", HALF_THE_FLOW),
    ];
    let jobs = cases.into_iter().map(|(name, change)| {
        job(format!("load steps of 50 N, {name}"), move || {
            let steps = worst_load_steps(full.unexpected(change))?;
            Ok(vec![
                Figure::at_most("back_s", steps.back_s, 0.5),
                Figure::at_most("error_percent", steps.error_percent, 0.5),
                Figure::at_most("late_pulses_per_s", steps.late_pulses_per_s, 20.0),
            ])
        })
    });
    jobs.collect()
}

fn resting(full: &Loaded) -> Vec<Job<'_>> {
    let cases: [(&str, bool, Change); 6] = [
        ("no creep", true, |_| {}),
        ("creep", false, |_| {}),
        ("no friction", false, NO_FRICTION),
        ("friction twice the believed", false, TWICE),
        ("creep that is only believed", false, no_creep),
        ("conductance twice the believed", false, TWICE_THE_FLOW),
    ];
    let jobs = cases.into_iter().map(|(name, still, change)| {
        job(format!("at rest, {name}"), move || {
            let loaded = if still { creepless(full) } else { full.clone() }.unexpected(change);
            let held = rest::hold(&loaded, 0, &mut CoreBoard::default())?;
            let stroke_mm = 1e3 * STROKE * loaded.plant.muscle.rest_length_m;
            Ok(vec![
                Figure::at_most("error_mm", 0.01 * held.error_percent * stroke_mm, 0.25),
                Figure::at_most("valves_driven", held.driven, if still { 0.0 } else { 0.12 }),
            ])
        })
    });
    jobs.collect()
}

/// Lengths in and beside a code that the converter makes too wide, 255.1 to 256.1 mm, starting at 253.5 mm; and lengths
/// from which they are approached in turn \[m\].
const WIDE_M: (f64, f64) = (0.2535, 0.0003);
const AWAY_M: [f64; 2] = [0.245, 0.268];

/// Holds in and beside a wide code: there the position of the muscle is not visible, and no valve changes that.
pub fn hold_across_a_wide_code(loaded: &Loaded, board: &mut dyn Board) -> Result<Held, RunError> {
    let (from_m, apart_m) = WIDE_M;
    let goals = (0..14).flat_map(|i| [AWAY_M[i % 2], from_m + apart_m * i as f64]);
    let rest_m = loaded.plant.muscle.rest_length_m;
    let values: Vec<f64> = goals.map(|length_m| 1.0 - length_m / rest_m).collect();
    rest::hold_at(loaded, &values, board)
}

fn across_a_wide_code(full: &Loaded) -> Vec<Job<'_>> {
    let cases = [
        ("20 N, no creep", load(&creepless(full), 20.0)),
        ("creep", full.clone()),
        ("no friction", full.unexpected(NO_FRICTION)),
    ];
    let jobs = cases.into_iter().map(|(name, loaded)| {
        job(format!("across a wide code, {name}"), move || {
            let held = hold_across_a_wide_code(&loaded, &mut CoreBoard::default())?;
            let stroke_mm = 1e3 * STROKE * loaded.plant.muscle.rest_length_m;
            Ok(vec![
                // Half of the code, and the dead zone on either side.
                Figure::at_most("error_mm", 0.01 * held.error_percent * stroke_mm, 0.75),
                Figure::at_most("valves_driven", held.driven, 0.12),
            ])
        })
    });
    jobs.collect()
}

/// Pulses from half a second after a step of the pressure from 2 to 4 bar on, and after the step back, in 10 s.
pub fn late_pulses(loaded: &Loaded, board: &mut dyn Board) -> Result<[usize; 2], RunError> {
    const STEPS_S: [f64; 3] = [2.0, 12.5, 23.0];
    let [low, high] = [2.0e5, 4.0e5];
    let profile = vec![
        (0.0, low),
        (STEPS_S[0] - 0.001, low),
        (STEPS_S[0], high),
        (STEPS_S[1] - 0.001, high),
        (STEPS_S[1], low),
        (STEPS_S[2], low),
    ];
    let points = stepped_trace(loaded, DriveKind::Pressure, profile, &[], board)?;
    let late = |step: usize| {
        let from_s = STEPS_S[step] + 0.5;
        points.iter().filter(|p| p.pulse && p.time_s > from_s && p.time_s < from_s + 10.0).count()
    };
    Ok([late(0), late(1)])
}

fn relaxing(full: &Loaded) -> Vec<Job<'_>> {
    let still: Change = |s| (s.heat.model, s.heat.inner_w_m2_k) = (HeatModel::Constant, 10.0);
    let stirred: Change = |_| {};
    let jobs =
        [("stirred gas", stirred), ("still gas", still)].into_iter().map(|(name, change)| {
            job(format!("pressure 2 to 4 bar and back, 270 mm, {name}"), move || {
                let loaded = isometric(&full.with(change), 0.27);
                let [filled, vented] = late_pulses(&loaded, &mut CoreBoard::default())?;
                Ok(vec![
                    Figure::at_most("late_pulses", filled as f64, 5.0),
                    Figure::at_most("late_pulses_back", vented as f64, 5.0),
                ])
            })
        });
    jobs.collect()
}

fn jobs(full: &Loaded) -> Vec<Job<'_>> {
    let observed =
        [sines(full), loads(full), resting(full), across_a_wide_code(full), relaxing(full)];
    let proportional = super::control_proportional::jobs(full);
    let hosts = super::control_hosts::jobs(full);
    let others = observed.into_iter().flatten().chain(proportional).chain(hosts);
    super::control::jobs(full).into_iter().chain(others).collect()
}

/// Runs every case of control on `full`, on all cores. When stopped, returns the lines of the finished cases.
pub fn evaluate(nominal: &Loaded, watch: &dyn Watch) -> Result<Vec<CaseFigures>, RunError> {
    let full = &super::control::full(nominal);
    parallel::map_watched(&jobs(full), watch, |job| job()).into_iter().collect()
}
