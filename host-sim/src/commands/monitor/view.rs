//! A session as text: notes, each printed when it changes, and one line of figures.

use super::{Session, Shown, Status};
use crossterm::terminal;
use model_core::control::Mode;
use model_core::{Faults, SetPoint, SetPointError};
use std::io::{self, Write};
use std::time::{Duration, Instant};
use thermyo_files::units::UnitSystem;
use thermyo_protocol::{LastReset, Refusal};
use thermyo_record::board_trace::kind_and_values;

/// The keys at a terminal.
pub const KEYS: &str = "space vents, Ctrl-C vents and leaves, a arms, arrows move the pressure";

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
    pub(super) fn show(&mut self, to: &mut dyn Write, session: &Session) -> io::Result<()> {
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
            write!(to, "{KEYS}{end}")?;
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
pub fn notes(session: &Session, units: UnitSystem) -> Vec<String> {
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

/// Remedy of a refusal, as the end of its message.
fn way_out(refusal: &Refusal) -> &'static str {
    match refusal {
        Refusal::NotConfigured
        | Refusal::SetPoint(SetPointError::Faults(Faults::NOT_CONFIGURED)) => {
            "; thermyo board PORT config write SCENARIO.toml configures it"
        }
        Refusal::SetPoint(SetPointError::NotArmed) => "; a arms it",
        Refusal::SetPoint(SetPointError::Faults(_)) => "; thermyo board PORT clear, then a arms it",
        _ => "",
    }
}

/// The latest telemetry in one line, the most important first: a narrow terminal truncates it.
pub fn figures(session: &Session, units: UnitSystem) -> Option<String> {
    let telemetry = session.latest()?;
    let mode = Mode::NAMES.iter().find(|(mode, _)| *mode == telemetry.mode);
    let mode = mode.map_or("", |(_, name)| name);
    let limited = if telemetry.limited { ", limited" } else { "" };
    let faults = match telemetry.faults {
        Faults::NONE => "no fault".to_owned(),
        faults => faults.to_string(),
    };
    let estimate = &telemetry.estimate;
    let text = |value: f32, si, decimals| units.text(value.into(), si, decimals);
    let reading_k = session.config().sensing().gas_k(telemetry.sample.gas);
    let remark = if estimate.valid { "" } else { " (not to be relied on)" };
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
    Some(format!(
        "{} (set point {}), {}, gas {} +- {:.2} K{remark}; {mode}{limited}: {faults}; inlet {}, \
         outlet {}, sensor {}, wall {}; {} rows{timing}",
        text(telemetry.pressure_pa, "Pa", 1),
        set_point(telemetry.set_point, units),
        text(telemetry.length_m, "m", 1),
        text(estimate.gas_k, "K", 2),
        estimate.gas_sd_k,
        text(telemetry.command.inlet.share(), "", 1),
        text(telemetry.command.outlet.share(), "", 1),
        text(reading_k, "K", 2),
        text(estimate.wall_k, "K", 2),
        session.rows(),
    ))
}

fn set_point(set_point: SetPoint, units: UnitSystem) -> String {
    let (_, value, second) = kind_and_values(set_point);
    let text = |value: f32, si, decimals| units.text(value.into(), si, decimals);
    match set_point {
        SetPoint::Vent => "none: it vents".to_owned(),
        SetPoint::Pressure { .. } => text(value, "Pa", 1),
        SetPoint::Contraction { .. } => text(value, "", 1),
        SetPoint::MassFlow { .. } => text(value, "kg/s", 3),
        SetPoint::MassFlowCycle { .. } => {
            format!("{}, {second:.1} s", text(value, "kg/s", 3))
        }
        SetPoint::Duty { .. } => {
            format!("{}, {}", text(value, "", 0), text(second, "", 0))
        }
    }
}
