//! A flashed board that drives a joint of two muscles in real time.

use super::link::Link;
use super::subject::{Live, Subject};
use model_core::joint::{
    JointConfig, JointError, JointField, JointMode, JointSetPoint, JointTelemetry,
};
use model_core::safety::supervisor::VENTING;
use model_core::{Config, Faults};
use std::time::Instant;
use thermyo_protocol::{
    Answer, Chip, HostCommand, Image, Name, Refusal, Side, Status, Version, joint_checksum,
};
use thermyo_simulation::board::BoardError;

/// Whether the board has the image for a joint.
///
/// # Errors
/// [`BoardError`] that names the other image.
pub(super) fn drives_joint(Version { image, .. }: Version) -> Result<(), BoardError> {
    match image {
        Image::Joint => Ok(()),
        _ => Err(BoardError::Refused(Refusal::OtherImage { joint: false })),
    }
}

/// The requests that configure a board, in their order: it takes the configuration as a whole with the last one.
pub(super) fn configuration(config: &JointConfig) -> [HostCommand; 3] {
    let [a, b] = config.muscles;
    [
        HostCommand::ConfigureMuscle(Side::A, a),
        HostCommand::ConfigureMuscle(Side::B, b),
        HostCommand::ConfigureJoint((config.mechanism, config.tuning, config.angle_part)),
    ]
}

pub struct LiveJoint {
    live: Live,
}

impl LiveJoint {
    fn muscle_config(&mut self, side: Side) -> Result<Config, BoardError> {
        let asked = "configuration of a muscle";
        match self.live.line.ask(HostCommand::ReadMuscle(side), asked)? {
            Answer::Config(config) => Ok(config),
            _ => Err(BoardError::Silent { asked }),
        }
    }

    fn check_above_ambient(&mut self, pressures_pa: [f32; 2]) -> Result<(), BoardError> {
        for (side, pressure_pa) in [Side::A, Side::B].into_iter().zip(pressures_pa) {
            let config = self.muscle_config(side)?;
            let least_pa = config.ambient.pressure_pa;
            if pressure_pa < least_pa {
                let most_pa = self.status()?.armed_pa.unwrap_or(config.working_limit_pa());
                return Err(BoardError::Pressure { pressure_pa, least_pa, most_pa });
            }
        }
        Ok(())
    }

    /// Adds the ambient pressure to a refused one, since the core would vent below it.
    fn refused(&mut self, error: BoardError) -> BoardError {
        let BoardError::Refused(Refusal::JointSetPoint(JointError::Range {
            field: JointField::Pressure,
            value: pressure_pa,
            maximum: most_pa,
            ..
        })) = error
        else {
            return error;
        };
        self.muscle_config(Side::A).map_or(error, |config| BoardError::Pressure {
            pressure_pa,
            least_pa: config.ambient.pressure_pa,
            most_pa,
        })
    }

    /// Clears the latched faults whose cause is gone; the telemetry has the remaining ones.
    pub fn clear(&mut self) -> Result<JointTelemetry, BoardError> {
        self.forget_faults()?;
        self.fresh_telemetry()
    }
}

impl Subject for LiveJoint {
    type Config = JointConfig;
    type Telemetry = JointTelemetry;
    type SetPoint = JointSetPoint;

    const VENT: JointSetPoint = JointSetPoint::Vent;

    fn fits(version: Version) -> Result<(), BoardError> {
        drives_joint(version)
    }

    fn of(live: Live) -> Self {
        Self { live }
    }

    fn live(&self) -> &Live {
        &self.live
    }

    fn live_mut(&mut self) -> &mut Live {
        &mut self.live
    }

    fn checksum(config: &JointConfig) -> u32 {
        joint_checksum(config)
    }

    fn config(&mut self) -> Result<JointConfig, BoardError> {
        let muscles = [self.muscle_config(Side::A)?, self.muscle_config(Side::B)?];
        let asked = "configuration of the joint";
        let Answer::Joint((mechanism, tuning, angle_part)) =
            self.live.line.ask(HostCommand::ReadJoint, asked)?
        else {
            return Err(BoardError::Silent { asked });
        };
        Ok(JointConfig { muscles, mechanism, tuning, angle_part })
    }

