//! `thermyo tune` for a joint: inertia, gravity, friction and mid-lengths from a short experiment on a board.
//!
//! ```text
//! configured scenario --experiment--> records --balance--> values, errors, what is left open
//!                                                          --check--> before, after
//! ```
//!
//! Only telemetry is used, so that a board with a real joint can be tuned like a simulated one. Only the core's
//! configuration changes, never the plant. See `docs/background/tuning.md`.

mod balance;
mod check;
mod experiment;
mod findings;
mod live;
mod page;
mod recorded;
#[cfg(test)]
mod tests;

pub use check::Figures;
pub use experiment::{Bench, BenchError, Course, Simulated};
pub use findings::{Findings, Values};
pub use page::{check_chart, page, record_page, record_plot};
pub use recorded::{Identified, RecordError, identify};

use crate::tune::{self, Left, OutOfReach, Parameter, SLIDING_M_S};
use check::Checked;
use experiment::{Plan, Record};
use findings::{Estimate, FRICTION, limits};
use model_core::joint::JointConfig;
use thermyo_compute::math::ends;
use thermyo_joint::JointLoaded;
use thermyo_scenario::with_numbers;

/// Least part of the way between the ends that a joint has to move.
const MOVED: f64 = 0.8;
/// The tuned values are wrong if the check's error grows by more than this factor, and exceeds [`WORSE_RAD`].
const WORSE: f64 = 1.5;
/// See [`WORSE`]; RMS error of the sine: 1 deg \[rad\].
const WORSE_RAD: f64 = 0.0175;
/// Motion at rest up to which tuned values are kept, 0.6 deg: dry friction slips by up to 0.5 deg, and a joint that
/// hunts moves by 1 deg and more \[rad\].
const REST_MOTION_RAD: f64 = 0.010_5;

/// Reason why the experiment or its data cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// As for one muscle.
    #[error(transparent)]
    Muscle(#[from] tune::Refusal),
    #[error(
        "faults during the experiment: {0}. Where the joint is sound, enter a rough joint.gravity_n_m and \
         joint.inertia_kg_m2, or raise joint.torque_limit_n_m"
    )]
    Torque(String),
    #[error("faults during the experiment: {0}")]
    Faulty(String),
    #[error(
        "the joint moved by {:.1} deg of the {:.1} deg asked for, at least {:.1} deg are needed: are the pressures \
         too low for its gravity or its bladders (--max-pressure), or is it blocked?",
        moved_rad.to_degrees(), asked_rad.to_degrees(), (MOVED * asked_rad).to_degrees()
    )]
    NotMoved { moved_rad: f64, asked_rad: f64 },
    #[error(
        "the balance of torques cannot be fitted to the {windows} intervals of 0.1 s in which the joint slid evenly \
         with both tendons taut: they are too few or too alike, or the angle grows where muscle a lengthens (its sign \
         is reversed, or the muscles are exchanged)"
    )]
    TooFew { windows: usize },
    #[error("{path} came out as {value:.4e}: must be {allowed}")]
    OutOfRange { path: &'static str, value: f64, allowed: String },
    #[error("the tuned values do not go together: {0}")]
    Together(String),
    #[error(
        "with the tuned values the joint follows worse: {:.2} deg RMS on the check's sine, {:.2} deg before",
        after_rad.to_degrees(), before_rad.to_degrees()
    )]
    Worse { before_rad: f64, after_rad: f64 },
}

