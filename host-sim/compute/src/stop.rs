//! The wish that what takes long ends before its time: Ctrl-C. A run, and whatever an identification simulates, look at it
//! at every step, so that whoever waits for them can put away what is finished.

use std::sync::atomic::{AtomicBool, Ordering};

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Says it; whether it had been said before.
pub fn request() -> bool {
    REQUESTED.swap(true, Ordering::Relaxed)
}

/// Takes it back: for the next piece of work.
pub fn reset() {
    REQUESTED.store(false, Ordering::Relaxed);
}

/// Whether it has been said since.
pub fn is_requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}
