//! `thermyo monitor`: a live view of a board behind a serial port, and its recording.
//!
//! The session asks the board and records what it says; the view draws what the session knows. A
//! board that is unplugged is waited for, and asked again when it is back.

mod record;
mod session;
mod view;

pub use record::Recorder;
pub use session::{Session, Status, Told};
pub use view::draw;

use crate::board::BoardError;
use crate::files::input::InputError;
use crate::files::output::OutputDir;
use ratatui::crossterm::event::{self, Event, KeyCode};
use std::io;
use std::time::{Duration, Instant};

/// Time between two pictures.
const FRAME: Duration = Duration::from_millis(100);

/// Why a monitor ends before it is told to.
#[derive(Debug, thiserror::Error)]
pub enum MonitorError {
    /// The port cannot be opened, or what is behind it speaks another protocol.
    #[error(transparent)]
    Board(#[from] BoardError),
    /// The recording cannot be written.
    #[error("the recording cannot be written: {0}")]
    Recording(io::Error),
    /// Nor what goes with it.
    #[error(transparent)]
    Output(#[from] InputError),
    /// There is nothing to draw on.
    #[error("the terminal cannot be used: {0}")]
    Terminal(io::Error),
}

/// Shows and records until `q` or Esc is pressed; `config.json` in `out` says what the board was told.
///
/// # Errors
/// [`MonitorError`]; the rows until then are recorded.
pub fn run(session: &mut Session, out: &mut OutputDir) -> Result<(), MonitorError> {
    let mut terminal = ratatui::try_init().map_err(MonitorError::Terminal)?;
    let outcome = watch(session, out, &mut terminal);
    ratatui::restore();
    outcome.and(session.finish())
}

fn watch(
    session: &mut Session,
    out: &mut OutputDir,
    terminal: &mut ratatui::DefaultTerminal,
) -> Result<(), MonitorError> {
    let mut shown: Option<Instant> = None;
    let mut written = 0;
    loop {
        session.poll()?;
        if session.told().len() > written {
            written = session.told().len();
            let json = serde_json::to_string_pretty(session.told()).expect("plain data") + "\n";
            out.text("config.json", &json)?;
        }
        if shown.is_none_or(|at| at.elapsed() >= FRAME) {
            shown = Some(Instant::now());
            terminal.draw(|frame| draw(frame, session)).map_err(MonitorError::Terminal)?;
        }
        if quit().map_err(MonitorError::Terminal)? {
            return Ok(());
        }
    }
}

/// Whether the user wants to leave.
fn quit() -> io::Result<bool> {
    if !event::poll(Duration::ZERO)? {
        return Ok(false);
    }
    Ok(matches!(
        event::read()?,
        Event::Key(key) if matches!(key.code, KeyCode::Char('q') | KeyCode::Esc)
    ))
}
