//! `thermyo monitor`: a live view of a board behind a serial port, and its recording.
//!
//! The session asks the board and records what it says; the view draws what the session knows. A
//! board that is unplugged is waited for, and asked again when it is back.

mod session;
mod view;

pub use session::{Configured, MOVE_PA, Session, Status};
pub use view::draw;

use ratatui::crossterm::event::{self, Event, KeyCode, KeyModifiers};
use std::io;
use std::time::{Duration, Instant};
use thermyo_compute::stop;
use thermyo_files::input::InputError;
use thermyo_files::output::OutputDir;
use thermyo_setup::from_config;
use thermyo_simulation::board::BoardError;

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
    /// Nobody sees that it is waited for.
    #[error("the line to the board is gone; what it said until then is recorded")]
    Gone,
    /// There is nothing to draw on.
    #[error("the terminal cannot be used: {0}")]
    Terminal(io::Error),
}

/// What ended a monitor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// Its key.
    Left,
    /// Ctrl-C.
    Stopped,
}

/// Shows and records until Ctrl-C, `q` or Esc is pressed, which vents what is driven; `config.json` in `out` says
/// what the board was configured with, `scenario.toml` what it was configured with last. Without a `screen` it records
/// until Ctrl-C, or until the line is gone.
///
/// # Errors
/// [`MonitorError`]; the rows until then are recorded.
pub fn run(
    session: &mut Session,
    out: &mut OutputDir,
    screen: bool,
) -> Result<Ended, MonitorError> {
    let outcome = if screen {
        let mut terminal = ratatui::try_init().map_err(MonitorError::Terminal)?;
        let outcome = watch(session, out, Some(&mut terminal));
        ratatui::restore();
        outcome
    } else {
        watch(session, out, None)
    };
    session.let_go();
    let finished = session.finish();
    outcome.and_then(|ended| finished.map(|()| ended))
}

fn watch(
    session: &mut Session,
    out: &mut OutputDir,
    mut terminal: Option<&mut ratatui::DefaultTerminal>,
) -> Result<Ended, MonitorError> {
    let mut shown: Option<Instant> = None;
    let mut written = 0;
    loop {
        session.poll()?;
        if stop::wanted() {
            return Ok(Ended::Stopped);
        }
        if session.configurations().len() > written {
            written = session.configurations().len();
            let json =
                serde_json::to_string_pretty(session.configurations()).expect("plain data") + "\n";
            out.text("config.json", &json)?;
            // A configuration that no scenario may have is in the other file all the same.
            if let Ok(said) = from_config::say(&session.config()) {
                out.text("scenario.toml", &thermyo_setup::render(&said.scenario))?;
            }
        }
        let Some(terminal) = &mut terminal else {
            if session.status() == Status::Unplugged {
                return Err(MonitorError::Gone);
            }
            continue;
        };
        if shown.is_none_or(|at| at.elapsed() >= FRAME) {
            shown = Some(Instant::now());
            terminal.draw(|frame| draw(frame, session)).map_err(MonitorError::Terminal)?;
        }
        match key().map_err(MonitorError::Terminal)? {
            Some(Key::Leave) => return Ok(Ended::Left),
            Some(Key::Stop) => return Ok(Ended::Stopped),
            Some(Key::Vent) => session.vent(),
            Some(Key::Arm) => session.arm(),
            Some(Key::Move(steps)) => session.move_set_point(steps * MOVE_PA),
            None => (),
        }
    }
}

/// What the user wants.
enum Key {
    Leave,
    Stop,
    Vent,
    Arm,
    /// Another set point, by so many steps.
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
