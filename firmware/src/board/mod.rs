//! Interface between the firmware and the boards. Each board is a folder below; no other code
//! depends on a chip.
//!
//! A board is chosen by the feature with the name of its folder. The folder has `mod.rs`, which
//! implements [`Board`], and `board.x`, its part of the linker script. `README.md` shows how to add
//! one.

// With samples from the host the converter is not read.
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

use crate::kind::Commands;
use embassy_executor::{InterruptExecutor, SendSpawner};
use embassy_time::Duration;
use embedded_hal::digital::{InputPin, OutputPin};
use embedded_io_async::{Read, Write};
use embedded_storage_async::nor_flash::NorFlash;
use model_core::Config;
use model_core::physics::valve::ValveKind;
use thermyo_protocol::Chip;

pub trait Board: Sized {
    const CHIP: Chip;
    fn maximum_period_steps() -> u16;

    type Adc: Adc;
    type Valves: Valves;
    /// Flash of [`STORE_BYTES`].
    type Flash: NorFlash;
    type Input: InputPin;
    type Output: OutputPin;
    type Receiver: Read;
    type Sender: Write;

    #[cfg(feature = "usb")]
    type Usb: embassy_usb::driver::Driver<'static>;

    /// SPI of a MAX31865: mode 1, at most 5 MHz.
    type GasBus: embedded_hal_async::spi::SpiDevice;
    /// I2C of an MPR, or of a joint's AS5600: at most 400 kHz.
    type I2c: embedded_hal_async::i2c::I2c;

    /// Called once, before everything else. It first removes the power from all coils. The serial
    /// line runs at [`BAUD`](thermyo_protocol::BAUD); its interrupt has a higher priority than
    /// control's, and the USB interrupt a lower one. The watchdog runs when this returns.
    fn start() -> Parts<Self>;
    /// Starts control's executor in an interrupt below the serial line's priority, whose handler
    /// calls [`on_control_interrupt`](crate::on_control_interrupt).
    fn start_control(executor: &'static InterruptExecutor) -> SendSpawner;
    /// Feeds the watchdog, which restarts the board unless fed within [`WATCHDOG`].
    fn feed();
    /// Removes the power from all coils, whichever code owns the pins. Must be called only when no
    /// other code runs.
    fn vent();
    /// Whether a bus reset waits to be handled by the driver of [`Self::Usb`].
    #[cfg(feature = "usb")]
    fn usb_reset_waits() -> bool;
    /// Restarts the board, with [`Reset::Forced`] as the cause.
    fn restart() -> !;
    /// Restarts the board into the chip's boot loader, which accepts another image, if there is
    /// one.
    const BOOT_LOADER: Option<fn() -> !>;
}

/// Peripherals that a board hands over at the start.
pub struct Parts<B: Board> {
    pub reset: Reset,
    pub adc: B::Adc,
    /// The run line, pulled down: high while the emergency stop is not pressed and its wire is
    /// intact.
    pub run_line: B::Input,
    /// All valves, closed for an inlet and open for an outlet.
    pub valves: B::Valves,
    /// Flash of the nonvolatile store, if the board has one.
    pub flash: Option<B::Flash>,
    /// LED, lit while the pin is high.
    pub led: B::Output,
    /// High while a fault is present or latched.
    pub fault_output: B::Output,
    /// High while a joint moves, if the board drives one: its brake is released.
    pub brake_release: Option<B::Output>,
    pub receiver: B::Receiver,
    pub sender: B::Sender,
    /// The chip's own USB, and the unique number of this board.
    #[cfg(feature = "usb")]
    pub usb: (B::Usb, [u8; 8]),
    /// SPI of each muscle's MAX31865, and its DRDY, pulled up.
    pub gas_buses: [(B::GasBus, B::Input); crate::kind::MUSCLES],
    pub i2c: B::I2c,
}

/// Reason why a board started.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Reset {
    /// Power came, or the reset button was pressed.
    Power,
    /// The watchdog was not fed.
    TimedOut,
    /// [`Board::restart`].
    Forced,
}

/// Inputs of the converter: pressure, gas and length of one muscle, or the pressures of a joint's muscles
/// a and b and its angle.
#[derive(Clone, Copy)]
pub enum Channel {
    Adc0,
    Adc1,
    Adc2,
}

/// A converter of 12 bits.
pub trait Adc {
    /// Runs one conversion, 0 to 4095. It blocks for about two microseconds; the watchdog ends a
    /// longer wait.
    fn convert(&mut self, channel: Channel) -> u16;
    /// Masks interrupts above control's priority whose peripherals can wait for 100 us, from
    /// shortly before a step is due until its conversions are done.
    fn hold_others(&mut self, _held: bool) {}
}

/// PWM of all valves. One call sets all duties, so that they change together; `embedded-hal`'s
/// `SetDutyCycle` sets one channel at a time.
pub trait Valves {
    /// Starts another modulation with these duties; a period of pulses starts
    /// [`PWM_DELAY`](crate::kind::PWM_DELAY) from now.
    fn restart(&mut self, modulation: Modulation, commands: Commands);
    /// Sets the duties from the next period on; [`Command::VENT`](model_core::Command::VENT) acts at
    /// once and cuts a pulse.
    fn drive(&mut self, commands: Commands);
}

/// Modulation of the pins by the duties.
#[derive(Clone, Copy)]
pub enum Modulation {
    /// Pulses for switching valves, one in each period of `period_steps`.
    Pulses { period_steps: u16 },
    /// A carrier whose mean, behind a filter, is the command of a proportional valve.
    Carrier,
}

impl Modulation {
    pub fn of(config: &Config) -> Self {
        match config.valve_kind {
            ValveKind::Switching => Self::Pulses { period_steps: config.pwm_period_steps },
            ValveKind::Proportional(_) => Self::Carrier,
        }
    }
}

/// Frequency of the carrier: above hearing, and a hundred times what filter and valve can follow
/// \[Hz\].
pub const CARRIER_HZ: u32 = 25_000;

/// Size of the nonvolatile store: four sectors.
pub const STORE_BYTES: usize = 4 * 4096;

/// The watchdog restarts the board unless fed within this time.
pub const WATCHDOG: Duration = Duration::from_millis(50);
