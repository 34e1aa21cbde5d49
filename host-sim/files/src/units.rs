//! Units: one table of the quantities, with the unit in which each is displayed and the units in
//! which people may write it.

use std::fmt;

/// Display of an SI unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unit {
    /// Symbol of the displayed unit; empty if dimensionless.
    pub symbol: &'static str,
    /// Displayed value per SI value.
    pub factor: f64,
}

/// Conversion of a written value to SI.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Scale {
    /// Times ten to this power, without a rounding error.
    Ten(i32),
    Times(f64),
    /// An absolute temperature: times the first, plus the second.
    From(f64, f64),
}

use Scale::{From, Ten, Times};

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Quantity {
    /// Suffix of its keys and columns; empty for a ratio.
    suffix: &'static str,
    /// SI symbol, as in the keys' declarations.
    pub si: &'static str,
    shown: &'static str,
    /// Units that may be written, the SI unit first.
    written: &'static [(&'static str, Scale)],
}

/// Pounds per square inch \[Pa\]: 0.453 592 37 kg times 9.806 65 m/s2 over (0.0254 m)^2.
const PSI_PA: f64 = 6_894.757_293_168_361;
/// 0 degrees Celsius \[K\].
const CELSIUS_K: f64 = 273.15;
/// 0 degrees Fahrenheit \[K\].
const FAHRENHEIT_K: f64 = 459.67 * 5.0 / 9.0;

/// The quantities. A longer suffix comes before any suffix that it ends with.
const QUANTITIES: [Quantity; 31] = [
    row("_w_m2_k", "W/(m2 K)", "W/(m² K)", &[("W/(m² K)", Ten(0))]),
    row(
        "_m3_s_pa",
        "m3/(s Pa)",
        "m³/(s Pa)",
        &[("m³/(s Pa)", Ten(0)), ("l/(s bar)", Ten(-8)), ("dm³/(s bar)", Ten(-8))],
    ),
    row("_pa_s_kg", "Pa s/kg", "Pa s/kg", &[("Pa s/kg", Ten(0))]),
    row("_kg_m2", "kg m2", "kg m²", &[("kg m²", Ten(0))]),
    row("_n_m_rad", "N m/rad", "N m/rad", &[("N m/rad", Ten(0))]),
    row("_j_kg_k", "J/(kg K)", "J/(kg K)", &[("J/(kg K)", Ten(0))]),
    row("_kg_s", "kg/s", "g/s", &[("kg/s", Ten(0)), ("g/s", Ten(-3)), ("mg/s", Ten(-6))]),
    row("_n_s_m", "N s/m", "N s/m", &[("N s/m", Ten(0))]),
    row("_n_m_s", "N/(m s)", "N/(m s)", &[("N/(m s)", Ten(0))]),
    row("_per_k", "1/K", "1/K", &[("1/K", Ten(0)), ("%/K", Ten(-2))]),
    row("_pa_s", "Pa/s", "Pa/s", &[("Pa/s", Ten(0)), ("kPa/s", Ten(3)), ("bar/s", Ten(5))]),
    row("_j_k", "J/K", "J/K", &[("J/K", Ten(0))]),
    row("_w_k", "W/K", "W/K", &[("W/K", Ten(0))]),
    row("_n_m", "N/m", "N/m", &[("N/m", Ten(0)), ("N/mm", Ten(3))]),
    row("_m_s", "m/s", "mm/s", &[("m/s", Ten(0)), ("mm/s", Ten(-3))]),
    row("_k_s", "K/s", "K/s", &[("K/s", Ten(0))]),
    row("_deg", "deg", "°", &[("°", Ten(0)), ("rad", Times(180.0 / std::f64::consts::PI))]),
    row("_rad", "rad", "rad", &[("rad", Ten(0)), ("°", Times(std::f64::consts::PI / 180.0))]),
    row("_ohm", "ohm", "ohm", &[("ohm", Ten(0)), ("kohm", Ten(3))]),
    row(
        "_m3",
        "m3",
        "cm³",
        &[("m³", Ten(0)), ("l", Ten(-3)), ("ml", Ten(-6)), ("cm³", Ten(-6)), ("mm³", Ten(-9))],
    ),
    row("_m2", "m2", "cm²", &[("m²", Ten(0)), ("cm²", Ten(-4)), ("mm²", Ten(-6))]),
    row("_kg", "kg", "g", &[("kg", Ten(0)), ("g", Ten(-3)), ("mg", Ten(-6))]),
    row(
        "_pa",
        "Pa",
        "kPa",
        &[
            ("Pa", Ten(0)),
            ("kPa", Ten(3)),
            ("MPa", Ten(6)),
            ("bar", Ten(5)),
            ("mbar", Ten(2)),
            ("psi", Times(PSI_PA)),
        ],
    ),
    row("_hz", "Hz", "Hz", &[("Hz", Ten(0)), ("kHz", Ten(3))]),
    row("_m", "m", "mm", &[("m", Ten(0)), ("cm", Ten(-2)), ("mm", Ten(-3)), ("um", Ten(-6))]),
    row(
        "_k",
        "K",
        "K",
        &[("K", Ten(0)), ("degC", From(1.0, CELSIUS_K)), ("degF", From(5.0 / 9.0, FAHRENHEIT_K))],
    ),
    row(
        "_s",
        "s",
        "s",
        &[
            ("s", Ten(0)),
            ("ms", Ten(-3)),
            ("us", Ten(-6)),
            ("min", Times(60.0)),
            ("h", Times(3600.0)),
        ],
    ),
    row("_n", "N", "N", &[("N", Ten(0)), ("kN", Ten(3))]),
    row("_j", "J", "J", &[("J", Ten(0))]),
    row("_w", "W", "W", &[("W", Ten(0))]),
    row("", "", "", &[("", Ten(0)), ("%", Ten(-2))]),
];

