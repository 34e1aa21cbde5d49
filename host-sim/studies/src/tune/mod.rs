//! `thermyo tune`: a short experiment on a board, and from it friction, force area, valves and gains.
//!
//! ```text
//! configured scenario --experiment--> records --force--> friction, bladder, force area and volume
//!                                       --valve--> conductance, delay, switching time
//!                                                  --gains--> controller     --check--> before, after
//! ```
//!
//! Only telemetry is looked at, so that a board with a muscle of its own can be tuned as a simulated
//! one. What the core believes is changed, never the plant. `docs/background/tuning.md` tells the whole.

mod check;
mod experiment;
mod findings;
mod force;
mod gains;
mod page;
mod regression;
mod valve;

pub use check::Figures;
pub use experiment::{Bench, HIGHEST_PA, Simulated};
pub use findings::{Findings, Parameter};
pub use page::{check_chart, page};

use check::Checked;
use experiment::{Plan, Record, during};
use force::Force;
use gains::{Basis, LoopGains, Noise};
use model_core::{Config, Faults};
use std::path::Path;
use thermyo_files::input::{InputError, Problem};
use thermyo_plant::chamber;
use thermyo_plant::chamber::Tunable;
use thermyo_scenario::schema::limits;
use thermyo_scenario::{DriveKind, PlantModel, number, with_numbers};
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::board::Board;
use thermyo_simulation::run::RunError;
use valve::{Direction, Gas};

/// Largest error of the pressure on the ramps, RMS, share of its range: the loop follows.
const LARGEST_ERROR: f64 = 0.05;
/// The highest pressure counts as reached within this share of the range.
const REACHED: f64 = 0.05;
/// Least motion, share of the rest length.
const LEAST_MOTION: f64 = 0.05;
/// A check that follows worse than before by this factor, and worse than [`WORSE_PERCENT`], says that
/// the tuned values are wrong.
const WORSE: f64 = 1.5;
/// See [`WORSE`]; RMS error of the sine in percent of the stroke.
const WORSE_PERCENT: f64 = 1.0;

/// A highest pressure that the configured muscle is never given.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "a highest pressure of {asked_pa:?} Pa: must be from {least_pa} Pa (ambient) to {most_pa} Pa (the supply, or \
     what set points are followed to), as configured"
)]
pub struct OutOfReach {
    /// \[Pa\]
    asked_pa: f64,
    /// \[Pa\]
    least_pa: f32,
    /// \[Pa\]
    most_pa: f32,
}

/// Highest pressure of the experiment: [`HIGHEST_PA`] where none is asked for \[Pa\].
///
/// # Errors
/// [`OutOfReach`]
pub fn highest_pa(config: &Config, asked_pa: Option<f64>) -> Result<f64, OutOfReach> {
    let Some(asked_pa) = asked_pa else { return Ok(HIGHEST_PA) };
    let least_pa = config.ambient.pressure_pa;
    let most_pa = config.supply.pressure_pa.min(config.working_limit_pa());
    if (f64::from(least_pa)..=f64::from(most_pa)).contains(&asked_pa) {
        Ok(asked_pa)
    } else {
        Err(OutOfReach { asked_pa, least_pa, most_pa })
    }
}

