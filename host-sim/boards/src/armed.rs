use model_core::{SetPoint, SetPointError};
use thermyo_protocol::{Answer, Refusal};
use thermyo_simulation::board::BoardError;

/// Returns the set point of the first step. While a fault vents, only `Vent` is accepted; the
/// telemetry states the reason.
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
