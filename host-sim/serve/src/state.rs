//! State of the page apart from the measured values: one message, always complete.

use super::sought::Offer;
use model_core::Config;
use serde::Serialize;
use std::time::{SystemTime, UNIX_EPOCH};
use thermyo_protocol::{Chip, ConfigSource, Status, Timing, Version};

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Link {
    /// Telemetry arrives.
    Connected,
    /// The port is open, and no telemetry arrives.
    Silent,
    /// The port is lost; opening it is retried.
    Lost,
    Ended,
}

#[derive(Debug, Clone, Serialize)]
pub struct State {
    /// Always "state": distinguishes it from other messages.
    pub kind: &'static str,
    pub link: Link,
    pub target: String,
    pub board: Option<Board>,
    pub configuration: Configuration,
    /// Name of the configuration before the last change.
    pub former: Option<String>,
    /// Highest absolute pressure of set points \[Pa\]; none if the board is not armed.
    pub armed_pa: Option<f32>,
    pub faults: Vec<String>,
    /// Whether one of the faults vents.
    pub vents: bool,
    pub timing: Option<Timing>,
    /// Steps whose telemetry did not arrive.
    pub lost_steps: u64,
    pub recording: Option<Recorded>,
    /// Results so far, the latest first.
    pub results: Vec<ResultLink>,
    /// The guided task.
    pub guide: Option<Guide>,
    pub study: Option<Study>,
    /// The events, the latest first.
    pub events: Vec<Event>,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Board {
    pub chip: Chip,
    pub firmware: [u16; 3],
}

impl From<Version> for Board {
    fn from(version: Version) -> Self {
        Self { chip: version.chip, firmware: version.firmware }
    }
}

/// The part of a board's configuration that the page needs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Configuration {
    pub name: String,
    pub checksum: u32,
    pub source: ConfigSource,
    /// Whether the core is configured; otherwise it runs on its defaults.
    pub configured: bool,
    /// Name of the muscle or joint behind an emulated board.
    pub own: Option<String>,
    /// Absolute ambient pressure \[Pa\].
    pub ambient_pa: f32,
    /// Absolute supply pressure \[Pa\].
    pub supply_pa: f32,
    /// Highest absolute pressure of a set point \[Pa\].
    pub working_limit_pa: f32,
    #[serde(flatten)]
    pub part: Part,
}

/// The part that only one kind of board has.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Part {
    Muscle {
        /// Range of contraction set points \[-\].
        contractions: [f32; 2],
        rest_length_m: Option<f64>,
        braid: Option<Braid>,
        /// Identifications that suit the configuration.
        offers: Vec<Offer>,
    },
    Joint {
        joint: JointPart,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct JointPart {
    pub minimum_rad: f32,
    pub maximum_rad: f32,
    /// Longest time of a lock \[s\]; 0 if it never locks.
    pub lock_s: f32,
}

/// Geometry from which the page computes the diameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Braid {
    pub thread_length_m: f32,
    /// Turns of a thread \[-\].
    pub turns: f32,
}

impl Configuration {
    /// Configuration of muscles; its limits hold for every one of them.
    pub fn new(muscles: &[Config], part: Part, status: &Status, own: Option<String>) -> Self {
        let least = |of: fn(&Config) -> f32| muscles.iter().map(of).fold(f32::INFINITY, f32::min);
        let ambients = muscles.iter().map(|muscle| muscle.ambient.pressure_pa);
        Self {
            name: status.config_name.as_str().to_owned(),
            checksum: status.config_checksum,
            source: status.config_source,
            configured: status.config_source != ConfigSource::Defaults,
            own,
            ambient_pa: ambients.fold(0.0, f32::max),
            supply_pa: least(|muscle| muscle.supply.pressure_pa),
            working_limit_pa: least(Config::working_limit_pa),
            part,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Recorded {
    /// Number of steps so far.
    pub rows: u64,
    pub time_s: f64,
}

/// A result that the page can open.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ResultLink {
    /// Name of the result's folder, and of its address.
    pub name: String,
    pub text: String,
    /// Whether it has a record, `trace.csv`.
    pub trace: bool,
}

/// Progress of a guided task.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Guide {
    pub title: &'static str,
    /// Instruction or outcome.
    pub text: String,
    /// Names of the table's columns.
    pub head: Vec<&'static str>,
    pub table: Vec<Vec<String>>,
    /// Whether the board has new values that the user may keep, or replace by the former
    /// configuration.
    pub chooses: bool,
    /// SI symbol of the quantity that the user must enter.
    pub asks: Option<&'static str>,
    /// Finished fraction \[-\].
    pub progress: Option<f64>,
    pub result: Option<String>,
    pub over: bool,
}

impl Guide {
    /// A task that has ended.
    pub fn over(title: &'static str, text: String) -> Self {
        Self { title, text, over: true, ..Self::default() }
    }
}

/// An identification or comparison, under way or over.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Study {
    pub title: String,
    /// Progress or outcome, and the values that the data leave open.
    pub text: String,
    /// Heads of the table's columns.
    pub head: Vec<String>,
    pub rows: Vec<Vec<String>>,
    /// Finished fraction \[-\], while the study is under way.
    pub progress: Option<f64>,
    /// Name of the result that the page can open.
    pub result: Option<String>,
    /// File of the result that contains a drawing.
    pub plot: Option<&'static str>,
    /// File of the result that contains the scenario found.
    pub scenario: Option<&'static str>,
    /// Whether the values may be applied to the board.
    pub applies: bool,
    /// Whether the board has the values, which the user may keep, or replace by the former
    /// configuration.
    pub chooses: bool,
    /// Reason why the last order about the study was refused.
    pub refused: Option<String>,
    pub over: bool,
}

impl Study {
    /// A study that ended without a result.
    pub fn failed(title: &str, text: String) -> Self {
        Self { title: title.to_owned(), text, over: true, ..Self::default() }
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Event {
    /// Time in milliseconds since 1970.
    pub at_ms: u64,
    pub weight: Weight,
    pub text: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Weight {
    Plain,
    Refused,
    Fault,
}

impl Event {
    /// An event at the present time.
    pub fn now(weight: Weight, text: String) -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { at_ms: since.as_millis() as u64, weight, text }
    }
}
