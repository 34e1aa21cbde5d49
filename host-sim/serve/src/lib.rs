//! `thermyo serve`: a board on a local page: live plots, set points, recording, calibration,
//! tuning, identification and comparison of records.
//!
//! ```text
//! board --link--> operator (a thread) --every step--> recording (a thread) --> trace, summary, report
//!                   |    ^
//!    frames, state  |    | orders, one of each kind; a vent overtakes them
//!                   v    |
//!                 sockets (one async thread) <--> pages: the first steers, the others watch
//! ```
//!
//! One thread owns the link, because all tasks with a board wait for its answers: driving, tuning, calibrating. It
//! sends every step to the recording, and a thinned stream to the pages. A page confirms the messages that it has
//! received; one that falls behind gets no more for a while and loses frames, so that it delays no other page.

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
mod sought;
mod state;
mod study;
mod target;
mod uploads;
mod web;
mod word;

pub use operator::{Operator, Served};
pub use shared::Shared;
pub use target::{OpenError, Opened, Target};
pub use web::{Address, listen};

use std::path::PathBuf;
use std::sync::Arc;
use std::{io, thread};

/// The end of a server.
#[derive(Debug)]
pub struct Ended {
    /// Whether the board has confirmed the vent; false if there is no link to it.
    pub vents: bool,
    /// Folders of the results.
    pub results: Vec<PathBuf>,
}

/// Serves a board until `wanted` returns true, and then vents it.
pub fn serve<S: Served>(
    operator: Operator<S>,
    listener: std::net::TcpListener,
    address: Address,
    wanted: impl Fn() -> bool + Send + 'static,
) -> io::Result<Ended> {
    let shared = operator.shared();
    let operating = thread::spawn(move || operator.run(&wanted));
    let served = web::run(listener, address, Arc::clone(&shared));
    // The board is vented even if the sockets have failed.
    shared.end();
    let vents = operating.join().unwrap_or(false);
    let results = shared.results().into_iter().map(|result| result.folder).collect();
    served.map(|()| Ended { vents, results })
}