/// Why nothing was tuned, though it could be tried.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// The load is a length.
    #[error(
        "load.kind = \"isometric\": nothing moves, so that friction cannot be seen; tune with the load \
         that is going to be moved"
    )]
    NothingMoves,
    /// What is allowed does not move the configured muscle.
    #[error(
        "the configured muscle needs {:.0} kPa to move by 9 % against its load, and at most {:.0} kPa are \
         allowed (--max-pressure, 85 % of the supply, 90 % of the sensor's limit)",
        needed_pa / 1e3, highest_pa / 1e3
    )]
    NoRange {
        /// What is allowed \[Pa\].
        highest_pa: f64,
        /// What is needed \[Pa\].
        needed_pa: f64,
    },
    /// A sensor failed, or the emergency stop was pressed.
    #[error("faults during the experiment: {0}")]
    Faulty(Faults),
    /// The pressure stayed below what was asked for.
    #[error(
        "the pressure reached {:.0} kPa where {:.0} kPa were asked for: the supply is too low, or the \
         valve too small",
        reached_pa / 1e3, asked_pa / 1e3
    )]
    NotReached {
        /// Highest measured \[Pa\].
        reached_pa: f64,
        /// Highest set point \[Pa\].
        asked_pa: f64,
    },
    /// The pressure did not follow.
    #[error(
        "the pressure loop does not follow the ramps: {:.1} kPa RMS from the set point, at most {:.1} kPa \
         are allowed",
        rms_pa / 1e3, limit_pa / 1e3
    )]
    LoopOpen {
        /// RMS error \[Pa\].
        rms_pa: f64,
        /// What is allowed \[Pa\].
        limit_pa: f64,
    },
    /// The muscle hardly moved.
    #[error(
        "the muscle moved by {:.1} mm on a ramp, at least {:.1} mm are needed: is the load too heavy, or \
         the length sensor stuck?",
        moved_m * 1e3, needed_m * 1e3
    )]
    NotMoved {
        /// Smallest span of the measured length on a ramp \[m\].
        moved_m: f64,
        /// What is needed \[m\].
        needed_m: f64,
    },
    /// Too little of the motion was even.
    #[error(
        "the balance of forces cannot be fitted to the {points} stretches of 50 ms in which the muscle \
         slid evenly: they are too few or too alike, or the configured load is 0"
    )]
    TooFew {
        /// Stretches.
        points: usize,
    },
    /// Friction is lost in scatter.
    #[error(
        "too noisy: friction stands out of the scatter by {signal:.1} standard errors, at least \
         {:.0} are needed (residual force {rms_n:.1} N RMS)",
        force::LEAST_SIGNAL
    )]
    Noisy {
        /// Friction over its standard error.
        signal: f64,
        /// RMS residual \[N\].
        rms_n: f64,
    },
    /// No step opened a valve fully.
    #[error(
        "no step kept the {valve} open for 30 ms: it is too large for this muscle to tell its conductance"
    )]
    NoSteps {
        /// Which one.
        valve: &'static str,
    },
    /// A value that no scenario may have.
    #[error("{path} came out as {value:.4e}: must be {allowed}")]
    OutOfRange {
        /// The key.
        path: &'static str,
        /// What came out.
        value: f64,
        /// What is allowed.
        allowed: String,
    },
    /// The check says that the values are wrong.
    #[error(
        "with the tuned values the muscle follows worse: {after:.2} % of the stroke RMS on the check's \
         sine, {before:.2} % before"
    )]
    Worse {
        /// RMS error before \[%\].
        before: f64,
        /// RMS error after \[%\].
        after: f64,
    },
}

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
pub enum TuneError {
    /// The scenario cannot be tuned.
    #[error(transparent)]
    Input(#[from] InputError),
    /// A run ended before its time.
    #[error("{0}")]
    Run(RunError),
    /// The data is not good enough.
    #[error(transparent)]
    Refused(#[from] Refusal),
}

impl From<RunError> for TuneError {
    fn from(error: RunError) -> Self {
        Self::Run(error)
    }
}

/// What a tuning gives.
#[derive(Debug)]
pub struct Tuned {
    /// The figures.
    pub findings: Findings,
    /// The scenario, the core configured with the tuned values.
    pub scenario: Loaded,
    records: Vec<Record>,
    plan: Plan,
    force: Force,
    before: Checked,
    after: Checked,
}

/// How long the checks take that follow the experiment \[s\].
pub fn checks_s() -> f64 {
    2.0 * check::duration_s()
}

/// [`tune_on`] a board with a simulated muscle.
///
/// # Errors
/// [`TuneError`]
pub fn tune(
    loaded: &Loaded,
    file: &Path,
    highest_pa: f64,
    board: &mut dyn Board,
) -> Result<Tuned, TuneError> {
    tune_on(loaded, file, highest_pa, &mut Simulated(board))
}

/// Runs the experiment for a scenario, fits, and checks. `file` is what messages call the scenario;
/// no more than `highest_pa` is asked for. The board is left venting.
///
/// # Errors
/// [`TuneError`]
pub fn tune_on(
    loaded: &Loaded,
    file: &Path,
    highest_pa: f64,
    bench: &mut dyn Bench,
) -> Result<Tuned, TuneError> {
    let refused = |why: &str| {
        let kind = loaded.plant.plant.kind.word();
        InputError::file(
            file,
            Problem::NotAllowed {
                key: "plant.kind".to_owned(),
                value: format!("\"{kind}\""),
                allowed: why.to_owned(),
            },
        )
    };
    let Some(chamber) = chamber::of(&loaded.believed) else {
        return Err(refused("another one: a vessel has neither friction nor a load").into());
    };
    let Some(tunable) = chamber.tunable() else {
        return Err(
            refused("another one: area and stiffness of this one have been measured").into()
        );
    };
    let config = core_config(&loaded.believed);
    let plan = Plan::new(&config, highest_pa)?;
    let result = tried(loaded, plan, (chamber.rest_length(), tunable), bench);
    // Whatever happened, the muscle is not left under pressure.
    let vented = bench.vent(&config);
    let tuned = result?;
    vented.map_err(RunError::Board)?;
    Ok(tuned)
}

fn tried(
    loaded: &Loaded,
    plan: Plan,
    (rest_m, tunable): (f64, Tunable),
    bench: &mut dyn Bench,
) -> Result<Tuned, TuneError> {
    let config = core_config(&loaded.believed);
    let records = experiment::record(loaded, DriveKind::Pressure, plan.profile.clone(), bench)?;
    let contractions = good_enough(&records, &plan, rest_m)?;
    let force = force::fit(&records, &plan, &config)?;

    let mut scenario = with_force(loaded, &force, &tunable);
    let config = core_config(&scenario.believed);
    let (chamber, _) = experiment::configured(&config)?;
    let gas = Gas::new(&config, &chamber);
    let steps =
        |direction, valve| gas.steps(&records, &plan, direction).ok_or(Refusal::NoSteps { valve });
    let [inlet, outlet] = [steps(Direction::In, "inlet")?, steps(Direction::Out, "outlet")?];
    let conductances = [inlet.conductance.value, outlet.conductance.value];
    // Every other plant has ideal valves, and the core is configured so.
    let switching = loaded.believed.plant.model == PlantModel::Full;
    let switch_time_s =
        switching.then(|| gas.switch_time_s(&records, &plan, conductances)).flatten();
    // Of the outlet: while the inlet opens, the regulator behind it gives way, which looks like a
    // shorter delay.
    let delay_s = outlet.delay_s;
    let basis = Basis {
        delay_s,
        area_scale: force.area_scale,
        noise: Noise::new(during(&records, &plan.rest_s)),
        smallest: plan.contractions[0],
    };
    let gains = LoopGains::new(&basis, &config, &chamber);
    let parts = findings::Parts {
        configured: loaded,
        force: &force,
        tunable,
        steps: [inlet, outlet],
        switching,
        switch_time_s,
        delay_s,
        gains: &gains,
    };
    let parameters = parts.parameters();
    adopt(&mut scenario, &parameters)?;

    let before = check::check(loaded, contractions, rest_m, bench)?;
    let after = check::check(&scenario, contractions, rest_m, bench)?;
    let rms = |checked: &Checked| checked.figures.sine_rms_percent;
    if rms(&after) > WORSE_PERCENT.max(WORSE * rms(&before)) {
        return Err(Refusal::Worse { before: rms(&before), after: rms(&after) }.into());
    }
    let findings = Findings::new(parameters, &records, &force, &basis, [&before, &after]);
    Ok(Tuned { findings, scenario, records, plan, force, before, after })
}

/// Whether the records can be fitted at all; the contractions that were reached.
fn good_enough(records: &[Record], plan: &Plan, rest_m: f64) -> Result<[f64; 2], Refusal> {
    let faults = records.iter().fold(Faults::NONE, |all, record| all.with(record.faults));
    if faults != Faults::NONE {
        return Err(Refusal::Faulty(faults));
    }
    let ramps = during(records, &plan.ramps_s);
    let [low_pa, high_pa] = plan.pressures_pa;
    let range_pa = high_pa - low_pa;
    let reached_pa = ramps.iter().map(|record| record.pressure_pa).fold(0.0, f64::max);
    if reached_pa < high_pa - REACHED * range_pa {
        return Err(Refusal::NotReached { reached_pa, asked_pa: high_pa });
    }
    let square: f64 =
        ramps.iter().map(|record| (record.pressure_pa - record.set_point).powi(2)).sum();
    let rms_pa = (square / ramps.len() as f64).sqrt();
    let limit_pa = LARGEST_ERROR * range_pa;
    if rms_pa > limit_pa {
        return Err(Refusal::LoopOpen { rms_pa, limit_pa });
    }
    // On every ramp: a length that is stuck for a while only would look like friction.
    let needed_m = LEAST_MOTION * rest_m;
    for ramp in &plan.ramps {
        let [shortest_m, longest_m] = lengths_m(during(records, &ramp.time_s));
        let moved_m = longest_m - shortest_m;
        if moved_m < needed_m {
            return Err(Refusal::NotMoved { moved_m, needed_m });
        }
    }
    let [shortest_m, longest_m] = lengths_m(ramps);
    Ok([1.0 - longest_m / rest_m, 1.0 - shortest_m / rest_m])
}

fn lengths_m(records: &[Record]) -> [f64; 2] {
    records
        .iter()
        .map(|record| record.length_m)
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[shortest, longest], length| {
            [shortest.min(length), longest.max(length)]
        })
}

/// The chamber with the force area that was found.
fn with_force(loaded: &Loaded, force: &Force, tunable: &Tunable) -> Loaded {
    let mut other = loaded.clone();
    let scaled = tunable.area.iter().filter_map(|(path, power)| {
        Some((*path, number(&loaded.believed, path)? * force.area_scale.value.powf(*power)))
    });
    other.believed = with_numbers(&loaded.believed, scaled);
    other
}

/// Tells the core the values.
fn adopt(scenario: &mut Loaded, parameters: &[Parameter]) -> Result<(), Refusal> {
    for Parameter { path, after, .. } in parameters {
        let allowed = limits(path);
        if !allowed.contains(*after) {
            let allowed = allowed.to_string();
            return Err(Refusal::OutOfRange { path, value: *after, allowed });
        }
    }
    let values = || parameters.iter().map(|parameter| (parameter.path, parameter.after));
    scenario.believed = with_numbers(&scenario.believed, values());
    // The controller is the core's own: it has no truth to differ from.
    let gains = values().filter(|(path, _)| path.starts_with("controller."));
    scenario.plant = with_numbers(&scenario.plant, gains);
    Ok(())
}
