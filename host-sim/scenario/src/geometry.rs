//! Computes the five dimensions of the muscle from those in the file (paper, Fig. 1): L = b
//! cos(theta), D = b sin(theta)/(n pi).

use super::document::Entries;
use super::schema::{DIMENSIONS, limits};
use super::tables::Muscle;
use super::violation::Violation;
use std::f64::consts::PI;
use thermyo_compute::math;

const REST_LENGTH_M: f64 = 0.30;
const DIAMETER_M: f64 = 0.020;
/// Default braid angle at rest \[deg\]: usual braids have 20 to 25.
const BRAID_ANGLE_DEG: f64 = 23.0;
/// Relative difference up to which redundant dimensions agree, since figures are rounded by hand.
const AGREEMENT: f64 = 1.0e-3;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dimensions {
    pub thread_length_m: f64,
    /// Thread turns n \[-\].
    pub turns: f64,
    pub rest_length_m: f64,
    pub diameter_m: f64,
    /// Angle of the threads to the axis \[deg\].
    pub braid_angle_deg: f64,
}

impl Dimensions {
    pub fn nominal() -> Self {
        Self::at_rest(REST_LENGTH_M, DIAMETER_M, BRAID_ANGLE_DEG)
    }

    /// Thread length and turns from the visible dimensions of a muscle at rest.
    fn at_rest(rest_length_m: f64, diameter_m: f64, braid_angle_deg: f64) -> Self {
        let angle = braid_angle_deg.to_radians();
        let thread_length_m = rest_length_m / math::cos(angle);
        // n = b sin(theta)/(pi D)
        let turns = thread_length_m * math::sin(angle) / PI / diameter_m;
        Self { thread_length_m, turns, rest_length_m, diameter_m, braid_angle_deg }
    }

    pub fn of(muscle: &Muscle) -> Self {
        let Muscle { thread_length_m, turns, rest_length_m, diameter_m, braid_angle_deg, .. } =
            *muscle;
        Self { thread_length_m, turns, rest_length_m, diameter_m, braid_angle_deg }
    }

    pub fn applied_to(self, muscle: &Muscle) -> Muscle {
        let Self { thread_length_m, turns, rest_length_m, diameter_m, braid_angle_deg } = self;
        Muscle {
            thread_length_m,
            turns,
            rest_length_m,
            diameter_m,
            braid_angle_deg,
            ..muscle.clone()
        }
    }
}

