//! The page of a joint.

use super::served::{Held, Served};
use super::{NotDone, Operator};
use crate::frames::{Shown, rounded};
use crate::page::Kind;
use crate::state::{JointPart, Part};
use crate::target::Target;
use crate::word::{Order, ScenarioText};
use model_core::joint::{JointConfig, JointError, JointSetPoint, JointTelemetry, Mechanism};
use model_core::{Config, Faults};
use serde::Serialize;
use std::path::Path;
use thermyo_boards::live_joint::LiveJoint;
use thermyo_files::input::{InputError, Problem};
use thermyo_protocol::Refusal;
use thermyo_simulation::board::BoardError;
use thermyo_studies::drive::joint::Gathered;

const OF_ONE_MUSCLE: NotDone = NotDone::NotNow(
    "the board drives a joint: on the page only one muscle is calibrated, tuned and measured, and \
     its records identified from and compared",
);

/// Values of muscles a and b.
type Both = [f32; 2];

/// One step. The page gets an array in this order: `of_joint.js` has the names.
#[derive(Debug, Serialize)]
pub struct Row(f64, f32, Option<f32>, f32, Option<f32>, f32, Both, Both, Both, Both, Both, Both);

impl Shown for LiveJoint {
    type Row = Row;
    type Valid = [bool; 2];

    fn muscles(config: &JointConfig) -> &[Config] {
        &config.muscles
    }

    fn mode(telemetry: &JointTelemetry) -> &'static str {
        telemetry.mode.name()
    }

    fn is_limited(telemetry: &JointTelemetry) -> bool {
        telemetry.limited
    }

    fn valid(telemetry: &JointTelemetry) -> [bool; 2] {
        telemetry.muscles.map(|muscle| muscle.estimate.valid)
    }

    fn row(time_s: f64, config: &JointConfig, telemetry: &JointTelemetry) -> Row {
        let (angle_set, stiffness_set) = match telemetry.set_point {
            JointSetPoint::Angle(motion) => {
                (Some(telemetry.reference_rad), Some(motion.stiffness_n_m_rad))
            }
            JointSetPoint::Torque { stiffness_n_m_rad, .. } => (None, Some(stiffness_n_m_rad)),
            _ => (None, None),
        };
        let [a, b] = &telemetry.muscles;
        let sensor_k = |i: usize| config.muscles[i].sensing().gas_k([a, b][i].sample.gas);
        Row(
            rounded(time_s),
            telemetry.angle_rad,
            angle_set,
            telemetry.stiffness_n_m_rad,
            stiffness_set,
            telemetry.torque_n_m,
            [a.pressure_pa, b.pressure_pa],
            [a.estimate.gas_k, b.estimate.gas_k],
            [a.estimate.gas_sd_k, b.estimate.gas_sd_k],
            [sensor_k(0), sensor_k(1)],
            [a.command.inlet.share(), b.command.inlet.share()],
            [a.command.outlet.share(), b.command.outlet.share()],
        )
    }
}

impl Served for LiveJoint {
    type Tasks = ();
    type Record = Gathered;

    const KIND: Kind = Kind::Joint;
    const VENTS: &'static str = "both muscles vent";

    fn part(config: &JointConfig) -> Part {
        let Mechanism { minimum_rad, maximum_rad, lock_s, .. } = config.mechanism;
        Part::Joint { joint: JointPart { minimum_rad, maximum_rad, lock_s } }
    }

    fn configuration(
        target: &Target,
        text: Option<ScenarioText>,
    ) -> Result<(JointConfig, String), NotDone> {
        let Some(text) = text else {
            let joint = target.joint()?.ok_or(NotDone::NotNow(
                "no scenario is selected for this port: choose one with a [joint]",
            ))?;
            return Ok((joint.config(), target.muscle_name()));
        };
        if !thermyo_scenario::joint::is_joint(&text.text) {
            let why = "has no [joint], and the board drives one".to_owned();
            let problem = Problem::Unusable(why);
            return Err(InputError::file(Path::new(&text.name), problem).into());
        }
        let loaded = thermyo_joint::parse_alone(&text.text, Path::new(&text.name))?;
        Ok((loaded.config(), text.stem()))
    }

    fn own(target: &Target) -> Option<String> {
        matches!(target, Target::Scenario(_)).then(|| target.muscle_name())
    }

    fn asked(order: &Order) -> Option<JointSetPoint> {
        match order {
            Order::SetJoint(set_point) => Some(*set_point),
            _ => None,
        }
    }

