//! A joint of two muscles: tracking, steps, rest, loads and stiffness, configured correctly and wrongly, light and
//! heavy; and that both muscles vent in the same step.

use super::{CaseFigures, Figure};
use model_core::Command;
use model_core::joint::{JointFaults, JointMode, Motion};
use model_core::safety::supervisor::VENTING;
use std::f64::consts::TAU;
use std::path::Path;
use thermyo_compute::math::{self, ends};
use thermyo_compute::parallel::{self, Watch};
use thermyo_files::input::InputError;
use thermyo_files::shipped;
use thermyo_joint::{Inputs, JointLoaded, Rig, Row, RunError};
use thermyo_plant::BuildError;
use thermyo_scenario::{ChannelFault, FaultWindow, Scenario, ValveFault};
use thermyo_studies::joint_tune::{self, BenchError, Simulated, TuneError};
use thermyo_studies::tune::HIGHEST_PA;

/// Stiffness of all cases except those that change it \[N m/rad\].
const STIFFNESS: f64 = 14.0;
/// Rest before a motion begins \[s\].
const BEFORE_S: f64 = 1.0;
/// Inertia of the heavy arm: 2 kg at 0.25 m, and the arm itself \[kg m2\].
const HEAVY_KG_M2: f64 = 0.145;
/// Error within which a step has settled \[deg\].
const SETTLED_DEG: f64 = 0.5;
/// External torque of the load step \[N m\].
const LOAD_N_M: f64 = 2.0;
/// Slope of a pulley's radii: 20 % over 60 deg \[1/rad\].
const VARIES_PER_RAD: f64 = 0.191;
/// Faults injected, in turn into muscle a and into muscle b.
const FAULTS: u64 = 100;
const LOCK_S: f64 = 3.0;

/// Targets that depend on the configuration and on the arm.
#[derive(Debug, Clone, Copy)]
struct Targets {
    sines_deg: [f64; 4],
    stiffness_percent: f64,
}

const RIGHT: Targets = Targets { sines_deg: [0.15, 0.2, 0.35, 0.3], stiffness_percent: 1.0 };
const HEAVY: Targets = Targets { sines_deg: [0.15, 0.2, 0.35, 0.2], stiffness_percent: 1.0 };
const WRONG: Targets = Targets { sines_deg: [0.3, 0.8, 1.7, 1.7], stiffness_percent: 5.0 };

struct Case {
    name: &'static str,
    loaded: JointLoaded,
    measure: fn(&JointLoaded) -> Result<Vec<Figure>, RunError>,
}

pub fn nominal() -> Result<JointLoaded, InputError> {
    thermyo_joint::parse(shipped::text("joint.toml"), Path::new("scenarios/joint.toml"))
}

/// Everything wrong that a user does not know, with one sign: the plant differs, the core keeps the nominal values.
fn all_wrong(nominal: &JointLoaded, sign: f64) -> JointLoaded {
    let mut loaded = nominal.clone();
    for muscle in &mut loaded.muscles {
        let plant = &mut muscle.plant;
        plant.friction.force_n *= 1.0 + 0.3 * sign;
        plant.muscle.slip_force_n *= 1.0 + 0.3 * sign;
        plant.valve.conductance_m3_s_pa *= 1.0 + 0.1 * sign;
        plant.muscle.bladder_stiffness_n_m *= 1.0 + 0.2 * sign;
        plant.heat.scale *= 3.0;
    }
    let [a, _] = &mut loaded.muscles;
    // The area falls with the square of the turns.
    a.plant.muscle.turns *= 1.0 - 0.015 * sign;
    a.plant.sensor.pressure.offset_pa += 3000.0 * sign;
    loaded.joint.inertia_kg_m2 *= 1.0 + 0.15 * sign;
    loaded.joint.gravity_n_m *= 1.0 + 0.1 * sign;
    loaded
}

fn heavy(nominal: &JointLoaded) -> JointLoaded {
    let mut loaded = nominal.clone();
    loaded.joint.inertia_kg_m2 = HEAVY_KG_M2;
    loaded.believed.inertia_kg_m2 = HEAVY_KG_M2;
    loaded
}

