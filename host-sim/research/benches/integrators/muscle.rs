//! Equations of the lumped muscle, from docs/background/model.md, for solvers that choose their own
//! steps: mass and energy of the gas, temperature of the wall, and the length where pull, load and
//! friction balance.

use crate::Sample;
use ode_solvers::{SVector, System};
use serde::Serialize;
use std::cell::Cell;
use std::f64::consts::PI;
use thermyo_scenario::Scenario;

/// Mass \[kg\] and internal energy \[J\] of the gas, temperature of the wall \[K\].
pub type State = SVector<f64, 3>;

/// Parameters of the equations, SI; in JSON for solvers in other languages.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Muscle {
    r: f64,
    k: f64,
    supply_pa: f64,
    supply_k: f64,
    ambient_pa: f64,
    ambient_k: f64,
    conductance: f64,
    critical_ratio: f64,
    thread_m: f64,
    turns: f64,
    rest_m: f64,
    dead_m3: f64,
    bladder_n_m: f64,
    load_n: f64,
    friction_n: f64,
    friction_to_wall: f64,
    /// h_0 to h_3 of docs/background/model.md.
    heat: [f64; 4],
    wall_j_k: f64,
    start_pa: f64,
    start_k: f64,
}

impl Muscle {
    pub fn of(scenario: &Scenario) -> Self {
        let Scenario { gas, supply, ambient, valve, muscle, heat, friction, .. } = scenario;
        Self {
            r: gas.gas_constant_j_kg_k,
            k: gas.heat_capacity_ratio,
            supply_pa: supply.pressure_pa,
            supply_k: supply.temperature_k,
            ambient_pa: ambient.pressure_pa,
            ambient_k: ambient.temperature_k,
            conductance: valve.conductance_m3_s_pa,
            critical_ratio: valve.critical_ratio,
            thread_m: muscle.thread_length_m,
            turns: muscle.turns,
            rest_m: muscle.rest_length_m,
            dead_m3: muscle.dead_volume_m3,
            bladder_n_m: muscle.bladder_stiffness_n_m,
            load_n: scenario.load.force_n,
            friction_n: friction.force_n,
            friction_to_wall: friction.heat_fraction,
            heat: [heat.inner_w_m2_k, heat.inner_per_flow, heat.outer_w_m2_k, heat.outer_per_speed],
            wall_j_k: scenario.wall.heat_capacity_j_k,
            start_pa: scenario.plant.initial_pressure_pa,
            start_k: scenario.plant.initial_temperature_k,
        }
    }

    /// State at the start, with the given length \[m\].
    pub fn start(&self, length: f64) -> State {
        let energy = self.start_pa * self.volume(length) / (self.k - 1.0);
        State::new(energy * (self.k - 1.0) / (self.r * self.start_k), energy, self.start_k)
    }

    /// Eq. (10).
    fn volume(&self, length: f64) -> f64 {
        length * (self.thread_m.powi(2) - length.powi(2)) / (4.0 * PI * self.turns.powi(2))
            + self.dead_m3
    }

    /// -dV/dL, eq. (11).
    fn area(&self, length: f64) -> f64 {
        (3.0 * length.powi(2) - self.thread_m.powi(2)) / (4.0 * PI * self.turns.powi(2))
    }

    fn pressure(&self, energy: f64, length: f64) -> f64 {
        (self.k - 1.0) * energy / self.volume(length)
    }

    fn temperature(&self, y: &State) -> f64 {
        y[1] * (self.k - 1.0) / (self.r * y[0])
    }

    fn pull(&self, pressure: f64, length: f64) -> f64 {
        (pressure - self.ambient_pa) * self.area(length) - self.bladder_n_m * (self.rest_m - length)
    }

    /// Slope of the pull over length at constant P V^e.
    fn stiffness(&self, pressure: f64, length: f64, e: f64) -> f64 {
        e * pressure * self.area(length).powi(2) / self.volume(length)
            + (pressure - self.ambient_pa) * 6.0 * length / (4.0 * PI * self.turns.powi(2))
            + self.bladder_n_m
    }

