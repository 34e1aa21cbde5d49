//! Messages from a page. An unknown key is refused, since the intended key would be missing.

use super::sought::Sought;
use model_core::SetPoint;
use model_core::joint::JointSetPoint;
use serde::Deserialize;
use std::path::Path;
use thermyo_studies::calibrate::Sensor;

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Word {
    /// Vent now. Accepted from every page.
    Vent,
    /// Take over the steering; the muscle vents.
    Steer,
    /// Number of messages that the page has processed.
    Seen(u64),
    /// Accepted from the steering page.
    Order(Order),
}

/// Orders for the board or the operator.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Order {
    /// Arms up to this absolute pressure \[Pa\]; `None` means the configuration's limit.
    Arm {
        most_pa: Option<f32>,
    },
    /// A set point of one muscle.
    Set(SetPoint),
    /// A set point of a joint.
    SetJoint(JointSetPoint),
    /// Clears latched faults whose cause is gone.
    Clear,
    /// Sends the configuration of a scenario's text; without a text, that of the emulated board's own muscle.
    Configure(Option<ScenarioText>),
    /// Sends the configuration that the board had before the last change.
    Back,
    Save,
    Record,
    Finish,
    Calibrate(Sensor),
    /// The typed reading of the reference.
    Reference(String),
    /// Starts a tuning, up to this absolute pressure \[Pa\].
    Tune {
        most_pa: f64,
    },
    /// Measures the gas temperature at stops, up to this absolute pressure \[Pa\].
    Stops {
        most_pa: f64,
    },
    /// Leaves the guided task, or closes its result.
    Leave,
    /// Identifies these keys of the board's configuration from a record.
    Identify {
        data: Source,
        sought: Sought,
        keys: Vec<String>,
    },
    /// Compares the second record with the first.
    Compare([Source; 2]),
    /// Sends the configuration with the identified values.
    Apply,
    /// Cancels an identification or comparison, or closes its result.
    Close,
}

/// A record that the page has sent, or one of a result.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Source {
    File {
        /// Number in the answer to its upload.
        number: u64,
        name: String,
    },
    /// A record of the result with this name.
    Result(String),
}

impl Order {
    /// Whether the order may move the driven muscle or joint.
    pub fn moves(&self) -> bool {
        matches!(
            self,
            Self::Arm { .. }
                | Self::Set(_)
                | Self::SetJoint(_)
                | Self::Tune { .. }
                | Self::Stops { .. }
        )
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenarioText {
    pub name: String,
    pub text: String,
}

impl ScenarioText {
    pub fn stem(&self) -> String {
        Path::new(&self.name).file_stem().unwrap_or_default().to_string_lossy().into_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::joint::Motion;

    #[test]
    fn words_are_read_and_garbage_is_not() {
        let read = |text: &str| serde_json::from_str::<Word>(text);
        assert_eq!(read("\"vent\"").unwrap(), Word::Vent);
        assert_eq!(read("{\"seen\":7}").unwrap(), Word::Seen(7));
        let order = |order| Word::Order(order);
        assert_eq!(read("{\"order\":\"record\"}").unwrap(), order(Order::Record));
        let arm = Order::Arm { most_pa: None };
        assert_eq!(read("{\"order\":{\"arm\":{\"most_pa\":null}}}").unwrap(), order(arm));
        let motion = "{\"Angle\":{\"angle_rad\":0.5,\"speed_rad_s\":0,\"acceleration_rad_s2\":0,\"stiffness_n_m_rad\":14}}";
        let angle = Order::SetJoint(JointSetPoint::Angle(Motion::still(0.5, 14.0)));
        assert!(angle.moves());
        let text = format!("{{\"order\":{{\"set_joint\":{motion}}}}}");
        assert_eq!(read(&text).unwrap(), order(angle));
        assert_eq!(
            read("{\"order\":{\"set_joint\":\"Lock\"}}").unwrap(),
            order(Order::SetJoint(JointSetPoint::Lock))
        );
        for (text, contraction) in [("0", 0.0), ("0.0625", 0.0625), ("-1e-1", -0.1)] {
            let set = Order::Set(SetPoint::Contraction { contraction });
            let text =
                format!("{{\"order\":{{\"set\":{{\"Contraction\":{{\"contraction\":{text}}}}}}}}}");
            assert_eq!(read(&text).unwrap(), order(set), "{text}");
        }
        for garbage in [
            "",
            "7",
            "{\"order\":{\"set\":7}}",
            "{\"order\":{\"fire\":null}}",
            "{\"seen\":-1}",
            // Without its key the order would arm up to the configuration's limit.
            "{\"order\":{\"arm\":{\"max_pa\":150000}}}",
            "{\"order\":{\"tune\":{\"most_pa\":150000,\"hold_s\":1}}}",
            "{\"order\":{\"configure\":{\"name\":\"a.toml\",\"text\":\"\",\"save\":true}}}",
        ] {
            assert!(read(garbage).is_err(), "{garbage}");
        }
    }
}
