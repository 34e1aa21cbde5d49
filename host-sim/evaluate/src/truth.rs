//! Comparison with published measurements: every case whose data are available, and the best
//! published figure.

use super::control::{self, rest};
use super::truth_motion::{self, tables};
use super::{CaseFigures, Figure};
use model_core::physics::chamber::{AnyChamber, Chamber};
use std::path::{Path, PathBuf};
use thermyo_compute::parallel;
use thermyo_compute::parallel::Watch;
use thermyo_files::input::{InputError, Problem};
use thermyo_files::shipped;
use thermyo_files::table::read_whole;
use thermyo_identify::IdentifyError;
use thermyo_identify::static_map;
use thermyo_identify::static_map::Readings;
use thermyo_record::measured::Measured;
use thermyo_record::trace::{COLUMNS, Row};
use thermyo_scenario::Scenario;
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::board::CoreBoard;
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;

/// Largest residual of a fit to five readings at the other readings, as a fraction of the largest
/// force.
const FIVE_SHARE: f64 = 0.05;
const HELD_N: [(&str, f64); 4] = [
    ("20_n_percent", 20.0),
    ("50_n_percent", 50.0),
    ("100_n_percent", 100.0),
    ("200_n_percent", 200.0),
];
/// Dead zone of the loop, as a fraction of the stroke \[-\]: the default's ratio to 30 % of the
/// rest length.
const DEAD_ZONE: f64 = 0.005;
/// Static maps with a target of their own: file, name, target, residual of an ideal braid \[N\].
const MAPS: [(&str, &str, f64, f64); 2] = [
    ("dmsp10_250", "static map, DMSP-10-250", 3.5, 46.8),
    ("dmsp20_300", "static map, DMSP-20-300", 9.0, 117.8),
];

