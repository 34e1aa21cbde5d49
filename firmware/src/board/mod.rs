//! The border between the firmware and the chip: small traits here, one file per family of chips.
//!
//! Another chip means another file beside `rp.rs` that gives these traits, an `embedded-io` serial
//! port, `embedded-hal` pins and the tasks' start. Nothing else changes.

#[cfg(feature = "pico")]
mod float_calls;
mod rp;

use embassy_time::Duration;
use model_core::link::Phase;
use model_core::safety::supervisor::FirstFailure;
use model_core::{Command, Faults};

/// Analog inputs.
#[cfg(not(feature = "hil"))]
#[derive(Clone, Copy)]
pub enum Channel {
    /// Muscle pressure.
    Pressure,
    /// Pt1000 in the gas.
    Gas,
    /// Muscle length.
    Length,
}

/// A converter of 12 bits.
#[cfg(not(feature = "hil"))]
pub trait Adc {
    /// One conversion, 0 to 4095. It blocks for the two microseconds that this takes; the watchdog
    /// ends a longer wait.
    fn convert(&mut self, channel: Channel) -> u16;
}

/// Both valves' PWM. One call sets both, so that they change together; `embedded-hal`'s
/// `SetDutyCycle` has one channel at a time.
pub trait Valves {
    /// Another period begins [`PWM_DELAY`] from now, with these openings.
    fn restart(&mut self, period_steps: u16, command: Command);
    /// Openings from the next period on; [`Command::VENT`] at once, a pulse that is under way is cut.
    fn drive(&mut self, command: Command);
}

/// A PWM period begins this much after the valves were driven in the step that starts it: later
/// steps of the same kind may take longer and must not miss the period's begin.
pub const PWM_DELAY: Duration = Duration::from_micros(250);

/// Remembers over a restart what control was doing.
pub trait BlackBox {
    /// Control enters a phase.
    fn note(&mut self, phase: Phase);
    /// What vented first, and what is latched now.
    fn record(&mut self, first: Option<FirstFailure>, latched: Faults);
}

/// Restarts the board when it is not fed.
pub trait Watchdog {
    /// Not before this time from now.
    fn feed(&mut self, timeout: Duration);
}
