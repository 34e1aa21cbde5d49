//! Ctrl-C, SIGTERM and SIGHUP request a stop: results are kept and driven muscles are vented. A
//! second Ctrl-C ends the program: the board then vents by its link's timeout.

use super::failure::STOPPED;
#[cfg(unix)]
use signal_hook::{
    consts::{SIGHUP, SIGINT, SIGTERM},
    iterator::Signals,
};
use std::io;
use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

static INSTALLED: Once = Once::new();
/// Signals belong to the process. Everything below the command line gets its own watch.
static REQUESTED: AtomicBool = AtomicBool::new(false);

pub(super) fn is_requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}

/// Returns whether a stop had been requested before.
fn request() -> bool {
    REQUESTED.swap(true, Ordering::Relaxed)
}

/// Makes Ctrl-C only request a stop from now on; clears an earlier request.
pub(super) fn watch() {
    INSTALLED.call_once(|| {
        // Without a handler Ctrl-C ends the program at once, and the rows written so far stay.
        #[cfg(not(unix))]
        let _ = ctrlc::set_handler(pressed);
        #[cfg(unix)]
        if let Ok(mut signals) = Signals::new([SIGINT, SIGTERM]) {
            if !ignores_hangup() {
                let _ = signals.add_signal(SIGHUP);
            }
            std::thread::spawn(move || {
                signals.forever().for_each(|signal| match signal {
                    SIGINT => pressed(),
                    // Signals come in pairs: `timeout` signals the command and then its group, and for a closed
                    // terminal the shell and the kernel each send one.
                    _ => drop(request()),
                });
            });
        }
    });
    REQUESTED.store(false, Ordering::Relaxed);
}

/// Whether SIGHUP is ignored, as `nohup` sets it. Only Linux reports this; elsewhere the signal is left alone.
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

/// [`is_requested`] as an error of the kind `Interrupted`, for row writers.
pub(super) fn check() -> io::Result<()> {
    if is_requested() { Err(io::ErrorKind::Interrupted.into()) } else { Ok(()) }
}
