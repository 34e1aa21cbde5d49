//! The board's own inputs, at every whole millisecond.

use super::{STEP, Source};
use crate::board::{Adc, Channel};
use embassy_time::{Duration, Instant, Timer};
use embedded_hal::digital::InputPin;
use model_core::sample::OVERSAMPLING;
use model_core::{AdcCode, Sample};

/// The timer is set this much ahead, and the rest is waited for in place: the way from the timer's
/// interrupt to the task takes some 14 us, and the line's interrupt may come in between.
const LEAD: Duration = Duration::from_micros(30);

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
        let due = self.due;
        Timer::at(due - LEAD).await;
        while Instant::now() < due {}
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