#[derive(Debug, thiserror::Error)]
pub enum TuneError {
    #[error(transparent)]
    Bench(#[from] BenchError),
    #[error(transparent)]
    Refused(#[from] Refusal),
}

#[derive(Debug)]
pub struct Tuned {
    pub findings: Findings,
    pub scenario: JointLoaded,
    estimate: Estimate,
    records: Vec<Record>,
    before: Checked,
    after: Checked,
}

/// Highest pressure of the experiment, [`tune::HIGHEST_PA`] by default \[Pa\].
pub fn highest_pa(config: &JointConfig, asked_pa: Option<f64>) -> Result<f64, OutOfReach> {
    let [a, b] = &config.muscles;
    let of = |muscle| tune::highest_pa(muscle, asked_pa).map(|pa| tune::usable_pa(muscle, pa));
    Ok(of(a)?.min(of(b)?))
}

/// Duration of experiment and checks \[s\].
pub fn duration_s(loaded: &JointLoaded, highest_pa: f64) -> f64 {
    Plan::new(&loaded.config(), highest_pa, SLIDING_M_S).duration_s() + 2.0 * check::duration_s()
}

/// Runs the experiment for a scenario, up to `highest_pa`, fits the values and checks them. The board vents afterwards.
/// It keeps the tuned values, or gets the former ones back if the joint follows less closely with the tuned ones.
pub fn tune_on(
    loaded: &JointLoaded,
    highest_pa: f64,
    bench: &mut dyn Bench,
) -> Result<Tuned, TuneError> {
    for muscle in &loaded.config().muscles {
        tune::refuse_without_pulses(muscle).map_err(Refusal::from)?;
    }
    let result = tried(loaded, highest_pa, bench);
    // In any case the joint is not left under pressure, and values that are no better are not left on the board.
    let vented = match &result {
        Ok(tuned) if tuned.findings.adopted => bench.leave(Left::Found(&tuned.scenario.config())),
        _ => bench.leave(Left::Former(&loaded.config())),
    };
    let tuned = result?;
    vented.map_err(BenchError::Board)?;
    Ok(tuned)
}

fn tried(loaded: &JointLoaded, highest_pa: f64, bench: &mut dyn Bench) -> Result<Tuned, TuneError> {
    let plan = Plan::new(&loaded.config(), highest_pa, SLIDING_M_S);
    let course = |time_s: f64| plan.motion(time_s);
    let records =
        experiment::record(loaded, (&course, plan.duration_s()), bench).map_err(refused)?;
    let [low, high] = ends(records.iter().map(|record| record.angle_rad));
    let asked_rad = plan.ends_rad[1] - plan.ends_rad[0];
    let moved_rad = (high - low).max(0.0);
    if moved_rad < MOVED * asked_rad {
        return Err(Refusal::NotMoved { moved_rad, asked_rad }.into());
    }
    let estimate = findings::estimate(loaded, plan.sliding_rad_s, &records)?;
    let scenario = adopt(loaded, &estimate.parameters(loaded))?;
    let before = check::check(loaded, &plan, bench).map_err(refused)?;
    let after = check::check(&scenario, &plan, bench).map_err(refused)?;
    let [before_rad, after_rad] = [&before, &after].map(|checked| checked.figures.sine_rms_rad);
    if after_rad > WORSE_RAD.max(WORSE * before_rad) {
        return Err(Refusal::Worse { before_rad, after_rad }.into());
    }
    let values = Values::new(loaded, &estimate, &records);
    let findings = Findings::new(values, [&before, &after]);
    Ok(Tuned { findings, scenario, estimate, records, before, after })
}

/// Faults are a refusal; if only the torque is unexplained, the configured values may be the cause.
fn refused(error: BenchError) -> TuneError {
    match error {
        BenchError::Vented(faults) if faults == "joint: torque" => Refusal::Torque(faults).into(),
        BenchError::Vented(faults) => Refusal::Faulty(faults).into(),
        other => other.into(),
    }
}

/// Configures the core with the values.
fn adopt(loaded: &JointLoaded, parameters: &[Parameter]) -> Result<JointLoaded, Refusal> {
    let mut scenario = loaded.clone();
    let joint = &mut scenario.believed;
    for Parameter { path, before, after, .. } in parameters {
        let (path, value) = (*path, *after);
        let allowed = limits(path);
        if !allowed.contains(value) {
            return Err(Refusal::OutOfRange { path, value, allowed: allowed.to_string() });
        }
        match path {
            "joint.inertia_kg_m2" => joint.inertia_kg_m2 = value,
            "joint.gravity_n_m" => joint.gravity_n_m = value,
            "joint.gravity_angle_rad" => joint.gravity_angle_rad = value,
            "joint.viscous_n_m_s" => joint.viscous_n_m_s = value,
            "joint.friction_n_m" => joint.friction_n_m = value,
            "joint.mid_length_a_m" => joint.mid_length_a_m = value,
            "joint.mid_length_b_m" => joint.mid_length_b_m = value,
            "joint.radius_m" => {}
            _ => {
                for muscle in &mut scenario.muscles {
                    let own = muscle.believed.friction.force_n * value / before;
                    muscle.believed = with_numbers(&muscle.believed, [(FRICTION, own)]);
                }
            }
        }
    }
    scenario.config().check().map_err(|error| Refusal::Together(error.to_string()))?;
    Ok(scenario)
}
