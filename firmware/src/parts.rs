//! Digital sensors: each has a task in the thread that reads it whenever it has converted. Control, which interrupts
//! both, finds the last reading in place and waits for nothing.

use crate::source::{STEP, into_step};
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Instant, Timer};
use embedded_hal::digital::InputPin;
use embedded_hal_async::i2c::I2c;
use embedded_hal_async::spi::SpiDevice;
use model_core::AdcCode;
use model_core::sensing::Sensors;
use sensor_parts::Error;
use sensor_parts::max31865::Max31865;
use sensor_parts::mpr::Mpr;

/// A part's last reading, from its task to control.
pub struct Part {
    /// The reading, and above it a count of them.
    last: AtomicU32,
    wanted: AtomicBool,
    /// Given when it is wanted: a task that nobody wants waits without a timer, whose interrupt could be in control's way.
    called: Signal<CriticalSectionRawMutex, ()>,
}

impl Part {
    const fn new() -> Self {
        Self { last: AtomicU32::new(0), wanted: AtomicBool::new(false), called: Signal::new() }
    }

    /// A reading of 15 bits; 0 where the part is broken.
    fn tell(&self, reading: u16) {
        let count = (self.last.load(Ordering::Relaxed) >> 16).wrapping_add(1);
        self.last.store(count << 16 | u32::from(reading), Ordering::Relaxed);
    }

    /// Its code for a step; `seen` is what the step before has found.
    pub fn code(&self, seen: &mut u32) -> AdcCode {
        let last = self.last.load(Ordering::Relaxed);
        AdcCode::of_part(last as u16, core::mem::replace(seen, last) != last)
    }

    fn want(&self, wanted: bool) {
        self.wanted.store(wanted, Ordering::Relaxed);
        if wanted {
            self.called.signal(());
        }
    }

    fn is_wanted(&self) -> bool {
        self.wanted.load(Ordering::Relaxed)
    }
}

/// Every part.
pub struct Parts {
    /// The MAX31865.
    pub gas: Part,
    /// The MPR.
    pub pressure: Part,
}

impl Parts {
    /// None of them is read.
    pub const fn new() -> Self {
        Self { gas: Part::new(), pressure: Part::new() }
    }

    /// Those that are configured are read from now on.
    pub fn want(&self, sensors: &Sensors) {
        self.gas.want(sensors.gas_element.is_digital());
        self.pressure.want(sensors.pressure_part.is_digital());
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

/// Steps without a reading after which the MAX31865 is started anew: two of its conversions, or the first one.
const GAS_PATIENCE: u32 = 70;

/// Reads the MAX31865 for ever, while it is wanted.
pub async fn read_gas<S: SpiDevice, P: InputPin>(bus: S, mut ready: P, part: &Part) -> ! {
    let mut chip = Max31865::new(bus);
    let mut quiet = GAS_PATIENCE;
    // A line that stays low says nothing of a next reading.
    let mut was_high = false;
    loop {
        if !part.is_wanted() {
            quiet = GAS_PATIENCE;
            part.called.wait().await;
            continue;
        }
        middle_of_a_step().await;
        if quiet >= GAS_PATIENCE {
            quiet = 0;
            was_high = true;
            // Nobody there: it is silent, which the core knows.
            let _ = chip.start().await;
        }
        quiet += 1;
        let low = ready.is_low().unwrap_or(false);
        if low && was_high {
            match chip.read().await {
                Ok(reading) => {
                    part.tell(reading);
                    quiet = 0;
                }
                Err(Error::Broken) => {
                    part.tell(0);
                    quiet = 0;
                }
                Err(_) => quiet = GAS_PATIENCE,
            }
        }
        was_high = !low;
    }
}

/// Steps for which the MPR may be busy.
const PRESSURE_PATIENCE: u32 = 10;

/// Reads the MPR for ever, while it is wanted.
pub async fn read_pressure<I: I2c>(bus: I, part: &Part) -> ! {
    let mut chip = Mpr::new(bus);
    loop {
        if !part.is_wanted() {
            part.called.wait().await;
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
                // Its 24 bits, rounded to 15.
                Ok(Some(output)) => part.tell(((output + 0x100) >> 9).min(0x7fff) as u16),
                Err(Error::Broken) => part.tell(0),
                Err(_) => (),
            }
            break;
        }
    }
}
