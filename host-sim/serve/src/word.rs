//! What a page says.

use model_core::SetPoint;
use serde::Deserialize;
use thermyo_studies::calibrate::Sensor;

/// One message of a page.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Word {
    /// Vent, now. Taken from every page.
    Vent,
    /// So many messages have been seen by now.
    Seen(u64),
    /// Taken from the page that steers.
    Order(Order),
}

/// What the board is to do, or what is to be done with it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// Takes set points up to this absolute pressure \[Pa\]; none: what the configuration allows.
    Arm {
        /// \[Pa\]
        most_pa: Option<f32>,
    },
    /// Another set point.
    Set(SetPoint),
    /// Forget faults whose cause is gone.
    Clear,
    /// The configuration of a scenario's text; without one, that of the emulated board's own muscle.
    Configure(Option<ScenarioText>),
    /// Keep the configuration over the loss of power.
    Save,
    /// Begin a recording.
    Record,
    /// End it.
    Finish,
    /// Begin to calibrate a sensor.
    Calibrate(SensorName),
    /// What the reference reads.
    Reference(String),
    /// Begin to tune, up to this absolute pressure \[Pa\].
    Tune {
        /// \[Pa\]
        most_pa: f64,
    },
    /// Leave what is guided, or put its result away.
    Leave,
}

impl Order {
    /// Whether the muscle may move by it.
    pub fn moves(&self) -> bool {
        matches!(self, Self::Arm { .. } | Self::Set(_) | Self::Tune { .. })
    }
}

/// A scenario as the page has read it.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct ScenarioText {
    /// Name of its file.
    pub name: String,
    /// What is in it.
    pub text: String,
}

/// See [`Sensor`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SensorName {
    /// Absolute pressure.
    Pressure,
    /// Length.
    Length,
    /// Gas temperature.
    Gas,
}

impl From<SensorName> for Sensor {
    fn from(name: SensorName) -> Self {
        match name {
            SensorName::Pressure => Self::Pressure,
            SensorName::Length => Self::Length,
            SensorName::Gas => Self::Gas,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_read_and_garbage_is_not() {
        let read = |text: &str| serde_json::from_str::<Word>(text);
        assert_eq!(read("\"vent\"").unwrap(), Word::Vent);
        assert_eq!(read("{\"seen\":7}").unwrap(), Word::Seen(7));
        let order = |order| Word::Order(order);
        assert_eq!(read("{\"order\":\"record\"}").unwrap(), order(Order::Record));
        let arm = Order::Arm { most_pa: None };
        assert_eq!(read("{\"order\":{\"arm\":{\"most_pa\":null}}}").unwrap(), order(arm));
        for (text, contraction) in [("0", 0.0), ("0.0625", 0.0625), ("-1e-1", -0.1)] {
            let set = Order::Set(SetPoint::Contraction { contraction });
            let text =
                format!("{{\"order\":{{\"set\":{{\"Contraction\":{{\"contraction\":{text}}}}}}}}}");
            assert_eq!(read(&text).unwrap(), order(set), "{text}");
        }
        for garbage in
            ["", "7", "{\"order\":{\"set\":7}}", "{\"order\":{\"fire\":null}}", "{\"seen\":-1}"]
        {
            assert!(read(garbage).is_err(), "{garbage}");
        }
    }
}
