//! The board's own inputs, at every whole millisecond.

use super::{STEP, Source, into_step};
use crate::board::{Adc, Channel};
use crate::kind::{self, Config, Sample};
use crate::shared::Shared;
use core::sync::atomic::Ordering;
use embassy_time::{Duration, Instant, Timer};
use embedded_hal::digital::InputPin;
use model_core::AdcCode;
use model_core::sample::OVERSAMPLING;

/// Lead with which the timer is set; the task polls for the rest. The timer's interrupt takes some
/// 9 us to reach the task on an RP2040, and the serial interrupt may delay it, so that one is masked
/// while polling.
const LEAD: Duration = Duration::from_micros(20);

pub struct Inputs<A, P> {
    adc: A,
    run_line: P,
    /// Time of the next step. It is first set when a step is requested, since the start takes time.
    due: Option<Instant>,
    /// Steps left out since the last step; a field, because an order may end a wait early.
    missed: u32,
    /// Last readings of digital sensors.
    seen: crate::parts::Seen,
    shared: &'static Shared,
}

impl<A: Adc, P: InputPin> Inputs<A, P> {
    /// Creates the source; `run_line` is high while the emergency stop is not pressed and its wire
    /// is intact.
    pub fn new(adc: A, run_line: P, shared: &'static Shared) -> Self {
        Self { adc, run_line, due: None, missed: 0, seen: crate::parts::Seen::default(), shared }
    }

    /// Returns the sum of conversions. The core scales the sum, which saves a division.
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
        let now = Instant::now();
        let mut due = match self.due {
            Some(due) => due,
            None => {
                let earliest = now + LEAD;
                earliest - into_step(earliest) + STEP
            }
        };
        while due + STEP <= now {
            due += STEP;
            self.missed = self.missed.saturating_add(1);
        }
        self.due = Some(due);
        Timer::at(due - LEAD).await;
        self.adc.hold_others(true);
        while Instant::now() < due {}
        self.due = Some(due + STEP);
        Some((due, core::mem::take(&mut self.missed)))
    }

    fn sample(&mut self, config: &Config) -> Sample {
        let mut codes = kind::sample([
            self.code(Channel::Adc0),
            self.code(Channel::Adc1),
            self.code(Channel::Adc2),
        ]);
        let paused = self.shared.storing.load(Ordering::Relaxed);
        kind::take_parts(config, &self.shared.parts, paused, &mut self.seen, &mut codes);
        self.adc.hold_others(false);
        // An input that cannot be read counts as open.
        Sample { emergency_stop: !self.run_line.is_high().unwrap_or(false), ..codes }
    }
}
