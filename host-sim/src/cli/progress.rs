//! A progress bar on standard error, if that is a terminal.

use super::interrupt;
use crossterm::terminal;
use std::io::{self, IsTerminal, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};
use thermyo_compute::parallel::Watch;

/// Shortest time between two drawings.
const REDRAW: Duration = Duration::from_millis(100);
const CLEAR: &str = "\r\x1b[K";

/// Clears the bar when dropped.
pub(super) struct Bar(Option<Mutex<State>>);

struct State {
    position: u64,
    length: u64,
    begun: Instant,
    drawn: Option<Instant>,
}

impl Bar {
    /// `length`: number of parts to do, as far as it is known.
    pub(super) fn new(length: u64, quiet: bool) -> Self {
        let shown = !quiet && io::stderr().is_terminal();
        let state = State { position: 0, length, begun: Instant::now(), drawn: None };
        Self(shown.then(|| Mutex::new(state)))
    }

    pub(super) fn set_length(&self, length: u64) {
        self.update(|state| state.length = length);
    }

    pub(super) fn set_position(&self, position: u64) {
        self.update(|state| state.position = position);
    }

    pub(super) fn clear(&self) {
        if self.0.is_some() {
            let _ = write!(io::stderr(), "{CLEAR}");
        }
    }

    fn update(&self, change: impl FnOnce(&mut State)) {
        let Some(state) = &self.0 else { return };
        let mut state = state.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        change(&mut state);
        if state.drawn.is_none_or(|at| at.elapsed() >= REDRAW) {
            state.drawn = Some(Instant::now());
            let columns = terminal::size().map_or(80, |(columns, _)| columns);
            let line = state.line(state.begun.elapsed(), columns.into());
            let _ = write!(io::stderr(), "{CLEAR}{line}");
        }
    }
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
    fn line(&self, elapsed: Duration, columns: usize) -> String {
        let done = (self.position as f64 / self.length.max(1) as f64).min(1.0);
        let left_s = (elapsed.as_secs_f64() * (1.0 - done) / done).min(1e6) as u64;
        let left = if done > 0.0 { format!("  {left_s} s left") } else { String::new() };
        let figures = format!(" {:>3.0} %{left}", done * 100.0);
        let width = columns.saturating_sub(figures.len() + 1);
        let full = (width as f64 * done) as usize;
        format!("{}{}{figures}", "█".repeat(full), "░".repeat(width - full))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_fills_its_line() {
        let line = |position, columns| {
            let state = State { position, length: 200, begun: Instant::now(), drawn: None };
            state.line(Duration::from_secs(6), columns)
        };
        assert_eq!(line(0, 12), "░░░░░   0 %");
        assert_eq!(line(50, 30), "███░░░░░░░░░  25 %  18 s left");
        assert_eq!(line(400, 24), "███████ 100 %  0 s left");
        assert_eq!(line(50, 10), "  25 %  18 s left", "too narrow for a bar");
    }
}
