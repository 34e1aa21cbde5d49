//! Two muscles on a pulley, in f64: an arm with inertia, gravity, friction, stops and tendons that cannot push.
//!
//! ```text
//! J q'' = r_a T_a - r_b T_b - G sin(q - q_hanging) - viscous q' - dry friction + external torque
//! L_a   = mid_a - integral of r_a,   L_b = mid_b + integral of r_b,   both from 0 to q
//! T     = max(0, pull of the muscle less what holds it back)
//! ```
//!
//! Radii may vary with the angle ([`Pulley`]). Tendons move by exactly the length that is wound up, so that no work is
//! lost.
//!
//! Muscles and arm exchange motion and force in steps far below the period of the arm on its springs. The arm makes a
//! velocity Verlet step, and between its half kicks both muscles move with its speed. A slack tendon passes no force;
//! the muscle then lies along its path, and its push is lost.

use super::{
    Actuation, BuildError, Disturbance, Diverged, DrivenEnd, Ledger, Truth, build_driven_end,
};
use crate::pulley::Pulley;
use thermyo_compute::math;
use thermyo_scenario::Scenario;

/// Upper limit on exchange step times the angular frequency of the arm on all its elastic parts: Verlet's error of the
/// frequency is a 24th of its square.
const STEP_TIMES_SWING: f64 = 0.05;
const MOST_EXCHANGES: f64 = 100.0;
/// Way over which dry friction of the bearing builds up \[rad\]: assumed, much less than the motion of an arm shows.
const PRESLIDING_RAD: f64 = 0.002;

#[derive(Debug, Clone, PartialEq)]
pub struct Arm {
    /// Radii over the angle.
    pub pulley: Pulley,
    /// Lengths of muscles a and b at angle 0 \[m\].
    pub mid_length_m: [f64; 2],
    pub inertia_kg_m2: f64,
    /// Largest torque of gravity \[N m\].
    pub gravity_n_m: f64,
    /// Angle at which the arm hangs \[rad\].
    pub gravity_angle_rad: f64,
    /// Viscous friction of the bearing \[N m s/rad\].
    pub viscous_n_m_s: f64,
    /// Dry friction of the bearing \[N m\].
    pub friction_n_m: f64,
    /// Stops \[rad\].
    pub stops_rad: [f64; 2],
}

impl Arm {
    /// Lengths of muscles a and b \[m\] at an angle \[rad\].
    pub fn lengths_m(&self, angle_rad: f64) -> [f64; 2] {
        let [mid_a, mid_b] = self.mid_length_m;
        let [way_a, way_b] = self.pulley.ways_m(angle_rad);
        [mid_a - way_a, mid_b + way_b]
    }

    /// Torque of two tensions at an angle \[N m\].
    fn tendon_torque_n_m(&self, [a, b]: [f64; 2], angle_rad: f64) -> f64 {
        let [of_a, of_b] = self.pulley.shares(angle_rad);
        self.pulley.radius_m * (of_a * a - of_b * b)
    }

    fn gravity_torque_n_m(&self, angle_rad: f64) -> f64 {
        -self.gravity_n_m * math::sin(angle_rad - self.gravity_angle_rad)
    }

    /// Energy above the hanging arm's \[J\].
    fn potential_j(&self, angle_rad: f64) -> f64 {
        self.gravity_n_m * (1.0 - math::cos(angle_rad - self.gravity_angle_rad))
    }
}

/// The ledger of the mechanism since the start \[J\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ArmLedger {
    /// Energy at the start: kinetic, of gravity, and of the bearing's presliding.
    pub initial_j: f64,
    /// The same energy now.
    pub energy_j: f64,
    /// Work of the tendons of muscles a and b on the arm.
    pub tendon_work_j: [f64; 2],
    /// Work with which muscles pushed along slack tendons, and which the arm did not receive.
    pub slack_work_j: [f64; 2],
    pub external_work_j: f64,
    /// Heat of viscous and dry friction of the bearing.
    pub friction_heat_j: f64,
    pub stop_heat_j: f64,
    /// Sum of the sizes of all energies that the arm took and gave.
    pub handled_j: f64,
}

impl ArmLedger {
    /// Error of the balance, relative to the energy handled.
    pub fn balance_error(&self) -> f64 {
        let [a, b] = self.tendon_work_j;
        let residual = self.energy_j - self.initial_j - a - b - self.external_work_j
            + self.friction_heat_j
            + self.stop_heat_j;
        residual.abs() / self.handled_j.max(1e-9)
    }
}

