//! Ctrl-C, and SIGTERM: not the end of the program, but a wish that it stops, keeps what it has and vents what it drives. Pressed
//! twice, it ends the program: the board then vents by its link's timeout.

use super::failure::STOPPED;
#[cfg(unix)]
use signal_hook::{consts::SIGTERM, iterator::Signals};
use std::io;
use std::sync::Once;
pub(super) use thermyo_compute::stop::wanted;
use thermyo_compute::stop::{forget, want};

static INSTALLED: Once = Once::new();

/// From now on Ctrl-C does not end the program; what was wanted before is forgotten.
pub(super) fn watch() {
    INSTALLED.call_once(|| {
        // Without it Ctrl-C ends the program at once, and the rows handed over so far stay.
        let _ = ctrlc::set_handler(pressed);
        #[cfg(unix)]
        if let Ok(mut signals) = Signals::new([SIGTERM]) {
            std::thread::spawn(move || signals.forever().for_each(|_| pressed()));
        }
    });
    forget();
}

fn pressed() {
    if want() {
        std::process::exit(STOPPED.into());
    }
}

/// [`wanted`] for those who write rows: an error of the kind `Interrupted`.
pub(super) fn check() -> io::Result<()> {
    if wanted() { Err(io::ErrorKind::Interrupted.into()) } else { Ok(()) }
}
