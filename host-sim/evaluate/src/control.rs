//! Control accuracy: at rest, in motion, warm and cold, with a wrong configuration, and against the
//! PID baseline.

use super::pid::{PidBoard, PidGains};
use super::{CaseFigures, Figure};
use model_core::{Command, Duty};
use std::f64::consts::TAU;
use thermyo_compute::math;
use thermyo_record::trace::Row;
use thermyo_scenario::{DriveKind, LoadKind, PlantModel, Scenario};
use thermyo_setup::Loaded;
use thermyo_simulation::board::{Board, CoreBoard};
use thermyo_simulation::run::{Run, RunError};

/// The stroke to which errors are relative: 30 % of the rest length, as a contraction \[-\].
pub(super) const STROKE: f64 = 0.3;
/// Held contractions as fractions of the stroke, in this order; up and down, far and near.
const HELD: [f64; 7] = [1.0 / 6.0, 0.5, 5.0 / 6.0, 0.5, 1.0 / 6.0, 2.0 / 3.0, 1.0 / 3.0];
const HOLD_S: f64 = 2.5;
/// Last part of a hold, which counts as rest \[s\].
const REST_S: f64 = 0.5;
/// Centre of the sines \[-\].
pub(super) const MIDDLE: f64 = 0.15;
const BEFORE_S: f64 = 1.0;
/// The best of some 170 combinations: least error of the slow sine on the nominal muscle, among those that hunt by at
/// most 1 % of the stroke at rest.
pub const USUAL_GAINS: PidGains =
    PidGains { proportional_pa: 1.2e6, integral_pa_s: 6.0e7, derivative_pa_s: 2.0e4 };

/// One row of a control run.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub time_s: f64,
    pub value: f64,
    driven: bool,
    /// Whether a valve is open for a whole period.
    open: bool,
    /// Whether a valve is switched on that was shut at the end of the step before.
    pub pulse: bool,
}

/// Whether a valve is switched on, judged by the commands of this step and of the one before: a valve that is open to
/// the end of its period and in the next one stays on.
fn switches_on(now: Command, before: Command) -> bool {
    let on = |now: Duty, before: Duty| now > Duty::ZERO && now != before && before < Duty::FULL;
    on(now.inlet, before.inlet) || on(now.outlet, before.outlet)
}

fn trace(
    loaded: &Loaded,
    kind: DriveKind,
    profile: Vec<(f64, f64)>,
    board: &mut dyn Board,
) -> Result<Vec<Point>, RunError> {
    stepped_trace(loaded, kind, profile, &[], board)
}

