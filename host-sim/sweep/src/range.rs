//! Ranges of a sweep: `--vary KEY=FROM:TO:COUNT`, `KEY=FROM:TO`, `KEY=A,B,C`.

use super::scenario::Swept;
use serde::Serialize;
use std::fmt;
use std::str::FromStr;
use thermyo_files::input::Problem;
use thermyo_files::number::short;
use thermyo_files::units::Wanted;
use thermyo_report::scale::Spacing;
use thermyo_scenario::joint::{self, Setting};
use thermyo_scenario::schema::{self, Allowed};

/// Largest number of values of one key, and of points of a sweep.
pub const MOST_POINTS: usize = 10_000_000;

/// A key and the values that it takes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Range {
    /// Full path of the key, such as `sensor.gas.time_constant_s`.
    pub key: String,
    /// The values, rising; for words their indices, from 0; for an interval its two ends.
    pub values: Vec<f64>,
    /// The words, for a key without numbers, or for integers with more digits than f64 holds.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub words: Vec<String>,
    /// Whether the values have a fixed ratio, not a fixed difference.
    pub logarithmic: bool,
    /// Whether the range contains everything between its two ends.
    #[serde(skip)]
    pub interval: bool,
    #[serde(skip)]
    written: String,
}

impl Range {
    /// Spacing of the key's axis.
    pub fn spacing(&self) -> Spacing {
        if self.logarithmic { Spacing::Log } else { Spacing::Linear }
    }

    /// The range as written after `--vary`.
    pub fn written(&self) -> &str {
        &self.written
    }

    /// One of the range's values as text: the word, or the shortest text that reads back to the number.
    pub fn text(&self, value: f64) -> String {
        match self.words.get(value as usize) {
            Some(word) => word.clone(),
            None => value.to_string(),
        }
    }

    /// One of the range's values for display: the word, or few digits of the number.
    pub fn shown(&self, value: f64) -> String {
        match self.words[..] {
            [] => short(value),
            _ => self.text(value),
        }
    }

    /// Sets the key to one of the values.
    pub fn set(&self, scenario: &mut Swept, value: f64) -> Result<(), Problem> {
        let setting = match self.words.get(value as usize) {
            Some(word) => Setting::Word(word),
            None => Setting::Number(value),
        };
        scenario.set(&self.key, setting)
    }

    /// Value at a fraction of the range, 0 to below 1; `whole` rounds it to an integer.
    pub fn along(&self, along: f64, whole: bool) -> f64 {
        let [from, to] = match self.values[..] {
            [from, to] if self.interval => [from, to],
            _ => return self.values[(along * self.values.len() as f64) as usize],
        };
        let between = |from: f64, to: f64| match self.logarithmic {
            true => from * (to / from).powf(along),
            false => from + (to - from) * along,
        };
        if whole { between(from, to + 1.0).floor().min(to) } else { rounded(between(from, to)) }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "--vary {}", self.written)
    }
}

/// Reason why a text is no range. Each message states what is allowed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RangeError {
    #[error(
        "must be KEY=FROM:TO:COUNT, or KEY=FROM:TO:COUNT:log for a fixed ratio between values; KEY=A,B,C; or, with \
         --lhs, KEY=FROM:TO or KEY=FROM:TO:log"
    )]
    Form,
    #[error("{0} = \"{1}\": must be {2}")]
    NoNumber(&'static str, String, String),
    /// An integer beyond 2^53, whose neighbours f64 cannot represent.
    #[error(
        "{0} = \"{1}\": has too many digits for a range, beyond 2^53: name each value, KEY=A,B,C"
    )]
    TooManyDigits(&'static str, String),
    #[error("COUNT = \"{0}\": must be a whole number from 1 to {MOST_POINTS}")]
    NoCount(String),
    #[error("COUNT = 1 takes one value: FROM must equal TO")]
    OneValue,
    #[error("FROM must be below TO, or COUNT 1")]
    NotRising,
    #[error("FROM must be above 0 in a logarithmic range")]
    NotPositive,
    #[error("numbers of a list must rise")]
    NotSorted,
    #[error("\"{0}\" is there twice")]
    Repeated(String),
}

impl FromStr for Range {
    type Err = RangeError;

