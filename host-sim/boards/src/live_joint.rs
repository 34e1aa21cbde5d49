//! A flashed board that drives a joint of two muscles in real time.

use super::line::{ALIVE, Line, VIEW_DIVIDER};
use model_core::Config;
use model_core::joint::{JointConfig, JointSetPoint, JointTelemetry};
use std::time::Instant;
use thermyo_protocol::{
    Answer, Chip, Event, HostCommand, Image, LastReset, Name, Refusal, Side, Status, Timing,
    Version, joint_checksum,
};
use thermyo_simulation::board::BoardError;

/// The board. It is vented when dropped while it drives.
pub struct LiveJoint {
    line: Line,
    version: Version,
    last_sent: Instant,
    driving: bool,
}

/// Whether the image drives a joint.
///
/// # Errors
/// [`BoardError`] for one that drives one muscle.
pub fn for_a_joint(Version { image, .. }: Version) -> Result<(), BoardError> {
    match image {
        Image::Joint => Ok(()),
        _ => Err(BoardError::Refused(Refusal::OtherImage { joint: false })),
    }
}

impl LiveJoint {
    /// Opens the board at a port.
    ///
    /// # Errors
    /// [`BoardError`], if there is no answer, another protocol, or an image for one muscle.
    pub fn open(port: &str) -> Result<Self, BoardError> {
        let (mut line, version) = Line::open(port)?;
        for_a_joint(version)?;
        line.ask(HostCommand::TelemetryDivider(VIEW_DIVIDER), "telemetry")?;
        Ok(Self { line, version, last_sent: Instant::now(), driving: false })
    }

    pub fn version(&self) -> Version {
        self.version
    }

    pub fn port(&self) -> &str {
        self.line.name()
    }

    fn done(&mut self, command: HostCommand, asked: &'static str) -> Result<u32, BoardError> {
        match self.line.ask(command, asked)? {
            Answer::Done { step } => Ok(step),
            _ => Err(BoardError::Silent { asked }),
        }
    }

    pub fn status(&mut self) -> Result<Status, BoardError> {
        self.line.ask_status()
    }

    pub fn timing(&mut self) -> Result<Timing, BoardError> {
        self.line.timing()
    }

    pub fn last_reset(&mut self) -> Result<LastReset, BoardError> {
        self.line.last_reset()
    }

    /// Restarts and venting faults of either muscle and of the joint, the latest first.
    pub fn history(&mut self) -> Result<Vec<Event>, BoardError> {
        self.line.history()
    }

    /// Sends a configuration and its name; the board accepts or refuses it as a whole.
    ///
    /// # Errors
    /// [`BoardError::Config`] with the value that is out of its range; [`BoardError::OtherChip`];
    /// [`BoardError::Damaged`] if the board's configuration differs afterwards.
    pub fn configure(&mut self, config: &JointConfig, name: &str) -> Result<Status, BoardError> {
        config.check().map_err(BoardError::Config)?;
        let [a, b] = config.muscles;
        let chip = self.version.chip;
        if chip != Chip::Rp2040 && [a, b].iter().any(|one| one.sensors.adc.wide_code_lsb > 0.0) {
            return Err(BoardError::OtherChip { chip });
        }
        self.done(HostCommand::ConfigureMuscle(Side::A, a), "muscle a")?;
        self.done(HostCommand::ConfigureMuscle(Side::B, b), "muscle b")?;
        let rest = (config.mechanism, config.tuning, config.angle_part);
        self.done(HostCommand::ConfigureJoint(rest), "configure")?;
        self.done(HostCommand::Name(Name::new(name)), "name")?;
        let status = self.status()?;
        let same = status.config_checksum == joint_checksum(config);
        same.then_some(status).ok_or(BoardError::Damaged)
    }

    /// Saves the configuration in use in flash.
    pub fn save(&mut self) -> Result<(), BoardError> {
        self.done(HostCommand::Save, "save").map(drop)
    }

    /// Deletes the saved configuration.
    pub fn forget(&mut self) -> Result<(), BoardError> {
        self.done(HostCommand::Forget, "forget").map(drop)
    }

    /// Set points are accepted up to this pressure in either muscle \[Pa\], or as far as configured.
    pub fn arm(&mut self, most_pa: Option<f32>) -> Result<(), BoardError> {
        self.done(HostCommand::Arm { most_pa }, "arm").map(drop)
    }

    /// Sends a set point; returns the step from which on it holds.
    ///
    /// # Errors
    /// [`BoardError::Refused`]; [`BoardError::Pressure`] below ambient, where a muscle would vent.
    pub fn set(&mut self, set_point: JointSetPoint) -> Result<u32, BoardError> {
        if let JointSetPoint::Pressures { pressure_pa } = set_point {
            self.check_above_ambient(pressure_pa)?;
        }
        // A set point whose answer is lost drives the joint too.
        self.driving |= set_point != JointSetPoint::Vent;
        let step = self.done(HostCommand::SetJoint(set_point), "set")?;
        self.last_sent = Instant::now();
        Ok(step)
    }

