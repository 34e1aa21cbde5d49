//! False alarms: the shipped scenarios, random muscles, and muscles with a wrong configuration of
//! the core.

use super::MUSCLES;
use super::muscle::{self, Draw, Task};
use crate::{CaseFigures, Figure};
use model_core::Faults;
use thermyo_files::shipped;
use thermyo_scenario::PlantModel;
use thermyo_setup::{Loaded, parse};
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;

const SHIPPED: [&str; 7] = [
    "air_discharge.toml",
    "contraction.toml",
    "gas_spring.toml",
    "nominal.toml",
    "proportional.toml",
    "reproduce.toml",
    "sensor.toml",
];
/// Duration of a run of a random muscle on `full` \[s\].
const MUSCLE_S: f64 = 30.0;
/// Duration of a run with a wrong configuration \[s\].
const RUN_S: f64 = 60.0;
/// Range of the factors between configured and true values \[-\].
const WRONG: [f64; 2] = [0.5, 2.0];

#[derive(Debug, Clone)]
pub struct Healthy {
    /// Name, by which the cause of an alarm is found.
    pub name: String,
    pub loaded: Loaded,
}

pub fn shipped() -> Vec<Healthy> {
    SHIPPED
        .iter()
        .map(|name| {
            let loaded = parse(shipped::text(name), name.as_ref());
            let loaded = loaded.expect("the file is part of the program");
            Healthy { name: (*name).to_owned(), loaded }
        })
        .collect()
}

/// Random muscles on `full`, configured correctly.
pub fn muscles() -> Vec<Healthy> {
    let muscle = |number| {
        let mut draw = Draw::new(0x00FF_0000 + number);
        let task = draw.of(&Task::ALL);
        let loaded = muscle::random(&mut draw, PlantModel::Full, task, MUSCLE_S);
        Healthy { name: format!("muscle {number}, {task:?}"), loaded }
    };
    (0..MUSCLES).map(muscle).collect()
}

/// Random muscles on `lumped` with a wrong configuration, for `hours` in total.
pub fn configured_wrong(hours: f64) -> Vec<Healthy> {
    let configured = |number| {
        let mut draw = Draw::new(0x0F00_0000 + number);
        let task = draw.of(&Task::ALL);
        let mut loaded = muscle::random(&mut draw, PlantModel::Lumped, task, RUN_S);
        let s = &mut loaded.believed;
        let heat = draw.factor(WRONG);
        s.heat.scale *= heat;
        let lag = draw.factor(WRONG);
        s.sensor.gas.time_constant_s *= lag;
        let conductance = draw.factor(WRONG);
        s.valve.conductance_m3_s_pa *= conductance;
        let friction = draw.factor(WRONG);
        s.friction.force_n *= friction;
        let wall = draw.factor(WRONG);
        s.wall.heat_capacity_j_k *= wall;
        let load = draw.factor(WRONG);
        s.load.force_n *= load;
        let name = format!(
            "configured wrong {number}, {task:?}, heat {heat:.2} lag {lag:.2} conductance \
             {conductance:.2} friction {friction:.2} wall {wall:.2} load {load:.2}"
        );
        Healthy { name, loaded }
    };
    (0..(hours * 3600.0 / RUN_S).ceil() as u64).map(configured).collect()
}

/// All faults that a healthy run shows.
pub fn shown(healthy: &Healthy) -> Result<Faults, RunError> {
    let mut loaded = healthy.loaded.clone();
    loaded.plant.run.log_every = 1;
    let mut shown = Faults::NONE;
    run::on_core(&loaded, |row| shown = shown.with(row.telemetry.faults))?;
    Ok(shown)
}

/// Hours run, and the number of runs that showed a fault, by kind.
pub fn line(case: &str, runs: &[Healthy], shown: &[Faults]) -> CaseFigures {
    let seconds: f64 = runs.iter().map(|run| run.loaded.plant.run.duration_s).sum();
    let alarms = shown.iter().filter(|faults| **faults != Faults::NONE).count();
    let mut figures = vec![
        Figure::shown("hours", seconds / 3600.0),
        Figure::at_most("alarms", alarms as f64, 0.0),
    ];
    for (fault, name) in Faults::NAMES {
        let count = shown.iter().filter(|faults| faults.intersects(fault)).count();
        if count > 0 {
            figures.push(Figure::shown(name, count as f64));
        }
    }
    CaseFigures { case: case.to_owned(), figures }
}
