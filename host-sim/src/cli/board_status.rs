//! Status of a board in words.

use super::{Console, Failure};
use model_core::Config;
use serde_json::{Value, json};
use std::path::Path;
use thermyo_boards::subject::Subject;
use thermyo_files::input::write_new;
use thermyo_files::units::UnitSystem;
use thermyo_protocol::{ConfigSource, Event, Image, LastReset, Status, Timing, Version};
use thermyo_simulation::board::BoardError;

/// A board's answers about itself, whatever it drives.
pub(super) struct Overview {
    pub version: Version,
    pub status: Status,
    pub timing: Timing,
    pub last_reset: LastReset,
}

/// Prints up to which pressure a board is armed, and from which it vents.
pub(super) fn armed(
    (armed_pa, config, of): (f32, &Config, &str),
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let vents_pa = armed_pa + config.pressure_margin_pa();
    let [most, vents] = [armed_pa, vents_pa].map(|pa| to.units.text(pa.into(), "Pa", 1));
    let words = format!("armed up to {most}, {of}; above {vents} it vents\n");
    to.done(&json!({ "armed_pa": armed_pa, "vents_pa": vents_pa }), &words)
}

/// Saves the configuration in use.
pub(super) fn save(board: &mut impl Subject, to: &mut Console<'_>) -> Result<(), Failure> {
    board.save()?;
    shown_as("saved: ", &board.status()?, to)
}

/// Prints a board's configuration after these words.
pub(super) fn shown_as(words: &str, status: &Status, to: &mut Console<'_>) -> Result<(), Failure> {
    to.done(&configuration_json(status), &format!("{words}{}\n", configuration(status)))
}

/// A board without a fault, after `clear`.
pub(super) fn cleared(armed_pa: Option<f32>) -> String {
    let until = if armed_pa.is_some() { "a set point comes: it is armed" } else { "it is armed" };
    format!("no fault is left; it vents until {until}\n")
}

impl Overview {
    pub fn of(board: &mut impl Subject) -> Result<Self, BoardError> {
        Ok(Self {
            version: board.version(),
            status: board.status()?,
            timing: board.timing()?,
            last_reset: board.last_reset()?,
        })
    }

    pub fn json(&self, port: &str) -> Value {
        json!({
            "port": port,
            "version": self.version,
            "status": self.status,
            "config_name": self.status.config_name.as_str(),
            "last_reset": self.last_reset,
            "timing": self.timing,
        })
    }

    /// `drives`: a line that begins with the driven muscle or joint.
    pub fn text(&self, faults: &str, drives: &str, units: UnitSystem) -> String {
        let Self { version, status, timing, last_reset } = self;
        let [major, minor, patch] = version.firmware;
        let armed = status.armed_pa.map_or("no".to_owned(), |armed_pa| {
            format!("up to {}", units.text(armed_pa.into(), "Pa", 1))
        });
        let joint = if version.image == Image::Joint { ", a joint" } else { "" };
        format!(
            "board:         {}, firmware {major}.{minor}.{patch}, protocol {}{joint}\n\
             started by:    {}, {} restarts since power came\n\
             configuration: {}\n\
             armed:         {armed}\n\
             faults:        {faults}\n\
             {drives}\n\
             timing:        {}\n",
            version.chip,
            version.protocol,
            started_by(*last_reset),
            status.restarts,
            configuration(status),
            timed(timing),
        )
    }
}

fn started_by(last_reset: LastReset) -> String {
    match last_reset {
        LastReset::Power => "power or its reset pin".to_owned(),
        other => format!("{other:?}"),
    }
}

fn configuration_json(status: &Status) -> Value {
    json!({
        "config_name": status.config_name.as_str(),
        "config_checksum": status.config_checksum,
        "config_source": status.config_source,
    })
}

fn configuration(status: &Status) -> String {
    let name = match status.config_name.as_str() {
        "" => "no name",
        name => name,
    };
    let from = match status.config_source {
        ConfigSource::Defaults => "the core's defaults",
        ConfigSource::Host => "sent by the host, not saved",
        ConfigSource::Flash => "from flash",
    };
    format!("{name}, {:08x}, {from}", status.config_checksum)
}

pub(super) fn timed(timing: &Timing) -> String {
    format!(
        "step {:.0} us mean, {} us worst; start {:.0} us late in the mean, {} us at worst; {} missed of {}",
        f64::from(timing.step_mean_ns) / 1e3,
        timing.step_worst_us,
        f64::from(timing.jitter_mean_ns) / 1e3,
        timing.jitter_worst_us,
        timing.missed_steps,
        timing.steps,
    )
}

/// Writes the scenario of a board's configuration; `exact`: whether the scenario gives the same
/// configuration again.
pub(super) fn config_file(
    (file, scenario, exact): (&Path, &str, bool),
    status: &Status,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let named = configuration(status);
    write_new(file, format!("# {named}\n\n{scenario}"))?;
    if !exact {
        to.say(
            "a scenario cannot hold all of this configuration: written back it has another \
             checksum",
        );
    }
    let words = format!("{}: {named}\n", file.display());
    let mut json = configuration_json(status);
    json["file"] = json!(file.display().to_string());
    to.done(&json, &words)
}

/// Prints the history of a board; `ended` says how a fault ends the drive.
pub(super) fn history(
    (events, ended): (&[Event], &str),
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let json = serde_json::to_value(events).expect("plain data");
    if events.is_empty() {
        let words = "no events: it has neither vented by itself nor restarted\n";
        return to.answer(&json, words);
    }
    let mut words = String::new();
    for event in events {
        words += &match event {
            Event::Started(last_reset) => format!("started by {}\n", started_by(*last_reset)),
            Event::Vented(first) => format!(
                "{ended} by {} at {}, step {}\n",
                first.faults,
                to.units.text(first.pressure_pa.into(), "Pa", 2),
                first.step
            ),
        };
    }
    to.answer(&json, &words)
}