    /// Sets the number of steps per telemetry frame.
    pub fn telemetry_every(&mut self, steps: u16) -> Result<(), BoardError> {
        self.done(HostCommand::TelemetryDivider(steps), "telemetry").map(drop)
    }

    /// The configuration in use.
    pub fn config(&mut self) -> Result<JointConfig, BoardError> {
        let muscles = [self.muscle_config(Side::A)?, self.muscle_config(Side::B)?];
        let asked = "configuration of the joint";
        let Answer::Joint((mechanism, tuning, angle_part)) =
            self.line.ask(HostCommand::ReadJoint, asked)?
        else {
            return Err(BoardError::Silent { asked });
        };
        Ok(JointConfig { muscles, mechanism, tuning, angle_part })
    }

    fn muscle_config(&mut self, side: Side) -> Result<Config, BoardError> {
        let asked = "configuration of a muscle";
        match self.line.ask(HostCommand::ReadMuscle(side), asked)? {
            Answer::Config(config) => Ok(config),
            _ => Err(BoardError::Silent { asked }),
        }
    }

    /// Restarts the core, with this set point in its step 0.
    pub fn start(&mut self, set_point: JointSetPoint) -> Result<(), BoardError> {
        self.driving = true;
        self.done(HostCommand::StartJoint(set_point), "start").map(drop)
    }

    /// Sends a set point without waiting for the answer; returns the request's number.
    pub fn send(&mut self, set_point: JointSetPoint) -> Result<u8, BoardError> {
        self.driving |= set_point != JointSetPoint::Vent;
        self.last_sent = Instant::now();
        self.line.send(HostCommand::SetJoint(set_point))
    }

    /// Returns the refusal of a request that was only sent, if there is one.
    pub fn check(&mut self, sequence: u8) -> Result<(), BoardError> {
        self.line.check(sequence)
    }

    /// Whether unread telemetry has arrived: what was read is not the latest.
    pub fn is_behind(&self) -> bool {
        self.line.is_behind()
    }

    /// Latest status that the board sent without a request.
    pub fn last_status(&self) -> Option<Status> {
        self.line.status()
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

    pub fn stop(&mut self) -> Result<(), BoardError> {
        self.done(HostCommand::Stop, "stop")?;
        self.driving = false;
        Ok(())
    }

    /// Clears the latched faults whose cause is gone; the telemetry has the remaining ones.
    pub fn clear(&mut self) -> Result<JointTelemetry, BoardError> {
        self.forget_faults()?;
        self.fresh_telemetry()
    }

    /// As [`Self::clear`], but reads no telemetry, for callers that read all of it themselves.
    pub fn forget_faults(&mut self) -> Result<(), BoardError> {
        self.done(HostCommand::ClearFaults, "clear")?;
        self.driving = false;
        Ok(())
    }

    /// The next telemetry of a later step than all that is unread.
    pub fn fresh_telemetry(&mut self) -> Result<JointTelemetry, BoardError> {
        while self.line.take_joint_telemetry().is_some() {}
        // The board sends in order: older telemetry comes before its answer.
        self.status()?;
        while self.line.take_joint_telemetry().is_some() {}
        self.line.wait(|link| link.take_joint_telemetry(), "telemetry")
    }

    /// Reads what has arrived, and keeps the board's set point alive.
    pub fn poll(&mut self) -> Result<Option<JointTelemetry>, BoardError> {
        if self.driving && self.last_sent.elapsed() >= ALIVE {
            self.line.send(HostCommand::Alive)?;
            self.last_sent = Instant::now();
        }
        match self.line.take_joint_telemetry() {
            Some(telemetry) => Ok(Some(telemetry)),
            None => self.line.poll().map(|()| self.line.take_joint_telemetry()),
        }
    }
}

impl Drop for LiveJoint {
    fn drop(&mut self) {
        if self.driving {
            let _ = self.line.ask(HostCommand::Stop, "stop");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{self, Read, Write};
    use std::sync::{Arc, Mutex};
    use thermyo_protocol::{Decoder, Request};

    /// A line on which every answer is lost.
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
        let mut board = LiveJoint { line, version, last_sent: Instant::now(), driving: false };
        let set_point = JointSetPoint::Angle(Motion::still(0.1, 14.0));
        assert!(board.set(set_point).is_err());
        drop(board);
        let heard = heard.lock().unwrap();
        assert_eq!(heard[..], [HostCommand::SetJoint(set_point), HostCommand::Stop]);
    }
}
