//! A digital part: a chip that converts by itself and is read over a bus, at a rate of its own.

use super::Validity;
use super::health::{Health, Stillness};
use crate::sample::{PartCode, RawCode};
use crate::step_counts::timeout_steps;
use core::ops::RangeInclusive;

/// Nonsense readings, or reports of the part that it is broken, in a row from which it is lost: a single one may be a
/// disturbance of the bus.
pub const PATIENCE: u16 = 2;

/// Limits of a digital sensor.
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    /// Silence after which the part is lost \[s\].
    pub timeout_s: f32,
    /// Time that the first reading may take \[s\].
    pub first_s: f32,
    /// Age of a reading when it arrives \[s\].
    pub latency_s: f32,
    /// Codes that the part may deliver.
    pub codes: RangeInclusive<u16>,
}

/// Time since a part's last reading, and its state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    timeout_steps: u32,
    /// Steps of silence that are left.
    left_steps: u32,
    lowest: u16,
    highest: u16,
    validity: Validity,
}

impl Part {
    /// Creates a part without a reading yet, which counts as `validity` until then, for a step of `step_s`.
    #[cold]
    pub fn new(limits: &Limits, step_s: f32, validity: Validity) -> Self {
        Self {
            timeout_steps: timeout_steps(limits.timeout_s, step_s),
            left_steps: timeout_steps(limits.first_s, step_s),
            lowest: *limits.codes.start(),
            highest: *limits.codes.end(),
            validity,
        }
    }

    /// Continues the part's silence from before a restart.
    pub fn goes_on_from(&mut self, before: &Self) {
        self.left_steps = self.left_steps.min(before.left_steps);
    }

    /// Judges the code of a step. Not inlined: two calls.
    #[inline(never)]
    pub fn add(&mut self, health: &mut Health, code: RawCode, usual: Stillness) -> Validity {
        if let RawCode::Fresh(PartCode(reading)) = code {
            self.left_steps = self.timeout_steps;
            let plausible = (self.lowest..=self.highest).contains(&reading);
            self.validity = health.add(if plausible { reading } else { 0 }, usual);
        } else {
            self.left_steps = self.left_steps.saturating_sub(1);
        }
        if self.left_steps == 0 { Validity::Lost } else { self.validity }
    }
}