fn believing(nominal: &JointLoaded, change: fn(&mut JointLoaded)) -> JointLoaded {
    let mut loaded = nominal.clone();
    change(&mut loaded);
    loaded
}

/// Each muscle has more radius as it shortens.
fn varying(loaded: &mut JointLoaded) {
    for joint in [&mut loaded.joint, &mut loaded.believed] {
        joint.radius_a_per_rad = VARIES_PER_RAD;
        joint.radius_b_per_rad = -VARIES_PER_RAD;
    }
}

fn gravity_unknown(loaded: &JointLoaded) -> JointLoaded {
    believing(loaded, |loaded| loaded.believed.gravity_n_m = 0.0)
}

pub fn evaluate(watch: &impl Watch) -> Result<Vec<CaseFigures>, RunError> {
    let nominal = nominal().map_err(|_| RunError::Build(BuildError::NoEnd))?;
    let heavy = heavy(&nominal);
    let cases = [
        ("brief", nominal.clone(), tracks_right as fn(&JointLoaded) -> _),
        ("heavy", heavy.clone(), tracks_heavy),
        ("brief, all wrong, high", all_wrong(&nominal, 1.0), tracks_wrong),
        ("brief, all wrong, low", all_wrong(&nominal, -1.0), tracks_wrong),
        ("heavy, all wrong, high", all_wrong(&heavy, 1.0), tracks_wrong),
        ("heavy, all wrong, low", all_wrong(&heavy, -1.0), tracks_wrong),
        ("brief, steps", nominal.clone(), steps),
        ("heavy, steps", heavy.clone(), steps),
        ("brief, 60 deg sequence", nominal.clone(), sequence),
        ("brief, rest", nominal.clone(), rest),
        ("heavy, rest", heavy.clone(), rest),
        ("brief, load of 2 N m", nominal.clone(), load_step),
        ("heavy, load of 2 N m", heavy.clone(), load_step),
        ("brief, stiffness 12 to 24", nominal.clone(), doubled),
        (
            "inertia believed twice",
            believing(&nominal, |s| s.believed.inertia_kg_m2 *= 2.0),
            stable,
        ),
        ("inertia believed half", believing(&nominal, |s| s.believed.inertia_kg_m2 *= 0.5), stable),
        ("no friction, 0.9 N m believed", believing(&nominal, frictionless), stable),
        ("gravity unknown", gravity_unknown(&nominal), stable),
        ("no friction, tuned", believing(&nominal, frictionless), tuned),
        ("gravity unknown, tuned", gravity_unknown(&nominal), tuned),
        ("all wrong, gravity unknown, tuned", gravity_unknown(&all_wrong(&nominal, 1.0)), tuned),
        (
            "inertia believed twice, tuned",
            believing(&nominal, |s| s.believed.inertia_kg_m2 *= 2.0),
            tuned,
        ),
        (
            "inertia believed half, tuned",
            believing(&nominal, |s| s.believed.inertia_kg_m2 *= 0.5),
            tuned,
        ),
        ("radii of 20 % over 60 deg", believing(&nominal, varying), tracks_right),
        (
            "the same, believed constant",
            believing(&nominal, |s| {
                let constant = s.believed.clone();
                varying(s);
                s.believed = constant;
            }),
            tracks_unknown,
        ),
        ("faults of either muscle", nominal.clone(), vents),
        ("brief, angle lost, locked", nominal, locked),
        ("heavy, angle lost, locked", heavy, locked),
    ];
    let cases = cases.map(|(name, loaded, measure)| Case { name, loaded, measure });
    let found = parallel::map_watched(&cases, watch, |case| {
        let figures = (case.measure)(&case.loaded)?;
        Ok(CaseFigures { case: case.name.to_owned(), figures })
    });
    found.into_iter().collect()
}

/// Removes friction and slip that the core is configured with.
fn frictionless(loaded: &mut JointLoaded) {
    for muscle in &mut loaded.muscles {
        muscle.plant.friction.force_n = 0.0;
        muscle.plant.friction.stribeck_force_n = 0.0;
        muscle.plant.muscle.slip_force_n = 0.0;
    }
}