    fn configure(&mut self, config: &JointConfig, name: &str) -> Result<Status, BoardError> {
        config.check().map_err(BoardError::Config)?;
        let chip = self.live.version.chip;
        let wide = config.muscles.iter().any(|one| one.sensors.adc.wide_code_lsb > 0.0);
        if chip != Chip::Rp2040 && wide {
            return Err(BoardError::OtherChip { chip });
        }
        for command in configuration(config) {
            self.live.done(command, "configure")?;
        }
        self.live.done(HostCommand::Name(Name::new(name)), "name")?;
        let status = self.status()?;
        let same = status.config_checksum == joint_checksum(config);
        same.then_some(status).ok_or(BoardError::Damaged)
    }

    fn arm(&mut self, most_pa: Option<f32>) -> Result<(), BoardError> {
        self.live.done(HostCommand::Arm { most_pa }, "arm").map(drop)
    }

    fn check_set_point(&mut self, set_point: JointSetPoint) -> Result<(), BoardError> {
        if let JointSetPoint::Pressures { pressure_pa } = set_point {
            self.check_above_ambient(pressure_pa)?;
        }
        let checked = set_point.check(&self.config()?);
        checked.map_err(|error| self.refused(BoardError::Refused(Refusal::JointSetPoint(error))))
    }

    fn set(&mut self, set_point: JointSetPoint) -> Result<u32, BoardError> {
        if let JointSetPoint::Pressures { pressure_pa } = set_point {
            self.check_above_ambient(pressure_pa)?;
        }
        // A set point whose answer is lost drives the joint too.
        self.live.driving |= set_point != JointSetPoint::Vent;
        let set = self.live.done(HostCommand::SetJoint(set_point), "set");
        let step = set.map_err(|error| self.refused(error))?;
        self.live.last_sent = Instant::now();
        Ok(step)
    }

    fn request(set_point: JointSetPoint) -> HostCommand {
        HostCommand::SetJoint(set_point)
    }

    fn restart(set_point: JointSetPoint) -> HostCommand {
        HostCommand::StartJoint(set_point)
    }

    fn take_telemetry(link: &mut Link) -> Option<JointTelemetry> {
        link.take_joint_telemetry()
    }

    fn stop(&mut self) -> Result<(), BoardError> {
        self.vent()
    }

    fn step(telemetry: &JointTelemetry) -> u32 {
        telemetry.step()
    }

    fn set_point(telemetry: &JointTelemetry) -> JointSetPoint {
        telemetry.set_point
    }

    fn is_checking(telemetry: &JointTelemetry) -> bool {
        telemetry.mode == JointMode::StartupCheck
    }

    fn pressure_pa(telemetry: &JointTelemetry) -> f32 {
        let [a, b] = telemetry.muscles.map(|muscle| muscle.pressure_pa);
        a.max(b)
    }

    fn venting(telemetry: &JointTelemetry) -> Faults {
        let [a, b] = telemetry.muscles.map(|muscle| muscle.faults.of(VENTING));
        a.with(b).with(telemetry.faults.of_failure())
    }
}

#[cfg(test)]
mod tests {
    use super::super::line::Line;
    use super::*;
    use std::io::{self, Read, Write};
    use std::sync::{Arc, Mutex};
    use thermyo_protocol::{Decoder, Request};

    /// A link on which every answer is lost.
    struct Deaf {
        requests: Decoder,
        heard: Arc<Mutex<Vec<HostCommand>>>,
    }

    impl Read for Deaf {
        fn read(&mut self, _: &mut [u8]) -> io::Result<usize> {
            Err(io::ErrorKind::BrokenPipe.into())
        }
    }

    impl Write for Deaf {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            for byte in bytes {
                if let Some(Request { command, .. }) = self.requests.push(*byte) {
                    self.heard.lock().unwrap().push(command);
                }
            }
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_set_point_whose_answer_is_lost_is_followed_by_a_vent() {
        use model_core::joint::Motion;
        let heard = Arc::new(Mutex::new(Vec::new()));
        let deaf = Deaf { requests: Decoder::new(), heard: Arc::clone(&heard) };
        let line = Line::over(Box::new(deaf), "deaf");
        let version = Version {
            protocol: thermyo_protocol::PROTOCOL,
            firmware: [0, 1, 0],
            chip: Chip::Rp2040,
            image: Image::Joint,
        };
        let mut board = LiveJoint { live: Live::new(line, version) };
        let set_point = JointSetPoint::Angle(Motion::still(0.1, 14.0));
        assert!(board.set(set_point).is_err());
        drop(board);
        let heard = heard.lock().unwrap();
        assert_eq!(heard[..], [HostCommand::SetJoint(set_point), HostCommand::Stop]);
    }
}