#[derive(Debug, thiserror::Error)]
pub enum TruthError {
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    #[error(transparent)]
    Run(#[from] RunError),
}

/// A static map: its file and its readings.
pub type Map = (PathBuf, Readings);

/// Reads the static maps below `folder`.
///
/// # Errors
/// If a map cannot be used.
pub fn maps(folder: &Path) -> Result<Vec<Map>, InputError> {
    let read = |file: PathBuf| Ok((file.clone(), Readings::of(&read_whole(&file)?)?));
    tables(&folder.join("muscle_static")).into_iter().map(read).collect()
}

/// Runs every case whose data lie in `folder`, in the layout of `docs/background/validation.md`.
/// The data are published and complete, so a damaged file gives no figure. When stopped, returns
/// the lines of the finished cases.
///
/// # Errors
/// If there are no data at all, or a case cannot be used.
pub fn evaluate(
    folder: &Path,
    maps: Vec<Map>,
    watch: &dyn Watch,
) -> Result<Vec<CaseFigures>, TruthError> {
    if !folder.is_dir() {
        let problem =
            if folder.exists() { Problem::IsFile } else { Problem::NotFound { near: None } };
        return Err(InputError::file(folder, problem).into());
    }
    let spring = folder.join("gas_spring/upper_2022-01-28.csv");
    let discharge = folder.join("hyddown/air_discharge.csv");
    watch.parts(maps.len());
    let mut lines = Vec::new();
    let mut add = |more: Result<Vec<CaseFigures>, TruthError>| match more {
        // A stopped search has no result.
        _ if watch.stopped() => Ok(()),
        Ok(more) => {
            lines.extend(more);
            Ok(())
        }
        Err(error) => Err(error),
    };
    for (file, readings) in maps {
        add(static_map(&file, readings))?;
        watch.done();
    }
    if spring.exists() {
        add(gas_spring(&spring, watch).map(|line| vec![line]))?;
    }
    if discharge.exists() {
        add(air_discharge(&discharge, watch))?;
    }
    add(truth_motion::evaluate(folder).map_err(TruthError::from))?;
    if lines.is_empty() && !watch.stopped() {
        return Err(InputError::file(folder, Problem::NoTruth).into());
    }
    Ok(lines)
}

/// Questions about static maps whose pressures may be absolute.
///
/// # Errors
/// If the shipped scenario is damaged.
pub fn doubts(maps: &[Map]) -> Result<Vec<InputError>, InputError> {
    let (loaded, _) = shipped("static_map.toml")?;
    let asked = |(file, readings): &Map| {
        let remark = static_map::beyond_supply(readings, &loaded.plant);
        remark.map(|why| InputError::file(file, Problem::Unusable(why)))
    };
    Ok(maps.iter().filter_map(asked).collect())
}

fn shipped(name: &str) -> Result<(Loaded, PathBuf), InputError> {
    let path = Path::new("scenarios").join(name);
    Ok((thermyo_setup::parse(shipped::text(name), &path)?, path))
}

fn static_map(file: &Path, readings: Readings) -> Result<Vec<CaseFigures>, TruthError> {
    let (loaded, config) = shipped("static_map.toml")?;
    let largest_n = readings.largest_n();
    let [five, others] = static_map::planned(&loaded.plant.muscle, &readings);
    if others.loaded.is_empty() {
        let found = readings.loaded.len();
        let why = "five are fitted, the others compared".to_owned();
        let problem = Problem::TooFewLoaded { found, fewest: static_map::FEWEST + 1, why };
        return Err(InputError::file(file, problem).into());
    }
    let of_five = static_map::identify(&loaded, five, Some(&others), &config, file)?;
    let of_all = static_map::identify(&loaded, readings, None, &config, file)?;
    let fitted_n = of_all.findings.rmse.force_n;
    let left_n = of_five.findings.against.map_or(f64::NAN, |against| against.force_n);
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let known = MAPS.iter().find(|(name, ..)| *name == stem);
    let mut figures = vec![match known {
        Some((_, _, target_n, _)) => Figure::at_most("fitted_n", fitted_n, *target_n),
        None => Figure::shown("fitted_n", fitted_n),
    }];
    figures.push(Figure::shown("five_n", left_n));
    figures.push(Figure::at_most("five_share", left_n / largest_n, FIVE_SHARE));
    figures.push(Figure::shown("largest_n", largest_n));
    figures.extend(known.map(|(.., ideal_n)| Figure::shown("ideal_braid_n", *ideal_n)));
    let case =
        known.map_or_else(|| format!("static map, {stem}"), |(_, name, ..)| (*name).to_owned());
    let controlled = controlled(&of_all.scenario, &of_five.scenario).map_err(|error| {
        let why = format!("the muscle found in it cannot be driven: {error}");
        InputError::file(file, Problem::Unusable(why))
    })?;
    let of_control = CaseFigures { case: format!("{case}: at rest"), figures: controlled };
    Ok(vec![CaseFigures { case, figures }, of_control])
}

/// Largest error at rest, in percent of the stroke, for each load: the plant follows the law of all
/// readings, the core that of five.
fn controlled(of_all: &Loaded, of_five: &Loaded) -> Result<Vec<Figure>, RunError> {
    let mut loaded = control::full(of_all);
    loaded.believed = of_five.believed.clone();
    let held = parallel::map(&HELD_N, |(name, load_n)| {
        let mut loaded = control::load(&loaded, *load_n);
        let strokes = strokes(&loaded);
        loaded.believed.controller.contraction_dead_zone = (DEAD_ZONE * strokes[0]) as f32;
        let held = rest::hold_within(&loaded, 0, strokes, &mut CoreBoard::default())?;
        Ok(Figure::at_most(name, held.error_percent, 1.0))
    });
    held.into_iter().collect()
}

/// Largest contraction at 90 % of the supply's gauge pressure: of the unloaded muscle, and against
/// load and friction.
fn strokes(loaded: &Loaded) -> [f64; 2] {
    let Scenario { supply, ambient, load, friction, muscle, .. } = &loaded.plant;
    let chamber = AnyChamber::new(&core_config(&loaded.plant).chamber);
    let gauge_pa = 0.9 * (supply.pressure_pa - ambient.pressure_pa);
    [0.0, load.force_n + friction.force_n].map(|force_n| {
        let length_m = chamber.length_for_force_m(gauge_pa as f32, force_n as f32);
        1.0 - f64::from(length_m) / muscle.rest_length_m
    })
}

fn measured(file: &Path, needed: [&str; 2]) -> Result<Measured, InputError> {
    let measured = Measured::new(&read_whole(file)?, &COLUMNS)?;
    for name in needed {
        measured.needed(file, name)?;
    }
    Ok(measured)
}

fn gas_spring(file: &Path, watch: &dyn Watch) -> Result<CaseFigures, TruthError> {
    let (loaded, config) = shipped("gas_spring.toml")?;
    let measured = measured(file, ["pressure_pa", "volume_m3"])?;
    let identified = thermyo_identify::identify(&loaded, &config, &measured, file, watch)?;
    let pressure_pa = identified.findings.rmse.pressure_pa.unwrap_or(f64::NAN);
    Ok(CaseFigures {
        case: "gas spring, nitrogen".to_owned(),
        figures: vec![
            Figure::at_most("identified_kpa", pressure_pa / 1000.0, 3.5),
            Figure::shown("adiabatic_kpa", 42.6),
            Figure::shown("isothermal_kpa", 32.9),
        ],
    })
}

fn air_discharge(file: &Path, watch: &dyn Watch) -> Result<Vec<CaseFigures>, TruthError> {
    let (loaded, config) = shipped("air_discharge.toml")?;
    let measured = measured(file, ["pressure_pa", "sensor_gas_k"])?;
    let mut observer = |_: &Row| Ok(());
    let summary = run::run(&loaded, &mut CoreBoard::default(), Some(&measured), &mut observer)?;
    let rmse = |name: &str| {
        let compared = summary.measured.as_ref().and_then(|columns| columns.get(name));
        compared.map_or(f64::NAN, |difference| difference.rmse)
    };
    let identified =
        thermyo_identify::identify(&loaded, &config, &measured, file, watch)?.findings.rmse;
    let or_nan = |value: Option<f64>| value.unwrap_or(f64::NAN);
    Ok(vec![
        CaseFigures {
            case: "air discharge, lag fitted".to_owned(),
            figures: vec![
                Figure::at_most("temperature_k", rmse("sensor_gas_k"), 3.5),
                Figure::at_most("pressure_kpa", rmse("pressure_pa") / 1000.0, 8.0),
                Figure::shown("hyddown_k", 10.9),
                Figure::shown("hyddown_kpa", 4.0),
            ],
        },
        CaseFigures {
            case: "air discharge, identified".to_owned(),
            figures: vec![
                Figure::at_most("temperature_k", or_nan(identified.temperature_k), 2.0),
                Figure::at_most("pressure_kpa", or_nan(identified.pressure_pa) / 1000.0, 2.0),
            ],
        },
    ])
}