/// Runs a motion for a time; returns the row of every step.
fn run(
    loaded: &JointLoaded,
    duration_s: f64,
    inputs: impl Fn(f64) -> Inputs,
) -> Result<Vec<Row>, RunError> {
    let step_s = loaded.muscles[0].plant.run.step_s;
    let steps = (duration_s / step_s).round() as u64;
    let mut rig = Rig::new(loaded, inputs(0.0))?;
    (0..steps).map(|step| rig.step(inputs((step + 1) as f64 * step_s))).collect()
}

fn still(angle_deg: f64, stiffness: f64) -> Inputs {
    Inputs::of(Motion::still(angle_deg.to_radians() as f32, stiffness as f32))
}

fn sine(frequency_hz: f64, amplitude_deg: f64, time_s: f64) -> Inputs {
    let time_s = time_s - BEFORE_S;
    if time_s < 0.0 {
        return still(0.0, STIFFNESS);
    }
    let (w, size) = (TAU * frequency_hz, amplitude_deg.to_radians());
    let (sin, cos) = (math::sin(w * time_s), math::cos(w * time_s));
    Inputs::of(Motion {
        angle_rad: (size * sin) as f32,
        speed_rad_s: (size * w * cos) as f32,
        acceleration_rad_s2: (-size * w * w * sin) as f32,
        stiffness_n_m_rad: STIFFNESS as f32,
    })
}

/// Error against the set point \[deg\].
fn error_deg(row: &Row) -> f64 {
    row.wanted().map_or(0.0, |[angle, _]| (row.truth.angle_rad - angle).to_degrees())
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), x| (sum + x * x, count + 1.0));
    (sum / f64::max(count, 1.0)).sqrt()
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.map(f64::abs).fold(0.0, f64::max)
}

fn after(rows: &[Row], time_s: f64) -> &[Row] {
    &rows[rows.partition_point(|row| row.time_s < time_s)..]
}

fn pulses_per_s(rows: &[Row]) -> f64 {
    let mut before = [Command::VENT; 2];
    let mut count = 0.0;
    for row in rows {
        let now = row.telemetry.commands();
        count += f64::from(thermyo_joint::pulses(now, before));
        before = now;
    }
    let (first, last) = (rows.first(), rows.last());
    let span_s = first.zip(last).map_or(1.0, |(first, last)| last.time_s - first.time_s);
    count / span_s.max(1e-3)
}

/// RMS errors of four sines, of the stiffness up to 1 Hz, and pulses at 1 Hz.
fn sines(loaded: &JointLoaded, last_deg: f64, targets: Targets) -> Result<Vec<Figure>, RunError> {
    let names = ["RMS 0.5 Hz deg", "RMS 1 Hz deg", "RMS 2 Hz deg", "RMS 5 Hz deg"];
    let motions = [(0.5, 20.0), (1.0, 20.0), (2.0, 10.0), (5.0, last_deg)];
    let (mut figures, mut stiffness, mut gas_k) = (Vec::new(), 0.0_f64, 0.0_f64);
    for ((name, (hz, deg)), most) in names.into_iter().zip(motions).zip(targets.sines_deg) {
        let rows = run(loaded, BEFORE_S + 5.0 / hz + 1.0, |time_s| sine(hz, deg, time_s))?;
        let moving = after(&rows, BEFORE_S + 1.0 / hz);
        figures.push(Figure::at_most(name, rms(moving.iter().map(error_deg)), most));
        if hz <= 1.0 {
            let off = moving.iter().map(|row| 100.0 * (row.stiffness_n_m_rad / STIFFNESS - 1.0));
            stiffness = stiffness.max(rms(off));
            gas_k = gas_k.max(rms(moving.iter().map(|row| {
                let estimate = f64::from(row.telemetry.muscles[0].estimate.gas_k);
                estimate - row.truth.muscles[0].gas_temperature_k
            })));
        }
        if hz == 1.0 {
            figures.push(Figure::at_most("pulses 1/s", pulses_per_s(moving), 100.0));
        }
    }
    figures.push(Figure::at_most("stiffness %", stiffness, targets.stiffness_percent));
    figures.push(Figure::shown("gas K", gas_k));
    Ok(figures)
}

