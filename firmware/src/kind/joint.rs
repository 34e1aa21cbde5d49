//! A joint of two muscles.

use crate::board::Modulation;
use crate::link::{Identity, Outcome, check_muscle, configure, done, other_image};
use crate::parts::{Parts, Seen};
use crate::shared::{Answer, Line, Message, Order, Shared};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::mutex::Mutex;
use embassy_time::Duration;
use model_core::joint::encoder::Encoder;
use model_core::joint::{Joint, JointMode};
pub use model_core::joint::{
    JointConfig as Config, JointSample as Sample, JointSetPoint as SetPoint,
    JointTelemetry as Telemetry,
};
use model_core::safety::supervisor::FirstFailure;
use model_core::{AdcCode, Command, Faults};
use serde::{Serialize, Serializer};
use static_cell::StaticCell;
pub use thermyo_protocol::joint_checksum as checksum;
use thermyo_protocol::{ConfigSource, Image, JointRest, Name, PROTOCOL, Refusal, Side};
pub use thermyo_protocol::{HostCommand, Request};

pub const MUSCLES: usize = 2;
pub const IMAGE: Image = Image::Joint;
/// Bytes of the longest value in the store, and schema of the values, whose bytes are those of the
/// messages. The schema never equals one of the image for one muscle, which stores its values in
/// the same place.
pub const MAX_VALUE: usize = 1536;
pub const SCHEMA: u16 = 0x8000 | PROTOCOL;
/// Delay from driving the valves to the start of the PWM period: later steps at a period's start
/// take 190 us longer than the first one and must not miss it.
pub const PWM_DELAY: Duration = Duration::from_micros(500);
pub type Commands = [Command; MUSCLES];
pub const VENT: Commands = [Command::VENT; MUSCLES];

pub type JointTelemetry = Telemetry;

/// Configurations of muscles a and b that wait for the rest of the joint's, each with the line that
/// it came over.
static MUSCLE_CONFIGS: Mutex<
    CriticalSectionRawMutex,
    [Option<(usize, model_core::Config)>; MUSCLES],
> = Mutex::new([None; MUSCLES]);

/// Stands for a muscle's active configuration in a message, which then need not hold its half
/// kilobyte: it is read when the message is sent.
#[derive(Clone, Copy)]
pub struct ActiveConfig(&'static Shared, Side);

impl Serialize for ActiveConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let [a, b] = self.0.config().unwrap_or_default().muscles;
        match self.1 {
            Side::A => a.serialize(serializer),
            Side::B => b.serialize(serializer),
        }
    }
}

/// Stands for the rest of the joint's active configuration, likewise.
#[derive(Clone, Copy)]
pub struct ActiveRest(&'static Shared);

impl Serialize for ActiveRest {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Config { mechanism, tuning, angle_part, .. } = self.0.config().unwrap_or_default();
        (mechanism, tuning, angle_part).serialize(serializer)
    }
}

/// The muscles are statics: the stack has no room for a whole joint.
pub type Core = Joint<&'static mut model_core::Core>;

/// Creates one of the board's two joints: the one that controls, and the one that is configured
/// next.
pub fn unconfigured() -> Core {
    static PLACES: [StaticCell<model_core::Core>; 2 * MUSCLES] =
        [const { StaticCell::new() }; 2 * MUSCLES];
    Core::unconfigured_in(|muscle| {
        let Some(place) = PLACES.iter().find_map(StaticCell::try_uninit) else {
            panic!("a board has two joints");
        };
        place.write(muscle)
    })
}

pub fn commands(telemetry: &Telemetry) -> Commands {
    telemetry.commands()
}

pub fn each(commands: Commands) -> [Command; MUSCLES] {
    commands
}

pub fn is_checking(telemetry: &Telemetry) -> bool {
    telemetry.mode == JointMode::StartupCheck
}

/// Whether the joint is driven: neither vented nor locked.
pub fn moves(telemetry: &Telemetry) -> bool {
    !matches!(telemetry.mode, JointMode::StartupCheck | JointMode::Vent | JointMode::Locked)
}

pub fn step(telemetry: &Telemetry) -> u32 {
    telemetry.step()
}

pub fn faults(telemetry: &Telemetry) -> Faults {
    let [a, b] = &telemetry.muscles;
    a.faults.with(b.faults).with(telemetry.faults.of_failure())
}

pub fn message(telemetry: Telemetry) -> Message {
    Message::JointTelemetry(telemetry)
}

pub fn latched(core: &Core) -> Faults {
    core.latched()
}

