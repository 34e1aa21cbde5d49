//! The columns of a trace as topics of a log, with meaning and unit.

use serde_json::{Map, Value, json};
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

pub const TOPICS: [Topic; 5] = [
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

impl Topic {
    /// The JSON schema of its messages. Unknown values are left out of a message.
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

    /// Indices of its columns in [`every_column`], the time first.
    pub fn places(&self) -> Vec<usize> {
        let all = every_column();
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
        let mut named: Vec<&str> = vec![TIME];
        named.extend(TOPICS.iter().flat_map(|topic| topic.columns.iter().map(|(name, _)| *name)));
        for column in every_column() {
            let times = named.iter().filter(|name| **name == column).count();
            assert_eq!(times, 1, "{column} is in {times} topics");
        }
        assert_eq!(named.len(), every_column().len());
    }

    #[test]
    fn a_schema_says_the_unit() {
        let schema = TOPICS[0].json_schema();
        assert_eq!(
            schema["properties"]["flow_in_kg_s"]["description"],
            "Mass flow in, mean since the row before [kg/s]"
        );
        assert_eq!(schema["properties"]["time_s"]["description"], "Time since the beginning [s]");
    }

    #[test]
    fn what_is_not_known_is_left_out() {
        let mut text = String::new();
        let cells = [Some(0.1), Some(f64::NAN), None, Some(3.0), Some(-2.5e-7)];
        write_json(&mut text, ["a", "b", "c", "d", "e"].into_iter().zip(cells));
        assert_eq!(text, "{\"a\":0.1,\"d\":3,\"e\":-2.5e-7}");
    }
}