/// The muscle with other dimensions at rest \[m, m, deg\].
pub fn at_rest(
    muscle: &Muscle,
    rest_length_m: f64,
    diameter_m: f64,
    braid_angle_deg: f64,
) -> Muscle {
    Dimensions::at_rest(rest_length_m, diameter_m, braid_angle_deg).applied_to(muscle)
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Given {
    thread_length_m: Option<f64>,
    turns: Option<f64>,
    rest_length_m: Option<f64>,
    diameter_m: Option<f64>,
    braid_angle_deg: Option<f64>,
}

impl Given {
    pub fn of(entries: &Entries) -> Self {
        let [thread_length_m, turns, rest_length_m, diameter_m, braid_angle_deg] =
            DIMENSIONS.map(|name| entries.get(&format!("muscle.{name}"))?.value.as_float());
        Self { thread_length_m, turns, rest_length_m, diameter_m, braid_angle_deg }
    }

    /// Resolves all five dimensions. Given values stay the same to the bit.
    ///
    /// # Errors
    /// When dimensions are missing, contradict each other, or make no braid.
    pub fn resolved(self) -> Result<Dimensions, Violation> {
        match (self.thread_length_m, self.turns) {
            (None, None) => self.thread_from_rest(),
            (Some(thread_m), Some(turns)) => self.rest_from_thread(thread_m, turns),
            (Some(_), None) => Err(lone("muscle.turns", "muscle.thread_length_m")),
            (None, Some(_)) => Err(lone("muscle.thread_length_m", "muscle.turns")),
        }
    }

    fn thread_from_rest(self) -> Result<Dimensions, Violation> {
        let found = Dimensions::at_rest(
            self.rest_length_m.unwrap_or(REST_LENGTH_M),
            self.diameter_m.unwrap_or(DIAMETER_M),
            self.braid_angle_deg.unwrap_or(BRAID_ANGLE_DEG),
        );
        let Dimensions { thread_length_m, turns, rest_length_m, diameter_m, .. } = found;
        let threads = limits("muscle.thread_length_m");
        if !threads.contains(thread_length_m) {
            let cos = math::cos(found.braid_angle_deg.to_radians());
            let rest = limits("muscle.rest_length_m").between(threads.min * cos, threads.max * cos);
            let why = "by its braid angle";
            return Err(Violation::number("muscle.rest_length_m", rest_length_m, &rest, why));
        }
        let counts = limits("muscle.turns");
        if !counts.contains(turns) {
            let turns_times_diameter = turns * diameter_m;
            let diameters = limits("muscle.diameter_m")
                .between(turns_times_diameter / counts.max, turns_times_diameter / counts.min);
            let why = "by its rest length and braid angle";
            return Err(Violation::number("muscle.diameter_m", diameter_m, &diameters, why));
        }
        Ok(found)
    }

    fn rest_from_thread(self, thread_m: f64, turns: f64) -> Result<Dimensions, Violation> {
        let angles = limits("muscle.braid_angle_deg");
        let usual = || self.braid_angle_deg.unwrap_or(BRAID_ANGLE_DEG).to_radians();
        let rest_m = self.rest_length_m.unwrap_or_else(|| thread_m * math::cos(usual()));
        let lengths = limits("muscle.rest_length_m").between(
            thread_m * math::cos(angles.max.to_radians()),
            thread_m * math::cos(angles.min.to_radians()),
        );
        if !lengths.contains(rest_m) {
            let why = "thread_length_m times the cosine of a braid angle from 54 to 3 deg";
            return Err(Violation::number("muscle.rest_length_m", rest_m, &lengths, why));
        }
        // The clamp only removes rounding errors at the ends.
        let angle_deg = math::acos(rest_m / thread_m).to_degrees().clamp(angles.min, angles.max);
        let diameter_m = (thread_m * thread_m - rest_m * rest_m).sqrt() / (turns * PI);
        let braid_angle_deg = agreeing("muscle.braid_angle_deg", self.braid_angle_deg, angle_deg)?;
        let diameter_m = agreeing("muscle.diameter_m", self.diameter_m, diameter_m)?;
        Ok(Dimensions {
            thread_length_m: thread_m,
            turns,
            rest_length_m: rest_m,
            diameter_m,
            braid_angle_deg,
        })
    }

    /// The dimensions that the core is configured with: those given here, completed from the
    /// plant's.
    ///
    /// If the entries use only one of the two forms of the geometry, the other follows; if they use
    /// both, missing dimensions are the plant's. `threaded`: the plant's file gives thread length
    /// and turns.
    pub fn completed_from(self, plant: Dimensions, threaded: bool) -> Self {
        let thread_told = self.thread_length_m.is_some() || self.turns.is_some();
        let rest_told = self.diameter_m.is_some() || self.braid_angle_deg.is_some();
        let (keep_thread, keep_rest) = match (thread_told, rest_told) {
            (false, false) if self.rest_length_m.is_some() => (threaded, !threaded),
            (false, false) => (true, true),
            both_or_one => both_or_one,
        };
        let kept = |keep: bool, value: f64| keep.then_some(value);
        Self {
            thread_length_m: self.thread_length_m.or(kept(keep_thread, plant.thread_length_m)),
            turns: self.turns.or(kept(keep_thread, plant.turns)),
            rest_length_m: self.rest_length_m.or(Some(plant.rest_length_m)),
            diameter_m: self.diameter_m.or(kept(keep_rest, plant.diameter_m)),
            braid_angle_deg: self.braid_angle_deg.or(kept(keep_rest, plant.braid_angle_deg)),
        }
    }
}

/// A dimension that follows from others; the given value if it agrees.
fn agreeing(path: &str, given: Option<f64>, derived: f64) -> Result<f64, Violation> {
    let given = given.unwrap_or(derived);
    let agreeing = limits(path).between(derived * (1.0 - AGREEMENT), derived * (1.0 + AGREEMENT));
    if agreeing.contains(given) {
        Ok(given)
    } else {
        let why = "by thread_length_m, turns and rest_length_m";
        Err(Violation::number(path, given, &agreeing, why))
    }
}

fn lone(missing: &str, given: &str) -> Violation {
    let why =
        format!("{given} needs it; or give rest_length_m, diameter_m and braid_angle_deg instead");
    Violation::missing(missing, given, &why)
}
