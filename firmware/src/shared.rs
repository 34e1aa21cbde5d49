//! What the tasks have in common.

use crate::source::{STEP, into_step};
use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU16, AtomicU32, Ordering};
use embassy_sync::blocking_mutex::{Mutex, raw::CriticalSectionRawMutex};
use embassy_sync::channel::Channel;
use embassy_sync::mutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use model_core::link::arbiter::{Arbiter, Ticket};
use model_core::link::{self, ConfigSource, Name, ReplyWith, Status, Timing, checksum};
use model_core::safety::supervisor::FirstFailure;
use model_core::{Config, Core, Faults, Sample, SetPoint};
use serde::{Serialize, Serializer};

const DEFAULT_TELEMETRY_DIVIDER: u16 = 10;

/// Messages that wait for the line, and how many of them telemetry leaves to replies: while the thread stands
/// still for the flash, only telemetry comes.
const OUTBOX: usize = 8;
const FOR_REPLIES: usize = 1;

/// From the link to control, carried out between two steps. Small: it is moved at every turn of the
/// control task.
#[derive(Clone, Copy)]
pub enum Order {
    /// Start anew as the core that was [prepared](Shared::prepare), with another configuration, and disarm.
    Configure {
        /// That of the configuration.
        checksum: u32,
        /// Where it comes from.
        source: ConfigSource,
        /// What it is called.
        name: Name,
    },
    /// Start anew as the core that was [prepared](Shared::prepare), with this set point.
    Start(SetPoint),
    /// Take set points up to this absolute pressure \[Pa\], or as far as the configuration allows.
    Arm(Option<f32>),
    /// Another set point.
    Set(SetPoint),
    /// Forget latched faults.
    ClearFaults,
}

impl Order {
    /// Whether the muscle may move by it: a stop overtakes it, and its host has to stay for it to hold.
    pub fn may_drive(&self) -> bool {
        matches!(self, Self::Arm(_) | Self::Start(_) | Self::Set(_))
    }

    /// To start anew with this configuration.
    pub fn configure(config: &Config, source: ConfigSource, name: Name) -> Self {
        Self::Configure { checksum: checksum(config), source, name }
    }
}

/// From the link to the keeper.
pub enum Keep {
    /// Save the configuration in use.
    Save,
    /// Forget what was saved.
    Forget,
    /// What happened, the last event first: the one of this number.
    Event(u8),
}

/// The configuration in use, read when it is sent: half a kilobyte that no message has to have room for.
#[derive(Clone, Copy)]
pub struct InUse(pub &'static Shared);

impl Serialize for InUse {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.config().unwrap_or_default().serialize(serializer)
    }
}

/// What goes out.
pub type Message = link::MessageWith<InUse>;
/// What an answer is here.
pub type Answer = link::AnswerWith<InUse>;

/// A place for a core. Unlike that of an `Option`, its empty state is zeros, which take no flash.
#[repr(u8)]
#[allow(clippy::large_enum_variant)] // One static.
enum Slot {
    Empty,
    Full(Core),
}

/// Lines to the host.
pub const LINES: usize = if cfg!(feature = "usb") { 2 } else { 1 };

/// One line to the host: what is to go out on it, and what its host has asked for. Its telemetry is its
/// own: none before the first request, as often as the host wants from then on.
pub struct Line {
    /// To the host.
    pub outbox: Channel<CriticalSectionRawMutex, Message, OUTBOX>,
    /// Steps per telemetry frame, 0 for none, and one more: zero before the first request.
    telemetry: AtomicU32,
    /// Control asks whether there is nothing to read.
    pub asked: Signal<CriticalSectionRawMutex, ()>,
    /// Messages for which the outbox had no room.
    dropped: AtomicU32,
    /// Frames that were no request.
    pub malformed: AtomicU32,
}