    /// ISO 6358. No valve of this case comes near equal pressures, where the law is linear.
    fn flow(&self, upstream_pa: f64, upstream_k: f64, downstream_pa: f64) -> f64 {
        let above = (downstream_pa / upstream_pa - self.critical_ratio).max(0.0);
        let phi = (1.0 - (above / (1.0 - self.critical_ratio)).powi(2)).sqrt();
        let density = 100_000.0 / (self.r * 293.15);
        self.conductance * upstream_pa * density * (293.15 / upstream_k).sqrt() * phi
    }
}

/// The muscle at constant openings. The length then moves in one direction only from its start.
#[derive(Debug, Clone)]
pub struct Phase<'a> {
    pub muscle: &'a Muscle,
    pub inlet: f64,
    pub outlet: f64,
    pub held_m: f64,
    /// Last solution for the length \[m\].
    pub guess_m: Cell<f64>,
}

impl Phase<'_> {
    /// Length \[m\], and the direction in which it may slide: -1 in, 1 out, 0 none.
    fn length(&self, energy: f64) -> (f64, f64) {
        let Self { muscle, held_m, .. } = *self;
        let excess = muscle.pull(muscle.pressure(energy, held_m), held_m) - muscle.load_n;
        // A length that was sliding at the end of the last phase lies at the edge but for rounding.
        let edge = muscle.friction_n * (1.0 - 1e-9);
        // A solver may try a step with NaN and reject it: NaN does not move the length.
        if !(excess > edge || (excess < -edge && held_m < muscle.rest_m)) {
            return (held_m, 0.0);
        }
        let force = muscle.load_n + muscle.friction_n.copysign(excess);
        let mut length = self.guess_m.get();
        for _ in 0..20 {
            let pressure = muscle.pressure(energy, length);
            let correction =
                (muscle.pull(pressure, length) - force) / muscle.stiffness(pressure, length, 1.0);
            length -= correction;
            // Newton squares the remaining error.
            if correction.abs() < 1e-7 {
                self.guess_m.set(length);
                break;
            }
        }
        if length < muscle.rest_m { (length, -excess.signum()) } else { (muscle.rest_m, 0.0) }
    }

    pub fn sample(&self, y: &State) -> Sample {
        let (length, _) = self.length(y[1]);
        [self.muscle.pressure(y[1], length), self.muscle.temperature(y), length]
    }
}

impl System<f64, State> for Phase<'_> {
    fn system(&self, _: f64, y: &State, dy: &mut State) {
        let Muscle { r, k, ambient_pa, ambient_k, supply_pa, supply_k, .. } = *self.muscle;
        let (muscle, [h0, h1, h2, h3]) = (self.muscle, self.muscle.heat);
        let (length, way) = self.length(y[1]);
        let (volume, area) = (muscle.volume(length), muscle.area(length));
        let (pressure, temperature) = (muscle.pressure(y[1], length), muscle.temperature(y));
        let inflow = self.inlet * muscle.flow(supply_pa, supply_k, pressure);
        let outflow = self.outlet * muscle.flow(pressure, temperature, ambient_pa);
        let surface = length * (muscle.thread_m.powi(2) - length.powi(2)).sqrt() / muscle.turns;
        let heat = (h0 + h1 * inflow) * surface * (temperature - y[2]);
        let source = k * r / (k - 1.0) * (inflow * supply_k - outflow * temperature) - heat;
        // Balance of forces over time: the motion cancels the source's effect on the pull.
        let free = -area * (k - 1.0) * source / volume / muscle.stiffness(pressure, length, k);
        let speed = if free * way > 0.0 { free } else { 0.0 };
        let friction = muscle.friction_to_wall * muscle.friction_n * speed.abs();
        let lost = (h2 + h3 * speed.abs()) * surface * (y[2] - ambient_k);
        dy[0] = inflow - outflow;
        dy[1] = source + pressure * area * speed;
        dy[2] = (heat + friction - lost) / muscle.wall_j_k;
    }
}
