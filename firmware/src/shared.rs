//! State shared by the tasks.

#[cfg(feature = "hil")]
use crate::kind::Sample;
use crate::kind::{ActiveConfig, ActiveRest, Config, Core, JointTelemetry, SetPoint, checksum};
use crate::source::{STEP, into_step};
use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use embassy_sync::blocking_mutex::{Mutex, raw::CriticalSectionRawMutex};
use embassy_sync::channel::Channel;
use embassy_sync::mutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use model_core::Faults;
use model_core::safety::supervisor::FirstFailure;
use thermyo_protocol::arbiter::{Arbiter, Ticket};
use thermyo_protocol::{self as link, ConfigSource, Name, Refusal, ReplyWith, Status, Timing};

const DEFAULT_TELEMETRY_DIVIDER: u16 = 10;

/// Capacity of the outbox, and the parts of it that are reserved for the reply to a waiting host
/// and for the status.
const OUTBOX: usize = 8;
const FOR_REPLIES: usize = 1;
const FOR_STATUS: usize = 1;

/// Order from the link to control, carried out between two steps. It is small because every turn of
/// the control task moves it.
#[derive(Clone, Copy)]
pub enum Order {
    /// Disarm, and restart as the [prepared](Shared::prepare) core, which has another
    /// configuration.
    Configure {
        checksum: u32,
        source: ConfigSource,
        name: Name,
    },
    /// Restart as the [prepared](Shared::prepare) core, with this set point.
    Start(SetPoint),
    /// Accept set points up to this absolute pressure \[Pa\], or up to the configuration's limit.
    Arm(Option<f32>),
    Set(SetPoint),
    ClearFaults,
}

impl Order {
    /// Whether the order may move the muscle. A stop overtakes such an order, and it holds only
    /// while its host stays connected.
    pub fn may_drive(&self) -> bool {
        match self {
            Self::Arm(_) | Self::Start(_) => true,
            Self::Set(set_point) => *set_point != SetPoint::Vent,
            Self::Configure { .. } | Self::ClearFaults => false,
        }
    }
}

pub enum StoreRequest {
    Save,
    Forget,
    /// Read the event of this number; the last event is number 0.
    Event(u8),
}

pub type Message = link::MessageWith<ActiveConfig, ActiveRest, JointTelemetry>;
pub type Answer = link::AnswerWith<ActiveConfig, ActiveRest>;

pub const LINES: usize = if cfg!(feature = "usb") { 2 } else { 1 };

/// One line to the host. Each line has its own telemetry divider, and no telemetry before the first
/// request.
pub struct Line {
    pub outbox: Channel<CriticalSectionRawMutex, Message, OUTBOX>,
    /// Steps per telemetry frame (0 for none) plus one; zero before the first request.
    telemetry: AtomicU32,
    /// Signal by which control asks the receiver whether there is nothing to read.
    pub silence_check: Signal<CriticalSectionRawMutex, ()>,
    /// Messages for which the outbox had no room.
    dropped: AtomicU32,
    /// Frames that were not a request.
    pub malformed: AtomicU32,
}

impl Line {
    const fn new() -> Self {
        Self {
            outbox: Channel::new(),
            telemetry: AtomicU32::new(0),
            silence_check: Signal::new(),
            dropped: AtomicU32::new(0),
            malformed: AtomicU32::new(0),
        }
    }

    /// Starts telemetry, at the first request.
    pub fn open(&self) {
        if self.telemetry.load(Ordering::Relaxed) == 0 {
            self.set_telemetry_divider(DEFAULT_TELEMETRY_DIVIDER);
        }
    }

    /// Closes the line, because the host is gone: nothing is sent until the next request.
    #[cfg(feature = "usb")]
    pub fn close(&self) {
        self.telemetry.store(0, Ordering::Relaxed);
        self.outbox.clear();
    }

    /// Sets the steps per telemetry frame; 0 for none.
    pub fn set_telemetry_divider(&self, steps: u16) {
        self.telemetry.store(u32::from(steps) + 1, Ordering::Relaxed);
    }

    /// Whether a request has come since the line was closed.
    fn is_open(&self) -> bool {
        self.telemetry.load(Ordering::Relaxed) > 0
    }

    /// Whether the telemetry of this step is due on the line; `obeyed`: the orders of its host
    /// hold.
    pub fn wants(&self, step: u32, obeyed: bool) -> bool {
        if cfg!(feature = "hil") {
            // Each sample is answered by its telemetry.
            return obeyed;
        }
        let divider = self.telemetry.load(Ordering::Relaxed).saturating_sub(1);
        divider > 0 && step.is_multiple_of(divider)
    }