impl Line {
    const fn new() -> Self {
        Self {
            outbox: Channel::new(),
            telemetry: AtomicU32::new(0),
            asked: Signal::new(),
            dropped: AtomicU32::new(0),
            malformed: AtomicU32::new(0),
        }
    }

    /// A request has come: telemetry begins.
    pub fn open(&self) {
        if self.telemetry.load(Ordering::Relaxed) == 0 {
            self.set_telemetry_divider(DEFAULT_TELEMETRY_DIVIDER);
        }
    }

    /// Nobody is there any more: nothing is sent until somebody asks again.
    #[cfg(feature = "usb")]
    pub fn close(&self) {
        self.telemetry.store(0, Ordering::Relaxed);
        self.outbox.clear();
    }

    /// Sets the steps per telemetry frame; 0 for none.
    pub fn set_telemetry_divider(&self, steps: u16) {
        self.telemetry.store(u32::from(steps) + 1, Ordering::Relaxed);
    }

    /// Whether a host has asked anything.
    fn is_open(&self) -> bool {
        self.telemetry.load(Ordering::Relaxed) > 0
    }

    /// Whether the host, which is obeyed or not, wants the telemetry of this step.
    pub fn wants(&self, step: u32, obeyed: bool) -> bool {
        if cfg!(feature = "hil") {
            // The answer to its sample.
            return obeyed;
        }
        let divider = self.telemetry.load(Ordering::Relaxed).saturating_sub(1);
        divider > 0 && step.is_multiple_of(divider)
    }

    /// Sends without waiting; what finds no room is counted.
    pub fn post(&self, message: Message) {
        let kept = if matches!(message, Message::Telemetry(_)) { FOR_REPLIES } else { 0 };
        if self.outbox.free_capacity() <= kept || self.outbox.try_send(message).is_err() {
            // Only one context may lose an increment to the other; the count is a diagnosis.
            self.dropped.store(self.dropped.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
        }
    }

    /// Answers a request without waiting.
    pub fn answer(&self, sequence: u8, answer: Answer) {
        self.post(Message::Reply(ReplyWith { sequence, answer }));
    }

    /// Answers a request when there is room: while the flash was busy the outbox may have filled.
    pub async fn answer_later(&self, sequence: u8, answer: Answer) {
        self.outbox.send(Message::Reply(ReplyWith { sequence, answer })).await;
    }
}

/// Who waits for the answer to an order.
#[derive(Clone, Copy)]
pub struct Asker {
    /// Where the request came from.
    pub line: &'static Line,
    /// Its number.
    pub sequence: u8,
    /// When it began to arrive.
    pub ticket: Ticket,
}

/// The one instance is a static of the board.
pub struct Shared {
    /// The lines to the host.
    pub lines: [Line; LINES],
    /// To control, and who is told the outcome, if anybody is.
    pub orders: Channel<CriticalSectionRawMutex, (Option<Asker>, Order), 1>,
    /// To the keeper.
    pub keep: Channel<CriticalSectionRawMutex, (Asker, Keep), 1>,
    /// What has vented, for the keeper.
    pub failed: Signal<CriticalSectionRawMutex, FirstFailure>,
    /// The digital sensors.
    #[cfg(feature = "parts")]
    pub parts: crate::parts::Parts,
    /// Steps for which the thread may stand still, because the flash is busy: control feeds the watchdog.
    pub flash_busy_steps: AtomicU32,
    /// Samples from the host.
    pub samples: Channel<CriticalSectionRawMutex, Sample, 1>,
    /// Grows with every turn of the control task.
    pub heartbeat: AtomicU32,
    /// Faults of the last step.
    pub faults: AtomicU16,
    /// Held while the flash is written, and while an order is given: the flash is written while the muscle is
    /// vented only, since whoever hangs then is found late.
    pub flash: mutex::Mutex<CriticalSectionRawMutex, ()>,
    /// What was saved has been taken: until then nobody is answered, who would hear of the defaults.
    pub recalled: AtomicBool,
    /// Nothing but to vent is asked of control.
    pub vented: AtomicBool,
    /// Requests that the link dropped, because too many came.
    pub dropped_requests: AtomicU32,
    arbiter: Mutex<CriticalSectionRawMutex, Cell<Arbiter<LINES>>>,
    /// Never waited for: the tasks of the thread hold it between two waits, and control reads it when one of
    /// them has sent an order, which it carries out before that task goes on. Interrupts are not held back
    /// while a core is copied: that would take the time of a late step.
    next_core: mutex::Mutex<CriticalSectionRawMutex, Slot>,
    /// What vented first, over restarts.
    first_failure: Mutex<CriticalSectionRawMutex, Cell<Option<FirstFailure>>>,
    tally: Mutex<CriticalSectionRawMutex, Cell<Tally>>,
    status: Mutex<CriticalSectionRawMutex, Cell<Status>>,
}

impl Shared {
    /// At the start.
    pub const fn new() -> Self {
        Self {
            lines: [const { Line::new() }; LINES],
            orders: Channel::new(),
            keep: Channel::new(),
            failed: Signal::new(),
            #[cfg(feature = "parts")]
            parts: crate::parts::Parts::new(),
            flash_busy_steps: AtomicU32::new(0),
            flash: mutex::Mutex::new(()),
            recalled: AtomicBool::new(false),
            samples: Channel::new(),
            heartbeat: AtomicU32::new(0),
            faults: AtomicU16::new(0),
            vented: AtomicBool::new(false),
            dropped_requests: AtomicU32::new(0),
            arbiter: Mutex::new(Cell::new(Arbiter::new())),
            next_core: mutex::Mutex::new(Slot::Empty),
            first_failure: Mutex::new(Cell::new(None)),
            tally: Mutex::new(Cell::new(Tally::NONE)),
            status: Mutex::new(Cell::new(Status::AT_START)),
        }
    }