/// [`trace`] with steps of the load at these times \[s, N\].
pub(super) fn stepped_trace(
    loaded: &Loaded,
    kind: DriveKind,
    profile: Vec<(f64, f64)>,
    loads: &[(f64, f64)],
    board: &mut dyn Board,
) -> Result<Vec<Point>, RunError> {
    let loaded = loaded.driven(kind, profile);
    let rest_m = loaded.plant.muscle.rest_length_m;
    let (mut points, mut before) = (Vec::new(), Command::VENT);
    let mut observer = |row: &Row| {
        let command = row.telemetry.command;
        let pulse = switches_on(command, std::mem::replace(&mut before, command));
        points.push(Point {
            time_s: row.truth.time_s,
            value: match kind {
                DriveKind::Contraction => 1.0 - row.truth.length_m / rest_m,
                _ => row.truth.pressure_pa,
            },
            driven: command.inlet > Duty::ZERO || command.outlet > Duty::ZERO,
            open: command.inlet.max(command.outlet) >= Duty::FULL,
            pulse,
        });
        Ok(())
    };
    let mut run = Run::start(&loaded, board, None)?;
    let (mut time_s, mut loads) = (0.0, loads.iter().peekable());
    loop {
        if let Some((_, force_n)) = loads.next_if(|(at_s, _)| *at_s <= time_s) {
            let mut plant = loaded.plant.clone();
            plant.load.force_n = *force_n;
            run.retune(&plant, board)?;
        }
        if !run.step(board, &mut observer)? {
            return Ok(points);
        }
        time_s += loaded.plant.run.step_s;
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

/// Set points held one after the other.
pub mod rest {
    use super::{
        Board, DriveKind, HELD, HOLD_S, Loaded, Point, REST_S, RunError, STROKE, math, mean, trace,
    };

    /// Worst result of all holds, in percent of full scale.
    #[derive(Debug, Clone, Copy, Default)]
    pub struct Held {
        pub error_percent: f64,
        /// Largest motion at rest, peak to peak \[%\].
        pub ripple_percent: f64,
        /// Fraction of the rest in which a valve is driven \[-\].
        pub driven: f64,
    }

    #[derive(Debug, Clone, Copy)]
    pub(super) struct Holds<'a> {
        pub values: &'a [f64],
        pub start_s: f64,
        pub full_scale: f64,
    }

    impl Holds<'_> {
        pub fn profile(&self) -> Vec<(f64, f64)> {
            let holds = self.values.iter().enumerate();
            holds
                .flat_map(|(i, value)| {
                    let time_s = self.start_s + i as f64 * HOLD_S;
                    [(time_s, *value), (time_s + HOLD_S - 0.001, *value)]
                })
                .collect()
        }

        pub fn worst(&self, points: &[Point]) -> Held {
            let mut held = Held::default();
            for (i, value) in self.values.iter().enumerate() {
                let end_s = self.start_s + (i + 1) as f64 * HOLD_S - 0.002;
                let at_rest: Vec<&Point> = points
                    .iter()
                    .filter(|point| (end_s - REST_S..end_s).contains(&point.time_s))
                    .collect();
                let error = mean(at_rest.iter().map(|point| point.value)) - value;
                let [low, high] = math::ends(at_rest.iter().map(|point| point.value));
                let driven = mean(at_rest.iter().map(|point| f64::from(u8::from(point.driven))));
                let percent = 100.0 / self.full_scale;
                held.error_percent = held.error_percent.max(error.abs() * percent);
                held.ripple_percent = held.ripple_percent.max((high - low) * percent);
                held.driven = held.driven.max(driven);
            }
            held
        }
    }

    /// Holds the contractions of the evaluation, after `strokes` full strokes of 2 s each.
    pub fn hold(loaded: &Loaded, strokes: u32, board: &mut dyn Board) -> Result<Held, RunError> {
        hold_within(loaded, strokes, [STROKE; 2], board)
    }

    /// Holds these contractions one after the other.
    pub fn hold_at(
        loaded: &Loaded,
        values: &[f64],
        board: &mut dyn Board,
    ) -> Result<Held, RunError> {
        let holds = Holds { values, start_s: 0.0, full_scale: STROKE };
        Ok(holds.worst(&trace(loaded, DriveKind::Contraction, holds.profile(), board)?))
    }

    /// [`hold`] on a muscle with another stroke, of which `reach` remains under load; contractions \[-\].
    pub fn hold_within(
        loaded: &Loaded,
        strokes: u32,
        [stroke, reach]: [f64; 2],
        board: &mut dyn Board,
    ) -> Result<Held, RunError> {
        let mut profile = Vec::new();
        let mut start_s = 0.0;
        for _ in 0..strokes {
            profile.extend([(start_s, reach / 6.0), (start_s + 1.0, reach * 5.0 / 6.0)]);
            start_s += 2.0;
        }
        let values = HELD.map(|share| share * reach);
        let holds = Holds { values: &values, start_s, full_scale: stroke };
        profile.extend(holds.profile());
        Ok(holds.worst(&trace(loaded, DriveKind::Contraction, profile, board)?))
    }
}

#[derive(Debug, Clone, Copy)]
pub struct Sine {
    /// Amplitude out over amplitude in \[-\].
    pub gain: f64,
    pub phase_deg: f64,
    /// RMS error to the set point, of the stroke \[%\].
    pub rms_percent: f64,
    /// Fraction of the time in which a valve is fully open \[-\].
    pub open: f64,
    /// Pulses \[1/s\]: how often a valve is switched on.
    pub pulses_per_s: f64,
}

