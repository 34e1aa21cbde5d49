//! Digital sensors. Each has a task in the thread that reads it whenever it has converted. Control,
//! which interrupts both, takes the last reading without waiting.

use crate::kind::{Config, MUSCLES, digital};
use crate::source::{STEP, into_step};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Instant, Timer};
use embedded_hal::digital::InputPin;
use embedded_hal_async::i2c::I2c;
use embedded_hal_async::spi::SpiDevice;
use model_core::RawCode;
use sensor_parts::Error;
#[cfg(feature = "joint")]
use sensor_parts::as5600::As5600;
use sensor_parts::max31865::Max31865;
#[cfg(not(feature = "joint"))]
use sensor_parts::mpr::Mpr;

/// Last reading of a sensor chip, from its task to control.
pub struct Part {
    /// The reading, and in the upper half a count of readings; 0 before the first.
    last: AtomicU32,
    enabled: AtomicBool,
    /// Wakes the task when it is enabled. A disabled task waits without a timer, whose interrupt
    /// could delay control.
    wake: Signal<CriticalSectionRawMutex, ()>,
}

impl Part {
    const fn new() -> Self {
        Self { last: AtomicU32::new(0), enabled: AtomicBool::new(false), wake: Signal::new() }
    }

    /// Stores a reading of up to 15 bits; 0 if a sensor of pressure or gas is broken.
    fn put(&self, reading: u16) {
        let count = (self.last.load(Ordering::Relaxed) >> 16).wrapping_add(1);
        self.last.store(count << 16 | u32::from(reading), Ordering::Relaxed);
    }

    /// Returns the code for a step; `seen` is the reading of the step before.
    pub fn code(&self, seen: &mut u32, paused: bool) -> RawCode {
        let (reading, fresh) = self.last(seen, paused);
        RawCode::of_part(reading, fresh)
    }

    /// Returns the reading that has come since the step before.
    #[cfg(feature = "joint")]
    pub fn fresh(&self, seen: &mut u32, paused: bool) -> Option<u16> {
        let (reading, fresh) = self.last(seen, paused);
        fresh.then_some(reading)
    }

    /// The last reading, and whether it has come since the step before. While its task is paused,
    /// it counts as new in every step: a missing reading is then no fault.
    fn last(&self, seen: &mut u32, paused: bool) -> (u16, bool) {
        let last = self.last.load(Ordering::Relaxed);
        let fresh = core::mem::replace(seen, last) != last || (paused && last != 0);
        (last as u16, fresh)
    }

    fn enable(&self, enabled: bool) {
        self.enabled.store(enabled, Ordering::Relaxed);
        if enabled {
            self.wake.signal(());
        }
    }

    fn is_enabled(&self) -> bool {
        self.enabled.load(Ordering::Relaxed)
    }
}

pub struct Parts {
    /// Gas sensor of each muscle.
    pub gas: [Part; MUSCLES],
    /// Pressure sensor of one muscle, or angle sensor of a joint.
    pub on_i2c: Part,
}

/// Readings seen in the step before.
#[derive(Default)]
pub struct Seen {
    pub gas: [u32; MUSCLES],
    pub on_i2c: u32,
    #[cfg(feature = "joint")]
    pub encoder: model_core::joint::encoder::Encoder,
}

impl Parts {
    pub const fn new() -> Self {
        Self { gas: [const { Part::new() }; MUSCLES], on_i2c: Part::new() }
    }

    /// Enables the configured sensors and disables the others.
    pub fn enable(&self, config: &Config) {
        let (gas, on_i2c) = digital(config);
        self.gas.iter().zip(gas).for_each(|(part, digital)| part.enable(digital));
        self.on_i2c.enable(on_i2c);
    }
}

/// Waits for the middle of a step, when control is done.
async fn middle_of_a_step() {
    let now = Instant::now();
    let into = into_step(now);
    let middle = STEP / 2;
    let start = now - into;
    Timer::at(if into < middle { start + middle } else { start + middle + STEP }).await;
}

/// Steps without a reading after which the MAX31865 is restarted: two conversions, or the first
/// one.
const GAS_PATIENCE: u32 = 70;

/// Reads the MAX31865 while it is enabled.
pub async fn read_gas<S: SpiDevice, P: InputPin>(bus: S, mut ready: P, part: &Part) -> ! {
    let mut chip = Max31865::new(bus);
    let mut quiet = GAS_PATIENCE;
    // DRDY must rise in between: while it stays low there is no new reading.
    let mut was_high = false;
    loop {
        if !part.is_enabled() {
            quiet = GAS_PATIENCE;
            part.wake.wait().await;
            continue;
        }
        middle_of_a_step().await;
        if quiet >= GAS_PATIENCE {
            quiet = 0;
            // A missing chip gives no readings, which the core detects.
            let _ = chip.start().await;
            // DRDY rises if it waits for an old reading, and stays low if it is stuck.
            let _ = chip.read().await;
            was_high = false;
        }
        quiet += 1;
        let low = ready.is_low().unwrap_or(false);
        if low && was_high {
            match chip.read().await {
                Ok(reading) => {
                    part.put(reading);
                    quiet = 0;
                }
                Err(Error::Broken) => {
                    part.put(0);
                    quiet = 0;
                }
                Err(_) => quiet = GAS_PATIENCE,
            }
        }
        was_high = !low;
    }
}

/// Steps for which the MPR may stay busy.
#[cfg(not(feature = "joint"))]
const PRESSURE_PATIENCE: u32 = 10;

/// Reads the MPR while it is enabled.
#[cfg(not(feature = "joint"))]
pub async fn read_i2c<I: I2c>(bus: I, part: &Part) -> ! {
    let mut chip = Mpr::new(bus);
    loop {
        if !part.is_enabled() {
            part.wake.wait().await;
            continue;
        }
        middle_of_a_step().await;
        if chip.start().await.is_err() {
            continue;
        }
        Timer::after_millis(4).await;
        for _ in 0..PRESSURE_PATIENCE {
            middle_of_a_step().await;
            match chip.read().await {
                Ok(None) => continue,
                // 24 bits, rounded to 15.
                Ok(Some(output)) => part.put(((output + 0x100) >> 9).min(0x7fff) as u16),
                Err(Error::Broken) => part.put(0),
                Err(_) => (),
            }
            break;
        }
    }
}

/// Reads the AS5600 while it is enabled, once in every step.
#[cfg(feature = "joint")]
pub async fn read_i2c<I: I2c>(bus: I, part: &Part) -> ! {
    let mut chip = As5600::new(bus);
    let mut started = false;
    loop {
        if !part.is_enabled() {
            started = false;
            part.wake.wait().await;
            continue;
        }
        middle_of_a_step().await;
        // A chip that has not answered may have lost power, and with it its configuration.
        if !started && chip.start().await.is_err() {
            continue;
        }
        started = match chip.read().await {
            Ok(Some(reading)) => {
                part.put(reading);
                true
            }
            // Control notices the missing readings.
            Ok(None) | Err(Error::Broken) => true,
            Err(_) => false,
        };
    }
}