fn tracks_right(loaded: &JointLoaded) -> Result<Vec<Figure>, RunError> {
    sines(loaded, 3.0, RIGHT)
}

fn tracks_heavy(loaded: &JointLoaded) -> Result<Vec<Figure>, RunError> {
    sines(loaded, 1.5, HEAVY)
}

fn tracks_wrong(loaded: &JointLoaded) -> Result<Vec<Figure>, RunError> {
    sines(loaded, 3.0, WRONG)
}

/// Figures of a pulley that the core is not configured with; they have no target.
fn tracks_unknown(loaded: &JointLoaded) -> Result<Vec<Figure>, RunError> {
    let figures = tracks_wrong(loaded)?.into_iter();
    Ok(figures.map(|figure| Figure::shown(figure.name, figure.value)).collect())
}

/// Time after which the error stays small \[s\], and the way beyond the goal \[deg\].
fn settling(rows: &[Row], from_s: f64, up: bool) -> (f64, f64) {
    let later = after(rows, from_s);
    let outside = later.iter().rev().find(|row| error_deg(row).abs() > SETTLED_DEG);
    let settled_s = outside.map_or(0.0, |row| row.time_s - from_s);
    let beyond = later.iter().map(|row| if up { error_deg(row) } else { -error_deg(row) });
    (settled_s, beyond.fold(0.0, f64::max))
}

fn steps(loaded: &JointLoaded) -> Result<Vec<Figure>, RunError> {
    let angle = |time_s: f64| match time_s {
        t if t < 1.5 => 0.0,
        t if t < 3.0 => 20.0,
        _ => -20.0,
    };
    let rows = run(loaded, 4.5, |time_s| still(angle(time_s), STIFFNESS))?;
    let first = &rows[..rows.partition_point(|row| row.time_s < 3.0)];
    let (small, over_small) = settling(first, 1.501, true);
    let (large, over_large) = settling(&rows, 3.001, false);
    Ok(vec![
        Figure::at_most("20 deg s", small, 0.5),
        Figure::at_most("40 deg s", large, 0.5),
        Figure::at_most("overshoot deg", over_small.max(over_large), 0.6),
    ])
}

/// Steps between -30 and 30 deg, against the reference's own rise: half a second after each step counts as rise.
fn sequence(loaded: &JointLoaded) -> Result<Vec<Figure>, RunError> {
    const HOLD_S: f64 = 2.0;
    const ANGLES_DEG: [f64; 6] = [-30.0, 30.0, -30.0, 0.0, 30.0, -30.0];
    let at = |time_s: f64| ((time_s / HOLD_S) as usize).min(ANGLES_DEG.len() - 1);
    let rows = run(loaded, HOLD_S * 6.0, |time_s| still(ANGLES_DEG[at(time_s)], STIFFNESS))?;
    let errors = rows.iter().filter(|row| row.time_s % HOLD_S > 0.5 && row.time_s > HOLD_S);
    Ok(vec![Figure::at_most("RMS after the rise deg", rms(errors.map(error_deg)), 2.0)])
}

fn rest(loaded: &JointLoaded) -> Result<Vec<Figure>, RunError> {
    let angle = |time_s: f64| if time_s < 1.0 { 0.0 } else { 20.0 };
    let rows = run(loaded, 21.0, |time_s| still(angle(time_s), STIFFNESS))?;
    let (settled, late) = (after(&rows, 3.0), after(&rows, 11.0));
    let off = settled.iter().map(|row| 100.0 * (row.stiffness_n_m_rad / STIFFNESS - 1.0));
    Ok(vec![
        Figure::at_most("worst deg", largest(settled.iter().map(error_deg)), 0.3),
        Figure::at_most("pulses after 10 s 1/s", pulses_per_s(late), 0.0),
        Figure::at_most("stiffness %", largest(off), 3.0),
    ])
}

