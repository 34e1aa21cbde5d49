//! Platinum resistor on a MAX31865, with 2 or 4 wires. The circuit is in `docs/reference/board.md`.
//!
//! The chip returns R/R_ref in 15 bits (data sheet 19-6478, "ADC code = (R_RTD x 2^15)/R_REF"), here every 20 ms: its
//! filter is set for 50 Hz.

use super::element::{Curve, Element};
use super::part::Limits;
use super::platinum::{platinum_resistance_ohm, platinum_temperature_k};
use crate::math::limit;
use crate::parameter::{ConfigError, parameters, within};

parameters! {
    /// Platinum resistor on a MAX31865. It counts as lost when it reads outside its range.
    "sensor.max31865": Max31865 {
        zero_ohm: 100.0, "Ohm", 10.0 to 10000.0, "resistance at 0 degC: 100 for a Pt100, 1000 for a Pt1000";
        reference_ohm: 430.0, "Ohm", 10.0 to 100000.0, "reference resistor: about four times zero_ohm";
        lowest_k: 230.0, "K", 73.0 to 800.0, "lowest temperature that is believed";
        highest_k: 430.0, "K", 74.0 to 1100.0, "highest temperature that is believed";
        timeout_s: 0.1, "s", 0.025 to 10.0, "silence after which the part is lost";
    }
}

/// Codes of the chip's full scale.
const SCALE: f32 = 32_768.0;

impl Max31865 {
    fn code(&self, temperature_k: f32) -> u16 {
        let ohm = platinum_resistance_ohm(self.zero_ohm, temperature_k);
        limit(SCALE * (ohm / self.reference_ohm), 1.0, 32_766.0) as u16
    }
}

impl Element for Max31865 {
    type Curve = Ratio;
    const DIGITAL: bool = true;

    fn check_ranges(&self) -> Result<(), ConfigError> {
        // The minimum of the upper end depends on the lower one.
        const HIGHEST_K: f32 = 1100.0;
        Self { highest_k: HIGHEST_K, ..*self }.check()?;
        within("sensor.max31865.highest_k", self.highest_k, self.lowest_k + 1.0, HIGHEST_K)
    }

    fn curve(&self) -> Ratio {
        Ratio { zero_ohm: self.zero_ohm, ohm_per_code: self.reference_ohm / SCALE }
    }

    fn resolution_k(&self) -> f32 {
        // One code of 15 bits, by the slope at 25 degC.
        self.reference_ohm / (SCALE * 3.879e-3 * self.zero_ohm)
    }

    fn part(&self) -> Option<Limits> {
        // The first conversion takes 63 ms after the command to convert.
        let first_s = self.timeout_s.max(0.2);
        let codes = self.code(self.lowest_k)..=self.code(self.highest_k);
        // Half of its 20 ms, plus half of the step in which it arrives.
        Some(Limits { timeout_s: self.timeout_s, first_s, latency_s: 0.010_5, codes })
    }
}

/// Resistance over codes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ratio {
    zero_ohm: f32,
    ohm_per_code: f32,
}

impl Curve for Ratio {
    fn at_k(&self, ideal_code: f32) -> f32 {
        // Up to 3 times the resistance at 0 degC, 870 K: beyond it `part` rejects the code, and higher up the
        // polynomial has its maximum.
        let ohm = limit(self.ohm_per_code * ideal_code, 0.0, 4.0 * self.zero_ohm);
        platinum_temperature_k(self.zero_ohm, ohm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The data sheet's registers of a Pt100 on 400 ohm, table 9.
    #[test]
    fn the_data_sheets_table_is_read() {
        let chip = Max31865 { reference_ohm: 400.0, ..Max31865::default() };
        for (register, celsius) in
            [(0x35ee_u16, -40.0), (0x4000, 0.0), (0x49f2, 40.0), (0x58a4, 100.0)]
        {
            let error_k = chip.curve().at_k(f32::from(register) / 2.0) - 273.15 - celsius;
            // Half an LSB, and the polynomial's omission below 0 degC.
            assert!(error_k.abs() < 0.05, "{error_k} K at {celsius} degC");
        }
    }

    #[test]
    fn its_own_code_is_its_step() {
        for chip in [
            Max31865::default(),
            Max31865 { zero_ohm: 1000.0, reference_ohm: 4300.0, ..Max31865::default() },
        ] {
            let code = chip.code(300.0);
            let step_k =
                chip.curve().at_k(f32::from(code) + 1.0) - chip.curve().at_k(f32::from(code));
            assert!((chip.resolution_k() / step_k - 1.0).abs() < 0.06, "{step_k}");
            assert!((0.02..0.05).contains(&step_k), "{step_k} K");
        }
    }

    proptest! {
        #[test]
        fn a_temperature_comes_back(kelvin in 230.0_f32..430.0) {
            let chip = Max31865::default();
            let read_k = chip.curve().at_k(f32::from(chip.code(kelvin)) + 0.5);
            prop_assert!((read_k - kelvin).abs() < 0.03, "{read_k} of {kelvin}");
        }
    }
}
