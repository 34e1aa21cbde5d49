//! `thermyo board PORT drive`: a whole run on a board that samples its own muscle, recorded like a simulated one.
//!
//! ```text
//! profile --set points, a little ahead--> board --telemetry of every step--> trace, summary, page
//! ```
//!
//! The core restarts with the first set point, so that the record replays from its step 0 on.

mod bench;
pub mod joint;
mod muscle;
mod page;
mod record;
mod summary;

pub use bench::LiveBench;
pub use muscle::Gathered;
pub use record::{ConfigOf, Record, SetPointOf, TelemetryOf};
pub use summary::{Driven, driven};

use model_core::{Faults, SetPoint, Telemetry};
use std::io;
use std::mem::discriminant;
use std::path::{Path, PathBuf};
use thermyo_boards::live::{LiveBoard, VIEW_DIVIDER};
use thermyo_boards::subject::Subject;
use thermyo_files::input::{InputError, Problem};
use thermyo_files::table::{Table, read_table};
use thermyo_protocol::Status;
use thermyo_scenario::DriveKind;
use thermyo_scenario::profile::Profile;
use thermyo_setup::core_config::core_config;
use thermyo_setup::from_config::ConfigScenario;
use thermyo_setup::{Loaded, SET_POINT_COLUMNS, set_points, set_points_in};
use thermyo_simulation::board::BoardError;
use thermyo_simulation::run::{RunError, SetPoints};

/// Steps by which a set point is sent ahead of its time, to cover the delay of the link.
const LEAD_STEPS: u64 = 5;

/// Excess over ambient below which a muscle has vented, a part of the sensors' error \[Pa\].
const VENTED_PA: f32 = 3.0e3;
/// Fall of the reading \[Pa\], and number of steps: a muscle that falls by less in that many steps vents no further.
const STILL_PA: f32 = 200.0;
const STILL_STEPS: u32 = 500;

#[derive(Debug, thiserror::Error)]
pub enum DriveError {
    /// The board can no longer be used, or vents.
    #[error(transparent)]
    Board(#[from] BoardError),
    #[error("the record cannot be written: {0}")]
    Output(io::Error),
}

impl From<DriveError> for RunError {
    fn from(error: DriveError) -> Self {
        match error {
            DriveError::Board(error) => Self::Board(error),
            DriveError::Output(error) => Self::Output(error),
        }
    }
}

/// Called with every step that a board sends, and its last status.
pub type Each<'a, T> = &'a mut dyn FnMut(&T, Option<&Status>) -> io::Result<()>;

/// End of a run without a venting fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    Whole,
    /// Stopped early by the user.
    Stopped,
}

/// Scenario to drive: the profile of a file, on the muscle in the board's configuration. The whole profile is within
/// the limits of that board: up to `armed_pa`, if it is not armed first. `kind` is the quantity of a column `value`.
///
/// # Errors
/// [`InputError`] for a file that is neither a scenario nor a table with a set point, and for a value
/// that the board would refuse.
pub fn plan(
    file: &Path,
    kind: Option<DriveKind>,
    board: &ConfigScenario,
    armed_pa: Option<f32>,
) -> Result<Loaded, InputError> {
    let mut driven = board.scenario.clone();
    if file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("csv")) {
        let table = read_table(file)?;
        driven.plant.drive.kind = kind_of(&table, kind)?;
        let profile = set_points_in(&table, &driven.plant)?;
        driven.plant.run.duration_s = end_s(&table, &profile, driven.plant.run.step_s)?;
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
    check(file, &driven, armed_pa)?;
    driven.plant.run.log_every = 1;
    if driven.drive_profile.is_some() {
        // The profile lies beside the scenario in the record's folder.
        driven.plant.drive.profile_csv = Some(PathBuf::from("profile.csv"));
    }
    driven.believed.run = driven.plant.run.clone();
    driven.believed.drive = driven.plant.drive.clone();
    Ok(driven)
}

/// Longest drive \[s\], the limit of `run.duration_s`.
const LONGEST_S: f64 = 1e6;

/// Time from the start to the end of a table of set points.
fn end_s(table: &Table, profile: &Profile, step_s: f64) -> Result<f64, InputError> {
    let end_s = profile.points().last().map_or(0.0, |point| point.0);
    if end_s > 0.5 * step_s && end_s <= LONGEST_S {
        return Ok(end_s);
    }
    let why =
        format!("ends at {end_s:?} s: must end after 0 s, where the drive begins, and by 1e6 s");
    Err(table.header_error(Problem::UnusableColumn { column: "time_s".to_owned(), why }))
}

/// The drive of a table: from the name of its column, or `kind` for a column `value`.
fn kind_of(table: &Table, kind: Option<DriveKind>) -> Result<DriveKind, InputError> {
    let has = |name: &str| table.columns().iter().any(|column| column.name == name);
    let mut columns = SET_POINT_COLUMNS.iter().filter(|(name, _)| has(name));
    let named = columns.next();
    if let (Some((first, _)), Some((other, _))) = (named, columns.next()) {
        let why = format!("has set points in {first} and in {other}: must have one of them");
        return Err(table.header_error(Problem::Unusable(why)));
    }
    let named = named.map(|(_, kind)| *kind);
    let names = SET_POINT_COLUMNS.map(|(name, _)| name).join(", ");
    named.or(kind).ok_or_else(|| {
        let why = format!("of which quantity? Name it {names}, or give --kind");
        table.header_error(if has("value") {
            Problem::UnusableColumn { column: "value".to_owned(), why }
        } else {
            Problem::Unusable(format!("needs a column of set points: one of {names}"))
        })
    })
}

