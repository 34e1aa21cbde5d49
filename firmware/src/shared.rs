//! What the tasks have in common.

use core::cell::{Cell, RefCell};
use core::sync::atomic::{AtomicBool, AtomicU16, AtomicU32, Ordering};
use embassy_sync::blocking_mutex::{Mutex, raw::CriticalSectionRawMutex};
use embassy_sync::channel::Channel;
use model_core::link::{Answer, Message, Name, Refusal, Reply, Status, Timing};
use model_core::safety::supervisor::FirstFailure;
use model_core::{Config, Core, Faults, Sample, SetPoint, SetPointError};

const DEFAULT_TELEMETRY_DIVIDER: u16 = 10;

/// From the link to control, carried out between two steps. Small: it is moved at every turn of the
/// control task.
pub enum Order {
    /// Start anew as the core that was [prepared](Shared::prepare), with another configuration, and disarm.
    Configure {
        /// That of the configuration.
        checksum: u32,
    },
    /// Start anew as the core that was [prepared](Shared::prepare).
    Restart,
    /// Take set points up to this absolute pressure \[Pa\], or as far as the configuration allows.
    Arm(Option<f32>),
    /// Another set point.
    Set(SetPoint),
    /// Forget latched faults.
    ClearFaults,
}

/// A place for a core. Unlike that of an `Option`, its empty state is zeros, which take no flash.
#[repr(u8)]
#[allow(clippy::large_enum_variant)] // One static.
enum Slot {
    Empty,
    Full(Core),
}

/// The one instance is a static of the board.
pub struct Shared {
    /// To control, with the sequence number for the reply.
    pub orders: Channel<CriticalSectionRawMutex, (u8, Order), 1>,
    /// Samples from the host.
    pub samples: Channel<CriticalSectionRawMutex, Sample, 1>,
    /// To the host.
    pub outbox: Channel<CriticalSectionRawMutex, Message, 4>,
    // A static of zeros takes no flash: it holds the difference to the default.
    telemetry_divider: AtomicU16,
    /// Grows with every turn of the control task.
    pub heartbeat: AtomicU32,
    /// Faults of the last step.
    pub faults: AtomicU16,
    /// Messages for which the outbox had no room.
    pub dropped: AtomicU32,
    /// Frames that the link dropped.
    pub malformed: AtomicU32,
    /// Requests that the link dropped, because too many came.
    pub dropped_requests: AtomicU32,
    /// A request has come since control last looked.
    pub heard: AtomicBool,
    /// The host wants the muscle vented: carried out in the next step, whatever else is asked.
    pub stop: AtomicBool,
    next_core: Mutex<CriticalSectionRawMutex, RefCell<Slot>>,
    /// What vented first, over restarts.
    first_failure: Mutex<CriticalSectionRawMutex, Cell<Option<FirstFailure>>>,
    tally: Mutex<CriticalSectionRawMutex, Cell<Tally>>,
    status: Mutex<CriticalSectionRawMutex, Cell<Status>>,
}

impl Shared {
    /// At the start.
    pub const fn new() -> Self {
        Self {
            orders: Channel::new(),
            samples: Channel::new(),
            outbox: Channel::new(),
            telemetry_divider: AtomicU16::new(0),
            heartbeat: AtomicU32::new(0),
            faults: AtomicU16::new(0),
            dropped: AtomicU32::new(0),
            malformed: AtomicU32::new(0),
            dropped_requests: AtomicU32::new(0),
            heard: AtomicBool::new(false),
            stop: AtomicBool::new(false),
            next_core: Mutex::new(RefCell::new(Slot::Empty)),
            first_failure: Mutex::new(Cell::new(None)),
            tally: Mutex::new(Cell::new(Tally::NONE)),
            status: Mutex::new(Cell::new(Status::AT_START)),
        }
    }

    /// Steps per telemetry frame; 0 for none. At the start a tenth of the step rate.
    pub fn telemetry_divider(&self) -> u16 {
        self.telemetry_divider.load(Ordering::Relaxed) ^ DEFAULT_TELEMETRY_DIVIDER
    }

