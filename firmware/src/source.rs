//! Where samples come from, and when.

use crate::board::{Adc, Channel};
use embassy_time::{Duration, Instant, Timer};
use embedded_hal::digital::InputPin;
use model_core::sample::OVERSAMPLING;
use model_core::{AdcCode, Sample};

/// Step of the board.
pub const STEP: Duration = Duration::from_millis(1);

/// Where samples come from.
pub trait Source {
    /// Waits until the next step is due and returns when that was, and how many steps were left out
    /// since the one before; `None` when the wait was long and nothing is due.
    async fn due(&mut self) -> Option<(Instant, u32)>;
    /// The inputs of the step that is due.
    fn sample(&mut self) -> Sample;
}

/// The board's own inputs, at every whole millisecond.
pub struct Inputs<A, P> {
    adc: A,
    run_line: P,
    due: Instant,
}

impl<A: Adc, P: InputPin> Inputs<A, P> {
    /// `run_line` is high while the emergency stop is not pressed and its wire not broken.
    pub fn new(adc: A, run_line: P) -> Self {
        let now_ms = Instant::now().as_millis();
        Self { adc, run_line, due: Instant::from_millis(now_ms + 1) }
    }

    /// A sum of conversions: averaging costs no division, and the core knows the sum's scale.
    fn code(&mut self, channel: Channel) -> AdcCode {
        let mut sum = 0_u16;
        for _ in 0..OVERSAMPLING {
            sum = sum.wrapping_add(self.adc.convert(channel));
        }
        AdcCode(sum)
    }
}

impl<A: Adc, P: InputPin> Source for Inputs<A, P> {
    async fn due(&mut self) -> Option<(Instant, u32)> {
        let mut missed = 0;
        let now = Instant::now();
        while self.due + STEP <= now {
            self.due += STEP;
            missed += 1;
        }
        Timer::at(self.due).await;
        let due = self.due;
        self.due += STEP;
        Some((due, missed))
    }

    fn sample(&mut self) -> Sample {
        Sample {
            pressure: self.code(Channel::Pressure),
            gas: self.code(Channel::Gas),
            length: self.code(Channel::Length),
            // A line that cannot be read is a line that is open.
            emergency_stop: !self.run_line.is_high().unwrap_or(false),
        }
    }
}

/// The host's samples, one step for each.
#[cfg(feature = "hil")]
pub struct Host {
    shared: &'static crate::shared::Shared,
    sample: Sample,
}

#[cfg(feature = "hil")]
impl Host {
    /// Samples that the link leaves in `shared`.
    pub fn new(shared: &'static crate::shared::Shared) -> Self {
        Self { shared, sample: Sample::default() }
    }
}

#[cfg(feature = "hil")]
impl Source for Host {
    async fn due(&mut self) -> Option<(Instant, u32)> {
        let wait = Duration::from_millis(20);
        self.sample = embassy_time::with_timeout(wait, self.shared.samples.receive()).await.ok()?;
        Some((Instant::now(), 0))
    }

    fn sample(&mut self) -> Sample {
        self.sample
    }
}