const fn row(
    suffix: &'static str,
    si: &'static str,
    shown: &'static str,
    written: &'static [(&'static str, Scale)],
) -> Quantity {
    Quantity { suffix, si, shown, written }
}

/// The SI symbol of a key or trace column, by its suffix; empty for a ratio.
pub fn si_of_column(name: &str) -> &'static str {
    QUANTITIES.iter().find(|row| name.ends_with(row.suffix)).map_or("", |row| row.si)
}

impl Unit {
    /// No unit and no conversion.
    pub const NONE: Self = Self { symbol: "", factor: 1.0 };

    /// The unit of a key or trace column, by its suffix: `pressure_pa` is displayed in kPa.
    pub fn of_column(name: &str) -> Self {
        QUANTITIES.iter().find(|row| name.ends_with(row.suffix)).map_or(Self::NONE, Quantity::unit)
    }

    /// The displayed unit of an SI symbol, if there is one.
    pub(crate) fn of_si(symbol: &str) -> Option<Self> {
        QUANTITIES.iter().find(|row| row.si == symbol && !symbol.is_empty()).map(Quantity::unit)
    }

    pub fn convert(self, values: &[f64]) -> Vec<f64> {
        values.iter().map(|v| v * self.factor).collect()
    }
}

/// The units in which a command prints its figures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum UnitSystem {
    /// kPa, mm, g/s, %, degC.
    #[default]
    Practical,
    Si,
}

impl UnitSystem {
    /// Symbol and scale of the unit in which a value of this SI unit is printed.
    fn unit(self, si: &'static str) -> (&'static str, Scale) {
        let row = QUANTITIES.iter().find(|row| row.si == si);
        match (self, row) {
            (Self::Practical, _) if si == "K" => ("degC", From(1.0, CELSIUS_K)),
            (Self::Practical, _) if si.is_empty() => ("%", Ten(-2)),
            (Self::Practical, Some(row)) => {
                let written = row.written.iter().find(|(symbol, _)| *symbol == row.shown);
                written.copied().unwrap_or((si, Ten(0)))
            }
            _ => (si, Ten(0)),
        }
    }

