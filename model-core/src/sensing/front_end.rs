//! From ADC codes to SI: the board's analog front ends, read backwards.
//!
//! Every channel is ratiometric: sensor, bridge and ADC share one reference, so that only fractions
//! of it matter. The arithmetic of the circuits is in `docs/board.md`.

use crate::math::sqrt;
use crate::sample::{AdcCode, CODE_MAX, OVERSAMPLING};

/// IEC 60751, platinum above 0 degC: R = R0 (1 + A t + B t^2), \[1/K\].
pub const PLATINUM_A: f32 = 3.9083e-3;
/// IEC 60751, \[1/K2\].
pub const PLATINUM_B: f32 = -5.775e-7;
/// 0 degC \[K\].
pub const ZERO_CELSIUS_K: f32 = 273.15;
/// Resistance of a Pt1000 at 0 degC \[ohm\].
pub const PT1000_OHM: f32 = 1000.0;
/// Upper resistor of the Pt1000's half bridge \[ohm\].
pub const BRIDGE_OHM: f32 = 4700.0;
/// Codes nearer to a rail than this are a broken or saturated sensor: 2 % of the range.
pub const RAIL_MARGIN: u16 = CODE_MAX / 50;

/// Ranges of the three front ends.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub struct FrontEnd {
    /// Pressure at full scale; the sensor gives 10 to 90 % of the reference over 0 to this \[Pa\].
    pub pressure_range_pa: f32,
    /// Noise of one conversion of the pressure, standard deviation \[Pa\].
    pub pressure_noise_pa: f32,
    /// Length at full scale; 5 to 95 % of the reference over 0 to this \[m\].
    pub length_range_m: f32,
    /// Temperature at 5 % of the reference \[K\].
    pub gas_min_k: f32,
    /// Temperature at 95 % of the reference \[K\].
    pub gas_max_k: f32,
    /// By how much the ADC's codes 512, 1536, 2560 and 3584 are too wide \[LSB of 12 bit\]: 8.9 on
    /// the RP2040 (erratum RP2040-E11), 0 on an ADC without it.
    pub wide_code_lsb: f32,
}

impl FrontEnd {
    /// Whether the converter makes this code so wide that a healthy line may stand still in it.
    pub fn widens(&self, code: AdcCode) -> bool {
        self.wide_code_lsb > 0.0 && is_wide(code)
    }

    /// What one code of 12 bit is worth on the pressure's channel \[Pa\].
    pub fn pressure_code_pa(&self) -> f32 {
        self.pressure_range_pa / (0.8 * 4096.0)
    }

    /// What one code of 12 bit is worth on the length's channel \[m\].
    pub fn length_code_m(&self) -> f32 {
        self.length_range_m / (0.9 * 4096.0)
    }

    /// What one code of 12 bit is worth on the gas sensor's channel, mean over its range \[K\].
    pub fn gas_code_k(&self) -> f32 {
        (self.gas_max_k - self.gas_min_k) / (0.9 * 4096.0)
    }
}

/// A front end with its constants worked out once: value = offset + slope code, and for the
/// bridge its ratio instead of the value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Converter {
    linearisation: Linearisation,
    pressure: Line,
    length: Line,
    bridge: Line,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    offset: f32,
    slope: f32,
}

/// Undoes erratum RP2040-E11. Four codes swallow `wide_code_lsb` of input each, and with the
/// curve's ends where they belong it is steeper by as much in between: an error of up to 4.5 LSB,
/// or at 120 kPa almost 1 % of the pressure. A wide code itself says no more than that the input
/// lies in it, and is read as its middle.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Linearisation {
    /// Input per code.
    slope: f32,
    /// Half of the input that one wide code swallows, in units of a summed code.
    half_swallowed: f32,
}

impl Linearisation {
    fn new(wide_code_lsb: f32) -> Self {
        Self {
            slope: 1.0 - 4.0 * wide_code_lsb / 4095.0,
            half_swallowed: 0.5 * wide_code_lsb * f32::from(OVERSAMPLING),
        }
    }

    /// The ideal code for a code as read; need not be whole.
    fn ideal(&self, code: AdcCode) -> f32 {
        self.slope * f32::from(code.0) + self.half_swallowed * wide_halves_below(code) as f32
    }
}

/// Halves of wide codes below a code: they lie at 512 + 1024 i, here times eight; of the one that is
/// read, one half.
fn wide_halves_below(code: AdcCode) -> u32 {
    let code = u32::from(code.0);
    ((code + 4096) >> 13) + ((code + 4095) >> 13)
}

/// Whether a code is one of the four that erratum RP2040-E11 widens.
fn is_wide(code: AdcCode) -> bool {
    code.0 & 8191 == 4096
}

/// Sum of one channel's codes over many steps, in integers: cheap where there is no FPU.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CodeSum {
    codes: u32,
    wide_halves: u32,
    count: u16,
}

