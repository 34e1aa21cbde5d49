//! What outlives the power: a configuration, and what happened. An image without a place for it keeps nothing
//! but what the black box has.

use crate::link::Identity;
use crate::shared::Shared;
use model_core::Config;
use model_core::link::{Event, Name, Refusal};

/// Keeps a configuration and its name over the loss of power.
pub async fn save(_: &Config, _: &Name) -> Result<(), Refusal> {
    Err(Refusal::NoStore)
}

/// Forgets what was saved.
pub async fn forget() -> Result<(), Refusal> {
    Err(Refusal::NoStore)
}

/// What happened, the last event first: the one of this number.
pub fn event(number: u8, identity: &Identity, shared: &Shared) -> Option<Event> {
    let vented = shared.first_failure().map(Event::Vented);
    let started = Some(Event::Started(identity.last_reset));
    [vented, started].into_iter().flatten().nth(usize::from(number))
}
