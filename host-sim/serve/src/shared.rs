//! What the operator and the sockets share.

use super::orders::Orders;
use super::results::Outcome;
use super::seats::Seats;
use super::state::{Event, Weight};
use axum::extract::ws::Utf8Bytes;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use tokio::sync::{broadcast, watch};

/// Frames that wait for a page: a second. What is older is lost to it.
const MOST_FRAMES: usize = 32;
/// Events that are remembered.
const MOST_EVENTS: usize = 100;

/// See the module.
#[derive(Debug)]
pub struct Shared {
    /// What the pages ask for.
    pub orders: Orders,
    /// Who steers.
    pub seats: Seats,
    /// Measured values, thinned.
    pub frames: broadcast::Sender<Utf8Bytes>,
    /// The state of everything else, as it is sent.
    pub state: watch::Sender<Utf8Bytes>,
    ended: AtomicBool,
    events: Mutex<VecDeque<Event>>,
    results: Mutex<Vec<Outcome>>,
}

impl Default for Shared {
    fn default() -> Self {
        Self {
            orders: Orders::default(),
            seats: Seats::default(),
            frames: broadcast::Sender::new(MOST_FRAMES),
            state: watch::Sender::new(Utf8Bytes::default()),
            ended: AtomicBool::new(false),
            events: Mutex::default(),
            results: Mutex::default(),
        }
    }
}

/// What a thread that has panicked left is whole: every change is one call.
fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// The muscle is to vent, before anything else.
    pub fn vent(&self, why: &'static str) {
        self.log(Weight::Plain, format!("{why}: it vents"));
        self.orders.vent(why);
    }

    /// The server ends.
    pub fn end(&self) {
        self.ended.store(true, Ordering::Release);
    }

    /// Whether it does.
    pub fn ended(&self) -> bool {
        self.ended.load(Ordering::Acquire)
    }

    /// Something happened.
    pub fn log(&self, weight: Weight, text: impl Into<String>) {
        let mut events = locked(&self.events);
        events.push_front(Event::now(weight, text.into()));
        events.truncate(MOST_EVENTS);
    }

    /// What happened, the last event first.
    pub fn events(&self) -> Vec<Event> {
        locked(&self.events).iter().cloned().collect()
    }

    /// Something lies in its folder.
    pub fn add_result(&self, outcome: Outcome) {
        locked(&self.results).push(outcome);
    }

    /// All of that, the oldest first.
    pub fn results(&self) -> Vec<Outcome> {
        locked(&self.results).clone()
    }
}
