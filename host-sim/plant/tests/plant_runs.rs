//! Shared by the tests of the plant: runs and their balances.

use crate::plant_support::{MassFlow, muscle};
use thermyo_plant::{Actuation, Ledger, Plant, Truth};
use thermyo_scenario::{HeatModel, LoadKind, PlantModel, Scenario};

pub const SHUT: Actuation = Actuation { inlet: 0.0, outlet: 0.0 };
pub const FILLING: Actuation = Actuation { inlet: 1.0, outlet: 0.0 };
pub const VENTING: Actuation = Actuation { inlet: 0.0, outlet: 1.0 };

pub fn built(scenario: &Scenario) -> Box<dyn Plant> {
    thermyo_plant::build(scenario, None).unwrap()
}

pub fn hold(plant: &mut dyn Plant, actuation: Actuation, steps: usize) -> Truth {
    for _ in 0..steps {
        plant.advance(actuation).unwrap();
    }
    plant.truth()
}

/// The muscle after this number of steps of its working cycle; `see` gets the state before each.
pub fn cycled(scenario: &Scenario, steps: usize, mut see: impl FnMut(Truth)) -> Box<dyn Plant> {
    let drive = MassFlow::new(scenario);
    let mut plant = built(scenario);
    for _ in 0..steps {
        let truth = plant.truth();
        plant.advance(drive.actuation(&truth)).unwrap();
        see(truth);
    }
    plant
}

/// A working cycle of 100 s: the muscle at its end, and the state before each step.
pub fn working_cycle(model: PlantModel) -> (Box<dyn Plant>, Vec<Truth>) {
    let mut truths = Vec::new();
    let plant = cycled(&muscle(model), 100_000, |truth| truths.push(truth));
    (plant, truths)
}

/// Smallest and largest value.
pub fn extremes(truths: &[Truth], of: impl Fn(&Truth) -> f64) -> (f64, f64) {
    truths.iter().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), value| {
        (value.min(least), value.max(most))
    })
}

/// RMS of the bare sensor's error \[K\].
pub fn bare_sensor_rms_k(truths: &[Truth]) -> f64 {
    let square = |truth: &Truth| (truth.sensor_gas_k - truth.gas_temperature_k).powi(2);
    (truths.iter().map(square).sum::<f64>() / truths.len() as f64).sqrt()
}

/// Asserts that the balances close, the energy's up to a share.
#[track_caller]
pub fn assert_books(ledger: &Ledger, energy: f64, case: &str) {
    for (name, error, bound) in [
        ("mass", ledger.mass_balance_error(), 1e-9),
        ("energy", ledger.energy_balance_error(), energy),
        ("wall", ledger.wall_balance_error(), 1e-9),
    ] {
        assert!(error < bound, "{case}: {name} {error:.1e}; {ledger:?}");
    }
}

/// Asserts that the balances close over 100 s of the working cycle, for any heat transfer and load.
pub fn assert_conserves(model: PlantModel, least_kg: f64) {
    let heats =
        [HeatModel::Adiabatic, HeatModel::Isothermal, HeatModel::Constant, HeatModel::Correlation];
    for heat in heats {
        for load in [LoadKind::Isotonic, LoadKind::Isometric, LoadKind::Mass] {
            let mut scenario = muscle(model);
            scenario.heat.model = heat;
            scenario.load.kind = load;
            let plant = cycled(&scenario, 100_000, drop);
            let case = format!("{model:?} {heat:?} {load:?}");
            assert!(plant.ledger().mass_in_kg > least_kg, "{case}");
            assert_books(&plant.ledger(), 1e-6, &case);
        }
    }
}
