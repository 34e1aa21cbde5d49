//! `thermyo sweep`: the same run over many values, to see which sensor is fast enough.
//!
//! ```text
//! scenario file --Document--> set each key --assemble--> Loaded --measure--> Figures, point by point --> journal
//! journals of shards --merge--> one table
//! ```
//!
//! The values go into the scenario as if they stood in its file: defaults, rules and `[believed]`,
//! which follows the plant where the file does not say otherwise, act on them.

mod journal;
mod measure;
mod outcome;
pub mod page;
mod plan;
mod range;
mod reach;
mod shard;
mod study;
mod ways;

pub use journal::{Journal, Kept, MergeError, merge};
pub use measure::{Figures, settled_s};
pub use outcome::{Extent, Outcome, Summary};
pub use plan::Latin;
pub use range::{Range, RangeError};
pub use shard::{Shard, ShardError};
pub use study::{Point, Study};

use plan::Plan;
pub use range::MOST_POINTS;
use std::any::Any;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use thermyo_compute::parallel;
use thermyo_files::input::{InputError, Problem, read_text};
use thermyo_scenario::Document;
use thermyo_setup::{Loaded, assemble};

/// Why a sweep does not start.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// The scenario cannot be used as it is.
    #[error(transparent)]
    Scenario(#[from] InputError),
    /// Nothing varies.
    #[error("--vary is missing: at least one key must be varied")]
    NoKey,
    /// One key twice.
    #[error("{0}: {1} is varied twice")]
    Twice(String, String),
    /// A grid needs to know how many values.
    #[error("{0}: must have a COUNT: KEY=FROM:TO:COUNT; or give --lhs N")]
    NoCount(String),
    /// A hypercube says itself how many.
    #[error("{0}: with --lhs must have no COUNT: KEY=FROM:TO, KEY=FROM:TO:log or KEY=A,B,C")]
    Count(String),
    /// A value that the key does not take.
    #[error("{0}: {1}")]
    Value(String, Problem),
    /// A point at which the values do not fit each other or the rest of the scenario.
    #[error("{0}: at {1}: {2}")]
    Point(String, String, InputError),
    /// There are more points than anybody would wait for.
    #[error("must be 1 to {MOST_POINTS} points: change the COUNT of a --vary, or --lhs")]
    TooLarge,
    /// Nothing is left to do.
    #[error("--shard {shard}: there are {points} points, so that this shard has none")]
    EmptyShard {
        /// The shard.
        shard: Shard,
        /// Points of the whole sweep.
        points: usize,
    },
}

/// A sweep that can start: every point of it is a valid scenario.
#[derive(Debug)]
pub struct Sweep {
    /// What is run.
    pub study: Study,
    document: Document,
}

impl Sweep {
    /// Reads the scenario and checks every point of the shard.
    ///
    /// # Errors
    /// [`SweepError`], in one line.
    pub fn new(
        path: &Path,
        ranges: Vec<Range>,
        latin: Option<Latin>,
        shard: Shard,
    ) -> Result<Self, SweepError> {
        let document = Document::parse(&read_text(path)?, path)?;
        let sweep = Self::of(document, ranges, latin, shard)?;
        sweep.check()?;
        Ok(sweep)
    }

    /// The same of a scenario that has been read; whether the values of a point fit each other is found out
    /// when it is run.
    ///
    /// # Errors
    /// As [`Sweep::new`].
    pub fn of(
        document: Document,
        ranges: Vec<Range>,
        latin: Option<Latin>,
        shard: Shard,
    ) -> Result<Self, SweepError> {
        let base = assemble(&document)?;
        let plan = Plan::new(ranges, latin)?;
        for range in &plan.ranges {
            for value in &range.values {
                let set = range.set(&mut document.clone(), *value);
                set.map_err(|problem| SweepError::Value(range.to_string(), problem))?;
            }
        }
        let name = document.origin.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let study = Study::new(plan, shard, name, &base);
        let sweep = Self { study, document };
        let own = sweep.study.own();
        if own.is_empty() {
            return Err(SweepError::EmptyShard { shard, points: sweep.study.points() });
        }
        Ok(sweep)
    }

    /// Whether the values fit each other at every point of the shard. Of the shard only: of a million points each of a
    /// thousand machines would check all.
    fn check(&self) -> Result<(), SweepError> {
        let own = self.study.own();
        let checked = parallel::map(&own, |point| self.assemble(*point).map(drop));
        for (point, outcome) in own.into_iter().zip(checked) {
            outcome.map_err(|error| {
                let ranges: Vec<String> =
                    self.study.ranges().iter().map(Range::to_string).collect();
                SweepError::Point(ranges.join(" "), self.study.values_text(point), error)
            })?;
        }
        Ok(())
    }

    /// Runs these points on all cores; `begun` and `done` are shown each. Before, during and after each `go_on` is asked.
    ///
    /// # Errors
    /// Those of `go_on`, `begun` and `done`. A point that fails is none: see [`Point::figures`].
    pub fn run(
        &self,
        points: &[usize],
        go_on: impl Fn() -> io::Result<()> + Sync,
        begun: impl Fn(usize) -> io::Result<()> + Sync,
        done: impl Fn(&Point) -> io::Result<()> + Sync,
    ) -> io::Result<Vec<Point>> {
        let rows = parallel::map(points, |point| {
            go_on()?;
            begun(*point)?;
            let row = self.point(*point, &mut || go_on());
            // What was stopped on its way is no result.
            go_on()?;
            done(&row)?;
            Ok(row)
        });
        rows.into_iter().collect()
    }

    /// Runs one point. Whatever goes wrong with it stands in it, errors of `go_on`, which is asked at each step, too.
    pub fn point(&self, point: usize, go_on: &mut dyn FnMut() -> io::Result<()>) -> Point {
        let failed = |settled_s, seed, failure: String| {
            let failure = failure.replace(['\n', '\r'], " ");
            Point { point, seed, settled_s, figures: Err(failure) }
        };
        let loaded = match self.assemble(point) {
            Ok(loaded) => loaded,
            Err(error) => return failed(f64::NAN, 0, error.to_string()),
        };
        let (settled_s, seed) = (settled_s(&loaded), loaded.plant.run.seed);
        // A point that brings the program down would take the others with it.
        match catch_unwind(AssertUnwindSafe(|| measure::measure(loaded, settled_s, go_on))) {
            Ok(Ok(figures)) => Point { point, seed, settled_s, figures: Ok(figures) },
            Ok(Err(error)) => failed(settled_s, seed, error.to_string()),
            Err(panic) => failed(settled_s, seed, format!("the program failed: {}", said(&*panic))),
        }
    }

    fn assemble(&self, point: usize) -> Result<Loaded, InputError> {
        let mut document = self.document.clone();
        for (range, value) in self.study.ranges().iter().zip(self.study.values(point)) {
            let set = range.set(&mut document, value);
            set.map_err(|problem| InputError::file(&document.origin, problem))?;
        }
        assemble(&document)
    }
}

/// The message of a panic.
fn said(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message")
}