    /// Sets the steps per telemetry frame; 0 for none.
    pub fn set_telemetry_divider(&self, steps: u16) {
        self.telemetry_divider.store(steps ^ DEFAULT_TELEMETRY_DIVIDER, Ordering::Relaxed);
    }

    /// Sends without waiting; what finds no room is counted.
    pub fn post(&self, message: Message) {
        if self.outbox.try_send(message).is_err() {
            // Only one context may lose an increment to the other; the count is a diagnosis.
            self.dropped.store(self.dropped.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
        }
    }

    /// Answers a request without waiting.
    pub fn answer(&self, sequence: u8, answer: Answer) {
        self.post(Message::Reply(Reply { sequence, answer }));
    }

    /// Faults of the last step.
    pub fn faults(&self) -> Faults {
        Faults(self.faults.load(Ordering::Relaxed))
    }

    /// Takes a flag down; whether it was up. Both sides only ever write one value each, and what
    /// is raised between the two accesses was raised before the step that follows.
    pub fn take(flag: &AtomicBool) -> bool {
        let up = flag.load(Ordering::Relaxed);
        if up {
            flag.store(false, Ordering::Relaxed);
        }
        up
    }

    /// Leaves a core for [`Order::Restart`], this time and after each [`Self::prepare_set_point`]: a start
    /// need not work its constants out again. Interrupts wait while it is copied, once.
    pub fn prepare(&self, core: Core) {
        let full = Slot::Full(core);
        self.next_core.lock(|slot| {
            if let Ok(mut slot) = slot.try_borrow_mut() {
                *slot = full;
            }
        });
    }

    /// Gives the core that is prepared another set point, which is checked as the armed core would.
    ///
    /// # Errors
    /// Why it does not take it, or that there is none.
    pub fn prepare_set_point(&self, set_point: SetPoint) -> Result<(), Refusal> {
        let armed_pa = self.status().armed_pa;
        self.next_core.lock(|slot| match slot.try_borrow_mut().as_deref_mut() {
            Ok(Slot::Full(_)) if set_point != SetPoint::Vent && armed_pa.is_none() => {
                Err(SetPointError::NotArmed.into())
            }
            Ok(Slot::Full(core)) => {
                core.arm(armed_pa)?;
                Ok(core.set(set_point)?)
            }
            _ => Err(Refusal::NotConfigured),
        })
    }

    /// The configuration that the host has told; nothing since the start of the board.
    pub fn config(&self) -> Option<Config> {
        self.next_core.lock(|slot| match &*slot.try_borrow().ok()? {
            Slot::Empty => None,
            Slot::Full(core) => Some(*core.config()),
        })
    }

    /// The core that is prepared.
    pub fn prepared(&self) -> Option<Core> {
        self.next_core.lock(|slot| match &*slot.try_borrow().ok()? {
            Slot::Empty => None,
            Slot::Full(core) => Some(core.clone()),
        })
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

    /// Another name for the configuration in use; tells the host.
    pub fn set_config_name(&self, config_name: Name) {
        let status = self.status.lock(|cell| {
            cell.set(Status { config_name, ..cell.get() });
            cell.get()
        });
        self.post(Message::Status(status));
    }

    /// Changes what changes rarely, and tells the host.
    pub fn tell(&self, status: Status) {
        self.status.lock(|cell| cell.set(status));
        self.post(Message::Status(status));
    }

    /// How the steps were timed.
    pub fn timing(&self) -> Timing {
        let tally = self.tally();
        let mean_ns = |sum_us: u64| (sum_us * 1000 / tally.steps.max(1)) as u32;
        Timing {
            steps: tally.steps,
            missed_steps: tally.missed_steps,
            step_mean_ns: mean_ns(tally.step_sum_us),
            step_worst_us: tally.step_worst_us,
            busy_worst_us: tally.busy_worst_us,
            jitter_mean_ns: mean_ns(tally.jitter_sum_us),
            jitter_worst_us: tally.jitter_worst_us,
            dropped_telemetry: self.dropped.load(Ordering::Relaxed),
            malformed_frames: self.malformed.load(Ordering::Relaxed),
            dropped_requests: self.dropped_requests.load(Ordering::Relaxed),
        }
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