impl CodeSum {
    /// Adds one code; up to 65 535 of them.
    pub fn add(&mut self, code: AdcCode) {
        self.codes = self.codes.saturating_add(u32::from(code.0));
        self.wide_halves = self.wide_halves.saturating_add(wide_halves_below(code));
        self.count = self.count.saturating_add(1);
    }
}

impl Line {
    /// The line with `low_value` at `low` and `high_value` at `high`, both fractions of the
    /// reference.
    fn new((low, low_value): (f32, f32), (high, high_value): (f32, f32)) -> Self {
        let slope = (high_value - low_value) / (high - low);
        let per_code = 1.0 / (4096.0 * f32::from(OVERSAMPLING));
        // A conversion truncates: the middle of a code lies half a step above it, for a sum of
        // eight that is four.
        let half = 0.5 * f32::from(OVERSAMPLING) * per_code;
        Self { offset: low_value + slope * (half - low), slope: slope * per_code }
    }

    fn at(&self, ideal_code: f32) -> f32 {
        self.offset + self.slope * ideal_code
    }
}

impl Converter {
    /// Works the constants out.
    pub fn new(front_end: &FrontEnd) -> Self {
        Self {
            linearisation: Linearisation::new(front_end.wide_code_lsb),
            pressure: Line::new((0.1, 0.0), (0.9, front_end.pressure_range_pa)),
            length: Line::new((0.05, 0.0), (0.95, front_end.length_range_m)),
            bridge: Line::new(
                (0.05, bridge_ratio(front_end.gas_min_k)),
                (0.95, bridge_ratio(front_end.gas_max_k)),
            ),
        }
    }

    /// Absolute pressure \[Pa\].
    pub fn pressure_pa(&self, code: AdcCode) -> f32 {
        self.pressure.at(self.linearisation.ideal(code))
    }

    /// Length \[m\].
    pub fn length_m(&self, code: AdcCode) -> f32 {
        self.length.at(self.linearisation.ideal(code))
    }

    /// Temperature of the Pt1000 \[K\] from one code.
    pub fn gas_k(&self, code: AdcCode) -> f32 {
        self.bridge_k(self.linearisation.ideal(code))
    }

    /// Temperature of the Pt1000 \[K\] from the mean of many codes; `None` for none.
    pub fn mean_gas_k(&self, sum: &CodeSum) -> Option<f32> {
        (sum.count > 0).then(|| {
            let total = self.linearisation.slope * sum.codes as f32
                + self.linearisation.half_swallowed * sum.wide_halves as f32;
            self.bridge_k(total / f32::from(sum.count))
        })
    }

    fn bridge_k(&self, ideal_code: f32) -> f32 {
        platinum_temperature_k(BRIDGE_OHM * ratio_to_resistance(self.bridge.at(ideal_code)))
    }
}

/// Whether a code lies so near to a rail that no healthy sensor gives it.
pub fn at_rail(code: AdcCode) -> bool {
    code.0 < RAIL_MARGIN || code.0 > CODE_MAX - RAIL_MARGIN
}

/// Resistance of a Pt1000 \[ohm\] at a temperature \[K\], IEC 60751 without the term below 0 degC
/// (at -40 degC it is 0.02 %).
pub fn platinum_resistance_ohm(temperature_k: f32) -> f32 {
    let celsius = temperature_k - ZERO_CELSIUS_K;
    PT1000_OHM * (1.0 + celsius * (PLATINUM_A + celsius * PLATINUM_B))
}

/// Temperature \[K\] of a Pt1000 of a resistance \[ohm\]: the quadratic of
/// [`platinum_resistance_ohm`], solved so that nothing cancels.
pub fn platinum_temperature_k(resistance_ohm: f32) -> f32 {
    let excess = resistance_ohm / PT1000_OHM - 1.0;
    let root = sqrt(PLATINUM_A * PLATINUM_A + 4.0 * PLATINUM_B * excess);
    ZERO_CELSIUS_K + 2.0 * excess / (PLATINUM_A + root)
}

/// Ratio of the half bridge, R/(R + BRIDGE_OHM), at a temperature \[K\].
fn bridge_ratio(temperature_k: f32) -> f32 {
    let resistance = platinum_resistance_ohm(temperature_k);
    resistance / (resistance + BRIDGE_OHM)
}

