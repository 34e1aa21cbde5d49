//! Builds the plant of a scenario.

use super::chamber::{Chamber, with_chamber};
use super::{BuildError, DrivenEnd, Plant, full, lumped, vessel};
use thermyo_scenario::profile::Profile;
use thermyo_scenario::{PlantModel, Scenario};

/// The plant of a scenario, at rest at time zero. `volume_profile` is the table of
/// `vessel.volume_csv`, volume \[m3\] over time \[s\].
///
/// # Errors
/// [`BuildError`] for faults that the scenario's validation cannot find.
pub fn build(
    scenario: &Scenario,
    volume_profile: Option<Profile>,
) -> Result<Box<dyn Plant>, BuildError> {
    of_kind(scenario, volume_profile, Drive::Valves)
}

/// The plant of a scenario without its valves or nozzle: its actuation is mass flows \[kg/s\],
/// with the inflow at the supply's temperature. A moving chamber is `lumped` or `paper`.
pub fn build_driven_by_flows(
    scenario: &Scenario,
    volume_profile: Option<Profile>,
) -> Result<Box<dyn Plant>, BuildError> {
    of_kind(scenario, volume_profile, Drive::Flows)
}

/// The plant of a scenario with a held end (`load.kind = "isometric"`), which a mechanism moves.
///
/// # Errors
/// As [`build`]; also for a vessel.
pub fn build_driven_end(scenario: &Scenario) -> Result<Box<dyn DrivenEnd>, BuildError> {
    with_chamber!(scenario, chamber => driven_end(scenario, chamber), vessel => Err(BuildError::NoEnd))
}

fn driven_end<C: Chamber + Copy + Send + 'static>(
    scenario: &Scenario,
    chamber: C,
) -> Result<Box<dyn DrivenEnd>, BuildError> {
    Ok(match scenario.plant.model {
        PlantModel::Full => Box::new(full::Full::new(scenario, chamber)?),
        PlantModel::Lumped | PlantModel::Paper => Box::new(lumped::Lumped::new(scenario, chamber)?),
    })
}

/// Meaning of an [`Actuation`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Drive {
    Valves,
    Flows,
}

/// The kinds of plant.
fn of_kind(
    scenario: &Scenario,
    volume_profile: Option<Profile>,
    drive: Drive,
) -> Result<Box<dyn Plant>, BuildError> {
    with_chamber!(scenario, chamber => moving(scenario, drive, chamber), vessel => {
        let vessel = vessel::Vessel::new(scenario, volume_profile)?;
        Ok(match drive {
            Drive::Valves => Box::new(vessel),
            Drive::Flows => Box::new(vessel.driven_by_flows(scenario.supply.temperature_k)),
        })
    })
}

fn moving<C: Chamber + Copy + Send + 'static>(
    scenario: &Scenario,
    drive: Drive,
    chamber: C,
) -> Result<Box<dyn Plant>, BuildError> {
    let lumped = || lumped::Lumped::new(scenario, chamber);
    Ok(match (drive, scenario.plant.model) {
        (Drive::Flows, _) => Box::new(lumped()?.driven_by_flows()),
        (Drive::Valves, PlantModel::Full) => Box::new(full::Full::new(scenario, chamber)?),
        (Drive::Valves, PlantModel::Lumped | PlantModel::Paper) => Box::new(lumped()?),
    })
}
