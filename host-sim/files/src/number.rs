//! Numbers for readers: few digits, units of a handy size, a typographic minus sign.

use super::units::{Unit, UnitSystem, si_of_column};
use std::fmt::Write;

pub const MISSING: &str = "–";

/// Marks a whole number, in place of a unit.
pub const COUNT: &str = "count";

/// Displayed value and symbol of an SI value with its SI symbol: `(4.2e5, "Pa")` is `("420", "kPa")`.
///
/// An unknown symbol is kept as it is; a [`COUNT`] is shown whole. Absolute temperatures get a fourth digit. Beyond 10 000 of a submultiple the SI unit itself is shown.
pub fn quantity(value: f64, si_symbol: &str) -> (String, String) {
    let digits = if si_symbol == "K" && value.abs() >= 100.0 { 4 } else { 3 };
    match Unit::of_si(si_symbol) {
        _ if si_symbol == COUNT => (fixed(value, 0), String::new()),
        Some(unit) if unit.factor <= 1.0 || (value * unit.factor).abs() < 1e4 => {
            (significant(value * unit.factor, digits), unit.symbol.to_owned())
        }
        _ => (significant(value, digits), si_symbol.to_owned()),
    }
}

/// An SI value of a column with its unit, or a difference of two, for a sentence.
pub fn of_column(value: f64, column: &str) -> String {
    in_unit(value, Unit::of_column(column))
}

/// A difference of two values of a column, with its unit.
pub fn difference_text(difference: f64, column: &str, units: UnitSystem) -> String {
    let unit = match units {
        UnitSystem::Practical => Unit::of_column(column),
        UnitSystem::Si => Unit { symbol: si_of_column(column), factor: 1.0 },
    };
    in_unit(difference, unit)
}

/// An SI value with three digits in this unit.
pub fn in_unit(value: f64, Unit { symbol, factor }: Unit) -> String {
    let text = significant(value * factor, 3);
    if symbol.is_empty() { text } else { format!("{text} {symbol}") }
}

