//! The full muscle: the working cycle, conservation, order, its parts.

use crate::plant_runs::{
    FILLING, SHUT, VENTING, assert_conserves, bare_sensor_rms_k, built, extremes, hold,
    working_cycle,
};
use crate::plant_support::{MassFlow, muscle};
use ode_solvers::{Dop853, SVector, System};
use std::f64::consts::PI;
use thermyo_plant::chamber::braid::Geometry;
use thermyo_plant::flow::{Iso6358, Streams};
use thermyo_plant::gas::{IdealGas, air_conductivity, air_viscosity};
use thermyo_plant::{Actuation, Plant, Truth};
use thermyo_scenario::{HeatModel, LoadKind, PlantModel, Scenario};

/// Removes slip and creep, for tests of something else.
pub fn elastic(mut scenario: Scenario) -> Scenario {
    let muscle = &mut scenario.muscle;
    (muscle.slip_force_n, muscle.creep_fast_n_m, muscle.creep_slow_n_m) = (0.0, 0.0, 0.0);
    scenario
}

#[test]
fn the_working_cycle() {
    let (plant, truths) = working_cycle(PlantModel::Full);
    let pressure = extremes(&truths, |truth| truth.pressure_pa);
    let gas = extremes(&truths, |truth| truth.gas_temperature_k);
    let (shortest, _) = extremes(&truths, |truth| truth.length_m);
    // Over the last ten strokes.
    let late = &truths[50_000..];
    let foil = late.iter().map(|truth| truth.sensor_gas_k).sum::<f64>() / late.len() as f64;
    let outer = plant.axial_wall_k();
    let rms = bare_sensor_rms_k(&truths);
    let contraction = 1.0 - shortest / 0.3;
    println!("pressure {pressure:.0?} Pa, contraction {contraction:.3}, gas {gas:.1?} K");
    println!("bare sensor {rms:.2} K RMS, foil mean {foil:.2} K");
    println!("outer wall {outer:.2?} K");
    assert!((1.0e5..1.3e5).contains(&pressure.0) && (3.2e5..4.5e5).contains(&pressure.1));
    assert!((0.25..0.31).contains(&contraction));
    assert!((275.0..287.0).contains(&gas.0) && (312.0..328.0).contains(&gas.1));
    assert!((10.0..16.0).contains(&rms));
    // Fig. 5: the foil's mean rises by some kelvins.
    assert!((299.0..305.0).contains(&foil));
    // Fig. 2: cool at the port, warm at the closed end.
    assert!(outer.windows(2).all(|pair| pair[1] > pair[0] - 0.2), "{outer:?}");
    let rise = outer.last().unwrap() - outer.first().unwrap();
    assert!((1.0..10.0).contains(&rise), "{outer:?}");
}

#[test]
fn mass_and_energy_are_conserved_over_100_s() {
    assert_conserves(PlantModel::Full, 0.005);
}

/// For any valid friction, heat transfer and wall, the plant's steps are short enough.
#[test]
fn the_ends_of_the_ranges_run() {
    type Set = fn(&mut Scenario);
    let ends: [(&str, Set); 10] = [
        ("no sliding friction", |s| s.friction.force_n = 0.0),
        ("no friction", |s| (s.friction.force_n, s.friction.stribeck_force_n) = (0.0, 0.0)),
        ("stiff bristles", |s| s.friction.presliding_stiffness_n_m = 1e7),
        ("stiff in the cold", |s| s.friction.reference_temperature_k = 700.0),
        ("friction softened away", |s| s.plant.initial_temperature_k = 700.0),
        ("heat transfer", |s| s.heat.scale = 300.0),
        ("heat transfer of the jet", |s| {
            (s.heat.model, s.heat.inner_per_flow) = (HeatModel::Constant, 1e7);
        }),
        ("stirring that lasts", |s| s.heat.stirring_decay_s = 100.0),
        ("stirring that stops", |s| s.heat.stirring_decay_s = 0.001),
        ("thin wall", |s| s.wall.conductance_w_k = 1e5),
    ];
    for model in [PlantModel::Full, PlantModel::Lumped] {
        for (name, set) in ends {
            let mut scenario = muscle(model);
            set(&mut scenario);
            let drive = MassFlow::new(&scenario);
            let mut plant = built(&scenario);
            for step in 0..300 {
                let advanced = plant.advance(drive.actuation(&plant.truth()));
                assert!(advanced.is_ok(), "{name}, {model:?}, step {step}: {advanced:?}");
            }
            let ledger = plant.ledger();
            let closes = ledger.mass_balance_error() < 1e-9 && ledger.energy_balance_error() < 1e-6;
            assert!(closes, "{name}, {model:?}: {ledger:?}");
        }
    }
}