/// One row of a sine, after the first periods, in which it settles.
#[derive(Debug, Clone, Copy)]
pub(super) struct SinePoint {
    /// Time since the sine began \[s\].
    pub time_s: f64,
    /// Contraction \[-\].
    pub value: f64,
    /// Contraction minus set point \[-\].
    pub error: f64,
    /// Whether a valve is open for a whole period.
    pub open: bool,
    /// Whether a valve is switched on.
    pub pulse: bool,
}

/// Whole periods of a sine around the middle of the stroke; the amplitude is a fraction of the
/// stroke.
pub(super) fn sine_trace(
    loaded: &Loaded,
    frequency_hz: f64,
    amplitude: f64,
    board: &mut dyn Board,
) -> Result<Vec<SinePoint>, RunError> {
    let amplitude = amplitude * STROKE;
    let set_point = |time_s: f64| {
        MIDDLE + amplitude * (TAU * frequency_hz * (time_s - BEFORE_S).max(0.0)).sin()
    };
    let counted_s = (2.0 * frequency_hz).ceil().max(2.0) / frequency_hz;
    let from_s = BEFORE_S + 1.0_f64.max(1.0 / frequency_hz);
    let end_s = from_s + counted_s;
    let rows = (end_s * 100.0).ceil() as usize;
    let profile = (0..=rows).map(|row| row as f64 * 0.01).map(|t| (t, set_point(t))).collect();
    let points = trace(loaded, DriveKind::Contraction, profile, board)?;
    let counted = points.iter().filter(|p| p.time_s >= from_s && p.time_s < end_s);
    let row = |p: &Point| SinePoint {
        time_s: p.time_s - BEFORE_S,
        value: p.value,
        error: p.value - set_point(p.time_s),
        open: p.open,
        pulse: p.pulse,
    };
    Ok(counted.map(row).collect())
}

/// Response to a sine around the middle of the stroke; the amplitude is a fraction of the stroke.
pub fn sine(
    loaded: &Loaded,
    frequency_hz: f64,
    amplitude: f64,
    board: &mut dyn Board,
) -> Result<Sine, RunError> {
    let points = sine_trace(loaded, frequency_hz, amplitude, board)?;
    let scale = 2.0 / (amplitude * STROKE);
    let angle = |p: &SinePoint| TAU * frequency_hz * p.time_s;
    let in_phase = scale * mean(points.iter().map(|p| p.value * angle(p).sin()));
    let quadrature = scale * mean(points.iter().map(|p| p.value * angle(p).cos()));
    let square = mean(points.iter().map(|p| p.error * p.error));
    Ok(Sine {
        gain: in_phase.hypot(quadrature),
        phase_deg: quadrature.atan2(in_phase).to_degrees(),
        rms_percent: square.sqrt() / STROKE * 100.0,
        open: mean(points.iter().map(|p| f64::from(u8::from(p.open)))),
        pulses_per_s: mean(points.iter().map(|p| f64::from(u8::from(p.pulse))))
            / loaded.plant.run.step_s,
    })
}

pub fn rms_mm(loaded: &Loaded, sine: &Sine) -> f64 {
    10.0 * sine.rms_percent * STROKE * loaded.plant.muscle.rest_length_m
}

#[derive(Debug, Clone, Copy)]
pub struct Step {
    /// Time to stay within 2 % of the step, over the time with the open valve \[-\].
    pub times_open_valve: f64,
    pub overshoot_percent: f64,
}

/// Pressures before and after a step \[Pa\].
pub(super) const STEP_PA: [f64; 2] = [2.0e5, 4.0e5];

/// Pressure over the time since a step, with the loop closed, and with the valve simply open.
pub(super) type StepTraces = (Vec<(f64, f64)>, Vec<(f64, f64)>);

