//! Random muscles with loads that they can lift, and random tasks.

use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use std::f64::consts::PI;
use thermyo_scenario::profile::Profile;
use thermyo_scenario::{DriveKind, PlantModel, Scenario};
use thermyo_setup::{Loaded, parse};

/// Gauge pressure at which a load has to be lifted \[Pa\], and the load's range as fractions of the
/// force at the rest length: the muscle is strong enough, but not far too strong.
const LIFTING_PA: f64 = 3.0e5;
const LIFTED: [f64; 2] = [0.05, 0.35];
/// Absolute pressures of holds and steps \[Pa\].
const PRESSURES_PA: [f64; 2] = [1.6e5, 5.0e5];
/// Conductance per volume, relative to the nominal muscle: all of them vent within a second, see
/// [`super::vent`] \[-\].
const VALVES: [f64; 2] = [2.0, 3.5];
/// Range of the gas sensor's front end \[K\]: a fast fill drives an element with a lag of a second
/// out of the nominal range, which would be detected as a rail fault.
const RANGE_K: [f64; 2] = [230.0, 390.0];
const BETWEEN_STEPS_S: [f64; 2] = [0.5, 2.5];
const NOMINAL_DIAMETER_M: f64 = 0.020;
const NOMINAL_LENGTH_M: f64 = 0.30;
/// Gas mass of a stroke in the nominal cycle \[kg\].
const NOMINAL_MOVED_KG: f64 = 9.0e-4;

/// Ranges of loads and sensors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    pub loads_n: [f64; 2],
    /// Shortest and longest lag of the gas sensor \[s\].
    pub lags_s: [f64; 2],
}

/// Ranges for the runs with faults.
const USUAL: Spread = Spread { loads_n: [20.0, 400.0], lags_s: [1.0, 5.0] };

#[derive(Debug, Clone)]
pub struct Draw(Xoshiro256PlusPlus);

impl Draw {
    pub fn new(seed: u64) -> Self {
        Self(Xoshiro256PlusPlus::seed_from_u64(seed))
    }

