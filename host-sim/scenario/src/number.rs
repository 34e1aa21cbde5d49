//! Numbers of a scenario by the path of their key.

use super::tables::Scenario;
use toml::{Table, Value};

impl Scenario {
    /// Every table and key.
    ///
    /// # Panics
    /// Never: a scenario is plain TOML.
    pub fn to_table(&self) -> Table {
        Table::try_from(self).expect("a scenario is plain TOML")
    }

    /// The scenario of a tree of tables, with defaults for missing keys. Serde's code for this is large, so it is
    /// compiled once here and not in every crate that reads a scenario.
    ///
    /// # Errors
    /// For an unknown key or a value of another type.
    pub fn from_toml(tree: Value) -> Result<Self, toml::de::Error> {
        tree.try_into()
    }
}

/// The number at a path such as `heat.inner_w_m2_k`.
pub fn number(scenario: &Scenario, path: &str) -> Option<f64> {
    let tree = Value::Table(scenario.to_table());
    path.split('.').try_fold(&tree, |place, name| place.get(name))?.as_float()
}

/// The scenario with these numbers at these paths.
///
/// # Panics
/// If a path is no number of every scenario.
pub fn with_numbers<'a>(
    scenario: &Scenario,
    numbers: impl IntoIterator<Item = (&'a str, f64)>,
) -> Scenario {
    let mut tree = Value::Table(scenario.to_table());
    for (path, number) in numbers {
        match path.split('.').try_fold(&mut tree, |place, name| place.get_mut(name)) {
            Some(place @ Value::Float(_)) => *place = Value::Float(number),
            _ => panic!("{path} is no number of a scenario"),
        }
    }
    Scenario::from_toml(tree).expect("numbers were replaced by numbers")
}

/// The shortest number that equals this one in f32.
pub fn short(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_and_replaced_by_path() {
        let scenario = Scenario::default();
        assert_eq!(number(&scenario, "sensor.gas.time_constant_s"), Some(3.0));
        assert_eq!(number(&scenario, "sensor.gas.none"), None);
        assert_eq!(number(&scenario, "plant.kind"), None);
        let changed = with_numbers(&scenario, [("sensor.gas.time_constant_s", 4.5)]);
        let mut expected = scenario;
        expected.sensor.gas.time_constant_s = 4.5;
        assert_eq!(changed, expected);
    }
    /// A mistyped path would otherwise leave the value unchanged without a message.
    #[test]
    fn a_path_of_no_number_is_refused() {
        for path in ["run", "plant.kind", "sensor.gas.time_constant", ""] {
            let replaced = || with_numbers(&Scenario::default(), [(path, 1.0)]);
            assert!(std::panic::catch_unwind(replaced).is_err(), "{path}");
        }
    }
}