    /// The number without its unit. `decimals` applies to the practical unit; SI gets as many as
    /// show the same digits. A temperature is absolute.
    pub fn number(self, value: f64, si: &'static str, decimals: usize) -> String {
        let (_, practical) = Self::Practical.unit(si);
        let (_, scale) = self.unit(si);
        let decimals = match (self, practical) {
            (Self::Si, Ten(power)) => usize::try_from(decimals as i32 - power).unwrap_or(0),
            _ => decimals,
        };
        let value = match scale {
            Ten(power) => value * 10_f64.powi(-power),
            Times(times) => value / times,
            From(times, zero) => (value - zero) / times,
        };
        format!("{value:.decimals$}")
    }

    /// The number with its unit: "158.94 kPa", "25.08 degC"; in SI "158940 Pa", "298.23 K".
    pub fn text(self, value: f64, si: &'static str, decimals: usize) -> String {
        format!("{} {}", self.number(value, si, decimals), self.symbol(si)).trim_end().to_owned()
    }

    /// Two numbers with their unit: "120.0 to 273.3 kPa".
    pub fn range(self, [least, most]: [f64; 2], si: &'static str, decimals: usize) -> String {
        format!("{} to {}", self.number(least, si, decimals), self.text(most, si, decimals))
    }

    pub fn symbol(self, si: &'static str) -> String {
        plain(self.unit(si).0)
    }
}

impl Quantity {
    fn unit(&self) -> Unit {
        let scale = self.written.iter().find(|(symbol, _)| *symbol == self.shown);
        match scale {
            Some((_, Ten(power))) => Unit { symbol: self.shown, factor: 10_f64.powi(-power) },
            _ => Unit { symbol: self.shown, factor: 1.0 },
        }
    }
}

/// The quantity that a text has to state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wanted {
    /// SI symbol; empty for a ratio.
    pub si: &'static str,
    /// Whether a temperature is absolute, and may be written in degC; otherwise it is a difference.
    pub absolute: bool,
}

impl Wanted {
    pub const fn new(si: &'static str) -> Self {
        Self { si, absolute: true }
    }

    /// The SI value of a number with its unit, such as `1.3 bar` or `5%`. A number without a unit
    /// is SI.
    ///
    /// # Errors
    /// [`Unread`] for another dimension, an unknown unit or no number.
    pub fn read(self, text: &str) -> Result<f64, Unread> {
        match text.trim().parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            Ok(_) => Err(Unread(self)),
            Err(_) => self.read_with_unit(text),
        }
    }

    /// As [`Self::read`], but the unit is required.
    pub fn read_with_unit(self, text: &str) -> Result<f64, Unread> {
        let (number, unit) = split(text.trim());
        let unit = plain(unit);
        let named = self.units().find(|(symbol, _)| !unit.is_empty() && plain(symbol) == unit);
        let value = match named {
            Some((_, Ten(power))) => times_ten(number, power),
            Some((_, Times(times))) => number.parse().ok().map(|value: f64| value * times),
            Some((_, From(times, zero))) => {
                number.parse().ok().map(|value: f64| value * times + zero)
            }
            None => None,
        };
        value.filter(|value| value.is_finite()).ok_or(Unread(self))
    }

    /// Units that may be written for this quantity. A set point is of one quantity or another ("Pa
    /// or 1"): other keys decide which, and limit the value.
    fn units(self) -> impl Iterator<Item = (&'static str, Scale)> {
        let of_one = |si: &'static str| {
            let si = if si == "1" { "" } else { si };
            let row = QUANTITIES.iter().find(|row| row.si == si);
            let own = row.is_none().then_some((si, Ten(0)));
            row.map_or(&[][..], |row| row.written).iter().copied().chain(own)
        };
        let units = self.si.split(" or ").flat_map(of_one);
        units.filter(move |(_, scale)| self.absolute || !matches!(scale, From(..)))
    }

    /// The units that may be written, as typed: "Pa, kPa, bar".
    pub fn names(self) -> String {
        let names = self.units().map(|(symbol, _)| plain(symbol));
        names.filter(|name| !name.is_empty()).collect::<Vec<_>>().join(", ")
    }
}

