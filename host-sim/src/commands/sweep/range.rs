//! What a sweep varies: `--vary KEY=FROM:TO:COUNT`.

use crate::report::scale::Spacing;
use serde::Serialize;
use std::fmt;
use std::str::FromStr;

/// Most values of one key, and most points of a grid.
pub const MOST_POINTS: usize = 10_000;

/// A key and the values that it takes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Range {
    /// Whole path of the key, such as `sensor.gas.time_constant_s`.
    pub key: String,
    /// The values, rising.
    pub values: Vec<f64>,
    /// Whether they are a fixed ratio apart, and not a fixed difference.
    pub logarithmic: bool,
    /// As the user wrote it.
    #[serde(skip)]
    written: String,
}

impl Range {
    /// How the key's axis is drawn.
    pub fn spacing(&self) -> Spacing {
        if self.logarithmic { Spacing::Log } else { Spacing::Linear }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "--vary {}", self.written)
    }
}

/// Why a text is no range. Each says what is allowed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RangeError {
    /// The parts are not all there.
    #[error("must be KEY=FROM:TO:COUNT, or KEY=FROM:TO:COUNT:log for a fixed ratio between values")]
    Form,
    /// A limit is no number.
    #[error("{0} = \"{1}\": must be a number")]
    NoNumber(&'static str, String),
    /// The count is none.
    #[error("COUNT = \"{0}\": must be a whole number from 1 to {MOST_POINTS}")]
    NoCount(String),
    /// One value between different limits.
    #[error("COUNT = 1 takes one value: FROM must equal TO")]
    OneValue,
    /// Several values between limits that do not rise.
    #[error("FROM must be below TO, or COUNT 1")]
    NotRising,
    /// No ratio leads from one limit to the other.
    #[error("FROM must be above 0 in a logarithmic range")]
    NotPositive,
}

impl FromStr for Range {
    type Err = RangeError;

    fn from_str(text: &str) -> Result<Self, RangeError> {
        let (key, range) = text.split_once('=').ok_or(RangeError::Form)?;
        let parts: Vec<&str> = range.split(':').collect();
        let (from, to, count, logarithmic) = match parts[..] {
            [from, to, count] => (from, to, count, false),
            [from, to, count, "log"] => (from, to, count, true),
            _ => return Err(RangeError::Form),
        };
        if key.is_empty() {
            return Err(RangeError::Form);
        }
        let limit = |name, text: &str| match text.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(RangeError::NoNumber(name, text.to_owned())),
        };
        let (from, to) = (limit("FROM", from)?, limit("TO", to)?);
        let count = match count.parse::<usize>() {
            Ok(number) if (1..=MOST_POINTS).contains(&number) => number,
            _ => return Err(RangeError::NoCount(count.to_owned())),
        };
        if count == 1 && from != to {
            return Err(RangeError::OneValue);
        }
        if count > 1 && from >= to {
            return Err(RangeError::NotRising);
        }
        if logarithmic && from <= 0.0 {
            return Err(RangeError::NotPositive);
        }
        let value = |i: usize| {
            let along = i as f64 / (count.max(2) - 1) as f64;
            match i {
                0 => from,
                _ if i + 1 == count => to,
                _ if logarithmic => rounded(from * (to / from).powf(along)),
                _ => rounded(from + (to - from) * along),
            }
        };
        let values: Vec<f64> = (0..count).map(value).collect();
        Ok(Self { key: key.to_owned(), values, logarithmic, written: text.to_owned() })
    }
}

/// To 12 significant digits: 0.3 and not 0.30000000000000004, and the same value on every machine,
/// whatever the last bit of its power function.
fn rounded(value: f64) -> f64 {
    format!("{value:.11e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(text: &str) -> Vec<f64> {
        text.parse::<Range>().unwrap().values
    }

    #[test]
    fn ranges_are_linear_or_logarithmic() {
        assert_eq!(values("a.b=0.1:0.5:5"), [0.1, 0.2, 0.3, 0.4, 0.5]);
        assert_eq!(values("a.b=0.01:100:5:log"), [0.01, 0.1, 1.0, 10.0, 100.0]);
        assert_eq!(values("a.b=3:3:1"), [3.0]);
        assert_eq!(values("a.b=-1:1:3"), [-1.0, 0.0, 1.0]);
    }

    #[test]
    fn what_is_no_range_says_what_would_be() {
        for (text, message) in [
            ("a.b", "KEY=FROM:TO:COUNT"),
            ("=1:2:3", "KEY=FROM:TO:COUNT"),
            ("a.b=1:2", "KEY=FROM:TO:COUNT"),
            ("a.b=1:2:3:lin", "KEY=FROM:TO:COUNT"),
            ("a.b=x:2:3", "FROM = \"x\": must be a number"),
            ("a.b=1:inf:3", "TO = \"inf\": must be a number"),
            ("a.b=1:2:0", "COUNT = \"0\": must be a whole number from 1"),
            ("a.b=1:2:2.5", "COUNT = \"2.5\""),
            ("a.b=1:2:1", "FROM must equal TO"),
            ("a.b=2:1:3", "FROM must be below TO"),
            ("a.b=1:1:3", "FROM must be below TO"),
            ("a.b=0:1:3:log", "above 0"),
        ] {
            let error = text.parse::<Range>().unwrap_err().to_string();
            assert!(error.contains(message), "{text}: {error}");
        }
    }
}
