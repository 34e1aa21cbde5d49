//! The columns of a trace as topics of a log, with meaning and unit.

use serde_json::{Map, Value, json};
use thermyo_joint::trace;
use thermyo_record::board_trace::every_column;
use thermyo_record::units::unit_of;

/// Related columns. The time is in every topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Topic {
    pub name: &'static str,
    pub schema: &'static str,
    pub about: &'static str,
    pub columns: &'static [(&'static str, &'static str)],
}

/// Name of the column that every topic has.
pub const TIME: &str = "time_s";

/// The file and the columns of a record, and their topics.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    pub file: &'static str,
    pub topics: &'static [Topic],
    /// Names of a row's cells; a row may end early.
    pub columns: fn() -> Vec<&'static str>,
}

pub const MUSCLE: Layout = Layout { file: "trace.csv", topics: &TOPICS, columns: every_column };

pub const JOINT: Layout =
    Layout { file: trace::FILE, topics: &JOINT_TOPICS, columns: trace::board_columns };

const TOPICS: [Topic; 5] = [
    Topic {
        name: "/muscle",
        schema: "thermyo.Muscle",
        about: "The muscle: of a simulated one the truth, of a real one what its board measures",
        columns: &[
            ("pressure_pa", "Absolute pressure of the gas"),
            ("volume_m3", "Volume of the gas"),
            ("length_m", "Length of the muscle"),
            ("mass_kg", "Mass of the gas"),
            ("flow_in_kg_s", "Mass flow in, mean since the row before"),
            ("flow_out_kg_s", "Mass flow out, mean since the row before"),
            ("gas_temperature_k", "Mean temperature of the gas"),
            ("wall_temperature_k", "Mean temperature of the wall"),
        ],
    },
    Topic {
        name: "/sensors",
        schema: "thermyo.Sensors",
        about: "Readings of the sensors",
        columns: &[
            ("sensor_gas_k", "Reading of the sensor in the gas"),
            ("sensor_wall_k", "Reading of the sensor in the wall"),
            ("measured_pressure_pa", "Absolute pressure as the core reads it"),
            ("measured_length_m", "Length as the core reads it"),
            ("code_pressure", "Code of the converter, pressure"),
            ("code_gas", "Code of the converter, sensor in the gas"),
            ("code_length", "Code of the converter, length"),
        ],
    },
    Topic {
        name: "/estimate",
        schema: "thermyo.Estimate",
        about: "The core's estimate, and its forward model without the sensor",
        columns: &[
            ("estimate_k", "Estimated temperature of the gas"),
            ("estimate_sd_k", "Standard deviation of the estimate"),
            ("estimate_valid", "1 where the estimate is to be relied on"),
            ("model_k", "Temperature of the gas by the forward model"),
            ("model_sensor_k", "Reading of the sensor in the gas by the forward model"),
            ("wall_estimate_k", "Estimated temperature of the wall"),
            ("sensor_estimate_k", "Estimated temperature of the sensor's element"),
            ("mass_estimate_kg", "Estimated mass of the gas"),
            ("heat_scale", "Estimated factor on the configured heat transfer"),
            ("sensor_lag_s", "Estimated lag of the sensor in the gas"),
        ],
    },
    Topic {
        name: "/control",
        schema: "thermyo.Control",
        about: "Set point, mode and valve duties",
        columns: &[
            ("duty_in", "Share of the PWM period for which the inlet is open, 0 to 1"),
            ("duty_out", "Share of the PWM period for which the outlet is open, 0 to 1"),
            ("set_point", "Set point in its own unit"),
            (
                "set_point_kind",
                "0 vent, 1 duty, 2 mass flow, 3 its cycle, 4 pressure, 5 contraction",
            ),
            ("set_point_value", "Set point, its first value"),
            ("set_point_second", "Set point, its second value: outlet's duty, cycle's period"),
            ("mode", "Mode of the core, by its number"),
            ("limited", "1 where the set point asks for more than the core gives"),
        ],
    },
    Topic {
        name: "/health",
        schema: "thermyo.Health",
        about: "How the core is",
        columns: &[
            ("step", "Number of the core's step"),
            ("missed_steps", "Steps missed before this one"),
            ("faults", "Faults, one bit each: docs/reference/safety.md"),
            ("emergency_stop", "1 where the emergency stop is pressed"),
            ("heard", "1 where the host was heard in this step"),
            ("flooded", "1 where the link brought more than it may in this step"),
            ("armed_pa", "Highest absolute pressure that set points may ask for; 0: not armed"),
            ("restarts", "Restarts of the board since its power came"),
            ("starts", "Starts of the board that it remembers"),
            ("config_checksum", "Checksum of the configuration"),
        ],
    },
];

