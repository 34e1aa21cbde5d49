//! Parts with public figures, by name; `presets.toml` has their values. A key in the file overrides its preset's value.

use super::declare::choice;
use serde::Deserialize;
use std::collections::HashMap;
use std::sync::LazyLock;
use toml::Value;

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Preset {
    /// Table that contains the key `preset`.
    pub table: String,
    pub word: String,
    /// Paths of the preset's values, and the values.
    pub values: Vec<(String, Value)>,
    /// Source, and the part of it that the values leave out.
    pub source: String,
    /// Keys for which there is no source.
    pub unknown: Vec<String>,
}

choice! {
    MusclePreset {
        None = "none",
        Dmsp10 = "dmsp-10",
        Dmsp20 = "dmsp-20",
    }
}

choice! {
    ValvePreset {
        None = "none",
        Mhe2 = "mhe2-class",
        Mhe3 = "mhe3-class",
        Mhe4 = "mhe4-class",
        Mhj10 = "mhj10-class",
    }
}

choice! {
    PressurePreset {
        None = "none",
        Hsc100 = "hsc-100psi-a",
        Hsc150 = "hsc-150psi-a",
        Mpr25 = "mpr-25psi-a",
    }
}

static PRESETS: LazyLock<Vec<Preset>> = LazyLock::new(|| {
    let mut file: HashMap<String, Vec<Preset>> =
        toml::from_str(include_str!("presets.toml")).expect("a test reads it");
    file.remove("preset").unwrap_or_default()
});

impl Preset {
    /// The preset of a table's word; none for "none".
    pub fn of(table: &str, word: &str) -> Option<&'static Self> {
        PRESETS.iter().find(|preset| preset.table == table && preset.word == word)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::key::Allowed;
    use crate::schema;

    #[test]
    fn every_preset_is_a_word_with_values_that_are_allowed() {
        for preset in PRESETS.iter() {
            let (_, key) = schema::key(&format!("{}.preset", preset.table)).unwrap();
            let Allowed::Choice(words) = key.allowed else { panic!("{preset:?}") };
            assert!(words.contains(&preset.word.as_str()), "{preset:?}");
            for (path, value) in &preset.values {
                let (_, key) = schema::key(path).unwrap();
                let allowed = match (key.allowed, value) {
                    (Allowed::Real(limits), Value::Float(number)) => limits.contains(*number),
                    (Allowed::Choice(words), Value::String(word)) => words.contains(&word.as_str()),
                    _ => false,
                };
                assert!(allowed, "{path} = {value:?}");
            }
            assert!(preset.unknown.iter().all(|path| schema::key(path).is_some()), "{preset:?}");
        }
        for (table, words) in [
            ("muscle", MusclePreset::WORDS),
            ("valve", ValvePreset::WORDS),
            ("sensor.pressure", PressurePreset::WORDS),
        ] {
            let found = words.iter().filter(|word| Preset::of(table, word).is_some());
            assert_eq!(found.count(), words.len() - 1, "{table}");
        }
    }
}