    /// Looks at or changes whose orders hold.
    pub fn arbitrate<T>(&self, with: impl FnOnce(&mut Arbiter<LINES>) -> T) -> T {
        self.arbiter.lock(|cell| {
            let mut arbiter = cell.get();
            let result = with(&mut arbiter);
            cell.set(arbiter);
            result
        })
    }

    /// The number of a line.
    pub fn index(&self, line: &Line) -> usize {
        self.lines.iter().position(|other| core::ptr::eq(other, line)).unwrap_or(LINES)
    }

    /// Gives control an order when the flash is not being written.
    pub async fn order(&self, asker: Option<Asker>, order: Order) {
        let _written = self.flash.lock().await;
        self.orders.send((asker, order)).await;
    }

    /// Gives control an order that starts it anew, in the middle of a step's time.
    pub async fn restart(&self, asker: Option<Asker>, order: Order) {
        let _written = self.flash.lock().await;
        time_to_restart().await;
        self.orders.send((asker, order)).await;
    }

    /// Faults of the last step.
    pub fn faults(&self) -> Faults {
        Faults(self.faults.load(Ordering::Relaxed))
    }

    /// Whether nothing but to vent was asked of control in its last step.
    pub fn vented(&self) -> bool {
        self.vented.load(Ordering::Relaxed)
    }

    /// Leaves a core for [`Order::Configure`] and each [`Order::Start`] from then on: a start need not work its
    /// constants out again.
    pub fn prepare(&self, core: Core) {
        if let Ok(mut slot) = self.next_core.try_lock() {
            *slot = Slot::Full(core);
        }
    }

    /// The configuration that the host has sent; nothing since the start of the board.
    pub fn config(&self) -> Option<Config> {
        match &*self.next_core.try_lock().ok()? {
            Slot::Empty => None,
            Slot::Full(core) => Some(*core.config()),
        }
    }

    /// The core that is prepared.
    pub fn prepared(&self) -> Option<Core> {
        match &*self.next_core.try_lock().ok()? {
            Slot::Empty => None,
            Slot::Full(core) => Some(core.clone()),
        }
    }

