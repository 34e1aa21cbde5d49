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
#[cfg(any(feature = "pico", feature = "pico2"))]
mod rp_bus;
#[cfg(any(feature = "pico", feature = "pico2"))]
mod rp_flash;

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
use embedded_storage_async::nor_flash::NorFlash;
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
    /// Flash of [`STORE_BYTES`].
    type Flash: NorFlash;
    /// A digital input.
    type Input: InputPin;
    /// A digital output.
    type Output: OutputPin;
    /// What comes from the host.
    type Receiver: Read;
    /// What goes to the host.
    type Sender: Write;

    /// The chip's own USB.
    #[cfg(feature = "usb")]
    type Usb: embassy_usb::driver::Driver<'static>;

    /// Where the MAX31865 is, if there is one: SPI mode 1, 5 MHz at most.
    #[cfg(feature = "parts")]
    type GasBus: embedded_hal_async::spi::SpiDevice;
    /// Where the MPR is, if there is one: I2C, 400 kHz at most.
    #[cfg(feature = "parts")]
    type PressureBus: embedded_hal_async::i2c::I2c;

    /// Called once, first of all. Both coils are without power before anything else happens; the line to
    /// the host runs at [`BAUD`](model_core::link::BAUD), and its interrupt comes before control's, that
    /// of USB after it; the watchdog runs when this returns.
    fn start() -> Parts<Self>;
    /// Starts control's executor in an interrupt with a priority below the line's, whose handler calls
    /// [`on_control_interrupt`](crate::on_control_interrupt).
    fn start_control(executor: &'static InterruptExecutor) -> SendSpawner;
    /// Feeds the watchdog, which restarts the board [`WATCHDOG`] after it was fed last.
    fn feed();
    /// Takes the power from both coils, whoever has the pins: nothing else runs any more.
    fn vent();
    /// Whether a reset of the bus waits to be seen by the driver of [`Self::Usb`].
    #[cfg(feature = "usb")]
    fn usb_reset_waits() -> bool;
    /// Restarts the board; it then finds [`Reset::Forced`].
    fn restart() -> !;
    /// Restarts it into the chip's boot loader, which takes another image; `None` where there is none.
    const BOOT_LOADER: Option<fn() -> !>;
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
    /// Where the board keeps what survives the loss of power, if it has such a place.
    pub flash: Option<B::Flash>,
    /// The LED, on while high.
    pub led: B::Output,
    /// High while a fault holds or is latched.
    pub fault_output: B::Output,
    /// What comes from the host.
    pub receiver: B::Receiver,
    /// What goes to the host.
    pub sender: B::Sender,
    /// The chip's own USB, and what tells this board from all others.
    #[cfg(feature = "usb")]
    pub usb: (B::Usb, [u8; 8]),
    /// Where the MAX31865 is, and its DRDY, pulled up.
    #[cfg(feature = "parts")]
    pub gas_bus: (B::GasBus, B::Input),
    /// Where the MPR is.
    #[cfg(feature = "parts")]
    pub pressure_bus: B::PressureBus,
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
    /// Holds back interrupts that come before control's, where what causes them has room for 100 us: from
    /// shortly before a step is due until its conversions are done.
    fn hold_others(&mut self, _held: bool) {}
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

/// Flash in which the board keeps what survives the loss of power: four sectors.
pub const STORE_BYTES: usize = 4 * 4096;

/// The watchdog restarts the board after this time without food.
pub const WATCHDOG: Duration = Duration::from_millis(50);
