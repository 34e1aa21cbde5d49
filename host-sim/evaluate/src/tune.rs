//! Accuracy of `thermyo tune` when the core is configured differently from the plant, and its
//! benefit.

use super::control::{Change, full, rest, sine, volume};
use super::{CaseFigures, Figure};
use std::path::Path;
use thermyo_compute::parallel;
use thermyo_compute::parallel::Watch;
use thermyo_setup::Loaded;
use thermyo_simulation::board::CoreBoard;
use thermyo_studies::tune;
use thermyo_studies::tune::{HIGHEST_PA, TuneError, Tuned};

pub const CASES: [(&str, Change); 8] = [
    ("all configured right", |_| {}),
    ("friction 30 % low", |s| s.friction.force_n *= 0.7),
    ("friction 30 % high", |s| s.friction.force_n *= 1.3),
    ("volume 20 % low", |s| volume(s, 0.8)),
    ("volume 20 % high", |s| volume(s, 1.2)),
    ("conductance 30 % low", |s| s.valve.conductance_m3_s_pa *= 0.7),
    ("conductance 30 % high", |s| s.valve.conductance_m3_s_pa *= 1.3),
    ALL_WRONG,
];

/// Friction and volume are too low, conductance too high.
pub const ALL_WRONG: (&str, Change) = ("friction -30, volume -20, conductance +30 %", |s| {
    s.friction.force_n *= 0.7;
    volume(s, 0.8);
    s.valve.conductance_m3_s_pa *= 1.3;
});

/// The muscle with all effects that the core leaves out, and a changed configuration of the core.
pub fn configured(nominal: &Loaded, change: Change) -> Loaded {
    full(nominal).believing(change)
}

pub fn tuned(loaded: &Loaded) -> Result<Tuned, TuneError> {
    tune::tune(loaded, Path::new("the nominal scenario"), HIGHEST_PA, &mut CoreBoard::default())
}

/// Error of a tuned value.
pub struct Off {
    /// Relative to the plant's value, with its sign \[%\].
    pub percent: f64,
    /// Size over the stated error \[-\].
    pub stated: f64,
}

pub fn off(tuned: &Tuned, truth: f64, path: &str) -> Off {
    let found = tuned.findings.value(path);
    let value = found.map_or(f64::NAN, |parameter| parameter.after);
    let stated = found.and_then(|parameter| parameter.standard_error);
    Off {
        percent: (value / truth - 1.0) * 100.0,
        stated: (value - truth).abs() / stated.unwrap_or(f64::NAN),
    }
}

fn line(nominal: &Loaded, name: &str, change: Change) -> Result<CaseFigures, TuneError> {
    let loaded = configured(nominal, change);
    let tuned = tuned(&loaded)?;
    let plant = &loaded.plant;
    let friction = off(&tuned, plant.friction.force_n, "friction.force_n");
    let turns = off(&tuned, plant.muscle.turns, "muscle.turns");
    let conductance = off(&tuned, plant.valve.conductance_m3_s_pa, "valve.conductance_m3_s_pa");
    let rms = |loaded: &Loaded| {
        sine(loaded, 0.5, 0.15, &mut CoreBoard::default()).map(|slow| slow.rms_percent)
    };
    let at_rest = |loaded: &Loaded| {
        rest::hold(loaded, 0, &mut CoreBoard::default()).map(|held| held.error_percent)
    };
    Ok(CaseFigures {
        case: name.to_owned(),
        figures: vec![
            Figure::at_most("friction_error_%", friction.percent.abs(), 3.0),
            // The force area is proportional to the turns squared.
            Figure::at_most("area_error_%", 2.0 * turns.percent.abs(), 1.0),
            Figure::at_most("conductance_error_%", conductance.percent.abs(), 8.0),
            Figure::at_most("friction_in_stated", friction.stated, 2.0),
            Figure::at_most("area_in_stated", turns.stated, 2.0),
            Figure::at_most("conductance_in_stated", conductance.stated, 2.0),
            Figure::at_least("sine_before_%", rms(&loaded)?, 0.0),
            Figure::at_most("sine_after_%", rms(&tuned.scenario)?, 0.2),
            Figure::at_least("rest_before_%", at_rest(&loaded)?, 0.0),
            Figure::at_most("rest_after_%", at_rest(&tuned.scenario)?, 1.0),
        ],
    })
}

/// Runs every case on `full`, on all cores. When stopped, returns the lines of the finished cases.
pub fn evaluate(nominal: &Loaded, watch: &dyn Watch) -> Result<Vec<CaseFigures>, TuneError> {
    let lines = parallel::map_watched(&CASES, watch, |(name, change)| line(nominal, name, *change));
    lines.into_iter().collect()
}