/// A step of the pressure on a board, and on the same plant with the valve open, both from the same rest.
pub(super) fn pressure_step_traces(
    loaded: &Loaded,
    [low, high]: [f64; 2],
    board: &mut dyn Board,
) -> Result<StepTraces, RunError> {
    const STEP_S: f64 = 1.5;
    const OPEN_S: f64 = 0.1;
    let since = |points: Vec<Point>, start_s: f64| -> Vec<(f64, f64)> {
        points.iter().map(|point| (point.time_s - start_s, point.value)).collect()
    };
    let profile = vec![(0.0, low), (STEP_S, low), (STEP_S + 0.001, high), (STEP_S + 2.0, high)];
    let closed = trace(loaded, DriveKind::Pressure, profile, board)?;
    // The profile of duties starts where the loop was at rest.
    let mut open = loaded.clone();
    open.plant.plant.initial_pressure_pa = low;
    let duties = vec![(0.0, 0.0), (OPEN_S - 0.001, 0.0), (OPEN_S, 1.0), (1.0, 1.0)];
    let open = trace(&open, DriveKind::Duty, duties, &mut CoreBoard::default())?;
    Ok((since(closed, STEP_S), since(open, OPEN_S)))
}

/// A step of the pressure from 2 to 4 bar, compared with the open valve on the same plant.
pub fn pressure_step(loaded: &Loaded, board: &mut dyn Board) -> Result<Step, RunError> {
    pressure_step_between(loaded, STEP_PA, board)
}

/// [`pressure_step`] between two absolute pressures \[Pa\].
pub fn pressure_step_between(
    loaded: &Loaded,
    [low, high]: [f64; 2],
    board: &mut dyn Board,
) -> Result<Step, RunError> {
    let (closed, open) = pressure_step_traces(loaded, [low, high], board)?;
    let band = 0.02 * (high - low);
    let late = closed.iter().filter(|(since_s, _)| *since_s >= 0.0);
    let settled_s = late
        .clone()
        .filter(|(_, pa)| (pa - high).abs() > band)
        .map(|(since_s, _)| *since_s)
        .fold(0.0, f64::max);
    let peak = late.map(|(_, pa)| *pa).fold(f64::NEG_INFINITY, f64::max);
    let reached = open.iter().find(|(_, pa)| *pa >= high - band);
    let reached_s = reached.map_or(f64::INFINITY, |(since_s, _)| *since_s);
    Ok(Step {
        times_open_valve: settled_s / reached_s,
        overshoot_percent: (peak - high).max(0.0) / (high - low) * 100.0,
    })
}

/// Sets the ambient temperature of plant and core, and with it that of supply and muscle.
pub fn ambient(loaded: &Loaded, temperature_k: f64) -> Loaded {
    loaded.with(|scenario| {
        scenario.ambient.temperature_k = temperature_k;
        scenario.supply.temperature_k = temperature_k;
        scenario.plant.initial_temperature_k = temperature_k;
    })
}

pub(super) fn load(loaded: &Loaded, force_n: f64) -> Loaded {
    loaded.with(|scenario| scenario.load.force_n = force_n)
}

/// Change of a scenario: of the plant, or of the core's configuration.
pub type Change = fn(&mut Scenario);

/// Holds after this number of strokes, with errors up to `most_percent`.
fn holds(loaded: &Loaded, strokes: u32, most_percent: f64) -> Result<Vec<Figure>, RunError> {
    let held = rest::hold(loaded, strokes, &mut CoreBoard::default())?;
    // Creep continues: 1.5 N/s after a way of 27 mm, 0.1 mm/s, which needs a pulse every 2 to 4 s. A muscle that does
    // not creep is left alone.
    let muscle = &loaded.plant.muscle;
    let creeps = muscle.creep_fast_n_m > 0.0 || muscle.creep_slow_n_m > 0.0;
    let (ripple_percent, driven) = if creeps { (0.5, 0.12) } else { (0.2, 0.0) };
    // The crept bladder holds 15 mm against 20 N and friction: the vented muscle does not return.
    if load_n(&loaded.plant) < LIGHT_N && creeps {
        return Ok(vec![Figure::shown("error_percent", held.error_percent)]);
    }
    Ok(held_within(&held, [most_percent, ripple_percent, driven]))
}

