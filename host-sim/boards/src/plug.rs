//! Plugs in the emulated board, if no other program has an earlier one open.

use super::image::Variant;
use super::line::Line;
use super::{port, service};
use std::path::Path;
use thermyo_setup::Loaded;
use thermyo_simulation::board::BoardError;

/// Plugs in a board with an image and the muscle or joint of a scenario file, replacing an earlier one.
///
/// # Errors
/// [`BoardError::Taken`] for an earlier one that another program has open; other errors if the board does not start.
pub fn plug(image: Variant, scenario: Option<&Path>) -> Result<(), BoardError> {
    let _alone = service::alone()?;
    refuse_taken()?;
    service::plug(image, scenario).map(drop)
}

/// Plugs in a board that runs in a thread of this process, with the muscle of a scenario, replacing
/// an earlier one: for programs that cannot be started again as the board's process.
///
/// # Errors
/// As [`plug`].
pub fn plug_into_this_process(loaded: Loaded) -> Result<(), BoardError> {
    let _alone = service::alone()?;
    refuse_taken()?;
    service::plug_into_this_process(loaded)
}

fn refuse_taken() -> Result<(), BoardError> {
    let open = || service::plugged_in().ok_or(BoardError::Silent { asked: "a connection" });
    match Line::meet_by(port::EMULATED, || Ok(Box::new(open()?))) {
        Err(taken @ BoardError::Taken { .. }) => Err(taken),
        _ => Ok(()),
    }
}
