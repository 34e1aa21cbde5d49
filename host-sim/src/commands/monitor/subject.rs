//! One muscle or a joint behind a monitored board: its messages, its rows, its figures.

use crate::commands::joint;
use model_core::joint::{JointConfig, JointSetPoint, JointTelemetry, Motion};
use model_core::{Config, Faults, SetPoint, Telemetry};
use serde::Serialize;
use thermyo_boards::line::Line;
use thermyo_boards::live::LiveBoard;
use thermyo_boards::live_joint::LiveJoint;
use thermyo_boards::subject::Subject;
use thermyo_files::input::InputError;
use thermyo_files::units::UnitSystem;
use thermyo_protocol::{Answer, HostCommand, Image, Side};
use thermyo_record::board_trace::kind_and_values;
use thermyo_setup::from_config;
use thermyo_simulation::board::BoardError;
use thermyo_studies::drive::{self, Record};

/// Increment of the pressure's set point \[Pa\].
const MOVE_PA: f32 = 5.0e3;
/// Increment of the angle's set point \[rad\].
const MOVE_RAD: f32 = core::f32::consts::PI / 180.0;

/// A board that is monitored.
pub trait Monitored: Subject<Config: Default + Serialize> {
    type Record: Record<Board = Self>;

    /// The quantity that the arrow keys move.
    const MOVED: &'static str;
    /// Requests whose answers are the configuration.
    const QUESTIONS: &'static [HostCommand];

    /// The configuration, once every one of [`Self::QUESTIONS`] is answered.
    fn config_of(answers: &[Option<Answer>]) -> Option<Self::Config>;

    /// The set point this many increments from the requested one, or from the present value, and its request.
    fn moved(
        config: &Self::Config,
        telemetry: &Self::Telemetry,
        by: (Option<f32>, f32),
    ) -> (f32, HostCommand);

    /// The scenario of a configuration.
    ///
    /// # Errors
    /// If no scenario can express the configuration.
    fn scenario(config: &Self::Config) -> Result<String, InputError>;

    /// A step in one line, the most important first.
    fn figures(config: &Self::Config, telemetry: &Self::Telemetry, units: UnitSystem) -> String;
}

/// Whether the board at a port has the joint's image; one that does not answer counts as a muscle's.
pub fn joint_at(port: &str) -> Result<bool, BoardError> {
    match Line::open(port) {
        Ok((_, version)) => Ok(version.image == Image::Joint),
        Err(BoardError::Silent { .. } | BoardError::Line(_)) => Ok(false),
        Err(error) => Err(error),
    }
}

impl Monitored for LiveBoard {
    type Record = drive::Gathered;

    const MOVED: &'static str = "the pressure";
    const QUESTIONS: &'static [HostCommand] = &[HostCommand::ReadConfig];

    fn config_of(answers: &[Option<Answer>]) -> Option<Config> {
        match answers {
            [Some(Answer::Config(config))] => Some(*config),
            _ => None,
        }
    }

    fn moved(
        config: &Config,
        telemetry: &Telemetry,
        (wanted, increments): (Option<f32>, f32),
    ) -> (f32, HostCommand) {
        let from_pa = wanted.unwrap_or(telemetry.pressure_pa);
        let to_pa = (from_pa / MOVE_PA + increments).round() * MOVE_PA;
        let pressure_pa = to_pa.clamp(config.ambient.pressure_pa, config.working_limit_pa());
        (pressure_pa, HostCommand::Set(SetPoint::Pressure { pressure_pa }))
    }

    fn scenario(config: &Config) -> Result<String, InputError> {
        Ok(thermyo_setup::render(&from_config::to_scenario(config)?.scenario))
    }

    fn figures(config: &Config, telemetry: &Telemetry, units: UnitSystem) -> String {
        let mode = telemetry.mode.name();
        let limited = if telemetry.limited { ", limited" } else { "" };
        let faults = match telemetry.faults {
            Faults::NONE => "no fault".to_owned(),
            faults => faults.to_string(),
        };
        let estimate = &telemetry.estimate;
        let text = |value: f32, si, decimals| units.text(value.into(), si, decimals);
        let reading_k = config.sensing().gas_k(telemetry.sample.gas);
        let remark = if estimate.valid { "" } else { " (not to be relied on)" };
        format!(
            "{} (set point {}), {}, gas {} +- {:.2} K{remark}; {mode}{limited}: {faults}; inlet {}, \
             outlet {}, sensor {}, wall {}",
            text(telemetry.pressure_pa, "Pa", 1),
            set_point(telemetry.set_point, units),
            text(telemetry.length_m, "m", 1),
            text(estimate.gas_k, "K", 2),
            estimate.gas_sd_k,
            text(telemetry.command.inlet.share(), "", 1),
            text(telemetry.command.outlet.share(), "", 1),
            text(reading_k, "K", 2),
            text(estimate.wall_k, "K", 2),
        )
    }
}

