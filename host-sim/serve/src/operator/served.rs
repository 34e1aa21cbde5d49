//! One muscle or a joint behind a page.

use super::{NotDone, Operator};
use crate::frames::Shown;
use crate::page::Kind;
use crate::shared::Shared;
use crate::state::{self, Part};
use crate::target::Target;
use crate::word::{Order, ScenarioText};
use model_core::Faults;
use model_core::safety::supervisor::VENTING;
use thermyo_studies::drive::Record;

/// Faults of a muscle, of a second one, and of their joint.
pub type Held = [Faults; 3];

pub(super) const VENTS: Faults =
    VENTING.with(Faults::JOINT_ANGLE).with(Faults::JOINT_WRONG_WAY).with(Faults::JOINT_TORQUE);

/// A board of one muscle or of a joint. Parts common to both are the operator's.
pub trait Served: Shown {
    /// Tasks that only this board's page offers.
    type Tasks: Tasks;
    type Record: Record<Board = Self>;

    const KIND: Kind;
    /// A sentence that names what vents.
    const VENTS: &'static str;

    /// The part of the page's configuration that only this kind of board has.
    fn part(config: &Self::Config) -> Part;

    /// Configuration to send, and its name; without a text, the emulated board's own.
    ///
    /// # Errors
    /// For a text that is no scenario of this kind, and for a port, whose own configuration is
    /// unknown.
    fn configuration(
        target: &Target,
        text: Option<ScenarioText>,
    ) -> Result<(Self::Config, String), NotDone>;

    /// Name of the muscle or joint at an emulated board's pins, if known.
    fn own(target: &Target) -> Option<String>;

    fn asked(order: &Order) -> Option<Self::SetPoint>;

    /// A set point in words.
    fn words(set_point: Self::SetPoint) -> String;

    /// A refusal in words.
    fn refusal(refused: &NotDone) -> String {
        refused.to_string()
    }

    fn faults(telemetry: &Self::Telemetry) -> Held;

    fn names(held: Held) -> Vec<String>;

    /// Carries out an order that not every board has.
    ///
    /// # Errors
    /// `NotDone`, also for an order that this board does not have.
    fn attempt(
        operator: &mut Operator<Self>,
        order: Order,
        wanted: &dyn Fn() -> bool,
    ) -> Result<(), NotDone>;

    /// Receives every step.
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
