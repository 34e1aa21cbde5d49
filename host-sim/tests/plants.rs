//! Plants of every size: stable by their own steps, or refused.

use thermyo_evaluate::{Figure, plants, table};
use thermyo_plant::{Actuation, BuildError};
use thermyo_scenario::{PlantKind, PlantModel, Scenario};

fn cylinder(bore_m: f64, stroke_m: f64, dead_volume_m3: f64, valve: f64) -> Scenario {
    let mut scenario = Scenario::default();
    scenario.plant.kind = PlantKind::Cylinder;
    scenario.plant.model = PlantModel::Full;
    scenario.cylinder.area_m2 = 0.25 * std::f64::consts::PI * bore_m * bore_m;
    scenario.cylinder.stroke_m = stroke_m;
    scenario.cylinder.dead_volume_m3 = dead_volume_m3;
    scenario.cylinder.spring_n = 5.0;
    scenario.load.force_n = -20.0;
    scenario.valve.conductance_m3_s_pa = valve;
    scenario
}

/// Fills and vents for a second each; returns the error of the energy balance.
fn cycle(scenario: &Scenario) -> Result<f64, BuildError> {
    let mut plant = thermyo_plant::build(scenario, None)?;
    for step in 0..4000 {
        let fills = step % 2000 < 1000;
        let [inlet, outlet] = if fills { [0.3, 0.0] } else { [0.0, 0.3] };
        plant.advance(Actuation { inlet, outlet }).unwrap();
    }
    Ok(plant.ledger().energy_balance_error())
}

#[test]
fn a_small_dead_volume_is_stable() {
    for (dead_volume_m3, valve) in
        [(2.0e-6, 3.3e-10), (2.0e-6, 4.0e-9), (1.0e-6, 3.3e-10), (1.0e-6, 4.0e-9), (2.0e-7, 4.0e-9)]
    {
        let error = cycle(&cylinder(0.016, 0.1, dead_volume_m3, valve)).unwrap();
        println!("{dead_volume_m3:e} m3, {valve:e}: energy off by {error:.1e}");
        assert!(error < 1e-6, "{dead_volume_m3} m3, {valve}: {error}");
    }
}

#[test]
fn the_ends_of_stated_ranges_are_stable_or_refused() {
    type Change = fn(&mut Scenario);
    let changes: [(&str, Change); 3] = [
        ("initial pressure", |s| s.plant.initial_pressure_pa = 1.0),
        ("dead volume", |s| s.cylinder.dead_volume_m3 = 1.0e-8),
        ("area", |s| s.cylinder.area_m2 = 1.0e-7),
    ];
    for (name, change) in changes {
        let mut scenario = cylinder(0.04, 0.1, 2.0e-5, 4.0e-9);
        change(&mut scenario);
        match cycle(&scenario) {
            Ok(error) => assert!(error < 1e-6, "{name}: {error}"),
            Err(error) => println!("{name}: {error}"),
        }
    }
}

#[test]
fn random_plants_neither_diverge_nor_swing_without_a_warning() {
    let lines = plants::evaluate(1, 40, &()).unwrap();
    let all = lines.last().unwrap();
    let misses =
        |name| all.figures.iter().any(|figure: &Figure| figure.name == name && !figure.holds());
    for name in ["diverged", "mass_ppm", "energy_ppm", "without_warning", "no_inflow"] {
        assert!(!misses(name), "{name}: {}", table(&lines));
    }
}

/// A valve passes no more than the tube behind it, which the core's configuration includes.
#[test]
fn a_valve_larger_than_its_tube_lets_gas_in() {
    let mut scenario = Scenario::default();
    scenario.plant.model = PlantModel::Full;
    scenario.valve.conductance_m3_s_pa = 3.0e-7;
    let config = thermyo_setup::core_config::core_config(&scenario);
    assert_eq!(config.valve.conductance_m3_s_pa, 3.0e-8, "the tube's");
    scenario.valve.conductance_m3_s_pa = 4.0e-9;
    let config = thermyo_setup::core_config::core_config(&scenario);
    assert_eq!(config.valve.conductance_m3_s_pa, 4.0e-9, "the valve's");
}