    /// Uniform from `low` to `high`.
    pub fn between(&mut self, [low, high]: [f64; 2]) -> f64 {
        let share = (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        low + share * (high - low)
    }

    /// Log-uniform from `low` to `high`, both above 0.
    pub fn factor(&mut self, [low, high]: [f64; 2]) -> f64 {
        self.between([low.ln(), high.ln()]).exp()
    }

    /// 1 or -1.
    pub fn sign(&mut self) -> f64 {
        if self.between([0.0, 1.0]) < 0.5 { -1.0 } else { 1.0 }
    }

    pub fn of<T: Copy>(&mut self, all: &[T]) -> T {
        all[(self.between([0.0, all.len() as f64]) as usize).min(all.len() - 1)]
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    PressureHold,
    /// Random pressures, a new one every 0.5 to 2.5 s.
    PressureSteps,
    ContractionHold,
    ContractionSteps,
    /// The paper's working cycle.
    Cycle,
    /// The inlet open at any pressure, behind a supply of 6 bar.
    Filling,
}

impl Task {
    pub const ALL: [Self; 5] = [
        Self::PressureHold,
        Self::PressureSteps,
        Self::ContractionHold,
        Self::ContractionSteps,
        Self::Cycle,
    ];
    /// Tasks with repeated flow.
    pub const MOVING: [Self; 3] = [Self::PressureSteps, Self::ContractionSteps, Self::Cycle];
    /// Tasks that come to rest.
    pub const HOLDING: [Self; 2] = [Self::PressureHold, Self::ContractionHold];

    pub fn name(self) -> &'static str {
        match self {
            Self::PressureHold => "pressure held",
            Self::PressureSteps => "pressure steps",
            Self::ContractionHold => "contraction held",
            Self::ContractionSteps => "contraction steps",
            Self::Cycle => "working cycle",
            Self::Filling => "inlet commanded open",
        }
    }
}

/// A random muscle on `model`, configured correctly, that does `task` for `duration_s`.
pub fn random(draw: &mut Draw, model: PlantModel, task: Task, duration_s: f64) -> Loaded {
    random_within(&USUAL, draw, model, task, duration_s)
}

/// [`random`] with the loads and lags of `spread`.
pub fn random_within(
    spread: &Spread,
    draw: &mut Draw,
    model: PlantModel,
    task: Task,
    duration_s: f64,
) -> Loaded {
    let diameter_m = draw.between([0.014, 0.040]);
    let rest_m = draw.between([0.15, 0.5]);
    let angle_deg = draw.between([21.0, 25.0]);
    let text = format!(
        "[muscle]\nrest_length_m = {rest_m}\ndiameter_m = {diameter_m}\n\
         braid_angle_deg = {angle_deg}\n"
    );
    let loaded = parse(&text, "random muscle".as_ref());
    let mut loaded = loaded.expect("what is drawn is allowed").with_model(model);
    let lifted_n = LIFTED.map(|share| share * rest_force_n(&loaded.plant));
    let load_n =
        draw.factor([spread.loads_n[0].max(lifted_n[0]), spread.loads_n[1].min(lifted_n[1])]);
    let ambient_k = draw.between([283.0, 313.0]);
    let lag_s = draw.factor(spread.lags_s);
    let valves = draw.factor(VALVES);
    let seed = draw.0.next_u64() >> 1;
    let wide = diameter_m / NOMINAL_DIAMETER_M;
    let long = rest_m / NOMINAL_LENGTH_M;
    let volume = wide * wide * long;
    for s in [&mut loaded.plant, &mut loaded.believed] {
        s.run.seed = seed;
        s.run.log_every = 1;
        s.run.duration_s = duration_s;
        s.ambient.temperature_k = ambient_k;
        s.supply.temperature_k = ambient_k;
        s.plant.initial_temperature_k = ambient_k;
        s.load.force_n = load_n;
        s.load.mass_kg *= load_n / 100.0;
        s.sensor.gas.time_constant_s = lag_s;
        [s.sensor.gas.range_min_k, s.sensor.gas.range_max_k] = RANGE_K;
        // Bladder and braid of the same material, with matching valves, tube and regulator.
        s.muscle.bladder_stiffness_n_m *= wide / long;
        s.muscle.dead_volume_m3 *= volume;
        s.wall.heat_capacity_j_k *= wide * long;
        s.wall.conductance_w_k *= wide * long;
        s.friction.force_n *= wide;
        s.friction.stribeck_force_n *= wide;
        s.friction.viscous_n_s_m *= wide;
        s.friction.presliding_stiffness_n_m *= wide / long;
        s.valve.conductance_m3_s_pa *= volume * valves;
        s.tube.volume_m3 *= volume;
        s.tube.conductance_m3_s_pa *= volume * valves;
        s.supply.droop_pa_s_kg /= volume * valves;
    }
    if task == Task::Filling {
        loaded.plant.supply.pressure_pa = 6.0e5;
        loaded.believed.supply.pressure_pa = 6.0e5;
    }
    give(draw, &mut loaded, task, volume);
    loaded
}

/// Force at the rest length and [`LIFTING_PA`] \[N\]: F = P pi D^2/4 (3 cos^2 - 1)/sin^2.
fn rest_force_n(s: &Scenario) -> f64 {
    let (diameter_m, angle) = braid(s);
    let sin2 = angle.sin().powi(2);
    LIFTING_PA * PI / 4.0 * diameter_m * diameter_m * (2.0 - 3.0 * sin2) / sin2
}

fn braid(s: &Scenario) -> (f64, f64) {
    (s.muscle.diameter_m, s.muscle.braid_angle_deg.to_radians())
}

/// Contraction at which the load balances [`LIFTING_PA`], without the bladder \[-\].
fn lifted_contraction(s: &Scenario) -> f64 {
    let (_, angle) = braid(s);
    let share = s.load.force_n / rest_force_n(s);
    // F ~ 3 cos^2 - 1
    let cos2 = (1.0 + share * (3.0 * angle.cos().powi(2) - 1.0)) / 3.0;
    1.0 - cos2.sqrt() / angle.cos()
}

fn give(draw: &mut Draw, loaded: &mut Loaded, task: Task, volume: f64) {
    let duration_s = loaded.plant.run.duration_s;
    let contractions = [0.03, 0.75 * lifted_contraction(&loaded.plant)];
    let mut steps = |kind, range| {
        let (mut time_s, mut value) = (0.0, draw.between(range));
        let mut points = vec![(time_s, value)];
        while time_s < duration_s {
            time_s += draw.between(BETWEEN_STEPS_S);
            points.push((time_s, value));
            value = draw.between(range);
            points.push((time_s + 0.001, value));
        }
        (kind, Some(Profile::new(points).expect("times increase")))
    };
    let (kind, profile) = match task {
        Task::PressureSteps => steps(DriveKind::Pressure, PRESSURES_PA),
        Task::ContractionSteps => steps(DriveKind::Contraction, contractions),
        Task::PressureHold => (DriveKind::Pressure, None),
        Task::ContractionHold => (DriveKind::Contraction, None),
        Task::Cycle => (DriveKind::MassFlow, None),
        Task::Filling => (DriveKind::Fill, None),
    };
    loaded.drive_profile = profile;
    let drive = &mut loaded.plant.drive;
    drive.kind = kind;
    drive.pressure_pa = draw.between(PRESSURES_PA);
    drive.contraction = draw.between(contractions);
    drive.period_s = draw.factor([1.5, 8.0]);
    let moved_kg = draw.between([0.5, 0.9]) * volume * NOMINAL_MOVED_KG;
    drive.flow_kg_s = moved_kg / (0.5 * drive.period_s);
}
