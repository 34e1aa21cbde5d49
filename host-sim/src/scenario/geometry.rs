//! The muscle's five dimensions from those that are given (paper, Fig. 1):
//! L = b cos(theta), D = b sin(theta)/(n pi).

use super::model::Muscle;
use super::schema::limits;
use super::violation::Violation;
use std::f64::consts::PI;

/// Rest length where nothing is said \[m\].
const REST_LENGTH_M: f64 = 0.30;
/// Diameter at rest where nothing is said \[m\].
const DIAMETER_M: f64 = 0.020;
/// Braid angle at rest where nothing is said \[deg\]: usual braids lie between 20 and 25.
const BRAID_ANGLE_DEG: f64 = 23.0;
/// Relative difference up to which dimensions given twice agree: hand-rounded figures do.
const AGREEMENT: f64 = 1.0e-3;

/// Fills all five dimensions in. What is given stays as it is, to the bit.
///
/// # Errors
/// When dimensions are missing, contradict each other, or make no braid.
pub fn resolve(muscle: &mut Muscle) -> Result<(), Violation> {
    match (muscle.thread_length_m, muscle.turns) {
        (None, None) => thread_from_rest(muscle),
        (Some(thread_m), Some(turns)) => rest_from_thread(muscle, thread_m, turns),
        (Some(_), None) => Err(lone("muscle.turns", "muscle.thread_length_m")),
        (None, Some(_)) => Err(lone("muscle.thread_length_m", "muscle.turns")),
    }
}

fn lone(missing: &str, given: &str) -> Violation {
    let why =
        format!("{given} needs it; or give rest_length_m, diameter_m and braid_angle_deg instead");
    Violation::missing(missing, given, &why)
}

fn thread_from_rest(muscle: &mut Muscle) -> Result<(), Violation> {
    let rest_m = *muscle.rest_length_m.get_or_insert(REST_LENGTH_M);
    let diameter_m = *muscle.diameter_m.get_or_insert(DIAMETER_M);
    let angle = muscle.braid_angle_deg.get_or_insert(BRAID_ANGLE_DEG).to_radians();
    let thread_m = rest_m / angle.cos();
    let threads = limits("muscle.thread_length_m");
    if !threads.contains(thread_m) {
        let rest = limits("muscle.rest_length_m")
            .between(threads.min * angle.cos(), threads.max * angle.cos());
        return Err(Violation::number("muscle.rest_length_m", rest_m, &rest, "by its braid angle"));
    }
    // n = b sin(theta)/(pi D)
    let turns_times_diameter = thread_m * angle.sin() / PI;
    let turns = turns_times_diameter / diameter_m;
    let counts = limits("muscle.turns");
    if !counts.contains(turns) {
        let diameters = limits("muscle.diameter_m")
            .between(turns_times_diameter / counts.max, turns_times_diameter / counts.min);
        let why = "by its rest length and braid angle";
        return Err(Violation::number("muscle.diameter_m", diameter_m, &diameters, why));
    }
    muscle.thread_length_m = Some(thread_m);
    muscle.turns = Some(turns);
    Ok(())
}

fn rest_from_thread(muscle: &mut Muscle, thread_m: f64, turns: f64) -> Result<(), Violation> {
    let angles = limits("muscle.braid_angle_deg");
    let angle_deg = muscle.braid_angle_deg.unwrap_or(BRAID_ANGLE_DEG);
    let rest_m = *muscle.rest_length_m.get_or_insert(thread_m * angle_deg.to_radians().cos());
    let lengths = limits("muscle.rest_length_m").between(
        thread_m * angles.max.to_radians().cos(),
        thread_m * angles.min.to_radians().cos(),
    );
    if !lengths.contains(rest_m) {
        let why = "thread_length_m times the cosine of a braid angle from 54 to 3 deg";
        return Err(Violation::number("muscle.rest_length_m", rest_m, &lengths, why));
    }
    // The clamp only takes away what rounding has added at the ends.
    let angle_deg = (rest_m / thread_m).acos().to_degrees().clamp(angles.min, angles.max);
    let diameter_m = (thread_m * thread_m - rest_m * rest_m).sqrt() / (turns * PI);
    for (path, given, derived) in [
        ("muscle.braid_angle_deg", &mut muscle.braid_angle_deg, angle_deg),
        ("muscle.diameter_m", &mut muscle.diameter_m, diameter_m),
    ] {
        let given = *given.get_or_insert(derived);
        let agreeing =
            limits(path).between(derived * (1.0 - AGREEMENT), derived * (1.0 + AGREEMENT));
        if !agreeing.contains(given) {
            let why = "as thread_length_m, turns and rest_length_m say";
            return Err(Violation::number(path, given, &agreeing, why));
        }
    }
    Ok(())
}

/// The dimensions that the core is told: those in `told`, completed from the plant's.
///
/// Where only one way of giving the geometry is touched, the other one follows; where both are,
/// each dimension that is not told is the plant's. `threaded` says whether the plant's file gives
/// thread length and turns.
pub fn overlay(told: &Muscle, plant: &Muscle, threaded: bool) -> Muscle {
    let thread_told = told.thread_length_m.is_some() || told.turns.is_some();
    let rest_told = told.diameter_m.is_some() || told.braid_angle_deg.is_some();
    let (keep_thread, keep_rest) = match (thread_told, rest_told) {
        (false, false) if told.rest_length_m.is_some() => (threaded, !threaded),
        (false, false) => (true, true),
        both_or_one => both_or_one,
    };
    Muscle {
        thread_length_m: told.thread_length_m.or(plant.thread_length_m.filter(|_| keep_thread)),
        turns: told.turns.or(plant.turns.filter(|_| keep_thread)),
        rest_length_m: told.rest_length_m.or(plant.rest_length_m),
        diameter_m: told.diameter_m.or(plant.diameter_m.filter(|_| keep_rest)),
        braid_angle_deg: told.braid_angle_deg.or(plant.braid_angle_deg.filter(|_| keep_rest)),
        ..told.clone()
    }
}
