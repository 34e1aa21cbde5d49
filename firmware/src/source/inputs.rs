//! The board's own inputs, at every whole millisecond.

use super::{STEP, Source, into_step};
use crate::board::{Adc, Channel};
use crate::shared::Shared;
use embassy_time::{Duration, Instant, Timer};
use embedded_hal::digital::InputPin;
use model_core::sample::OVERSAMPLING;
use model_core::sensing::Sensors;
use model_core::{AdcCode, Sample};

/// The timer is set this much ahead, and the rest is waited for in place: the way from the timer's
/// interrupt to the task takes some 14 us, and the line's interrupt may come in between. It is held back then.
const LEAD: Duration = Duration::from_micros(30);

/// The board's own inputs, at every whole millisecond.
pub struct Inputs<A, P> {
    adc: A,
    run_line: P,
    /// Time of the next step; of the first one when it is asked for: what comes before takes its time.
    due: Option<Instant>,
    /// Steps left out since the last one: kept here, because an order may end a wait early.
    missed: u32,
    /// Where the digital sensors' readings are, and the last ones of pressure and gas.
    #[cfg(feature = "parts")]
    parts: (&'static crate::parts::Parts, [u32; 2]),
}

impl<A: Adc, P: InputPin> Inputs<A, P> {
    /// `run_line` is high while the emergency stop is not pressed and its wire not broken.
    #[cfg_attr(not(feature = "parts"), allow(unused_variables))]
    pub fn new(adc: A, run_line: P, shared: &'static Shared) -> Self {
        Self {
            adc,
            run_line,
            due: None,
            missed: 0,
            #[cfg(feature = "parts")]
            parts: (&shared.parts, [0; 2]),
        }
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

    #[cfg_attr(not(feature = "parts"), allow(unused_mut, unused_variables))]
    fn sample(&mut self, sensors: &Sensors) -> Sample {
        let mut codes = Sample::new(
            self.code(Channel::Pressure),
            self.code(Channel::Gas),
            self.code(Channel::Length),
        );
        #[cfg(feature = "parts")]
        {
            let (parts, [pressure, gas]) = &mut self.parts;
            if sensors.pressure_part.is_digital() {
                codes.pressure = parts.pressure.code(pressure);
            }
            if sensors.gas_element.is_digital() {
                codes.gas = parts.gas.code(gas);
            }
        }
        self.adc.hold_others(false);
        // A line that cannot be read is a line that is open.
        Sample { emergency_stop: !self.run_line.is_high().unwrap_or(false), ..codes }
    }
}