fn load_step(loaded: &JointLoaded) -> Result<Vec<Figure>, RunError> {
    let rows = run(loaded, 6.0, |time_s| Inputs {
        load_n_m: if time_s < 2.0 { 0.0 } else { LOAD_N_M },
        ..still(0.0, STIFFNESS)
    })?;
    let (back_s, _) = settling(&rows, 2.0, true);
    let last = after(&rows, 5.0).iter().map(error_deg);
    let [low, high] = ends(last);
    Ok(vec![
        Figure::at_most("peak deg", largest(after(&rows, 2.0).iter().map(error_deg)), 7.0),
        Figure::at_most("back s", back_s, 0.5),
        Figure::at_most("hunting deg", high - low, 0.3),
    ])
}

fn doubled(loaded: &JointLoaded) -> Result<Vec<Figure>, RunError> {
    let stiffness = |time_s: f64| if time_s < 2.0 { 12.0 } else { 24.0 };
    let rows = run(loaded, 4.0, |time_s| still(0.0, stiffness(time_s)))?;
    let changed = after(&rows, 2.0);
    let off = |row: &Row| (row.stiffness_n_m_rad / 24.0 - 1.0).abs();
    let outside = changed.iter().rev().find(|row| off(row) > 0.05);
    Ok(vec![
        Figure::at_most("angle deg", largest(changed.iter().map(error_deg)), 0.5),
        Figure::at_most("stiffness within 5 % s", outside.map_or(0.0, |row| row.time_s - 2.0), 0.3),
    ])
}

/// A sine at 1 Hz, then rest at 15 deg: tracking, and motion at rest.
fn stable(loaded: &JointLoaded) -> Result<Vec<Figure>, RunError> {
    let rows = run(loaded, 12.0, |time_s| {
        if time_s < 6.0 { sine(1.0, 20.0, time_s) } else { still(15.0, STIFFNESS) }
    })?;
    let moving = after(&rows, 2.0).iter().filter(|row| row.time_s < 6.0);
    let last = after(&rows, 10.0).iter().map(|row| row.truth.angle_rad.to_degrees());
    let [low, high] = ends(last);
    // Judged by the mode, since a loop may open both outlets too.
    let vented = rows.iter().any(|row| row.telemetry.mode == JointMode::Vent);
    Ok(vec![
        Figure::at_most("RMS 1 Hz deg", rms(moving.map(error_deg)), 0.8),
        Figure::at_most("limit cycle deg", 0.5 * (high - low), 0.3),
        Figure::at_most("vented", f64::from(u8::from(vented)), 0.0),
    ])
}

/// `thermyo tune`, then sines and rest with the tuned values; errors of the values.
fn tuned(loaded: &JointLoaded) -> Result<Vec<Figure>, RunError> {
    let mut bench = Simulated { highest_pa: HIGHEST_PA, stopped: &|| false };
    let tuned = match joint_tune::tune_on(loaded, HIGHEST_PA, &mut bench) {
        Ok(tuned) => tuned,
        Err(TuneError::Bench(BenchError::Run(error))) => return Err(error),
        // A refusal misses every target.
        Err(_) => return Ok(vec![Figure::at_most("refused", 1.0, 0.0)]),
    };
    let error_percent = |path: &str, truth: f64| {
        let after = tuned.findings.values.value(path).map_or(f64::NAN, |one| one.after);
        100.0 * (after / truth - 1.0).abs()
    };
    let plant = &loaded.joint;
    let mut figures = vec![
        Figure::shown("gravity error %", error_percent("joint.gravity_n_m", plant.gravity_n_m)),
        Figure::shown("inertia error %", error_percent("joint.inertia_kg_m2", plant.inertia_kg_m2)),
    ];
    let names = ["RMS 0.5 Hz deg", "RMS 1 Hz deg", "RMS 2 Hz deg"];
    let motions = [(0.5, 20.0), (1.0, 20.0), (2.0, 10.0)];
    for ((name, (hz, deg)), most) in names.into_iter().zip(motions).zip(WRONG.sines_deg) {
        let duration_s = BEFORE_S + 5.0 / hz + 1.0;
        let rows = run(&tuned.scenario, duration_s, |time_s| sine(hz, deg, time_s))?;
        let moving = after(&rows, BEFORE_S + 1.0 / hz);
        figures.push(Figure::at_most(name, rms(moving.iter().map(error_deg)), most));
    }
    let at_rest = stable(&tuned.scenario)?;
    figures.extend(at_rest.into_iter().filter(|figure| figure.name != "RMS 1 Hz deg"));
    Ok(figures)
}