/// The joint as an observer with perfect instruments would see it, SI.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointTruth {
    pub angle_rad: f64,
    pub speed_rad_s: f64,
    /// Torque of both tendons on the pulley \[N m\].
    pub torque_n_m: f64,
    /// Tensions of tendons a and b \[N\].
    pub tension_n: [f64; 2],
    pub muscles: [Truth; 2],
}

/// A joint in operation.
pub struct Joint {
    arm: Arm,
    muscles: [Box<dyn DrivenEnd>; 2],
    start_rad: f64,
    exchanges: u32,
    exchange_s: f64,
    angle_rad: f64,
    speed_rad_s: f64,
    /// Dry friction of the bearing \[N m\].
    dry_n_m: f64,
    external_n_m: f64,
    /// A torn tendon passes no force.
    torn: [bool; 2],
    /// Pulls of the muscles now \[N\].
    pull_n: [f64; 2],
    ledger: ArmLedger,
}

impl Joint {
    /// Two muscles at rest on an arm at this angle \[rad\]. Load, start length and step of the scenarios are replaced
    /// by the joint's.
    pub fn new(arm: Arm, scenarios: [&Scenario; 2], angle_rad: f64) -> Result<Self, BuildError> {
        let (exchanges, exchange_s) = exchange(&arm, scenarios)?;
        let [a, b] = own(&arm, scenarios, angle_rad, exchange_s);
        let build = |own: &Scenario| {
            let mut muscle = build_driven_end(own)?;
            muscle.drive_end(0.0);
            Ok(muscle)
        };
        let muscles = [build(&a)?, build(&b)?];
        let pull_n = [muscles[0].tension_n(), muscles[1].tension_n()];
        let initial_j = arm.potential_j(angle_rad);
        Ok(Self {
            arm,
            muscles,
            start_rad: angle_rad,
            exchanges,
            exchange_s,
            angle_rad,
            speed_rad_s: 0.0,
            dry_n_m: 0.0,
            external_n_m: 0.0,
            torn: [false; 2],
            pull_n,
            ledger: ArmLedger { initial_j, energy_j: initial_j, ..ArmLedger::default() },
        })
    }

    /// Takes over inertia, gravity and friction of the arm, and the muscles' numbers as [`super::Plant::retune`] does,
    /// from the next step on; states are kept. All other keys must equal those with which the joint was built.
    ///
    /// # Errors
    /// As [`Self::new`]; on an error nothing has changed.
    pub fn retune(&mut self, arm: Arm, scenarios: [&Scenario; 2]) -> Result<(), BuildError> {
        let (exchanges, exchange_s) = exchange(&arm, scenarios)?;
        let own = own(&arm, scenarios, self.start_rad, exchange_s);
        // A muscle that is refused leaves the other one as it was.
        for scenario in &own {
            build_driven_end(scenario)?;
        }
        for (muscle, scenario) in self.muscles.iter_mut().zip(&own) {
            muscle.retune(scenario)?;
        }
        (self.arm, self.exchanges, self.exchange_s) = (arm, exchanges, exchange_s);
        // The ledger refers to the arm as it is now.
        let energy_j = self.energy_j();
        self.ledger.initial_j += energy_j - self.ledger.energy_j;
        self.ledger.energy_j = energy_j;
        Ok(())
    }

    /// Sets the external torque from the next step on, positive towards growing angles \[N m\].
    pub fn load(&mut self, external_n_m: f64) {
        self.external_n_m = external_n_m;
    }

    /// Tears a tendon from the next step on, or mends it.
    pub fn tear(&mut self, torn: [bool; 2]) {
        self.torn = torn;
    }

    /// Sets the faults of muscles a and b from the next step on.
    pub fn disturb(&mut self, disturbances: [Disturbance; 2]) {
        for (muscle, disturbance) in self.muscles.iter_mut().zip(disturbances) {
            muscle.disturb(disturbance);
        }
    }

    /// Advances by one step of the scenario, with the openings of muscles a and b.
    pub fn advance(&mut self, actuation: [Actuation; 2]) -> Result<(), Diverged> {
        for _ in 0..self.exchanges {
            self.exchange(actuation)?;
        }
        Ok(())
    }