    fn from_str(text: &str) -> Result<Self, RangeError> {
        let (key, range) = text.split_once('=').ok_or(RangeError::Form)?;
        let parts: Vec<&str> = range.split(':').collect();
        let (from, to, count, logarithmic) = match parts[..] {
            [list] => return listed(text, key, list),
            [from, to] => (from, to, None, false),
            [from, to, "log"] => (from, to, None, true),
            [from, to, count] => (from, to, Some(count), false),
            [from, to, count, "log"] => (from, to, Some(count), true),
            _ => return Err(RangeError::Form),
        };
        if key.is_empty() {
            return Err(RangeError::Form);
        }
        let wanted = wanted(key);
        let limit = |name, text: &str| match wanted.read(text) {
            Ok(number) if !keeps(text, number) => {
                Err(RangeError::TooManyDigits(name, text.to_owned()))
            }
            Ok(number) => Ok(number),
            // The unit of an unknown key is unknown: the scenario refuses the key, and suggests the intended one.
            Err(unread) => leading_number(text)
                .filter(|_| allowed(key).is_none())
                .ok_or_else(|| RangeError::NoNumber(name, text.to_owned(), unread.to_string())),
        };
        let (from, to) = (limit("FROM", from)?, limit("TO", to)?);
        let interval = count.is_none();
        let count = match count.map(str::parse::<usize>) {
            None => 2,
            Some(Ok(number)) if (1..=MOST_POINTS).contains(&number) => number,
            Some(_) => return Err(RangeError::NoCount(count.unwrap_or_default().to_owned())),
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
        let (key, written) = (key.to_owned(), text.to_owned());
        let values: Vec<f64> = (0..count).map(value).collect();
        Ok(Self { key, values, words: Vec::new(), logarithmic, interval, written })
    }
}

/// `KEY=A,B,C`: rising numbers, or words.
fn listed(text: &str, key: &str, list: &str) -> Result<Range, RangeError> {
    let parts: Vec<&str> = list.split(',').collect();
    if key.is_empty() || parts.iter().any(|part| part.is_empty()) {
        return Err(RangeError::Form);
    }
    for (i, part) in parts.iter().enumerate() {
        if parts[..i].contains(part) {
            return Err(RangeError::Repeated((*part).to_owned()));
        }
    }
    let number = |part: &&str| {
        let number = wanted(key).read(part).ok();
        number.filter(|number| keeps(part, *number))
    };
    let numbers: Option<Vec<f64>> = parts.iter().map(number).collect();
    let (values, words) = match numbers {
        Some(numbers) => (numbers, Vec::new()),
        None => {
            let places = (0..parts.len()).map(|place| place as f64).collect();
            (places, parts.iter().map(|part| (*part).to_owned()).collect())
        }
    };
    if values.windows(2).any(|pair| pair[0] >= pair[1]) {
        return Err(RangeError::NotSorted);
    }
    let (key, written) = (key.to_owned(), text.to_owned());
    Ok(Range { key, values, words, logarithmic: false, interval: false, written })
}

/// The quantity of a key, for values with a unit; that of a ratio for a key without numbers.
fn wanted(key: &str) -> Wanted {
    match allowed(key) {
        Some(Allowed::Real(limits)) => limits.wanted(),
        _ => Wanted::new(""),
    }
}

/// Allowed values of a key of a muscle's or a joint's scenario.
pub(super) fn allowed(full_path: &str) -> Option<Allowed> {
    let of_muscle = joint::of_muscle(full_path);
    let path = of_muscle.strip_prefix("believed.").unwrap_or(of_muscle);
    let key = schema::key(path).map(|(_, key)| key).or_else(|| joint::key(full_path));
    key.map(|key| key.allowed)
}

/// The number at the start of a text.
fn leading_number(text: &str) -> Option<f64> {
    let end = text.find(|char: char| !"+-.0123456789".contains(char)).unwrap_or(text.len());
    text[..end].parse().ok()
}

/// Whether f64 holds every digit of the number as written; a seed may have more.
fn keeps(text: &str, number: f64) -> bool {
    text.parse::<i128>().map_or(true, |whole| whole == number as i128)
}

/// Rounds to 12 significant digits: 0.3 and not 0.30000000000000004, and the same value on every machine, independent
/// of the last bit of its power function.
fn rounded(value: f64) -> f64 {
    format!("{value:.11e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use thermyo_scenario::Document;

    fn values(text: &str) -> Vec<f64> {
        text.parse::<Range>().unwrap().values
    }

    #[test]
    fn ranges_are_linear_or_logarithmic() {
        assert_eq!(values("a.b=0.1:0.5:5"), [0.1, 0.2, 0.3, 0.4, 0.5]);
        assert_eq!(values("a.b=0.01:100:5:log"), [0.01, 0.1, 1.0, 10.0, 100.0]);
        assert_eq!(values("a.b=3:3:1"), [3.0]);
        assert_eq!(values("a.b=-1:1:3"), [-1.0, 0.0, 1.0]);
        assert_eq!(values("a.b=0.1,0.5,7"), [0.1, 0.5, 7.0]);
    }

    #[test]
    fn values_have_the_units_of_their_key() {
        assert_eq!(values("supply.pressure_pa=4bar:800 kPa:3"), [4e5, 6e5, 8e5]);
        assert_eq!(values("believed.drive.contraction=5%,10%"), [0.05, 0.1]);
        assert_eq!(values("ambient.temperature_k=10degC:20degC"), [283.15, 293.15]);
        assert_eq!(values("joint.radius_m=20mm,3cm"), [0.02, 0.03]);
        assert_eq!(values("joint.b.supply.pressure_pa=4bar,5bar"), [4e5, 5e5]);
        let error = "supply.pressure_pa=4bar:8kg:3".parse::<Range>().unwrap_err().to_string();
        assert!(error.contains("TO = \"8kg\": must be a number in Pa, or one with"), "{error}");
        let range: Range = "supply.pressure_pa=4kg,5kg".parse().unwrap();
        let mut scenario = Swept::Muscle(Document::parse("", "test".as_ref()).unwrap());
        let error = range.set(&mut scenario, 0.0).unwrap_err().to_string();
        assert!(error.contains("= 4kg: must be a number from 1 to 3e6 Pa, or a text"), "{error}");
    }

    #[test]
    fn words_are_values_too() {
        let range: Range = "plant.model=lumped,full".parse().unwrap();
        assert_eq!(range.values, [0.0, 1.0]);
        assert_eq!(range.text(1.0), "full");
        let range: Range = "a.b=1:2:3".parse().unwrap();
        assert_eq!(range.text(1.5), "1.5");
    }

    /// Whole numbers such as seeds.
    #[test]
    fn whole_numbers_keep_every_digit() {
        let range: Range = "run.seed=9007199254740995,9007199254740997".parse().unwrap();
        let mut scenario = Swept::Muscle(Document::parse("", "test".as_ref()).unwrap());
        for (value, seed) in [(0.0, 9_007_199_254_740_995), (1.0, 9_007_199_254_740_997)] {
            range.set(&mut scenario, value).unwrap();
            assert_eq!(scenario.assemble().unwrap().settled_and_seed().1, seed);
        }
        for text in ["run.seed=9007199254740993:9007199254740999:2", "run.seed=1:9007199254740993"]
        {
            let error = text.parse::<Range>().unwrap_err().to_string();
            assert!(
                error.contains("\"9007199254740993\": has too many digits for a range"),
                "{error}"
            );
        }
        for seed in ["9223372036854775808,9223372036854775809", "-1,9007199254740993"] {
            let range: Range = format!("run.seed={seed}").parse().unwrap();
            let error = range.set(&mut scenario, 0.0).unwrap_err().to_string();
            let (first, _) = seed.split_once(',').unwrap();
            assert!(error.starts_with(&format!("run.seed = {first}: must be a whole")), "{error}");
        }
    }

    #[test]
    fn an_interval_has_everything_between_its_ends() {
        let range: Range = "a.b=1:100:log".parse().unwrap();
        assert!(range.interval && range.logarithmic);
        assert_eq!([0.0, 0.5].map(|along| range.along(along, false)), [1.0, 10.0]);
        let range: Range = "a.b=1:4".parse().unwrap();
        assert_eq!([0.0, 0.3, 0.999].map(|along| range.along(along, true)), [1.0, 2.0, 4.0]);
        let range: Range = "a.b=x,y".parse().unwrap();
        assert_eq!(
            [0.0, 0.49, 0.5, 0.99].map(|along| range.along(along, false)),
            [0.0, 0.0, 1.0, 1.0]
        );
    }

    #[test]
    fn invalid_ranges_state_the_allowed_form() {
        for (text, message) in [
            ("a.b", "KEY=FROM:TO:COUNT"),
            ("=1:2:3", "KEY=FROM:TO:COUNT"),
            ("a.b=", "KEY=A,B,C"),
            ("a.b=1,,2", "KEY=A,B,C"),
            ("a.b=2,1", "must rise"),
            ("a.b=x,x", "\"x\" is there twice"),
            ("a.b=x:2:3", "FROM = \"x\": must be a number"),
            ("a.b=1:inf:3", "TO = \"inf\": must be a number"),
            ("a.b=1:2:0", "COUNT = \"0\": must be a whole number from 1"),
            ("a.b=1:2:2.5", "COUNT = \"2.5\""),
            ("a.b=1:2:3:lin", "KEY=FROM:TO:COUNT"),
            ("a.b=1:2:1", "FROM must equal TO"),
            ("a.b=2:1:3", "FROM must be below TO"),
            ("a.b=2:1", "FROM must be below TO"),
            ("a.b=1:1:3", "FROM must be below TO"),
            ("a.b=0:1:3:log", "above 0"),
            ("a.b=0:1:log", "above 0"),
        ] {
            let error = text.parse::<Range>().unwrap_err().to_string();
            assert!(error.contains(message), "{text}: {error}");
        }
    }
}