    /// Leaves what vented first for others.
    pub fn set_first_failure(&self, first: Option<FirstFailure>) {
        self.first_failure.lock(|cell| cell.set(first));
    }

    /// What vented first.
    pub fn first_failure(&self) -> Option<FirstFailure> {
        self.first_failure.lock(Cell::get)
    }

    /// Leaves the control task's measurements for others.
    pub fn set_tally(&self, tally: Tally) {
        self.tally.lock(|cell| cell.set(tally));
    }

    /// The control task's measurements.
    pub fn tally(&self) -> Tally {
        self.tally.lock(Cell::get)
    }

    /// What changes rarely.
    pub fn status(&self) -> Status {
        self.status.lock(Cell::get)
    }

    /// Changes what changes rarely, and tells the hosts.
    pub fn change_status(&self, change: impl FnOnce(&mut Status)) {
        self.status.lock(|cell| {
            let mut status = cell.get();
            change(&mut status);
            cell.set(status);
        });
        self.tell_status();
    }

    /// Tells the hosts what changes rarely.
    pub fn tell_status(&self) {
        let status = self.status();
        for line in self.lines.iter().filter(|line| line.is_open()) {
            line.post(Message::Status(status));
        }
    }

    /// How the steps were timed.
    pub fn timing(&self) -> Timing {
        let tally = self.tally();
        let mean_ns = |sum_us: u64| (1000.0 * (sum_us as f32 / tally.steps.max(1) as f32)) as u32;
        let sum = |count: fn(&Line) -> &AtomicU32| {
            let counts = self.lines.iter().map(|line| count(line).load(Ordering::Relaxed));
            counts.fold(0, u32::wrapping_add)
        };
        Timing {
            steps: tally.steps,
            missed_steps: tally.missed_steps,
            step_mean_ns: mean_ns(tally.step_sum_us),
            step_worst_us: tally.step_worst_us,
            busy_worst_us: tally.busy_worst_us,
            jitter_mean_ns: mean_ns(tally.jitter_sum_us),
            jitter_worst_us: tally.jitter_worst_us,
            dropped_telemetry: sum(|line| &line.dropped),
            malformed_frames: sum(|line| &line.malformed),
            dropped_requests: self.dropped_requests.load(Ordering::Relaxed),
        }
    }
}

/// Time that a restart of the core may take: nothing else runs while one is copied.
const RESTARTING: Duration = Duration::from_micros(500);

/// Waits until the core can be restarted before the next step is due.
async fn time_to_restart() {
    let now = Instant::now();
    let into = into_step(now);
    if into + RESTARTING > STEP {
        Timer::at(now + STEP - into).await;
    }
}

/// The control task's measurements of itself.
#[derive(Clone, Copy)]
pub struct Tally {
    pub steps: u64,
    pub missed_steps: u32,
    pub step_sum_us: u64,
    pub step_worst_us: u32,
    pub busy_worst_us: u32,
    pub jitter_sum_us: u64,
    pub jitter_worst_us: u32,
}

impl Tally {
    /// Nothing yet.
    pub const NONE: Self = Self {
        steps: 0,
        missed_steps: 0,
        step_sum_us: 0,
        step_worst_us: 0,
        busy_worst_us: 0,
        jitter_sum_us: 0,
        jitter_worst_us: 0,
    };

    /// One more step.
    pub fn add(&mut self, jitter_us: u32, step_us: u32, busy_us: u32) {
        self.steps += 1;
        self.step_sum_us += u64::from(step_us);
        self.step_worst_us = self.step_worst_us.max(step_us);
        self.busy_worst_us = self.busy_worst_us.max(busy_us);
        self.jitter_sum_us += u64::from(jitter_us);
        self.jitter_worst_us = self.jitter_worst_us.max(jitter_us);
    }
}
