//! A board at its start: armed, or venting.

use model_core::link::{Answer, Refusal};
use model_core::{SetPoint, SetPointError};
use thermyo_simulation::board::BoardError;

/// The set point to start with: while faults vent, nothing else is taken, and the telemetry says why.
pub(super) fn if_armed(
    armed: Result<Answer, BoardError>,
    set_point: SetPoint,
) -> Result<SetPoint, BoardError> {
    match armed {
        Ok(_) => Ok(set_point),
        Err(BoardError::Refused(Refusal::SetPoint(SetPointError::Faults(_)))) => Ok(SetPoint::Vent),
        Err(error) => Err(error),
    }
}