/// Filling at a fixed length through an ideal valve and a wide tube volume: no process is faster
/// than the step, and nothing switches.
fn smooth() -> Scenario {
    let mut scenario = muscle(PlantModel::Full);
    scenario.heat.model = HeatModel::Constant;
    scenario.load.kind = LoadKind::Isometric;
    scenario.plant.initial_pressure_pa = 300_000.0;
    scenario.valve.switch_time_s = 0.0;
    scenario.valve.dead_time_s = 0.0;
    scenario.tube.volume_m3 = 1.0e-4;
    scenario.tube.conductance_m3_s_pa = 4.0e-9;
    scenario
}

#[test]
fn integration_is_of_fourth_order() {
    let mut scenario = smooth();
    // A small flow through a wide tube: the pressure drop stays in the tube's linear range, and the flow laminar.
    scenario.valve.conductance_m3_s_pa = 1.5e-10;
    scenario.tube.conductance_m3_s_pa = 3.0e-8;
    scenario.tube.volume_m3 = 3.0e-5;
    let mut pressure = |step: f64| {
        scenario.run.step_s = step;
        let mut plant = built(&scenario);
        hold(&mut *plant, FILLING, (0.008 / step).round() as usize).pressure_pa
    };
    let exact = pressure(1.25e-5);
    let (coarse, fine) = ((pressure(1e-4) - exact).abs(), (pressure(5e-5) - exact).abs());
    let order = (coarse / fine).log2();
    println!("errors {coarse:.1e}, {fine:.1e} Pa: order {order:.2}");
    assert!((3.5..4.5).contains(&order));
}

/// Differences of the default muscle, in steps of `step_s`, from one in steps of 10 us, over 2 s of pulses on either
/// valve, compared every 1 ms: RMS and largest of the pressure \[Pa\], RMS of the gas's temperature \[K\] and the
/// length \[m\].
fn differences(step_s: f64) -> [f64; 4] {
    let built = |step_s: f64| {
        let mut scenario = muscle(PlantModel::Full);
        scenario.run.step_s = step_s;
        (built(&scenario), (0.001 / step_s).round() as usize)
    };
    let ((mut plant, steps), (mut exact, exact_steps)) = (built(step_s), built(1e-5));
    let (mut squares, mut largest) = ([0.0_f64; 3], 0.0_f64);
    const MS: usize = 2000;
    for ms in 0..MS {
        let actuation = match ms / 250 % 4 {
            0 => Actuation { inlet: 0.237, outlet: 0.0 },
            2 => Actuation { inlet: 0.0, outlet: 0.341 },
            _ => SHUT,
        };
        let ours = hold(&mut *plant, actuation, steps);
        let exact = hold(&mut *exact, actuation, exact_steps);
        let pressure = ours.pressure_pa - exact.pressure_pa;
        let gas = ours.gas_temperature_k - exact.gas_temperature_k;
        largest = largest.max(pressure.abs());
        for (sum, off) in squares.iter_mut().zip([pressure, gas, ours.length_m - exact.length_m]) {
            *sum += off * off;
        }
    }
    let [pressure, gas, length] = squares.map(|sum| (sum / MS as f64).sqrt());
    [pressure, largest, gas, length]
}

