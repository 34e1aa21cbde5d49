//! Sources of samples and their timing.

#[cfg(feature = "hil")]
mod host;
#[cfg(not(feature = "hil"))]
mod inputs;

#[cfg(feature = "hil")]
pub use host::Host;
#[cfg(not(feature = "hil"))]
pub use inputs::Inputs;

use crate::kind::{Config, Sample};
use embassy_time::{Duration, Instant};

pub const STEP: Duration = Duration::from_micros(STEP_US as u64);
pub const STEP_US: u32 = 1000;

/// Time since the last step was due. In 32 bits, because a 64-bit division takes a kilobyte of
/// flash.
pub fn into_step(time: Instant) -> Duration {
    let us = time.as_micros();
    let (high, low) = ((us >> 32) as u32, us as u32);
    // Remainder of 2^32 us.
    const REST_US: u32 = (u32::MAX % STEP_US + 1) % STEP_US;
    let rest_us = high % STEP_US * REST_US + low % STEP_US;
    Duration::from_micros((rest_us % STEP_US).into())
}

pub trait Source {
    /// Waits until the next step is due. Returns that time and the number of steps left out before
    /// it, or `None` after a long wait without a step.
    async fn due(&mut self) -> Option<(Instant, u32)>;
    /// Samples the sensors of this configuration for the step that is due.
    fn sample(&mut self, config: &Config) -> Sample;
}
