//! `thermyo sweep`: the same run over many values, to see which sensor is fast enough.
//!
//! ```text
//! scenario file --Swept--> set each key --> Assembled --measure--> Figures, point by point --> journal
//! journals of shards --merge--> one table
//! ```
//!
//! The values are set in the scenario's document, so that defaults, rules and `[believed]`, which
//! follows the plant unless the file states otherwise, apply to them.

mod journal;
mod measure;
mod outcome;
pub mod page;
mod plan;
mod range;
mod reach;
mod scenario;
mod shard;
mod study;
mod ways;

pub use journal::{Journal, Kept, MergeError, merge};
pub use measure::Figures;
pub use outcome::{Extent, Outcome, Summary};
pub use plan::Latin;
pub use range::{Range, RangeError};
pub use shard::{Shard, ShardError};
pub use study::{Point, Study};

use plan::Plan;
pub use range::MOST_POINTS;
use range::allowed;
use scenario::Assembled;
pub use scenario::Swept;
use std::any::Any;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use thermyo_compute::parallel;
use thermyo_files::input::{InputError, Problem};
use thermyo_scenario::schema::Allowed;

/// Reason why a sweep does not start.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    #[error(transparent)]
    Scenario(#[from] InputError),
    #[error("--vary is missing: at least one key must be varied")]
    NoKey,
    #[error("{0}: {1} is varied twice")]
    Twice(String, String),
    #[error("{0}: must have a COUNT: KEY=FROM:TO:COUNT; or give --lhs N")]
    NoCount(String),
    #[error("{0}: with --lhs must have no COUNT: KEY=FROM:TO, KEY=FROM:TO:log or KEY=A,B,C")]
    Count(String),
    #[error("{0}: {1}")]
    Value(String, Problem),
    #[error(
        "{0}: {1} names a file, and a sweep varies numbers and words: run each file, and compare the runs"
    )]
    File(String, String),
    #[error("{0}: at {1}: {2}")]
    Point(String, String, InputError),
    #[error("must be 1 to {MOST_POINTS} points: change the COUNT of a --vary, or --lhs")]
    TooLarge,
    #[error("--shard {shard}: there are {points} points, so that this shard has none")]
    EmptyShard { shard: Shard, points: usize },
}

#[derive(Debug)]
pub struct Sweep {
    pub study: Study,
    scenario: Swept,
}

impl Sweep {
    /// Reads the scenario and checks every point of the shard.
    pub fn new(
        path: &Path,
        ranges: Vec<Range>,
        latin: Option<Latin>,
        shard: Shard,
    ) -> Result<Self, SweepError> {
        let sweep = Self::of(Swept::read(path)?, ranges, latin, shard)?;
        sweep.check()?;
        Ok(sweep)
    }

    /// Sweep of a scenario that has been read. The points are checked only when they run.
    pub fn of(
        scenario: Swept,
        ranges: Vec<Range>,
        latin: Option<Latin>,
        shard: Shard,
    ) -> Result<Self, SweepError> {
        let base = scenario.assemble()?;
        let plan = Plan::new(ranges, latin)?;
        for range in &plan.ranges {
            if let Some(Allowed::Csv { .. }) = allowed(&range.key) {
                return Err(SweepError::File(range.to_string(), range.key.clone()));
            }
            for value in &range.values {
                let set = range.set(&mut scenario.clone(), *value);
                set.map_err(|problem| SweepError::Value(range.to_string(), problem))?;
            }
        }
        let name = scenario.origin().file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let study = Study::new(plan, shard, name, &base);
        let sweep = Self { study, scenario };
        let own = sweep.study.own();
        if own.is_empty() {
            return Err(SweepError::EmptyShard { shard, points: sweep.study.plan.points() });
        }
        Ok(sweep)
    }

    /// Warnings at the ends of each range, with the first and the last values of the other ranges: at most one for each
    /// range.
    pub fn warnings(&self) -> Vec<SweepError> {
        let ranges = &self.study.plan.ranges;
        let ends = |range: &Range| [range.values.first(), range.values.last()].map(|v| *v.unwrap());
        let warned = |own: &Range, value: f64| {
            let [first, last] = [0, 1].map(|end| {
                let mut scenario = self.scenario.clone();
                for range in ranges {
                    let value = if range.key == own.key { value } else { ends(range)[end] };
                    range.set(&mut scenario, value).ok();
                }
                scenario.warnings_of(&own.key)
            });
            (!last.is_empty()).then_some(first).into_iter().flatten().next()
        };
        let of_range = |range: &Range| {
            let problem = ends(range).into_iter().find_map(|value| warned(range, value))?;
            Some(SweepError::Value(range.to_string(), problem))
        };
        ranges.iter().filter_map(of_range).collect()
    }

    /// Checks that the values are consistent at every point of the shard. Other points are left out: with a million
    /// points, each of a thousand machines would check all.
    fn check(&self) -> Result<(), SweepError> {
        let own = self.study.own();
        let checked = parallel::map(&own, |point| self.assemble(*point).map(drop));
        for (point, outcome) in own.into_iter().zip(checked) {
            outcome.map_err(|error| {
                let ranges: Vec<String> =
                    self.study.plan.ranges.iter().map(Range::to_string).collect();
                SweepError::Point(ranges.join(" "), self.study.values_text(point), error)
            })?;
        }
        Ok(())
    }

    /// Runs these points on all cores, calling `begun` and `done` for each. `go_on` is called before, during and after
    /// each point, and its error ends the work. A point that fails is no error: see [`Point::figures`].
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
            // A run that was stopped early is no result.
            go_on()?;
            done(&row)?;
            Ok(row)
        });
        rows.into_iter().collect()
    }

    /// Runs one point. Its errors are part of the result, including those of `go_on`, which is called in each step.
    pub fn point(&self, point: usize, go_on: &mut dyn FnMut() -> io::Result<()>) -> Point {
        let failed = |settled_s, seed, failure: String| {
            let failure = failure.replace(['\n', '\r'], " ");
            Point { point, seed, settled_s, figures: Err(failure) }
        };
        let loaded = match self.assemble(point) {
            Ok(loaded) => loaded,
            Err(error) => return failed(f64::NAN, 0, error.to_string()),
        };
        let (settled_s, seed) = loaded.settled_and_seed();
        // A panic at one point must not lose the others.
        match catch_unwind(AssertUnwindSafe(|| loaded.measure(settled_s, go_on))) {
            Ok(Ok(figures)) => Point { point, seed, settled_s, figures: Ok(figures) },
            Ok(Err(error)) => failed(settled_s, seed, error),
            Err(panic) => failed(settled_s, seed, format!("the program failed: {}", said(&*panic))),
        }
    }

    fn assemble(&self, point: usize) -> Result<Assembled, InputError> {
        let mut scenario = self.scenario.clone();
        for (range, value) in self.study.plan.ranges.iter().zip(self.study.plan.values(point)) {
            let set = range.set(&mut scenario, value);
            set.map_err(|problem| InputError::file(scenario.origin(), problem))?;
        }
        scenario.assemble()
    }
}

fn said(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("without a message")
}
