//! Keys of a table: allowed values and meaning.

use std::fmt;
use thermyo_files::units::Wanted;

/// A table of keys, such as `[sensor.gas]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Table {
    pub name: &'static str,
    pub meaning: &'static str,
    /// Whether `[believed]` may overlay the table.
    pub believed: bool,
    /// Whether the table describes the measured object and not the run.
    pub physical: bool,
    pub keys: &'static [Key],
}

impl Table {
    /// Returns a table that is neither believed nor physical.
    pub const fn new(name: &'static str, meaning: &'static str, keys: &'static [Key]) -> Self {
        Self { name, meaning, believed: false, physical: false, keys }
    }

    pub const fn believed(self) -> Self {
        Self { believed: true, ..self }
    }

    pub const fn physical(self) -> Self {
        Self { physical: true, ..self }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key {
    pub name: &'static str,
    pub allowed: Allowed,
    pub meaning: &'static str,
    /// Whether the key is the core's own, in f32.
    pub core: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Allowed {
    /// A finite number; whole numbers are accepted too.
    Real(Limits),
    /// A whole number, both limits included.
    Whole { min: i64, max: i64 },
    /// One of these words.
    Choice(&'static [&'static str]),
    /// Yes or no.
    Switch,
    /// A list of words, which the rules check.
    List,
    /// The path of a CSV file with these columns, relative to the scenario's folder.
    Csv {
        /// Names of the columns; for a profile the times and the values.
        columns: &'static [&'static str],
    },
}

/// A closed range, with its unit; no unit for a ratio.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    pub min: f64,
    pub max: f64,
    pub unit: &'static str,
}

impl Limits {
    /// Whether the value lies within; NaN does not.
    pub fn contains(&self, value: f64) -> bool {
        self.min <= value && value <= self.max
    }

    /// The value as stored, if it is allowed. Numbers so near to zero that some processors flush them become 0, since
    /// the core refuses them.
    pub fn taken(&self, value: f64) -> Option<f64> {
        const SMALLEST: f64 = 1.0e-20;
        let value = if value.abs() < SMALLEST { 0.0 } else { value };
        self.contains(value).then_some(value)
    }

    /// Quantity of a value that has a unit. Only a temperature that cannot be zero is absolute.
    pub fn wanted(&self) -> Wanted {
        Wanted { si: self.unit, absolute: self.min > 0.0 }
    }

    /// The same unit between other limits.
    pub fn between(&self, min: f64, max: f64) -> Self {
        Self { min, max, unit: self.unit }
    }

    /// "0.001 to 1e6". Computed limits are rounded inwards, so that the printed limits are
    /// allowed.
    pub fn range(&self) -> String {
        format!("{} to {}", Rounded::up(self.min), Rounded::down(self.max))
    }
}

impl fmt::Display for Limits {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a number from {}", self.range())?;
        if self.unit.is_empty() { Ok(()) } else { write!(f, " {}", self.unit) }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Real(limits) => limits.fmt(f),
            Self::Whole { min, max } => write!(f, "a whole number from {min} to {max}"),
            Self::Choice(words) => write!(f, "one of {}", Words(words, ", ")),
            Self::Switch => f.write_str("true or false"),
            Self::List => f.write_str("a list of words, [\"...\", \"...\"]"),
            Self::Csv { columns } => {
                write!(f, "the path of a CSV file with the columns {}", columns.join(","))
            }
        }
    }
}

impl Key {
    /// "s, 0.001 to 1e6: simulated time", the comment beside the key's value.
    pub fn comment(&self) -> String {
        let allowed = match self.allowed {
            Allowed::Real(limits) if limits.unit.is_empty() => limits.range(),
            Allowed::Real(limits) => format!("{}, {}", limits.unit, limits.range()),
            Allowed::Whole { min, max } => format!("{min} to {max}"),
            Allowed::Choice(words) => Words(words, " | ").to_string(),
            Allowed::Switch => "true | false".to_owned(),
            Allowed::List => "list of words".to_owned(),
            Allowed::Csv { columns } => format!("CSV file, {}", columns.join(",")),
        };
        format!("{allowed}: {}", self.meaning)
    }
}

/// Quoted words and the text between them.
struct Words<'a>(&'a [&'a str], &'a str);

impl fmt::Display for Words<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, word) in self.0.iter().enumerate() {
            if i > 0 {
                f.write_str(self.1)?;
            }
            write!(f, "\"{word}\"")?;
        }
        Ok(())
    }
}

/// A number of at most six significant digits.
struct Rounded(f64);

impl Rounded {
    fn up(value: f64) -> Self {
        Self(-Self::down(-value).0)
    }

    // Rounds down for a message.
    #[allow(clippy::disallowed_methods)]
    fn down(value: f64) -> Self {
        if value == 0.0 || !value.is_finite() {
            return Self(value);
        }
        let digits = |x: f64| format!("{x:.5e}").parse::<f64>().unwrap_or(x);
        let nearest = digits(value);
        if nearest <= value {
            return Self(nearest);
        }
        let last_digit = 10_f64.powi(value.abs().log10().floor() as i32 - 5);
        Self(digits(nearest - last_digit))
    }
}

impl fmt::Display for Rounded {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (plain, scientific) = (self.0.to_string(), format!("{:e}", self.0));
        let familiar = self.0 == 0.0 || (1e-3..1e5).contains(&self.0.abs());
        f.write_str(if familiar || plain.len() <= scientific.len() { &plain } else { &scientific })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn printed_limits_are_allowed() {
        let limits = Limits { min: 0.188_163_41, max: 2.0 / 3.0, unit: "m" };
        assert_eq!(limits.to_string(), "a number from 0.188164 to 0.666666 m");
        let plain = Limits { min: -1.0e9, max: 0.001, unit: "" };
        assert_eq!(plain.to_string(), "a number from -1e9 to 0.001");
        for x in [1.0 / 3.0, 1e-9 / 7.0, 12_345.678_9, 99_999.999_9, 1e8 / 3.0, 1.0, 9.999_999_9] {
            let (up, down) = (Rounded::up(x).0, Rounded::down(x).0);
            assert!(down <= x && x <= up && (up - down) / x < 3e-5, "{down} {x} {up}");
        }
    }
}