/// A text that states no value of the wanted quantity. Its `Display` is the rest of "must be ".
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unread(Wanted);

impl fmt::Display for Unread {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(wanted) = self;
        let (si, names) = (wanted.si, wanted.names());
        match si {
            "" => write!(f, "a number, or one with {names}"),
            _ if plain(si) == names => write!(f, "a number in {si}"),
            _ => write!(f, "a number in {si}, or one with its unit: {names}"),
        }
    }
}

/// Names of the units that may be written for an SI symbol, with factor and zero to SI, for the
/// scripts of a page.
pub fn script(symbols: &[&'static str]) -> String {
    let mut text =
        String::from("// Units by SI symbol: name, SI value of one, SI value of zero.\n");
    text += "export default {";
    for si in symbols {
        text += &format!("\"{si}\":[");
        for (symbol, scale) in Wanted::new(si).units() {
            let (times, zero) = match scale {
                Ten(power) => (10_f64.powi(power), 0.0),
                Times(times) => (times, 0.0),
                From(times, zero) => (times, zero),
            };
            text += &format!("[\"{}\",{times:?},{zero:?}],", plain(symbol));
        }
        text += "],";
    }
    text + "};\n"
}

fn split(text: &str) -> (&str, &str) {
    let is_number = |(_, c): &(usize, char)| !(c.is_ascii_digit() || "+-.eE".contains(*c));
    let end = text.char_indices().find(is_number).map_or(text.len(), |(at, _)| at);
    let number = text[..end].trim_end_matches(['e', 'E']);
    (number, text[number.len()..].trim())
}

/// The number times ten to this power, as precise as an `f64` allows.
fn times_ten(number: &str, power: i32) -> Option<f64> {
    let (digits, exponent) = match number.split_once(['e', 'E']) {
        Some((digits, exponent)) => (digits, exponent.parse::<i32>().ok()?),
        None => (number, 0),
    };
    format!("{digits}e{}", exponent.checked_add(power)?).parse().ok()
}

/// A symbol as typed: cm3, degC.
fn plain(symbol: &str) -> String {
    let symbol = symbol.replace("°C", "degC").replace("°F", "degF").replace('°', "deg");
    symbol.replace('²', "2").replace('³', "3").replace(['µ', 'μ'], "u")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn values_are_read_in_the_units_of_their_quantity() {
        for (text, si, value) in [
            ("1.3bar", "Pa", 130_000.0),
            ("150 kPa", "Pa", 150_000.0),
            ("130000", "Pa", 130_000.0),
            ("1.3e5", "Pa", 130_000.0),
            ("1.3e2 kPa", "Pa", 130_000.0),
            (" 5 % ", "", 0.05),
            ("35%", "", 0.35),
            ("25 degC", "K", 298.15),
            ("25°C", "K", 298.15),
            ("77 degF", "K", 298.15),
            ("30mm", "m", 0.03),
            ("-0.5 mm", "m", -0.0005),
            ("2Hz", "Hz", 2.0),
            ("6 cm³", "m3", 6e-6),
            ("6 cm3", "m3", 6e-6),
            ("2 l/(s bar)", "m3/(s Pa)", 2e-8),
            ("20 ms", "s", 0.02),
            ("3 furlong", "furlong", 3.0),
        ] {
            let read = Wanted::new(si).read(text).unwrap();
            assert!((read - value).abs() <= 1e-12 * value.abs(), "{text}: {read}");
        }
        assert_eq!(Wanted::new("Pa").read("14.5 psi").unwrap().round(), 99_974.0);
    }

    #[test]
    fn another_dimension_gets_the_units_that_are_allowed() {
        let error = |text, si| Wanted::new(si).read(text).unwrap_err().to_string();
        let pressures = "a number in Pa, or one with its unit: Pa, kPa, MPa, bar, mbar, psi";
        for text in ["5 kg", "bar", "", "1,3 bar", "1.3 Bar", "inf", "nan", "1.3 bar kPa", "--1 Pa"]
        {
            assert_eq!(error(text, "Pa"), pressures, "{text}");
        }
        assert_eq!(error("5 bar", ""), "a number, or one with %");
        assert_eq!(error("5 bar", "J/K"), "a number in J/K");
        let difference = Wanted { si: "K", absolute: false };
        let unread = difference.read("25 degC").unwrap_err();
        assert_eq!(unread.to_string(), "a number in K", "a difference has no zero");
        assert!(Wanted::new("Pa").read_with_unit("130000").is_err());
    }

    #[test]
    fn a_set_point_may_have_the_units_of_its_quantities() {
        let set_point = Wanted::new("Pa or 1");
        for (text, value) in [("5 %", 0.05), ("1.3bar", 130_000.0), ("1 MPa", 1e6), ("0.1", 0.1)] {
            assert_eq!(set_point.read(text), Ok(value), "{text}");
        }
        assert_eq!(set_point.names(), "Pa, kPa, MPa, bar, mbar, psi, %");
    }

    #[test]
    fn figures_are_printed_in_practical_units_or_in_si() {
        for (value, si, decimals, practical, in_si) in [
            (158_943.2, "Pa", 2, "158.94 kPa", "158943 Pa"),
            (0.268_42, "m", 1, "268.4 mm", "0.2684 m"),
            (298.23, "K", 2, "25.08 degC", "298.23 K"),
            (0.052_1, "", 1, "5.2 %", "0.052"),
            (3.6e-4, "kg/s", 3, "0.360 g/s", "0.000360 kg/s"),
            (2.0, "s", 1, "2.0 s", "2.0 s"),
        ] {
            assert_eq!(UnitSystem::Practical.text(value, si, decimals), practical);
            assert_eq!(UnitSystem::Si.text(value, si, decimals), in_si);
        }
        let range = UnitSystem::Practical.range([296.4, 326.6], "K", 1);
        assert_eq!(range, "23.2 to 53.5 degC");
    }

    #[test]
    fn shown_units_are_units_that_may_be_written() {
        for row in &QUANTITIES {
            assert!(row.written.iter().any(|(symbol, _)| *symbol == row.shown), "{row:?}");
            assert!(matches!(row.written[0], (_, Ten(0))), "{row:?}");
        }
        for (i, row) in QUANTITIES.iter().enumerate() {
            let earlier = QUANTITIES[..i].iter().find(|one| row.suffix.ends_with(one.suffix));
            assert_eq!(earlier, None, "{row:?} is never found");
        }
    }

    #[test]
    fn a_script_has_the_table() {
        let text = script(&["Pa", "K"]);
        assert!(text.contains("\"Pa\":[[\"Pa\",1.0,0.0],[\"kPa\",1000.0,0.0],"), "{text}");
        assert!(text.contains("[\"degC\",1.0,273.15],"), "{text}");
    }

    proptest! {
        #[test]
        fn any_number_is_read_back_in_any_unit(value in -1e9_f64..1e9, row in 0..QUANTITIES.len()) {
            let Quantity { si, written, .. } = QUANTITIES[row];
            for (symbol, scale) in written.iter().filter(|(symbol, _)| !symbol.is_empty()) {
                let expected = match scale {
                    Ten(power) => value * 10_f64.powi(*power),
                    Times(times) => value * times,
                    From(times, zero) => value * times + zero,
                };
                let read = Wanted::new(si).read(&format!("{value} {symbol}")).unwrap();
                prop_assert!((read - expected).abs() <= 1e-9 * expected.abs().max(1e-12));
            }
        }

        #[test]
        fn no_text_breaks_the_reader(text in "\\PC*") {
            let _ = Wanted::new("Pa").read(&text);
        }
    }
}
