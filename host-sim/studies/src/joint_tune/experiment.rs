//! The experiment: angles between the stops that the core's own loop follows, within its limits of pressure.
//!
//! ```text
//! rest | slow sweeps   | fast sine | steps      | the same, stiffer
//!      | /\/  soft     | soft      | soft       |
//! ```
//!
//! Only telemetry is used, so that it works on any board.

use crate::tune::Left;
use model_core::joint::allocation::{Line, stiffness_n_m_rad};
use model_core::joint::{JointConfig, JointTelemetry, Mechanism, Motion};
use model_core::physics::chamber::{AnyChamber, Chamber};
use std::f64::consts::TAU;
use thermyo_joint::{Inputs, JointLoaded, Rig};
use thermyo_simulation::board::BoardError;
use thermyo_simulation::run::set_point_interval_steps;

/// Used fraction of the range between the stops: the rest is room for an overshoot \[-\].
const RANGE: f64 = 0.75;
/// Mean gauge pressures of both muscles, soft and stiff, as fractions of the highest \[-\].
const PRESSURES: [f64; 2] = [0.3, 0.65];
/// Factor on these fractions above the pressure at which both muscles pull \[-\]: bladders that take much of the
/// pressure thus get more.
const ABOVE_TAUT: f64 = 0.5;
/// Speed of the slow sweeps over the least speed at which a muscle slides \[-\].
const SLOW: f64 = 1.5;
/// Longest sweep from end to end \[s\].
const LONGEST_S: f64 = 4.0;
/// Rest before the motion, and at its turns \[s\].
const REST_S: f64 = 1.0;
const DWELL_S: f64 = 0.2;
/// Fast motions: amplitude over that of the sweeps; frequency \[Hz\] and periods of the sine; number and duration \[s\]
/// of the steps.
const FAST: f64 = 0.7;
const SINE_HZ: f64 = 1.5;
const PERIODS: f64 = 4.0;
const STEPS: u32 = 6;
const STEP_S: f64 = 0.6;
/// Largest number of lost steps that is interpolated: the steps between two rows of a run, which logs every tenth step
/// by default.
pub(super) const MOST_LOST: u32 = 9;

/// Data of one step of the core; arrays are of muscles a and b.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Record {
    pub step: u32,
    pub time_s: f64,
    pub angle_rad: f64,
    pub reference_rad: f64,
    /// Absolute pressures \[Pa\].
    pub pressure_pa: [f64; 2],
    pub wall_k: [f64; 2],
}

impl Record {
    fn new(step: u32, telemetry: &JointTelemetry, step_s: f64) -> Self {
        let [a, b] = &telemetry.muscles;
        Self {
            step,
            time_s: f64::from(step) * step_s,
            angle_rad: f64::from(telemetry.angle_rad),
            reference_rad: f64::from(telemetry.reference_rad),
            pressure_pa: [a, b].map(|muscle| f64::from(muscle.pressure_pa)),
            wall_k: [a, b].map(|muscle| f64::from(muscle.estimate.wall_k)),
        }
    }
}

