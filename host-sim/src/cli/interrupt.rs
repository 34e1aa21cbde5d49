//! Ctrl-C, SIGTERM and SIGHUP: not the end of the program, but a wish that it stops, keeps what it has and vents what it drives.
//! Ctrl-C or SIGTERM a second time ends the program: the board then vents by its link's timeout.

use super::failure::STOPPED;
#[cfg(unix)]
use signal_hook::{
    consts::{SIGHUP, SIGTERM},
    iterator::Signals,
};
use std::io;
use std::sync::Once;
pub(super) use thermyo_compute::stop::is_requested;
use thermyo_compute::stop::{request, reset};

static INSTALLED: Once = Once::new();

/// From now on Ctrl-C does not end the program; what was wanted before is forgotten.
pub(super) fn watch() {
    INSTALLED.call_once(|| {
        // Without it Ctrl-C ends the program at once, and the rows handed over so far stay.
        let _ = ctrlc::set_handler(pressed);
        #[cfg(unix)]
        if let Ok(mut signals) = Signals::new([SIGTERM]) {
            if !ignores_hangup() {
                let _ = signals.add_signal(SIGHUP);
            }
            std::thread::spawn(move || {
                signals.forever().for_each(|signal| match signal {
                    // A terminal that is closed sends it more than once: shell and kernel each do.
                    SIGHUP => drop(request()),
                    _ => pressed(),
                });
            });
        }
    });
    reset();
}

/// Whether SIGHUP is ignored, as `nohup` sets it, and so to be left alone. Linux tells it; elsewhere it is left alone.
#[cfg(unix)]
fn ignores_hangup() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    ignored.is_none_or(|mask| mask >> (SIGHUP - 1) & 1 == 1)
}

fn pressed() {
    if request() {
        std::process::exit(STOPPED.into());
    }
}

/// [`is_requested`] for those who write rows: an error of the kind `Interrupted`.
pub(super) fn check() -> io::Result<()> {
    if is_requested() { Err(io::ErrorKind::Interrupted.into()) } else { Ok(()) }
}
