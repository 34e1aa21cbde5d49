//! `thermyo sweep`: the same run over a grid of values, to see which sensor is fast enough.
//!
//! ```text
//! scenario file --Document--> set each key --assemble--> Loaded --measure--> Figures, point by point
//! ```
//!
//! The values go into the scenario as if they stood in its file: defaults, rules and `[believed]`,
//! which follows the plant where the file does not say otherwise, act on them.

mod measure;
mod outcome;
pub mod page;
mod range;
mod reach;
mod shard;

pub use measure::{Figures, settled_s};
pub use outcome::{Extent, Outcome, Summary};
pub use range::{Range, RangeError};
pub use shard::{Shard, ShardError};

use crate::commands::parallel;
use crate::files::input::{InputError, Problem, read_text};
use crate::plant::Diverged;
use crate::scenario::schema::{self, Allowed};
use crate::scenario::{Document, Loaded, assemble};
use crate::simulation::run::RunError;
use range::MOST_POINTS;
use std::io;
use std::path::Path;

/// Most keys of a sweep: more could not be drawn.
const MOST_KEYS: usize = 3;

/// Why a sweep does not start.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// The scenario cannot be used as it is.
    #[error(transparent)]
    Scenario(#[from] InputError),
    /// Too few or too many keys.
    #[error("--vary is given {0} times: must be 1 to {MOST_KEYS} times")]
    KeyCount(usize),
    /// One key twice.
    #[error("{0}: {1} is varied twice")]
    Twice(String, String),
    /// A value that the key does not take.
    #[error("{0}: {1}")]
    Value(String, Problem),
    /// A point at which the values do not fit each other or the rest of the scenario.
    #[error("{0}: at {1}: {2}")]
    Point(String, String, InputError),
    /// The grid is larger than anybody would wait for.
    #[error("a grid of more than {MOST_POINTS} points: lower the COUNT of a --vary")]
    TooLarge,
    /// Nothing is left to do.
    #[error("--shard {shard}: the grid has {points} points, so that this shard has none")]
    EmptyShard {
        /// The shard.
        shard: Shard,
        /// Points of the whole grid.
        points: usize,
    },
}

/// A sweep that can start: every point of it is a valid scenario.
#[derive(Debug)]
pub struct Sweep {
    /// The scenario without the varied keys' values.
    pub base: Loaded,
    ranges: Vec<Range>,
    shard: Shard,
    /// The shard's points, and their scenarios.
    points: Vec<(usize, Loaded)>,
}

impl Sweep {
    /// Reads the scenario and checks every point.
    ///
    /// # Errors
    /// [`SweepError`], in one line.
    pub fn new(path: &Path, ranges: Vec<Range>, shard: Shard) -> Result<Self, SweepError> {
        let document = Document::parse(&read_text(path)?, path)?;
        let base = assemble(&document)?;
        if !(1..=MOST_KEYS).contains(&ranges.len()) {
            return Err(SweepError::KeyCount(ranges.len()));
        }
        let mut points = 1_usize;
        for (i, range) in ranges.iter().enumerate() {
            if ranges[..i].iter().any(|other| other.key == range.key) {
                return Err(SweepError::Twice(range.to_string(), range.key.clone()));
            }
            for value in &range.values {
                let set = document.clone().set(&range.key, *value);
                set.map_err(|problem| SweepError::Value(range.to_string(), problem))?;
            }
            points = points.saturating_mul(range.values.len());
        }
        if points > MOST_POINTS {
            return Err(SweepError::TooLarge);
        }
        let mut sweep = Self { base, ranges, shard, points: Vec::new() };
        // All of the grid, so that a shard fails where the whole would.
        let all: Vec<Loaded> = (0..points)
            .map(|point| {
                sweep.assemble(&document, point).map_err(|error| sweep.blame(point, error))
            })
            .collect::<Result<_, _>>()?;
        let own = |(point, loaded)| shard.has(point).then_some((point, loaded));
        sweep.points = all.into_iter().enumerate().filter_map(own).collect();
        if sweep.points.is_empty() {
            return Err(SweepError::EmptyShard { shard, points });
        }
        Ok(sweep)
    }

