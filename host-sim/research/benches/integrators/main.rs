//! Cost and accuracy of the plant's fixed steps, compared with independent solvers: `ode_solvers`,
//! and SciPy if python3 has it.
//!
//!     cargo bench -p research --bench integrators
//!
//! The case is the largest for which an adaptive solver can use the same equations: the default
//! muscle of the model `lumped` with stop, friction, both valves and wall, over four cycles of
//! filling, holding, venting and holding. Openings do not change within a phase, and are known in
//! advance. Friction does not soften as the wall warms, since the plant's speed leaves that drift
//! out. `full`, with zones and pulses, is compared only with itself.
//!
//! Times are for all 20 s, without core and trace. Solvers return a state every 10 ms; the plant
//! computes a state and its sensors in every step. "Restarted every 1 ms" is a solver that restarts
//! every step, as it must if a controller sets the openings.

mod muscle;

use muscle::{Muscle, Phase, State};
use ode_solvers::{Dop853, Dopri5};
use serde::Deserialize;
use serde_json::json;
use std::array::from_fn;
use std::cell::Cell;
use std::io::ErrorKind;
use std::process::{Command, Stdio};
use std::time::Instant;
use thermyo_plant::Actuation;
use thermyo_runs::signals::rms_difference;
use thermyo_scenario::{HeatModel, PlantModel, Scenario};

/// Phases of a motion: duration \[s\], openings of inlet and outlet.
type Drive = [(f64, f64, f64)];

/// Cycle from 124 to 404 kPa, 287 to 307 K, 0.300 to 0.212 m.
const CYCLE: [(f64, f64, f64); 4] =
    [(2.0, 0.108, 0.0), (0.5, 0.0, 0.0), (2.0, 0.0, 0.27), (0.5, 0.0, 0.0)];
const CYCLES: usize = 4;
/// Interval of the samples from which the errors are computed \[s\].
const SAMPLE_S: f64 = 0.01;
/// Exchange step, in which a core is called and openings may change \[s\].
const STEP_S: f64 = 0.001;
const ROUNDS: usize = 7;
/// Relative tolerance of the finest solution.
const FINEST: f64 = 1e-13;
/// An absolute tolerance per relative one: a small mass \[kg\].
const LEAST_KG: f64 = 1e-4;
/// Exit code of the script if SciPy is missing.
const NO_SCIPY: i32 = 3;

/// Pressure \[Pa\], gas temperature \[K\], length \[m\].
type Sample = [f64; 3];

fn main() {
    let default = thermyo_setup::parse("", "default".as_ref()).expect("the defaults are valid");
    let [lumped, full] = [PlantModel::Lumped, PlantModel::Full].map(|model| {
        let mut scenario = default.with_model(model).plant;
        scenario.friction.softening_per_k = 0.0;
        scenario.heat.model = HeatModel::Constant;
        scenario
    });
    let drive = [CYCLE; CYCLES].concat();
    let by = |solver, tolerance, piece_s| integrate(&lumped, &drive, solver, tolerance, piece_s);
    let exact = by(dop853, FINEST, f64::MAX);
    let exact_full = plant(&full, &drive, 1e-5);
    let mut table = Table::default();
    let mut scipy_is_there = true;
    for _ in 0..ROUNDS {
        table.time("lumped, 1 ms", &exact, || plant(&lumped, &drive, STEP_S));
        table.time("lumped, 0.5 ms", &exact, || plant(&lumped, &drive, 0.5 * STEP_S));
        table.time("Dopri5, 1e-6", &exact, || by(dopri5, 1e-6, f64::MAX));
        table.time("Dopri5, 1e-9", &exact, || by(dopri5, 1e-9, f64::MAX));
        table.time("Dop853, 1e-9", &exact, || by(dop853, 1e-9, f64::MAX));
        table.time("Dopri5, 1e-9, restarted every 1 ms", &exact, || by(dopri5, 1e-9, STEP_S));
        if scipy_is_there {
            let runs = scipy(&lumped, &drive);
            scipy_is_there = !runs.is_empty();
            for ScipyRun { name, seconds, samples } in runs {
                table.record(&name, seconds, errors(&samples, &exact));
            }
        }
        table.time("full, its own steps", &exact_full, || plant(&full, &drive, STEP_S));
        table.time("full, 0.1 ms", &exact_full, || plant(&full, &drive, 1e-4));
        table.time("full, 0.05 ms", &exact_full, || plant(&full, &drive, 5e-5));
    }
    let base_s = median(&table.rows[0].seconds);
    println!("Four cycles, 20 s; lumped alone takes {:.1} ms", 1e3 * base_s);
    table.print();
    println!("RMS against Dop853 at {FINEST:.0e}, full against itself in steps of 0.01 ms");
    if !scipy_is_there {
        println!("SciPy is left out: python3 does not have it");
    }

    let mut sliding = lumped.clone();
    sliding.plant.initial_pressure_pa = 150_000.0;
    sliding.heat.inner_w_m2_k = 3000.0;
    let drive = &CYCLE[..1];
    let exact = integrate(&sliding, drive, dop853, FINEST, f64::MAX);
    let mut table = Table::default();
    table.time("lumped, 1 ms", &exact, || plant(&sliding, drive, STEP_S));
    table.time("lumped, 0.5 ms", &exact, || plant(&sliding, drive, 0.5 * STEP_S));
    println!(
        "\nFilling from 150 kPa, sliding all the time, heat transfer so strong that an error stands out of rounding"
    );
    table.print();
}

