//! The thread that owns the link: reads every step, carries out orders, vents before anything else.

use super::frames::Frames;
use super::guide::{Calibration, Guided, Step};
use super::orders::Next;
use super::recording::Recording;
use super::results::{Outcome, next_folder};
use super::shared::Shared;
use super::sought::Sought;
use super::state::{Configuration, Guide, Link, ResultLink, State, Weight};
use super::study::{Content, Fit, Study};
use super::target::Target;
use super::tuning;
use super::word::{Order, ScenarioText, Source};
use model_core::control::Mode;
use model_core::safety::supervisor::VENTING;
use model_core::{Config, Faults, SetPoint, Telemetry};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use thermyo_boards::live::LiveBoard;
use thermyo_files::input::InputError;
use thermyo_files::output::OutputDir;
use thermyo_files::units::UnitSystem;
use thermyo_logs::Logs;
use thermyo_protocol::{ConfigSource, Refusal, Status, Timing};
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_setup::from_config;
use thermyo_simulation::board::BoardError;
use thermyo_simulation::run::RunError;
use thermyo_studies::calibrate;
use thermyo_studies::drive::LiveBench;
use thermyo_studies::stops;
use thermyo_studies::stops::{Asked, LiveRows, Plan, Record, RowBench};
use thermyo_studies::tune;
use thermyo_studies::tune::{OutOfReach, TuneError, Tuned};

/// A board without telemetry for this long counts as silent.
const SILENCE: Duration = Duration::from_millis(500);
/// Interval of attempts to open a lost port.
const RETRY: Duration = Duration::from_millis(300);
/// Interval of looks at a port that is being opened.
const LOOK: Duration = Duration::from_millis(20);
/// Interval of state messages when nothing is urgent.
const STATE: Duration = Duration::from_millis(250);
/// Interval of orders. A board carries out 250 requests a second and drops the others, whose answers
/// would be waited for in vain; an order takes ten requests at most.
const BETWEEN_ORDERS: Duration = Duration::from_millis(50);
/// Steps between two samples that a calibration averages: 100 per second.
const CALIBRATION_STEPS: u32 = 10;

pub struct Operator {
    target: Target,
    out: PathBuf,
    logs: Logs,
    shared: Arc<Shared>,
    board: Option<LiveBoard>,
    known: Known,
    /// The part of it that the page needs.
    configuration: Configuration,
    /// Configuration and name before the last change.
    former: Option<(Config, String)>,
    link: Link,
    frames: Frames,
    recording: Option<Recording>,
    /// Threads that write reports.
    writers: Vec<JoinHandle<()>>,
    guided: Option<Guided>,
    tuning: Option<Guide>,
    study: Study,
    faults: Faults,
    set_point: SetPoint,
    next_step: Option<u32>,
    lost_steps: u64,
    heard: Instant,
    /// When the last order or vent was carried out, and whether it was a vent.
    carried_out: Instant,
    vented: bool,
    tried: Instant,
    /// An attempt to open the port that was lost. It waits for a silent board, and neither a vent nor the end waits for it.
    opening: Option<JoinHandle<Result<(LiveBoard, Known), BoardError>>>,
    reopen: fn(&Target) -> Result<LiveBoard, BoardError>,
    shown: Option<Instant>,
}

/// Answers of the board.
#[derive(Debug, Clone, Copy)]
struct Known {
    config: Config,
    status: Status,
    timing: Timing,
}

impl Known {
    fn configuration(&self, target: &Target) -> Configuration {
        let own = !matches!(target, Target::Port(_));
        Configuration::new(&self.config, &self.status, own.then(|| target.muscle_name()))
    }
}