    /// Sends without waiting. A message without room is dropped and counted.
    pub fn post(&self, message: Message) {
        let reserved = match message {
            Message::Reply(_) => 0,
            Message::Status(_) => FOR_REPLIES,
            Message::Telemetry(_) | Message::JointTelemetry(_) => FOR_REPLIES + FOR_STATUS,
        };
        if self.outbox.free_capacity() <= reserved || self.outbox.try_send(message).is_err() {
            // Two contexts may lose an increment to each other; the count is for diagnosis only.
            self.dropped.store(self.dropped.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
        }
    }

    /// Answers a request without waiting.
    pub fn answer(&self, sequence: u8, answer: Answer) {
        self.post(Message::Reply(ReplyWith { sequence, answer }));
    }

    /// Answers a request once there is room: the outbox may have filled while the flash was busy.
    pub async fn answer_later(&self, sequence: u8, answer: Answer) {
        self.outbox.send(Message::Reply(ReplyWith { sequence, answer })).await;
    }
}

/// The request that waits for the answer to an order.
#[derive(Clone, Copy)]
pub struct Requester {
    pub line: &'static Line,
    pub sequence: u8,
    /// Issued when the request began to arrive.
    pub ticket: Ticket,
}

/// The only instance is a static of the board.
pub struct Shared {
    pub lines: [Line; LINES],
    /// Orders to control, each with the requester that gets the answer, if there is one.
    pub orders: Channel<CriticalSectionRawMutex, (Option<Requester>, Order), 1>,
    pub store_requests: Channel<CriticalSectionRawMutex, (Requester, StoreRequest), 1>,
    /// First failure, for the keeper.
    pub failed: Signal<CriticalSectionRawMutex, FirstFailure>,
    pub parts: crate::parts::Parts,
    /// Steps for which the busy flash may still block the thread: control feeds the watchdog
    /// meanwhile.
    pub flash_busy_steps: AtomicU32,
    /// Whether the keeper writes: busy flash and searches in it leave the tasks of digital sensors
    /// no time.
    pub storing: AtomicBool,
    #[cfg(feature = "hil")]
    pub samples: Channel<CriticalSectionRawMutex, Sample, 1>,
    /// Incremented in every turn of the control task.
    pub heartbeat: AtomicU32,
    /// Faults of the last step.
    pub faults: AtomicU32,
    /// Held while the flash is written and while an order is given. The flash is written only while
    /// the muscle is vented, since a hang during a write is found late.
    pub flash: mutex::Mutex<CriticalSectionRawMutex, ()>,
    /// Whether the saved configuration is loaded. Until then no request is answered, as the
    /// defaults would apply.
    pub recalled: AtomicBool,
    /// Whether the set point of the last step was venting.
    pub vented: AtomicBool,
    /// Requests that the link dropped because they came too fast.
    pub dropped_requests: AtomicU32,
    arbiter: Mutex<CriticalSectionRawMutex, Cell<Arbiter<LINES>>>,
    /// There is never contention: the tasks of the thread hold it between two waits, and control
    /// reads it after one of them has sent an order, before that task continues. It is no critical
    /// section, because copying a core with interrupts off would delay a step.
    next_core: mutex::Mutex<CriticalSectionRawMutex, Option<NextCore>>,
    /// First failure, kept over restarts.
    first_failure: Mutex<CriticalSectionRawMutex, Cell<Option<FirstFailure>>>,
    tally: Mutex<CriticalSectionRawMutex, Cell<Tally>>,
    status: Mutex<CriticalSectionRawMutex, Cell<Status>>,
}

struct NextCore {
    core: &'static mut Core,
    /// Checksum of its configuration.
    checksum: u32,
}

impl Shared {
    pub const fn new() -> Self {
        Self {
            lines: [const { Line::new() }; LINES],
            orders: Channel::new(),
            store_requests: Channel::new(),
            failed: Signal::new(),
            parts: crate::parts::Parts::new(),
            flash_busy_steps: AtomicU32::new(0),
            storing: AtomicBool::new(false),
            flash: mutex::Mutex::new(()),
            recalled: AtomicBool::new(false),
            #[cfg(feature = "hil")]
            samples: Channel::new(),
            heartbeat: AtomicU32::new(0),
            faults: AtomicU32::new(0),
            vented: AtomicBool::new(false),
            dropped_requests: AtomicU32::new(0),
            arbiter: Mutex::new(Cell::new(Arbiter::new())),
            next_core: mutex::Mutex::new(None),
            first_failure: Mutex::new(Cell::new(None)),
            tally: Mutex::new(Cell::new(Tally::NONE)),
            status: Mutex::new(Cell::new(Status::AT_START)),
        }
    }

    /// Reads or changes the arbiter in a critical section.
    pub fn arbitrate<T>(&self, with: impl FnOnce(&mut Arbiter<LINES>) -> T) -> T {
        self.arbiter.lock(|cell| {
            let mut arbiter = cell.get();
            let result = with(&mut arbiter);
            cell.set(arbiter);
            result
        })
    }

