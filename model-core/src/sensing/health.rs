//! Whether a channel of the converter is healthy, judged by its codes.

use super::Validity;
use super::adc::number_at_rail;
use crate::sample::CODE_MAX;

/// Conversions with flowing gas for which a code may stay the same. The noise of eight summed conversions changes it at
/// almost every step, and so does flowing gas; only a wide code of erratum RP2040-E11 hides both.
pub const FROZEN_CODES: u16 = 60;

/// A second difference of the codes beyond this is a jerk: 2 % of the range. The gas of a muscle behind a fast valve
/// makes 20 % of it.
const JERK: i32 = (CODE_MAX / 50) as i32;
/// Count that a jerk adds for a noisy channel; a code without one takes 1 away.
const JERK_WEIGHT: u16 = 4;
/// Count from which a channel is noisy, ten jerks, and the highest count.
const NOISY: u16 = 40;
const MOST_NOISY: u16 = 60;

/// Meaning of an unchanged code in the channel's present state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stillness {
    /// Gas flows: an unchanged code is frozen.
    Suspicious,
    /// Nothing moves, or the sensor is slow: an unchanged code proves nothing.
    Usual,
    /// The code is so wide that a healthy channel may stay in it.
    Wide,
}

/// The last codes of a channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Health {
    /// Codes in a row at a rail from which the channel is lost.
    patience: u16,
    last: u16,
    before: u16,
    jerks: u16,
    still: u16,
    at_rail: u16,
}

impl Health {
    /// Creates the health of a channel without codes yet; `patience` codes in a row at a rail make it lost.
    pub fn new(patience: u16) -> Self {
        Self { patience, last: 0, before: 0, jerks: 0, still: 0, at_rail: 0 }
    }

    /// Returns the same health with the patience of `other`.
    pub fn with_patience_of(self, other: &Self) -> Self {
        Self { patience: other.patience, ..self }
    }

    /// Takes the next code, of the converter or of a digital part.
    pub fn add(&mut self, code: u16, stillness: Stillness) -> Validity {
        let [now, last, before] = [code, self.last, self.before].map(i32::from);
        self.jerks = if (now - 2 * last + before).abs() > JERK {
            (self.jerks + JERK_WEIGHT).min(MOST_NOISY)
        } else {
            self.jerks.saturating_sub(1)
        };
        if now != last || stillness == Stillness::Wide {
            self.still = 0;
        } else if stillness == Stillness::Suspicious {
            self.still = self.still.saturating_add(1);
        }
        self.at_rail = if number_at_rail(code) { self.at_rail.saturating_add(1) } else { 0 };
        self.before = self.last;
        self.last = code;
        if self.at_rail >= self.patience || self.still >= FROZEN_CODES || self.jerks >= NOISY {
            Validity::Lost
        } else if self.at_rail > 0 {
            Validity::Suspect
        } else {
            Validity::Valid
        }
    }
}
