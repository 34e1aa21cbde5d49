//! Ctrl-C: a command that keeps what it has recorded so far stops at its next row; any other at once.

use signal_hook::consts::SIGINT;
use signal_hook::flag;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

/// What a shell reports of a command that Ctrl-C ended.
pub(super) const EXIT_CODE: u8 = 130;

/// What the signal has set, and whether it ends the process at once.
struct Flags {
    asked: Arc<AtomicBool>,
    at_once: Arc<AtomicBool>,
}

static FLAGS: OnceLock<Flags> = OnceLock::new();

/// From now on Ctrl-C ends the process with [`EXIT_CODE`].
///
/// # Errors
/// Those of the system.
pub(super) fn install() -> io::Result<()> {
    let flags = FLAGS
        .get_or_init(|| Flags { asked: Arc::default(), at_once: Arc::new(AtomicBool::new(true)) });
    for ends in [&flags.at_once, &flags.asked] {
        // The second one: whoever presses it twice does not want to wait.
        flag::register_conditional_shutdown(SIGINT, EXIT_CODE.into(), Arc::clone(ends))?;
    }
    flag::register(SIGINT, Arc::clone(&flags.asked)).map(drop)
}

/// From now on Ctrl-C is only noted, for [`check`]; pressed again it ends the process.
pub(super) fn watch() {
    if let Some(flags) = FLAGS.get() {
        flags.at_once.store(false, Ordering::SeqCst);
    }
}

/// An error of the kind `Interrupted` once Ctrl-C has been pressed.
pub(super) fn check() -> io::Result<()> {
    let asked = FLAGS.get().is_some_and(|flags| flags.asked.load(Ordering::SeqCst));
    if asked { Err(io::ErrorKind::Interrupted.into()) } else { Ok(()) }
}