/// Reason why an experiment ended early.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    #[error(transparent)]
    Run(#[from] thermyo_joint::RunError),
    #[error(transparent)]
    Board(#[from] BoardError),
    /// Both muscles have vented because of these faults.
    #[error("faults during the experiment: {0}")]
    Vented(String),
    #[error("stopped")]
    Stopped,
}

/// The set point over time \[s\].
pub type Course<'a> = &'a dyn Fn(f64) -> Motion;

/// Board on which an experiment runs: with a simulated joint, or with a real one.
pub trait Bench {
    /// Drives a joint along a course for a time \[s\], with the core as the scenario configures it, and calls `each`
    /// with every step since the start and its telemetry. A fault vents and ends the drive.
    fn drive(
        &mut self,
        loaded: &JointLoaded,
        course: (Course<'_>, f64),
        each: &mut dyn FnMut(u32, &JointTelemetry),
    ) -> Result<(), BenchError>;

    /// Vents, and leaves the board with a configuration.
    fn leave(&mut self, left: Left<'_, JointConfig>) -> Result<(), BoardError>;
}

/// A simulated joint, with the core in this process.
pub struct Simulated<'a> {
    /// Highest absolute pressure \[Pa\].
    pub highest_pa: f64,
    pub stopped: &'a dyn Fn() -> bool,
}

impl Bench for Simulated<'_> {
    fn drive(
        &mut self,
        loaded: &JointLoaded,
        (course, duration_s): (Course<'_>, f64),
        each: &mut dyn FnMut(u32, &JointTelemetry),
    ) -> Result<(), BenchError> {
        let step_s = loaded.muscles[0].plant.run.step_s;
        let every = set_point_interval_steps(step_s);
        let mut inputs = Inputs::of(course(0.0));
        // A board begins vented; a scenario may begin above the allowed pressure.
        let mut allowed = loaded.clone();
        for muscle in &mut allowed.muscles {
            let initial_pa = &mut muscle.plant.plant.initial_pressure_pa;
            *initial_pa = initial_pa.min(self.highest_pa);
        }
        let mut rig = Rig::new(&allowed, inputs)?;
        let armed = rig.core().arm(Some(self.highest_pa as f32));
        let set = armed.and_then(|()| rig.core().set(inputs.set_point));
        set.map_err(thermyo_joint::RunError::SetPoint)?;
        for step in 0..=(duration_s / step_s).round() as u64 {
            if (step + 1).is_multiple_of(every) {
                inputs = Inputs::of(course((step + 1) as f64 * step_s));
            }
            let row = rig.step(inputs)?;
            if let Some(faults) = thermyo_joint::venting(&row.telemetry) {
                return Err(BenchError::Vented(faults));
            }
            each(step as u32, &row.telemetry);
            if (self.stopped)() {
                return Err(BenchError::Stopped);
            }
        }
        Ok(())
    }

    fn leave(&mut self, _: Left<'_, JointConfig>) -> Result<(), BoardError> {
        Ok(())
    }
}

/// A record interpolated between two others, at a step.
fn between(one: &Record, other: &Record, step: u32) -> Record {
    let share = f64::from(step - one.step) / f64::from(other.step - one.step);
    let mix = |from: f64, to: f64| from + share * (to - from);
    let both = |from: [f64; 2], to: [f64; 2]| [mix(from[0], to[0]), mix(from[1], to[1])];
    Record {
        step,
        time_s: mix(one.time_s, other.time_s),
        angle_rad: mix(one.angle_rad, other.angle_rad),
        reference_rad: mix(one.reference_rad, other.reference_rad),
        pressure_pa: both(one.pressure_pa, other.pressure_pa),
        wall_k: both(one.wall_k, other.wall_k),
    }
}

/// The records with short gaps filled, as a slow link leaves them.
pub(super) fn filled(records: &[Record]) -> Vec<Record> {
    let mut all: Vec<Record> = Vec::with_capacity(records.len());
    for record in records {
        if let Some(before) = all.last().copied() {
            let lost = record.step.saturating_sub(before.step + 1);
            if lost <= MOST_LOST {
                all.extend((1..=lost).map(|k| between(&before, record, before.step + k)));
            }
        }
        all.push(*record);
    }
    all
}

/// Drives a course and records every step.
pub fn record(
    loaded: &JointLoaded,
    (course, duration_s): (Course<'_>, f64),
    bench: &mut dyn Bench,
) -> Result<Vec<Record>, BenchError> {
    let step_s = loaded.muscles[0].plant.run.step_s;
    let mut records = Vec::new();
    bench.drive(loaded, (course, duration_s), &mut |step, telemetry| {
        records.push(Record::new(step, telemetry, step_s));
    })?;
    Ok(filled(&records))
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Form {
    /// From one angle to another at constant speed \[rad\].
    Line { from: f64, to: f64 },
    /// About an angle \[rad\].
    Sine { middle: f64, amplitude: f64 },
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Part {
    start_s: f64,
    end_s: f64,
    form: Form,
    stiffness_n_m_rad: f64,
}

/// Least speed of the joint at which its muscles slide \[rad/s\].
pub(super) fn sliding_rad_s(config: &JointConfig, sliding_m_s: f64) -> f64 {
    sliding_m_s / least_radius_m(&config.mechanism)
}

/// Smallest radius of either muscle between the stops \[m\].
pub(super) fn least_radius_m(mechanism: &Mechanism) -> f64 {
    const INTERVALS: u8 = 32;
    let Mechanism { minimum_rad, maximum_rad, radius_m, .. } = *mechanism;
    let along = (0..=INTERVALS).map(|i| f32::from(i) / f32::from(INTERVALS));
    let levers =
        along.flat_map(|share| mechanism.levers(minimum_rad + share * (maximum_rad - minimum_rad)));
    f64::from(radius_m) * levers.map(|lever| f64::from(lever.share)).fold(f64::INFINITY, f64::min)
}

#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    pub ends_rad: [f64; 2],
    /// Soft and stiff set point \[N m/rad\].
    pub stiffness_n_m_rad: [f64; 2],
    /// Least speed at which a muscle slides \[rad/s\].
    pub sliding_rad_s: f64,
    parts: Vec<Part>,
}

impl Plan {
    /// The experiment for the core's configuration, up to `highest_pa`; muscles slide at `sliding_m_s` and faster.
    pub fn new(config: &JointConfig, highest_pa: f64, sliding_m_s: f64) -> Self {
        let mechanism = &config.mechanism;
        let [least, most] = [mechanism.minimum_rad, mechanism.maximum_rad].map(f64::from);
        let (middle, reach) = (f64::midpoint(least, most), 0.5 * RANGE * (most - least));
        let ends_rad = [middle - reach, middle + reach];
        let sliding_rad_s = sliding_rad_s(config, sliding_m_s);
        let most_pa = gauge_pa(config, highest_pa);
        let taut_pa = taut_pa(config, ends_rad);
        let stiffness_n_m_rad = PRESSURES.map(|share| {
            let above_pa = taut_pa + ABOVE_TAUT * share * (most_pa - taut_pa);
            stiffness(config, middle, above_pa.max(share * most_pa))
        });
        let mut plan = Self { ends_rad, stiffness_n_m_rad, sliding_rad_s, parts: Vec::new() };
        for stiffness in stiffness_n_m_rad {
            plan.line([middle, middle], REST_S, stiffness);
            plan.sweeps(middle, stiffness);
            plan.fast(middle, FAST * reach, stiffness);
        }
        plan
    }

    pub fn duration_s(&self) -> f64 {
        self.parts.last().map_or(0.0, |part| part.end_s)
    }

    fn part(&mut self, form: Form, duration_s: f64, stiffness_n_m_rad: f64) {
        let start_s = self.duration_s();
        self.parts.push(Part { start_s, end_s: start_s + duration_s, form, stiffness_n_m_rad });
    }

    fn line(&mut self, [from, to]: [f64; 2], duration_s: f64, stiffness: f64) {
        self.part(Form::Line { from, to }, duration_s, stiffness);
    }

    /// Down, up, down, up and back.
    fn sweeps(&mut self, middle: f64, stiffness: f64) {
        let [low, high] = self.ends_rad;
        let speed = (SLOW * self.sliding_rad_s).max((high - low) / LONGEST_S);
        let mut from = middle;
        for to in [low, high, low, high, middle] {
            self.line([from, to], (to - from).abs() / speed, stiffness);
            self.line([to, to], DWELL_S, stiffness);
            from = to;
        }
    }

    fn fast(&mut self, middle: f64, amplitude: f64, stiffness: f64) {
        self.part(Form::Sine { middle, amplitude }, PERIODS / SINE_HZ, stiffness);
        for step in 0..STEPS {
            let sign = if step % 2 == 0 { 1.0 } else { -1.0 };
            let to = middle + sign * amplitude;
            self.line([to, to], STEP_S, stiffness);
        }
    }

    /// The set point at a time \[s\].
    pub fn motion(&self, time_s: f64) -> Motion {
        let later = self.parts.partition_point(|part| part.end_s <= time_s);
        let Some(part) = self.parts.get(later).or(self.parts.last()) else {
            return Motion::still(0.0, 0.0);
        };
        let since_s = (time_s - part.start_s).min(part.end_s - part.start_s);
        let (angle, speed, acceleration) = match part.form {
            Form::Line { from, to } => {
                let speed = (to - from) / (part.end_s - part.start_s);
                (from + speed * since_s, speed, 0.0)
            }
            Form::Sine { middle, amplitude } => {
                let w = TAU * SINE_HZ;
                let (sin, cos) = (w * since_s).sin_cos();
                (middle + amplitude * sin, amplitude * w * cos, -amplitude * w * w * sin)
            }
        };
        Motion {
            angle_rad: angle as f32,
            speed_rad_s: speed as f32,
            acceleration_rad_s2: acceleration as f32,
            stiffness_n_m_rad: part.stiffness_n_m_rad as f32,
        }
    }
}

fn gauge_pa(config: &JointConfig, highest_pa: f64) -> f64 {
    let [a, _] = &config.muscles;
    highest_pa - f64::from(a.ambient.pressure_pa)
}

/// Gauge pressure above which both muscles pull at both ends \[Pa\].
fn taut_pa(config: &JointConfig, ends_rad: [f64; 2]) -> f64 {
    let at = |angle_rad: f64| {
        let lengths_m = config.mechanism.lengths_m(angle_rad as f32);
        let slack_pa = |i: usize| {
            let chamber = AnyChamber::new(&config.muscles[i].chamber);
            let length_m = chamber.limit_length_m(lengths_m[i]);
            f64::from(chamber.gauge_pressure_for_force_pa(0.0, length_m))
        };
        slack_pa(0).max(slack_pa(1))
    };
    ends_rad.map(at).into_iter().fold(0.0, f64::max)
}

/// Stiffness at an angle \[rad\] with this gauge pressure in both muscles \[Pa\].
fn stiffness(config: &JointConfig, angle_rad: f64, gauge_pa: f64) -> f64 {
    let lengths_m = config.mechanism.lengths_m(angle_rad as f32);
    let levers = config.mechanism.levers(angle_rad as f32);
    let line = |i: usize| {
        let chamber = AnyChamber::new(&config.muscles[i].chamber);
        let length_m = chamber.limit_length_m(lengths_m[i]);
        Line::new(&config.muscles[i], &chamber, length_m, 0.0, &levers[i])
    };
    let radius_m = config.mechanism.radius_m;
    f64::from(stiffness_n_m_rad(radius_m, &[line(0), line(1)], [gauge_pa as f32; 2]))
}