/// Within a step of 1 ms the integration steps are 0.1 ms long, or 0.2 ms while both valves are shut; a step of 0.1 ms
/// has one, a step of 50 us is half of one. With equal steps of 0.1 ms over which the openings were averaged, the
/// differences were 0.32 and 1.9 Pa, 1.7e-4 K and 4.1e-8 m.
#[test]
fn its_own_steps_are_short_enough() {
    let [own, tenth, twentieth] = [1e-3, 1e-4, 5e-5].map(differences);
    for off in [own, tenth, twentieth] {
        println!("{}", off.map(|off| format!("{off:.1e}")).join(" "));
    }
    for (what, off, (low, high)) in [
        ("RMS, Pa", own[0], (0.005, 0.2)),
        ("largest, Pa", own[1], (0.03, 1.0)),
        ("gas, K", own[2], (1e-5, 1e-3)),
        ("length, m", own[3], (1e-9, 2e-7)),
        ("halved, Pa", tenth[0] / twentieth[0], (3.0, 20.0)),
    ] {
        assert!((low..=high).contains(&off), "{what}: {off}, allowed {low} to {high}");
    }
}

/// One zone of the full muscle at a fixed length, with tube, regulator and two wall layers,
/// derived separately in energies: m, U, m_t, U_t, regulator flow, inner and outer wall.
struct Independent {
    scenario: Scenario,
    gas: IdealGas,
    valve: Iso6358,
    tube: Iso6358,
    volume: f64,
    surface: f64,
}

impl Independent {
    /// Heat to the wall of a tube as wide as a nozzle that passes as much as its port.
    fn tube_heat_w(&self, flow: f64, gas_k: f64) -> f64 {
        let (bore_m, wall_k) =
            (self.tube.equivalent_diameter(&self.gas), self.scenario.ambient.temperature_k);
        let section_m2 = PI / 4.0 * bore_m * bore_m;
        let reynolds = flow.abs() * bore_m / (section_m2 * air_viscosity(wall_k));
        let turbulent = ((reynolds - 2300.0) / 1700.0).clamp(0.0, 1.0);
        let colburn = 0.3164 / 8.0 * reynolds.powf(0.75) * 0.71_f64.powf(1.0 / 3.0);
        let nusselt = (1.0 - turbulent) * 3.66 + turbulent * colburn;
        let surface_m2 = PI * bore_m * self.scenario.tube.volume_m3 / section_m2;
        nusselt * air_conductivity(wall_k) / bore_m * surface_m2 * (gas_k - wall_k)
    }
}

impl System<f64, SVector<f64, 7>> for Independent {
    fn system(&self, _: f64, y: &SVector<f64, 7>, dy: &mut SVector<f64, 7>) {
        let s = &self.scenario;
        let gas = &self.gas;
        let state = |m: f64, u: f64, v: f64| ((gas.k - 1.0) * u / v, u / (gas.cv * m));
        let muscle = state(y[0], y[1], self.volume);
        let tube = state(y[2], y[3], s.tube.volume_m3);
        let supply = s.supply.pressure_pa - s.supply.droop_pa_s_kg * y[4];
        let mut port = Streams::default();
        port.add(muscle, tube, |p, t, q| self.tube.mass_flow(p, t, q));
        let inflow = self.valve.mass_flow(supply, s.supply.temperature_k, tube.0);
        let h = s.heat.inner_w_m2_k + s.heat.inner_per_flow * port.inflow;
        let heat = h * self.surface * (muscle.1 - y[5]);
        let into = gas.cp * (port.inflow_temperature - port.outflow * muscle.1);
        let through = s.wall.conductance_w_k * (y[5] - y[6]);
        let lost = s.heat.outer_w_m2_k * self.surface * (y[6] - s.ambient.temperature_k);
        dy[0] = port.inflow - port.outflow;
        dy[1] = into - heat;
        dy[2] = inflow - dy[0];
        dy[3] = gas.cp * inflow * s.supply.temperature_k - into - self.tube_heat_w(dy[0], tube.1);
        dy[4] = (inflow - y[4]) / 0.02;
        dy[5] = (heat - through) / (s.wall.heat_capacity_j_k * (1.0 - s.wall.outer_fraction));
        dy[6] = (through - lost) / (s.wall.heat_capacity_j_k * s.wall.outer_fraction);
    }
}

