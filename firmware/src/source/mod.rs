//! Where samples come from, and when.

#[cfg(feature = "hil")]
mod host;
#[cfg(not(feature = "hil"))]
mod inputs;

#[cfg(feature = "hil")]
pub use host::Host;
#[cfg(not(feature = "hil"))]
pub use inputs::Inputs;

use embassy_time::{Duration, Instant};
use model_core::Sample;
use model_core::sensing::Sensors;

/// Step of the board.
pub const STEP: Duration = Duration::from_millis(1);

/// Where samples come from.
pub trait Source {
    /// Waits until the next step is due and returns when that was, and how many steps were left out
    /// since the one before; `None` when the wait was long and nothing is due.
    async fn due(&mut self) -> Option<(Instant, u32)>;
    /// The inputs of the step that is due, of these sensors.
    fn sample(&mut self, sensors: &Sensors) -> Sample;
}