/// Error and ripple at rest \[%\], and the fraction of the rest in which a valve may be driven.
pub(super) fn held_within(held: &rest::Held, [error, ripple, driven]: [f64; 3]) -> Vec<Figure> {
    vec![
        Figure::at_most("error_percent", held.error_percent, error),
        Figure::at_most("ripple_percent", held.ripple_percent, ripple),
        Figure::at_most("valves_driven", held.driven, driven),
    ]
}

pub(super) fn step_figures(step: &Step) -> Vec<Figure> {
    vec![
        Figure::at_most("times_open_valve", step.times_open_valve, 1.3),
        Figure::at_most("overshoot_percent", step.overshoot_percent, 2.0),
    ]
}

/// Load below which slip and creep hold the muscle where it was \[N\].
const LIGHT_N: f64 = 40.0;

fn load_n(scenario: &Scenario) -> f64 {
    match scenario.load.kind {
        LoadKind::Mass => scenario.load.mass_kg * 9.81,
        _ => scenario.load.force_n,
    }
}

/// The muscle without slip and creep: only friction holds it.
pub(super) fn creepless(loaded: &Loaded) -> Loaded {
    loaded.with(no_creep)
}

pub(super) fn no_creep(scenario: &mut Scenario) {
    scenario.muscle.creep_fast_n_m = 0.0;
    scenario.muscle.creep_slow_n_m = 0.0;
}

/// The nominal muscle with all effects that the core leaves out.
pub fn full(nominal: &Loaded) -> Loaded {
    nominal.with_model(PlantModel::Full)
}

pub(super) type Job<'a> = Box<dyn Fn() -> Result<CaseFigures, RunError> + Send + Sync + 'a>;

pub(super) fn job<'a>(
    case: String,
    figures: impl Fn() -> Result<Vec<Figure>, RunError> + Send + Sync + 'a,
) -> Job<'a> {
    Box::new(move || Ok(CaseFigures { case: case.clone(), figures: figures()? }))
}

fn holding(full: &Loaded) -> Vec<Job<'_>> {
    let mut jobs: Vec<Job> = Vec::new();
    for temperature_k in [283.15, 298.15, 313.15] {
        let at = move |loaded: &Loaded, force_n| load(&ambient(loaded, temperature_k), force_n);
        let celsius = temperature_k - 273.15;
        for force_n in [20.0, 100.0, 200.0] {
            let case = format!("hold, {force_n} N, {celsius:.0} degC, cold");
            jobs.push(job(case, move || holds(&at(full, force_n), 0, 1.0)));
        }
        let case = format!("hold, 20 N, {celsius:.0} degC, no creep");
        jobs.push(job(case, move || holds(&at(&creepless(full), 20.0), 0, 1.0)));
        let case = format!("hold, 100 N, {celsius:.0} degC, after 200 strokes");
        jobs.push(job(case, move || holds(&ambient(full, temperature_k), 200, 1.0)));
    }
    let wrong: [(&str, Change); 8] = [
        ("friction 20 % low", |s| s.friction.force_n *= 0.8),
        ("friction 20 % high", |s| s.friction.force_n *= 1.2),
        ("volume 20 % low", |s| volume(s, 0.8)),
        ("volume 20 % high", |s| volume(s, 1.2)),
        ("conductance 20 % low", |s| s.valve.conductance_m3_s_pa *= 0.8),
        ("conductance 20 % high", |s| s.valve.conductance_m3_s_pa *= 1.2),
        ("load 80 N too high", |s| s.load.force_n += 80.0),
        ("load 80 N too low", |s| s.load.force_n -= 80.0),
    ];
    for (name, change) in wrong {
        let case = format!("hold, {name}");
        jobs.push(job(case, move || holds(&full.believing(change), 0, 2.0)));
    }
    jobs
}

/// Changes the volume by the number of turns, which enters volume and force as a square.
pub(super) fn volume(scenario: &mut Scenario, factor: f64) {
    let muscle = &mut scenario.muscle;
    muscle.turns /= factor.sqrt();
    muscle.diameter_m *= factor.sqrt();
}

