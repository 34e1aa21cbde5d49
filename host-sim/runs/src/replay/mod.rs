//! Replays recorded samples through the core and compares its outputs bit by bit.

pub mod joint;
mod muscle;

pub use muscle::{Row, identical, read_record, replay};

use model_core::Telemetry;
use model_core::sample::CODE_MAX;
use model_core::sensing::Sensors;
use std::path::Path;
use thermyo_files::input::InputError;
use thermyo_files::table::Table;
use thermyo_simulation::board::{Board, BoardError};

/// The first step that differs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mismatch {
    pub step: u32,
    pub recorded: String,
    pub replayed: String,
}

#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Replay {
    pub steps: u64,
    /// Number of steps in which at least one bit of a number differs.
    pub mismatches: u64,
    pub first: Option<Mismatch>,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Record {
    Muscle(Box<muscle::Record>),
    Joint(Box<joint::Record>),
}

/// A quantity of a replay's page: its name, its column, and the column of its difference on replay.
pub type Estimated = (&'static str, &'static str, &'static str);

/// Columns of a replay's page, `time_s` first and `differs` last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Drawn {
    pub columns: &'static [&'static str],
    pub estimates: &'static [Estimated],
    /// Names and columns of the valves' duties.
    pub duties: &'static [(&'static str, &'static str)],
}

const OF_MUSCLE: Drawn = Drawn {
    columns: &["time_s", "estimate_k", "estimate_difference_k", "duty_in", "duty_out", "differs"],
    estimates: &[("", "estimate_k", "estimate_difference_k")],
    duties: &[("inlet", "duty_in"), ("outlet", "duty_out")],
};

impl Record {
    /// Reads the `table` of a trace, and the `scenario.toml` beside it.
    ///
    /// # Errors
    /// If the scenario cannot be read, or the trace lacks a step.
    pub fn read(trace: &Path, table: &Table) -> Result<Self, InputError> {
        let angles = table.column("angle_reference_rad").unwrap_or_default();
        let start_rad = angles.first().copied().flatten().unwrap_or(0.0);
        match thermyo_joint::load_recorded(&trace.with_file_name("scenario.toml"), start_rad)? {
            Some(loaded) => Ok(Self::Joint(Box::new(joint::read_record(&loaded, table)?))),
            None => Ok(Self::Muscle(Box::new(read_record(trace, table)?))),
        }
    }

    pub fn part(&self) -> Part {
        match self {
            Self::Muscle(record) => record.part,
            Self::Joint(record) => record.part(),
        }
    }

    /// Columns and lines of the replay's page.
    pub fn drawn(&self) -> Drawn {
        match self {
            Self::Muscle(_) => OF_MUSCLE,
            Self::Joint(_) => joint::DRAWN,
        }
    }

    /// Replays the record on a board, a joint's in this process. `each` gets the cells of every step, until it returns
    /// that this is enough.
    pub fn replay(
        &self,
        board: &mut dyn Board,
        each: &mut dyn FnMut(&[f64]) -> bool,
    ) -> Result<Replay, BoardError> {
        let record = match self {
            Self::Muscle(record) => record,
            Self::Joint(record) => return record.replay(each),
        };
        let step_s = f64::from(record.config.step_s);
        replay(board, &record.config, &record.rows, &mut |recorded, replayed| {
            each(&cells(step_s, recorded, replayed))
        })
    }
}

fn cells(step_s: f64, recorded: &Telemetry, replayed: &Telemetry) -> [f64; 6] {
    let differs = !identical(recorded, replayed);
    [
        f64::from(recorded.step) * step_s,
        f64::from(recorded.estimate.gas_k),
        f64::from(replayed.estimate.gas_k) - f64::from(recorded.estimate.gas_k),
        f64::from(recorded.command.inlet.share()),
        f64::from(recorded.command.outlet.share()),
        f64::from(u8::from(differs)),
    ]
}

/// The part of a record that is replayed: consecutive steps of one configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// Number of rows before it.
    pub before: usize,
    pub rows: usize,
    /// Number of rows after it.
    pub after: usize,
    /// Step of its first row. Beyond 0, the record lacks the state of the core at that step, and the replay begins with
    /// a core that has just started.
    pub first_step: u32,
    /// Last step of the part, and step of the row after it.
    ends: Option<[u32; 2]>,
}

/// Factor by which a row of a part that begins at a start of the core counts for more: it is recomputed to the bit.
const OF_START: usize = 10;

