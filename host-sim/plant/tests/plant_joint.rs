//! The joint of two muscles: small oscillations in closed form, large ones against an independent solver, and the
//! balance of energy over gas, muscles and arm.

use ode_solvers::{Dop853, SVector, System};
use std::f64::consts::TAU;
use std::sync::Arc;
use thermyo_plant::Actuation;
use thermyo_plant::joint::{Arm, Joint};
use thermyo_plant::pulley::Pulley;
use thermyo_scenario::{HeatModel, PlantModel, Scenario};

const RADIUS_M: f64 = 0.02;
const ARM: Arm = Arm {
    pulley: Pulley::constant(RADIUS_M),
    mid_length_m: [0.27, 0.27],
    inertia_kg_m2: 0.02,
    gravity_n_m: 0.0,
    gravity_angle_rad: 0.0,
    viscous_n_m_s: 0.0,
    friction_n_m: 0.0,
    stops_rad: [-0.8, 0.8],
};
const SHUT: [Actuation; 2] = [Actuation { inlet: 0.0, outlet: 0.0 }; 2];

/// A table whose radii vary by this share per angle; muscle b's the other way.
fn varying(per_rad: f64) -> Pulley {
    let row = |angle: f64| {
        [angle, RADIUS_M * (1.0 + per_rad * angle), RADIUS_M * (1.0 - per_rad * angle)]
    };
    Pulley::rows(RADIUS_M, Arc::from([row(-1.0), row(1.0)]))
}

/// A muscle at 2.9 bar without any loss.
fn lossless(model: PlantModel) -> Scenario {
    let mut scenario = Scenario::default();
    scenario.plant.model = model;
    scenario.plant.initial_pressure_pa = 2.9e5;
    scenario.heat.model = HeatModel::Adiabatic;
    scenario.friction.force_n = 0.0;
    scenario.friction.stribeck_force_n = 0.0;
    scenario.friction.viscous_n_s_m = 0.0;
    scenario.friction.presliding_stiffness_n_m = 0.0;
    scenario.muscle.slip_force_n = 0.0;
    scenario.muscle.slip_stiffness_n_m = 0.0;
    scenario.muscle.creep_fast_n_m = 0.0;
    scenario.muscle.creep_slow_n_m = 0.0;
    scenario
}

/// Gas volume \[m3\] and its slope, with the volumes connected to it: the paper's equations (10) and (11).
fn volume(scenario: &Scenario, dead_m3: f64, length: f64) -> (f64, f64) {
    let (b, n) = (scenario.muscle.thread_length_m, scenario.muscle.turns);
    let c = 1.0 / (2.0 * TAU * n * n);
    (c * length * (b * b - length * length) + dead_m3, c * (b * b - 3.0 * length * length))
}

/// Pull of an adiabatic muscle that was filled to 2.9 bar at 0.27 m \[N\].
fn pull(scenario: &Scenario, dead_m3: f64, length: f64) -> f64 {
    let (start, _) = volume(scenario, dead_m3, 0.27);
    let (now, slope) = volume(scenario, dead_m3, length);
    let gauge = 2.9e5 * (start / now).powf(1.4) - 101_325.0;
    -gauge * slope - scenario.muscle.bladder_stiffness_n_m * (0.3 - length)
}

/// Times at which the arm passes its middle upwards \[s\], and the largest angle.
fn swing(joint: &mut Joint, steps: u32) -> (Vec<f64>, f64) {
    let (mut passes, mut most) = (Vec::new(), 0.0_f64);
    let mut before = joint.truth().angle_rad;
    for step in 0..steps {
        joint.advance(SHUT).unwrap();
        let now = joint.truth().angle_rad;
        if before < 0.0 && now >= 0.0 {
            passes.push(1e-3 * (f64::from(step) + before / (before - now)));
        }
        most = most.max(now.abs());
        before = now;
    }
    (passes, most)
}

