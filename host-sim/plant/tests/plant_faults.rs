//! Faults of the plant against physics: holes, valves that stick or leak, a supply that is lost.

use crate::plant_runs::{FILLING, SHUT, VENTING, assert_books, built, hold};
use crate::plant_support::{MassFlow, muscle};
use thermyo_plant::flow::Iso6358;
use thermyo_plant::gas::IdealGas;
use thermyo_plant::{Actuation, BuildError, Disturbance, Plant, Travel, Truth};
use thermyo_scenario::{
    DriveKind, FaultWindow, HeatModel, LoadKind, PlantKind, PlantModel, Scenario,
};

const STUCK_OPEN: Travel = Travel { shut: 1.0, open: 1.0 };
const STUCK_SHUT: Travel = Travel { shut: 0.0, open: 0.0 };
const MUSCLES: [PlantModel; 2] = [PlantModel::Lumped, PlantModel::Full];

/// A muscle held at its length: a vessel with valves.
fn held(model: PlantModel, pressure_pa: f64) -> Scenario {
    let mut scenario = muscle(model);
    scenario.load.kind = LoadKind::Isometric;
    scenario.plant.initial_pressure_pa = pressure_pa;
    scenario
}

/// A plant with a hole, which the scenario must state before it is built.
fn holed(scenario: &Scenario, leak_m3_s_pa: f64) -> Box<dyn Plant> {
    let mut scenario = scenario.clone();
    scenario.faults.own.leak_conductance_m3_s_pa = leak_m3_s_pa;
    let mut plant = built(&scenario);
    plant.disturb(Disturbance { leak_m3_s_pa, ..Disturbance::default() });
    plant
}

fn broken(scenario: &Scenario, disturbance: Disturbance) -> Box<dyn Plant> {
    let mut plant = built(scenario);
    plant.disturb(disturbance);
    plant
}

fn run(plant: &mut dyn Plant, actuation: Actuation, seconds: f64) -> Truth {
    hold(plant, actuation, (seconds / 0.001).round() as usize)
}

/// V/(R C rho0 sqrt(T0 T)), the time in which a choked hole would empty the volume [s].
fn choked_time(scenario: &Scenario, start: &Truth, conductance: f64) -> f64 {
    let r = scenario.gas.gas_constant_j_kg_k;
    let (rho, t0) = (100_000.0 / (r * 293.15), 293.15_f64);
    start.volume_m3 / (r * conductance * rho * (t0 * start.gas_temperature_k).sqrt())
}

#[test]
fn a_choked_leak_discharges_as_the_closed_forms_say() {
    let leak = 2.0e-9;
    let mut vessel = Scenario::default();
    vessel.plant.kind = PlantKind::Vessel;
    vessel.drive.kind = DriveKind::Closed;
    vessel.vessel.volume_m3 = 1.0e-4;
    vessel.plant.initial_pressure_pa = 600_000.0;
    // The tube of the full muscle empties through the same hole, behind a resistance.
    for (name, scenario, tolerance) in [
        ("vessel", vessel, 1e-9),
        ("lumped", held(PlantModel::Lumped, 600_000.0), 1e-6),
        ("full", held(PlantModel::Full, 600_000.0), 0.01),
    ] {
        for heat in [HeatModel::Isothermal, HeatModel::Adiabatic] {
            let mut scenario = scenario.clone();
            scenario.heat.model = heat;
            let mut plant = holed(&scenario, leak);
            let start = plant.truth();
            let tube = if name == "full" { scenario.tube.volume_m3 } else { 0.0 };
            let gas_m3 = Truth { volume_m3: start.volume_m3 + tube, ..start };
            let passed = 0.2 / choked_time(&scenario, &gas_m3, leak);
            let end = run(&mut *plant, SHUT, 0.2);
            let expected = if heat == HeatModel::Isothermal {
                (-passed).exp()
            } else {
                (1.0 + 0.2 * passed).powf(-7.0)
            };
            let ratio = end.pressure_pa / start.pressure_pa;
            println!("{name} {heat:?}: {ratio:.6} for {expected:.6}");
            // It chokes down to ambient over the critical ratio of 0.3.
            assert!((0.57..0.85).contains(&expected), "{expected}");
            assert!((ratio / expected - 1.0).abs() < tolerance, "{name} {heat:?}");
            let left_kg = start.mass_kg - end.mass_kg - plant.ledger().mass_out_kg;
            assert!((left_kg + plant.ledger().mass_in_kg).abs() < 1e-12, "{name}: {left_kg}");
        }
    }
}

