//! The inverse of [`JointLoaded::config`]: finds a scenario for a configuration of the core, such as a board's.

use crate::load::{JointLoaded, parse};
use crate::render::render;
use model_core::joint::{AnglePart, JointConfig};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Number, Value};
use std::path::Path;
use thermyo_files::input::{InputError, Problem};
use thermyo_scenario::joint::{AngleKind, Joint, JointDrive};
use thermyo_scenario::short;
use thermyo_setup::from_config;

/// The scenario of a joint that gives this configuration.
///
/// # Errors
/// For a configuration that no scenario can give.
pub fn to_scenario(config: &JointConfig) -> Result<JointLoaded, InputError> {
    let origin = Path::new("the board's configuration");
    let [a, b] = &config.muscles;
    let muscle = |config| from_config::to_scenario(config).map(|found| found.scenario);
    let sensor_kind = match config.angle_part {
        AnglePart::Potentiometer => AngleKind::Potentiometer,
        AnglePart::As5600 => AngleKind::As5600,
        _ => return Err(InputError::file(origin, other_sensor())),
    };
    let joint = Joint { sensor_kind, ..table(&config.mechanism, origin)? };
    let drive: JointDrive = table(&Map::new(), origin)?;
    let written = render(&JointLoaded {
        muscles: [muscle(a)?, muscle(b)?],
        believed: joint.clone(),
        joint,
        rows: None,
        controller: table(&config.tuning, origin)?,
        drive,
        profile: None,
        load: None,
    });
    let found = parse(&written, origin)?;
    let lengths = |config: &JointConfig| config.muscles.map(|muscle| muscle.sensors.length);
    if lengths(&found.config()) == lengths(config) {
        Ok(found)
    } else {
        Err(InputError::file(origin, other_length()))
    }
}

fn other_length() -> Problem {
    Problem::NotAllowed {
        key: "joint.b.sensor.length".to_owned(),
        value: "another than that of muscle a".to_owned(),
        allowed: "the same, to be written as a scenario: a joint has one sensor of its angle"
            .to_owned(),
    }
}

fn other_sensor() -> Problem {
    Problem::NotAllowed {
        key: "joint.sensor_kind".to_owned(),
        value: "another".to_owned(),
        allowed: "\"potentiometer\" or \"as5600\", to be written as a scenario".to_owned(),
    }
}

/// A table of the scenario with the core's values, each in the shortest form that reads back to the same value.
fn table<T: DeserializeOwned>(values: &impl Serialize, origin: &Path) -> Result<T, InputError> {
    let read = || -> serde_json::Result<T> {
        let Value::Object(values) = serde_json::to_value(values)? else {
            return serde_json::from_value(Value::Null);
        };
        let shortened = values.into_iter().map(|(name, value)| {
            let number = value.as_f64().and_then(|number| Number::from_f64(short(number as f32)));
            (name, number.map_or(value, Value::Number))
        });
        serde_json::from_value(Value::Object(shortened.collect()))
    };
    read().map_err(|error| InputError::file(origin, Problem::Unreadable(error.to_string())))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Muscles and mechanism differ from every default.
    #[test]
    fn a_scenario_gives_the_configuration_again() {
        let text = "[plant]\nmodel = \"lumped\"\n[sensor.gas]\nkind = \"max31865\"\n\
             [joint]\nradius_m = 0.021\nradius_a_per_rad = -0.2\nradius_b_share = 1.1\nradius_b_per_rad3 = 0.1\ngravity_n_m = 4.9\nlock_s = 2\nsensor_kind = \"as5600\"\n\
             [joint.controller]\ngain_n_m_rad = 11.3\n\
             [joint.b.muscle]\nbladder_stiffness_n_m = 700\n[joint.b.friction]\nforce_n = 3.3\n";
        let loaded = parse(text, "joint.toml".as_ref()).unwrap();
        let found = to_scenario(&loaded.config()).unwrap();
        assert_eq!(found.config(), loaded.config());
        let read = parse(&render(&found), "scenario.toml".as_ref()).unwrap();
        assert_eq!(read.config(), loaded.config());
        // A longer muscle has a longer range.
        let text = "[joint]\nmid_length_b_m = 0.4\n[joint.b.muscle]\nrest_length_m = 0.45\n";
        let mut config = parse(text, "joint.toml".as_ref()).unwrap().config();
        let [a, b] = config.muscles.map(|muscle| muscle.sensors.length.range_m);
        assert!(a < b, "{a} {b}");
        assert_eq!(to_scenario(&config).unwrap().config(), config);
        config.muscles[1].sensors.length.range_m = 0.7;
        let said = to_scenario(&config).unwrap_err().to_string();
        assert!(said.contains("joint.b.sensor.length"), "{said}");
    }
}