/// Results of all solvers.
#[derive(Default)]
struct Table {
    rows: Vec<Row>,
}

struct Row {
    name: String,
    seconds: Vec<f64>,
    errors: Sample,
}

impl Table {
    fn time(&mut self, name: &str, exact: &[Sample], run: impl FnOnce() -> Vec<Sample>) {
        let start = Instant::now();
        let samples = run();
        self.record(name, start.elapsed().as_secs_f64(), errors(&samples, exact));
    }

    fn record(&mut self, name: &str, seconds: f64, errors: Sample) {
        match self.rows.iter_mut().find(|row| row.name == name) {
            Some(row) => row.seconds.push(seconds),
            None => self.rows.push(Row { name: name.into(), seconds: vec![seconds], errors }),
        }
    }

    /// Relative times refer to the first row of the same round.
    fn print(&self) {
        println!(
            "{:30} {:>8} {:>12} {:>9} {:>10}",
            "", "time", "pressure, Pa", "gas, K", "length, m"
        );
        for Row { name, seconds, errors: [pressure, gas, length] } in &self.rows {
            let ratios = seconds.iter().zip(&self.rows[0].seconds).map(|(own, base)| own / base);
            let ratio = median(&ratios.collect::<Vec<_>>());
            println!("{name:30} {ratio:8.3} {pressure:12.1e} {gas:9.1e} {length:10.1e}");
        }
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

/// RMS of each quantity.
fn errors(samples: &[Sample], exact: &[Sample]) -> Sample {
    assert_eq!(samples.len(), exact.len());
    let column = |of: &[Sample], i: usize| of.iter().map(|sample| sample[i]).collect::<Vec<_>>();
    from_fn(|i| rms_difference(&column(samples, i), &column(exact, i)))
}

/// The plant in exchange steps of `step_s`.
fn plant(scenario: &Scenario, drive: &Drive, step_s: f64) -> Vec<Sample> {
    let mut scenario = scenario.clone();
    scenario.run.step_s = step_s;
    let mut plant = thermyo_plant::build(&scenario, None).expect("the default muscle can be built");
    let mut samples = Vec::new();
    for &(duration_s, inlet, outlet) in drive {
        for _ in 0..steps(duration_s, SAMPLE_S) {
            for _ in 0..steps(SAMPLE_S, step_s) {
                plant.advance(Actuation { inlet, outlet }).expect("the default muscle runs");
            }
            let truth = plant.truth();
            samples.push([truth.pressure_pa, truth.gas_temperature_k, truth.length_m]);
        }
    }
    samples
}

fn steps(duration_s: f64, step_s: f64) -> usize {
    (duration_s / step_s).round() as usize
}

/// Solves the case with a restart at every phase, and every `piece_s`.
fn integrate(
    scenario: &Scenario,
    drive: &Drive,
    solver: Solver,
    tolerance: f64,
    piece_s: f64,
) -> Vec<Sample> {
    let muscle = Muscle::of(scenario);
    let mut held_m = start_m(scenario);
    let mut y = muscle.start(held_m);
    let mut samples = Vec::new();
    for &(duration_s, inlet, outlet) in drive {
        let piece_s = piece_s.min(duration_s);
        let interval_s = SAMPLE_S.min(piece_s);
        let mut states = Vec::new();
        for _ in 0..steps(duration_s, piece_s) {
            let guess_m = Cell::new(held_m);
            let phase = Phase { muscle: &muscle, inlet, outlet, held_m, guess_m };
            let piece = solver(phase.clone(), piece_s, interval_s, y, tolerance);
            y = piece[piece.len() - 1];
            states.extend(piece[1..].iter().map(|y| phase.sample(y)));
            held_m = states[states.len() - 1][2];
        }
        let per_sample = steps(SAMPLE_S, interval_s);
        samples.extend(states.into_iter().skip(per_sample - 1).step_by(per_sample));
    }
    samples
}

fn start_m(scenario: &Scenario) -> f64 {
    thermyo_plant::build(scenario, None).expect("the default muscle can be built").truth().length_m
}

/// Solver: returns the states at multiples of an interval \[s\] within a duration \[s\]; the last
/// arguments are the initial state and the relative tolerance.
type Solver = fn(Phase<'_>, f64, f64, State, f64) -> Vec<State>;

/// Time by which a solver runs longer \[s\]. `ode_solvers` 0.6.2 returns the state at the very end
/// only when it is due next, from the polynomial of a step that has not reached that far.
const BEYOND_S: f64 = 1e-8;

fn dopri5(phase: Phase<'_>, duration_s: f64, every_s: f64, y: State, rtol: f64) -> Vec<State> {
    let end_s = duration_s + BEYOND_S;
    let mut solver = Dopri5::new(phase, 0.0, end_s, every_s, y, rtol, LEAST_KG * rtol);
    solver.integrate().expect("nothing is stiff");
    solver.y_out().clone()
}

fn dop853(phase: Phase<'_>, duration_s: f64, every_s: f64, y: State, rtol: f64) -> Vec<State> {
    let end_s = duration_s + BEYOND_S;
    let mut solver = Dop853::new(phase, 0.0, end_s, every_s, y, rtol, LEAST_KG * rtol);
    solver.integrate().expect("nothing is stiff");
    solver.y_out().clone()
}

/// A run of the script beside this file.
#[derive(Deserialize)]
struct ScipyRun {
    name: String,
    seconds: f64,
    samples: Vec<Sample>,
}

/// Solves the case with SciPy; empty if it is not installed.
fn scipy(scenario: &Scenario, drive: &Drive) -> Vec<ScipyRun> {
    let muscle = Muscle::of(scenario);
    let held_m = start_m(scenario);
    let start: [f64; 3] = muscle.start(held_m).into();
    let case = json!({
        "muscle": muscle, "drive": drive, "start": start, "held_m": held_m,
        "sample_s": SAMPLE_S, "least_kg": LEAST_KG,
        "runs": [("LSODA", 1e-9), ("RK45", 1e-9), ("DOP853", 1e-9)],
    });
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/integrators/scipy_reference.py");
    let child =
        Command::new("python3").arg(script).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
    let mut child = match child {
        Err(error) if error.kind() == ErrorKind::NotFound => return Vec::new(),
        child => child.expect("python3 can be run"),
    };
    // A script without SciPy does not read its input, so the write may fail.
    let _ = serde_json::to_writer(child.stdin.take().expect("it is piped"), &case);
    let output = child.wait_with_output().expect("python3 ends");
    if output.status.code() == Some(NO_SCIPY) {
        return Vec::new();
    }
    assert!(output.status.success(), "scipy_reference.py: {}", output.status);
    serde_json::from_slice(&output.stdout).expect("it writes its runs")
}
