//! A session as text: notes, each printed when it changes, and one line of figures.

use super::{Monitored, Session, Shown, Status};
use crossterm::terminal;
use model_core::joint::JointError;
use model_core::{Faults, SetPointError};
use std::io::{self, Write};
use std::time::{Duration, Instant};
use thermyo_files::units::UnitSystem;
use thermyo_protocol::{LastReset, Refusal};

/// Interval of the figures in a terminal's line.
const REFRESH: Duration = Duration::from_millis(100);
/// Interval of the lines of figures.
const LINE: Duration = Duration::from_secs(1);

/// Prints a session; remembers what was printed last.
pub(super) struct View {
    shown: Shown,
    units: UnitSystem,
    notes: Vec<String>,
    figures: Option<Instant>,
}

impl View {
    pub(super) fn new(shown: Shown, units: UnitSystem) -> Self {
        Self { shown, units, notes: Vec::new(), figures: None }
    }

    /// Prints new notes, and figures when they are due.
    pub(super) fn show<S: Monitored>(
        &mut self,
        to: &mut dyn Write,
        session: &Session<S>,
    ) -> io::Result<()> {
        let (begin, end, pause) = match self.shown {
            Shown::Not => return Ok(()),
            Shown::Lines => ("", "\n", LINE),
            // A raw terminal does not return to the first column by itself.
            Shown::Terminal => ("\r\x1b[K", "\r\n", REFRESH),
        };
        if self.figures.is_some_and(|at| at.elapsed() < pause) {
            return Ok(());
        }
        if self.figures.is_none() && self.shown == Shown::Terminal {
            let moved = S::MOVED;
            let keys = "space vents, Ctrl-C vents and leaves, a arms, arrows move";
            write!(to, "{keys} {moved}{end}")?;
        }
        self.figures = Some(Instant::now());
        let notes = notes(session, self.units);
        for note in notes.iter().filter(|note| !self.notes.contains(note)) {
            write!(to, "{begin}{note}{end}")?;
        }
        self.notes = notes;
        let Some(figures) = figures(session, self.units) else { return to.flush() };
        match self.shown {
            Shown::Terminal => {
                // A wrapped line cannot be overwritten.
                let columns = terminal::size().map_or(80, |(columns, _)| columns);
                let most = usize::from(columns).saturating_sub(1);
                let line: String = figures.chars().take(most).collect();
                write!(to, "{begin}{line}")?;
            }
            _ => writeln!(to, "{figures}")?,
        }
        to.flush()
    }
}

/// State that changes rarely: connection, arming, failures.
pub fn notes<S: Monitored>(session: &Session<S>, units: UnitSystem) -> Vec<String> {
    let status = match session.status() {
        Status::Connected => "connected",
        Status::Silent => "no telemetry: is the firmware flashed?",
        Status::Unplugged => "unplugged: waiting for it to come back",
    };
    let board = session.version().map_or(String::new(), |version| {
        let [major, minor, patch] = version.firmware;
        format!(", {}, firmware {major}.{minor}.{patch}", version.chip)
    });
    let arming = session.last_status().map(|status| {
        let armed = match status.armed_pa {
            Some(pa) => format!("armed up to {}", units.text(pa.into(), "Pa", 0)),
            None => "not armed".to_owned(),
        };
        let name = match status.config_name.as_str() {
            "" => "without a name",
            name => name,
        };
        format!("{armed}; configuration {name} {:08x}", status.config_checksum)
    });
    let restart = match session.last_reset() {
        None | Some(LastReset::Power) => None,
        Some(reason) => Some(format!("last restart: {reason:?}")),
    };
    let first = session.first_failure().map(|first| {
        let pressure = units.text(first.pressure_pa.into(), "Pa", 1);
        format!("first failure: {} at {pressure}, step {}", first.faults, first.step)
    });
    let refused =
        session.refused().map(|refusal| format!("refused: {refusal}{}", way_out(&refusal)));
    let connection = Some(format!("{}: {status}{board}", session.port()));
    [connection, arming, restart, first, refused].into_iter().flatten().collect()
}

/// Remedy for a refusal, as the end of its message.
fn way_out(refusal: &Refusal) -> &'static str {
    match refusal {
        Refusal::NotConfigured
        | Refusal::SetPoint(SetPointError::Faults(Faults::NOT_CONFIGURED))
        | Refusal::JointSetPoint(JointError::Faults([Faults::NOT_CONFIGURED, _], _)) => {
            "; thermyo board PORT config write SCENARIO.toml configures it"
        }
        Refusal::SetPoint(SetPointError::NotArmed)
        | Refusal::JointSetPoint(JointError::NotArmed) => "; a arms it",
        Refusal::SetPoint(SetPointError::Faults(_))
        | Refusal::JointSetPoint(JointError::Faults(..)) => {
            "; thermyo board PORT clear, then a arms it"
        }
        _ => "",
    }
}

pub fn rows(count: u64) -> String {
    format!("{count} {}", if count == 1 { "row" } else { "rows" })
}

/// The latest telemetry in one line, the most important first: a narrow terminal truncates it.
pub fn figures<S: Monitored>(session: &Session<S>, units: UnitSystem) -> Option<String> {
    let figures = S::figures(&session.config(), session.latest()?, units);
    let timing = session.timing().map_or(String::new(), |timing| {
        format!(
            "; step {:.0}/{} us, start {} us late; {} missed, {} dropped, {} malformed",
            f64::from(timing.step_mean_ns) / 1000.0,
            timing.step_worst_us,
            timing.jitter_worst_us,
            timing.missed_steps,
            timing.dropped_telemetry,
            timing.malformed_frames,
        )
    });
    Some(format!("{figures}; {}{timing}", rows(session.rows())))
}

#[cfg(test)]
mod tests {
    #[test]
    fn one_row_is_one() {
        assert_eq!([0, 1, 2].map(super::rows), ["0 rows", "1 row", "2 rows"]);
    }
}
