//! Types of the angle's sensor, and the code of a sensor that is read over a bus.
//!
//! A potentiometer is read by the converter. An AS5600 is read once in every step: an [`Encoder`] puts its reading on
//! the converter's scale, so that both give one code, which the sensing of both muscles judges.

use crate::sample::AdcCode;
use crate::sensing::adc::at_rail;

/// Type of the angle's sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum AnglePart {
    /// A potentiometer on the converter.
    #[default]
    Potentiometer,
    /// ams AS5600, a magnetic encoder on I2C: 4096 LSB in a turn. It reads 0 at `joint.sensor_minimum_rad`.
    As5600,
}

impl AnglePart {
    /// Whether it is read over a bus.
    pub fn is_digital(self) -> bool {
        self == Self::As5600
    }
}

/// Number of readings of an AS5600 in a turn.
pub const TURN: u16 = 4096;
/// Codes per reading: a turn spans 90 % of the scale.
const PER_READING: f32 = 0.9 * 32_768.0 / TURN as f32;
/// Code of reading 0.
const FIRST: f32 = 0.05 * 32_768.0;
/// Steps without a reading after which the angle is lost: ten disturbed messages, or the chip's start.
const PATIENCE_STEPS: u8 = 10;

/// Code of a reading, 0 to 4095, far from both rails. Its lowest bit alternates from reading to reading, so that a
/// frozen code always means a chip that is no longer read.
///
/// ```
/// use model_core::joint::encoder;
///
/// let code = encoder::code(2048, false);
/// assert_eq!(encoder::reading(code), Some(2048));
/// assert_ne!(code, encoder::code(2048, true));
/// ```
pub fn code(reading: u16, odd: bool) -> AdcCode {
    let even = (FIRST + 0.5 + PER_READING * f32::from(reading % TURN)) as u16 & !1;
    AdcCode(even | u16::from(odd))
}

/// The reading of a [`code`]; `None` at a rail.
pub fn reading(AdcCode(code): AdcCode) -> Option<u16> {
    // A code is within 1.5 of its reading's place, and readings are 7.2 apart.
    let reading = (f32::from(code) - FIRST) / PER_READING + 0.5;
    (!at_rail(AdcCode(code))).then(|| (reading as u16).min(TURN - 1))
}

/// The board's side of an AS5600: the code of each step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Encoder {
    last: AdcCode,
    silent_steps: u8,
}

impl Default for Encoder {
    /// No reading yet: half a turn, until a first reading comes or the patience ends. The joint's startup check lasts
    /// longer, and the joint vents meanwhile.
    fn default() -> Self {
        Self { last: code(TURN / 2, false), silent_steps: 0 }
    }
}

impl Encoder {
    /// Returns the code of a step; `reading` is `None` if none has come since the step before. Without readings the
    /// last code stays for 10 steps, and then a rail's code follows.
    ///
    /// ```
    /// use model_core::joint::encoder::Encoder;
    /// use model_core::AdcCode;
    ///
    /// let mut encoder = Encoder::default();
    /// let last = encoder.code(Some(700));
    /// assert!((1..10).all(|_| encoder.code(None) == last));
    /// assert_eq!(encoder.code(None), AdcCode(0));
    /// ```
    pub fn code(&mut self, reading: Option<u16>) -> AdcCode {
        match reading {
            Some(reading) => {
                self.last = code(reading, self.last.0 & 1 == 0);
                self.silent_steps = 0;
            }
            None => self.silent_steps = self.silent_steps.saturating_add(1),
        }
        if self.silent_steps < PATIENCE_STEPS { self.last } else { AdcCode(0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reading_has_codes_of_its_own_between_the_rails() {
        for of in 0..TURN {
            for odd in [false, true] {
                let code = code(of, odd);
                assert_eq!((reading(code), at_rail(code)), (Some(of), false), "{code:?}");
            }
        }
        for rail in [0, 600, 32_400, 32_760] {
            assert_eq!(reading(AdcCode(rail)), None);
        }
    }

    #[test]
    fn a_chip_that_is_silent_for_ten_steps_is_at_a_rail_until_it_is_read_again() {
        let mut encoder = Encoder::default();
        assert_eq!(reading(encoder.code(None)), Some(2048));
        let silent = (1..100).find(|_| at_rail(encoder.code(None)));
        assert_eq!(silent, Some(9));
        let first = encoder.code(Some(3000));
        let second = encoder.code(Some(3000));
        assert!(first != second && reading(first) == reading(second));
        for _ in 0..5 {
            assert_eq!(encoder.code(None), second);
        }
        assert_eq!(reading(encoder.code(Some(7))), Some(7));
    }
}
