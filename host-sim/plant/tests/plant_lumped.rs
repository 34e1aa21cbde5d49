//! The lumped muscle: the working cycle, conservation, order, an independent solver.

use crate::plant_full::elastic;
use crate::plant_runs::{
    FILLING, VENTING, assert_conserves, bare_sensor_rms_k, built, extremes, hold, working_cycle,
};
use crate::plant_support::{MassFlow, muscle};
use ode_solvers::{Dop853, SVector, System};
use thermyo_plant::chamber::braid::Geometry;
use thermyo_plant::flow::Iso6358;
use thermyo_plant::gas::IdealGas;
use thermyo_plant::{Actuation, Truth};
use thermyo_scenario::{HeatModel, LoadKind, PlantModel, Scenario};

#[test]
fn the_working_cycle() {
    let (plant, truths) = working_cycle(PlantModel::Lumped);
    let pressure = extremes(&truths, |truth| truth.pressure_pa);
    let length = extremes(&truths, |truth| truth.length_m);
    let gas = extremes(&truths, |truth| truth.gas_temperature_k);
    let rms = bare_sensor_rms_k(&truths);
    let contraction = 1.0 - length.0 / 0.3;
    println!("pressure {pressure:?} Pa, contraction {contraction:.3}, gas {gas:?} K");
    println!("bare sensor {rms:.2} K RMS, wall {:.2} K", plant.truth().wall_temperature_k);
    assert!((1.0e5..1.3e5).contains(&pressure.0) && (3.5e5..4.7e5).contains(&pressure.1));
    assert!((0.25..0.31).contains(&contraction));
    assert!((8.0..13.0).contains(&rms));
}

#[test]
fn mass_and_energy_are_conserved_over_100_s() {
    for model in [PlantModel::Lumped, PlantModel::Paper] {
        assert_conserves(model, 0.01);
    }
}

/// A contraction from the stop, sliding all the time, with no valve near equal pressures.
fn smooth() -> Scenario {
    let mut scenario = elastic(muscle(PlantModel::Lumped));
    scenario.heat.model = HeatModel::Constant;
    scenario.friction.force_n = 0.0;
    scenario.load.force_n = 60.0;
    scenario.plant.initial_pressure_pa = 150_000.0;
    scenario
}

const OPEN: Actuation = Actuation { inlet: 0.08, outlet: 0.02 };

fn run(scenario: &Scenario, until: f64) -> Truth {
    hold(&mut *built(scenario), OPEN, (until / scenario.run.step_s).round() as usize)
}

/// The same muscle, derived separately: states m, U, T_w and the ways u of the creep's dashpots; the length by
/// bisection of the forces. It starts relaxed and only contracts.
struct Independent {
    scenario: Scenario,
    braid: Geometry,
    valve: Iso6358,
    start_m: f64,
}

impl Independent {
    /// P, V, L for an internal energy and the dashpots' ways.
    fn place(&self, energy: f64, ways: [f64; 2]) -> (f64, f64, f64) {
        let k = self.scenario.gas.heat_capacity_ratio;
        let muscle = &self.scenario.muscle;
        let (mut low, mut high) = (self.braid.thread_length_m / 3.0f64.sqrt(), 0.3);
        let state = |length: f64| {
            let v = length * (self.braid.thread_length_m.powi(2) - length * length)
                / (4.0 * std::f64::consts::PI * self.braid.turns.powi(2))
                + self.braid.dead_volume_m3;
            ((k - 1.0) * energy / v, v)
        };
        let h = 1e-3;
        for _ in 0..60 {
            let length = 0.5 * (low + high);
            let (p, _) = state(length);
            // dV/dL of the cubic, exactly.
            let slope = (state(length - 2.0 * h).1 - 8.0 * state(length - h).1
                + 8.0 * state(length + h).1
                - state(length + 2.0 * h).1)
                / (12.0 * h);
            let x = self.start_m - length;
            let held = (muscle.slip_stiffness_n_m * x).min(muscle.slip_force_n)
                + muscle.creep_fast_n_m * (x - ways[0])
                + muscle.creep_slow_n_m * (x - ways[1]);
            let force = -(p - self.scenario.ambient.pressure_pa) * slope
                + muscle.bladder_stiffness_n_m * (length - 0.3)
                - held;
            if force > self.scenario.load.force_n { high = length } else { low = length }
        }
        let length = 0.5 * (low + high);
        let (p, v) = state(length);
        (p, v, length)
    }
}

