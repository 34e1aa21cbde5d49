//! Ctrl-C while a muscle is driven: not the end of the program, but a wish that it is vented.

use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

static WANTED: AtomicBool = AtomicBool::new(false);
static INSTALLED: Once = Once::new();

/// From now on Ctrl-C does not end the program; what was wanted before is forgotten.
pub(super) fn watch() {
    INSTALLED.call_once(|| {
        // Without it Ctrl-C ends the program, and the board vents by its link's timeout.
        let _ = ctrlc::set_handler(|| WANTED.store(true, Ordering::Relaxed));
    });
    WANTED.store(false, Ordering::Relaxed);
}

/// Whether it has been pressed since.
pub(super) fn wanted() -> bool {
    WANTED.load(Ordering::Relaxed)
}
