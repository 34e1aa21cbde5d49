//! One muscle.

use crate::board::Modulation;
use crate::link::{Identity, Outcome, check_muscle, configure, other_image};
#[cfg_attr(feature = "hil", allow(unused_imports))]
use crate::parts::{Parts, Seen};
use crate::shared::{Answer, Line, Message, Order, Shared};
use embassy_time::Duration;
use model_core::control::SetPointError;
use model_core::safety::supervisor::FirstFailure;
use model_core::{AdcCode, Faults, Mode};
pub use model_core::{Command as Commands, Config, Core, Sample, SetPoint, Telemetry};
use serde::{Serialize, Serializer};
pub use thermyo_protocol::checksum;
use thermyo_protocol::{
    ConfigSource, HostCommandWith, Image, MAX_FRAME, Name, PROTOCOL, Refusal, RequestWith, Unread,
};

pub const MUSCLES: usize = 1;
pub const IMAGE: Image = if cfg!(feature = "hil") { Image::Hil } else { Image::Muscle };
/// Bytes of the longest value in the store, which holds every configuration that fits a frame, with
/// its name and head; and schema of the values, whose bytes are those of the messages.
pub const MAX_VALUE: usize = MAX_FRAME + 64;
pub const SCHEMA: u16 = PROTOCOL;
/// Delay from driving the valves to the start of the PWM period: later steps at a period's start
/// may take longer and must not miss it.
pub const PWM_DELAY: Duration = Duration::from_micros(250);
pub const VENT: Commands = Commands::VENT;

pub type Request = RequestWith<Unread, Unread, Unread>;
pub type HostCommand = HostCommandWith<Unread, Unread, Unread>;

/// Never sent.
pub type JointTelemetry = ();

/// Stands for the active configuration in a message, which then need not hold its half kilobyte: it
/// is read when the message is sent.
#[derive(Clone, Copy)]
pub struct ActiveConfig(&'static Shared);

/// Never sent.
pub type ActiveRest = ();

impl Serialize for ActiveConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.config().unwrap_or_default().serialize(serializer)
    }
}

pub fn unconfigured() -> Core {
    let Ok(core) = Core::unconfigured() else {
        panic!("the default configuration holds");
    };
    core
}

pub fn commands(telemetry: &Telemetry) -> Commands {
    telemetry.command
}

pub fn each(commands: Commands) -> [Commands; MUSCLES] {
    [commands]
}

pub fn is_checking(telemetry: &Telemetry) -> bool {
    telemetry.mode == Mode::StartupCheck
}

/// Whether the muscle is driven.
pub fn moves(telemetry: &Telemetry) -> bool {
    !matches!(telemetry.mode, Mode::StartupCheck | Mode::Vent)
}

pub fn step(telemetry: &Telemetry) -> u32 {
    telemetry.step
}

pub fn faults(telemetry: &Telemetry) -> Faults {
    telemetry.faults
}

pub fn message(telemetry: Telemetry) -> Message {
    Message::Telemetry(telemetry)
}

pub fn latched(core: &Core) -> Faults {
    core.supervisor().latched()
}

pub fn first_failure(core: &Core) -> Option<FirstFailure> {
    core.supervisor().first_failure()
}

pub fn modulation(config: &Config) -> Modulation {
    Modulation::of(config)
}

/// Restarts with a set point, which is checked as if the other core were armed like this one.
pub fn start(core: &mut Core, other: &Core, set_point: SetPoint) -> Result<(), Refusal> {
    let mut other = other.clone();
    if let Some(armed_pa) = core.armed_pa() {
        other.arm(Some(armed_pa))?;
        other.set(set_point)?;
    } else if set_point != SetPoint::Vent {
        return Err(SetPointError::NotArmed.into());
    }
    core.restart_as(&other);
    Ok(())
}

/// Sample with these codes of ADC0 to ADC2.
#[cfg_attr(feature = "hil", allow(dead_code))]
pub fn sample([pressure, gas, length]: [AdcCode; 3]) -> Sample {
    Sample::new(pressure, gas, length)
}

/// Whether the gas sensors, and the pressure sensor, are digital.
pub fn digital(config: &Config) -> ([bool; MUSCLES], bool) {
    let sensors = &config.sensors;
    ([sensors.gas_element.is_digital()], sensors.pressure_part.is_digital())
}

/// Replaces the codes by readings of digital sensors.
#[cfg_attr(feature = "hil", allow(dead_code))]
pub fn take_parts(
    config: &Config,
    parts: &Parts,
    paused: bool,
    seen: &mut Seen,
    sample: &mut Sample,
) {
    let ([gas], pressure) = digital(config);
    if pressure {
        sample.pressure = parts.on_i2c.code(&mut seen.on_i2c, paused);
    }
    if gas {
        for (part, seen) in parts.gas.iter().zip(&mut seen.gas) {
            sample.gas = part.code(seen, paused);
        }
    }
}

/// Checks whether the board can run the configuration, apart from its values.
pub fn check(config: &Config, identity: &Identity) -> Result<(), Refusal> {
    check_muscle(config, identity)
}

/// Carries out requests that are specific to this image.
pub fn carry_out(
    command: HostCommand,
    identity: &Identity,
    _: &Line,
    shared: &'static Shared,
) -> Outcome {
    match command {
        HostCommand::ReadConfig => Outcome::Answer(Answer::Config(ActiveConfig(shared))),
        HostCommand::Configure(config) => {
            match configure(&config, identity, shared, ConfigSource::Host, Name::NONE) {
                Ok(order) => Outcome::Restart(order),
                Err(refusal) => Outcome::Answer(Answer::Refused(refusal)),
            }
        }
        HostCommand::Start(set_point) => Outcome::Restart(Order::Start(set_point)),
        HostCommand::Set(set_point) => Outcome::Order(Order::Set(set_point)),
        #[cfg(feature = "hil")]
        HostCommand::Step(sample) => Outcome::Step(sample),
        #[cfg(not(feature = "hil"))]
        HostCommand::Step(_) => Outcome::Answer(Answer::Refused(Refusal::NoHostSamples)),
        _ => other_image(),
    }
}