/// Time in which gas at a fixed length falls to a pressure through a hole [s], with n = 1 at
/// constant temperature and n = k without heat.
fn time_to(scenario: &Scenario, start: &Truth, conductance: f64, exponent: f64, to: f64) -> f64 {
    let gas = IdealGas::new(&scenario.gas);
    let hole = Iso6358::valve(conductance, scenario.valve.critical_ratio, &gas);
    let ambient = scenario.ambient.pressure_pa;
    let (mut time, mut pressure, step) = (0.0, start.pressure_pa, 1e-6);
    while pressure > to {
        let warmth = (pressure / start.pressure_pa).powf(1.0 - 1.0 / exponent);
        let kelvin = start.gas_temperature_k * warmth;
        let flow = hole.mass_flow(pressure, kelvin, ambient);
        pressure -= step * exponent * gas.r * kelvin * flow / start.volume_m3;
        time += step;
    }
    time
}

#[test]
fn a_burst_empties_the_muscle_in_the_time_its_conductance_gives() {
    let burst = 5.0e-8;
    for model in MUSCLES {
        let scenario = held(model, 500_000.0);
        let mut plant = holed(&scenario, burst);
        let start = plant.truth();
        let fastest = time_to(&scenario, &start, burst, 1.4, 120_000.0);
        let slowest = time_to(&scenario, &start, burst, 1.0, 120_000.0);
        while plant.truth().pressure_pa > 120_000.0 {
            plant.advance(SHUT).unwrap();
        }
        let time = plant.truth().time_s;
        println!("{model:?}: {time:.3} s of {fastest:.4} to {slowest:.4} s");
        // A step of the clock; the tube holds 5 % more gas.
        assert!(fastest < time + 0.001 && time < 1.06 * slowest + 0.001);
    }
    let rest = run(&mut *holed(&held(PlantModel::Lumped, 500_000.0), burst), SHUT, 2.0);
    assert!((rest.pressure_pa / 101_325.0 - 1.0).abs() < 1e-3, "{rest:?}");
}

#[test]
fn a_stuck_valve_does_what_it_wants() {
    for model in MUSCLES {
        let low = held(model, 150_000.0);
        let high = held(model, 500_000.0);
        let inlet = |travel| Disturbance { inlet: travel, ..Disturbance::default() };
        let outlet = |travel| Disturbance { outlet: travel, ..Disturbance::default() };

        let filled = run(&mut *broken(&low, inlet(STUCK_OPEN)), SHUT, 5.0).pressure_pa;
        assert!((filled / 700_000.0 - 1.0).abs() < 1e-3, "{model:?}: {filled}");
        let vented = run(&mut *broken(&high, outlet(STUCK_OPEN)), SHUT, 5.0).pressure_pa;
        assert!((vented / 101_325.0 - 1.0).abs() < 1e-3, "{model:?}: {vented}");

        let mut plant = broken(&low, inlet(STUCK_SHUT));
        run(&mut *plant, FILLING, 1.0);
        // Rounding of the tube's pressure moves some molecules.
        assert!(plant.ledger().mass_in_kg < 1e-15, "{model:?}");
        let mut plant = broken(&high, outlet(STUCK_SHUT));
        run(&mut *plant, VENTING, 1.0);
        assert!(plant.ledger().mass_out_kg < 1e-15, "{model:?}");
        // The other valve still works.
        let other = run(&mut *broken(&high, inlet(STUCK_SHUT)), VENTING, 5.0).pressure_pa;
        assert!((other / 101_325.0 - 1.0).abs() < 1e-3, "{model:?}: {other}");
    }
}

#[test]
fn a_leaking_valve_passes_its_share_when_shut_and_all_when_open() {
    const SHARE: f64 = 0.05;
    for (model, tolerance) in [(PlantModel::Lumped, 1e-9), (PlantModel::Full, 0.01)] {
        let mut scenario = held(model, 120_000.0);
        scenario.supply.droop_pa_s_kg = 0.0;
        let leaking =
            Disturbance { inlet: Travel { shut: SHARE, open: 1.0 }, ..Disturbance::default() };
        let gas = IdealGas::new(&scenario.gas);
        let valve = &scenario.valve;
        let full = Iso6358::valve(valve.conductance_m3_s_pa, valve.critical_ratio, &gas)
            .mass_flow(700_000.0, 298.0, 120_000.0);
        let mut plant = broken(&scenario, leaking);
        // After the tube has filled.
        run(&mut *plant, SHUT, 0.2);
        let early = plant.ledger().mass_in_kg;
        let end = run(&mut *plant, SHUT, 0.2);
        assert!(end.pressure_pa < 0.3 * 700_000.0, "{model:?}: the valve must choke");
        let flow = (plant.ledger().mass_in_kg - early) / 0.2;
        println!("{model:?}: {:.6} of the full flow", flow / full);
        // A full muscle's tube takes its part of the flow.
        let volumes = if model == PlantModel::Full {
            end.volume_m3 / (end.volume_m3 + scenario.tube.volume_m3)
        } else {
            1.0
        };
        assert!((flow / (SHARE * full * volumes) - 1.0).abs() < tolerance, "{model:?}");
        let open = run(&mut *broken(&scenario, leaking), FILLING, 0.05);
        let healthy = run(&mut *built(&scenario), FILLING, 0.05);
        let ratio = (open.mass_kg - 1.3e-4) / (healthy.mass_kg - 1.3e-4);
        assert!((0.999..1.05).contains(&ratio), "{model:?}: {ratio}");
    }
}

