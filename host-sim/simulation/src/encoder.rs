//! An AS5600 at the axis of a joint, and the board that reads it once in every step.

use crate::noise::standard_normal;
use model_core::AdcCode;
use model_core::joint::encoder::{self, Encoder};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use thermyo_scenario::Scenario;

const READINGS: f64 = 4096.0;
/// Noise with the fastest filter, which the firmware chooses: 0.043 deg (data sheet), standard deviation \[turns\].
const NOISE_TURNS: f64 = 0.043 / 360.0;

/// The chip and its reader.
#[derive(Debug, Clone)]
pub struct VirtualEncoder {
    generator: Xoshiro256PlusPlus,
    odd: bool,
    /// Code read in the step before, and code taken in it.
    read: Option<AdcCode>,
    taken: Option<AdcCode>,
    board: Encoder,
}

impl VirtualEncoder {
    /// The encoder of a scenario, seeded by `run.seed`.
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            // A seed other than those of converter and faults, offset by 2^33.
            generator: Xoshiro256PlusPlus::seed_from_u64(scenario.run.seed.wrapping_add(1 << 33)),
            odd: false,
            read: None,
            taken: None,
            board: Encoder::default(),
        }
    }

    /// The chip's code for a magnet turned by this number of turns.
    pub fn convert(&mut self, turns: f64) -> AdcCode {
        let noisy = turns + NOISE_TURNS * standard_normal(&mut self.generator);
        self.odd = !self.odd;
        encoder::code((READINGS * noisy).floor().rem_euclid(READINGS) as u16, self.odd)
    }

    /// The board's code of a step, from the chip's code after its faults. The chip is read in the middle of a step, and
    /// the next step takes the code. A code at a rail means a missing magnet, a frozen code a chip that does not
    /// answer.
    pub fn take(&mut self, code: AdcCode) -> AdcCode {
        let read = self.read.replace(code).unwrap_or(code);
        let fresh = self.taken.replace(read) != Some(read);
        self.board.code(encoder::reading(read).filter(|_| fresh))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use thermyo_compute::math;

    #[test]
    fn a_turn_wraps_and_has_the_stated_noise() {
        let mut encoder = VirtualEncoder::new(&Scenario::default());
        let mut mean = |turns: f64| {
            let n = 20_000;
            let readings: Vec<f64> = (0..n)
                .map(|_| f64::from(encoder::reading(encoder.convert(turns)).unwrap()))
                .collect();
            let mean = readings.iter().sum::<f64>() / f64::from(n);
            let square: f64 = readings.iter().map(|one| (one - mean) * (one - mean)).sum();
            (mean, (square / f64::from(n)).sqrt())
        };
        let (half, deviation) = mean(0.5 + 0.5 / 4096.0);
        assert!((half - 2048.0).abs() < 0.02, "{half}");
        // Noise and rounding together, in LSB.
        let expected = math::hypot(READINGS * NOISE_TURNS, (1.0 / 12.0_f64).sqrt());
        assert!((deviation / expected - 1.0).abs() < 0.05, "{deviation} for {expected}");
        assert!((mean(-0.25).0 - 3071.5).abs() < 0.1, "a turn below");
    }

    #[test]
    fn a_step_takes_the_reading_of_the_one_before() {
        let mut encoder = VirtualEncoder::new(&Scenario::default());
        let codes: Vec<AdcCode> = [0.2, 0.3, 0.4].map(|turns| encoder.convert(turns)).into();
        let taken: Vec<Option<u16>> =
            codes.iter().map(|code| encoder::reading(encoder.take(*code))).collect();
        let [first, second, _] = codes[..] else { unreachable!() };
        assert_eq!(
            taken,
            [encoder::reading(first), encoder::reading(first), encoder::reading(second)]
        );
    }

    /// A missing magnet and a chip that does not answer end at a rail after 10 steps.
    #[test]
    fn a_lost_encoder_ends_at_a_rail() {
        for lost in [AdcCode(0), AdcCode(20_000)] {
            let mut encoder = VirtualEncoder::new(&Scenario::default());
            for _ in 0..100 {
                let code = encoder.convert(0.5);
                assert!(encoder::reading(encoder.take(code)).is_some());
            }
            let steps = (1..100).find(|_| encoder::reading(encoder.take(lost)).is_none());
            // Two frozen codes are still taken: the last good one, and the first of the fault.
            let expected = if lost.0 == 0 { 11 } else { 12 };
            assert_eq!(steps, Some(expected));
        }
    }
}
