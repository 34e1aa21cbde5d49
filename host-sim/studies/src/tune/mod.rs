//! `thermyo tune`: friction, force area, valves and gains from a short experiment on a board.
//!
//! ```text
//! configured scenario --experiment--> records --force--> friction, bladder, force area and volume
//!                                       --valve--> conductance, delay, switching time
//!                                                  --gains--> controller     --check--> before, after
//! ```
//!
//! Only telemetry is used, so that a board with a real muscle can be tuned like a simulated one. Only the core's
//! configuration changes, never the plant. See `docs/background/tuning.md`.

pub(crate) mod check;
mod experiment;
mod findings;
mod force;
mod gains;
mod motion;
mod page;
pub(crate) mod regression;
#[cfg(test)]
mod tests;
mod valve;

pub use check::Figures;
pub(crate) use experiment::usable_pa;
pub use experiment::{Bench, HIGHEST_PA, Left, Simulated};
pub use findings::{Findings, Parameter, table};
pub(crate) use findings::{compared, word};
pub(crate) use force::SLIDING_M_S;
pub use motion::{motion_record, motion_values};
pub(crate) use page::{FollowedBy, group, values};
pub use page::{check_chart, page};

use check::Checked;
use experiment::{Plan, Record, during};
use force::Force;
use gains::{Basis, LoopGains, Noise};
use model_core::physics::valve::ValveKind;
use model_core::{Config, Faults};
use std::path::Path;
use thermyo_compute::math::ends;
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

/// Largest RMS error of the pressure on the ramps, as a fraction of its range.
const LARGEST_ERROR: f64 = 0.05;
/// Fraction of the range within which the highest pressure counts as reached.
const REACHED: f64 = 0.05;
/// Least motion, as a fraction of the rest length.
const LEAST_MOTION: f64 = 0.05;
/// The tuned values are wrong if the check's error grows by more than this factor, and exceeds
/// [`WORSE_PERCENT`].
const WORSE: f64 = 1.5;
/// See [`WORSE`]; RMS error of the sine in percent of the stroke.
const WORSE_PERCENT: f64 = 1.0;

/// The requested highest pressure lies outside the limits.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "a highest pressure of {asked_pa:?} Pa: must be from {least_pa} Pa (ambient) to {most_pa} Pa (the supply, or \
     what set points are followed to), as configured"
)]
pub struct OutOfReach {
    asked_pa: f64,
    least_pa: f32,
    most_pa: f32,
}

/// Highest pressure of the experiment, [`HIGHEST_PA`] by default \[Pa\].
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

/// Refuses valves that do not switch.
pub(crate) fn refuse_without_pulses(config: &Config) -> Result<(), Refusal> {
    if config.valve_kind == ValveKind::Switching { Ok(()) } else { Err(Refusal::NoPulses) }
}

/// Hint how an experiment gets the pressure that it needs.
fn more(needed_pa: f64, usable_pa: f64) -> String {
    // Rounded up to a tenth of a bar.
    let asked_bar = (needed_pa / 1e4).ceil() / 10.0;
    if asked_bar * 1e5 <= usable_pa {
        format!("--max-pressure {asked_bar}bar or more, the more its friction takes")
    } else {
        format!(
            "85 % of supply.pressure_pa, and 90 % of the pressure at which the core vents, are no more than \
             {:.0} kPa",
            usable_pa / 1e3
        )
    }
}

