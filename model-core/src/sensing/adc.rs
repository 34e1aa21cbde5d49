//! The board's converter: the share of the reference that a code stands for.
//!
//! Every channel is ratiometric: sensor, bridge and ADC share one reference, so that only fractions
//! of it matter. The arithmetic of the circuits is in `docs/reference/board.md`.

use crate::parameter::parameters;
use crate::sample::{AdcCode, CODE_MAX, OVERSAMPLING, PartCode, RawCode};

/// Codes nearer to a rail than this come from a broken or saturated sensor: 2 % of the range.
pub const RAIL_MARGIN: u16 = CODE_MAX / 50;
/// Codes of 12 bit over the whole reference.
const CODES: f32 = 4096.0;

parameters! {
    /// The converter.
    "adc": Adc {
        wide_code_lsb: 8.9, "LSB", 0.0 to 100.0, "by how much codes 512, 1536, 2560 and 3584 of 12 bit are too wide: 8.9 on the RP2040 (erratum E11), 0 without it";
    }
}

impl Adc {
    /// Half the width of the converter's widest codes, in the unit of a sensor whose codes are worth `resolution` each.
    pub fn half_width(&self, resolution: f32) -> f32 {
        0.5 * self.wide_code_lsb * resolution
    }
}

/// Number of possible halves of wide codes below a code, zero included.
const MOST_HALVES: usize = 9;

/// Undoes erratum RP2040-E11. Four codes swallow `wide_code_lsb` of input each. As the ends of the curve are right, it
/// is steeper by as much in between: an error of up to 4.5 LSB, or at 120 kPa almost 1 % of the pressure. A wide code
/// itself only shows that the input lies in it, and is read as its middle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linearisation {
    /// Input per code.
    slope: f32,
    /// Half of the input that one wide code swallows, in units of a summed code.
    half_swallowed: f32,
    /// Its multiples, looked up in every step because that is faster than multiplying.
    swallowed: [f32; MOST_HALVES],
}

impl Linearisation {
    /// Computes the constants.
    ///
    /// ```
    /// use model_core::AdcCode;
    /// use model_core::sensing::adc::{Adc, Linearisation};
    ///
    /// let exact = Linearisation::new(&Adc { wide_code_lsb: 0.0 });
    /// assert_eq!(exact.ideal(AdcCode(4096)), 4096.0);
    /// assert!(Linearisation::new(&Adc::default()).widens(AdcCode(4096)));
    /// ```
    pub fn new(adc: &Adc) -> Self {
        let half_swallowed = 0.5 * adc.wide_code_lsb * f32::from(OVERSAMPLING);
        Self {
            slope: 1.0 - 4.0 * adc.wide_code_lsb / 4095.0,
            half_swallowed,
            swallowed: core::array::from_fn(|halves| half_swallowed * halves as f32),
        }
    }

    /// Whether the converter makes this code so wide that a healthy channel may stay in it.
    pub fn widens(&self, code: AdcCode) -> bool {
        is_wide(code) && self.half_swallowed > 0.0
    }

    /// The ideal code for a code as read; not necessarily whole.
    pub fn ideal(&self, code: AdcCode) -> f32 {
        let halves = (wide_halves_below(code.0) as usize).min(MOST_HALVES - 1);
        self.slope * f32::from(code.0) + self.swallowed.get(halves).unwrap_or(&0.0)
    }

    /// The mean of the ideal codes of a sum; `None` if the sum is empty.
    pub fn mean(&self, sum: &CodeSum) -> Option<f32> {
        (sum.count > 0).then(|| {
            let total =
                self.slope * sum.codes as f32 + self.half_swallowed * sum.wide_halves as f32;
            total / f32::from(sum.count)
        })
    }
}

/// Halves of wide codes below a code: they lie at 512 + 1024 i, here times eight; of a wide code itself, one half
/// counts.
fn wide_halves_below(code: u16) -> u32 {
    let code = u32::from(code);
    ((code + 4096) >> 13) + ((code + 4095) >> 13)
}

/// Whether a code is one of the four that erratum RP2040-E11 widens.
fn is_wide(code: AdcCode) -> bool {
    code.0 & 8191 == 4096
}

/// Whether a code lies so near to a rail that no healthy sensor gives it. The 15 bits of a digital
/// part span the same numbers.
pub fn at_rail(code: impl Into<RawCode>) -> bool {
    let (RawCode::Adc(AdcCode(code))
    | RawCode::Fresh(PartCode(code))
    | RawCode::Stale(PartCode(code))) = code.into();
    number_at_rail(code)
}

pub(super) fn number_at_rail(code: u16) -> bool {
    !(RAIL_MARGIN..=CODE_MAX - RAIL_MARGIN).contains(&code)
}

/// Sum of one channel's codes over many steps, of the converter or of a digital part, in integers:
/// cheap where there is no FPU.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CodeSum {
    codes: u32,
    wide_halves: u32,
    count: u16,
}