/// A muscle of a joint, with the prefix `$side` before its columns.
macro_rules! muscle_of_joint {
    ($name:literal, $schema:literal, $about:literal, $side:literal) => {
        Topic {
            name: $name,
            schema: $schema,
            about: $about,
            columns: &[
                (concat!($side, "pressure_pa"), "Absolute pressure of the gas"),
                (concat!($side, "length_m"), "Length of the muscle"),
                (concat!($side, "tension_n"), "Tension of the tendon"),
                (concat!($side, "gas_temperature_k"), "Mean temperature of the gas"),
                (concat!($side, "wall_temperature_k"), "Mean temperature of the wall"),
                (concat!($side, "sensor_gas_k"), "Reading of the sensor in the gas"),
                (concat!($side, "estimate_k"), "Estimated temperature of the gas"),
                (concat!($side, "estimate_sd_k"), "Standard deviation of the estimate"),
                (concat!($side, "estimate_valid"), "1 where the estimate is to be relied on"),
                (concat!($side, "wall_estimate_k"), "Estimated temperature of the wall"),
                (concat!($side, "sensor_estimate_k"), "Estimated temperature of the element"),
                (concat!($side, "mass_estimate_kg"), "Estimated mass of the gas"),
                (concat!($side, "heat_scale"), "Estimated factor on the heat transfer"),
                (concat!($side, "sensor_lag_s"), "Estimated lag of the sensor in the gas"),
                (concat!($side, "duty_in"), "Share of the PWM period with the inlet open, 0 to 1"),
                (
                    concat!($side, "duty_out"),
                    "Share of the PWM period with the outlet open, 0 to 1",
                ),
                (concat!($side, "faults"), "Faults, one bit each: docs/reference/safety.md"),
                (concat!($side, "measured_pressure_pa"), "Absolute pressure as the core reads it"),
                (concat!($side, "measured_length_m"), "Length by the angle, as the core reads it"),
                (concat!($side, "code_pressure"), "Code of the converter, pressure"),
                (concat!($side, "code_gas"), "Code of the converter, sensor in the gas"),
            ],
        }
    };
}

const JOINT_TOPICS: [Topic; 5] = [
    Topic {
        name: "/joint",
        schema: "thermyo.Joint",
        about: "The joint: of a simulated one the truth, of a real one what its board measures",
        columns: &[
            ("angle_rad", "Angle"),
            ("speed_rad_s", "Speed"),
            ("torque_n_m", "Torque of both tendons"),
            ("stiffness_n_m_rad", "Stiffness behind shut valves"),
            ("load_n_m", "Torque from outside"),
            ("measured_angle_rad", "Angle as the core reads it"),
            ("estimated_speed_rad_s", "Speed as the core observes it"),
            ("estimated_torque_n_m", "Torque by pressures and angle"),
            ("estimated_stiffness_n_m_rad", "Stiffness by pressures and angle"),
            ("disturbance_n_m", "Torque that nothing configured explains"),
            ("code_angle", "Code of the converter, angle"),
        ],
    },
    muscle_of_joint!(
        "/muscle_a",
        "thermyo.MuscleA",
        "Muscle a, which shortens as the angle grows",
        "a_"
    ),
    muscle_of_joint!(
        "/muscle_b",
        "thermyo.MuscleB",
        "Muscle b, which shortens as the angle falls",
        "b_"
    ),
    Topic {
        name: "/control",
        schema: "thermyo.JointControl",
        about: "Set point and mode",
        columns: &[
            ("angle_reference_rad", "Set point of the angle"),
            ("stiffness_reference_n_m_rad", "Set point of the stiffness"),
            ("reference_rad", "Angle of the core's reference"),
            ("set_point_kind", "0 vent, 1 duty, 2 pressures, 3 torque, 4 angle, 5 lock"),
            ("set_point_1", "Angle, torque, pressure of a, inlet of a"),
            ("set_point_2", "Speed, stiffness of a torque, pressure of b, inlet of b"),
            ("set_point_3", "Acceleration, outlet of a"),
            ("set_point_4", "Stiffness of an angle, outlet of b"),
            ("mode", "Mode of the core, by its number"),
            ("limited", "1 where stiffness, or torque too, gives way to the limits of pressure"),
        ],
    },
    Topic {
        name: "/health",
        schema: "thermyo.JointHealth",
        about: "How the core is",
        columns: &[
            ("step", "Number of the core's step"),
            ("missed_steps", "Steps missed before this one"),
            ("faults", "Faults of the joint, one bit each: docs/reference/safety.md"),
            ("emergency_stop", "1 where the emergency stop is pressed"),
            ("heard", "1 where the host was heard in this step"),
            ("flooded", "1 where the link brought more than it may in this step"),
            ("armed_pa", "Highest absolute pressure of either muscle; 0: not armed"),
            ("restarts", "Restarts of the board since its power came"),
            ("starts", "Starts of the board that it remembers"),
            ("config_checksum", "Checksum of the configuration"),
        ],
    },
];