#[test]
fn agrees_with_an_independent_solver() {
    let mut scenario = smooth();
    scenario.muscle.zones = 1;
    let gas = IdealGas::new(&scenario.gas);
    let braid = Geometry::new(
        scenario.muscle.thread_length_m,
        scenario.muscle.turns,
        scenario.muscle.dead_volume_m3,
    );
    let length = scenario.load.length_m;
    let (c, b) = (scenario.valve.conductance_m3_s_pa, scenario.valve.critical_ratio);
    let system = Independent {
        gas,
        valve: Iso6358::valve(c, b, &gas),
        tube: Iso6358::tube(scenario.tube.conductance_m3_s_pa, b, &gas),
        volume: braid.volume(length),
        surface: braid.surface(length),
        scenario: scenario.clone(),
    };
    let (p, t) = (300_000.0, 298.0);
    let density = p / (gas.r * t);
    let tube = scenario.tube.volume_m3;
    let initial = SVector::<f64, 7>::from([
        density * system.volume,
        p * system.volume / (gas.k - 1.0),
        density * tube,
        p * tube / (gas.k - 1.0),
        0.0,
        t,
        t,
    ]);
    let volume = system.volume;
    let mut solver = Dop853::new(system, 0.0, 0.3, 0.001, initial, 1e-11, 1e-13);
    solver.integrate().unwrap();
    let end = *solver.y_out().last().unwrap();
    let mut plant = built(&scenario);
    let truth = hold(&mut *plant, FILLING, 300);
    for (name, ours, theirs) in [
        ("mass", truth.mass_kg, end[0]),
        ("energy", truth.pressure_pa * volume / (gas.k - 1.0), end[1]),
        ("outer wall", plant.axial_wall_k()[0], end[6]),
    ] {
        let error = (ours / theirs - 1.0).abs();
        println!("{name}: {error:.1e}");
        assert!(error < 1e-7, "{name}: {ours} for {theirs}");
    }
    assert!(truth.pressure_pa > 450_000.0, "{truth:?}");
}

#[test]
fn the_closed_end_is_compressed_isentropically() {
    let mut scenario = muscle(PlantModel::Full);
    scenario.heat.model = HeatModel::Adiabatic;
    scenario.load.kind = LoadKind::Isometric;
    scenario.muscle.zones = 20;
    let mut plant = built(&scenario);
    let truth = hold(&mut *plant, FILLING, 60);
    let gas = plant.axial_gas_k();
    let isentrope = 298.0 * (truth.pressure_pa / 120_000.0).powf(0.4 / 1.4);
    assert!(isentrope > 330.0, "{truth:?}");
    assert!((gas[19] / isentrope - 1.0).abs() < 0.01, "{gas:?} for {isentrope}");
    assert!(gas[0] < gas[19] - 5.0, "{gas:?}");
    // Without flow the gas temperature evens out.
    hold(&mut *plant, SHUT, 300_000);
    let gas = plant.axial_gas_k();
    assert!((gas[19] - gas[0]).abs() < 0.5, "{gas:?}");
}

#[test]
fn the_load_rests_on_the_stop_until_it_is_lifted() {
    let scenario = muscle(PlantModel::Full);
    let mut plant = built(&scenario);
    let mut lifted_at = None;
    for _ in 0..500 {
        let truth = hold(&mut *plant, Actuation { inlet: 0.2, outlet: 0.0 }, 1);
        assert!(truth.length_m <= 0.3);
        if truth.length_m < 0.3 - 1e-3 && lifted_at.is_none() {
            lifted_at = Some(truth.pressure_pa);
        }
    }
    // 100 N of load and 15 to 19 N of friction over 31.7 cm2.
    let braid = Geometry::from_braid(0.3, 0.02, 23.0, 0.0);
    let pressure = |force: f64| 101_325.0 + force / braid.force_area(0.3);
    let lifted_at = lifted_at.expect("it must lift");
    assert!((pressure(115.0)..pressure(150.0)).contains(&lifted_at), "{lifted_at} Pa");
    // Vented, it comes back to the stop and stays there.
    let truth = hold(&mut *plant, VENTING, 3000);
    assert_eq!((truth.length_m, truth.speed_m_s), (0.3, 0.0));
}