impl System<f64, SVector<f64, 5>> for Independent {
    fn system(&self, _: f64, y: &SVector<f64, 5>, dy: &mut SVector<f64, 5>) {
        // Eq. (3) with U and L found together: dL/dt from differences of the equilibrium.
        let s = &self.scenario;
        let gas = IdealGas::new(&s.gas);
        let ways = [y[3], y[4]];
        let (p, v, length) = self.place(y[1], ways);
        let t = p * v / (y[0] * gas.r);
        let inflow =
            OPEN.inlet * self.valve.mass_flow(s.supply.pressure_pa, s.supply.temperature_k, p);
        let outflow = OPEN.outlet * self.valve.mass_flow(p, t, s.ambient.pressure_pa);
        let area = std::f64::consts::PI * self.braid.diameter(length) * length;
        let h = s.heat.inner_w_m2_k + s.heat.inner_per_flow * inflow;
        let heat = h * area * (t - y[2]);
        let source = gas.cp * (inflow * s.supply.temperature_k - outflow * t) - heat;
        let stretches = ways.map(|way| self.start_m - length - way);
        let rates = [stretches[0] / s.muscle.creep_fast_s, stretches[1] / s.muscle.creep_slow_s];
        // Change of volume and length at a constant energy, as the dashpots give way.
        let d = 1e-3;
        let moved = |by: f64| self.place(y[1], [ways[0] + by * rates[0], ways[1] + by * rates[1]]);
        let (before, after) = (moved(-d), moved(d));
        let (volume_drift, length_drift) =
            ((after.1 - before.1) / (2.0 * d), (after.2 - before.2) / (2.0 * d));
        let d = 1e-4 * y[1];
        let (up, down) = (self.place(y[1] + d, ways), self.place(y[1] - d, ways));
        // dU = source dt - P dV and dV = V'(U) dU + drift dt.
        let volume_per_energy = (up.1 - down.1) / (2.0 * d);
        let energy_rate = (source - p * volume_drift) / (1.0 + p * volume_per_energy);
        let speed = (up.2 - down.2) / (2.0 * d) * energy_rate + length_drift;
        let outer = s.heat.outer_w_m2_k + s.heat.outer_per_speed * speed.abs();
        let slips = s.muscle.slip_stiffness_n_m * (self.start_m - length) > s.muscle.slip_force_n;
        let lost = s.muscle.creep_fast_n_m * stretches[0] * rates[0]
            + s.muscle.creep_slow_n_m * stretches[1] * rates[1]
            + if slips { -speed * s.muscle.slip_force_n } else { 0.0 };
        dy[0] = inflow - outflow;
        dy[1] = energy_rate;
        dy[2] = (heat + s.friction.heat_fraction * lost
            - outer * area * (y[2] - s.ambient.temperature_k))
            / s.wall.heat_capacity_j_k;
        (dy[3], dy[4]) = (rates[0], rates[1]);
    }
}

