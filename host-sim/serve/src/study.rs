//! Work on records in parallel to the board: an identification or a comparison, in its own thread.
//!
//! ```text
//! order --> Study --thread--> table --identify or compare--> folder, and what the page shows
//!              ^-- polled at every state, and left to end by itself when it is cancelled
//! ```

use super::results::{Outcome, next_folder};
use super::shared::Shared;
use super::sought::{BOARDS, Sought};
use super::state::{self, Weight};
use super::word::Source;
use hyper::body::Bytes;
use model_core::Config;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicUsize, Ordering};
use std::thread::{self, JoinHandle};
use thermyo_compute::parallel::Watch;
use thermyo_files::input::InputError;
use thermyo_files::number::{MISSING, significant};
use thermyo_files::output::OutputDir;
use thermyo_files::table::{self, Table};
use thermyo_files::units::UnitSystem;
use thermyo_fit::Fitted;
use thermyo_identify::static_map::Readings;
use thermyo_identify::{Found, IdentifyError, identify_table};
use thermyo_runs::compare::{Comparison, Recorded};
use thermyo_scenario::number;
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_setup::from_config;

/// Lowest priority of a thread on Linux.
#[cfg(target_os = "linux")]
const LEAST_URGENT: i32 = 19;

#[derive(Debug, Default)]
pub struct Study {
    works: Option<Works>,
    over: Option<Over>,
}

#[derive(Debug)]
struct Works {
    title: &'static str,
    progress: Arc<Progress>,
    thread: JoinHandle<Result<Done, NotDone>>,
}

#[derive(Debug)]
struct Over {
    shown: state::Study,
    fit: Option<Fit>,
}

/// Configurations before and after an identification.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    pub before: Config,
    pub after: Config,
}

/// Number of finished parts, and the phase of the work.
#[derive(Debug, Default)]
struct Progress {
    parts: AtomicUsize,
    done: AtomicUsize,
    phase: AtomicU8,
}

/// Phases of the work. It is cancelled or it saves its result, never both.
const WORKS: u8 = 0;
const SAVES: u8 = 1;
const CANCELLED: u8 = 2;

impl Progress {
    /// Begins to save the result.
    ///
    /// # Errors
    /// If the work is cancelled.
    fn save(&self) -> Result<(), NotDone> {
        if self.leaves_work_for(SAVES) { Ok(()) } else { Err(NotDone::Cancelled) }
    }

    /// Whether it is cancelled: not once it saves.
    fn cancel(&self) -> bool {
        self.leaves_work_for(CANCELLED)
    }

    fn leaves_work_for(&self, phase: u8) -> bool {
        let order = Ordering::Relaxed;
        self.phase.compare_exchange(WORKS, phase, order, order).is_ok()
    }
}

impl Watch for Progress {
    fn parts(&self, count: usize) {
        self.parts.fetch_add(count, Ordering::Relaxed);
    }

    fn done(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    fn stopped(&self) -> bool {
        self.phase.load(Ordering::Relaxed) == CANCELLED
    }

    /// Number of threads: one core is left for the board and its page.
    fn threads(&self) -> usize {
        thread::available_parallelism().map_or(1, |cores| cores.get() - 1).max(1)
    }
}

#[derive(Debug)]
struct Done {
    shown: state::Study,
    outcome: Outcome,
    fit: Option<Fit>,
}

#[derive(Debug, thiserror::Error)]
enum NotDone {
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Identify(#[from] IdentifyError),
    #[error("{0}")]
    OtherTable(String),
    #[error("Cancelled: nothing was kept.")]
    Cancelled,
}

/// A table of the page or of a result.
#[derive(Debug)]
pub enum Content {
    Sent { name: String, bytes: Bytes },
    Recorded { name: String, trace: PathBuf },
}

impl Content {
    /// The content of a source; none if it is no longer there.
    pub fn of(source: Source, shared: &Shared) -> Option<Self> {
        match source {
            Source::File { number, name } => {
                let bytes = shared.uploads.get(number)?;
                Some(Self::Sent { name, bytes })
            }
            Source::Result(name) => {
                let results = shared.results();
                let outcome = results.iter().find(|outcome| outcome.name == name)?;
                Some(Self::Recorded { name, trace: outcome.folder.join("trace.csv") })
            }
        }
    }