    fn words(set_point: JointSetPoint) -> String {
        let percent = |share: f32| format!("{:.1} %", share * 100.0);
        match set_point {
            JointSetPoint::Vent => "vent".to_owned(),
            JointSetPoint::Lock => "lock".to_owned(),
            JointSetPoint::Duty { inlet: [in_a, in_b], outlet: [out_a, out_b] } => format!(
                "a: inlet {}, outlet {}; b: inlet {}, outlet {}",
                percent(in_a),
                percent(out_a),
                percent(in_b),
                percent(out_b)
            ),
            JointSetPoint::Pressures { pressure_pa: [a, b] } => {
                format!("{:.1} kPa and {:.1} kPa", a / 1e3, b / 1e3)
            }
            JointSetPoint::Torque { torque_n_m, stiffness_n_m_rad } => {
                format!("{torque_n_m:.2} N m, {stiffness_n_m_rad:.1} N m/rad")
            }
            JointSetPoint::Angle(motion) => format!(
                "{:.2} deg, {:.1} N m/rad",
                f64::from(motion.angle_rad).to_degrees(),
                motion.stiffness_n_m_rad
            ),
        }
    }

    fn refusal(refused: &NotDone) -> String {
        let NotDone::Board(BoardError::Refused(Refusal::JointSetPoint(JointError::Faults(
            muscles,
            joint,
        )))) = refused
        else {
            return refused.to_string();
        };
        if muscles.contains(&Faults::NOT_CONFIGURED) {
            return Refusal::NotConfigured.to_string();
        }
        let [a, b] = *muscles;
        let faults = Self::names([a, b, joint.of_failure()]).join(", ");
        format!("the board vents until this is cleared: {faults}")
    }

    fn faults(telemetry: &JointTelemetry) -> Held {
        let [a, b] = telemetry.muscles.map(|muscle| muscle.faults);
        [a, b, telemetry.faults.of_failure()]
    }

    fn names([a, b, joint]: Held) -> Vec<String> {
        let both = a.of(b);
        let places = [
            ("both muscles: ", both),
            ("muscle a: ", a.without(both)),
            ("muscle b: ", b.without(both)),
            ("", joint),
        ];
        let named = |(place, faults): (&'static str, Faults)| {
            faults.names().map(move |name| format!("{place}{name}"))
        };
        places.into_iter().flat_map(named).collect()
    }

    fn attempt(
        _operator: &mut Operator<Self>,
        order: Order,
        _wanted: &dyn Fn() -> bool,
    ) -> Result<(), NotDone> {
        Err(match order {
            Order::Set(_) => BoardError::Refused(Refusal::OtherImage { joint: true }).into(),
            _ => OF_ONE_MUSCLE,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::joint::JointFaults;

    #[test]
    fn a_fault_of_both_muscles_is_named_once() {
        let held = [
            Faults::LINK_LOST.with(Faults::EMERGENCY_STOP),
            Faults::LINK_LOST,
            JointFaults::TORQUE.of_failure(),
        ];
        let names = LiveJoint::names(held).join(", ");
        let both = format!("both muscles: {}", Faults::LINK_LOST);
        assert_eq!(names, format!("{both}, muscle a: {}, joint's torque", Faults::EMERGENCY_STOP));
    }

    #[test]
    fn a_page_names_no_file_and_sends_a_joint() {
        let refused = |text: &str| {
            let text = ScenarioText { name: "sent.toml".to_owned(), text: text.to_owned() };
            LiveJoint::configuration(&Target::Emulated, Some(text)).unwrap_err().to_string()
        };
        for (text, key) in [
            ("[joint]\n[drive]\nprofile_csv = \"/etc/passwd\"\n", "drive.profile_csv"),
            ("[joint]\n[drive]\nload_csv = \"/etc/passwd\"\n", "drive.load_csv"),
            ("[joint]\n\nradius_csv = \"/etc/passwd\"\n", "joint.radius_csv"),
            ("[joint]\n[joint.b.table]\ncsv = \"/etc/passwd\"\n", "table.csv"),
        ] {
            let said = format!("{key} = \"/etc/passwd\": must be left out");
            let error = refused(text);
            assert!(error.starts_with("sent.toml:3:") && error.contains(&said), "{error}");
        }
        assert!(refused("[muscle]\n").contains("has no [joint]"));
    }
}