/// T = 2 pi sqrt(J/K), K = r^2 sum(k P A^2/V + P_g dA/dL + k_b) - r_a' F_a + r_b' F_b: of either plant, the full one with
/// the gas of its tube.
#[test]
fn a_small_oscillation_has_the_period_of_the_gas_spring() {
    for (model, per_rad) in [PlantModel::Lumped, PlantModel::Full]
        .into_iter()
        .flat_map(|model| [0.0, 0.3, -0.3].map(|per_rad| (model, per_rad)))
    {
        let scenario = lossless(model);
        let full = model == PlantModel::Full;
        let tube_m3 = if full { scenario.tube.volume_m3 } else { 0.0 };
        let dead_m3 = scenario.muscle.dead_volume_m3 + tube_m3;
        let slope = |way: f64| pull(&scenario, dead_m3, 0.27 + way);
        let spring = (slope(1e-5) - slope(-1e-5)) / 2e-5;
        let turns = per_rad * RADIUS_M * slope(0.0);
        let stiffness = 2.0 * (RADIUS_M * RADIUS_M * spring - turns);
        assert!((8.0..20.0).contains(&stiffness), "{stiffness} N m/rad");
        let pulley = if per_rad == 0.0 { ARM.pulley } else { varying(per_rad) };
        let mut joint = Joint::new(Arm { pulley, ..ARM }, [&scenario; 2], 0.0).unwrap();
        joint.load(0.1);
        for _ in 0..50 {
            joint.advance(SHUT).unwrap();
        }
        joint.load(0.0);
        let (passes, _) = swing(&mut joint, 3000);
        let count = passes.len() - 1;
        let period = (passes[count] - passes[0]) / count as f64;
        let expected = TAU * (ARM.inertia_kg_m2 / stiffness).sqrt();
        let bound = if full { 3e-3 } else { 2e-4 };
        assert!(
            (period / expected - 1.0).abs() < bound,
            "{model:?}, {per_rad}: {period} s for {expected} s"
        );
    }
}

struct Swinging {
    scenario: Scenario,
    arm: Arm,
    /// How the radii vary.
    per_rad: f64,
}

impl System<f64, SVector<f64, 2>> for Swinging {
    fn system(&self, _: f64, y: &SVector<f64, 2>, dy: &mut SVector<f64, 2>) {
        let Self { scenario, arm, per_rad } = self;
        let dead_m3 = scenario.muscle.dead_volume_m3;
        let way = |per_rad: f64| RADIUS_M * (y[0] + 0.5 * per_rad * y[0] * y[0]);
        let lengths = [0.27 - way(*per_rad), 0.27 + way(-per_rad)];
        let pulls = lengths.map(|length| pull(scenario, dead_m3, length).max(0.0));
        let gravity = -arm.gravity_n_m * (y[0] - arm.gravity_angle_rad).sin();
        let radius = |per_rad: f64| RADIUS_M * (1.0 + per_rad * y[0]);
        let torque = radius(*per_rad) * pulls[0] - radius(-per_rad) * pulls[1] + gravity
            - arm.viscous_n_m_s * y[1];
        dy[0] = y[1];
        dy[1] = torque / arm.inertia_kg_m2;
    }
}

/// 40 deg on gas springs, with gravity and damping, against the eighth-order method of Dormand and Prince; on a
/// constant radius and on a table of radii.
#[test]
fn a_large_motion_is_that_of_an_independent_solver() {
    follows_the_solver(ARM.pulley, 0.0);
    follows_the_solver(varying(-0.2), -0.2);
}

fn follows_the_solver(pulley: Pulley, per_rad: f64) {
    let arm = Arm { pulley, gravity_n_m: 4.9, gravity_angle_rad: 0.3, viscous_n_m_s: 0.05, ..ARM };
    let scenario = lossless(PlantModel::Lumped);
    let mut joint = Joint::new(arm.clone(), [&scenario; 2], 0.0).unwrap();
    let system = Swinging { scenario, arm, per_rad };
    // The plant starts at rest at 0; the solver follows it from a thrown state.
    joint.load(8.0);
    for _ in 0..60 {
        joint.advance(SHUT).unwrap();
    }
    joint.load(0.0);
    let start = joint.truth();
    let y0 = SVector::<f64, 2>::new(start.angle_rad, start.speed_rad_s);
    let mut solver = Dop853::new(system, 0.0, 1.0, 0.01, y0, 1e-10, 1e-10);
    solver.integrate().unwrap();
    let mut expected = solver.x_out().iter().zip(solver.y_out());
    let (mut worst, mut most) = (0.0_f64, 0.0_f64);
    expected.next();
    for (time_s, y) in expected.take(100) {
        while joint.truth().muscles[0].time_s - start.muscles[0].time_s < time_s - 1e-6 {
            joint.advance(SHUT).unwrap();
        }
        worst = worst.max((joint.truth().angle_rad - y[0]).abs());
        most = most.max(y[0].abs());
    }
    assert!(most > 0.5, "{most} rad");
    assert!((1e-8..2e-3 * most).contains(&worst), "{worst} rad of {most}");
}