    /// Name of the file in messages.
    fn path(&self) -> &Path {
        match self {
            Self::Sent { name, .. } => Path::new(name),
            Self::Recorded { trace, .. } => trace,
        }
    }

    fn name(&self) -> &str {
        match self {
            Self::Sent { name, .. } | Self::Recorded { name, .. } => name,
        }
    }

    fn table(&self) -> Result<Table, InputError> {
        match self {
            Self::Sent { name, bytes } => {
                Table::parse_either(bytes, Path::new(name), Readings::are_in)
            }
            Self::Recorded { trace, .. } => table::read_either(trace, Readings::are_in),
        }
    }

    fn record(&self) -> Result<(Recorded, Option<String>), InputError> {
        let (table, recorded) = match self {
            Self::Sent { name, bytes } => {
                let table = Table::parse_record(bytes, Path::new(name))?;
                let recorded = Recorded::alone(name, &table)?;
                (table, recorded)
            }
            Self::Recorded { name, trace } => {
                let table = table::read_record(trace)?;
                let recorded = Recorded::of_trace(name, trace, &table)?;
                (table, recorded)
            }
        };
        Ok((recorded, damage(&table)))
    }
}

fn damage(table: &Table) -> Option<String> {
    table.damage().map(|damage| format!("{damage}."))
}

impl Study {
    pub fn works(&self) -> bool {
        self.works.is_some()
    }

    /// Identifies `keys` of a board's configuration from a table; results go to a folder of `out`.
    pub fn identify(
        &mut self,
        config: Config,
        (sought, keys): (Sought, &[String]),
        data: Content,
        out: &Path,
    ) -> Result<(), InputError> {
        let loaded = sought.scenario(&config, keys)?;
        let out = out.to_path_buf();
        self.begin("Identification", move |watch| fit(config, &loaded, sought, &data, &out, watch));
        Ok(())
    }

    /// Compares the second record with the first; results go to a folder of `out`.
    pub fn compare(&mut self, records: [Content; 2], out: &Path) {
        let out = out.to_path_buf();
        self.begin("Comparison", move |watch| compare(&records, &out, watch));
    }

    fn begin(
        &mut self,
        title: &'static str,
        work: impl FnOnce(&Progress) -> Result<Done, NotDone> + Send + 'static,
    ) {
        let progress = Arc::new(Progress::default());
        let watch = Arc::clone(&progress);
        let thread = thread::spawn(move || {
            yield_to_the_board();
            work(&watch)
        });
        (self.works, self.over) = (Some(Works { title, progress, thread }), None);
    }

    /// Cancels the work, or closes its result. Cancelled work gets so little time on a busy machine
    /// that its end is not waited for; work that already saves its result goes on.
    pub fn close(&mut self) {
        if self.works.is_none() {
            self.over = None;
        } else if let Some(Works { title, .. }) =
            self.works.take_if(|works| works.progress.cancel())
        {
            let shown = state::Study::failed(title, NotDone::Cancelled.to_string());
            self.over = Some(Over { shown, fit: None });
        }
    }

    /// Takes the result once the work has ended.
    pub fn poll(&mut self, shared: &Shared) {
        let Some(works) = self.works.take_if(|works| works.thread.is_finished()) else { return };
        let title = works.title;
        let failed = |text: String| {
            shared.log(Weight::Refused, format!("{title}: {text}"));
            Over { shown: state::Study::failed(title, text), fit: None }
        };
        self.over = Some(match works.thread.join() {
            Ok(Ok(Done { shown, outcome, fit })) => {
                shared.log(Weight::Plain, format!("{title}: {}", outcome.folder.display()));
                shared.add_result(outcome);
                Over { shown, fit }
            }
            Ok(Err(error)) => failed(error.to_string()),
            Err(_) => failed("it ended by a fault of this program".to_owned()),
        });
    }

