//! One muscle or a joint, as the page has it.

use super::{NotDone, Operator};
use crate::page::Kind;
use crate::shared::Shared;
use crate::state::{self, Part};
use crate::target::Target;
use crate::word::{Order, ScenarioText};
use model_core::safety::supervisor::VENTING;
use model_core::{Config, Faults};
use serde::Serialize;
use std::io;
use thermyo_boards::subject::Subject;
use thermyo_files::input::InputError;
use thermyo_logs::topics::Layout;
use thermyo_protocol::{Status, Timing};
use thermyo_record::board_trace::Recorder;

/// Faults of a muscle, of a second one, and of their joint.
pub type Held = [Faults; 3];

/// Faults that vent.
pub(super) const VENTS: Faults =
    VENTING.with(Faults::JOINT_ANGLE).with(Faults::JOINT_WRONG_WAY).with(Faults::JOINT_TORQUE);

/// A board of one muscle or of a joint. What both have is the operator's.
pub trait Served: Subject<SetPoint: Serialize> {
    /// Tasks that only this board's page offers.
    type Tasks: Tasks;
    type Record: Record<Self>;
    /// A step as the page gets it.
    type Row: Serialize + Send;
    /// Whether the estimate of each gas temperature is to be relied on.
    type Valid: Serialize;

    const KIND: Kind;
    /// A sentence: what vents, vents.
    const VENTS: &'static str;

    /// Configurations of the muscles.
    fn muscles(config: &Self::Config) -> &[Config];

    /// The part of the page's configuration that only this kind of board has.
    fn part(config: &Self::Config) -> Part;

    /// Configuration to send, and its name; without a text, that of the emulated board's own.
    ///
    /// # Errors
    /// For a text that is no scenario of this kind, and for a port, whose own is unknown.
    fn configuration(
        target: &Target,
        text: Option<ScenarioText>,
    ) -> Result<(Self::Config, String), NotDone>;

    /// Name of what an emulated board has at its pins, if it is known.
    fn own(target: &Target) -> Option<String>;

    /// The set point that an order asks for.
    fn asked(order: &Order) -> Option<Self::SetPoint>;

    /// A set point in words.
    fn words(set_point: Self::SetPoint) -> String;

    /// A refusal in words.
    fn refusal(refused: &NotDone) -> String {
        refused.to_string()
    }

    fn set_point(telemetry: &Self::Telemetry) -> Self::SetPoint;

    fn faults(telemetry: &Self::Telemetry) -> Held;

    /// Names of faults, each with its place.
    fn names(held: Held) -> Vec<String>;

    fn mode(telemetry: &Self::Telemetry) -> &'static str;

    fn is_limited(telemetry: &Self::Telemetry) -> bool;

    fn valid(telemetry: &Self::Telemetry) -> Self::Valid;

    /// The row of a step at a time \[s\].
    fn row(time_s: f64, config: &Self::Config, telemetry: &Self::Telemetry) -> Self::Row;

    /// Carries out an order that not every board has.
    ///
    /// # Errors
    /// `NotDone`, also for an order that this board does not have.
    fn attempt(
        operator: &mut Operator<Self>,
        order: Order,
        wanted: &dyn Fn() -> bool,
    ) -> Result<(), NotDone>;

    /// Takes every step.
    fn see(_operator: &mut Operator<Self>, _telemetry: &Self::Telemetry) {}
}

/// Tasks that only the page of one kind of board offers.
pub trait Tasks: Default + Send {
    /// The board vents.
    fn vented(&mut self) {}

    /// The board has its former configuration again.
    fn went_back(&mut self) {}

    /// The server ends.
    fn end(&mut self) {}

    /// The guided task and the study, as the page shows them.
    fn shown(&mut self, _shared: &Shared) -> (Option<state::Guide>, Option<state::Study>) {
        (None, None)
    }
}

impl Tasks for () {}

/// The files of a record, beside the recorder of its rows.
pub trait Record<S: Subject>: Sized + Send + 'static {
    /// Name of the file of rows.
    const TRACE: &'static str;
    /// Columns of the record.
    const LAYOUT: Layout;
    /// Whether the page can identify from it, and compare it.
    const STUDIED: bool;

    /// # Errors
    /// If no scenario expresses the configuration.
    fn new(config: &S::Config) -> Result<Self, InputError>;

    /// The scenario that gives the configuration.
    fn scenario(&self) -> String;

    /// Writes a row.
    ///
    /// # Errors
    /// Of the file.
    fn write(
        &mut self,
        recorder: &mut Recorder,
        status: Option<&Status>,
        telemetry: &S::Telemetry,
    ) -> io::Result<()>;

    /// The end of a record of that name at a port.
    fn finish(self, of: (&str, &str), status: &Status, timing: &Timing) -> Finished;
}

/// Texts and figures of a whole record.
pub struct Finished {
    pub duration_s: f64,
    pub lost_steps: u64,
    /// `scenario.toml`, `summary.json` and `report.html`.
    pub scenario: String,
    pub summary: String,
    pub report: String,
}