/// Reason why the experiment or its data cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    #[error(
        "load.kind = \"isometric\": nothing moves, so that friction cannot be seen; tune with the load \
         that is going to be moved"
    )]
    NothingMoves,
    #[error(
        "valve.kind = \"proportional\": the experiment measures pulses of switching valves; set dead band and \
         bandwidth by the data sheet, and measure the muscle with thermyo identify"
    )]
    NoPulses,
    #[error(
        "the configured muscle needs {:.0} kPa to move by 9 % against its load, and at most {:.0} kPa are \
         allowed: {}",
        needed_pa / 1e3, highest_pa / 1e3, more(*needed_pa, *usable_pa)
    )]
    NoRange {
        highest_pa: f64,
        needed_pa: f64,
        /// Highest pressure that may be allowed \[Pa\].
        usable_pa: f64,
    },
    #[error("faults during the experiment: {0}")]
    Faulty(Faults),
    #[error(
        "the pressure reached {:.0} kPa where {:.0} kPa were asked for: the supply is too low, or the \
         valve too small",
        reached_pa / 1e3, asked_pa / 1e3
    )]
    NotReached {
        reached_pa: f64,
        /// Highest set point \[Pa\].
        asked_pa: f64,
    },
    #[error(
        "the pressure loop does not follow the ramps: {:.1} kPa RMS from the set point, at most {:.1} kPa \
         are allowed: is the valve configured wrong, or too small for them?",
        rms_pa / 1e3, limit_pa / 1e3
    )]
    LoopOpen { rms_pa: f64, limit_pa: f64 },
    #[error(
        "the muscle moved by {:.1} mm on a ramp, at least {:.1} mm are needed: are {:.0} kPa too little for load and \
         friction (--max-pressure), or is the load too light to lengthen the muscle again, or the length sensor stuck?",
        moved_m * 1e3, needed_m * 1e3, highest_pa / 1e3
    )]
    NotMoved {
        /// Smallest span of the measured length on a ramp \[m\].
        moved_m: f64,
        needed_m: f64,
        /// Highest set point \[Pa\].
        highest_pa: f64,
    },
    #[error(
        "the balance of forces cannot be fitted to the {points} stretches of 50 ms in which the muscle \
         slid evenly: they are too few or too alike, or the configured load is 0"
    )]
    TooFew {
        /// Number of intervals of even motion.
        points: usize,
    },
    #[error(
        "too noisy: friction stands out of the scatter by {signal:.1} standard errors, at least \
         {:.0} are needed (residual force {rms_n:.1} N RMS): slip and creep of another muscle leave some \
         newtons too, and `thermyo tune --plan motion` finds them",
        force::LEAST_SIGNAL
    )]
    Noisy {
        /// Friction over its standard error.
        signal: f64,
        rms_n: f64,
    },
    #[error(
        "no step up to {:.0} kPa kept the {valve} open for 30 ms: allow more (--max-pressure), or the valve is too \
         large for this chamber to tell its conductance",
        highest_pa / 1e3
    )]
    NoSteps {
        valve: &'static str,
        /// Highest set point \[Pa\].
        highest_pa: f64,
    },
    #[error("{path} came out as {value:.4e}: must be {allowed}")]
    OutOfRange { path: &'static str, value: f64, allowed: String },
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

#[derive(Debug, thiserror::Error)]
pub enum TuneError {
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Run(#[from] RunError),
    #[error(transparent)]
    Refused(#[from] Refusal),
}

#[derive(Debug)]
pub struct Tuned {
    pub findings: Findings,
    pub scenario: Loaded,
    records: Vec<Record>,
    plan: Plan,
    force: Force,
    before: Checked,
    after: Checked,
}

/// Duration of the checks after the experiment \[s\].
pub fn checks_s() -> f64 {
    2.0 * check::duration_s()
}

/// [`tune_on`] a board with a simulated muscle.
pub fn tune(
    loaded: &Loaded,
    file: &Path,
    highest_pa: f64,
    board: &mut dyn Board,
) -> Result<Tuned, TuneError> {
    tune_on(loaded, file, highest_pa, &mut Simulated { board, stopped: &|| false })
}

/// Runs the experiment for a scenario, up to `highest_pa`, fits the values and checks them. `file` names the scenario
/// in messages. The board vents afterwards. It keeps the tuned values, or gets the former ones back if the muscle
/// follows less closely with the tuned ones.
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
    refuse_without_pulses(&config)?;
    let plan = Plan::new(&config, highest_pa)?;
    let result = tried(loaded, plan, (chamber.rest_length(), tunable), bench);
    // In any case the muscle is not left under pressure, and values that are no better are not left on the board.
    let vented = match &result {
        Ok(tuned) if tuned.findings.adopted => {
            bench.leave(Left::Found(&core_config(&tuned.scenario.believed)))
        }
        _ => bench.leave(Left::Former(&config)),
    };
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
    let [_, highest_pa] = plan.pressures_pa;
    let steps = |direction, valve| {
        gas.steps(&records, &plan, direction).ok_or(Refusal::NoSteps { valve, highest_pa })
    };
    let [inlet, outlet] = [steps(Direction::In, "inlet")?, steps(Direction::Out, "outlet")?];
    let conductances = [inlet.conductance.value, outlet.conductance.value];
    // All other plants have ideal valves, and so does the core's configuration.
    let switching = loaded.believed.plant.model == PlantModel::Full;
    let switch_time_s =
        switching.then(|| gas.switch_time_s(&records, &plan, conductances)).flatten();
    // The outlet's delay, since the supply behind the regulator falls while the inlet opens, which looks like a shorter
    // delay.
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

/// Checks that the records can be fitted; returns the contractions reached.
fn good_enough(records: &[Record], plan: &Plan, rest_m: f64) -> Result<[f64; 2], Refusal> {
    let faults = records.iter().fold(Faults::NONE, |all, record| all.with(record.faults));
    if faults != Faults::NONE {
        return Err(Refusal::Faulty(faults));
    }
    let ramps = during(records, &plan.ramps_s);
    reached(ramps, plan.pressures_pa)?;
    let [low_pa, high_pa] = plan.pressures_pa;
    let range_pa = high_pa - low_pa;
    let square: f64 =
        ramps.iter().map(|record| (record.pressure_pa - record.set_point).powi(2)).sum();
    let rms_pa = (square / ramps.len() as f64).sqrt();
    let limit_pa = LARGEST_ERROR * range_pa;
    if rms_pa > limit_pa {
        return Err(Refusal::LoopOpen { rms_pa, limit_pa });
    }
    // Checked on every ramp: a length that is stuck for part of the time would look like friction.
    let needed_m = LEAST_MOTION * rest_m;
    for ramp in &plan.ramps {
        let [shortest_m, longest_m] = lengths_m(during(records, &ramp.time_s));
        let moved_m = longest_m - shortest_m;
        if moved_m < needed_m {
            return Err(Refusal::NotMoved { moved_m, needed_m, highest_pa: high_pa });
        }
    }
    let [shortest_m, longest_m] = lengths_m(ramps);
    Ok([1.0 - longest_m / rest_m, 1.0 - shortest_m / rest_m])
}

/// Checks that the upper end of a range of pressures was reached.
fn reached(records: &[Record], [low_pa, high_pa]: [f64; 2]) -> Result<(), Refusal> {
    let reached_pa = records.iter().map(|record| record.pressure_pa).fold(0.0, f64::max);
    if reached_pa < high_pa - REACHED * (high_pa - low_pa) {
        return Err(Refusal::NotReached { reached_pa, asked_pa: high_pa });
    }
    Ok(())
}

fn lengths_m(records: &[Record]) -> [f64; 2] {
    ends(records.iter().map(|record| record.length_m))
}

/// The chamber with the fitted force area.
fn with_force(loaded: &Loaded, force: &Force, tunable: &Tunable) -> Loaded {
    let mut other = loaded.clone();
    let scaled = tunable.area.iter().filter_map(|(path, power)| {
        Some((*path, number(&loaded.believed, path)? * force.area_scale.value.powf(*power)))
    });
    other.believed = with_numbers(&loaded.believed, scaled);
    other
}

/// Configures the core with the values.
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
    // The plant has no gains: only the core's configuration changes.
    let gains = values().filter(|(path, _)| path.starts_with("controller."));
    scenario.plant = with_numbers(&scenario.plant, gains);
    Ok(())
}