/// Checks that all set points are within the board's configuration, and within the pressure for which it is armed.
fn check(file: &Path, driven: &Loaded, armed_pa: Option<f32>) -> Result<(), InputError> {
    let drive = &driven.plant.drive;
    let Some((name, _)) = SET_POINT_COLUMNS.iter().find(|(_, kind)| *kind == drive.kind) else {
        return Ok(());
    };
    let (mut allowed, mut why) = set_points(&driven.plant);
    if let Some(armed_pa) = armed_pa.map(f64::from).filter(|_| drive.kind == DriveKind::Pressure)
        && armed_pa < allowed.max
    {
        (allowed.max, why) = (armed_pa, "as the board is armed");
    }
    let points = SetPoints::new(driven).extremes();
    let Some((time_s, value)) = points.iter().find(|(_, value)| !allowed.contains(*value)) else {
        return Ok(());
    };
    let problem = Problem::NotAllowed {
        key: (*name).to_owned(),
        value: format!("{value} at {time_s} s"),
        allowed: format!("{allowed}, {why}"),
    };
    Err(InputError::file(file, problem))
}

/// Drives a board and calls `each` with every step. The board vents afterwards in any case.
/// `wanted` returns whether to stop early.
///
/// # Errors
/// [`DriveError`], also if a fault vented.
pub fn drive(
    board: &mut LiveBoard,
    driven: &Loaded,
    wanted: &dyn Fn() -> bool,
    each: Each<'_, Telemetry>,
) -> Result<Ended, DriveError> {
    follow(board, &MuscleCourse::new(driven), wanted, each)
}

/// Set points over the steps of a drive.
pub trait Course<P> {
    fn steps(&self) -> u64;

    /// Ambient pressure in the board's configuration \[Pa\].
    fn ambient_pa(&self) -> f32;

    /// The set point of step 0.
    fn first(&self) -> P;

    /// The set point that begins at a step, if any.
    fn acting_from(&self, step: u64) -> Option<P>;
}

/// The set points of a scenario.
pub struct MuscleCourse<'a> {
    set_points: SetPoints,
    driven: &'a Loaded,
}

impl<'a> MuscleCourse<'a> {
    pub fn new(driven: &'a Loaded) -> Self {
        Self { set_points: SetPoints::new(driven), driven }
    }
}

impl Course<SetPoint> for MuscleCourse<'_> {
    fn steps(&self) -> u64 {
        self.driven.plant.run.steps()
    }

    fn ambient_pa(&self) -> f32 {
        self.driven.believed.ambient.pressure_pa as f32
    }

    fn first(&self) -> SetPoint {
        self.set_points.at(0.0)
    }

    fn acting_from(&self, step: u64) -> Option<SetPoint> {
        self.set_points.acting_from(step, self.driven)
    }
}

/// Drives a board along a course and calls `each` with every step; as [`drive`].
pub fn follow<B: Subject>(
    board: &mut B,
    course: &dyn Course<B::SetPoint>,
    wanted: &dyn Fn() -> bool,
    each: Each<'_, B::Telemetry>,
) -> Result<Ended, DriveError> {
    board.telemetry_every(1)?;
    let outcome = along(board, course, wanted, each);
    // A lost link is reported only once.
    let stopped = board.stop().and_then(|()| board.telemetry_every(VIEW_DIVIDER));
    outcome.and_then(|ended| Ok(stopped.map(|()| ended)?))
}

/// Waits until every driven muscle has vented: to ambient, or to where the reading stays. Returns false if it is
/// stopped meanwhile.
fn vented<B: Subject>(
    board: &mut B,
    ambient_pa: f32,
    wanted: &dyn Fn() -> bool,
) -> Result<bool, DriveError> {
    board.vent()?;
    // The lowest reading and its step; a board that has restarted counts from 0 again.
    let mut lowest = (f32::INFINITY, 0);
    while !wanted() {
        let Some(telemetry) = board.poll()? else { continue };
        let (pressure_pa, step) = (B::pressure_pa(&telemetry), B::step(&telemetry));
        if pressure_pa < lowest.0 - STILL_PA || step < lowest.1 {
            lowest = (pressure_pa, step);
        }
        if pressure_pa <= ambient_pa + VENTED_PA || step - lowest.1 >= STILL_STEPS {
            return Ok(true);
        }
    }
    Ok(false)
}

fn along<B: Subject>(
    board: &mut B,
    course: &dyn Course<B::SetPoint>,
    wanted: &dyn Fn() -> bool,
    each: Each<'_, B::Telemetry>,
) -> Result<Ended, DriveError> {
    let steps = course.steps();
    if !vented(board, course.ambient_pa(), wanted)? {
        return Ok(Ended::Stopped);
    }
    board.start(course.first())?;
    let mut reported = 0;
    let mut asked = None;
    loop {
        if wanted() {
            return Ok(Ended::Stopped);
        }
        let Some(telemetry) = board.poll()? else { continue };
        if B::is_checking(&telemetry) {
            continue;
        }
        let status = board.last_status();
        each(&telemetry, status.as_ref()).map_err(DriveError::Output)?;
        let faults = B::venting(&telemetry);
        if faults != Faults::NONE {
            return Err(BoardError::Vented(faults).into());
        }
        let step = u64::from(B::step(&telemetry));
        if step >= steps {
            return Ok(Ended::Whole);
        }
        if let Some(sequence) = asked {
            board.check(sequence)?;
        }
        // After a delay the host sends only the current set point; all missed ones would flood the board.
        if board.is_behind() {
            continue;
        }
        let last = (step + LEAD_STEPS).min(steps);
        let missed = (reported + 1..=last).rev();
        if let Some(set_point) = missed.filter_map(|at| course.acting_from(at)).next() {
            asked = Some(board.send(set_point)?);
        }
        reported = reported.max(last);
    }
}
