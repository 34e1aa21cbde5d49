//! `thermyo monitor`: a live view of a board behind a serial port, and its recording.
//!
//! The session asks the board and records what it says; the view draws what the session knows. A
//! board that is unplugged is waited for, and asked again when it is back.

mod record;
mod session;
mod view;

pub use record::Recorder;
pub use session::{Session, Status};
pub use view::draw;

use crate::board::BoardError;
use ratatui::crossterm::event::{self, Event, KeyCode};
use std::path::Path;
use std::time::{Duration, Instant};

/// Time between two pictures.
const FRAME: Duration = Duration::from_millis(100);

/// Shows and records until `q` or Esc is pressed.
///
/// # Errors
/// [`BoardError`] when the port cannot be opened at the start, or the recording not be written.
pub fn run(port: &str, trace: &Path) -> Result<(), BoardError> {
    let mut session = Session::open(port, Recorder::create(trace)?)?;
    let mut terminal = ratatui::try_init()?;
    let mut shown: Option<Instant> = None;
    let outcome = loop {
        if let Err(error) = session.poll() {
            break Err(error);
        }
        if shown.is_none_or(|at| at.elapsed() >= FRAME) {
            shown = Some(Instant::now());
            if let Err(error) = terminal.draw(|frame| draw(frame, &session)) {
                break Err(error.into());
            }
        }
        match quit() {
            Ok(false) => (),
            Ok(true) => break Ok(()),
            Err(error) => break Err(error.into()),
        }
    };
    ratatui::restore();
    session.finish()?;
    outcome
}

/// Whether the user wants to leave.
fn quit() -> std::io::Result<bool> {
    if !event::poll(Duration::ZERO)? {
        return Ok(false);
    }
    Ok(matches!(
        event::read()?,
        Event::Key(key) if matches!(key.code, KeyCode::Char('q') | KeyCode::Esc)
    ))
}