/// The work of the gas, less the work against ambient, equals what muscles lose, store and pull with; and the arm's
/// balance closes.
#[test]
fn energy_closes_over_gas_muscles_and_arm() {
    // The slope changes within the way.
    let kinked =
        [[-0.6, 0.016, 0.024], [-0.1, 0.021, 0.021], [0.2, 0.019, 0.022], [0.6, 0.024, 0.016]];
    let kinked = Pulley::rows(RADIUS_M, Arc::from(kinked));
    for (model, pulley) in [PlantModel::Lumped, PlantModel::Full]
        .into_iter()
        .flat_map(|model| [ARM.pulley, kinked.clone()].map(|pulley| (model, pulley)))
    {
        let mut scenario = Scenario::default();
        scenario.plant.model = model;
        scenario.plant.initial_pressure_pa = 2.5e5;
        // A muscle's ledger lacks the energy of presliding.
        scenario.friction.force_n = 0.0;
        scenario.friction.stribeck_force_n = 0.0;
        scenario.friction.presliding_stiffness_n_m = 0.0;
        let arm = Arm {
            pulley,
            gravity_n_m: 4.9,
            viscous_n_m_s: 0.05,
            friction_n_m: 0.2,
            stops_rad: [-0.5, 0.5],
            ..ARM
        };
        let mut joint = Joint::new(arm, [&scenario; 2], 0.1).unwrap();
        let start = joint.truth();
        for step in 0..4000 {
            let fills = (step / 400) % 2 == 0;
            let pulse = |open: bool| Actuation {
                inlet: if open { 0.3 } else { 0.0 },
                outlet: if open { 0.0 } else { 0.3 },
            };
            joint.load(if step > 2000 { 6.0 } else { 0.0 });
            joint.advance([pulse(fills), pulse(!fills)]).unwrap();
        }
        let (now, ledger) = (joint.truth(), joint.arm_ledger());
        assert!(ledger.balance_error() < 2e-3, "{model:?}: {ledger:?}");
        assert!(ledger.friction_heat_j > 0.1 && ledger.stop_heat_j > 0.01, "{ledger:?}");
        for (i, muscle) in joint.ledgers().iter().enumerate() {
            let [from, to] = [start.muscles[i], now.muscles[i]];
            let elastic = |length: f64| 0.5 * 600.0 * (0.3 - length) * (0.3 - length);
            let pushed = muscle.work_j - 101_325.0 * (to.volume_m3 - from.volume_m3);
            let pulled = ledger.tendon_work_j[i] + ledger.slack_work_j[i];
            let stored = muscle.hysteresis_energy_j + elastic(to.length_m) - elastic(from.length_m);
            let residual = pushed - pulled - stored - muscle.friction_heat_j;
            let handled = ledger.handled_j;
            assert!(residual.abs() < 2e-3 * handled, "{model:?} {i}: {residual} J of {handled} J");
            assert!(muscle.energy_balance_error() < 1e-6 && muscle.mass_balance_error() < 1e-9);
        }
    }
}

/// Without pressure in b its tendon is slack: it neither pulls nor pushes; nor does a torn one.
#[test]
fn a_tendon_does_not_push() {
    let filled = lossless(PlantModel::Full);
    let mut empty = filled.clone();
    empty.plant.initial_pressure_pa = 101_325.0;
    let mut joint = Joint::new(ARM, [&filled, &empty], 0.0).unwrap();
    assert_eq!(joint.truth().tension_n[1], 0.0);
    assert!(joint.truth().torque_n_m > 7.0);
    joint.tear([true, false]);
    assert_eq!(joint.truth().tension_n, [0.0; 2]);
    joint.tear([false; 2]);
    for _ in 0..300 {
        joint.advance(SHUT).unwrap();
    }
    let truth = joint.truth();
    assert!((0.3..=0.8).contains(&truth.angle_rad), "{truth:?}");
    assert!(joint.arm_ledger().slack_work_j[1].abs() > 0.01);
}

#[test]
fn an_arm_that_is_too_light_is_refused() {
    let scenario = Scenario::default();
    let arm = Arm { inertia_kg_m2: 1e-7, ..ARM };
    let error = Joint::new(arm, [&scenario; 2], 0.0).err().unwrap();
    assert!(error.to_string().starts_with("joint.inertia_kg_m2: must be at least "), "{error}");
}