    pub fn truth(&self) -> JointTruth {
        let tension_n = self.tensions_n();
        JointTruth {
            angle_rad: self.angle_rad,
            speed_rad_s: self.speed_rad_s,
            torque_n_m: self.arm.tendon_torque_n_m(tension_n, self.angle_rad),
            tension_n,
            muscles: [self.muscles[0].truth(), self.muscles[1].truth()],
        }
    }

    pub fn arm(&self) -> &Arm {
        &self.arm
    }

    pub fn arm_ledger(&self) -> ArmLedger {
        self.ledger
    }

    pub fn ledgers(&self) -> [Ledger; 2] {
        [self.muscles[0].ledger(), self.muscles[1].ledger()]
    }

    fn tensions_n(&self) -> [f64; 2] {
        let tension = |i: usize| if self.torn[i] { 0.0 } else { self.pull_n[i].max(0.0) };
        [tension(0), tension(1)]
    }

    /// Torque of everything but viscous friction \[N m\].
    fn torque_n_m(&self) -> f64 {
        self.arm.tendon_torque_n_m(self.tensions_n(), self.angle_rad)
            + self.arm.gravity_torque_n_m(self.angle_rad)
            - self.dry_n_m
            + self.external_n_m
    }

    fn exchange(&mut self, actuation: [Actuation; 2]) -> Result<(), Diverged> {
        let Arm { inertia_kg_m2, viscous_n_m_s, friction_n_m, stops_rad, .. } = self.arm;
        let half = 0.5 * self.exchange_s / inertia_kg_m2;
        let before_n = self.tensions_n();
        let pull_before_n = self.pull_n;
        let kicked = self.speed_rad_s + half * self.torque_n_m();
        let mut speed = kicked / (1.0 + half * viscous_n_m_s);
        let [lower, upper] = stops_rad;
        let next = self.angle_rad + speed * self.exchange_s;
        let stopped = next.clamp(lower, upper);
        let hits = stopped != next;
        if hits {
            speed = (stopped - self.angle_rad) / self.exchange_s;
        }
        let Pulley { radius_m, .. } = self.arm.pulley;
        let means = self.arm.pulley.mean_shares(self.angle_rad, stopped);
        let rates = [-radius_m * speed * means[0], radius_m * speed * means[1]];
        for ((muscle, rate), actuation) in self.muscles.iter_mut().zip(rates).zip(actuation) {
            muscle.drive_end(rate);
            muscle.advance(actuation)?;
        }
        let way = stopped - self.angle_rad;
        self.angle_rad = stopped;
        let stiffness = friction_n_m / PRESLIDING_RAD;
        let dry_before = self.dry_n_m;
        self.dry_n_m = (dry_before + stiffness * way).clamp(-friction_n_m, friction_n_m);
        self.pull_n = [self.muscles[0].tension_n(), self.muscles[1].tension_n()];
        let torque = self.torque_n_m();
        self.speed_rad_s = speed * (1.0 - half * viscous_n_m_s) + half * torque;
        if hits {
            // The arm stays where it is pressed against the stop, and loses all its speed.
            self.speed_rad_s = 0.0;
        }
        let ways = means.map(|share| share * radius_m * way);
        self.enter((way, ways), speed, [before_n, pull_before_n], dry_before, hits);
        Ok(())
    }

    /// Energy of the arm \[J\]: kinetic, of gravity, and of the bearing's presliding.
    fn energy_j(&self) -> f64 {
        let Arm { inertia_kg_m2, friction_n_m, .. } = self.arm;
        let stiffness = friction_n_m / PRESLIDING_RAD;
        let dry = self.dry_n_m;
        let stored = if stiffness > 0.0 { 0.5 * dry * dry / stiffness } else { 0.0 };
        let kinetic = 0.5 * inertia_kg_m2 * self.speed_rad_s * self.speed_rad_s;
        kinetic + self.arm.potential_j(self.angle_rad) + stored
    }