pub fn first_failure(core: &Core) -> Option<FirstFailure> {
    core.first_failure()
}

pub fn modulation(config: &Config) -> Modulation {
    let [a, _] = &config.muscles;
    Modulation::of(a)
}

/// Restarts with a set point, which is checked first: a restart keeps the arming. There is no
/// memory for a third joint that could be armed and set first, as is done for one muscle's core.
pub fn start(core: &mut Core, other: &Core, set_point: SetPoint) -> Result<(), Refusal> {
    set_point.check(other.config())?;
    core.may_set(&set_point)?;
    core.restart_as(other);
    core.set(set_point)?;
    Ok(())
}

/// Sample with these codes of ADC0 to ADC2.
pub fn sample([pressure_a, pressure_b, angle]: [AdcCode; 3]) -> Sample {
    Sample { pressure: [pressure_a.into(), pressure_b.into()], angle, ..Sample::default() }
}

/// Whether the gas sensors, and the sensor on I2C, are digital.
pub fn digital(config: &Config) -> ([bool; MUSCLES], bool) {
    ([true; MUSCLES], config.angle_part.is_digital())
}

/// Replaces the codes by readings of digital sensors.
pub fn take_parts(
    config: &Config,
    parts: &Parts,
    paused: bool,
    seen: &mut Seen,
    sample: &mut Sample,
) {
    let sensors = parts.gas.iter().zip(&mut seen.gas);
    for (gas, (part, seen)) in sample.gas.iter_mut().zip(sensors) {
        *gas = part.code(seen, paused);
    }
    if config.angle_part.is_digital() {
        sample.angle = seen.encoder.code(parts.on_i2c.fresh(&mut seen.on_i2c, paused));
    } else {
        seen.encoder = Encoder::default();
    }
}

/// Checks whether the board can run the configuration, apart from its values.
pub fn check(config: &Config, identity: &Identity) -> Result<(), Refusal> {
    for muscle in &config.muscles {
        check_muscle(muscle, identity)?;
        let sensors = &muscle.sensors;
        if sensors.pressure_part.is_digital() || !sensors.gas_element.is_digital() {
            return Err(Refusal::JointSensors);
        }
    }
    Ok(())
}

/// Carries out requests that are specific to this image.
pub fn carry_out(
    command: HostCommand,
    identity: &Identity,
    line: &Line,
    shared: &'static Shared,
) -> Outcome {
    match command {
        HostCommand::ReadMuscle(side) => {
            Outcome::Answer(Answer::Config(ActiveConfig(shared, side)))
        }
        HostCommand::ReadJoint => Outcome::Answer(Answer::Joint(ActiveRest(shared))),
        HostCommand::ConfigureMuscle(side, config) => {
            // The tasks of the thread take turns, so the lock is free.
            if let Ok(mut configs) = MUSCLE_CONFIGS.try_lock() {
                let [a, b] = &mut *configs;
                let waits = Some((shared.index(line), config));
                match side {
                    Side::A => *a = waits,
                    Side::B => *b = waits,
                }
            }
            Outcome::Answer(done(shared))
        }
        HostCommand::ConfigureJoint(rest) => commit(rest, identity, line, shared)
            .unwrap_or_else(|refusal| Outcome::Answer(Answer::Refused(refusal))),
        HostCommand::StartJoint(set_point) => Outcome::Restart(Order::Start(set_point)),
        HostCommand::SetJoint(set_point) => Outcome::Order(Order::Set(set_point)),
        HostCommand::Step(_) => Outcome::Answer(Answer::Refused(Refusal::NoHostSamples)),
        _ => other_image(),
    }
}

fn commit(
    (mechanism, tuning, angle_part): JointRest,
    identity: &Identity,
    line: &Line,
    shared: &'static Shared,
) -> Result<Outcome, Refusal> {
    let mut configs = MUSCLE_CONFIGS.try_lock().map_err(|_| Refusal::NoMuscles)?;
    let [Some((of_a, a)), Some((of_b, b))] = *configs else {
        return Err(Refusal::NoMuscles);
    };
    // Another host's muscles do not belong to this joint.
    if [of_a, of_b] != [shared.index(line); MUSCLES] {
        return Err(Refusal::NoMuscles);
    }
    *configs = [None; MUSCLES];
    let config = Config { muscles: [a, b], mechanism, tuning, angle_part };
    configure(&config, identity, shared, ConfigSource::Host, Name::NONE).map(Outcome::Restart)
}
