//! A flashed board that samples a real muscle in real time.

pub use super::line::VIEW_DIVIDER;
use super::link::Link;
use super::subject::{Live, Subject};
use model_core::control::{Mode, Target};
use model_core::physics::chamber::AnyChamber;
use model_core::safety::supervisor::VENTING;
use model_core::{Config, Faults, SetPoint, SetPointError, Telemetry};
use thermyo_protocol::{
    Answer, Chip, HostCommand, Image, Name, Refusal, Status, Version, checksum,
};
use thermyo_simulation::board::BoardError;

pub struct LiveBoard {
    live: Live,
    /// Result of the last request for the configuration.
    config: Option<Config>,
}

impl LiveBoard {
    fn check_above_ambient(&mut self, set_point: SetPoint) -> Result<(), BoardError> {
        let SetPoint::Pressure { pressure_pa } = set_point else { return Ok(()) };
        let config = self.known_config()?;
        let least_pa = config.ambient.pressure_pa;
        if pressure_pa >= least_pa {
            return Ok(());
        }
        let most_pa = self.status()?.armed_pa.unwrap_or(config.working_limit_pa());
        Err(BoardError::Pressure { pressure_pa, least_pa, most_pa })
    }

    /// Adds the ambient pressure to a refused one, since the core would vent below it.
    fn refused(&self, set_point: SetPoint, error: BoardError) -> BoardError {
        match (set_point, error, self.config) {
            (
                SetPoint::Pressure { pressure_pa },
                BoardError::Refused(Refusal::SetPoint(SetPointError::Range { maximum, .. })),
                Some(config),
            ) => BoardError::Pressure {
                pressure_pa,
                least_pa: config.ambient.pressure_pa,
                most_pa: maximum,
            },
            (_, error, _) => error,
        }
    }

    /// The configuration in use, requested again if it may have changed.
    fn known_config(&mut self) -> Result<Config, BoardError> {
        let status = self.last_status();
        let in_use = |config: &Config| {
            status.is_none_or(|status| status.config_checksum == checksum(config))
        };
        match self.config.filter(in_use) {
            Some(config) => Ok(config),
            None => self.config(),
        }
    }

    /// Clears the latched faults whose cause is gone; returns the remaining ones.
    pub fn clear(&mut self) -> Result<Faults, BoardError> {
        self.forget_faults()?;
        Ok(self.fresh_telemetry()?.faults)
    }
}

impl Subject for LiveBoard {
    type Config = Config;
    type Telemetry = Telemetry;
    type SetPoint = SetPoint;

    const VENT: SetPoint = SetPoint::Vent;

    fn fits(Version { image, chip, .. }: Version) -> Result<(), BoardError> {
        match image {
            Image::Hil => Err(BoardError::Hil { chip }),
            Image::Joint => Err(BoardError::Refused(Refusal::OtherImage { joint: true })),
            _ => Ok(()),
        }
    }

    fn of(live: Live) -> Self {
        Self { live, config: None }
    }

    fn live(&self) -> &Live {
        &self.live
    }

    fn live_mut(&mut self) -> &mut Live {
        &mut self.live
    }

    fn checksum(config: &Config) -> u32 {
        checksum(config)
    }

    fn config(&mut self) -> Result<Config, BoardError> {
        match self.live.line.ask(HostCommand::ReadConfig, "configuration")? {
            Answer::Config(config) => {
                self.config = Some(config);
                Ok(config)
            }
            _ => Err(BoardError::Silent { asked: "configuration" }),
        }
    }

    fn configure(&mut self, config: &Config, name: &str) -> Result<Status, BoardError> {
        config.check().map_err(BoardError::Config)?;
        let chip = self.live.version.chip;
        if chip != Chip::Rp2040 && config.sensors.adc.wide_code_lsb > 0.0 {
            return Err(BoardError::OtherChip { chip });
        }
        self.config = None;
        self.live.line.ask(HostCommand::Configure(*config), "configure")?;
        self.live.line.ask(HostCommand::Name(Name::new(name)), "name")?;
        let status = self.status()?;
        if status.config_checksum == checksum(config) {
            Ok(status)
        } else {
            Err(BoardError::Damaged)
        }
    }

    fn arm(&mut self, most_pa: Option<f32>) -> Result<(), BoardError> {
        if let Some(pressure_pa) = most_pa {
            let config = self.known_config()?;
            let (least_pa, most_pa) = (config.ambient.pressure_pa, config.working_limit_pa());
            if !(least_pa..=most_pa).contains(&pressure_pa) {
                return Err(BoardError::Pressure { pressure_pa, least_pa, most_pa });
            }
        }
        self.live.done(HostCommand::Arm { most_pa }, "arm").map(drop)
    }

    fn check_set_point(&mut self, set_point: SetPoint) -> Result<(), BoardError> {
        self.check_above_ambient(set_point)?;
        let config = self.known_config()?;
        let target = Target::new(&set_point, &config, &AnyChamber::new(&config.chamber));
        let refused =
            |error| self.refused(set_point, BoardError::Refused(Refusal::SetPoint(error)));
        target.map(drop).map_err(refused)
    }

