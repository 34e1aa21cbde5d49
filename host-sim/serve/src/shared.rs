//! State shared by the operator and the sockets.

use super::orders::Orders;
use super::page::Kind;
use super::results::Outcome;
use super::seats::Seats;
use super::state::{Event, Weight};
use super::uploads::Uploads;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tokio::sync::{broadcast, watch};
use tokio_tungstenite::tungstenite::Utf8Bytes;

/// Frames kept for a page: one second. The page loses older ones.
const MOST_FRAMES: usize = 32;
const MOST_EVENTS: usize = 100;

#[derive(Debug)]
pub struct Shared {
    pub kind: Kind,
    pub orders: Orders,
    pub seats: Seats,
    pub uploads: Uploads,
    /// Measured values, thinned.
    pub frames: broadcast::Sender<Utf8Bytes>,
    /// The serialised `State`.
    pub state: watch::Sender<Utf8Bytes>,
    ended: AtomicBool,
    events: Mutex<VecDeque<Event>>,
    results: Mutex<Vec<Outcome>>,
}

impl Default for Shared {
    fn default() -> Self {
        Self {
            kind: Kind::Muscle,
            orders: Orders::default(),
            seats: Seats::default(),
            uploads: Uploads::default(),
            frames: broadcast::Sender::new(MOST_FRAMES),
            state: watch::Sender::new(Utf8Bytes::default()),
            ended: AtomicBool::new(false),
            events: Mutex::default(),
            results: Mutex::default(),
        }
    }
}

/// A lock poisoned by a panic is still usable: every change is one call.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// State of a board of this kind.
    pub fn of(kind: Kind) -> Self {
        Self { kind, ..Self::default() }
    }

    /// Requests a vent before anything else.
    pub fn vent(&self, why: &'static str) {
        self.log(Weight::Plain, format!("{why}: it vents"));
        self.orders.vent(why);
    }

    pub fn end(&self) {
        self.ended.store(true, Ordering::Release);
    }

    pub fn ended(&self) -> bool {
        self.ended.load(Ordering::Acquire)
    }

    pub fn log(&self, weight: Weight, text: impl Into<String>) {
        let mut events = locked(&self.events);
        events.push_front(Event::now(weight, text.into()));
        events.truncate(MOST_EVENTS);
    }

    /// The events, the latest first.
    pub fn events(&self) -> Vec<Event> {
        locked(&self.events).iter().cloned().collect()
    }

    pub fn add_result(&self, outcome: Outcome) {
        locked(&self.results).push(outcome);
    }

    /// The results, the oldest first.
    pub fn results(&self) -> Vec<Outcome> {
        locked(&self.results).clone()
    }
}
