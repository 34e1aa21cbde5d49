//! Random plants of every plausible size on `full`: no accepted plant may diverge, mass and energy
//! must balance, and a loop that does not come to rest must report it.

use super::faults::muscle::Draw;
use super::{CaseFigures, Figure};
use model_core::{Duty, Faults};
use std::f64::consts::PI;
use thermyo_compute::math::ends;
use thermyo_compute::parallel::{self, Watch};
use thermyo_files::input::InputError;
use thermyo_scenario::{DriveKind, Scenario};
use thermyo_setup::{Loaded, parse, unrest};
use thermyo_simulation::run::{self, RunError};

/// Number of plants, by default.
pub const COUNT: u64 = 200;
/// Volumes \[m3\], conductances of the valves \[m3/(s Pa)\] and pressures of the supply \[Pa\], and the largest load \[N\].
const VOLUMES_M3: [f64; 2] = [1.0e-5, 5.0e-3];
const VALVES_M3_S_PA: [f64; 2] = [1.0e-10, 1.0e-7];
const SUPPLIES_PA: [f64; 2] = [2.0e5, 1.2e6];
const LARGEST_LOAD_N: f64 = 1000.0;
const AMBIENT_PA: f64 = 101_325.0;
/// Times at which the set point steps, and the end of the run \[s\].
const STEPS_S: [f64; 4] = [0.0, 2.0, 4.0, 6.0];
/// Time before a step within which a loop should be at rest \[s\].
const REST_S: f64 = 1.0;
/// Largest relative error of the balances of mass and energy \[ppm\].
const BOOKS_PPM: f64 = 1.0;
/// Number of stated deviations, and share of the valid time, above which an estimate is overconfident; and the share of
/// plants on which it may be.
const BEYOND_SD: f64 = 3.0;
const BEYOND: f64 = 0.05;
const OVERCONFIDENT: f64 = 0.01;
/// Swing in dead zones, peak to peak, and number of crossings of the mean within [`REST_S`], above which a loop is not
/// at rest.
const SWINGS_ZONES: f64 = 6.0;
const CROSSINGS: usize = 8;

/// A random plant in words, and its scenario.
pub fn random(seed: u64, number: u64) -> (String, Result<Loaded, InputError>) {
    let mut draw = Draw::new(seed.wrapping_mul(1_000_003).wrapping_add(number));
    let volume_m3 = draw.factor(VOLUMES_M3);
    let valve = draw.factor(VALVES_M3_S_PA);
    let supply_pa = draw.factor(SUPPLIES_PA);
    let gauge_pa = supply_pa - AMBIENT_PA;
    let kind = draw.of(&["muscle", "push", "pull"]);
    let drive = draw.of(&[DriveKind::Pressure, DriveKind::Contraction, DriveKind::Duty]);
    let load_share = draw.between([0.0, 1.0]);
    let (chamber, force_n, rest_m, lifts) = if kind == "muscle" {
        muscle(&mut draw, volume_m3, gauge_pa)
    } else {
        cylinder(&mut draw, kind, volume_m3, gauge_pa)
    };
    let direction = if kind == "push" { -1.0 } else { 1.0 };
    let load_n = load_share * LARGEST_LOAD_N.min(0.35 * force_n);
    let mass_kg = (load_n / 9.81).max(0.1);
    let friction_n = 0.02 * force_n;
    let tube = if draw.sign() > 0.0 {
        String::new()
    } else {
        let volume_m3 = draw.factor([0.01, 0.1]) * volume_m3;
        let conductance = draw.factor([1.0, 10.0]) * valve;
        format!("[tube]\nvolume_m3 = {volume_m3:e}\nconductance_m3_s_pa = {conductance:e}\n")
    };
    let text = format!(
        "[run]\nseed = {number}\n[plant]\nmodel = \"full\"\n{chamber}\
         [supply]\npressure_pa = {supply_pa}\n[valve]\nconductance_m3_s_pa = {valve:e}\n{tube}\
         [load]\nforce_n = {}\nmass_kg = {mass_kg}\n\
         [friction]\nforce_n = {friction_n}\nstribeck_force_n = {}\npresliding_stiffness_n_m = {}\n\
         [sensor.pressure]\nrange_pa = {}\n[sensor.length]\nrange_m = {}\n",
        direction * load_n,
        0.2 * friction_n,
        friction_n / 4.0e-4,
        1.2 * supply_pa,
        2.0 * rest_m,
    );
    let name = format!(
        "{number:4} {kind:6} {:8.3} cm3 {valve:.1e} m3/(s Pa) {:4.1} bar {load_n:4.0} N {drive:?}",
        1e6 * volume_m3,
        1e-5 * supply_pa
    );
    let parsed = parse(&text, "random plant".as_ref()).map(|loaded| {
        let range = match drive {
            DriveKind::Pressure => [0.1, 0.9].map(|share| AMBIENT_PA + share * gauge_pa),
            DriveKind::Contraction => lifts,
            _ => [-1.0, 1.0],
        };
        let mut points = Vec::new();
        for stretch in STEPS_S.windows(2) {
            let value = draw.between(range);
            points.push((stretch[0], value));
            points.push((stretch[1] - 0.001, value));
        }
        loaded.driven(drive, points)
    });
    (name, parsed)
}