#[test]
fn gas_flows_back_into_a_lost_supply() {
    for model in MUSCLES {
        let scenario = held(model, 500_000.0);
        let lost = Disturbance { supply_pa: Some(101_325.0), ..Disturbance::default() };
        let mut plant = broken(&scenario, lost);
        let open = run(&mut *plant, FILLING, 5.0).pressure_pa;
        assert!((open / 101_325.0 - 1.0).abs() < 1e-3, "{model:?}: {open}");
        assert!(plant.ledger().mass_out_kg > 1e-4, "{model:?}");
        let shut = run(&mut *broken(&scenario, lost), SHUT, 1.0).pressure_pa;
        assert!((shut / 500_000.0 - 1.0).abs() < 1e-9, "{model:?}: {shut}");
    }
    // A vessel filled through a nozzle has the same supply behind it.
    let mut vessel = Scenario::default();
    vessel.plant.kind = PlantKind::Vessel;
    vessel.drive.kind = DriveKind::Fill;
    let half = Disturbance { supply_pa: Some(350_000.0), ..Disturbance::default() };
    let filled = run(&mut *broken(&vessel, half), SHUT, 20.0).pressure_pa;
    assert!((filled / 350_000.0 - 1.0).abs() < 1e-3, "{filled}");
}

#[test]
fn the_books_close_over_all_faults_at_once() {
    for model in [PlantModel::Lumped, PlantModel::Full, PlantModel::Paper] {
        let mut scenario = muscle(model);
        let leak_m3_s_pa = 2.0e-9;
        scenario.faults.own.leak_conductance_m3_s_pa = 50.0 * leak_m3_s_pa;
        let drive = MassFlow::new(&scenario);
        let mut plant = built(&scenario);
        for step in 0..20_000 {
            plant.disturb(match step / 2500 {
                0 => Disturbance::default(),
                1 => Disturbance { leak_m3_s_pa, ..Disturbance::default() },
                2 => Disturbance {
                    inlet: Travel { shut: 0.05, open: 1.0 },
                    leak_m3_s_pa,
                    ..Disturbance::default()
                },
                3 => Disturbance { outlet: STUCK_OPEN, ..Disturbance::default() },
                4 => Disturbance { inlet: STUCK_OPEN, leak_m3_s_pa, ..Disturbance::default() },
                5 => Disturbance {
                    inlet: STUCK_OPEN,
                    supply_pa: Some(101_325.0),
                    ..Disturbance::default()
                },
                6 => Disturbance { leak_m3_s_pa: 50.0 * leak_m3_s_pa, ..Disturbance::default() },
                _ => Disturbance { inlet: STUCK_SHUT, ..Disturbance::default() },
            });
            plant.advance(drive.actuation(&plant.truth())).unwrap();
        }
        let ledger = plant.ledger();
        assert!(ledger.mass_out_kg > 1e-3, "{model:?}");
        assert_books(&ledger, 1e-6, &format!("{model:?}"));
    }
}

#[test]
fn what_is_mended_is_as_new() {
    for model in MUSCLES {
        let scenario = held(model, 300_000.0);
        // With both valves driven shut, only a healthy plant keeps its gas.
        let mut plant =
            broken(&scenario, Disturbance { outlet: STUCK_OPEN, ..Disturbance::default() });
        let start = plant.truth().mass_kg;
        let vented = run(&mut *plant, SHUT, 0.1).mass_kg;
        assert!(vented < 0.85 * start, "{model:?}: {vented} kg of {start} kg");
        plant.disturb(Disturbance::default());
        let kept = run(&mut *plant, SHUT, 1.0).mass_kg;
        // The gas in the full muscle's tube warms up.
        assert!((kept / vented - 1.0).abs() < 0.02, "{model:?}: {kept} kg of {vented} kg");
    }
}

#[test]
fn a_hole_that_is_too_large_to_integrate_is_named() {
    for model in MUSCLES {
        let mut scenario = muscle(model);
        let window = FaultWindow { leak_conductance_m3_s_pa: 1e-3, ..FaultWindow::default() };
        scenario.faults.named.insert("burst".to_owned(), window);
        let error = thermyo_plant::build(&scenario, None).err().unwrap();
        assert!(matches!(error, BuildError::TooFast { .. }));
        assert!(error.to_string().starts_with("leak_conductance_m3_s_pa of [faults] is too large"));
    }
}