fn broken(number: u64) -> (usize, FaultWindow) {
    let mut window = FaultWindow::default();
    match (number / 2) % 5 {
        0 => window.pressure = ChannelFault::Open,
        1 => window.pressure = ChannelFault::Shorted,
        2 => window.emergency_stop = true,
        3 => window.inlet = ValveFault::Open,
        _ => window.length = ChannelFault::Shorted,
    }
    // The angle goes through the length channel of muscle a.
    let is_angle = window.length != ChannelFault::None;
    (if is_angle { 0 } else { (number % 2) as usize }, window)
}

/// Faults of every kind in either muscle while it moves: both outlets open in the step that shows the fault.
fn vents(loaded: &JointLoaded) -> Result<Vec<Figure>, RunError> {
    let numbers: Vec<u64> = (0..FAULTS).collect();
    let found = parallel::map(&numbers, |number| {
        let (side, mut window) = broken(*number);
        window.from_s = 1.6 + 0.037 * *number as f64 / 10.0;
        window.until_s = 100.0;
        let mut loaded = loaded.clone();
        let plant: &mut Scenario = &mut loaded.muscles[side].plant;
        plant.faults.own = window;
        let rows = run(&loaded, 3.5, |time_s| sine(1.0, 15.0, time_s))?;
        Ok(together(&rows))
    });
    let found: Vec<bool> = found.into_iter().collect::<Result<_, RunError>>()?;
    let share = found.iter().filter(|both| **both).count() as f64;
    Ok(vec![Figure::at_least("both vent in one step, of 100", share, FAULTS as f64)])
}

/// The arm is held up against gravity when its angle is lost, and locks for three seconds.
fn locked(loaded: &JointLoaded) -> Result<Vec<Figure>, RunError> {
    let mut loaded = loaded.clone();
    loaded.believed.lock_s = LOCK_S;
    let [a, _] = &mut loaded.muscles;
    a.plant.faults.own =
        FaultWindow { length: ChannelFault::Open, from_s: 2.0, ..FaultWindow::default() };
    let rows = run(&loaded, 2.1 + LOCK_S, |_| still(20.0, STIFFNESS))?;
    let before_rad = rows.iter().rfind(|row| row.time_s < 2.0).map(|row| row.truth.angle_rad);
    let held = rows.iter().filter(|row| (2.0..2.0 + LOCK_S - 0.01).contains(&row.time_s));
    let moved = held.map(|row| (row.truth.angle_rad - before_rad.unwrap_or(f64::NAN)).to_degrees());
    let vents_s = rows.iter().find(|row| row.telemetry.commands() == [Command::VENT; 2]);
    let late_s = vents_s.map_or(f64::INFINITY, |row| (row.time_s - 2.0 - LOCK_S).abs());
    Ok(vec![
        Figure::at_most("moves deg", largest(moved.map(f64::abs)), 0.5),
        Figure::at_most("vents off its time s", late_s, 0.002),
    ])
}

/// Whether both muscles vent from the first step in which either of them, or the joint, has a venting fault.
fn together(rows: &[Row]) -> bool {
    let has_fault = |row: &Row| {
        row.telemetry.faults != JointFaults::NONE
            || row.telemetry.muscles.iter().any(|one| one.faults.intersects(VENTING))
    };
    let Some(first) = rows.iter().position(has_fault) else { return false };
    rows[first..].iter().all(|row| row.telemetry.commands() == [Command::VENT; 2])
}