impl CodeSum {
    /// Adds one code; up to 65 535 of them.
    pub fn add(&mut self, code: u16) {
        self.codes = self.codes.saturating_add(u32::from(code));
        self.wide_halves = self.wide_halves.saturating_add(wide_halves_below(code));
        self.count = self.count.saturating_add(1);
    }

    /// Mean of the codes as read; `None` if there are none.
    pub fn mean(&self) -> Option<f32> {
        (self.count > 0).then(|| self.codes as f32 / f32::from(self.count))
    }

    /// Number of codes.
    pub fn count(&self) -> u16 {
        self.count
    }
}

/// Value of a sensor at a fraction of the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Share of the reference \[-\].
    pub share: f32,
    /// In the sensor's unit.
    pub value: f32,
}

/// A sensor that is linear in the reference: value = offset + slope code.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Characteristic {
    offset: f32,
    slope: f32,
}

impl Characteristic {
    /// Creates the characteristic through two points. Not inlined: three calls, each at a start.
    ///
    /// ```
    /// use model_core::sensing::adc::{Characteristic, Point};
    ///
    /// let sensor = Characteristic::through(Point { share: 0.1, value: 0.0 }, Point { share: 0.9, value: 8.0e5 });
    /// assert!((sensor.at(0.5 * 32_768.0) - 4.0e5).abs() < 200.0);
    /// ```
    #[inline(never)]
    pub fn through(low: Point, high: Point) -> Self {
        let per_code = 1.0 / (CODES * f32::from(OVERSAMPLING));
        // A conversion truncates: the middle of a code lies half an LSB above it, which is four for a sum of eight.
        Self::over(per_code, 0.5 * f32::from(OVERSAMPLING) * per_code, low, high)
    }

    /// Creates the same over the [codes](PartCode) of a digital part, with its output's full scale as the reference.
    pub fn of_part(low: Point, high: Point) -> Self {
        Self::over(1.0 / 32_768.0, 0.0, low, high)
    }

    fn over(per_code: f32, half: f32, low: Point, high: Point) -> Self {
        let slope = (high.value - low.value) / (high.share - low.share);
        Self { offset: low.value + slope * (half - low.share), slope: slope * per_code }
    }

    /// Scales the values by `gain`, then adds `offset`.
    pub fn scaled(self, gain: f32, offset: f32) -> Self {
        Self { offset: gain * self.offset + offset, slope: gain * self.slope }
    }

    /// Value at an ideal code.
    pub fn at(&self, ideal_code: f32) -> f32 {
        self.offset + self.slope * ideal_code
    }

    /// Width of a 12-bit code.
    pub fn per_code(&self) -> f32 {
        self.slope * f32::from(OVERSAMPLING)
    }
}
#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The curve of the erratum, written as in the datasheet, becomes straight again.
        #[test]
        fn linearisation_undoes_the_erratum(input in 1.0_f64..4094.0) {
            let steep = 4095.0 / (4095.0 - 4.0 * 8.9);
            let mut read = input * steep;
            for wide in [512.0, 1536.0, 2560.0, 3584.0] {
                read = if read > wide + 8.9 * steep { read - 8.9 * steep } else { read.min(wide) };
            }
            let code = AdcCode((read * 8.0).round() as u16);
            let ideal = Linearisation::new(&Adc::default()).ideal(code);
            // A value that rounds to a wide code is also read as its middle.
            let allowed = if is_wide(code) { 4.45 } else { 0.0 } + 0.1;
            prop_assert!((f64::from(ideal) / 8.0 - input).abs() < allowed, "{ideal} for {input}");
        }

        #[test]
        fn a_mean_is_what_its_codes_are(code in 2000_u16..30_000, count in 1_u16..300) {
            let linearisation = Linearisation::new(&Adc::default());
            let mut sum = CodeSum::default();
            prop_assert_eq!(linearisation.mean(&sum), None);
            for _ in 0..count {
                sum.add(code);
            }
            let mean = linearisation.mean(&sum).unwrap();
            prop_assert!((mean - linearisation.ideal(AdcCode(code))).abs() < 0.02, "{mean}");
        }
    }

    /// 2 % of eight conversions of 4095, at either end.
    #[test]
    fn a_fiftieth_of_the_range_is_a_rail_at_either_end() {
        for (code, rail) in [
            (0, true),
            (654, true),
            (655, false),
            (16_000, false),
            (32_105, false),
            (32_106, true),
            (32_760, true),
        ] {
            assert_eq!(at_rail(AdcCode(code)), rail, "{code}");
        }
    }

    /// 512, 1536, 2560 and 3584, each as a sum of eight equal conversions.
    #[test]
    fn four_codes_are_wide() {
        let wide: Vec<u16> = (0..=CODE_MAX).filter(|&code| is_wide(AdcCode(code))).collect();
        assert_eq!(wide, [4096, 12_288, 20_480, 28_672]);
    }
}