impl Part {
    /// The longest part, where rows after a start of the core count [`OF_START`] times. A single row is a part only where
    /// there is no other.
    ///
    /// `of_config` returns whether a row was recorded with the replayed configuration. The board states it some steps
    /// late: the last row of a part counts.
    fn of(steps: &[f64], of_config: impl Fn(usize) -> bool) -> Option<Self> {
        let ends = (1..=steps.len())
            .filter(|end| steps.get(*end).is_none_or(|step| *step != steps[end - 1] + 1.0));
        let mut begin = 0;
        let parts = ends.map(|end| {
            let part = begin..end;
            begin = end;
            part
        });
        let longest = parts.filter(|part| of_config(part.end - 1)).max_by_key(|part| {
            let factor = if steps[part.start] == 0.0 { OF_START } else { 1 };
            (part.len() > 1, part.len() * factor, steps.len() - part.start)
        })?;
        Some(Self {
            before: longest.start,
            rows: longest.len(),
            after: steps.len() - longest.end,
            first_step: steps[longest.start] as u32,
            ends: steps.get(longest.end).map(|next| [steps[longest.end - 1] as u32, *next as u32]),
        })
    }

    /// Message about the replayed rows, unless they are the whole record from a start on.
    pub fn note(&self) -> Option<String> {
        let Self { before, rows, after, first_step, ends } = *self;
        let all = before + rows + after;
        let end = match ends {
            None => String::new(),
            Some([_, 0]) => "; then the core starts again".to_owned(),
            Some([last, next]) => format!("; step {last} is followed by {next}"),
        };
        match first_step {
            0 if rows == all => None,
            0 => Some(format!(
                "replayed from the start of the core in row {} on, {rows} of {all} rows{end}",
                before + 1
            )),
            _ => Some(format!(
                "the record has no start of the core: replayed from its step {first_step} on ({rows} of \
                 {all} rows{end}) with a core that starts there, so that the first seconds differ"
            )),
        }
    }
}

/// Whether pressure and gas are read from a digital sensor.
fn are_digital(sensors: &Sensors) -> [bool; 2] {
    [sensors.pressure_part.is_digital(), sensors.gas_element.is_digital()]
}

/// Highest raw code of a digital sensor, or of one at the converter.
fn most_code(digital: bool) -> u32 {
    if digital { u16::MAX.into() } else { CODE_MAX.into() }
}

/// The part of a record whose configuration has this checksum.
fn part_of(table: &Table, checksum: u32) -> Result<Part, InputError> {
    let steps = table.filled("step")?;
    let is_step = |step: &f64| step.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(step);
    if let Some(row) = steps.iter().position(|step| !is_step(step)) {
        return Err(table.cell_error(row, "step", "a whole number from 0 on"));
    }
    let has = |name: &str| table.columns().iter().any(|column| column.name == name);
    // The cells are empty until the board has stated its checksum.
    let checksums =
        if has("config_checksum") { Some(table.column("config_checksum")?) } else { None };
    let own = f64::from(checksum);
    let of_config =
        |row: usize| checksums.as_ref().and_then(|all| all[row]).is_none_or(|stated| stated == own);
    let part = Part::of(&steps, of_config).or_else(|| Part::of(&steps, |_| true));
    part.filter(|part| part.rows > 1 || steps.len() < 2).ok_or_else(|| {
        let after = steps[1] - steps[0];
        let every = format!(
            "the next step, but the record goes on {after} steps later, and the core needs every sample: \
             record again with `[run] log_every = 1`, or a board with `thermyo monitor PORT --every 1`, \
             `thermyo serve` or `thermyo board PORT drive`"
        );
        table.cell_error(1, "step", &every)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_replayed_from_a_start_of_the_core_on() {
        let of = |steps: &[u32]| {
            let steps: Vec<f64> = steps.iter().map(|step| f64::from(*step)).collect();
            Part::of(&steps, |_| true).unwrap()
        };
        let part = |steps: &[u32]| {
            let Part { before, rows, after, first_step, .. } = of(steps);
            [before, rows, after, first_step as usize]
        };
        assert_eq!(part(&[0, 1, 2]), [0, 3, 0, 0]);
        assert_eq!(part(&[7, 8, 9, 0, 1]), [3, 2, 0, 0], "a start goes before length");
        assert_eq!(part(&[0, 2, 3, 4]), [1, 3, 0, 2], "a lost row leaves one before it");
        assert_eq!(part(&[7, 8, 9, 11, 12]), [0, 3, 2, 7]);
        let long: Vec<u32> = (0..50).chain(51..60_000).collect();
        assert_eq!(part(&long), [50, 59_949, 0, 51], "a row lost soon after the start");
        assert_eq!(part(&[0, 1, 3, 0, 1, 2]), [3, 3, 0, 0]);
        let steps = [0.0, 1.0, 2.0, 0.0, 1.0];
        let other = Part::of(&steps, |row| row > 2).unwrap();
        assert_eq!((other.before, other.rows), (3, 2), "of the configuration that is replayed");
        assert!(other.note().unwrap().contains("in row 4 on, 2 of 5 rows"));
        let ends = |steps: &[u32], end: &str| of(steps).note().unwrap().ends_with(end);
        assert!(ends(&[0, 1, 3, 4], "2 of 4 rows; step 1 is followed by 3"));
        assert!(ends(&[0, 1, 2, 0, 1], "3 of 5 rows; then the core starts again"));
    }
}