/// A light mass on a muscle that fills fast: the mass is thrown, and the muscle's end catches up
/// with it.
#[test]
fn a_slack_muscle_does_not_hold_its_load() {
    const G: f64 = 9.80665;
    for (kind, fall) in [(LoadKind::Mass, G), (LoadKind::Isotonic, 8.0)] {
        let mut scenario = elastic(muscle(PlantModel::Full));
        scenario.load.kind = kind;
        scenario.load.mass_kg = 0.5;
        scenario.load.force_n = 0.5 * fall;
        scenario.friction.force_n = 2.0;
        scenario.friction.stribeck_force_n = 0.0;
        scenario.muscle.bladder_stiffness_n_m = 1500.0;
        scenario.plant.initial_pressure_pa = 101_325.0;
        let mut plant = built(&scenario);
        let truths: Vec<Truth> = (0..200).map(|_| hold(&mut *plant, FILLING, 1)).collect();
        let step = scenario.run.step_s;
        // Positive in contraction.
        let speed: Vec<f64> = truths.iter().map(|truth| -truth.speed_m_s).collect();
        let acceleration = |i: usize| (speed[i + 1] - speed[i]) / step;
        let steps = 0..truths.len() - 1;
        let away = |i: &usize| speed[*i] > 0.5 && acceleration(*i) < -fall;
        let thrown = steps.clone().find(away).expect("it must be thrown");
        let caught =
            steps.skip(thrown).find(|i| acceleration(*i) < -100.0).expect("it must be caught");
        let flight_s = (caught - thrown) as f64 * step;
        println!("{kind:?}: thrown at {:.3} m/s, caught after {flight_s:.3} s", speed[thrown]);
        assert!((0.02..0.2).contains(&flight_s));
        let flown = speed[thrown] * flight_s - 0.5 * fall * flight_s * flight_s;
        let way = truths[thrown].length_m - truths[caught].length_m;
        assert!((flown / way - 1.0).abs() < 0.02, "{flown} m, {way} m");
        // The end's own 50 g meet 500 g.
        let load = speed[thrown] - fall * flight_s;
        let together = (0.5 * load + 0.05 * speed[caught]) / 0.55;
        let after = speed[caught + 1];
        assert!((after / together - 1.0).abs() < 0.08, "{after} m/s, {together} m/s");
    }
}

/// A mass without a restoring force does not come back: the muscle works without it.
#[test]
fn a_load_of_no_force_may_fly_away() {
    let mut scenario = muscle(PlantModel::Full);
    scenario.load.force_n = 0.0;
    let mut plant = built(&scenario);
    for _ in 0..3 {
        let filled = hold(&mut *plant, FILLING, 1000);
        assert!((0.19..0.22).contains(&filled.length_m), "{} m", filled.length_m);
        let vented = hold(&mut *plant, VENTING, 3000);
        assert!((0.25..=0.3).contains(&vented.length_m), "{} m", vented.length_m);
    }
}

/// Width of the loop of force over length \[N\]: the same length takes more pressure on the way in than
/// on the way out.
fn loop_width_n(scenario: &Scenario) -> f64 {
    let mut plant = built(scenario);
    let crossing = |plant: &mut dyn Plant, actuation: Actuation, contracting: bool| loop {
        let truth = hold(plant, actuation, 1);
        if (truth.length_m < 0.27) == contracting {
            return truth.pressure_pa;
        }
    };
    let slow = Actuation { inlet: 0.1, outlet: 0.0 };
    let up = crossing(&mut *plant, slow, true);
    hold(&mut *plant, slow, 500);
    let down = crossing(&mut *plant, Actuation { inlet: 0.0, outlet: 0.1 }, false);
    (up - down) * Geometry::from_braid(0.3, 0.02, 23.0, 0.0).force_area(0.27)
}