    fn set(&mut self, set_point: SetPoint) -> Result<u32, BoardError> {
        self.check_above_ambient(set_point)?;
        self.live.driving |= set_point != SetPoint::Vent;
        let set = self.live.done(HostCommand::Set(set_point), "set point");
        set.map_err(|error| self.refused(set_point, error))
    }

    fn request(set_point: SetPoint) -> HostCommand {
        HostCommand::Set(set_point)
    }

    fn restart(set_point: SetPoint) -> HostCommand {
        HostCommand::Start(set_point)
    }

    fn take_telemetry(link: &mut Link) -> Option<Telemetry> {
        link.take_telemetry()
    }

    fn stop(&mut self) -> Result<(), BoardError> {
        self.vent()?;
        let vents =
            |telemetry: &Telemetry| matches!(telemetry.mode, Mode::Vent | Mode::StartupCheck);
        self.fresh(vents).map(drop)
    }

    fn step(telemetry: &Telemetry) -> u32 {
        telemetry.step
    }

    fn set_point(telemetry: &Telemetry) -> SetPoint {
        telemetry.set_point
    }

    fn is_checking(telemetry: &Telemetry) -> bool {
        telemetry.mode == Mode::StartupCheck
    }

    fn pressure_pa(telemetry: &Telemetry) -> f32 {
        telemetry.pressure_pa
    }

    fn venting(telemetry: &Telemetry) -> Faults {
        telemetry.faults.of(VENTING)
    }
}

#[cfg(test)]
mod tests {
    use super::super::line::Line;
    use super::*;
    use model_core::{AdcCode, Core, Sample};
    use std::collections::VecDeque;
    use std::io::{self, Read, Write};
    use thermyo_protocol::{Decoder, Message, PROTOCOL, Reply, Request, encode};

    /// Step of the board when its telemetry is read again.
    const NOW: u32 = 3_000;

    /// A board whose telemetry has not been read for a while.
    struct Unread {
        telemetry: Telemetry,
        divider: u32,
        requests: Decoder,
        waiting: VecDeque<u8>,
    }

    impl Unread {
        fn new() -> Self {
            let sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));
            let first = Core::new(&Config::default()).unwrap().step(&sample);
            let telemetry =
                Telemetry { step: 0, mode: Mode::Pressure, faults: Faults::NONE, ..first };
            let (requests, waiting) = (Decoder::new(), VecDeque::new());
            let mut board = Self { telemetry, divider: 1, requests, waiting };
            (0..NOW).for_each(|_| board.step());
            board
        }

        /// Holds a pressure, and vents from the last step on.
        fn step(&mut self) {
            self.telemetry.step += 1;
            if self.telemetry.step == NOW {
                (self.telemetry.mode, self.telemetry.faults) = (Mode::Vent, Faults::LINK_LOST);
            }
            if self.telemetry.step.is_multiple_of(self.divider) {
                self.tell(Message::Telemetry(self.telemetry));
            }
        }

        fn tell(&mut self, message: Message) {
            self.waiting.extend(encode(&message).unwrap());
        }
    }

    impl Read for Unread {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            if self.waiting.is_empty() {
                (0..10).for_each(|_| self.step());
            }
            if self.waiting.is_empty() {
                Err(io::ErrorKind::TimedOut.into())
            } else {
                self.waiting.read(buffer)
            }
        }
    }

    impl Write for Unread {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            for byte in bytes {
                let Some(Request { sequence, command }) = self.requests.push(*byte) else {
                    continue;
                };
                if let HostCommand::TelemetryDivider(divider) = command {
                    self.divider = u32::from(divider);
                }
                let answer = Answer::Done { step: self.telemetry.step };
                self.tell(Message::Reply(Reply { sequence, answer }));
            }
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn unread() -> LiveBoard {
        let version = Version {
            protocol: PROTOCOL,
            firmware: [0, 1, 0],
            chip: Chip::Rp2040,
            image: Image::Muscle,
        };
        let line = Line::over(Box::new(Unread::new()), "unread");
        LiveBoard::of(Live::new(line, version))
    }

    #[test]
    fn telemetry_that_nobody_has_read_is_not_of_now() {
        let telemetry = unread().fresh_telemetry().unwrap();
        assert!(telemetry.step >= NOW, "{}", telemetry.step);
        assert_eq!((telemetry.mode, telemetry.faults), (Mode::Vent, Faults::LINK_LOST));
        assert_eq!(unread().clear().unwrap(), Faults::LINK_LOST);
    }

    #[test]
    fn telemetry_of_now_does_not_wait_for_a_slow_stream() {
        let mut board = unread();
        board.telemetry_every(u16::MAX).unwrap();
        assert!(board.fresh_telemetry().unwrap().step <= NOW + 100);
        board.stop().unwrap();
        // The stream continues as before.
        let next = board.live.line.wait(Link::take_telemetry, "telemetry").unwrap();
        assert!(next.step.is_multiple_of(u32::from(u16::MAX)), "{}", next.step);
    }
}
