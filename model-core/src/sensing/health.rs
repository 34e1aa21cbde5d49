//! Whether a line of the converter is healthy, by its codes.

use super::Validity;
use super::adc::number_at_rail;
use crate::sample::CODE_MAX;

/// Conversions with gas flowing for which a code may stand still. The noise of eight summed conversions
/// moves it at almost every step, and so does gas that flows; only in a code of erratum RP2040-E11
/// neither is seen.
pub const FROZEN_CODES: u16 = 60;

/// A change of the change from code to code beyond this is a jerk: 2 % of the range. The gas of a
/// muscle behind a fast valve makes a fifth of it.
const JERK: i32 = (CODE_MAX / 50) as i32;
/// Count that a jerk adds for a noisy channel; a code without one takes 1 away.
const JERK_WEIGHT: u16 = 4;
/// Count from which a line is noisy, ten jerks, and the most that is counted.
const NOISY: u16 = 40;
const MOST_NOISY: u16 = 60;

/// How long a channel may be frozen in its present state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stillness {
    /// Gas flows: a code that stands still is a frozen one.
    Suspicious,
    /// Nothing moves, or the sensor is slow: a frozen code proves nothing.
    Usual,
    /// The code is so wide that a healthy line stands still in it.
    Wide,
}

/// The last codes of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Health {
    /// Codes at a rail in a row from which the line is lost.
    patience: u16,
    last: u16,
    before: u16,
    jerks: u16,
    still: u16,
    at_rail: u16,
}

impl Health {
    /// Nothing seen yet; so many codes at a rail in a row make a line lost.
    pub fn new(patience: u16) -> Self {
        Self { patience, last: 0, before: 0, jerks: 0, still: 0, at_rail: 0 }
    }

    /// The same line, judged as patiently as `other`.
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