/// R/BRIDGE_OHM from the ratio R/(R + BRIDGE_OHM).
fn ratio_to_resistance(ratio: f32) -> f32 {
    ratio / (1.0 - ratio)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FRONT_END: FrontEnd = FrontEnd {
        pressure_range_pa: 700_000.0,
        pressure_noise_pa: 150.0,
        length_range_m: 0.4,
        gas_min_k: 270.0,
        gas_max_k: 330.0,
        wide_code_lsb: 8.9,
    };

    /// IEC 60751 tables, 0 to 100 degC.
    #[test]
    fn platinum_table() {
        for (celsius, ohm) in [(0.0, 1000.0), (25.0, 1097.35), (50.0, 1193.97), (100.0, 1385.06)] {
            let r = platinum_resistance_ohm(celsius + ZERO_CELSIUS_K);
            assert!((r / ohm - 1.0).abs() < 1e-5, "{r} for {ohm}");
            let t = platinum_temperature_k(ohm);
            assert!((t - celsius - ZERO_CELSIUS_K).abs() < 0.01, "{t} at {celsius} degC");
        }
    }

    #[test]
    fn range_ends() {
        let converter = Converter::new(&FrontEnd { wide_code_lsb: 0.0, ..FRONT_END });
        let code = |fraction: f32| AdcCode((fraction * 32768.0) as u16);
        assert!(converter.pressure_pa(code(0.1)).abs() < 150.0);
        assert!((converter.pressure_pa(code(0.9)) - 700_000.0).abs() < 150.0);
        // A sum of eight truncated codes: its middle lies four above it.
        let middle_pa = 700_000.0 * (f32::from(code(0.5).0 + 4) / 32768.0 - 0.1) / 0.8;
        assert!((converter.pressure_pa(code(0.5)) - middle_pa).abs() < 1.0);
        assert!((converter.length_m(code(0.95)) - 0.4).abs() < 1e-4);
        assert!((converter.gas_k(code(0.05)) - 270.0).abs() < 0.02);
        assert!((converter.gas_k(code(0.95)) - 330.0).abs() < 0.02);
    }

    proptest! {
        #[test]
        fn every_code_gives_a_finite_value(code in any::<u16>()) {
            let converter = Converter::new(&FRONT_END);
            prop_assert!(converter.pressure_pa(AdcCode(code)).is_finite());
            prop_assert!(converter.length_m(AdcCode(code)).is_finite());
            prop_assert!(converter.gas_k(AdcCode(code)).is_finite());
        }

        /// The curve of the erratum, written down as the datasheet tells it, comes back straight.
        #[test]
        fn linearisation_undoes_the_erratum(input in 1.0_f64..4094.0) {
            let steep = 4095.0 / (4095.0 - 4.0 * 8.9);
            let mut read = input * steep;
            for wide in [512.0, 1536.0, 2560.0, 3584.0] {
                read = if read > wide + 8.9 * steep { read - 8.9 * steep } else { read.min(wide) };
            }
            let code = AdcCode((read * 8.0).round() as u16);
            let ideal = Linearisation::new(8.9).ideal(code);
            // What rounds to a wide code is read as its middle too.
            let allowed = if is_wide(code) { 4.45 } else { 0.0 } + 0.1;
            prop_assert!((f64::from(ideal) / 8.0 - input).abs() < allowed, "{ideal} for {input}");
        }

        #[test]
        fn a_mean_is_what_its_codes_are(code in 2000_u16..30_000, count in 1_u16..300) {
            let converter = Converter::new(&FRONT_END);
            let mut sum = CodeSum::default();
            for _ in 0..count {
                sum.add(AdcCode(code));
            }
            let mean = converter.mean_gas_k(&sum).unwrap();
            prop_assert!((mean - converter.gas_k(AdcCode(code))).abs() < 1e-3);
            prop_assert_eq!(converter.mean_gas_k(&CodeSum::default()), None);
        }
    }

    /// What one code of 12 bit is worth is what the converter makes of eight of a sum.
    #[test]
    fn a_code_is_worth_what_the_converter_makes_of_it() {
        let front_end = FrontEnd { wide_code_lsb: 0.0, ..FRONT_END };
        let converter = Converter::new(&front_end);
        let [low, high] = [0.05_f32, 0.95].map(|share| AdcCode((share * 32_768.0) as u16));
        let codes = f32::from(high.0 - low.0) / 8.0;
        let worth = |value: fn(&Converter, AdcCode) -> f32| {
            (value(&converter, high) - value(&converter, low)) / codes
        };
        for (stated, made) in [
            (front_end.pressure_code_pa(), worth(Converter::pressure_pa)),
            (front_end.length_code_m(), worth(Converter::length_m)),
            (front_end.gas_code_k(), worth(Converter::gas_k)),
        ] {
            assert!((stated / made - 1.0).abs() < 1e-3, "{stated} for {made}");
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

    /// 512, 1536, 2560 and 3584, each eight times in a row.
    #[test]
    fn four_codes_are_wide() {
        let wide: Vec<u16> = (0..=CODE_MAX).filter(|&code| is_wide(AdcCode(code))).collect();
        assert_eq!(wide, [4096, 12_288, 20_480, 28_672]);
    }
}
