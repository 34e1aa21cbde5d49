//! `thermyo board PORT drive`: a whole run on a board that samples its own muscle, recorded as a simulated one.
//!
//! ```text
//! profile --set points, a little ahead--> board --telemetry of every step--> trace, summary, page
//! ```
//!
//! The core restarts with the first set point, so that the record replays from its step 0 on.

mod bench;
mod page;
mod summary;

pub use bench::LiveBench;
pub use page::{Drawn, page};
pub use summary::{Driven, Gathered};

use model_core::control::Mode;
use model_core::link::Status;
use model_core::safety::supervisor::VENTING;
use model_core::{Faults, Telemetry};
use std::io;
use std::mem::discriminant;
use std::path::{Path, PathBuf};
use thermyo_boards::live::{LiveBoard, VIEW_DIVIDER};
use thermyo_files::input::{InputError, Problem};
use thermyo_files::table::read_table;
use thermyo_scenario::DriveKind;
use thermyo_scenario::profile::Profile;
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_setup::from_config::ConfigScenario;
use thermyo_simulation::board::BoardError;
use thermyo_simulation::run::SetPoints;

/// Steps by which a set point is sent ahead of its time, to cover the delay of the link.
const LEAD_STEPS: u64 = 5;

/// Columns of a profile, and the drive of each.
const PROFILES: [(&str, DriveKind); 4] = [
    ("pressure_pa", DriveKind::Pressure),
    ("contraction", DriveKind::Contraction),
    ("flow_kg_s", DriveKind::MassFlow),
    ("duty", DriveKind::Duty),
];

#[derive(Debug, thiserror::Error)]
pub enum DriveError {
    /// The board cannot be used any more, or vents.
    #[error(transparent)]
    Board(#[from] BoardError),
    #[error("the record cannot be written: {0}")]
    Output(io::Error),
}

/// End of a run without a venting fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    Whole,
    /// Stopped early by the user.
    Stopped,
}

/// Scenario to drive: the profile of a file, on the muscle that the board was configured with.
///
/// # Errors
/// [`InputError`] for a file that is neither a scenario nor a table with a set point.
pub fn plan(file: &Path, board: &ConfigScenario) -> Result<Loaded, InputError> {
    let mut driven = board.scenario.clone();
    if file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv")) {
        let table = read_table(file)?;
        let names: Vec<&str> = table.columns().iter().map(|column| column.name.as_str()).collect();
        let found = PROFILES.iter().find(|(name, _)| names.contains(name));
        let (name, kind) = *found.unwrap_or(&PROFILES[0]);
        let points = table.filled("time_s")?.into_iter().zip(table.filled(name)?).collect();
        let profile = Profile::new(points)
            .map_err(|error| table.header_error(Problem::Unreadable(error.to_string())))?;
        driven.plant.run.duration_s = profile.points().last().map_or(0.0, |point| point.0);
        driven.plant.drive.kind = kind;
        driven.drive_profile = Some(profile);
    } else {
        let loaded = thermyo_setup::load(file)?;
        let kinds = [&loaded, &driven].map(|loaded| core_config(&loaded.believed).chamber);
        if discriminant(&kinds[0]) != discriminant(&kinds[1]) {
            let problem = Problem::NotAllowed {
                key: "plant.kind".to_owned(),
                value: format!("{:?}", loaded.plant.plant.kind.word()),
                allowed: format!(
                    "what the board was configured with, {:?}",
                    driven.plant.plant.kind.word()
                ),
            };
            return Err(InputError::file(file, problem));
        }
        driven.plant.run.duration_s = loaded.plant.run.duration_s;
        driven.plant.drive = loaded.plant.drive.clone();
        driven.drive_profile = loaded.drive_profile;
    }
    above_ambient(file, &driven)?;
    driven.plant.run.log_every = 1;
    if driven.drive_profile.is_some() {
        // The profile lies beside the scenario in the record's folder.
        driven.plant.drive.profile_csv = Some(PathBuf::from("profile.csv"));
    }
    driven.believed.run = driven.plant.run.clone();
    driven.believed.drive = driven.plant.drive.clone();
    Ok(driven)
}

/// The set points must not be below the ambient pressure of the board's configuration.
fn above_ambient(file: &Path, driven: &Loaded) -> Result<(), InputError> {
    let drive = &driven.plant.drive;
    let points = driven.drive_profile.as_ref().map_or_else(Vec::new, |of| of.points().to_vec());
    let values = points.iter().map(|point| point.1);
    let lowest_pa = values.reduce(f64::min).unwrap_or(drive.pressure_pa);
    let ambient_pa = driven.plant.ambient.pressure_pa;
    if drive.kind != DriveKind::Pressure || lowest_pa >= ambient_pa {
        return Ok(());
    }
    let problem = Problem::NotAllowed {
        key: "pressure_pa".to_owned(),
        value: lowest_pa.to_string(),
        allowed: format!("at least {ambient_pa} Pa, ambient as the board is configured"),
    };
    Err(InputError::file(file, problem))
}

/// Drives a board and calls `each` with every step. The board vents afterwards in any case.
/// `wanted` returns whether to stop early.
///
/// # Errors
/// [`DriveError`], also where a fault vented.
pub fn drive(
    board: &mut LiveBoard,
    driven: &Loaded,
    wanted: &dyn Fn() -> bool,
    each: &mut dyn FnMut(&Telemetry, Option<&Status>) -> io::Result<()>,
) -> Result<Ended, DriveError> {
    board.telemetry_every(1)?;
    let outcome = along(board, driven, wanted, each);
    // A lost link is reported only once.
    let stopped = board.stop().and_then(|()| board.telemetry_every(VIEW_DIVIDER));
    outcome.and_then(|ended| Ok(stopped.map(|()| ended)?))
}

fn along(
    board: &mut LiveBoard,
    driven: &Loaded,
    wanted: &dyn Fn() -> bool,
    each: &mut dyn FnMut(&Telemetry, Option<&Status>) -> io::Result<()>,
) -> Result<Ended, DriveError> {
    let steps = driven.plant.run.steps();
    let set_points = SetPoints::new(driven);
    board.start(set_points.at(0.0))?;
    let mut reported = 0;
    let mut asked = None;
    loop {
        if wanted() {
            return Ok(Ended::Stopped);
        }
        let Some(telemetry) = board.poll()? else { continue };
        if telemetry.mode == Mode::Judging {
            continue;
        }
        let status = board.last_status();
        each(&telemetry, status.as_ref()).map_err(DriveError::Output)?;
        let faults = telemetry.faults.of(VENTING);
        if faults != Faults::NONE {
            return Err(BoardError::Vented(faults).into());
        }
        let step = u64::from(telemetry.step);
        if step >= steps {
            return Ok(Ended::Whole);
        }
        if let Some(sequence) = asked {
            board.check(sequence)?;
        }
        // After a delay the host sends only the current set point, not all that it has missed: they
        // would flood the board.
        if board.is_behind() {
            continue;
        }
        let last = (step + LEAD_STEPS).min(steps);
        let missed = (reported + 1..=last).rev();
        if let Some(set_point) = missed.filter_map(|at| set_points.acting_from(at, driven)).next() {
            asked = Some(board.send(set_point)?);
        }
        reported = reported.max(last);
    }
}