#[derive(Debug, thiserror::Error)]
enum NotDone {
    #[error(transparent)]
    Board(#[from] BoardError),
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Pressure(#[from] OutOfReach),
    #[error(transparent)]
    Stops(#[from] stops::Refusal),
    #[error("{0}")]
    NotNow(&'static str),
}

const NO_LINK: NotDone = NotDone::NotNow("there is no link to the board");
const NO_FORMER: NotDone = NotDone::NotNow("this page has changed no configuration yet");
const ONE_STUDY: NotDone =
    NotDone::NotNow("an identification or a comparison goes on: wait for it, or cancel it");
const NO_SOURCE: NotDone =
    NotDone::NotNow("that record is no longer here: the last four files are kept; choose it again");
const NO_FIT: NotDone = NotDone::NotNow("there are no identified values to apply");
const OTHER_CONFIG: NotDone = NotDone::NotNow(
    "the board has another configuration than the identification began with: identify again",
);
const DRIVEN: NotDone =
    NotDone::NotNow("the muscle is driven, and new values would vent it: vent first");
const RECORDS: NotDone =
    NotDone::NotNow("a recording runs, and a record has one configuration: end it first");

impl Operator {
    /// For a board that has been opened; recordings go to folders in `out`, and to `logs`.
    pub fn new(
        target: Target,
        mut board: LiveBoard,
        out: &Path,
        logs: Logs,
    ) -> Result<Self, BoardError> {
        let known = learn(&mut board)?;
        let now = Instant::now();
        let configuration = known.configuration(&target);
        let shared = Arc::new(Shared::default());
        shared.log(Weight::Plain, format!("connected with {}", target.name()));
        let mut operator = Self {
            target,
            out: out.to_path_buf(),
            logs,
            shared,
            board: Some(board),
            known,
            configuration,
            former: None,
            link: Link::Connected,
            frames: Frames::new(),
            recording: None,
            writers: Vec::new(),
            guided: None,
            tuning: None,
            study: Study::default(),
            faults: Faults::NONE,
            set_point: SetPoint::Vent,
            next_step: None,
            lost_steps: 0,
            heard: now,
            carried_out: now,
            vented: false,
            tried: now,
            opening: None,
            reopen: Target::reopen,
            shown: None,
        };
        operator.show();
        Ok(operator)
    }

    /// The state that it shares with the sockets.
    pub fn shared(&self) -> Arc<Shared> {
        Arc::clone(&self.shared)
    }

    /// Operates until `wanted` returns true; then vents, and ends a recording.
    pub fn run(mut self, wanted: &dyn Fn() -> bool) {
        while !wanted() && !self.shared.ended() {
            // Telemetry that arrived while an order waited for its answer is read before the next
            // order; otherwise the pages and the record would lag further with each.
            let behind = self.board.as_ref().is_some_and(LiveBoard::is_behind);
            let rested = self.carried_out.elapsed() >= BETWEEN_ORDERS;
            // A vent is carried out at once, except right after another one: the muscle vents already.
            if (rested || !self.vented)
                && let Some(next) = self.shared.orders.next(rested && !behind)
            {
                self.vented = next == Next::Vent;
                match next {
                    Next::Vent => self.vent(),
                    Next::Order(order) => self.carry_out(order, wanted),
                }
                self.carried_out = Instant::now();
            }
            self.listen();
            self.show();
        }
        self.vent();
        self.study.close();
        self.finish_recording();
        for writer in self.writers.drain(..) {
            let _ = writer.join();
        }
        self.shared.log(Weight::Plain, "the server has ended");
        (self.link, self.shown) = (Link::Ended, None);
        self.show();
        self.shared.end();
    }

    fn vent(&mut self) {
        self.guided = self.guided.take().filter(|guided| matches!(guided, Guided::Over(_)));
        match self.board.as_mut().map(LiveBoard::vent) {
            Some(Ok(())) => self.shared.log(Weight::Plain, "the muscle vents"),
            Some(Err(error)) => self.lost(&error),
            None => self.shared.log(
                Weight::Fault,
                "there is no link: a board that is driven vents by itself when its host is silent",
            ),
        }
        self.shown = None;
    }

    /// Reads telemetry, or waits for a lost board.
    fn listen(&mut self) {
        match self.board.as_mut().map(LiveBoard::poll) {
            Some(Ok(Some(telemetry))) => self.see(&telemetry),
            Some(Ok(None)) => {
                if self.link == Link::Connected && self.heard.elapsed() > SILENCE {
                    self.link_is(Link::Silent);
                    self.shared.log(Weight::Fault, "the board does not answer");
                }
            }
            Some(Err(error)) => self.lost(&error),
            None => self.reopen(),
        }
        if self.stale() {
            self.learn_anew();
        }
        if self.recording.as_ref().is_some_and(Recording::has_failed) {
            self.recording = None;
        }
    }

    fn reopen(&mut self) {
        match self.opening.take() {
            Some(opening) if opening.is_finished() => {
                self.tried = Instant::now();
                if let Ok(Ok((board, known))) = opening.join() {
                    self.board = Some(board);
                    self.heard = Instant::now();
                    self.now_known(known);
                    self.link_is(Link::Connected);
                    self.shared.log(Weight::Plain, "the link is back");
                }
            }
            None if self.tried.elapsed() > RETRY => {
                let (target, reopen) = (self.target.clone(), self.reopen);
                self.opening = Some(thread::spawn(move || {
                    let mut board = reopen(&target)?;
                    // It may still be driven by what was asked before, and these questions would keep it so.
                    board.vent()?;
                    let known = learn(&mut board)?;
                    Ok((board, known))
                }));
            }
            opening => {
                self.opening = opening;
                thread::sleep(LOOK);
            }
        }
    }

    fn lost(&mut self, error: &BoardError) {
        // A board that was driven is asked to stop as it is dropped, and a silent one is waited for.
        let board = self.board.take();
        thread::spawn(move || drop(board));
        self.tried = Instant::now();
        self.link_is(Link::Lost);
        self.shared.log(
            Weight::Fault,
            format!("the link is lost ({error}); a board that is driven vents by itself"),
        );
    }

    fn link_is(&mut self, link: Link) {
        self.link = link;
        self.shown = None;
        if link != Link::Connected {
            self.frames.interrupted();
            self.next_step = None;
        }
    }

    /// Whether the board has restarted or was configured by another program.
    fn stale(&self) -> bool {
        let identity =
            |status: &Status| (status.restarts, status.config_checksum, status.config_name);
        let said = self.board.as_ref().and_then(LiveBoard::last_status);
        said.is_some_and(|said| identity(&said) != identity(&self.known.status))
    }

    fn learn_anew(&mut self) {
        match self.board.as_mut().map(learn) {
            Some(Ok(known)) => self.now_known(known),
            Some(Err(error)) => self.lost(&error),
            None => (),
        }
    }

    fn now_known(&mut self, known: Known) {
        let before = std::mem::replace(&mut self.known, known).status;
        self.configuration = self.known.configuration(&self.target);
        let now = self.known.status;
        if now.restarts != before.restarts {
            self.shared.log(Weight::Fault, "the board has restarted");
        }
        if now.config_checksum != before.config_checksum {
            self.shared.log(Weight::Plain, format!("configuration: {}", called(&now)));
            // Its rows belong to the former configuration.
            self.finish_recording();
        }
        self.shown = None;
    }

    fn see(&mut self, telemetry: &Telemetry) {
        self.heard = Instant::now();
        if self.link == Link::Silent {
            self.link_is(Link::Connected);
            self.shared.log(Weight::Plain, "the board answers again");
        }
        self.see_faults(telemetry.faults);
        self.see_status();
        self.set_point = telemetry.set_point;
        // The core does not count the steps of its startup check.
        if telemetry.mode == Mode::StartupCheck {
            self.next_step = None;
            return;
        }
        let lost = self.next_step.and_then(|next| telemetry.step.checked_sub(next));
        self.lost_steps += u64::from(lost.unwrap_or_default());
        self.next_step = Some(telemetry.step.wrapping_add(1));
        if let Some(recording) = &self.recording {
            recording.step(self.board.as_ref().and_then(LiveBoard::last_status), telemetry);
        }
        if let Some(parcel) = self.frames.add(&self.known.config, telemetry) {
            // Without a page there is no receiver.
            let _ = self.shared.frames.send(parcel.into());
        }
        if telemetry.step.is_multiple_of(CALIBRATION_STEPS) {
            self.calibrate(telemetry);
        }
    }

    fn see_faults(&mut self, faults: Faults) {
        let before = std::mem::replace(&mut self.faults, faults);
        if before == faults {
            return;
        }
        self.shown = None;
        let changed = |from: Faults, to: Faults| to.without(from).without(Faults::NOT_CONFIGURED);
        let new = changed(before, faults);
        if faults.intersects(Faults::NOT_CONFIGURED) && !before.intersects(Faults::NOT_CONFIGURED) {
            self.shared.log(Weight::Plain, "the board waits for its configuration, and vents");
        }
        if new != Faults::NONE {
            let vents = if new.intersects(VENTING) { "; the muscle vents" } else { "" };
            self.shared.log(Weight::Fault, format!("fault: {new}{vents}"));
        }
        let gone = changed(faults, before);
        if gone != Faults::NONE {
            self.shared.log(Weight::Plain, format!("no longer: {gone}"));
        }
    }

    fn see_status(&mut self) {
        let Some(status) = self.board.as_ref().and_then(LiveBoard::last_status) else { return };
        if status.armed_pa != self.known.status.armed_pa {
            self.known.status.armed_pa = status.armed_pa;
            self.shown = None;
            self.shared.log(
                Weight::Plain,
                status.armed_pa.map_or("no longer armed".to_owned(), |pa| {
                    format!("armed up to {:.1} kPa", pa / 1e3)
                }),
            );
        }
    }

    fn calibrate(&mut self, telemetry: &Telemetry) {
        let Some(Guided::Calibration(calibration)) = &mut self.guided else { return };
        let vents = calibrate::vents(telemetry.mode);
        let Step::Calibrated(config, [first, second]) = calibration.see(&telemetry.sample, vents)
        else {
            return;
        };
        let name = self.known.status.config_name;
        let configured = match self.board.as_mut() {
            Some(board) => board.configure(&config, name.as_str()).map_err(NotDone::from),
            None => Err(NO_LINK),
        };
        let calibrated = configured.is_ok();
        let text = match configured {
            Ok(_) => format!(
                "Put right by {first} and {second}. The board has it, and vents; it is not saved."
            ),
            Err(error) => format!("Not calibrated: {error}."),
        };
        if let Some(Guided::Calibration(calibration)) = &self.guided {
            self.guided = Some(calibration.outcome(&text, calibrated));
        }
        if calibrated {
            self.remember();
        }
        self.shown = None;
    }

    fn carry_out(&mut self, order: Order, wanted: &dyn Fn() -> bool) {
        if let Err(error) = self.attempt(order, wanted) {
            match error {
                NotDone::Board(error @ BoardError::Line(_)) => self.lost(&error),
                other => self.shared.log(Weight::Refused, other.to_string()),
            }
        }
        self.shown = None;
    }

    fn attempt(&mut self, order: Order, wanted: &dyn Fn() -> bool) -> Result<(), NotDone> {
        let Some(order) = self.attempt_beside(order, wanted)? else { return Ok(()) };
        let board = self.board.as_mut().ok_or(NO_LINK)?;
        match order {
            Order::Arm { most_pa } => board.arm(most_pa)?,
            Order::Set(set_point) => {
                board.set(set_point)?;
                self.shared.log(Weight::Plain, format!("set point: {}", asked_for(set_point)));
            }
            Order::Clear => board.forget_faults()?,
            Order::Configure(_) | Order::Back if self.recording.is_some() => return Err(RECORDS),
            Order::Configure(text) => {
                let (config, name) = configuration(&self.target, text)?;
                board.configure(&config, &name)?;
                self.remember();
            }
            Order::Back => return self.back(),
            Order::Save => {
                board.save()?;
                self.shared.log(Weight::Plain, "the configuration is kept over the loss of power");
                self.known.status = board.status()?;
                self.configuration = self.known.configuration(&self.target);
            }
            Order::Record if self.recording.is_none() => self.record()?,
            Order::Calibrate(_) if self.recording.is_some() => return Err(RECORDS),
            Order::Calibrate(_) if self.known.status.config_source == ConfigSource::Defaults => {
                return Err(BoardError::Refused(Refusal::NotConfigured).into());
            }
            Order::Calibrate(sensor) => {
                let calibration = Calibration::new(sensor.into(), self.known.config);
                self.guided = Some(Guided::Calibration(Box::new(calibration)));
            }
            Order::Record
            | Order::Leave
            | Order::Finish
            | Order::Reference(_)
            | Order::Identify { .. }
            | Order::Compare(_)
            | Order::Apply
            | Order::Close
            | Order::Tune { .. }
            | Order::Stops { .. } => (),
        }
        Ok(())
    }

    /// Carries out an order that is more than a request to the board; returns any other.
    fn attempt_beside(
        &mut self,
        order: Order,
        wanted: &dyn Fn() -> bool,
    ) -> Result<Option<Order>, NotDone> {
        match order {
            Order::Leave => self.guided = None,
            Order::Finish => self.finish_recording(),
            Order::Reference(text) => {
                if let Some(Guided::Calibration(calibration)) = &mut self.guided {
                    calibration.answer(&text);
                }
            }
            Order::Identify { data, sought, keys } => {
                let begun = self.identify(data, sought, &keys);
                self.said("Identification", begun)?;
            }
            Order::Compare(records) => {
                let begun = self.compare(records);
                self.said("Comparison", begun)?;
            }
            Order::Apply => {
                let applied = self.apply();
                self.said("Identification", applied)?;
            }
            Order::Close => self.study.close(),
            Order::Tune { most_pa } => self.tune(most_pa, wanted)?,
            Order::Stops { most_pa } => self.measure_stops(most_pa, wanted)?,
            other => return Ok(Some(other)),
        }
        Ok(None)
    }

    /// Keeps the known configuration as the former one: the board has just got another.
    fn remember(&mut self) {
        let Known { config, status, .. } = &self.known;
        if status.config_source != ConfigSource::Defaults {
            self.former = Some((*config, status.config_name.as_str().to_owned()));
        }
    }

    fn back(&mut self) -> Result<(), NotDone> {
        let (config, name) = self.former.clone().ok_or(NO_FORMER)?;
        self.board.as_mut().ok_or(NO_LINK)?.configure(&config, &name)?;
        self.remember();
        self.guided = None;
        if !self.study.works() {
            self.study.close();
        }
        Ok(())
    }

    /// Shows a refusal where the study is shown.
    fn said(&mut self, title: &str, done: Result<(), NotDone>) -> Result<(), NotDone> {
        if let Err(error) = &done {
            self.study.refused(title, error.to_string());
        }
        done
    }

    fn identify(&mut self, data: Source, sought: Sought, keys: &[String]) -> Result<(), NotDone> {
        if self.study.works() {
            return Err(ONE_STUDY);
        }
        if self.known.status.config_source == ConfigSource::Defaults {
            return Err(BoardError::Refused(Refusal::NotConfigured).into());
        }
        self.study.close();
        let data = Content::of(data, &self.shared).ok_or(NO_SOURCE)?;
        self.study.identify(self.known.config, (sought, keys), data, &self.out)?;
        self.shared.log(Weight::Plain, "identification begins");
        Ok(())
    }

    fn compare(&mut self, records: [Source; 2]) -> Result<(), NotDone> {
        if self.study.works() {
            return Err(ONE_STUDY);
        }
        self.study.close();
        let [first, second] = records.map(|source| Content::of(source, &self.shared));
        self.study.compare([first.ok_or(NO_SOURCE)?, second.ok_or(NO_SOURCE)?], &self.out);
        Ok(())
    }

    /// Gives the board the identified values.
    fn apply(&mut self) -> Result<(), NotDone> {
        let Fit { before, after } = self.study.fit().cloned().ok_or(NO_FIT)?;
        if self.recording.is_some() {
            return Err(RECORDS);
        }
        if self.set_point != SetPoint::Vent {
            return Err(DRIVEN);
        }
        if before != self.known.config {
            return Err(OTHER_CONFIG);
        }
        let name = self.known.status.config_name;
        self.board.as_mut().ok_or(NO_LINK)?.configure(&after, name.as_str())?;
        self.remember();
        self.study.applied();
        self.shared.log(Weight::Plain, "the board has the identified values, and vents");
        Ok(())
    }

    fn record(&mut self) -> Result<(), NotDone> {
        let port = self.target.port();
        let shared = Arc::clone(&self.shared);
        let recording = Recording::begin(&self.out, &self.logs, port, self.known.config, shared)?;
        self.recording = Some(recording);
        self.shared.log(Weight::Plain, "recording begins");
        Ok(())
    }

    fn tune(&mut self, most_pa: f64, wanted: &dyn Fn() -> bool) -> Result<(), NotDone> {
        if self.recording.is_some() {
            return Err(RECORDS);
        }
        if self.known.status.config_source == ConfigSource::Defaults {
            return Err(BoardError::Refused(Refusal::NotConfigured).into());
        }
        let most_pa = tune::highest_pa(&self.known.config, Some(most_pa))?;
        let known = from_config::to_scenario(&self.known.config)?.scenario;
        let mut board = self.board.take().ok_or(NO_LINK)?;
        self.shared.log(Weight::Plain, "tuning begins");
        let name = self.known.status.config_name;
        let shared = Arc::clone(&self.shared);
        let ends = || shared.orders.vent_wanted().is_some() || wanted();
        let bench = LiveBench::new(&mut board, name.as_str(), most_pa, &ends);
        let tuned = tuning::tune(&known, most_pa, bench, &mut |telemetry, part| {
            let text = format!(
                "Run {}: {:.0} of {:.0} s. To vent ends it.",
                part.number, part.time_s, part.duration_s
            );
            self.show_progress("Tuning", text, part.time_s / part.duration_s);
            self.see(telemetry);
            self.show();
        });
        self.tuning = None;
        self.board = Some(board);
        self.heard = Instant::now();
        if tuned.as_ref().is_ok_and(|tuned| tuned.findings.adopted) {
            self.remember();
        }
        self.learn_anew();
        match tuned {
            Ok(tuned) => self.tuned(&tuned)?,
            Err(error) => self.not_tuned(error),
        }
        Ok(())
    }

    fn tuned(&mut self, tuned: &Tuned) -> Result<(), InputError> {
        let (folder, name) = next_folder(&self.out, "tune");
        tuning::write(tuned, &folder, &name)?;
        self.shared.log(Weight::Plain, format!("tuned: {}", folder.display()));
        let text = "friction, valves and gains".to_owned();
        self.shared.add_result(Outcome { name: name.clone(), folder, text, trace: false });
        let adopted = tuned.findings.adopted;
        let has = if adopted {
            "The board has the tuned values, and vents; they are not saved."
        } else {
            "The board has its former values again, and vents."
        };
        self.guided = Some(Guided::Over(Guide {
            title: "Tuning".to_owned(),
            text: format!("{}\n{has}", tuned.findings.verdict()),
            table: tuned.findings.rows(),
            chooses: adopted,
            result: Some(name),
            over: true,
            ..Guide::default()
        }));
        Ok(())
    }

    fn measure_stops(&mut self, most_pa: f64, wanted: &dyn Fn() -> bool) -> Result<(), NotDone> {
        if self.recording.is_some() {
            return Err(RECORDS);
        }
        if self.known.status.config_source == ConfigSource::Defaults {
            return Err(BoardError::Refused(Refusal::NotConfigured).into());
        }
        let config = self.known.config;
        let loaded = from_config::to_scenario(&config)?.scenario;
        let most_pa = tune::highest_pa(&config, Some(most_pa))?;
        let plan = Plan::new(&loaded, &config, &Asked::usual(most_pa), None)?;
        let mut board = self.board.take().ok_or(NO_LINK)?;
        self.shared.log(Weight::Plain, "stops are measured");
        let mut record = Record::default();
        let whole_s = plan.driven.plant.run.duration_s;
        let outcome = LiveRows::arm(&mut board, config, &plan, true)
            .map_err(RunError::from)
            .and_then(|mut bench| {
                bench.measure(&plan, &mut record, &mut |telemetry| {
                    let time_s = f64::from(telemetry.step) * plan.driven.plant.run.step_s;
                    self.show_progress(
                        "Stops",
                        format!("{time_s:.0} of {whole_s:.0} s. To vent ends it."),
                        time_s / whole_s,
                    );
                    self.see(telemetry);
                    self.show();
                    self.shared.orders.vent_wanted().is_some() || wanted()
                })
            });
        self.tuning = None;
        self.board = Some(board);
        self.heard = Instant::now();
        self.learn_anew();
        let why = match outcome {
            Ok(()) => None,
            Err(RunError::Stopped) => Some(format!(
                "{}; the board vents",
                self.shared.orders.vent_wanted().unwrap_or("it ended")
            )),
            Err(error) => Some(error.to_string()),
        };
        if let Some(why) = why {
            let text = format!("Nothing was measured: {why}.");
            self.shared.log(Weight::Refused, text.clone());
            self.guided = Some(Guided::failed("Stops", text));
            return Ok(());
        }
        let findings = stops::measured(&record, &plan, &loaded, &self.target.name());
        self.publish_stops(&findings, &record, &loaded)
    }

    fn publish_stops(
        &mut self,
        findings: &stops::Findings,
        record: &Record,
        loaded: &Loaded,
    ) -> Result<(), NotDone> {
        let (folder, name) = next_folder(&self.out, "stops");
        let mut files = OutputDir::create(&folder)?;
        stops::write(&mut files, findings, record, loaded, &name)?;
        files.publish()?;
        self.shared.log(Weight::Plain, format!("stops measured: {}", folder.display()));
        let text = "gas temperature at stops, heat transfer".to_owned();
        self.shared.add_result(Outcome { name: name.clone(), folder, text, trace: true });
        self.guided = Some(Guided::Over(Guide {
            title: "Stops".to_owned(),
            text: findings.text(UnitSystem::Practical),
            result: Some(name),
            over: true,
            ..Guide::default()
        }));
        Ok(())
    }

    fn show_progress(&mut self, title: &str, text: String, progress: f64) {
        if self.shared.orders.refuse() {
            self.shared.log(Weight::Refused, "the board is at work: to vent ends that");
        }
        let (title, progress) = (title.to_owned(), Some(progress));
        self.tuning = Some(Guide { title, text, progress, ..Guide::default() });
    }

    fn not_tuned(&mut self, error: TuneError) {
        let why = match (error, self.shared.orders.vent_wanted()) {
            (TuneError::Run(RunError::Board(BoardError::Interrupted)), Some(why)) => {
                format!("{why}; the board vents")
            }
            (error, _) => error.to_string(),
        };
        let text = format!("Nothing was tuned: {why}.");
        self.shared.log(Weight::Refused, text.clone());
        self.guided = Some(Guided::failed("Tuning", text));
    }

    fn finish_recording(&mut self) {
        let Some(recording) = self.recording.take() else { return };
        if let Some(Ok(timing)) = self.board.as_mut().map(LiveBoard::timing) {
            self.known.timing = timing;
        }
        self.writers.retain(|writer| !writer.is_finished());
        self.writers.push(recording.end(self.known.status, self.known.timing));
    }

    /// Sends the state when it is due.
    fn show(&mut self) {
        if self.shown.is_some_and(|shown| shown.elapsed() < STATE) {
            return;
        }
        self.shown = Some(Instant::now());
        self.study.poll(&self.shared);
        let Known { status, timing, .. } = &self.known;
        let guide = self.guided.as_ref().map(Guided::state);
        let state = State {
            kind: "state",
            link: self.link,
            target: self.target.name(),
            board: self.board.as_ref().map(|board| board.version().into()),
            configuration: self.configuration.clone(),
            former: self.former.as_ref().map(|(_, name)| name.clone()),
            armed_pa: status.armed_pa,
            faults: names(self.faults),
            vents: self.faults.intersects(VENTING),
            timing: Some(*timing),
            lost_steps: self.lost_steps,
            recording: self.recording.as_ref().map(Recording::recorded),
            results: self.results(),
            guide: self.tuning.clone().or(guide),
            study: self.study.state(),
            events: self.shared.events(),
        };
        let json = serde_json::to_string(&state).expect("plain data");
        self.shared.state.send_if_modified(|before| {
            let other = before.as_str() != json;
            if other {
                *before = json.into();
            }
            other
        });
    }

    fn results(&self) -> Vec<ResultLink> {
        let results = self.shared.results().into_iter().rev();
        let link = |Outcome { name, text, trace, .. }| ResultLink { name, text, trace };
        results.map(link).collect()
    }
}

/// Requests what the page shows, and the telemetry of every step.
fn learn(board: &mut LiveBoard) -> Result<Known, BoardError> {
    board.telemetry_every(1)?;
    Ok(Known { config: board.config()?, status: board.status()?, timing: board.timing()? })
}

/// Configuration to send, and its name.
fn configuration(target: &Target, text: Option<ScenarioText>) -> Result<(Config, String), NotDone> {
    let (loaded, name) = match text {
        Some(ScenarioText { name, text }) => {
            let loaded = thermyo_setup::parse_alone(&text, Path::new(&name))?;
            let stem = Path::new(&name).file_stem().unwrap_or_default();
            (loaded, stem.to_string_lossy().into_owned())
        }
        None => {
            let unknown = NotDone::NotNow("no scenario is selected for this port: choose one");
            (target.muscle()?.ok_or(unknown)?, target.muscle_name())
        }
    };
    Ok((core_config(&loaded.believed), name))
}

fn names(faults: Faults) -> Vec<&'static str> {
    faults.names().collect()
}

fn called(status: &Status) -> String {
    match status.config_name.as_str() {
        "" => format!("without a name, {:08x}", status.config_checksum),
        name => format!("{name}, {:08x}", status.config_checksum),
    }
}

fn asked_for(set_point: SetPoint) -> String {
    match set_point {
        SetPoint::Vent => "vent".to_owned(),
        SetPoint::Duty { inlet, outlet } => {
            format!("inlet {:.1} %, outlet {:.1} %", inlet * 100.0, outlet * 100.0)
        }
        SetPoint::MassFlow { flow_kg_s } => format!("{:.3} g/s", flow_kg_s * 1e3),
        SetPoint::MassFlowCycle { flow_kg_s, period_s } => {
            format!("cycles of {period_s:.2} s, {:.3} g/s", flow_kg_s * 1e3)
        }
        SetPoint::Pressure { pressure_pa } => format!("{:.1} kPa", pressure_pa / 1e3),
        SetPoint::Contraction { contraction } => {
            format!("contraction {:.2} %", contraction * 100.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The operator and a board at a pseudo-terminal that answers every request.
    #[cfg(unix)]
    mod at_a_terminal {
        use super::super::*;
        use crate::word::Order;
        use serialport::{SerialPort, TTYPort};
        use std::io::{ErrorKind, Read, Write};
        use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
        use std::sync::{Mutex, OnceLock};
        use thermyo_protocol::{
            Answer, Chip, Decoder, HostCommand, Image, Message, PROTOCOL, Reply, Request, Version,
            checksum, encode,
        };

        /// It bounds hanging, and is no figure.
        const HANGS: Duration = Duration::from_secs(60);

        fn until(what: &str, holds: impl Fn() -> bool) {
            let began = Instant::now();
            while !holds() {
                assert!(began.elapsed() < HANGS, "{what}");
                thread::sleep(Duration::from_millis(5));
            }
        }

        /// An operator of a board that answers as long as `hears` is true of every request.
        fn operated(
            out: &Path,
            mut hears: impl FnMut(HostCommand) -> bool + Send + 'static,
        ) -> Operator {
            let (mut board, port) = TTYPort::pair().unwrap();
            board.set_timeout(Duration::from_millis(5)).unwrap();
            let target = Target::Port(port.name().unwrap());
            thread::spawn(move || {
                let (mut requests, mut bytes) = (Decoder::new(), [0; 64]);
                loop {
                    let count = match board.read(&mut bytes) {
                        Ok(count) => count,
                        Err(error) if error.kind() == ErrorKind::TimedOut => continue,
                        Err(_) => return,
                    };
                    for byte in &bytes[..count] {
                        let Some(Request { sequence, command }) = requests.push(*byte) else {
                            continue;
                        };
                        if !hears(command) {
                            return;
                        }
                        let answer = answer(command);
                        let frame = encode(&Message::Reply(Reply { sequence, answer })).unwrap();
                        board.write_all(&frame).unwrap();
                    }
                }
            });
            let opened = target.open().unwrap();
            // Until now it kept the terminal open for the board.
            drop(port);
            Operator::new(target, opened, out, Logs::default()).unwrap()
        }

        fn answer(command: HostCommand) -> Answer {
            let config = Config::default();
            match command {
                HostCommand::Version => Answer::Version(Version {
                    protocol: PROTOCOL,
                    firmware: [0, 1, 0],
                    chip: Chip::Rp2040,
                    image: Image::Muscle,
                }),
                HostCommand::ReadConfig => Answer::Config(config),
                HostCommand::Status => Answer::Status(Status {
                    config_checksum: checksum(&config),
                    ..Status::AT_START
                }),
                HostCommand::Timing => Answer::Timing(Timing::default()),
                _ => Answer::Done { step: 0 },
            }
        }

        #[test]
        fn no_order_is_carried_out_between_a_vent_and_its_arrival() {
            let heard: Arc<Mutex<Vec<HostCommand>>> = Arc::default();
            let shared: Arc<OnceLock<Arc<Shared>>> = Arc::default();
            let out = tempfile::tempdir().unwrap();
            let set = |pressure_pa| Order::Set(SetPoint::Pressure { pressure_pa });
            let operator = operated(out.path(), {
                let (heard, shared) = (Arc::clone(&heard), Arc::clone(&shared));
                move |command| {
                    let shared = shared.get();
                    let driven = matches!(command, HostCommand::Set(_));
                    if let Some(shared) = shared.filter(|_| driven) {
                        let orders = |from: u16| {
                            for i in from..from + 250 {
                                let pressure_pa = 1.3e5 + f32::from(i);
                                shared.orders.put(set(pressure_pa));
                                shared.orders.put(Order::Arm { most_pa: Some(pressure_pa) });
                                shared.orders.put(Order::Clear);
                                shared.orders.put(Order::Save);
                            }
                        };
                        orders(0);
                        shared.vent("a test");
                        orders(250);
                    }
                    heard.lock().unwrap().push(command);
                    true
                }
            });
            let shared = shared.get_or_init(|| operator.shared());
            shared.orders.put(set(1.2e5));
            let heard = || heard.lock().unwrap().clone();
            let stopped = || heard().contains(&HostCommand::Stop);
            let operating = thread::spawn(move || operator.run(&|| false));
            until("it vents", stopped);
            shared.end();
            operating.join().unwrap();
            let heard = heard();
            let driven = heard.iter().position(|command| matches!(command, HostCommand::Set(_)));
            let after = heard[driven.unwrap() + 1..].iter().filter(|c| **c != HostCommand::Alive);
            let after: Vec<_> = after.collect();
            assert_eq!(after.first(), Some(&&HostCommand::Stop), "{after:?}");
            let moves =
                |c: &&&HostCommand| matches!(c, HostCommand::Set(_) | HostCommand::Arm { .. });
            assert_eq!(after.iter().find(moves), None, "what came before the vent is dropped");
        }

        /// The firmware's ration: 16 requests at once, one more every 4 ms.
        #[test]
        fn a_flood_of_orders_and_vents_stays_within_what_a_board_carries_out() {
            const REQUESTS: f64 = 16.0;
            const EVERY_S: f64 = 0.004;
            let [dropped, vents] = [(); 2].map(|()| Arc::new(AtomicU32::new(0)));
            let shared: Arc<OnceLock<Arc<Shared>>> = Arc::default();
            let out = tempfile::tempdir().unwrap();
            let operator = operated(out.path(), {
                let (dropped, vents) = (Arc::clone(&dropped), Arc::clone(&vents));
                let shared = Arc::clone(&shared);
                let (mut left, mut since) = (REQUESTS, Instant::now());
                move |command| {
                    left = REQUESTS.min(left + since.elapsed().as_secs_f64() / EVERY_S);
                    since = Instant::now();
                    left -= if command == HostCommand::Save { 4.0 } else { 1.0 };
                    dropped.fetch_add(u32::from(left < 0.0), Ordering::Relaxed);
                    vents.fetch_add(u32::from(command == HostCommand::Stop), Ordering::Relaxed);
                    if let Some(shared) = shared.get() {
                        shared.orders.put(Order::Clear);
                        shared.orders.put(Order::Save);
                        shared.vent("a test");
                    }
                    true
                }
            });
            let shared = shared.get_or_init(|| operator.shared());
            shared.vent("a test");
            let operating = thread::spawn(move || operator.run(&|| false));
            until("it vents", || vents.load(Ordering::Relaxed) > 40);
            shared.end();
            operating.join().unwrap();
            assert_eq!(dropped.load(Ordering::Relaxed), 0);
        }

        #[test]
        fn neither_a_vent_nor_the_end_waits_for_a_port_that_is_opened() {
            static OPENING: AtomicBool = AtomicBool::new(false);
            let out = tempfile::tempdir().unwrap();
            let gone = Arc::new(AtomicBool::new(false));
            let mut operator = operated(out.path(), {
                let gone = Arc::clone(&gone);
                move |_| !gone.load(Ordering::Relaxed)
            });
            operator.reopen = |_| {
                OPENING.store(true, Ordering::Relaxed);
                loop {
                    thread::park();
                }
            };
            let shared = operator.shared();
            gone.store(true, Ordering::Relaxed);
            let operating = thread::spawn(move || operator.run(&|| false));
            until("the port is opened again", || OPENING.load(Ordering::Relaxed));
            shared.vent("a test");
            let vented = || shared.events().iter().any(|event| event.text.contains("no link"));
            until("the vent is seen to", vented);
            shared.end();
            until("it ends", || operating.is_finished());
        }
    }

    #[test]
    fn a_page_names_no_file() {
        for (text, key) in [
            ("[drive]\nkind = \"pressure\"\nprofile_csv = \"/etc/passwd\"\n", "drive.profile_csv"),
            ("[vessel]\nvolume_csv = \"/etc/passwd\"\n", "vessel.volume_csv"),
            ("[table]\ncsv = \"/etc/passwd\"\n", "table.csv"),
        ] {
            let text = ScenarioText { name: "sent.toml".to_owned(), text: text.to_owned() };
            let error = configuration(&Target::Emulated, Some(text)).unwrap_err().to_string();
            let said = format!("{key} = \"/etc/passwd\": must be left out");
            assert!(error.starts_with("sent.toml:") && error.contains(&said), "{error}");
        }
    }
}