#[test]
fn friction_slip_and_creep_make_a_loop_of_pressure_over_length() {
    let nominal = muscle(PlantModel::Full);
    let mut slipping = nominal.clone();
    (slipping.muscle.creep_fast_n_m, slipping.muscle.creep_slow_n_m) = (0.0, 0.0);
    let [dry, with_slip, all] =
        [elastic(nominal.clone()), slipping, nominal].map(|scenario| loop_width_n(&scenario));
    assert!((30.0..42.0).contains(&dry), "{dry} N");
    // Twice 6.5 N.
    assert!((12.0..14.0).contains(&(with_slip - dry)), "{with_slip} N, {dry} N");
    // Creep holds back up to 4 N per millimetre.
    assert!((20.0..45.0).contains(&(all - with_slip)), "{all} N, {with_slip} N");
}

/// All work of the gas on the muscle's end is in the load, in the bladder, in motion, in slip and creep, or in heat.
#[test]
fn the_books_of_work_close() {
    let mut scenario = muscle(PlantModel::Full);
    scenario.load.kind = LoadKind::Mass;
    scenario.load.mass_kg = 8.0;
    scenario.muscle.slip_pressure_factor = 0.7;
    // The ledger lacks the energy that the bristles store.
    (scenario.friction.force_n, scenario.friction.stribeck_force_n) = (0.0, 0.0);
    let mut plant = built(&scenario);
    let start = plant.truth();
    for cycle in 0..6 {
        hold(&mut *plant, Actuation { inlet: 0.3, outlet: 0.0 }, 300 + 40 * cycle);
        hold(&mut *plant, Actuation { inlet: 0.0, outlet: 0.4 }, 300);
    }
    hold(&mut *plant, Actuation { inlet: 0.5, outlet: 0.0 }, 300);
    let (truth, ledger) = (plant.truth(), plant.ledger());
    let bladder_j = |length: f64| 0.5 * 600.0 * (0.3 - length).powi(2);
    let lifted_j = 8.0 * 9.80665 * (start.length_m - truth.length_m);
    let moving_j = 0.5 * 8.0 * truth.speed_m_s.powi(2);
    let pushed_j = 101_325.0 * (truth.volume_m3 - start.volume_m3);
    let residual_j = ledger.work_j
        - pushed_j
        - lifted_j
        - moving_j
        - (bladder_j(truth.length_m) - bladder_j(start.length_m))
        - ledger.hysteresis_energy_j
        - ledger.friction_heat_j;
    let handled_j = ledger.energy_initial_j + ledger.enthalpy_in_j + ledger.enthalpy_out_j;
    println!("{residual_j:.2e} J of {handled_j:.0} J; {ledger:?}");
    assert!(residual_j.abs() < 1e-6 * handled_j, "{residual_j} J");
    assert!(ledger.hysteresis_energy_j > 0.1 && ledger.friction_heat_j > 4.0, "{ledger:?}");
    assert!(ledger.energy_balance_error() < 1e-6 && ledger.wall_balance_error() < 1e-6);
}

#[test]
fn droop_and_dead_time_slow_the_filling() {
    let mut scenario = muscle(PlantModel::Full);
    scenario.load.kind = LoadKind::Isometric;
    let pressure = |scenario: &Scenario| hold(&mut *built(scenario), FILLING, 50).pressure_pa;
    let nominal = pressure(&scenario);
    scenario.supply.droop_pa_s_kg = 0.0;
    let stiff = pressure(&scenario);
    scenario.valve.dead_time_s = 0.005;
    let late = pressure(&scenario);
    assert!(stiff > 1.01 * nominal && stiff < 1.3 * nominal, "{stiff} and {nominal} Pa");
    assert!(late < 0.98 * stiff && late > 0.8 * stiff, "{late} and {stiff} Pa");
}
