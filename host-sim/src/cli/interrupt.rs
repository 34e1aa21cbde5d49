//! Ctrl-C: not the end of the program, but a wish that it stops, keeps what it has and vents what it drives. Pressed
//! twice, it ends the program: the board then vents by its link's timeout.

use super::failure::STOPPED;
use std::io;
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

static WANTED: AtomicBool = AtomicBool::new(false);
static INSTALLED: Once = Once::new();

/// From now on Ctrl-C does not end the program; what was wanted before is forgotten.
pub(super) fn watch() {
    INSTALLED.call_once(|| {
        // Without it Ctrl-C ends the program at once, and the rows handed over so far stay.
        let _ = ctrlc::set_handler(|| {
            if WANTED.swap(true, Ordering::Relaxed) {
                std::process::exit(STOPPED.into());
            }
        });
    });
    WANTED.store(false, Ordering::Relaxed);
}

/// Whether it has been pressed since.
pub(super) fn wanted() -> bool {
    WANTED.load(Ordering::Relaxed)
}

/// The same for those who write rows: an error of the kind `Interrupted`.
pub(super) fn check() -> io::Result<()> {
    if wanted() { Err(io::ErrorKind::Interrupted.into()) } else { Ok(()) }
}