/// `value` rounded to `digits` significant digits, but never to less than a whole unit.
///
/// Powers of ten below 0.001 and from a million; [`MISSING`] if it is not finite.
pub fn significant(value: f64, digits: usize) -> String {
    if !value.is_finite() {
        return MISSING.to_owned();
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let scientific = format!("{:.*e}", digits.max(1) - 1, value);
    let (mantissa, exponent) = scientific.split_once('e').expect("format `e` writes an exponent");
    let exponent: i32 = exponent.parse().expect("format `e` writes a whole exponent");
    if !(-3..6).contains(&exponent) {
        return format!("{}×{}", minus(mantissa), power_of_ten(exponent));
    }
    let decimals = usize::try_from(digits as i32 - 1 - exponent).unwrap_or(0);
    fixed(value, decimals)
}

/// How many times as fast as real time a run was: a whole number, or two significant digits of a slow one.
pub fn speed(factor: f64) -> String {
    if factor < 9.95 { significant(factor, 2) } else { format!("{factor:.0}") }
}

/// Up to three significant digits without trailing zeros, for the values of an axis.
pub fn short(value: f64) -> String {
    let text = significant(value, 3);
    if text.contains('.') && !text.contains('×') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// `value` with `decimals` digits after the point; thousands are separated from 10 000 on.
pub fn fixed(value: f64, decimals: usize) -> String {
    let plain = format!("{value:.decimals$}");
    let unsigned = plain.trim_start_matches('-');
    let negative = plain.starts_with('-') && unsigned.bytes().any(|b| (b'1'..=b'9').contains(&b));
    let (whole, rest) = unsigned.split_at(unsigned.find('.').unwrap_or(unsigned.len()));
    let mut out = String::from(if negative { "−" } else { "" });
    for (i, digit) in whole.chars().enumerate() {
        if whole.len() > 4 && i > 0 && (whole.len() - i).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(digit);
    }
    out.push_str(rest);
    out
}

/// A value and its standard error, to the error's second digit: `89.99 ± 0.12`, `(1.9996 ± 0.0021)×10⁻¹²`.
///
/// Six digits of the value if the error is missing or zero.
pub fn with_error(value: f64, error: f64) -> String {
    let exponent = |x: f64| x.abs().log10().floor() as i32;
    if !(value.is_finite() && error.is_finite() && error > 0.0) {
        return format!("{} ± {}", significant(value, 6), significant(error, 2));
    }
    let largest = exponent(value.abs().max(error));
    let power = if (-3..6).contains(&largest) { 0 } else { largest };
    let scale = 10_f64.powi(-power);
    let decimals = usize::try_from(1 - exponent(error * scale)).unwrap_or(0);
    let both = format!("{} ± {}", fixed(value * scale, decimals), fixed(error * scale, decimals));
    if power == 0 { both } else { format!("({both})×{}", power_of_ten(power)) }
}

/// 10 to the power of `exponent`, in superscript digits.
pub fn power_of_ten(exponent: i32) -> String {
    let mut out = String::from("10");
    for c in exponent.to_string().chars() {
        out.push(match c {
            '-' => '⁻',
            '1' => '¹',
            '2' => '²',
            '3' => '³',
            digit => char::from_u32(0x2070 + u32::from(digit) - 0x30).unwrap_or(digit),
        });
    }
    out
}

/// A drawing's coordinate or length with one decimal, or none if that is zero.
pub fn px(value: f64) -> String {
    let mut out = String::new();
    write!(out, "{value:.1}").expect("writing to a String");
    if out.ends_with(".0") {
        out.truncate(out.len() - 2);
    }
    out
}

fn minus(text: &str) -> String {
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn significant_digits() {
        for (value, shown) in [
            (0.0, "0"),
            (0.1234, "0.123"),
            (9.996, "10.0"),
            (-273.15, "−273"),
            (0.00123, "0.00123"),
            (0.000_123_4, "1.23×10⁻⁴"),
            (101_325.0, "101\u{202f}325"),
            (1.5e9, "1.50×10⁹"),
            (f64::NAN, MISSING),
            (f64::INFINITY, MISSING),
        ] {
            assert_eq!(significant(value, 3), shown);
        }
    }

    /// A run slower than half of real time used to be "0 times real time".
    #[test]
    fn a_slow_run_has_two_digits() {
        for (factor, shown) in
            [(0.0123, "0.012"), (0.314, "0.31"), (1.04, "1.0"), (9.96, "10"), (12_386.4, "12386")]
        {
            assert_eq!(speed(factor), shown);
        }
    }

    #[test]
    fn a_rounded_zero_has_no_sign() {
        assert_eq!(fixed(-0.001, 1), "0.0");
        assert_eq!(fixed(-0.06, 1), "−0.1");
    }

    #[test]
    fn a_value_is_as_long_as_its_error_allows() {
        for (value, error, shown) in [
            (89.994_35, 0.1234, "89.99 ± 0.12"),
            (1.999_6e-12, 2.14e-15, "(1.9996 ± 0.0021)×10⁻¹²"),
            (0.867_8, 0.0161, "0.868 ± 0.016"),
            (-0.02, 3.1, "0.0 ± 3.1"),
            (418_200.0, 1_530.0, "418\u{202f}200 ± 1530"),
            (2.5e9, 1.4e7, "(2.500 ± 0.014)×10⁹"),
            (0.12, 0.0, "0.120000 ± 0"),
            (f64::NAN, 1.0, "– ± 1.0"),
        ] {
            assert_eq!(with_error(value, error), shown);
        }
    }

    #[test]
    fn short_values_end_without_zeros() {
        for (value, shown) in [(10.0, "10"), (0.3, "0.3"), (0.125, "0.125"), (200.0, "200")] {
            assert_eq!(short(value), shown);
        }
    }

    #[test]
    fn units_by_suffix_and_symbol() {
        assert_eq!(Unit::of_column("flow_in_kg_s").symbol, "g/s");
        assert_eq!(Unit::of_column("pressure_pa").symbol, "kPa");
        assert_eq!(Unit::of_column("time_s").symbol, "s");
        assert_eq!(Unit::of_column("volume_m3").symbol, "cm³");
        assert_eq!(Unit::of_column("duty_in"), Unit::NONE);
        assert_eq!(quantity(420_000.0, "Pa"), ("420".into(), "kPa".into()));
        assert_eq!(quantity(299.14, "K"), ("299.1".into(), "K".into()));
        assert_eq!(quantity(20.0, "kg"), ("20.0".into(), "kg".into()));
        assert_eq!(quantity(0.0021, "kg"), ("2.10".into(), "g".into()));
        assert_eq!(quantity(12.0, "strokes"), ("12.0".into(), "strokes".into()));
        // Ten minutes of steps.
        assert_eq!(quantity(600_015.0, COUNT), ("600\u{202f}015".into(), String::new()));
        assert_eq!(quantity(6.0, COUNT), ("6".into(), String::new()));
    }
}
