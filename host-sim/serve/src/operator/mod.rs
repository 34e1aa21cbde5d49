//! The thread that owns the link: reads every step, carries out orders, vents before anything else.

mod joint;
mod muscle;
mod served;
mod tuning;

pub use served::{Held, Served};

use super::frames::Frames;
use super::orders::Next;
use super::recording::Recording;
use super::results::Outcome;
use super::shared::Shared;
use super::state::{Configuration, Link, ResultLink, State, Weight};
use super::target::Target;
use super::word::Order;
use model_core::Faults;
use served::{Tasks, VENTS};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use thermyo_files::input::InputError;
use thermyo_logs::Logs;
use thermyo_protocol::{ConfigSource, Refusal, Status, Timing};
use thermyo_simulation::board::BoardError;
use thermyo_studies::stops;
use thermyo_studies::tune::OutOfReach;

/// A board without telemetry for this long counts as silent.
const SILENCE: Duration = Duration::from_millis(500);
/// A silence that is no restart of the board, which takes 1.6 s at most.
const LONGEST_START: Duration = Duration::from_secs(2);
/// Interval of attempts to open a lost port.
const RETRY: Duration = Duration::from_millis(300);
/// Polling interval of a port that is being opened.
const LOOK: Duration = Duration::from_millis(20);
/// Interval of state messages when nothing is urgent.
const STATE: Duration = Duration::from_millis(250);
/// Interval of orders. A board carries out 250 requests a second and drops the others, so the wait for their answers
/// would time out; an order takes eleven requests at most.
const BETWEEN_ORDERS: Duration = Duration::from_millis(50);

/// Operator of a board. `S` is the board: of one muscle, or of a joint.
pub struct Operator<S: Served> {
    target: Target,
    out: PathBuf,
    logs: Logs,
    shared: Arc<Shared>,
    board: Option<S>,
    known: Known<S>,
    /// The part of the configuration that the page needs.
    configuration: Configuration,
    /// Configuration and name before the last change.
    former: Option<(S::Config, String)>,
    link: Link,
    frames: Frames<S>,
    recording: Option<Recording<S::Record>>,
    /// Threads that write reports.
    writers: Vec<JoinHandle<()>>,
    tasks: S::Tasks,
    faults: Held,
    /// The set point of the last step; none before the first.
    set_point: Option<S::SetPoint>,
    next_step: Option<u32>,
    lost_steps: u64,
    heard: Instant,
    /// Whether the events report the board's silence.
    missed: bool,
    /// Time of the last order or vent, and whether it was a vent.
    carried_out: Instant,
    vented: bool,
    tried: Instant,
    /// An attempt to open the lost port. It waits for a silent board, but neither a vent nor the end waits for it.
    opening: Option<Opening<S>>,
    reopen: fn(&Target) -> Result<S, BoardError>,
    shown: Option<Instant>,
}

/// A port that is being opened, with the answers of its board.
type Opening<S> = JoinHandle<Result<(S, Known<S>), BoardError>>;

/// Answers of the board.
struct Known<S: Served> {
    config: S::Config,
    status: Status,
    timing: Timing,
}

impl<S: Served> Known<S> {
    fn configuration(&self, target: &Target) -> Configuration {
        Configuration::new(
            S::muscles(&self.config),
            S::part(&self.config),
            &self.status,
            S::own(target),
        )
    }
}

#[derive(Debug, thiserror::Error)]
pub enum NotDone {
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
const RECORDS: NotDone =
    NotDone::NotNow("a recording runs, and a record has one configuration: end it first");

impl<S: Served> Operator<S> {
    /// Operator of an opened board; recordings go to folders in `out`, and to `logs`.
    pub fn new(target: Target, mut board: S, out: &Path, logs: Logs) -> Result<Self, BoardError> {
        let known = learn(&mut board)?;
        let now = Instant::now();
        let configuration = known.configuration(&target);
        let shared = Arc::new(Shared::of(S::KIND));
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
            tasks: S::Tasks::default(),
            faults: Held::default(),
            set_point: None,
            next_step: None,
            lost_steps: 0,
            heard: now,
            missed: false,
            carried_out: now,
            vented: false,
            tried: now,
            opening: None,
            reopen: Target::reopen::<S>,
            shown: None,
        };
        operator.show();
        Ok(operator)
    }

    pub fn shared(&self) -> Arc<Shared> {
        Arc::clone(&self.shared)
    }

