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
pub const STEP: Duration = Duration::from_micros(STEP_US as u64);
/// The same \[us\].
pub const STEP_US: u32 = 1000;

/// How far into a step a time is. In 32 bits: a division of 64 takes a kilobyte of flash.
pub fn into_step(time: Instant) -> Duration {
    let us = time.as_micros();
    let (high, low) = ((us >> 32) as u32, us as u32);
    // 2^32 us are some steps and this.
    const REST_US: u32 = (u32::MAX % STEP_US + 1) % STEP_US;
    let rest_us = high % STEP_US * REST_US + low % STEP_US;
    Duration::from_micros((rest_us % STEP_US).into())
}

/// Where samples come from.
pub trait Source {
    /// Waits until the next step is due and returns when that was, and how many steps were left out
    /// since the one before; `None` when the wait was long and nothing is due.
    async fn due(&mut self) -> Option<(Instant, u32)>;
    /// The inputs of the step that is due, of these sensors.
    fn sample(&mut self, sensors: &Sensors) -> Sample;
}