/// Contractions of [`overshoot_percent`], held one after the other.
const STEPS: [f64; 6] = [0.08, 0.16, 0.05, 0.2, 0.12, 0.08];

/// Largest overshoot of steps of the contraction, relative to the step \[%\].
pub fn overshoot_percent(loaded: &Loaded, board: &mut dyn Board) -> Result<f64, RunError> {
    let holds = rest::Holds { values: &STEPS, start_s: 0.0, full_scale: 1.0 };
    let points = trace(loaded, DriveKind::Contraction, holds.profile(), board)?;
    let beyond = |(i, pair): (usize, &[f64])| {
        let from_s = (i + 1) as f64 * HOLD_S;
        let step = pair[1] - pair[0];
        let within = points.iter().filter(|p| (from_s..from_s + HOLD_S).contains(&p.time_s));
        within.map(|p| 100.0 * (p.value - pair[1]) / step).fold(0.0, f64::max)
    };
    Ok(STEPS.windows(2).enumerate().map(beyond).fold(0.0, f64::max))
}

/// The muscle at a fixed length.
pub(super) fn isometric(loaded: &Loaded, length_m: f64) -> Loaded {
    loaded.with(|s| (s.load.kind, s.load.length_m) = (LoadKind::Isometric, length_m))
}

/// Loads other than a constant force: a hanging mass, and a fixed length.
fn other_loads(full: &Loaded) -> Vec<Job<'_>> {
    let mut jobs: Vec<Job> = Vec::new();
    let hanging =
        |mass_kg: f64| full.with(|s| (s.load.kind, s.load.mass_kg) = (LoadKind::Mass, mass_kg));
    for mass_kg in [2.0, 10.0, 20.0] {
        let loaded = hanging(mass_kg);
        let case = format!("hold, {mass_kg} kg hanging");
        jobs.push(job(case, move || holds(&loaded, 0, 1.0)));
    }
    for mass_kg in [5.0, 10.0, 20.0, 30.0] {
        let loaded = hanging(mass_kg);
        jobs.push(job(
            format!("steps of 4 to 15 % contraction, {mass_kg} kg hanging"),
            move || {
                let overshoot = overshoot_percent(&loaded, &mut CoreBoard::default())?;
                Ok(vec![Figure::at_most("overshoot_percent", overshoot, 10.0)])
            },
        ));
    }
    for length_m in [0.29, 0.27, 0.24] {
        let loaded = isometric(full, length_m);
        jobs.push(job(format!("isometric, {:.0} mm", 1e3 * length_m), move || {
            let step = pressure_step(&loaded, &mut CoreBoard::default())?;
            let held = force_hold(&loaded, &mut CoreBoard::default())?;
            Ok(vec![
                Figure::at_most("times_open_valve", step.times_open_valve, 1.3),
                Figure::at_most("overshoot_percent", step.overshoot_percent, 2.0),
                Figure::at_most("force_error_percent", held.error_percent, 1.0),
                // 1.5 % of the last step, 2 bar, in either direction while the gas relaxes.
                Figure::at_most("force_ripple_percent", held.ripple_percent, 2.0),
                Figure::at_most("valves_driven", held.driven, 0.04),
            ])
        }));
    }
    jobs
}

/// Holds pressures at a fixed length; errors are those of the force, in percent of the largest. Force and gauge
/// pressure are proportional except for the bladder's force, which is constant.
fn force_hold(loaded: &Loaded, board: &mut dyn Board) -> Result<rest::Held, RunError> {
    let ambient_pa = loaded.plant.ambient.pressure_pa;
    let held_pa = [1.5e5, 3.0e5, 4.0e5, 3.0e5, 2.0e5];
    let largest_pa = 4.0e5 - ambient_pa;
    let holds = rest::Holds { values: &held_pa, start_s: 0.0, full_scale: largest_pa };
    let points = trace(loaded, DriveKind::Pressure, holds.profile(), board)?;
    Ok(holds.worst(&points))
}

