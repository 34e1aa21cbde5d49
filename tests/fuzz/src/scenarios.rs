//! Scenario files: random text, and text made of valid keys.

use crate::any::{self, Choices, byte};
use arbitrary::Unstructured;
use model_core::Core;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;
use thermyo_files::input::InputError;
use thermyo_scenario::schema::{Allowed, Key, TABLES, Table, fittable_paths};
use thermyo_setup::core_config::core_config;
use thermyo_setup::{Loaded, OBSERVABLE};

const MOST_KEYS: usize = 24;
/// A folder that does not exist, so that no CSV file is found.
const ORIGIN: &str = "nowhere/scenario.toml";

/// Loads a scenario; returns 1.
pub fn run(bytes: &[u8]) -> u64 {
    let mut bytes = Unstructured::new(bytes);
    let text = match byte(&mut bytes) % 4 {
        0 => String::from_utf8_lossy(bytes.take_rest()).into_owned(),
        _ => made(&mut bytes),
    };
    match thermyo_setup::parse(&text, Path::new(ORIGIN)) {
        Ok(loaded) => loads(&loaded, &text),
        Err(error) => assert_names_place(&error, ORIGIN),
    }
    1
}

/// Checks that the core accepts a loaded scenario, and that printing preserves it.
fn loads(loaded: &Loaded, text: &str) {
    for side in [&loaded.plant, &loaded.believed] {
        if let Err(error) = Core::new(&core_config(side)) {
            panic!("the core does not take what is loaded: {error}\n{text}");
        }
    }
    let printed = thermyo_setup::render(loaded);
    match thermyo_setup::parse(&printed, Path::new(ORIGIN)) {
        Ok(again) => assert_eq!(&again, loaded, "what is printed is another:\n{text}"),
        Err(error) => panic!("what is printed is refused: {error}\n{text}"),
    }
}

/// Asserts that the message is one line that begins with the file.
pub fn assert_names_place(error: &InputError, file: &str) {
    let message = error.to_string();
    let rest = message.strip_prefix(file).and_then(|rest| rest.strip_prefix(':'));
    assert!(rest.is_some_and(|rest| rest.len() > 4), "names no file: {message:?}");
    assert!(!message.contains(char::is_control), "more than one line: {message:?}");
    assert!(message.len() < 4000, "{} bytes: {message}", message.len());
}

/// A scenario of the repository, or none, with some keys changed.
fn made(bytes: &mut Unstructured) -> String {
    static SHIPPED: LazyLock<Vec<BTreeMap<String, String>>> = LazyLock::new(|| {
        [
            "",
            include_str!("../../../scenarios/reproduce.toml"),
            include_str!("../../../scenarios/sensor.toml"),
            include_str!("../../../scenarios/air_discharge.toml"),
            include_str!("../../../scenarios/gas_spring.toml"),
        ]
        .map(flat)
        .into()
    });
    static KEYS: LazyLock<Vec<(&Table, &Key)>> = LazyLock::new(|| {
        TABLES.iter().flat_map(|table| table.keys.iter().map(move |key| (table, key))).collect()
    });
    let mut lines = any::one_of(bytes, &SHIPPED).clone();
    for _ in 0..MOST_KEYS {
        if bytes.is_empty() {
            break;
        }
        let (table, key) = any::one_of(bytes, &KEYS);
        let path = match byte(bytes) {
            // Also keys that `[believed]` does not allow.
            0..64 => format!("believed.{}.{}", table.name, key.name),
            64..80 if table.name == "faults" => format!("faults.later.{}", key.name),
            80..84 => format!("{}.{}x", table.name, key.name),
            84..86 => table.name.to_owned(),
            _ => format!("{}.{}", table.name, key.name),
        };
        lines.insert(path, value(bytes, &key.allowed));
    }
    lines.iter().map(|(path, value)| format!("{path} = {value}\n")).collect()
}

/// Path and value of every key as written.
fn flat(text: &str) -> BTreeMap<String, String> {
    fn add(lines: &mut BTreeMap<String, String>, path: &str, value: &toml::Value) {
        match value {
            toml::Value::Table(table) => {
                for (name, value) in table {
                    let separator = if path.is_empty() { "" } else { "." };
                    add(lines, &format!("{path}{separator}{name}"), value);
                }
            }
            _ => drop(lines.insert(path.to_owned(), value.to_string())),
        }
    }
    let mut lines = BTreeMap::new();
    add(&mut lines, "", &toml::Value::Table(text.parse().expect("it is shipped")));
    lines
}

fn value(bytes: &mut Unstructured, allowed: &Allowed) -> String {
    const WRONG: [&str; 12] = [
        "nan",
        "-inf",
        "\"\"",
        "[]",
        "{}",
        "true",
        "1e999",
        "1979-05-27",
        "-1",
        "0",
        "1",
        "'\\n\u{7f}'",
    ];
    if byte(bytes) % 16 == 15 {
        return (*any::one_of(bytes, &WRONG)).to_owned();
    }
    match *allowed {
        Allowed::Real(limits) => {
            let share = bytes.whole(16) as f64 / 65_535.0;
            let number = match byte(bytes) % 8 {
                0 => limits.min,
                1 => limits.max,
                2 => limits.min + (limits.max - limits.min) * share,
                3..=6 => {
                    let least = limits.min.max(limits.max * 1e-12);
                    (least * (limits.max / least).powf(share)).clamp(limits.min, limits.max)
                }
                _ => f64::from_bits(bytes.whole(64)),
            };
            format!("{number:?}").replace("NaN", "nan")
        }
        Allowed::Whole { min, max } => match byte(bytes) % 8 {
            0 => min.to_string(),
            1 => max.to_string(),
            2..=6 => min
                .saturating_add(bytes.whole(16) as i64 % max.saturating_sub(min).max(1))
                .to_string(),
            _ => (bytes.whole(64) as i64).to_string(),
        },
        Allowed::Choice(words) => format!("{:?}", any::one_of(bytes, words)),
        Allowed::Switch => (bytes.one_of(2) == 0).to_string(),
        Allowed::List => {
            let known: Vec<String> =
                OBSERVABLE.iter().map(|name| (*name).to_owned()).chain(fittable_paths()).collect();
            let words: Vec<String> =
                (0..byte(bytes) % 4).map(|_| format!("{:?}", any::one_of(bytes, &known))).collect();
            format!("[{}]", words.join(", "))
        }
        Allowed::Csv { .. } => "\"absent.csv\"".to_owned(),
    }
}
