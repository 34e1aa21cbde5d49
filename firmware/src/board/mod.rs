//! The border between the firmware and the boards: what a board gives is here, each board is a folder
//! below, and nothing else knows a chip.
//!
//! A board is chosen by the feature with the name of its folder. The folder has `mod.rs`, which
//! implements [`Board`], and `board.x`, its part of the linker script. `README.md` says how to add one.

// With samples from the host nobody reads the converter.
#![cfg_attr(feature = "hil", allow(dead_code))]

#[cfg(feature = "nucleo-g474re")]
mod nucleo_g474re;
#[cfg(feature = "pico")]
mod pico;
#[cfg(feature = "pico2")]
mod pico2;
#[cfg(any(feature = "pico", feature = "pico2"))]
mod rp;

#[cfg(feature = "nucleo-g474re")]
pub use nucleo_g474re::NucleoG474re as Chosen;
#[cfg(feature = "pico")]
pub use pico::Pico as Chosen;
#[cfg(feature = "pico2")]
pub use pico2::Pico2 as Chosen;

use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_time::Duration;
use embedded_hal::digital::{InputPin, OutputPin};
use embedded_io_async::{Read, Write};
use model_core::Command;
use model_core::link::Chip;

/// A board.
pub trait Board: Sized {
    /// Its chip.
    const CHIP: Chip;
    /// Longest PWM period, in steps.
    fn maximum_period_steps() -> u16;

    /// The analog inputs.
    type Adc: Adc;
    /// Both valves.
    type Valves: Valves;
    /// The watchdog.
    type Watchdog: Watchdog;
    /// A digital input.
    type Input: InputPin;
    /// A digital output.
    type Output: OutputPin;
    /// What comes from the host.
    type Receiver: Read;
    /// What goes to the host.
    type Sender: Write;

    /// Called once, first of all. Both coils are without power before anything else happens; the line to
    /// the host runs at [`BAUD`](model_core::link::BAUD), and its interrupt comes before control's; the
    /// watchdog runs when this returns.
    fn start() -> Parts<Self>;
    /// Starts control's executor in an interrupt with a priority below the line's, whose handler calls
    /// [`on_control_interrupt`](crate::on_control_interrupt).
    fn start_control(executor: &'static InterruptExecutor) -> SendSpawner;
    /// Takes the power from both coils, whoever has the pins: nothing else runs any more.
    fn vent();
    /// Restarts the board; it then finds [`Reset::Forced`].
    fn restart() -> !;
}

/// What a board hands over at the start.
pub struct Parts<B: Board> {
    /// Why the board started.
    pub reset: Reset,
    /// The analog inputs.
    pub adc: B::Adc,
    /// Pulled down: high while the emergency stop is not pressed and its wire not broken.
    pub run_line: B::Input,
    /// Both valves, closed for the inlet and open for the outlet.
    pub valves: B::Valves,
    /// The watchdog, fed a moment ago.
    pub watchdog: B::Watchdog,
    /// The LED, on while high.
    pub led: B::Output,
    /// High while a fault holds or is latched.
    pub fault_output: B::Output,
    /// What comes from the host.
    pub receiver: B::Receiver,
    /// What goes to the host.
    pub sender: B::Sender,
}

/// Why a board started.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Reset {
    /// Power came, or somebody pressed a button.
    Power,
    /// The watchdog was not fed.
    TimedOut,
    /// [`Board::restart`].
    Forced,
}

/// Analog inputs.
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

/// Restarts the board when it is not fed.
pub trait Watchdog {
    /// Not before [`WATCHDOG`] from now.
    fn feed(&mut self);
}

/// The watchdog restarts the board after this time without food.
pub const WATCHDOG: Duration = Duration::from_millis(50);
