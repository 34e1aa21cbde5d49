//! Time to vent from 5 bar to below 1.2 bar, and the valve that this requires.

use super::muscle::{self, Draw, Task};
use super::trial::VENTED_PA;
use super::{MUSCLES, VENTED_S};
use crate::{CaseFigures, Figure};
use thermyo_scenario::{DriveKind, PlantModel};
use thermyo_setup::Loaded;
use thermyo_simulation::run;
use thermyo_simulation::run::RunError;

const FULL_PA: f64 = 5.0e5;
/// Time of the emergency stop, after the muscle has filled \[s\].
const STOP_S: f64 = 3.0;

/// The nominal muscle's valve is small for its volume, so it takes longer \[s\].
const NOMINAL: &str = "vent from 5 bar, nominal muscle";
const NOMINAL_S: f64 = 1.5;
/// Sonic conductance per gas volume at 5 bar that vents any muscle within [`VENTED_S`] \[1/(s MPa)\].
const NEEDED_S_MPA: f64 = 25.0;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vented {
    /// Time from the emergency stop until below 1.2 bar \[s\].
    pub time_s: f64,
    /// The valve's sonic conductance over the gas volume at 5 bar \[1/(s Pa)\].
    pub per_volume_s_pa: f64,
}

impl Vented {
    /// Conductance per volume at which venting would have taken [`VENTED_S`] \[1/(s MPa)\]: the
    /// time is proportional to the volume over the conductance.
    pub fn needed_s_mpa(&self) -> f64 {
        1e6 * self.per_volume_s_pa * self.time_s / VENTED_S
    }
}

/// Fills a muscle to 5 bar and presses its emergency stop.
pub fn vent(muscle: &Loaded) -> Result<Vented, RunError> {
    let mut loaded = muscle.clone();
    loaded.drive_profile = None;
    loaded.plant.drive.kind = DriveKind::Pressure;
    loaded.plant.drive.pressure_pa = FULL_PA;
    loaded.plant.run.duration_s = STOP_S + 5.0;
    loaded.plant.run.log_every = 1;
    loaded.plant.faults.own.emergency_stop = true;
    loaded.plant.faults.own.from_s = STOP_S;
    let (mut volume_m3, mut time_s) = (0.0, 0.0);
    run::on_core(&loaded, |row| {
        let since_s = row.truth.time_s - STOP_S;
        if since_s < 0.0 {
            volume_m3 = row.truth.volume_m3;
        } else if row.truth.pressure_pa > VENTED_PA {
            time_s = since_s;
        }
    })?;
    let per_volume_s_pa = loaded.plant.valve.conductance_m3_s_pa / volume_m3;
    Ok(Vented { time_s, per_volume_s_pa })
}

pub fn muscles(nominal: &Loaded) -> Vec<(&'static str, Vec<Loaded>)> {
    let random = |number| {
        let mut draw = Draw::new(0x0DE0_0000 + number);
        muscle::random(&mut draw, PlantModel::Full, Task::PressureHold, STOP_S)
    };
    vec![
        (NOMINAL, [PlantModel::Lumped, PlantModel::Full].map(|m| nominal.with_model(m)).to_vec()),
        ("vent from 5 bar, random muscles", (0..MUSCLES).map(random).collect()),
    ]
}

/// Line of the table for some muscles.
pub fn line(case: &str, vented: &[Vented]) -> CaseFigures {
    let most = |figure: fn(&Vented) -> f64| vented.iter().map(figure).fold(0.0, f64::max);
    let worst_s = most(|vented| vented.time_s);
    CaseFigures {
        case: case.to_owned(),
        figures: vec![
            match case {
                NOMINAL => Figure::at_most("worst_s", worst_s, NOMINAL_S),
                _ => Figure::at_most("worst_s", worst_s, VENTED_S),
            },
            Figure::shown("conductance_s_mpa", most(|vented| 1e6 * vented.per_volume_s_pa)),
            Figure::at_most("needed_s_mpa", most(Vented::needed_s_mpa), NEEDED_S_MPA),
        ],
    }
}
