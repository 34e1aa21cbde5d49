//! The request to stop long work early, such as by Ctrl-C. Runs and identifications check it at
//! every step, so that the caller can keep finished results.

use std::sync::atomic::{AtomicBool, Ordering};

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// Requests the stop. Returns whether it had been requested before.
pub fn request() -> bool {
    REQUESTED.swap(true, Ordering::Relaxed)
}

/// Clears the request, for the next piece of work.
pub fn reset() {
    REQUESTED.store(false, Ordering::Relaxed);
}

pub fn is_requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}