    /// How many points this shard runs.
    pub fn count(&self) -> usize {
        self.points.len()
    }

    /// Runs every point of the shard on all cores; `done` is shown each as soon as it is there. Before each
    /// `go_on` is asked.
    ///
    /// # Errors
    /// A run that could not be made, and those of `go_on` and `done`. A plant that diverges is no error: see
    /// [`Outcome::failed`].
    pub fn run(
        &self,
        go_on: impl Fn() -> io::Result<()> + Sync,
        done: impl Fn(&Point) -> io::Result<()> + Sync,
    ) -> Result<Outcome<'_>, RunError> {
        let rows = parallel::map(&self.points, |(point, loaded)| {
            go_on().map_err(RunError::Output)?;
            let row = self.row(*point, loaded)?;
            done(&row).map_err(RunError::Output)?;
            Ok(row)
        });
        Ok(Outcome::new(self, rows.into_iter().collect::<Result<_, RunError>>()?))
    }

    /// Points of the whole grid.
    fn grid(&self) -> usize {
        self.ranges.iter().map(|range| range.values.len()).product()
    }

    /// Place of a point in each range; the last key's value changes from point to point.
    fn places(&self, mut point: usize) -> Vec<usize> {
        let mut places = vec![0; self.ranges.len()];
        for (place, range) in places.iter_mut().zip(&self.ranges).rev() {
            *place = point % range.values.len();
            point /= range.values.len();
        }
        places
    }

    fn values(&self, point: usize) -> Vec<f64> {
        let places = self.places(point);
        self.ranges.iter().zip(places).map(|(range, place)| range.values[place]).collect()
    }

    fn assemble(&self, document: &Document, point: usize) -> Result<Loaded, InputError> {
        let mut document = document.clone();
        for (range, value) in self.ranges.iter().zip(self.values(point)) {
            let set = document.set(&range.key, value);
            set.map_err(|problem| InputError::file(&document.origin, problem))?;
        }
        assemble(&document)
    }

    fn blame(&self, point: usize, error: InputError) -> SweepError {
        let join = |parts: Vec<String>, between| parts.join(between);
        let ranges = join(self.ranges.iter().map(Range::to_string).collect(), " ");
        let values = self.ranges.iter().zip(self.values(point));
        let at =
            join(values.map(|(range, value)| format!("{} = {value}", range.key)).collect(), ", ");
        SweepError::Point(ranges, at, error)
    }

    fn row(&self, point: usize, loaded: &Loaded) -> Result<Point, RunError> {
        let settled_s = settled_s(loaded);
        let figures = match measure::measure(loaded.clone(), settled_s) {
            Ok(figures) => Ok(figures),
            Err(RunError::Diverged(diverged)) => Err(diverged),
            Err(error) => return Err(error),
        };
        let seed = loaded.plant.run.seed;
        Ok(Point { point, values: self.values(point), seed, settled_s, figures })
    }

    /// Unit of a key's values, as the SI writes it; empty for a ratio or a number of things.
    fn unit(&self, key: usize) -> &'static str {
        let path = &self.ranges[key].key;
        let path = path.strip_prefix("believed.").unwrap_or(path);
        match schema::key(path).map(|(_, key)| key.allowed) {
            Some(Allowed::Real(limits)) => limits.unit,
            _ => "",
        }
    }
}

/// One point of the grid, run.
#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Its number in the whole grid, from 0.
    pub point: usize,
    /// The varied keys' values.
    pub values: Vec<f64>,
    /// `run.seed` of its run.
    pub seed: u64,
    /// From when on its errors count \[s\].
    pub settled_s: f64,
    /// What it gave; or how the plant diverged.
    pub figures: Result<Figures, Diverged>,
}