    /// Operates until `wanted` returns true; then vents, and ends a recording. Returns whether the board has confirmed
    /// the vent.
    pub fn run(mut self, wanted: &dyn Fn() -> bool) -> bool {
        while !wanted() && !self.shared.ended() {
            // Telemetry that arrived while an order waited for its answer is read before the next
            // order; otherwise the pages and the record would lag further with each.
            let behind = self.board.as_ref().is_some_and(S::is_behind);
            let rested = self.carried_out.elapsed() >= BETWEEN_ORDERS;
            // A vent is carried out at once, except right after another one: the board vents already.
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
        let vents = self.board.is_some();
        self.tasks.end();
        self.finish_recording();
        for writer in self.writers.drain(..) {
            let _ = writer.join();
        }
        self.shared.log(Weight::Plain, "the server has ended");
        (self.link, self.shown) = (Link::Ended, None);
        self.show();
        self.shared.end();
        vents
    }

    fn vent(&mut self) {
        self.tasks.vented();
        match self.board.as_mut().map(S::vent) {
            Some(Ok(())) => self.shared.log(Weight::Plain, S::VENTS),
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
        match self.board.as_mut().map(S::poll) {
            Some(Ok(Some(telemetry))) => self.see(&telemetry),
            Some(Ok(None)) => {
                let silent = self.heard.elapsed();
                if self.link == Link::Connected && silent > SILENCE {
                    self.missed = false;
                    self.link_is(Link::Silent);
                }
                if self.link == Link::Silent && !self.missed && silent > LONGEST_START {
                    self.missed = true;
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
                match opening.join() {
                    Ok(Ok((board, known))) => {
                        self.board = Some(board);
                        self.heard = Instant::now();
                        self.now_known(known);
                        self.link_is(Link::Connected);
                        self.shared.log(Weight::Plain, "the link is back");
                    }
                    Ok(Err(BoardError::Refused(refusal))) => self.refused(refusal),
                    _ => (),
                }
            }
            None if self.tried.elapsed() > RETRY => {
                let (target, reopen) = (self.target.clone(), self.reopen);
                self.opening = Some(thread::spawn(move || {
                    let mut board = reopen(&target)?;
                    // An earlier set point may still drive the board, and these requests would keep it so.
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

    /// Reports once that another board, or the other image, is at the lost port.
    fn refused(&mut self, refusal: Refusal) {
        let text = format!(
            "the link stays lost: {refusal}. Started again, `thermyo serve` shows the board that is there"
        );
        if self.shared.events().first().is_none_or(|last| last.text != text) {
            self.shared.log(Weight::Fault, text);
            self.shown = None;
        }
    }

    fn lost(&mut self, error: &BoardError) {
        // Dropping a driven board requests a stop, and waits for a silent board.
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
        let said = self.board.as_ref().and_then(S::last_status);
        said.is_some_and(|said| identity(&said) != identity(&self.known.status))
    }

    fn learn_anew(&mut self) {
        match self.board.as_mut().map(learn) {
            Some(Ok(known)) => self.now_known(known),
            Some(Err(error)) => self.lost(&error),
            None => (),
        }
    }

    fn now_known(&mut self, known: Known<S>) {
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

    fn see(&mut self, telemetry: &S::Telemetry) {
        self.heard = Instant::now();
        if self.link == Link::Silent {
            self.link_is(Link::Connected);
            if std::mem::take(&mut self.missed) {
                self.shared.log(Weight::Plain, "the board answers again");
            }
        }
        self.see_faults(S::faults(telemetry));
        self.see_status();
        self.set_point = Some(S::set_point(telemetry));
        // The core does not count the steps of its startup check.
        if S::is_checking(telemetry) {
            self.next_step = None;
            return;
        }
        let step = S::step(telemetry);
        let lost = self.next_step.and_then(|next| step.checked_sub(next));
        self.lost_steps += u64::from(lost.unwrap_or_default());
        self.next_step = Some(step.wrapping_add(1));
        if let Some(recording) = &self.recording {
            recording.step(self.board.as_ref().and_then(S::last_status), telemetry);
        }
        if let Some(parcel) = self.frames.add(&self.known.config, telemetry) {
            // Without a page there is no receiver.
            let _ = self.shared.frames.send(parcel.into());
        }
        S::see(self, telemetry);
    }

    fn see_faults(&mut self, faults: Held) {
        let before = std::mem::replace(&mut self.faults, faults);
        if before == faults {
            return;
        }
        self.shown = None;
        let changed = |from: Held, to: Held| -> Held {
            let known = |i: usize| from[i].with(Faults::NOT_CONFIGURED);
            std::array::from_fn(|i| to[i].without(known(i)))
        };
        let new = changed(before, faults);
        if among(faults, Faults::NOT_CONFIGURED) && !among(before, Faults::NOT_CONFIGURED) {
            self.shared.log(Weight::Plain, "the board waits for its configuration, and vents");
        }
        if new != Held::default() {
            let vents = if among(new, VENTS) { format!("; {}", S::VENTS) } else { String::new() };
            let names = S::names(new).join(", ");
            self.shared.log(Weight::Fault, format!("fault: {names}{vents}"));
        }
        let gone = changed(faults, before);
        if gone != Held::default() {
            self.shared.log(Weight::Plain, format!("no longer: {}", S::names(gone).join(", ")));
        }
    }

    fn see_status(&mut self) {
        if let Some(status) = self.board.as_ref().and_then(S::last_status) {
            self.see_armed(status.armed_pa);
        }
    }

    fn see_armed(&mut self, armed_pa: Option<f32>) {
        if armed_pa != self.known.status.armed_pa {
            self.known.status.armed_pa = armed_pa;
            self.shown = None;
            self.shared.log(
                Weight::Plain,
                armed_pa.map_or("no longer armed".to_owned(), |pa| {
                    format!("armed up to {:.1} kPa", pa / 1e3)
                }),
            );
        }
    }

    fn carry_out(&mut self, order: Order, wanted: &dyn Fn() -> bool) {
        if let Err(error) = self.attempt(order, wanted) {
            match error {
                NotDone::Board(error @ BoardError::Line(_)) => self.lost(&error),
                other => self.shared.log(Weight::Refused, S::refusal(&other)),
            }
        }
        self.shown = None;
    }

    fn attempt(&mut self, order: Order, wanted: &dyn Fn() -> bool) -> Result<(), NotDone> {
        if let Some(set_point) = S::asked(&order) {
            self.linked()?.set(set_point)?;
            self.shared.log(Weight::Plain, format!("set point: {}", S::words(set_point)));
            return Ok(());
        }
        match order {
            Order::Finish => self.finish_recording(),
            Order::Arm { most_pa } => self.linked()?.arm(most_pa)?,
            Order::Clear => self.linked()?.forget_faults()?,
            Order::Configure(_) | Order::Back if self.recording.is_some() => return Err(RECORDS),
            Order::Configure(text) => {
                let (config, name) = S::configuration(&self.target, text)?;
                self.linked()?.configure(&config, &name)?;
                self.remember();
            }
            Order::Back => return self.back(),
            Order::Save => {
                let board = self.linked()?;
                board.save()?;
                let status = board.status()?;
                self.shared.log(Weight::Plain, "the configuration is kept over the loss of power");
                self.known.status = status;
                self.configuration = self.known.configuration(&self.target);
            }
            Order::Record if self.recording.is_none() => {
                self.linked()?;
                self.record()?;
            }
            Order::Record => (),
            other => return S::attempt(self, other, wanted),
        }
        Ok(())
    }

    fn linked(&mut self) -> Result<&mut S, NotDone> {
        self.board.as_mut().ok_or(NO_LINK)
    }

    /// Keeps the known configuration as the former one: the board has just received another.
    fn remember(&mut self) {
        let Known { config, status, .. } = &self.known;
        if status.config_source != ConfigSource::Defaults {
            self.former = Some((*config, status.config_name.as_str().to_owned()));
        }
    }

    fn back(&mut self) -> Result<(), NotDone> {
        let (config, name) = self.former.clone().ok_or(NO_FORMER)?;
        self.linked()?.configure(&config, &name)?;
        self.remember();
        self.tasks.went_back();
        Ok(())
    }

    fn record(&mut self) -> Result<(), NotDone> {
        let port = self.target.port();
        let shared = Arc::clone(&self.shared);
        let recording = Recording::begin(&self.out, &self.logs, port, &self.known.config, shared)?;
        self.recording = Some(recording);
        self.shared.log(Weight::Plain, "recording begins");
        Ok(())
    }

    fn finish_recording(&mut self) {
        let Some(recording) = self.recording.take() else { return };
        if let Some(Ok(timing)) = self.board.as_mut().map(S::timing) {
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
        let (guide, study) = self.tasks.shown(&self.shared);
        let Known { status, timing, .. } = &self.known;
        let state = State {
            kind: "state",
            link: self.link,
            target: self.target.name(),
            board: self.board.as_ref().map(|board| board.version().into()),
            configuration: self.configuration.clone(),
            former: self.former.as_ref().map(|(_, name)| name.clone()),
            armed_pa: status.armed_pa,
            faults: S::names(self.faults),
            vents: among(self.faults, VENTS),
            timing: Some(*timing),
            lost_steps: self.lost_steps,
            recording: self.recording.as_ref().map(Recording::recorded),
            results: self.results(),
            guide,
            study,
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

/// Requests the values that the page shows, and the telemetry of every step.
fn learn<S: Served>(board: &mut S) -> Result<Known<S>, BoardError> {
    board.telemetry_every(1)?;
    Ok(Known { config: board.config()?, status: board.status()?, timing: board.timing()? })
}

/// Whether one of these faults holds in a muscle or the joint.
fn among(held: Held, faults: Faults) -> bool {
    held.iter().any(|held| held.intersects(faults))
}

fn called(status: &Status) -> String {
    match status.config_name.as_str() {
        "" => format!("without a name, {:08x}", status.config_checksum),
        name => format!("{name}, {:08x}", status.config_checksum),
    }
}

#[cfg(test)]
mod tests;