fn moving(full: &Loaded) -> Vec<Job<'_>> {
    let mut jobs: Vec<Job> = Vec::new();
    // At 50 N the muscle works at 1.4 bar, where the open outlet passes 0.5 g/s: the reversal of 30
    // N of friction alone takes a third of half a period at 5 Hz.
    for (force_n, bandwidth_target_hz) in [(50.0, 5.0), (100.0, 5.0), (200.0, 5.0)] {
        jobs.push(job(format!("pressure 2 to 4 bar, {force_n} N"), move || {
            let loaded = load(full, force_n);
            let step = pressure_step(&loaded, &mut CoreBoard::default())?;
            Ok(step_figures(&step))
        }));
        jobs.push(job(format!("sine of 2.5 % of stroke, {force_n} N"), move || {
            let loaded = load(full, force_n);
            let at = |hz: f64| sine(&loaded, hz, 0.025, &mut CoreBoard::default());
            let mut peak: f64 = 0.0;
            let mut bandwidth_hz: f64 = 0.0;
            // Bandwidth: last frequency up to which every gain is above -3 dB.
            let mut within = true;
            for step in 2..=16 {
                let hz = 0.5 * f64::from(step);
                let gain = at(hz)?.gain;
                peak = peak.max(gain);
                within &= gain >= 0.5_f64.sqrt();
                if within {
                    bandwidth_hz = hz;
                }
            }
            Ok(vec![
                Figure::at_least("bandwidth_hz", bandwidth_hz, bandwidth_target_hz),
                Figure::at_most("largest_gain", peak, 1.5),
            ])
        }));
        jobs.push(job(format!("0.5 Hz over 30 % of stroke, {force_n} N"), move || {
            let loaded = load(full, force_n);
            let slow = sine(&loaded, 0.5, 0.15, &mut CoreBoard::default())?;
            Ok(vec![Figure::at_most("rms_percent", slow.rms_percent, 2.0)])
        }));
    }
    jobs
}

/// Sets friction to its value at room temperature, whatever the wall does.
pub(super) fn for_the_room(s: &mut Scenario) {
    let warmer_k = s.ambient.temperature_k - s.friction.reference_temperature_k;
    s.friction.force_n *= math::exp(-s.friction.softening_per_k * warmer_k);
    s.friction.softening_per_k = 0.0;
}

fn compared(full: &Loaded) -> Vec<Job<'_>> {
    [283.15, 313.15]
        .into_iter()
        .map(|temperature_k| {
            job(format!("0.5 Hz sine, {:.0} degC", temperature_k - 273.15), move || {
                let loaded = ambient(full, temperature_k);
                let fixed = loaded.believing(|s| s.friction.softening_per_k = 0.0);
                let room = loaded.believing(for_the_room);
                let rms = |loaded: &Loaded, board: &mut dyn Board| {
                    sine(loaded, 0.5, 0.15, board).map(|slow| slow.rms_percent)
                };
                let rest_m = full.plant.muscle.rest_length_m;
                let compensated = rms(&loaded, &mut CoreBoard::default())?;
                let uncompensated = rms(&fixed, &mut CoreBoard::default())?;
                let by_thermometer = rms(&room, &mut CoreBoard::default())?;
                let usual = rms(&loaded, &mut PidBoard::new(USUAL_GAINS, rest_m))?;
                Ok(vec![
                    Figure::at_most("rms_percent", compensated, 2.0),
                    // The load observer compensates for a friction that is configured not to soften.
                    Figure::at_most("fixed_friction_times", uncompensated / compensated, 2.0),
                    // A thermometer in the room does nearly as well as the estimated wall.
                    Figure::shown("room_friction_times", by_thermometer / compensated),
                    Figure::at_least("pid_times", usual / compensated, 3.0),
                ])
            })
        })
        .collect()
}

pub(super) fn jobs(full: &Loaded) -> Vec<Job<'_>> {
    [holding(full), other_loads(full), moving(full), compared(full)].into_iter().flatten().collect()
}