/// Largest relative difference of mass, energy and wall temperature after a second.
fn difference(scenario: &Scenario) -> f64 {
    let start = built(scenario).truth();
    let gas = IdealGas::new(&scenario.gas);
    let system = Independent {
        braid: Geometry::new(
            scenario.muscle.thread_length_m,
            scenario.muscle.turns,
            scenario.muscle.dead_volume_m3,
        ),
        valve: Iso6358::valve(
            scenario.valve.conductance_m3_s_pa,
            scenario.valve.critical_ratio,
            &gas,
        ),
        start_m: start.length_m,
        scenario: scenario.clone(),
    };
    let energy = start.pressure_pa * start.volume_m3 / (gas.k - 1.0);
    let initial = SVector::<f64, 5>::new(start.mass_kg, energy, 298.0, 0.0, 0.0);
    let mut solver = Dop853::new(system, 0.0, 1.0, 0.01, initial, 1e-11, 1e-13);
    solver.integrate().unwrap();
    let end = *solver.y_out().last().unwrap();
    let truth = run(scenario, 1.0);
    assert!(truth.length_m < 0.285, "it must have moved: {truth:?}");
    let energy = truth.pressure_pa * truth.volume_m3 / (gas.k - 1.0);
    let pairs = [(truth.mass_kg, end[0]), (energy, end[1]), (truth.wall_temperature_k, end[2])];
    println!("{pairs:?}");
    pairs.into_iter().map(|(ours, theirs)| (ours / theirs - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn agrees_with_an_independent_solver() {
    let error = difference(&smooth());
    assert!(error < 1e-8, "{error:e}");
}

/// Creep is of second order in time: a constant speed over a step. Slip has a kink within one.
#[test]
fn slip_and_creep_agree_with_an_independent_solver() {
    let mut scenario = smooth();
    scenario.muscle = Scenario::default().muscle;
    scenario.friction.softening_per_k = 0.0;
    let error = difference(&scenario);
    assert!(error < 1e-6, "{error:e}");
}

#[test]
fn integration_is_of_fourth_order() {
    let mut scenario = smooth();
    // A fast wall makes errors that exceed the rounding.
    scenario.heat.inner_w_m2_k = 3000.0;
    let mut pressure = |step: f64| {
        scenario.run.step_s = step;
        run(&scenario, 0.064).pressure_pa
    };
    let exact = pressure(0.000_125);
    let (coarse, fine) = ((pressure(0.001) - exact).abs(), (pressure(0.0005) - exact).abs());
    let order = (coarse / fine).log2();
    println!("errors {coarse:.1e}, {fine:.1e} Pa: order {order:.2}");
    assert!((3.5..4.5).contains(&order));
}

#[test]
fn friction_holds_the_length_and_heats_the_wall() {
    let mut scenario = elastic(muscle(PlantModel::Lumped));
    scenario.plant.initial_pressure_pa = 300_000.0;
    let mut plant = built(&scenario);
    let start = plant.truth();
    assert!(start.length_m < 0.29 && (start.friction_n - 15.0).abs() < 1e-6, "{start:?}");
    // Venting: the pull must fall through the whole band of 30 N before the braid slides back.
    let vent = Actuation { inlet: 0.0, outlet: 0.02 };
    while plant.truth().length_m == start.length_m {
        plant.advance(vent).unwrap();
    }
    assert!((-15.1..-14.9).contains(&plant.truth().friction_n), "{:?}", plant.truth());
    let drop = start.pressure_pa - plant.truth().pressure_pa;
    let braid = Geometry::from_braid(0.30, 0.020, 23.0, 0.0);
    assert!((drop * braid.force_area(start.length_m) / 30.0 - 1.0).abs() < 0.02, "{drop} Pa");
    while plant.truth().length_m < 0.3 {
        plant.advance(vent).unwrap();
    }
    let heat = plant.ledger().friction_heat_j;
    assert!((heat / (15.0 * (0.3 - start.length_m)) - 1.0).abs() < 0.02, "{heat} J");
    assert!((plant.ledger().friction_to_wall_j / heat - 0.9).abs() < 1e-9);
}

#[test]
fn flow_reverses_through_an_open_valve() {
    // Muscle above the supply with the inlet open: gas leaves. Below ambient with the outlet open: air enters.
    let mut scenario = muscle(PlantModel::Lumped);
    scenario.load.kind = LoadKind::Isometric;
    scenario.plant.initial_pressure_pa = 600_000.0;
    scenario.supply.pressure_pa = 300_000.0;
    let mut plant = built(&scenario);
    let truth = hold(&mut *plant, FILLING, 5000);
    assert!((truth.pressure_pa / 300_000.0 - 1.0).abs() < 1e-3);
    assert!(plant.ledger().mass_out_kg > 1e-4);
    scenario.plant.initial_pressure_pa = 60_000.0;
    let mut plant = built(&scenario);
    let truth = hold(&mut *plant, VENTING, 5000);
    assert!((truth.pressure_pa / 101_325.0 - 1.0).abs() < 1e-3);
    assert!(plant.ledger().mass_in_kg > 1e-5);
}

#[test]
fn a_wild_scenario_diverges_with_its_state() {
    // Eq. (9) with unequal coefficients does not close a cycle: the temperature runs away.
    let mut scenario = muscle(PlantModel::Paper);
    scenario.paper.alpha_in = 1.4;
    scenario.paper.alpha_out = 1.0;
    let drive = MassFlow::new(&scenario);
    let mut plant = built(&scenario);
    let diverged = (0..100_000).find_map(|_| plant.advance(drive.actuation(&plant.truth())).err());
    let message = diverged.expect("it must diverge").to_string();
    assert!(message.contains("temperature = ") && message.contains(" s: "), "{message}");
}
