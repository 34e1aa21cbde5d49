//! `thermyo serve`: a board on a local page, live: seen, steered, recorded, calibrated, tuned.
//!
//! ```text
//! board --link--> operator (a thread) --every step--> recording (a thread) --> trace, summary, report
//!                   |    ^
//!    frames, state  |    | orders, one of each kind; a vent passes them
//!                   v    |
//!                 sockets (one async thread) <--> pages: the first steers, the others watch
//! ```
//!
//! One thread owns the link, because all that talks to a board waits for its answers: driving, tuning, calibrating.
//! What it hears it fans out: whole to the recording, thinned to the pages. A page says how much it has seen; one
//! that falls behind is not sent more, and so loses frames, while nobody waits for it.

mod frames;
mod guide;
mod operator;
mod orders;
pub mod page;
mod recording;
mod results;
mod seats;
mod shared;
mod socket;
mod state;
mod target;
mod tuning;
mod web;
mod word;

pub use operator::Operator;
pub use shared::Shared;
pub use target::{OpenError, Target};
pub use web::{Address, listen};

use std::path::PathBuf;
use std::sync::Arc;
use std::{io, thread};

/// Serves a board until `wanted` says to end, and then vents it. Gives the
/// folders of what was recorded.
///
/// # Errors
/// Those of the sockets.
pub fn serve(
    operator: Operator,
    listener: std::net::TcpListener,
    address: Address,
    wanted: impl Fn() -> bool + Send + 'static,
) -> io::Result<Vec<PathBuf>> {
    let shared = operator.shared();
    let operating = thread::spawn(move || operator.run(&wanted));
    let served = web::run(listener, address, Arc::clone(&shared));
    // Where the sockets have failed, the board is not left alone.
    shared.end();
    let _ = operating.join();
    served.map(|()| shared.results().into_iter().map(|result| result.folder).collect())
}