    /// Enters one exchange into the ledger: the way of the arm \[rad\], and the ways of both tendons \[m\].
    fn enter(
        &mut self,
        (way, ways_m): (f64, [f64; 2]),
        speed: f64,
        before: [[f64; 2]; 2],
        dry_before: f64,
        hits: bool,
    ) {
        let after_n = self.tensions_n();
        let [before_n, pull_before_n] = before;
        let energy = self.energy_j();
        let ledger = &mut self.ledger;
        let mut gained = self.external_n_m * way;
        ledger.external_work_j += gained;
        ledger.handled_j += gained.abs();
        for (i, sign) in [(0, 1.0), (1, -1.0)] {
            let mean = |from: [f64; 2], to: [f64; 2]| 0.5 * (from[i] + to[i]) * sign * ways_m[i];
            let work = mean(before_n, after_n);
            ledger.tendon_work_j[i] += work;
            ledger.slack_work_j[i] += mean(pull_before_n, self.pull_n) - work;
            ledger.handled_j += work.abs();
            gained += work;
        }
        let viscous = self.arm.viscous_n_m_s * speed * way;
        let stiffness = self.arm.friction_n_m / PRESLIDING_RAD;
        // Over the part of the way that slides, the friction is at its limit.
        let slid =
            if stiffness > 0.0 { way - (self.dry_n_m - dry_before) / stiffness } else { 0.0 };
        let heat = viscous + self.dry_n_m * slid;
        ledger.friction_heat_j += heat;
        if hits {
            ledger.stop_heat_j += ledger.energy_j + gained - heat - energy;
        }
        ledger.energy_j = energy;
    }
}

/// Exchanges between arm and muscles in a step of the scenarios, and the time of each \[s\].
fn exchange(arm: &Arm, scenarios: [&Scenario; 2]) -> Result<(u32, f64), BuildError> {
    let step_s = scenarios[0].run.step_s;
    let [radii_m, slopes_m_rad] = arm.pulley.largest(arm.stops_rad);
    let of_muscle = |i: usize| {
        let (spring_n_m, force_n) = stiffest(scenarios[i]);
        spring_n_m * radii_m[i] * radii_m[i] + force_n * slopes_m_rad[i]
    };
    let swing = of_muscle(0) + of_muscle(1);
    let bearing = arm.friction_n_m / PRESLIDING_RAD;
    let gravity = arm.gravity_n_m;
    let spring_n_m_rad = swing + bearing + gravity;
    let fastest = (spring_n_m_rad / arm.inertia_kg_m2).sqrt();
    let exchanges = (step_s * fastest / STEP_TIMES_SWING).ceil().max(1.0);
    if exchanges > MOST_EXCHANGES {
        let most = MOST_EXCHANGES * STEP_TIMES_SWING / step_s;
        // Printed with two digits, rounded up.
        let least_kg_m2 = 1.05 * spring_n_m_rad / (most * most);
        return Err(BuildError::TooLight { least_kg_m2 });
    }
    Ok((exchanges as u32, step_s / exchanges))
}

/// The scenarios as the muscles of a joint at this angle \[rad\]: their ends are held, and exchange with the arm.
fn own(arm: &Arm, scenarios: [&Scenario; 2], angle_rad: f64, exchange_s: f64) -> [Scenario; 2] {
    let lengths_m = arm.lengths_m(angle_rad);
    [0, 1].map(|i: usize| {
        let mut own = scenarios[i].clone();
        own.load.kind = thermyo_scenario::LoadKind::Isometric;
        own.load.length_m = lengths_m[i];
        // The board counts its own steps, not the exchanges.
        own.valve.pwm_hz = 1.0 / own.pwm_period_s();
        own.run.step_s = exchange_s;
        own
    })
}

/// Largest stiffness of a scenario's muscle \[N/m\]: friction before it slides, slip, creep, and the gas at the
/// supply's pressure in the volume at rest; and the force of that pressure there \[N\].
fn stiffest(scenario: &Scenario) -> (f64, f64) {
    let Scenario { muscle, friction, supply, gas, .. } = scenario;
    let hysteresis = muscle.slip_stiffness_n_m + muscle.creep_fast_n_m + muscle.creep_slow_n_m;
    let presliding = if friction.force_n > 0.0 { friction.presliding_stiffness_n_m } else { 0.0 };
    let held = presliding + hysteresis + muscle.bladder_stiffness_n_m;
    let Some(chamber) = super::chamber::of(scenario) else { return (held, 0.0) };
    let rest = chamber.rest_length();
    let area = chamber.force_area(rest);
    let spring = gas.heat_capacity_ratio * supply.pressure_pa * area * area / chamber.volume(rest);
    let gas = spring + supply.pressure_pa * chamber.force_area_slope(rest).abs();
    (held + gas, supply.pressure_pa * area.abs())
}
