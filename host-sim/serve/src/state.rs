//! What a page shows besides the measured values: one message, whole every time.

use model_core::Config;
use model_core::control::contractions;
use model_core::link::{Chip, ConfigSource, Status, Timing, Version};
use model_core::physics::chamber::{AnyChamber, ChamberConfig};
use serde::Serialize;
use std::time::{SystemTime, UNIX_EPOCH};
use thermyo_plant::chamber;
use thermyo_setup::from_config;

/// State of the link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Link {
    /// Telemetry comes.
    Connected,
    /// The port is open, and no telemetry comes.
    Silent,
    /// The port is gone; it is tried again and again.
    Lost,
    /// The server has ended.
    Ended,
}

/// Everything.
#[derive(Debug, Clone, Serialize)]
pub struct State {
    /// "state", which tells it from other messages.
    pub kind: &'static str,
    /// State of the link.
    pub link: Link,
    /// What is served.
    pub target: String,
    /// Who the board is.
    pub board: Option<Board>,
    /// What it has been configured with.
    pub configuration: Configuration,
    /// Highest absolute pressure of set points \[Pa\]; none where it is not armed.
    pub armed_pa: Option<f32>,
    /// What is wrong.
    pub faults: Vec<&'static str>,
    /// Whether that vents the muscle.
    pub vents: bool,
    /// How steps were timed.
    pub timing: Option<Timing>,
    /// Steps whose telemetry did not arrive.
    pub lost_steps: u64,
    /// The recording that runs.
    pub recording: Option<Recorded>,
    /// What lies in the folder by now, the last one first.
    pub results: Vec<ResultLink>,
    /// What is guided.
    pub guide: Option<Guide>,
    /// What happened, the last event first.
    pub events: Vec<Event>,
}

/// Who the board is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Board {
    /// The chip.
    pub chip: Chip,
    /// Version of the firmware.
    pub firmware: [u16; 3],
}

impl From<Version> for Board {
    fn from(version: Version) -> Self {
        Self { chip: version.chip, firmware: version.firmware }
    }
}

/// What a board has been configured with, as far as the page needs it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Configuration {
    /// Its name.
    pub name: String,
    /// Its checksum.
    pub checksum: u32,
    /// Where it comes from.
    pub source: ConfigSource,
    /// Whether anybody has configured it.
    pub configured: bool,
    /// What the muscle behind an emulated board is called.
    pub own: Option<String>,
    /// Absolute pressure of the surroundings \[Pa\].
    pub ambient_pa: f32,
    /// Absolute pressure of the supply \[Pa\].
    pub supply_pa: f32,
    /// Highest pressure that a set point is followed to \[Pa\].
    pub working_limit_pa: f32,
    /// Least and most contraction that may be asked for \[-\].
    pub contractions: [f32; 2],
    /// Length that contraction counts from \[m\].
    pub rest_length_m: Option<f64>,
    /// The braid.
    pub braid: Option<Braid>,
}

/// What a muscle's diameter follows from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Braid {
    /// Length of a thread \[m\].
    pub thread_length_m: f32,
    /// Its turns \[-\].
    pub turns: f32,
}

impl Configuration {
    /// What a board has; `own`: see there.
    pub fn new(config: &Config, status: &Status, own: Option<String>) -> Self {
        let said = from_config::to_scenario(config).ok();
        let chamber = said.and_then(|said| chamber::of(&said.scenario.believed));
        let braid = match &config.chamber {
            ChamberConfig::Muscle(muscle) => Some(Braid {
                thread_length_m: muscle.braid.thread_length_m,
                turns: muscle.braid.turns,
            }),
            _ => None,
        };
        Self {
            name: status.config_name.as_str().to_owned(),
            checksum: status.config_checksum,
            source: status.config_source,
            configured: status.config_source != ConfigSource::Defaults,
            own,
            ambient_pa: config.ambient.pressure_pa,
            supply_pa: config.supply.pressure_pa,
            working_limit_pa: config.working_limit_pa(),
            contractions: contractions(config, &AnyChamber::new(&config.chamber)),
            rest_length_m: chamber.map(|chamber| chamber.rest_length()),
            braid,
        }
    }
}

/// A recording that runs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Recorded {
    /// Steps so far.
    pub rows: u64,
    /// Since its beginning \[s\].
    pub time_s: f64,
}

/// What can be opened.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ResultLink {
    /// Name of its folder, and of its address.
    pub name: String,
    /// What it is.
    pub text: String,
}

/// Where a guided task is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Guide {
    /// Its name.
    pub title: String,
    /// What is to be done, or what came out.
    pub text: String,
    /// A number of this unit is asked for.
    pub asks: Option<&'static str>,
    /// Share that is done \[-\].
    pub progress: Option<f64>,
    /// Name of the result that came out.
    pub result: Option<String>,
    /// It has ended.
    pub over: bool,
}

/// Something that happened.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Event {
    /// Milliseconds since 1970.
    pub at_ms: u64,
    /// How serious it is.
    pub weight: Weight,
    /// What.
    pub text: String,
}

/// How serious an event is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Weight {
    /// As wanted.
    Plain,
    /// Something was not done.
    Refused,
    /// Something is wrong.
    Fault,
}

impl Event {
    /// One that happens now.
    pub fn now(weight: Weight, text: String) -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { at_ms: since.as_millis() as u64, weight, text }
    }
}
