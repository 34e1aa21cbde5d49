//! The full muscle: the working cycle, conservation, order, its parts.

mod plant_support;

use host_sim::plant::{self, Actuation, Plant};
use host_sim::scenario::{HeatModel, LoadKind, PlantModel, Scenario};
use plant_support::{MassFlow, muscle};

fn cycle(scenario: &Scenario, steps: usize) -> Box<dyn Plant> {
    let drive = MassFlow::new(scenario);
    let mut plant = plant::build(scenario, None).unwrap();
    for _ in 0..steps {
        plant.advance(drive.actuation(&plant.truth())).unwrap();
    }
    plant
}

#[test]
fn the_working_cycle() {
    let scenario = muscle(PlantModel::Full);
    let drive = MassFlow::new(&scenario);
    let mut plant = plant::build(&scenario, None).unwrap();
    let mut pressure = (f64::MAX, f64::MIN);
    let mut gas = (f64::MAX, f64::MIN);
    let mut shortest = f64::MAX;
    let (mut square, mut sensor_mean) = (0.0, 0.0);
    for i in 0..100_000 {
        let truth = plant.truth();
        pressure = (truth.pressure_pa.min(pressure.0), truth.pressure_pa.max(pressure.1));
        gas = (truth.gas_temperature_k.min(gas.0), truth.gas_temperature_k.max(gas.1));
        shortest = truth.length_m.min(shortest);
        square += (truth.sensor_gas_k - truth.gas_temperature_k).powi(2);
        if i >= 50_000 {
            sensor_mean += truth.sensor_gas_k / 50_000.0;
        }
        if i % 10_000 == 2_500 {
            println!(
                "{} s: foil {:.2} K, wall sensor {:.2} K",
                truth.time_s, truth.sensor_gas_k, truth.sensor_wall_k
            );
        }
        plant.advance(drive.actuation(&truth)).unwrap();
    }
    let rms = (square / 100_000.0f64).sqrt();
    println!(
        "pressure {pressure:.0?} Pa, contraction {:.3}, gas {gas:.1?} K",
        1.0 - shortest / 0.3
    );
    println!("bare sensor {rms:.2} K RMS, foil mean {sensor_mean:.2} K");
    println!("wall outer {:.2?} K", plant.axial_wall_k());
    println!("gas {:.2?} K", plant.axial_gas_k());
    println!("{:?}", plant.ledger());
}

#[test]
fn speed() {
    let scenario = muscle(PlantModel::Full);
    let start = std::time::Instant::now();
    cycle(&scenario, 20_000);
    println!("{:.2} us per step", 1e6 * start.elapsed().as_secs_f64() / 20_000.0);
}

#[test]
fn mass_and_energy_are_conserved_over_100_s() {
    for heat in [HeatModel::Adiabatic, HeatModel::Isothermal, HeatModel::Constant] {
        for load in [LoadKind::Isotonic, LoadKind::Isometric, LoadKind::Mass] {
            let mut scenario = muscle(PlantModel::Full);
            scenario.heat.model = heat;
            scenario.load.kind = load;
            let plant = cycle(&scenario, 100_000);
            let ledger = plant.ledger();
            let case = format!("{heat:?} {load:?}");
            println!(
                "{case}: {:.1e} {:.1e} {:.1e}",
                ledger.mass_balance_error(),
                ledger.energy_balance_error(),
                ledger.wall_balance_error()
            );
            assert!(ledger.mass_in_kg > 0.005, "{case}");
            assert!(ledger.mass_balance_error() < 1e-9, "{case}");
            assert!(ledger.energy_balance_error() < 1e-6, "{case}");
            assert!(ledger.wall_balance_error() < 1e-9, "{case}");
        }
    }
}
