//! `thermyo monitor`: records a board behind a serial port, with a line of figures.
//!
//! The session queries the board and records its answers; the view prints the session's state. At a
//! terminal the monitor waits for a board that is unplugged, and connects again when it is back.

mod session;
mod subject;
pub mod view;

pub use session::{Configured, EVERY, Session, Status};
pub use subject::{Monitored, joint_at};
use view::View;
pub use view::rows;

use crossterm::event::{self, Event, KeyCode, KeyModifiers};
use crossterm::terminal::{disable_raw_mode, enable_raw_mode};
use std::io::{self, Write};
use std::time::Duration;
use thermyo_files::input::InputError;
use thermyo_files::output::OutputDir;
use thermyo_files::units::UnitSystem;
use thermyo_simulation::board::BoardError;

#[derive(Debug, thiserror::Error)]
pub enum MonitorError {
    /// The port cannot be opened, or the board uses another protocol.
    #[error(transparent)]
    Board(#[from] BoardError),
    #[error("the recording cannot be written: {0}")]
    Recording(io::Error),
    /// A file beside the recording cannot be written.
    #[error(transparent)]
    Output(#[from] InputError),
    /// Without a terminal a lost link ends the recording.
    #[error("the line to the board is gone; the rows until then are recorded")]
    Gone,
    /// The keys cannot be read, or nothing can be printed.
    #[error("the terminal cannot be used: {0}")]
    Terminal(io::Error),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// The key for leaving was pressed.
    Left,
    /// Ctrl-C was pressed.
    Stopped,
}

/// Form in which a monitor prints its figures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shown {
    Not,
    /// In lines, one after the other.
    Lines,
    /// In one line of a terminal, whose keys drive the board.
    Terminal,
}

/// Shows and records until Ctrl-C, `q` or Esc is pressed, which vents a driven board. `config.json`
/// in `out` lists every configuration of the board; `scenario.toml` is the scenario of the last
/// one. Without a terminal it records until `stopped`, or until the link is lost.
pub fn run<S: Monitored>(
    session: &mut Session<S>,
    out: &mut OutputDir,
    (shown, units): (Shown, UnitSystem),
    stopped: &dyn Fn() -> bool,
) -> Result<Ended, MonitorError> {
    let outcome = if shown == Shown::Terminal {
        enable_raw_mode().map_err(MonitorError::Terminal)?;
        let _keys = Keys;
        let outcome = watch(session, out, (shown, units), stopped);
        // The next output starts below the figures.
        let _ = write!(io::stdout(), "\r\n");
        outcome
    } else {
        watch(session, out, (shown, units), stopped)
    };
    session.let_go();
    let finished = session.finish();
    outcome.and_then(|ended| finished.map(|()| ended))
}

/// Raw mode until dropped: keys arrive one by one and are not echoed.
struct Keys;

impl Drop for Keys {
    fn drop(&mut self) {
        let _ = disable_raw_mode();
    }
}

fn watch<S: Monitored>(
    session: &mut Session<S>,
    out: &mut OutputDir,
    (shown, units): (Shown, UnitSystem),
    stopped: &dyn Fn() -> bool,
) -> Result<Ended, MonitorError> {
    let mut view = View::new(shown, units);
    let mut written = 0;
    loop {
        session.poll()?;
        if stopped() {
            return Ok(Ended::Stopped);
        }
        if session.configurations().len() > written {
            written = session.configurations().len();
            let json =
                serde_json::to_string_pretty(session.configurations()).expect("plain data") + "\n";
            out.text("config.json", &json)?;
            // A configuration that no scenario can express is still in `config.json`.
            if let Ok(scenario) = S::scenario(&session.config()) {
                out.text("scenario.toml", &scenario)?;
            }
        }
        match view.show(&mut io::stdout(), session) {
            // The program that reads the figures has ended.
            Err(error) if shown == Shown::Lines && error.kind() == io::ErrorKind::BrokenPipe => {
                return Ok(Ended::Left);
            }
            shown => shown.map_err(MonitorError::Terminal)?,
        }
        if shown != Shown::Terminal {
            if session.status() == Status::Unplugged {
                return Err(MonitorError::Gone);
            }
            continue;
        }
        match key().map_err(MonitorError::Terminal)? {
            Some(Key::Leave) => return Ok(Ended::Left),
            Some(Key::Stop) => return Ok(Ended::Stopped),
            Some(Key::Vent) => session.vent(),
            Some(Key::Arm) => session.arm(),
            Some(Key::Move(increments)) => session.move_set_point(increments),
            None => (),
        }
    }
}

enum Key {
    Leave,
    Stop,
    Vent,
    Arm,
    /// Moves the set point by this many increments.
    Move(f32),
}

fn key() -> io::Result<Option<Key>> {
    if !event::poll(Duration::ZERO)? {
        return Ok(None);
    }
    let Event::Key(key) = event::read()? else { return Ok(None) };
    let control = key.modifiers.contains(KeyModifiers::CONTROL);
    Ok(match key.code {
        KeyCode::Char('c') if control => Some(Key::Stop),
        KeyCode::Char('q') | KeyCode::Esc => Some(Key::Leave),
        KeyCode::Char(' ') => Some(Key::Vent),
        KeyCode::Char('a') => Some(Key::Arm),
        KeyCode::Up => Some(Key::Move(1.0)),
        KeyCode::Down => Some(Key::Move(-1.0)),
        KeyCode::Right => Some(Key::Move(5.0)),
        KeyCode::Left => Some(Key::Move(-5.0)),
        _ => None,
    })
}