/// Keys of a muscle, its force at its rest length \[N\], that length \[m\], and contractions that may be requested
/// \[-\].
fn muscle(draw: &mut Draw, volume_m3: f64, gauge_pa: f64) -> (String, f64, f64, [f64; 2]) {
    let slender = draw.between([10.0, 25.0]);
    let angle_deg = draw.between([21.0, 25.0]);
    let rest_m = (4.0 / PI * volume_m3 * slender * slender).cbrt();
    let diameter_m = rest_m / slender;
    let squared = angle_deg.to_radians().sin().powi(2);
    let force_n = gauge_pa * PI / 4.0 * diameter_m * diameter_m * (2.0 - 3.0 * squared) / squared;
    let nominal = Scenario::default();
    let (wide, long) = (diameter_m / 0.02, rest_m / 0.3);
    let text = format!(
        "[muscle]\nrest_length_m = {rest_m}\ndiameter_m = {diameter_m}\nbraid_angle_deg = {angle_deg}\n\
         dead_volume_m3 = {}\nbladder_stiffness_n_m = {}\n[wall]\nheat_capacity_j_k = {}\nconductance_w_k = {}\n",
        0.07 * volume_m3,
        nominal.muscle.bladder_stiffness_n_m * wide / long,
        nominal.wall.heat_capacity_j_k * wide * long,
        nominal.wall.conductance_w_k * wide * long,
    );
    (text, force_n, rest_m, [0.03, 0.15])
}

/// Keys of a cylinder, and the same values.
fn cylinder(
    draw: &mut Draw,
    acts: &str,
    volume_m3: f64,
    gauge_pa: f64,
) -> (String, f64, f64, [f64; 2]) {
    let bore_per_stroke = draw.factor([0.2, 2.5]);
    let dead = draw.factor([0.03, 0.4]);
    let swept_m3 = (1.0 - dead) * volume_m3;
    let stroke_m = (4.0 * swept_m3 / (PI * bore_per_stroke * bore_per_stroke)).cbrt();
    let area_m2 = swept_m3 / stroke_m;
    let force_n = gauge_pa * area_m2;
    let spring_n = draw.between([0.01, 0.1]) * force_n;
    let rest_m = 1.5 * stroke_m + 0.05;
    let nominal = Scenario::default();
    let surface = area_m2.sqrt() * stroke_m / (0.3 * 0.02);
    let text = format!(
        "kind = \"cylinder\"\n[cylinder]\nacts = \"{acts}\"\nrest_length_m = {rest_m}\nstroke_m = {stroke_m}\n\
         area_m2 = {area_m2:e}\ndead_volume_m3 = {:e}\nspring_n = {spring_n}\nspring_stiffness_n_m = {}\n\
         [wall]\nheat_capacity_j_k = {}\nconductance_w_k = {}\n",
        dead * volume_m3,
        0.5 * spring_n / stroke_m,
        nominal.wall.heat_capacity_j_k * surface,
        nominal.wall.conductance_w_k * surface,
    );
    let way = if acts == "push" { -stroke_m / rest_m } else { stroke_m / rest_m };
    let ends = [0.2 * way, 0.8 * way];
    (text, force_n, rest_m, [ends[0].min(ends[1]), ends[0].max(ends[1])])
}

#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Outcome {
    refused: bool,
    diverged: bool,
    mass_ppm: f64,
    energy_ppm: f64,
    swings: bool,
    warned: bool,
    false_alarm: bool,
    /// Steps in which the estimate was valid, and those of them in which it erred by more than [`BEYOND_SD`].
    valid_steps: u64,
    beyond_steps: u64,
}

impl Outcome {
    fn overconfident(&self) -> bool {
        self.beyond_steps as f64 > BEYOND * self.valid_steps as f64
    }
}

/// Whether values of the last [`REST_S`] before a step of the set point swing; independent of the detector of a run.
fn swings(values: &[f64], dead_zone: f64) -> bool {
    let [least, most] = ends(values.iter().copied());
    let mean = 0.5 * (most + least);
    let crossings = values.windows(2).filter(|pair| (pair[0] < mean) != (pair[1] < mean)).count();
    most - least > SWINGS_ZONES * dead_zone && crossings >= CROSSINGS
}

