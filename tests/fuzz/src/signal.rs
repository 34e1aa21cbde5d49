//! ADC codes over many steps, from a few bytes.

use crate::any::{Choices, byte};
use arbitrary::Unstructured;
use model_core::sample::CODE_MAX;
use model_core::{AdcCode, Command};
use rand_xoshiro::Xoshiro128PlusPlus;
use rand_xoshiro::rand_core::Rng;

/// Course of a channel's code.
#[derive(Debug, Clone, Copy)]
enum Waveform {
    /// Follows the flow through the valves by this much per step, and stays within a usual range.
    Follow(f32),
    Still,
    /// Changes by this much per step.
    Ramp(f32),
    /// Alternates by this much.
    Toggle(u16),
    /// Any code at any step.
    Random,
}

#[derive(Debug, Clone, Copy)]
pub struct Signal {
    waveform: Waveform,
    code: f32,
    /// Largest noise, in either direction.
    noise: u16,
    odd: bool,
}

impl Signal {
    /// Constant at a usual code, with the noise of eight summed conversions.
    pub fn usual(code: u16) -> Self {
        Self { waveform: Waveform::Still, code: f32::from(code), noise: 6, odd: false }
    }

    /// Another waveform from the current code, or from another one.
    pub fn change(&mut self, bytes: &mut Unstructured) {
        let slope = (f32::from(byte(bytes)) - 128.0) / 4.0;
        match byte(bytes) % 16 {
            0..=5 => self.waveform = Waveform::Follow(slope),
            6..=8 => self.waveform = Waveform::Still,
            9 | 10 => self.waveform = Waveform::Ramp(slope),
            11 => self.waveform = Waveform::Toggle(bytes.whole(16) as u16),
            12 => self.waveform = Waveform::Random,
            // From a rail, from above the sum of eight conversions, or from any code.
            13 => self.code = if slope < 0.0 { 0.0 } else { f32::from(CODE_MAX) },
            14 => self.code = f32::from(u16::MAX),
            _ => self.code = bytes.whole(16) as f32,
        }
        self.noise = match byte(bytes) % 4 {
            0 => 6,
            1 => 0,
            2 => 60,
            _ => bytes.whole(16) as u16,
        };
    }

    pub fn next(&mut self, command: Command, random: &mut Xoshiro128PlusPlus) -> AdcCode {
        const USUAL: (f32, f32) = (3000.0, 29_000.0);
        self.odd = !self.odd;
        let by = match self.waveform {
            Waveform::Follow(slope) => {
                let followed = self.code + slope * (command.inlet.share() - command.outlet.share());
                followed.clamp(USUAL.0, USUAL.1) - self.code
            }
            Waveform::Still => 0.0,
            Waveform::Ramp(slope) => slope,
            Waveform::Toggle(by) if self.odd => f32::from(by),
            Waveform::Toggle(by) => -f32::from(by),
            Waveform::Random => return AdcCode(random.next_u32() as u16),
        };
        self.code = (self.code + by).clamp(0.0, f32::from(u16::MAX));
        let noise = random.next_u32() % (2 * u32::from(self.noise) + 1);
        AdcCode((self.code + noise as f32 - f32::from(self.noise)) as u16)
    }
}