    pub fn index(&self, line: &Line) -> usize {
        self.lines.iter().position(|other| core::ptr::eq(other, line)).unwrap_or(LINES)
    }

    /// Sends an order to control when the flash is not being written.
    pub async fn order(&self, requester: Option<Requester>, order: Order) {
        let _written = self.flash.lock().await;
        self.orders.send((requester, order)).await;
    }

    /// Sends control an order that restarts the core, at a time in the step that leaves room for
    /// it.
    pub async fn restart(&self, requester: Option<Requester>, order: Order) {
        let _written = self.flash.lock().await;
        time_to_restart().await;
        self.orders.send((requester, order)).await;
    }

    pub fn faults(&self) -> Faults {
        Faults(self.faults.load(Ordering::Relaxed))
    }

    /// Whether the set point of control's last step was venting.
    pub fn vented(&self) -> bool {
        self.vented.load(Ordering::Relaxed)
    }

    /// Stages a core with a configuration for [`Order::Configure`] and every later [`Order::Start`],
    /// so that a start need not compute the constants again. Returns the configuration's checksum.
    pub fn prepare(&self, config: &Config) -> Result<u32, Refusal> {
        let mut next = self.next_core.try_lock().map_err(|_| Refusal::NotConfigured)?;
        let next = next.as_mut().ok_or(Refusal::NotConfigured)?;
        next.core.become_new(config)?;
        next.checksum = checksum(config);
        Ok(next.checksum)
    }

    /// The active configuration; `None` before the first one since the start of the board.
    pub fn config(&self) -> Option<Config> {
        match &*self.next_core.try_lock().ok()? {
            Some(NextCore { core, .. }) if core.is_configured() => Some(*core.config()),
            _ => None,
        }
    }

    /// Provides the memory of the staged core, before the first one.
    pub fn stage(&self, core: &'static mut Core) {
        if let Ok(mut next) = self.next_core.try_lock() {
            *next = Some(NextCore { core, checksum: 0 });
        }
    }

    /// Uses the staged core, if it has the configuration with this checksum: another host may have
    /// staged its own while an order waited.
    pub fn with_prepared<T>(
        &self,
        checksum: u32,
        with: impl FnOnce(&Core) -> Result<T, Refusal>,
    ) -> Result<T, Refusal> {
        let next = self.next_core.try_lock().map_err(|_| Refusal::NotConfigured)?;
        match &*next {
            Some(next) if next.core.is_configured() && next.checksum == checksum => with(next.core),
            Some(next) if next.core.is_configured() => Err(Refusal::Overtaken),
            _ => Err(Refusal::NotConfigured),
        }
    }

    /// Counts a request that is not carried out.
    pub fn drop_request(&self) {
        let count = self.dropped_requests.load(Ordering::Relaxed);
        self.dropped_requests.store(count.wrapping_add(1), Ordering::Relaxed);
    }

    pub fn set_first_failure(&self, first: Option<FirstFailure>) {
        self.first_failure.lock(|cell| cell.set(first));
    }

    pub fn first_failure(&self) -> Option<FirstFailure> {
        self.first_failure.lock(Cell::get)
    }

    pub fn set_tally(&self, tally: Tally) {
        self.tally.lock(|cell| cell.set(tally));
    }

    pub fn tally(&self) -> Tally {
        self.tally.lock(Cell::get)
    }

    pub fn status(&self) -> Status {
        self.status.lock(Cell::get)
    }

    pub fn change_status(&self, change: impl FnOnce(&mut Status)) {
        self.status.lock(|cell| {
            let mut status = cell.get();
            change(&mut status);
            cell.set(status);
        });
        self.post_status();
    }

    pub fn post_status(&self) {
        let status = self.status();
        for line in self.lines.iter().filter(|line| line.is_open()) {
            line.post(Message::Status(status));
        }
    }

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

/// Time that a restart of the core may take: nothing else runs while a core is copied.
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
    pub const NONE: Self = Self {
        steps: 0,
        missed_steps: 0,
        step_sum_us: 0,
        step_worst_us: 0,
        busy_worst_us: 0,
        jitter_sum_us: 0,
        jitter_worst_us: 0,
    };

    pub fn add(&mut self, jitter_us: u32, step_us: u32, busy_us: u32) {
        self.steps += 1;
        self.step_sum_us += u64::from(step_us);
        self.step_worst_us = self.step_worst_us.max(step_us);
        self.busy_worst_us = self.busy_worst_us.max(busy_us);
        self.jitter_sum_us += u64::from(jitter_us);
        self.jitter_worst_us = self.jitter_worst_us.max(jitter_us);
    }
}