fn outcome(loaded: &Loaded) -> Result<Outcome, RunError> {
    let rest_m = thermyo_plant::chamber::of(&loaded.plant).map_or(1.0, |c| c.rest_length());
    let controller = &loaded.believed.controller;
    let zone = match loaded.plant.drive.kind {
        DriveKind::Pressure => f64::from(controller.pressure_dead_zone_pa),
        DriveKind::Contraction => f64::from(controller.contraction_dead_zone),
        _ => f64::INFINITY,
    };
    let mut outcome = Outcome { warned: !unrest(loaded).is_empty(), ..Outcome::default() };
    let (mut values, mut driven) = (Vec::new(), false);
    let result = run::on_core(loaded, |row| {
        let truth = &row.truth;
        outcome.false_alarm |= row.telemetry.faults.intersects(Faults::NO_INFLOW);
        let estimate = &row.telemetry.estimate;
        let error_k = f64::from(estimate.gas_k) - truth.gas_temperature_k;
        let beyond = error_k.abs() > BEYOND_SD * f64::from(estimate.gas_sd_k);
        outcome.valid_steps += u64::from(estimate.valid);
        outcome.beyond_steps += u64::from(estimate.valid && beyond);
        let command = row.telemetry.command;
        let next_s = STEPS_S.into_iter().find(|step_s| *step_s > truth.time_s + 0.0025);
        let next_s = next_s.unwrap_or(f64::INFINITY);
        if truth.time_s > next_s - 0.0025 || truth.time_s < next_s - REST_S {
            outcome.swings |= driven && swings(&values, zone);
            values.clear();
            driven = false;
            return;
        }
        driven |= command.inlet > Duty::ZERO || command.outlet > Duty::ZERO;
        values.push(match loaded.plant.drive.kind {
            DriveKind::Contraction => 1.0 - truth.length_m / rest_m,
            _ => truth.pressure_pa,
        });
    });
    match result {
        Ok(summary) => {
            outcome.mass_ppm = 1e6 * summary.mass_balance_error;
            outcome.energy_ppm = 1e6 * summary.energy_balance_error;
            outcome.warned |= summary.limit_cycle.is_some();
            Ok(outcome)
        }
        Err(RunError::Build(_) | RunError::Config(_)) => {
            Ok(Outcome { refused: true, ..Outcome::default() })
        }
        Err(RunError::Diverged(_)) => Ok(Outcome { diverged: true, ..outcome }),
        Err(error) => Err(error),
    }
}

fn figures(outcomes: &[Outcome]) -> Vec<Figure> {
    let count = |which: fn(&Outcome) -> bool| outcomes.iter().filter(|o| which(o)).count() as f64;
    let most = |of: fn(&Outcome) -> f64| outcomes.iter().map(of).fold(0.0, f64::max);
    vec![
        Figure::shown("refused", count(|o| o.refused)),
        Figure::at_most("diverged", count(|o| o.diverged), 0.0),
        Figure::at_most("mass_ppm", most(|o| o.mass_ppm), BOOKS_PPM),
        Figure::at_most("energy_ppm", most(|o| o.energy_ppm), BOOKS_PPM),
        Figure::shown("limit_cycles", count(|o| o.swings)),
        Figure::at_most("without_warning", count(|o| o.swings && !o.warned), 0.0),
        Figure::at_most("no_inflow", count(|o| o.false_alarm), 0.0),
        Figure::at_most(
            "overconfident",
            count(Outcome::overconfident),
            OVERCONFIDENT * outcomes.len() as f64,
        ),
    ]
}

/// `count` random plants: a line for each that misses a target, and one for all. When stopped, returns the lines of the
/// finished plants.
///
/// # Errors
/// Error of the first run that failed for a reason other than an invalid plant.
pub fn evaluate(seed: u64, count: u64, watch: &dyn Watch) -> Result<Vec<CaseFigures>, RunError> {
    let numbers: Vec<u64> = (0..count).collect();
    let results = parallel::map_watched(&numbers, watch, |&number| {
        let (name, drawn) = random(seed, number);
        let outcome = match drawn {
            Ok(loaded) => outcome(&loaded)?,
            Err(_) => Outcome { refused: true, ..Outcome::default() },
        };
        Ok::<_, RunError>((name, outcome))
    });
    let results = results.into_iter().collect::<Result<Vec<(String, Outcome)>, _>>()?;
    let mut lines: Vec<CaseFigures> = results
        .iter()
        .map(|(name, outcome)| CaseFigures {
            case: name.clone(),
            figures: figures(&[*outcome]).into_iter().filter(|f| !f.holds()).collect(),
        })
        .filter(|line| !line.figures.is_empty())
        .collect();
    let outcomes: Vec<Outcome> = results.into_iter().map(|(_, outcome)| outcome).collect();
    lines.push(CaseFigures {
        case: format!("{} plants of seed {seed}", outcomes.len()),
        figures: figures(&outcomes),
    });
    Ok(lines)
}