fn set_point(set_point: SetPoint, units: UnitSystem) -> String {
    let (_, value, second) = kind_and_values(set_point);
    let text = |value: f32, si, decimals| units.text(value.into(), si, decimals);
    match set_point {
        SetPoint::Vent => "none: it vents".to_owned(),
        SetPoint::Pressure { .. } => text(value, "Pa", 1),
        SetPoint::Contraction { .. } => text(value, "", 1),
        SetPoint::MassFlow { .. } => text(value, "kg/s", 3),
        SetPoint::MassFlowCycle { .. } => {
            format!("{}, {second:.1} s", text(value, "kg/s", 3))
        }
        SetPoint::Duty { .. } => {
            format!("{}, {}", text(value, "", 0), text(second, "", 0))
        }
    }
}

impl Monitored for LiveJoint {
    type Record = drive::joint::Gathered;

    const MOVED: &'static str = "the angle";
    const QUESTIONS: &'static [HostCommand] = &[
        HostCommand::ReadMuscle(Side::A),
        HostCommand::ReadMuscle(Side::B),
        HostCommand::ReadJoint,
    ];

    fn config_of(answers: &[Option<Answer>]) -> Option<JointConfig> {
        match answers {
            [Some(Answer::Config(a)), Some(Answer::Config(b)), Some(Answer::Joint(rest))] => {
                let (mechanism, tuning, angle_part) = *rest;
                Some(JointConfig { muscles: [*a, *b], mechanism, tuning, angle_part })
            }
            _ => None,
        }
    }

    /// Moves the angle. The stiffness is that of the set point, or the joint's present one, with the lowest pressures
    /// that hold the angle.
    fn moved(
        config: &JointConfig,
        telemetry: &JointTelemetry,
        (wanted, increments): (Option<f32>, f32),
    ) -> (f32, HostCommand) {
        let from_rad = wanted.unwrap_or(telemetry.angle_rad);
        let to_rad = (from_rad / MOVE_RAD + increments).round() * MOVE_RAD;
        let mechanism = &config.mechanism;
        let angle_rad = to_rad.clamp(mechanism.minimum_rad, mechanism.maximum_rad);
        let stiffness_n_m_rad = match telemetry.set_point {
            JointSetPoint::Angle(motion) => motion.stiffness_n_m_rad,
            JointSetPoint::Torque { stiffness_n_m_rad, .. } => stiffness_n_m_rad,
            _ => telemetry.stiffness_n_m_rad.max(0.0),
        };
        let motion = Motion::still(angle_rad, stiffness_n_m_rad);
        (angle_rad, HostCommand::SetJoint(JointSetPoint::Angle(motion)))
    }

    fn scenario(config: &JointConfig) -> Result<String, InputError> {
        Ok(thermyo_joint::render(&thermyo_joint::to_scenario(config)?))
    }

    fn figures(_: &JointConfig, telemetry: &JointTelemetry, units: UnitSystem) -> String {
        let faults = joint::faults(telemetry).unwrap_or_else(|| "no fault".to_owned());
        let [a, b] = telemetry.muscles.map(|muscle| {
            let estimate = muscle.estimate;
            let gas = units.text(estimate.gas_k.into(), "K", 2);
            let duty = |share: f32| units.text(share.into(), "", 1);
            let [inlet, outlet] =
                [muscle.command.inlet, muscle.command.outlet].map(|part| duty(part.share()));
            let remark = if estimate.valid { "" } else { " (not to be relied on)" };
            format!(
                "gas {gas} +- {:.2} K{remark}, inlet {inlet}, outlet {outlet}",
                estimate.gas_sd_k
            )
        });
        let wanted = match telemetry.set_point {
            JointSetPoint::Angle(motion) => {
                format!("{:.2} deg", f64::from(motion.angle_rad).to_degrees())
            }
            JointSetPoint::Vent => "none: it vents".to_owned(),
            _ => "not of an angle".to_owned(),
        };
        let line = joint::line(telemetry, units);
        format!("{line} (set point {wanted}): {faults}; a: {a}; b: {b}")
    }
}