    /// Configurations of an identification whose values may be applied.
    pub fn fit(&self) -> Option<&Fit> {
        self.over.as_ref().and_then(|over| over.fit.as_ref())
    }

    /// Notes that the board has the values.
    pub fn applied(&mut self) {
        let Some(over) = &mut self.over else { return };
        over.fit = None;
        (over.shown.applies, over.shown.chooses, over.shown.refused) = (false, true, None);
    }

    /// Shows the reason for a refusal, beside the result if there is one.
    pub fn refused(&mut self, title: &str, why: String) {
        match &mut self.over {
            Some(over) => over.shown.refused = Some(why),
            None if self.works.is_none() => {
                self.over = Some(Over { shown: state::Study::failed(title, why), fit: None });
            }
            None => (),
        }
    }

    pub fn state(&self) -> Option<state::Study> {
        let Some(Works { title, progress, .. }) = &self.works else {
            return self.over.as_ref().map(|over| over.shown.clone());
        };
        let [parts, done] = [&progress.parts, &progress.done].map(|n| n.load(Ordering::Relaxed));
        let text = match parts {
            0 => "The record is read.".to_owned(),
            parts => format!("{done} of {parts} searches."),
        };
        let progress = Some(if parts == 0 { 0.0 } else { done as f64 / parts as f64 });
        Some(state::Study { title: (*title).to_owned(), text, progress, ..state::Study::default() })
    }
}

/// On Linux this thread, and those that it starts, get only the time that the link, the page and an
/// emulated board leave.
fn yield_to_the_board() {
    #[cfg(target_os = "linux")]
    // If this is refused, the work is only as urgent as the rest.
    let _ = rustix::process::nice(LEAST_URGENT);
}

fn fit(
    config: Config,
    loaded: &Loaded,
    sought: Sought,
    data: &Content,
    out: &Path,
    watch: &Progress,
) -> Result<Done, NotDone> {
    let table = data.table()?;
    check(sought, &table, data)?;
    let found = identify_table(loaded, Path::new(BOARDS), &table, data.path(), None, watch)?;
    watch.save()?;
    let (folder, name) = next_folder(out, "identify");
    let mut files = OutputDir::create(&folder)?;
    let json = serde_json::to_string_pretty(&found.findings()).expect("plain data") + "\n";
    files.text("summary.json", &json)?;
    files.text("identified.toml", &thermyo_setup::render(found.scenario()))?;
    files.text("report.html", &found.page(data.name()))?;
    let (plot, drawing) = found.plot(data.name());
    files.text(plot, &drawing)?;
    files.publish()?;
    let after = core_config(&found.scenario().believed);
    let failed = found.failed();
    let shown = state::Study {
        title: "Identification".to_owned(),
        text: verdict(&found, data.name(), damage(&table)),
        head: ["Value", "before", "after"].map(str::to_owned).to_vec(),
        rows: rows(&found, &from_config::to_scenario(&config)?.scenario),
        result: Some(name.clone()),
        plot: Some(plot),
        scenario: Some("identified.toml"),
        applies: failed.is_none(),
        over: true,
        ..state::Study::default()
    };
    let text = format!("identified from {}", data.name());
    let outcome = Outcome { name, folder, text, trace: false };
    Ok(Done { shown, outcome, fit: failed.is_none().then_some(Fit { before: config, after }) })
}

/// Refuses a mismatch: a table of static readings determines the force and nothing else.
fn check(sought: Sought, table: &Table, data: &Content) -> Result<(), NotDone> {
    if sought == Sought::Force {
        return Ok(Readings::of(table).map(drop)?);
    }
    if Readings::are_in(table) {
        let text = "a table of static readings, which shows the force of the muscle only";
        return Err(NotDone::OtherTable(format!("{}: {text}", data.path().display())));
    }
    Ok(())
}

/// Outcome, and the values that the data leave open.
fn verdict(found: &Found, name: &str, damage: Option<String>) -> String {
    let failed = found.failed();
    let first = match &failed {
        Some(why) => {
            let why = why.trim_end_matches('.');
            format!("Not to be relied on: {why}. The board keeps its values.")
        }
        None => format!("Found from {name}. The board still has the values from before."),
    };
    let remarks = found.remarks().iter().filter(|remark| Some(*remark) != failed.as_ref());
    let lines = [first].into_iter().chain(remarks.cloned()).chain(damage);
    lines.collect::<Vec<String>>().join("\n")
}

/// Rows of key, value before and value after.
fn rows(found: &Found, before: &Loaded) -> Vec<Vec<String>> {
    let row = |(path, fitted): (&str, &Fitted)| {
        let before = number(&before.plant, path).map_or(MISSING.to_owned(), |value| {
            format!("{} {}", significant(value, 4), fitted.unit).trim_end().to_owned()
        });
        vec![path.to_owned(), before, fitted.text()]
    };
    found.values().into_iter().map(row).collect()
}

fn compare(records: &[Content; 2], out: &Path, watch: &Progress) -> Result<Done, NotDone> {
    let [(first, first_damage), (second, second_damage)] =
        [records[0].record()?, records[1].record()?];
    let comparison = Comparison::of(vec![first, second]);
    watch.save()?;
    let (folder, name) = next_folder(out, "compare");
    let mut files = OutputDir::create(&folder)?;
    files.text("summary.json", &comparison.summary())?;
    files.text("report.html", &comparison.page())?;
    files.text("runs.svg", &comparison.plot())?;
    files.publish()?;
    let [with, run] = [0, 1].map(|i| records[i].name());
    let rows = comparison.compared.iter().map(|compared| compared.rows).sum::<usize>();
    let lead = format!("{run} less {with}, at {rows} rows of both.");
    let warnings = comparison.warnings().into_iter().map(|text| format!("Warning: {text}."));
    let tracking = comparison.tracking(UnitSystem::Practical);
    let lines = [lead].into_iter().chain(warnings).chain(first_damage).chain(second_damage);
    let lines = lines.chain((!tracking.is_empty()).then(|| tracking.trim_end().to_owned()));
    let shown = state::Study {
        title: "Comparison".to_owned(),
        text: lines.collect::<Vec<String>>().join("\n"),
        head: ["Quantity", "RMS", "mean", "largest"].map(str::to_owned).to_vec(),
        rows: comparison.rows().flatten().map(Vec::from).collect(),
        result: Some(name.clone()),
        plot: Some("runs.svg"),
        over: true,
        ..state::Study::default()
    };
    let outcome = Outcome { name, folder, text: format!("{run} less {with}"), trace: false };
    Ok(Done { shown, outcome, fit: None })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    fn text(study: &Study) -> String {
        study.state().unwrap().text
    }

    #[test]
    fn work_that_does_not_look_is_cancelled_at_once_and_saves_nothing() {
        let mut study = Study::default();
        let (reach, reached) = mpsc::channel::<()>();
        let (say, said) = mpsc::channel();
        study.begin("Identification", move |watch| {
            reached.recv().unwrap();
            say.send(watch.save().is_ok()).unwrap();
            Err(NotDone::Cancelled)
        });
        study.close();
        assert!(!study.works());
        assert_eq!(text(&study), "Cancelled: nothing was kept.");
        reach.send(()).unwrap();
        assert!(!said.recv().unwrap(), "it saves although it is cancelled");
        study.close();
        assert!(study.state().is_none());
    }

    #[test]
    fn work_that_saves_its_result_is_not_cancelled() {
        let mut study = Study::default();
        let (reach, reached) = mpsc::channel::<()>();
        let (say, said) = mpsc::channel();
        study.begin("Comparison", move |watch| {
            say.send(watch.save().is_ok()).unwrap();
            reached.recv().unwrap();
            Err(NotDone::OtherTable("its own end".to_owned()))
        });
        assert!(said.recv().unwrap());
        study.close();
        assert!(study.works());
        reach.send(()).unwrap();
        while study.works() {
            study.poll(&Shared::default());
        }
        assert_eq!(text(&study), "its own end");
    }
}
