//! SPI and I2C for digital sensors, whose messages fit the peripherals' FIFOs. The task fills the
//! FIFO, sleeps for the time on the wire, and reads the answer. embassy's drivers with interrupts
//! and DMA would take 5 KiB of the image; and here a hanging bus blocks no task.

use embassy_rp::Peri;
use embassy_rp::clocks::clk_sys_freq;
use embassy_rp::gpio::{Level, Output, OutputOpenDrain};
use embassy_rp::i2c::{self, I2c};
use embassy_rp::pac;
use embassy_rp::peripherals::{I2C0, PIN_4, PIN_5};
#[cfg(feature = "joint")]
use embassy_sync::{blocking_mutex::raw::CriticalSectionRawMutex, mutex::Mutex};
use embassy_time::Timer;
use embedded_hal_async::i2c as hal_i2c;
use embedded_hal_async::spi as hal_spi;

/// Depth of the SPI's FIFO \[bytes\].
const SPI_BYTES: usize = 8;
/// Time of a byte at 1 MHz, and margin per message \[us\].
const SPI_BYTE_US: u64 = 8;
const SPI_ROOM_US: u64 = 4;

/// One device on SPI1, at 1 MHz.
pub struct SpiDevice {
    select: Output<'static>,
}

/// Held while a device is selected.
#[cfg(feature = "joint")]
static BUS: Mutex<CriticalSectionRawMutex, ()> = Mutex::new(());

impl SpiDevice {
    pub fn new(select: Output<'static>) -> Self {
        Self { select }
    }
}

impl hal_spi::ErrorType for SpiDevice {
    type Error = hal_spi::ErrorKind;
}

impl hal_spi::SpiDevice for SpiDevice {
    /// Runs one write or transfer in place, of at most [`SPI_BYTES`].
    async fn transaction(
        &mut self,
        operations: &mut [hal_spi::Operation<'_, u8>],
    ) -> Result<(), hal_spi::ErrorKind> {
        use hal_spi::Operation::{TransferInPlace, Write};
        let [operation] = operations else {
            return Err(hal_spi::ErrorKind::Other);
        };
        let out: &[u8] = match operation {
            Write(bytes) => bytes,
            TransferInPlace(bytes) => bytes,
            _ => return Err(hal_spi::ErrorKind::Other),
        };
        if out.len() > SPI_BYTES {
            return Err(hal_spi::ErrorKind::Overrun);
        }
        #[cfg(feature = "joint")]
        let _selected = BUS.lock().await;
        let registers = pac::SPI1;
        self.select.set_low();
        for byte in out {
            registers.dr().write(|data| data.set_data((*byte).into()));
        }
        Timer::after_micros(SPI_BYTE_US * out.len() as u64 + SPI_ROOM_US).await;
        self.select.set_high();
        if let TransferInPlace(bytes) = operation {
            for byte in bytes.iter_mut() {
                *byte = registers.dr().read().data() as u8;
            }
        }
        while registers.sr().read().rne() {
            registers.dr().read();
        }
        Ok(())
    }
}

/// Depth of the I2C's FIFOs of commands and of received bytes.
const I2C_BYTES: usize = 16;
const I2C_HZ: u32 = 400_000;
/// Time of a byte, and of the address with a margin \[us\].
const I2C_BYTE_US: u64 = 24;
const I2C_ROOM_US: u64 = 60;

/// Half-periods per second of the clock that frees the bus: 100 kHz, slow enough for every chip
/// \[Hz\].
const FREES_HZ: u32 = 200_000;

/// Frees a bus whose chip holds SDA low: a restart of the board or a disturbance has interrupted
/// the chip while it sent a byte, and it waits for the remaining clocks.
#[cold]
fn free_i2c(scl: Peri<'_, PIN_5>, sda: Peri<'_, PIN_4>) {
    let wait = || cortex_m::asm::delay(clk_sys_freq() / FREES_HZ);
    let mut scl = OutputOpenDrain::new(scl, Level::High);
    let mut sda = OutputOpenDrain::new(sda, Level::High);
    scl.set_pullup(true);
    sda.set_pullup(true);
    wait();
    // Eight bits and the acknowledge, which no one sends.
    for _ in 0..9 {
        if sda.is_high() {
            return;
        }
        scl.set_low();
        wait();
        scl.set_high();
        wait();
    }
}

/// I2C0, at [`I2C_HZ`].
pub struct I2cBus {
    i2c: Peri<'static, I2C0>,
    scl: Peri<'static, PIN_5>,
    sda: Peri<'static, PIN_4>,
}

impl I2cBus {
    pub fn new(
        i2c: Peri<'static, I2C0>,
        scl: Peri<'static, PIN_5>,
        sda: Peri<'static, PIN_4>,
    ) -> Self {
        let mut bus = Self { i2c, scl, sda };
        bus.set_up();
        bus
    }

    /// Frees the bus and hands it to the peripheral.
    #[cold]
    fn set_up(&mut self) {
        let Self { i2c, scl, sda } = self;
        free_i2c(scl.reborrow(), sda.reborrow());
        let mut config = i2c::Config::default();
        config.frequency = I2C_HZ;
        // Only its setup is used; the messages bypass embassy's driver.
        let _i2c = I2c::new_blocking(i2c.reborrow(), scl.reborrow(), sda.reborrow(), config);
    }
}

impl hal_i2c::ErrorType for I2cBus {
    type Error = hal_i2c::ErrorKind;
}

impl hal_i2c::I2c for I2cBus {
    /// Runs one message of at most [`I2C_BYTES`].
    async fn transaction(
        &mut self,
        address: u8,
        operations: &mut [hal_i2c::Operation<'_>],
    ) -> Result<(), hal_i2c::ErrorKind> {
        let [operation] = operations else {
            return Err(hal_i2c::ErrorKind::Other);
        };
        let (count, write) = match operation {
            hal_i2c::Operation::Write(bytes) => (bytes.len(), Some(*bytes)),
            hal_i2c::Operation::Read(bytes) => (bytes.len(), None),
        };
        if count > I2C_BYTES {
            return Err(hal_i2c::ErrorKind::Overrun);
        }
        let registers = pac::I2C0;
        // Disabling the peripheral discards the rest of an earlier message.
        registers.ic_enable().write(|enable| enable.set_enable(false));
        registers.ic_tar().write(|target| target.set_ic_tar(address.into()));
        registers.ic_clr_intr().read();
        registers.ic_enable().write(|enable| enable.set_enable(true));
        for i in 0..count {
            registers.ic_data_cmd().write(|command| {
                match write {
                    Some(bytes) => command.set_dat(bytes.get(i).copied().unwrap_or(0)),
                    None => command.set_cmd(true),
                }
                command.set_stop(i + 1 == count);
            });
        }
        Timer::after_micros(I2C_BYTE_US * count as u64 + I2C_ROOM_US).await;
        let ended = registers.ic_raw_intr_stat().read();
        if !ended.stop_det() {
            self.set_up();
        }
        if ended.tx_abrt() || !ended.stop_det() {
            return Err(hal_i2c::ErrorKind::NoAcknowledge(hal_i2c::NoAcknowledgeSource::Unknown));
        }
        if let hal_i2c::Operation::Read(bytes) = operation {
            for byte in bytes.iter_mut() {
                *byte = registers.ic_data_cmd().read().dat();
            }
        }
        Ok(())
    }
}
