//! Start of a run, the same in every plant.

use super::Ledger;
use super::chamber::{Chamber, with_chamber};
use super::gas::IdealGas;
use super::pull::{Pressed, Pull, Softening};
use super::sensors::Exposure;
use thermyo_scenario::{LoadKind, Scenario};

/// The gas and its wall at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    pub pressure: f64,
    pub gas_k: f64,
    pub wall_k: f64,
    pub length: f64,
    pub volume: f64,
}

impl Start {
    /// Start with gas of this length \[m\] and volume \[m3\].
    pub fn new(scenario: &Scenario, length: f64, volume: f64) -> Self {
        let plant = &scenario.plant;
        Self {
            pressure: plant.initial_pressure_pa,
            gas_k: plant.gas_k(),
            wall_k: plant.initial_temperature_k,
            length,
            volume,
        }
    }

    /// Start of a moving chamber: at the held length, or where friction lets its end rest.
    pub fn of_chamber<C: Chamber>(scenario: &Scenario, pull: &Pull<C>) -> Self {
        let Scenario { friction, load, plant, .. } = scenario;
        let pressure = plant.initial_pressure_pa;
        let softening = Softening::new(friction).factor(plant.initial_temperature_k);
        let pressed = Pressed::new(friction.pressure_factor).factor(pressure - pull.ambient_pa);
        let length = if load.kind == LoadKind::Isometric {
            load.length_m
        } else {
            pull.start_length(pressure, friction.force_n * pressed * softening)
        };
        Self::new(scenario, length, pull.chamber.volume(length))
    }

    /// Mass of the gas \[kg\].
    pub fn mass(&self, gas: &IdealGas) -> f64 {
        self.pressure * self.volume / (gas.r * self.gas_k)
    }

    /// The ledger, still without entries.
    pub fn ledger(&self, gas: &IdealGas) -> Ledger {
        let mass_kg = self.mass(gas);
        Ledger {
            mass_initial_kg: mass_kg,
            energy_initial_j: gas.cv * mass_kg * self.gas_k,
            ..Ledger::default()
        }
    }

    /// Surroundings of the sensors up to the start.
    pub fn exposure(&self) -> Exposure {
        Exposure {
            gas_k: self.gas_k,
            wall_k: self.wall_k,
            pressure_pa: self.pressure,
            length_m: self.length,
        }
    }
}

/// Length at which a run of a scenario begins \[m\]: NaN where no length holds its load, none for a vessel.
pub fn start_m(scenario: &Scenario) -> Option<f64> {
    with_chamber!(
        scenario,
        chamber => Some(Start::of_chamber(scenario, &Pull::new(scenario, chamber)).length),
        vessel => None
    )
}