impl Topic {
    /// The JSON schema of the topic's messages. Unknown values are left out of a message.
    pub fn json_schema(&self) -> Value {
        let property = |(name, meaning): &(&str, &str)| {
            let unit = unit_of(name).map(|unit| format!(" [{}]", unit.name)).unwrap_or_default();
            let what = json!({ "type": "number", "description": format!("{meaning}{unit}") });
            ((*name).to_owned(), what)
        };
        let time = (TIME, "Time since the beginning");
        let properties: Map<String, Value> =
            [time].iter().chain(self.columns).map(property).collect();
        json!({
            "title": self.schema,
            "description": self.about,
            "type": "object",
            "properties": properties,
            "required": [TIME],
        })
    }

    /// Indices of the topic's columns among all, the time first.
    pub fn places(&self, all: &[&str]) -> Vec<usize> {
        let names = [TIME].into_iter().chain(self.columns.iter().map(|(name, _)| *name));
        names.filter_map(|name| all.iter().position(|column| *column == name)).collect()
    }
}

/// Writes the known cells as a JSON object; missing cells are unknown. Every number is the
/// shortest text that reads back to the same value.
pub fn write_json(text: &mut String, columns: impl Iterator<Item = (&'static str, Option<f64>)>) {
    let mut buffer = zmij::Buffer::new();
    text.push('{');
    let mut first = true;
    for (name, cell) in columns {
        let Some(cell) = cell.filter(|cell| cell.is_finite()) else { continue };
        if !first {
            text.push(',');
        }
        first = false;
        text.push('"');
        text.push_str(name);
        text.push_str("\":");
        let number = buffer.format(cell);
        text.push_str(number.strip_suffix(".0").unwrap_or(number));
    }
    text.push('}');
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_column_is_in_one_topic() {
        for layout in [MUSCLE, JOINT] {
            let mut named: Vec<&str> = vec![TIME];
            let topics = layout.topics.iter();
            named.extend(topics.flat_map(|topic| topic.columns.iter().map(|(name, _)| *name)));
            let columns = (layout.columns)();
            for column in &columns {
                let times = named.iter().filter(|name| *name == column).count();
                assert_eq!(times, 1, "{column} is in {times} topics");
            }
            assert_eq!(named.len(), columns.len());
        }
    }

    #[test]
    fn a_schema_says_the_unit() {
        let schema = TOPICS[0].json_schema();
        assert_eq!(
            schema["properties"]["flow_in_kg_s"]["description"],
            "Mass flow in, mean since the row before [kg/s]"
        );
        assert_eq!(schema["properties"]["time_s"]["description"], "Time since the beginning [s]");
        let joint = JOINT_TOPICS[0].json_schema();
        for (name, unit) in
            [("torque_n_m", "N m"), ("stiffness_n_m_rad", "N m/rad"), ("speed_rad_s", "rad/s")]
        {
            let text = joint["properties"][name]["description"].as_str().unwrap();
            assert!(text.ends_with(&format!(" [{unit}]")), "{text}");
        }
    }

    #[test]
    fn what_is_not_known_is_left_out() {
        let mut text = String::new();
        let cells = [Some(0.1), Some(f64::NAN), None, Some(3.0), Some(-2.5e-7)];
        write_json(&mut text, ["a", "b", "c", "d", "e"].into_iter().zip(cells));
        assert_eq!(text, "{\"a\":0.1,\"d\":3,\"e\":-2.5e-7}");
    }
}
