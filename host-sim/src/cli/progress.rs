//! Progress on standard error: a bar on a terminal, otherwise a line now and then.

use super::interrupt;
use crossterm::terminal;
use std::io::{self, IsTerminal, Write};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};
use thermyo_compute::parallel::Watch;

/// Shortest time between two drawings.
const REDRAW: Duration = Duration::from_millis(100);
/// Time after which a bar is drawn again even if no part was done.
const TICK: Duration = Duration::from_secs(1);
/// Time between two lines without a terminal.
const SIGN_OF_LIFE: Duration = Duration::from_secs(30);
const CLEAR: &str = "\r\x1b[K";

/// Cleared when dropped.
pub(super) struct Bar(Option<Shown>);

struct Shown {
    state: Arc<Mutex<State>>,
    /// Ends the thread that shows progress while a part takes long.
    _ticks: Sender<()>,
}

struct State {
    position: u64,
    length: u64,
    begun: Instant,
    drawn: Option<Instant>,
    ended: bool,
    on_terminal: bool,
    to: Box<dyn Write + Send>,
}

impl Bar {
    /// `length`: number of parts to do, as far as it is known.
    pub(super) fn new(length: u64, quiet: bool) -> Self {
        let on_terminal = io::stderr().is_terminal();
        let interval = if on_terminal { TICK } else { SIGN_OF_LIFE };
        Self(
            (!quiet).then(|| {
                Shown::new(State::new(length, on_terminal, Box::new(io::stderr())), interval)
            }),
        )
    }

    pub(super) fn set_length(&self, length: u64) {
        self.update(|state| state.length = length);
    }

    pub(super) fn set_position(&self, position: u64) {
        self.update(|state| state.position = position);
    }

    /// Clears the bar for good.
    pub(super) fn clear(&self) {
        let Some(shown) = &self.0 else { return };
        let mut state = lock(&shown.state);
        if !state.ended {
            state.ended = true;
            if state.on_terminal {
                let _ = write!(state.to, "{CLEAR}");
            }
        }
    }

    fn update(&self, change: impl FnOnce(&mut State)) {
        let Some(shown) = &self.0 else { return };
        let mut state = lock(&shown.state);
        change(&mut state);
        if state.on_terminal && state.drawn.is_none_or(|at| at.elapsed() >= REDRAW) {
            state.draw();
        }
    }
}

impl Shown {
    fn new(state: State, interval: Duration) -> Self {
        let state = Arc::new(Mutex::new(state));
        let (ticks, ended) = mpsc::channel();
        let ticking = Arc::clone(&state);
        thread::spawn(move || {
            while ended.recv_timeout(interval) == Err(RecvTimeoutError::Timeout) {
                lock(&ticking).draw();
            }
        });
        Self { state, _ticks: ticks }
    }
}

fn lock(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Watch for Bar {
    fn parts(&self, count: usize) {
        self.update(|state| state.length += count as u64);
    }

    fn done(&self) {
        self.update(|state| state.position += 1);
    }

    fn stopped(&self) -> bool {
        interrupt::is_requested()
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.clear();
    }
}

impl State {
    fn new(length: u64, on_terminal: bool, to: Box<dyn Write + Send>) -> Self {
        let (begun, drawn) = (Instant::now(), None);
        Self { position: 0, length, begun, drawn, ended: false, on_terminal, to }
    }

    fn draw(&mut self) {
        if self.ended {
            return;
        }
        self.drawn = Some(Instant::now());
        let elapsed = self.begun.elapsed();
        let text = if self.on_terminal {
            let columns = terminal::size().map_or(80, |(columns, _)| columns);
            format!("{CLEAR}{}", self.line(elapsed, columns.into()))
        } else {
            let done = (100.0 * self.done()) as u64;
            let share = if done > 0 { format!(", {done} % done") } else { String::new() };
            format!("thermyo: at work for {} s{share}\n", elapsed.as_secs())
        };
        // A closed standard error does not stop the work.
        let _ = write!(self.to, "{text}");
    }

    fn done(&self) -> f64 {
        (self.position as f64 / self.length.max(1) as f64).min(1.0)
    }

    /// Percentage done, with the time left where that can be told, and otherwise the time so far.
    fn figures(&self, elapsed: Duration) -> String {
        let done = self.done();
        let elapsed_s = elapsed.as_secs_f64();
        let time = if done > 0.0 && done < 1.0 {
            format!("{} s left", (elapsed_s * (1.0 - done) / done).min(1e6) as u64)
        } else {
            format!("{} s", elapsed_s as u64)
        };
        format!(" {:>3.0} %  {time}", done * 100.0)
    }

    fn line(&self, elapsed: Duration, columns: usize) -> String {
        let figures = self.figures(elapsed);
        let width = columns.saturating_sub(figures.len() + 1);
        let full = (width as f64 * self.done()) as usize;
        format!("{}{}{figures}", "█".repeat(full), "░".repeat(width - full))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Lines(Sender<String>);

    impl Write for Lines {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let _ = self.0.send(String::from_utf8_lossy(bytes).into_owned());
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_bar_fills_its_line() {
        let line = |position, columns| {
            let state = State { position, ..State::new(200, true, Box::new(io::sink())) };
            state.line(Duration::from_secs(6), columns)
        };
        assert_eq!(line(0, 17), "░░░░░   0 %  6 s");
        assert_eq!(line(50, 30), "███░░░░░░░░░  25 %  18 s left");
        assert_eq!(line(400, 19), "███████ 100 %  6 s");
        assert_eq!(line(50, 10), "  25 %  18 s left", "too narrow for a bar");
    }

    /// A search of minutes without finished parts used to print nothing, on a terminal or without one.
    #[test]
    fn a_long_part_shows_that_it_lives() {
        for (on_terminal, sign) in [(true, "░   0 %  "), (false, "thermyo: at work for ")] {
            let (sender, written) = mpsc::channel();
            let state = State::new(0, on_terminal, Box::new(Lines(sender)));
            let bar = Bar(Some(Shown::new(state, Duration::from_millis(1))));
            let said: String = written.iter().take(8).collect();
            assert!(said.contains(sign), "{said:?}");
            drop(bar);
            // Returns when the thread has ended.
            written.iter().for_each(drop);
        }
    }
}
