//! Messages between board and host, over a UART or USB.
//!
//! A frame is one message in postcard's encoding and its CRC-32 (ISO-HDLC, little end first), both stuffed by COBS, and
//! a zero byte. COBS leaves no zero inside a frame, so a receiver that starts late or reads garbage is in step again
//! after the next zero. Numbers cross without loss: f32 as its four bytes, raw codes as they are, so that a recorded
//! run can be compared to the bit.
//!
//! The host asks ([`Request`]), the board answers each request with one [`Reply`] of the same
//! sequence number, and sends [`Message::Telemetry`] of its own accord.
//!
//! A client that moves a muscle on a board at a serial port, 921 600 baud:
//!
//! ```
//! use std::io::{self, Read, Write};
//! use thermyo_protocol::model_core::SetPoint;
//! use thermyo_protocol::{Answer, Decoder, HostCommand, Message, PROTOCOL, Reply, Request, encode};
//!
//! struct Client<P> {
//!     port: P,
//!     decoder: Decoder,
//!     sequence: u8,
//! }
//!
//! impl<P: Read + Write> Client<P> {
//!     fn ask(&mut self, command: HostCommand) -> io::Result<Answer> {
//!         self.sequence = self.sequence.wrapping_add(1);
//!         let request = Request { sequence: self.sequence, command };
//!         self.port.write_all(&encode(&request).expect("every request fits a frame"))?;
//!         loop {
//!             let mut byte = [0];
//!             self.port.read_exact(&mut byte)?;
//!             match self.decoder.push(byte[0]) {
//!                 Some(Message::Reply(Reply { sequence, answer })) if sequence == self.sequence => {
//!                     return Ok(answer);
//!                 }
//!                 Some(Message::Telemetry(step)) => println!("{} K", step.estimate.gas_k),
//!                 _ => (),
//!             }
//!         }
//!     }
//! }
//!
//! fn hold(port: impl Read + Write, pressure_pa: f32) -> io::Result<Answer> {
//!     let mut board = Client { port, decoder: Decoder::new(), sequence: 0 };
//!     match board.ask(HostCommand::Version)? {
//!         Answer::Version(version) if version.protocol == PROTOCOL => (),
//!         other => return Err(io::Error::other(format!("protocol {PROTOCOL} needed: {other:?}"))),
//!     }
//!     board.ask(HostCommand::Arm { most_pa: None })?;
//!     // The board vents after half a second without a request: `HostCommand::Alive` is one.
//!     board.ask(HostCommand::Set(SetPoint::Pressure { pressure_pa }))
//! }
//! # use thermyo_protocol::model_core::{Config, Core, Sample};
//! # use thermyo_protocol::{Chip, Image, Refusal, Version};
//! # /// A board in this process, configured, and past its startup check.
//! # struct Board { core: Core, decoder: Decoder, sent: std::collections::VecDeque<u8> }
//! # impl Write for Board {
//! #     fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
//! #         for &byte in bytes {
//! #             let Some(Request { sequence, command }) = self.decoder.push(byte) else { continue };
//! #             let done = |outcome: Result<(), _>| match outcome {
//! #                 Ok(()) => Answer::Done { step: 0 },
//! #                 Err(error) => Answer::Refused(Refusal::SetPoint(error)),
//! #             };
//! #             let answer = match command {
//! #                 HostCommand::Version => Answer::Version(Version {
//! #                     protocol: PROTOCOL, firmware: [0, 1, 0], chip: Chip::Rp2040, image: Image::Muscle,
//! #                 }),
//! #                 HostCommand::Arm { most_pa } => done(self.core.arm(most_pa)),
//! #                 HostCommand::Set(set_point) => done(self.core.set(set_point)),
//! #                 other => unreachable!("{other:?}"),
//! #             };
//! #             let telemetry = self.core.step(&Sample::default());
//! #             for message in [Message::Telemetry(telemetry), Message::Reply(Reply { sequence, answer })] {
//! #                 self.sent.extend(encode(&message).unwrap());
//! #             }
//! #         }
//! #         Ok(bytes.len())
//! #     }
//! #     fn flush(&mut self) -> io::Result<()> { Ok(()) }
//! # }
//! # impl Read for Board {
//! #     fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> { self.sent.read(bytes) }
//! # }
//! # let board = || Board {
//! #     core: Core::new(&Config::default()).unwrap(),
//! #     decoder: Decoder::new(),
//! #     sent: Default::default(),
//! # };
//! # assert_eq!(hold(board(), 2.5e5).unwrap(), Answer::Done { step: 0 });
//! # assert!(matches!(hold(board(), 2.5e6).unwrap(), Answer::Refused(_)));
//! ```

#![cfg_attr(not(test), no_std)]
#![forbid(unsafe_code)]
#![warn(missing_docs)]
#![deny(clippy::indexing_slicing, clippy::unwrap_used, clippy::expect_used, clippy::panic)]
#![cfg_attr(test, allow(clippy::indexing_slicing, clippy::unwrap_used, clippy::panic))]

pub mod arbiter;

pub use model_core;

use cobs::{DecodeResult, DecoderState};
use crc::{CRC_32_ISO_HDLC, Crc, Digest};
use model_core::config::Config;
use model_core::control::SetPointError;
use model_core::joint::{
    AnglePart, JointConfig, JointError, JointSetPoint, JointTelemetry, JointTuning, Mechanism,
};
use model_core::parameter::ConfigError;
use model_core::safety::supervisor::FirstFailure;
use model_core::sample::{Sample, SetPoint, Telemetry};
use serde::de::{DeserializeOwned, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

/// Version of these messages. Board and host must have the same one.
pub const PROTOCOL: u16 = 24;
/// USB vendor and product of a board: pid.codes' pair for tests, until the project has its own.
pub const USB_ID: (u16, u16) = (0x1209, 0x0001);
/// USB name of the board's maker, which distinguishes it from other devices of [`USB_ID`].
pub const USB_MANUFACTURER: &str = "Thermyo";
/// Speed of the serial line \[baud\], 8 data bits, no parity, one stop bit.
pub const BAUD: u32 = 921_600;
/// Longest frame including its zero \[bytes\].
pub const MAX_FRAME: usize = 640;

/// Longest message and CRC before COBS adds a byte for each 254, or part of them, and the zero.
const MAX_PAYLOAD: usize = MAX_FRAME - 4;
const CRC_BYTES: usize = 4;
static CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// A request from the host to the board.
pub type Request = RequestWith<Config, JointRest, JointSetPoint>;
/// Commands of the host.
pub type HostCommand = HostCommandWith<Config, JointRest, JointSetPoint>;

/// [`Request`] with the joint's parts as types `C`, `J` and `P`: on a board for one muscle each is [`Unread`], and its
/// image has no code for them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RequestWith<C, J, P> {
    /// Number that comes back with the reply.
    pub sequence: u8,
    /// The command of the request.
    pub command: HostCommandWith<C, J, P>,
}

/// [`HostCommand`] in a [`RequestWith`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant)] // One at a time, in a static buffer.
pub enum HostCommandWith<C, J, P> {
    /// The board's version: [`Answer::Version`]. Kept first, so that every protocol version can ask for it. A host asks
    /// once, when it connects: the set point of the previous host on the line is then no longer kept alive.
    Version,
    /// Restart into the boot loader, which accepts another image; only while the board vents. Kept second, so that
    /// every protocol version can request a newer firmware.
    BootLoader,
    /// The configuration in use: [`Answer::Config`].
    ReadConfig,
    /// A complete new configuration, without a name: the core restarts with it, vents, and is not armed.
    Configure(Config),
    /// Restart the core with its configuration and its present arming; the next step is step 0.
    Start(SetPoint),
    /// Another set point, from the step named in the reply on.
    Set(SetPoint),
    /// Vent. Orders that were sent before it on any line and could drive are refused: [`Refusal::Overtaken`].
    Stop,
    /// Forget latched faults whose cause is gone; the board then vents.
    ClearFaults,
    /// One telemetry frame per this many steps; 0 for none.
    TelemetryDivider(u16),
    /// Timing of the steps: [`Answer::Timing`].
    Timing,
    /// Reason of the board's last start: [`Answer::LastReset`].
    LastReset,
    /// The first venting fault: [`Answer::FirstFailure`].
    FirstFailure,
    /// Sign of life of the host; it gets no answer.
    Alive,
    /// One step on this sample instead of one from the ADC; only for firmware with the `hil` feature. The reply is the
    /// step's telemetry.
    Step(Sample),
    /// Accept set points from now on, up to this absolute pressure \[Pa\]; `None`: up to the configured maximum. The
    /// muscle vents until there is one.
    Arm {
        /// Absolute pressure \[Pa\].
        most_pa: Option<f32>,
    },
    /// The status: [`Answer::Status`].
    Status,
    /// Set the name of the configuration in use.
    Name(Name),
    /// Save the configuration in use, with its name, so that it survives a loss of power.
    Save,
    /// Forget the saved configuration.
    Forget,
    /// Read the event of this number, counted from 0 for the last one: [`Answer::Event`].
    History(u8),
    /// For a joint: the configuration of one of its muscles, used from the next [`Self::ConfigureJoint`] on.
    ConfigureMuscle(Side, C),
    /// The rest of a joint's configuration: together with both muscles' it is a complete new one, like
    /// [`Self::Configure`].
    ConfigureJoint(J),
    /// [`Self::Start`] for a joint.
    StartJoint(P),
    /// [`Self::Set`] for a joint.
    SetJoint(P),
    /// Read the active configuration of one of a joint's muscles: [`Answer::Config`].
    ReadMuscle(Side),
    /// Read the rest of a joint's active configuration: [`Answer::Joint`].
    ReadJoint,
}

/// The rest of a message, whatever it contains: read and discarded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unread;

impl<'de> Deserialize<'de> for Unread {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Rest;
        impl<'de> Visitor<'de> for Rest {
            type Value = Unread;

            fn expecting(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                f.write_str("bytes")
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut bytes: A) -> Result<Unread, A::Error> {
                // postcard reports the end of the message as an error.
                while let Ok(Some(_)) = bytes.next_element::<u8>() {}
                Ok(Unread)
            }
        }
        deserializer.deserialize_tuple(MAX_PAYLOAD, Rest)
    }
}

/// One of a joint's muscles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Side {
    /// Muscle a, which shortens as the angle grows.
    A,
    /// Muscle b.
    B,
}

/// A joint's configuration without its muscles.
pub type JointRest = (Mechanism, JointTuning, AnglePart);

/// A message from the board to the host.
pub type Message = MessageWith<Config, JointRest, JointTelemetry>;
/// An answer with the number of its request.
pub type Reply = ReplyWith<Config, JointRest>;
/// Answers of the board.
pub type Answer = AnswerWith<Config, JointRest>;

/// [`Message`] with its configuration as `C`, the rest of a joint's as `J` and a joint's telemetry as `T`. Only the
/// encodings must match: a board with little memory need not hold a configuration for every waiting message, nor types
/// that it never sends.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant)]
pub enum MessageWith<C, J, T> {
    /// Telemetry of one step.
    Telemetry(Telemetry),
    /// Answer to the request of the same sequence number.
    Reply(ReplyWith<C, J>),
    /// The status, on each change and twice a second.
    Status(Status),
    /// Telemetry of one step of a joint.
    JointTelemetry(T),
}

/// [`Reply`] in a [`MessageWith`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ReplyWith<C, J> {
    /// Number of the request.
    pub sequence: u8,
    /// The answer.
    pub answer: AnswerWith<C, J>,
}

/// [`Answer`] in a [`MessageWith`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant)]
pub enum AnswerWith<C, J> {
    /// Version and purpose of the board's firmware.
    Version(Version),
    /// The request was carried out; it takes effect from this step on.
    Done {
        /// Number of the first step that it affects.
        step: u32,
    },
    /// The request was not carried out.
    Refused(Refusal),
    /// The configuration in use.
    Config(C),
    /// Timing of the steps.
    Timing(Timing),
    /// Reason of the board's last start.
    LastReset(LastReset),
    /// The first venting fault since faults were last cleared, including one before the last restart.
    FirstFailure(Option<FirstFailure>),
    /// Status of the board.
    Status(Status),
    /// An event; `None` beyond the oldest one that is remembered.
    Event(Option<Event>),
    /// The joint's active configuration, without its muscles.
    Joint(J),
}

/// Reason why a request was not carried out.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Refusal {
    /// A value of the configuration is out of its range; [`Config::check`] on the host names the value.
    Config,
    /// The board runs at its own step, this one \[us\].
    Step {
        /// Step of the board \[us\].
        board_us: u32,
    },
    /// The valves' PWM cannot be that slow: at most this many steps per period.
    Period {
        /// Longest period in steps \[-\].
        maximum_steps: u16,
    },
    /// Samples from the host need firmware with the `hil` feature.
    NoHostSamples,
    /// The set point was refused: the value and its permitted range, or the faults that vent.
    SetPoint(SetPointError),
    /// The board has not been configured since it started.
    NotConfigured,
    /// This board has no store for a configuration.
    NoStore,
    /// The request is carried out only while the board vents: writing its flash, or starting its boot loader.
    NotVented,
    /// The flash could not be written.
    Flash,
    /// The board has no boot loader that it could start by itself.
    NoBootLoader,
    /// A [`HostCommand::Stop`] on another line came after it was sent: [`arbiter`]. Or another line configured the
    /// board while this request to configure or start it waited.
    Overtaken,
    /// A joint's request to an image for one muscle, or vice versa.
    OtherImage {
        /// Whether the board's image is for a joint.
        joint: bool,
    },
    /// A joint's set point was refused: the value and its permitted range, or the faults that vent.
    JointSetPoint(JointError),
    /// A joint's board uses its converter for both pressures and the angle, and reads gas temperatures from MAX31865
    /// chips.
    JointSensors,
    /// A joint's configuration came before those of both muscles.
    NoMuscles,
}

impl From<JointError> for Refusal {
    fn from(error: JointError) -> Self {
        Self::JointSetPoint(error)
    }
}

impl From<SetPointError> for Refusal {
    fn from(error: SetPointError) -> Self {
        Self::SetPoint(error)
    }
}

impl From<ConfigError> for Refusal {
    fn from(_: ConfigError) -> Self {
        Self::Config
    }
}

impl core::fmt::Display for Refusal {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Config => write!(f, "a value of the configuration is out of its range"),
            Self::Step { board_us } => write!(f, "the board's step is {board_us} us"),
            Self::Period { maximum_steps } => {
                write!(f, "a PWM period has at most {maximum_steps} steps on this board")
            }
            Self::NoHostSamples => {
                write!(f, "this firmware samples its ADC: flash the one built with `hil`")
            }
            Self::SetPoint(error) => error.fmt(f),
            Self::NotConfigured => {
                write!(f, "the board has no configuration since it started: configure it first")
            }
            Self::NoStore => write!(f, "this board cannot save a configuration"),
            Self::NotVented => write!(f, "the board does that while it vents: stop it first"),
            Self::Flash => write!(f, "the flash does not take it: it is worn out or damaged"),
            Self::NoBootLoader => write!(f, "this board is flashed through its probe"),
            Self::Overtaken => {
                write!(
                    f,
                    "another host has stopped or configured the board meanwhile: it is not carried out"
                )
            }
            Self::OtherImage { joint: false } => write!(
                f,
                "this board's image drives one muscle: `thermyo flash --joint` writes that of a joint"
            ),
            Self::OtherImage { joint: true } => write!(
                f,
                "this board's image drives a joint: `thermyo flash` writes that of one muscle"
            ),
            Self::JointSetPoint(error) => error.fmt(f),
            Self::JointSensors => write!(
                f,
                "a joint's board reads gas temperatures with MAX31865 chips and pressures with its converter: \
                 sensor.gas.kind = \"max31865\", sensor.pressure.kind = \"ratiometric\""
            ),
            Self::NoMuscles => {
                write!(f, "the configurations of both muscles come before that of their joint")
            }
        }
    }
}

impl core::error::Error for Refusal {}

/// Protocol, firmware and chip of a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Version {
    /// [`PROTOCOL`] of the board. Kept first.
    pub protocol: u16,
    /// Version of the firmware: major, minor, patch.
    pub firmware: [u16; 3],
    /// The chip.
    pub chip: Chip,
    /// The purpose of the image. One byte, 0 or 1 before protocol 18, so the answer of an older board can be read too.
    pub image: Image,
}

/// Images of the firmware.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Image {
    /// The image drives one muscle.
    Muscle,
    /// The same, with samples from the host.
    Hil,
    /// The image drives a joint of two muscles.
    Joint,
}

/// Name of a configuration: up to 24 bytes of UTF-8, padded with zeros.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
pub struct Name([u8; 24]);

impl Name {
    /// No name.
    pub const NONE: Self = Self([0; 24]);

    /// Creates the name, or as much of it as fits.
    pub fn new(text: &str) -> Self {
        let mut bytes = [0; 24];
        let mut end = 0;
        for character in text.chars() {
            let Some(place) = bytes.get_mut(end..end + character.len_utf8()) else { break };
            character.encode_utf8(place);
            end += character.len_utf8();
        }
        Self(bytes)
    }

    /// The name as text; empty if there is none.
    pub fn as_str(&self) -> &str {
        let end = self.0.iter().position(|&byte| byte == 0).unwrap_or(self.0.len());
        let bytes = self.0.get(..end).unwrap_or_default();
        core::str::from_utf8(bytes).unwrap_or_default()
    }
}

/// Status of the board.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Status {
    /// Number of the step from which this status holds.
    pub step: u32,
    /// Unrequested restarts of the board since power came.
    pub restarts: u32,
    /// Starts of the core since the board started: each of them restarts its steps from 0.
    pub starts: u32,
    /// [`checksum`] of the configuration in use.
    pub config_checksum: u32,
    /// Origin of the configuration.
    pub config_source: ConfigSource,
    /// Name of the configuration.
    pub config_name: Name,
    /// Highest absolute pressure that set points may request \[Pa\]; `None`: the board is not armed.
    pub armed_pa: Option<f32>,
}

impl Status {
    /// Status after the first start since power came.
    pub const AT_START: Self = Self {
        step: 0,
        restarts: 0,
        starts: 0,
        config_checksum: 0,
        config_source: ConfigSource::Defaults,
        config_name: Name::NONE,
        armed_pa: None,
    };
}

/// Origin of a configuration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
pub enum ConfigSource {
    /// The core's defaults, which describe another muscle.
    #[default]
    Defaults,
    /// The host, since the board started.
    Host,
    /// The board's own flash.
    Flash,
}

/// Something that happened to a board.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Event {
    /// The board started.
    Started(LastReset),
    /// The board vented.
    Vented(FirstFailure),
}

/// Identifies a configuration: the CRC-32 of its encoding.
// Compiled where it is called: for a board's flash that means for size, like its other encodings of a configuration.
#[inline]
pub fn checksum(config: &Config) -> u32 {
    let mut digest = CRC.digest();
    add(&mut digest, config);
    digest.finalize()
}

/// Identifies a joint's configuration: the CRC-32 of the encodings of muscle a, of muscle b and of the rest.
#[inline]
pub fn joint_checksum(config: &JointConfig) -> u32 {
    let JointConfig { muscles: [a, b], mechanism, tuning, angle_part } = config;
    let mut digest = CRC.digest();
    add(&mut digest, a);
    add(&mut digest, b);
    add(&mut digest, &(mechanism, tuning, angle_part));
    digest.finalize()
}

fn add(digest: &mut Digest<'_, u32>, value: &impl Serialize) {
    let mut bytes = [0_u8; MAX_PAYLOAD];
    // Every configuration fits, or it could not have come over the link.
    if let Ok(encoded) = postcard::to_slice(value, &mut bytes) {
        digest.update(encoded);
    }
}

/// Chips that the firmware is built for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Chip {
    /// Raspberry Pi Pico.
    Rp2040,
    /// Raspberry Pi Pico 2.
    Rp2350,
    /// NUCLEO-G474RE.
    Stm32G474,
}

impl core::fmt::Display for Chip {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Rp2040 => "RP2040",
            Self::Rp2350 => "RP2350",
            Self::Stm32G474 => "STM32G474",
        })
    }
}

/// Timing of the steps since the board started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
pub struct Timing {
    /// Number of steps.
    pub steps: u64,
    /// Steps that were left out because the previous one was not done.
    pub missed_steps: u32,
    /// Mean time of the core's step \[ns\].
    pub step_mean_ns: u32,
    /// Worst time of the core's step \[us\].
    pub step_worst_us: u32,
    /// Worst time from waking to sleeping: sampling, the core's step, valves, telemetry \[us\].
    pub busy_worst_us: u32,
    /// Mean delay of a step's start \[ns\].
    pub jitter_mean_ns: u32,
    /// Worst delay of a step's start \[us\].
    pub jitter_worst_us: u32,
    /// Telemetry frames that the line was too slow for.
    pub dropped_telemetry: u32,
    /// Frames from the host that were malformed and dropped.
    pub malformed_frames: u32,
    /// Requests that were dropped because more came than the board carries out.
    pub dropped_requests: u32,
}

/// Reason why the board last started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum LastReset {
    /// Power, the reset pin, or a probe.
    Power,
    /// The watchdog was not fed.
    Watchdog {
        /// Activity of the control task.
        phase: Phase,
    },
    /// The firmware panicked.
    Panic {
        /// Line of the source.
        line: u32,
        /// Activity of the control task.
        phase: Phase,
    },
    /// The processor met a fault.
    HardFault {
        /// Address of the instruction.
        address: u32,
        /// Activity of the control task.
        phase: Phase,
    },
}

/// Activity of the control task.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Phase {
    /// Before the first step.
    Starting,
    /// Waiting for the next step's time.
    Waiting,
    /// Reading the ADC.
    Sampling,
    /// Running the core.
    Stepping,
    /// Driving the valves and sending telemetry.
    Driving,
}

/// The message does not fit a frame. All messages of this module fit; the tests check it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TooLong;

/// Bytes of a frame.
pub type Frame = heapless::Vec<u8, MAX_FRAME>;

/// Encodes a message as a frame.
///
/// # Errors
/// [`TooLong`] for a type whose encoding exceeds [`MAX_FRAME`].
pub fn encode<T: Serialize>(message: &T) -> Result<Frame, TooLong> {
    let mut payload = [0_u8; MAX_PAYLOAD];
    let length = postcard::to_slice(message, &mut payload).map_err(|_| TooLong)?.len();
    let (message, rest) = payload.split_at_mut_checked(length).ok_or(TooLong)?;
    *rest.first_chunk_mut::<CRC_BYTES>().ok_or(TooLong)? = CRC.checksum(message).to_le_bytes();
    let content = payload.get(..length + CRC_BYTES).ok_or(TooLong)?;
    let mut frame = Frame::new();
    // No longer than it may become: an RP2040 takes 50 us to set all of it.
    frame.resize(cobs::max_encoding_length(content.len()) + 1, 0).map_err(|_| TooLong)?;
    let stuffed = cobs::try_encode(content, &mut frame).map_err(|_| TooLong)?;
    if let Some(end) = frame.get_mut(stuffed) {
        *end = 0;
    }
    frame.truncate(stuffed + 1);
    Ok(frame)
}

/// Assembles messages from a stream of bytes; anything else is counted and dropped.
#[derive(Debug)]
pub struct Decoder {
    cobs: DecoderState,
    /// Message and checksum so far.
    content: heapless::Vec<u8, MAX_PAYLOAD>,
    /// Whether the present frame is longer than any can be.
    overlong: bool,
    malformed: u32,
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}

impl Decoder {
    /// Creates a decoder at the start of a frame.
    ///
    /// ```
    /// use thermyo_protocol::{Decoder, HostCommand, encode};
    ///
    /// let mut decoder = Decoder::new();
    /// let frame = encode(&HostCommand::Alive).unwrap();
    /// let received = frame.iter().find_map(|byte| decoder.push::<HostCommand>(*byte));
    /// assert_eq!(received, Some(HostCommand::Alive));
    /// ```
    pub const fn new() -> Self {
        Self {
            cobs: DecoderState::Idle,
            content: heapless::Vec::new(),
            overlong: false,
            malformed: 0,
        }
    }

    /// Number of dropped frames: too long, damaged, or no known message; wraps.
    pub fn malformed(&self) -> u32 {
        self.malformed
    }

    /// Takes one byte; returns the message that it completes.
    pub fn push<T: DeserializeOwned>(&mut self, byte: u8) -> Option<T> {
        let message = match self.cobs.feed(byte) {
            Ok(DecodeResult::NoData) => return None,
            Ok(DecodeResult::DataContinue(byte)) => {
                self.overlong |= self.content.push(byte).is_err();
                return None;
            }
            // Ends a truncated frame, if there was one.
            Ok(DecodeResult::DataComplete) if self.content.is_empty() => return None,
            Ok(DecodeResult::DataComplete) if !self.overlong => decode(&self.content),
            Ok(DecodeResult::DataComplete) | Err(_) => None,
        };
        if message.is_none() {
            self.malformed = self.malformed.wrapping_add(1);
        }
        self.content.clear();
        self.overlong = false;
        message
    }
}

/// Decodes the message of a frame's content.
fn decode<T: DeserializeOwned>(content: &[u8]) -> Option<T> {
    let (payload, checksum) = content.split_last_chunk::<CRC_BYTES>()?;
    if CRC.checksum(payload) != u32::from_le_bytes(*checksum) {
        return None;
    }
    let (message, rest) = postcard::take_from_bytes(payload).ok()?;
    rest.is_empty().then_some(message)
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::joint::{JointFaults, JointMode, Motion};
    use model_core::physics::chamber::table::{MOST_ROWS, Row};
    use model_core::physics::chamber::{ChamberConfig, Table};
    use model_core::sample::{AdcCode, Command, Duty, Estimate, Faults, Mode, RawCode};
    use model_core::sensing::Sensors;
    use model_core::sensing::gas::{GasElement, Max31865};
    use model_core::sensing::pressure::{Mpr, PressurePart};
    use proptest::prelude::*;

    /// Every field takes the most bytes that it can.
    fn longest_telemetry() -> Telemetry {
        let code = RawCode::of_part(0x7fff, true);
        let value = f32::from_bits(0x7fc1_2345);
        Telemetry {
            step: u32::MAX,
            sample: Sample {
                pressure: code,
                gas: code,
                length: AdcCode(u16::MAX),
                emergency_stop: true,
                heard: true,
                flooded: true,
                missed_steps: u8::MAX,
            },
            pressure_pa: value,
            length_m: value,
            estimate: Estimate {
                gas_k: value,
                gas_sd_k: value,
                valid: value > 0.0,
                wall_k: value,
                sensor_k: value,
                mass_kg: value,
                heat_scale: value,
                sensor_lag_s: value,
            },
            command: Command { inlet: Duty::FULL, outlet: Duty::FULL },
            mode: Mode::ContractionHeld,
            limited: true,
            set_point: SetPoint::Pressure { pressure_pa: value },
            faults: Faults(u32::MAX),
        }
    }

    fn longest_of_joint() -> JointTelemetry {
        let value = f32::from_bits(0x7fc1_2345);
        JointTelemetry {
            muscles: [longest_telemetry(); 2],
            mode: JointMode::AngleHeld,
            angle_rad: value,
            speed_rad_s: value,
            reference_rad: value,
            torque_n_m: value,
            stiffness_n_m_rad: value,
            disturbance_n_m: value,
            limited: true,
            set_point: JointSetPoint::Angle(Motion::still(value, value)),
            faults: JointFaults(u8::MAX),
        }
    }

    /// The serial line carries one frame in three steps.
    #[test]
    fn telemetry_of_a_joint_fits_three_milliseconds() {
        let telemetry = encode(&Message::JointTelemetry(longest_of_joint())).unwrap().len();
        assert!((130..=3 * (BAUD / 10 / 1000) as usize).contains(&telemetry), "{telemetry} bytes");
    }

    #[test]
    fn a_joints_checksum_tells_its_parts_apart() {
        let config = JointConfig::default();
        let mut others = [config; 3];
        others[0].muscles[0].link.timeout_s = 0.4;
        others[1].muscles[1].link.timeout_s = 0.4;
        others[2].mechanism.radius_m = 0.03;
        let mut sums: Vec<u32> = others.iter().chain([&config]).map(joint_checksum).collect();
        sums.sort_unstable();
        sums.dedup();
        assert_eq!(sums.len(), 4);
    }

    fn decode_all<T: DeserializeOwned>(decoder: &mut Decoder, bytes: &[u8]) -> Vec<T> {
        bytes.iter().filter_map(|&byte| decoder.push(byte)).collect()
    }

    /// The line carries 92 bytes in one millisecond; beside telemetry there is room for one reply per step.
    #[test]
    fn telemetry_fits_one_millisecond() {
        let bytes_per_ms = (BAUD / 10 / 1000) as usize;
        let telemetry = encode(&Message::Telemetry(longest_telemetry())).unwrap().len();
        let done = Reply { sequence: 255, answer: Answer::Done { step: u32::MAX } };
        let reply = encode(&Message::Reply(done)).unwrap().len();
        assert!((60..=bytes_per_ms - reply).contains(&telemetry), "{telemetry} + {reply} bytes");
        // If a set point has two values, the reply comes with the next step's telemetry.
        let cycle = SetPoint::MassFlowCycle { flow_kg_s: f32::NAN, period_s: f32::NAN };
        let longest = Telemetry { set_point: cycle, ..longest_telemetry() };
        let telemetry = encode(&Message::Telemetry(longest)).unwrap().len();
        assert!(telemetry <= bytes_per_ms, "{telemetry} bytes");
    }

    #[test]
    fn a_name_is_cut_where_a_character_ends() {
        for (text, name) in [
            ("nominal", "nominal"),
            ("", ""),
            ("a muscle with a long name", "a muscle with a long nam"),
            ("a muscle with a long nam\u{e9}", "a muscle with a long nam"),
            ("a muscle with a long na\u{e9}", "a muscle with a long na"),
        ] {
            assert_eq!(Name::new(text).as_str(), name);
        }
        assert_eq!(Name([0xff; 24]).as_str(), "", "what is no text is none");
    }

    #[test]
    fn a_checksum_tells_configurations_apart() {
        let config = Config::default();
        let mut other = config;
        other.link.timeout_s = f32::from_bits(other.link.timeout_s.to_bits() + 1);
        assert_eq!(checksum(&config), checksum(&config.clone()));
        assert_ne!(checksum(&config), checksum(&other));
    }

    #[test]
    fn the_longest_messages_fit_a_frame() {
        let table = Table { rows: [Row::default(); MOST_ROWS], count: 12, rest_length_m: 0.1 };
        let sensors = Sensors {
            gas_element: GasElement::Max31865(Max31865::default()),
            pressure_part: PressurePart::Mpr(Mpr::default()),
            ..Sensors::default()
        };
        let chamber = ChamberConfig::Table(table);
        let config = Config { chamber, sensors, ..Config::default() };
        let command = HostCommand::ConfigureMuscle(Side::B, config);
        let request = Request { sequence: 255, command };
        let reply = Message::Reply(Reply { sequence: 255, answer: Answer::Config(config) });
        for length in [encode(&request).unwrap().len(), encode(&reply).unwrap().len()] {
            // Integers of the configuration may need two bytes more than the default's.
            assert!((300..=MAX_FRAME - 4).contains(&length), "{length} bytes");
        }
        let timing = Timing {
            steps: u64::MAX,
            missed_steps: u32::MAX,
            step_mean_ns: u32::MAX,
            step_worst_us: u32::MAX,
            busy_worst_us: u32::MAX,
            jitter_mean_ns: u32::MAX,
            jitter_worst_us: u32::MAX,
            dropped_telemetry: u32::MAX,
            malformed_frames: u32::MAX,
            dropped_requests: u32::MAX,
        };
        assert!(
            encode(&Message::Reply(Reply { sequence: 0, answer: Answer::Timing(timing) })).is_ok()
        );
        assert_eq!(encode(&[u64::MAX; 64].as_slice()), Err(TooLong));
    }

    /// The bytes of [`PROTOCOL`]: a change of them must change its number, and these values.
    #[test]
    fn the_bytes_of_the_protocol_are_these() {
        let hex = |frame: Frame| frame.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        let request = |command| hex(encode(&Request { sequence: 7, command }).unwrap());
        let answer = |answer| hex(encode(&Message::Reply(Reply { sequence: 7, answer })).unwrap());
        let pressure_pa = 2.5e5;
        let failure = FirstFailure { faults: Faults::BURST, pressure_pa: 2.5e5, step: 9 };
        let version = Version {
            protocol: PROTOCOL,
            firmware: [0, 1, 0],
            chip: Chip::Rp2040,
            image: Image::Muscle,
        };
        let phase = Phase::Stepping;
        let sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));
        let status = Status {
            step: 1000,
            restarts: 2,
            starts: 3,
            config_checksum: 0x1234_5678,
            config_source: ConfigSource::Host,
            config_name: Name::new("nominal"),
            armed_pa: Some(pressure_pa),
        };
        let (found, expected): (Vec<String>, Vec<&str>) = [
            (request(HostCommand::Version), "0207053884980e00"),
            (request(HostCommand::BootLoader), "070701aeb49f7900"),
            (
                request(HostCommand::Set(SetPoint::Pressure { pressure_pa })),
                "0407050408247448ef4d96f100",
            ),
            (request(HostCommand::Stop), "0707060d21fbe700"),
            (request(HostCommand::ClearFaults), "0707079b11fc9000"),
            (request(HostCommand::TelemetryDivider(10)), "0807080a81ac02d200"),
            (request(HostCommand::Alive), "07070c13c82e0700"),
            (request(HostCommand::Step(sample)), "03070d035a1e054e3ecd5c02010105c5cc30c500"),
            (answer(Answer::Version(version)), "0301070218020101010567ee8eac00"),
            (answer(Answer::Done { step: 1000 }), "0a010701e8076460946f00"),
            (answer(Answer::Refused(Refusal::NotConfigured)), "0901070205f138ebde00"),
            (
                answer(Answer::LastReset(LastReset::Panic { line: 300, phase })),
                "0c01070502ac0203b534aa3f00",
            ),
            (request(HostCommand::Arm { most_pa: Some(pressure_pa) }), "04070e01082474485c32b15300"),
            (request(HostCommand::Save), "070711caa4286400"),
            (request(HostCommand::History(1)), "0807130193bee6ec00"),
            (request(HostCommand::SetJoint(JointSetPoint::Angle(Motion::still(0.5, 14.0)))), "040717040101023f0101010101010101010760412c119c6800"),
            (request(HostCommand::ReadMuscle(Side::B)), "080718015867120f00"),
            (request(HostCommand::ReadJoint), "070719f82cf36a00"),
            (hex(encode(&Message::Status(status)).unwrap()), "1302e8070203f8acd19101016e6f6d696e616c01010101010101010101010101010101020108247448a05ee7b800"),
            (answer(Answer::Event(Some(Event::Vented(failure)))), "080107080101800809247448097926dc5800"),
            (answer(Answer::FirstFailure(Some(failure))), "07010706018008092474480992e1f4ae00"),
        ]
        .into_iter()
        .unzip();
        assert_eq!(found, expected);
        // The long ones by their checksums.
        let config = Request { sequence: 7, command: HostCommand::Configure(Config::default()) };
        let telemetry = Message::Telemetry(longest_telemetry());
        let muscle = HostCommand::ConfigureMuscle(Side::A, Config::default());
        let muscle = Request { sequence: 7, command: muscle };
        let joint = JointConfig::default();
        let joint = HostCommand::ConfigureJoint((joint.mechanism, joint.tuning, joint.angle_part));
        let joint = Request { sequence: 7, command: joint };
        let of_joint = Message::JointTelemetry(longest_of_joint());
        for (frame, expected) in [
            (encode(&config), (466, 2_278_870_752)),
            (encode(&telemetry), (77, 1_017_350_385)),
            (encode(&muscle), (467, 3_501_585_281)),
            (encode(&joint), (161, 4_259_523_710)),
            (encode(&of_joint), (191, 1_436_421_169)),
        ] {
            let frame = frame.unwrap();
            assert_eq!((frame.len(), CRC.checksum(&frame)), expected);
        }
    }

    /// A board for one muscle must answer that it does not accept it.
    #[test]
    fn what_only_a_joint_takes_arrives_unread() {
        type Unreading = RequestWith<Unread, Unread, Unread>;
        let joint = JointConfig::default();
        let motion = JointSetPoint::Angle(Motion::still(0.5, 14.0));
        for (command, expected) in [
            (
                HostCommand::ConfigureMuscle(Side::B, Config::default()),
                HostCommandWith::ConfigureMuscle(Side::B, Unread),
            ),
            (
                HostCommand::ConfigureJoint((joint.mechanism, joint.tuning, joint.angle_part)),
                HostCommandWith::ConfigureJoint(Unread),
            ),
            (HostCommand::SetJoint(motion), HostCommandWith::SetJoint(Unread)),
            (HostCommand::Stop, HostCommandWith::Stop),
        ] {
            let frame = encode(&Request { sequence: 7, command }).unwrap();
            let requests = decode_all::<Unreading>(&mut Decoder::new(), &frame);
            assert_eq!(requests, [Unreading { sequence: 7, command: expected }]);
        }
    }

    #[test]
    fn a_config_arrives_whole() {
        let request = Request { sequence: 7, command: HostCommand::Configure(Config::default()) };
        let mut decoder = Decoder::new();
        let frame = encode(&request).unwrap();
        assert_eq!(decode_all::<Request>(&mut decoder, &frame), [request]);
        assert_eq!(decoder.malformed(), 0);
    }

    #[test]
    fn not_a_number_keeps_its_bits() {
        let telemetry = longest_telemetry();
        let frame = encode(&Message::Telemetry(telemetry)).unwrap();
        let messages = decode_all::<Message>(&mut Decoder::new(), &frame);
        let [Message::Telemetry(back)] = messages[..] else { unreachable!("{messages:?}") };
        assert_eq!(back.pressure_pa.to_bits(), telemetry.pressure_pa.to_bits());
        assert_eq!(back.estimate.sensor_lag_s.to_bits(), 0x7fc1_2345);
    }

    #[test]
    fn an_overlong_frame_is_one_malformed_frame() {
        let mut decoder = Decoder::new();
        assert!(decode_all::<Request>(&mut decoder, &[1; 3 * MAX_FRAME]).is_empty());
        assert!(decode_all::<Request>(&mut decoder, &[0, 0, 0]).is_empty());
        assert_eq!(decoder.malformed(), 1);
    }

    /// Nor is an overlong frame a message if it begins with one and its checksum.
    #[test]
    fn an_overlong_frame_is_no_message_whatever_it_begins_with() {
        type Bytes = heapless::Vec<u8, MAX_PAYLOAD>;
        let mut bytes = Bytes::new();
        // The length itself takes two.
        bytes.resize(MAX_PAYLOAD - CRC_BYTES - 2, 7).unwrap();
        let mut content = [0; MAX_PAYLOAD + 1];
        let end = postcard::to_slice(&bytes, &mut content).unwrap().len();
        let checksum = CRC.checksum(&content[..end]).to_le_bytes();
        content[end..MAX_PAYLOAD].copy_from_slice(&checksum);
        for (length, expected) in [(MAX_PAYLOAD, (1, 0)), (MAX_PAYLOAD + 1, (0, 1))] {
            let mut frame = [0; 2 * MAX_FRAME];
            let stuffed = cobs::try_encode(&content[..length], &mut frame).unwrap();
            frame[stuffed] = 0;
            let mut decoder = Decoder::new();
            let messages = decode_all::<Bytes>(&mut decoder, &frame[..=stuffed]);
            assert_eq!((messages.len(), decoder.malformed()), expected, "{length} bytes");
        }
    }

    /// Up to the longest message that fits a frame with its checksum, for all kinds of bytes.
    #[test]
    fn every_length_arrives_or_is_refused() {
        type Bytes = heapless::Vec<u8, 600>;
        for byte in [0, 1, 255] {
            for length in 0..600 {
                let mut bytes = Bytes::new();
                bytes.resize(length, byte).unwrap();
                // The length itself goes before it, in seven bits a byte.
                let payload = length + if length < 128 { 1 } else { 2 };
                let Ok(frame) = encode(&bytes) else {
                    assert!(payload + 4 > MAX_PAYLOAD, "{length} bytes refused");
                    continue;
                };
                assert!(
                    payload + 4 <= MAX_PAYLOAD && frame.len() <= MAX_FRAME,
                    "{length} bytes taken"
                );
                assert_eq!(decode_all::<Bytes>(&mut Decoder::new(), &frame), [bytes]);
            }
        }
    }

    #[test]
    fn a_refusal_says_why() {
        let refused = model_core::SetPoint::Pressure { pressure_pa: -1.0 };
        let error = model_core::Core::new(&Config::default()).unwrap().set(refused).unwrap_err();
        for (refusal, text) in [
            (error.into(), "pressure_pa = -1: must be from 0 to 689500"),
            (Refusal::Step { board_us: 1000 }, "the board's step is 1000 us"),
        ] {
            assert_eq!(std::string::ToString::to_string(&refusal), text);
        }
        let config = Config { step_s: 0.0, ..Config::default() };
        assert_eq!(Refusal::from(config.check().unwrap_err()), Refusal::Config);
    }

    proptest! {
        #[test]
        fn telemetry_arrives_to_the_bit(
            step in any::<u32>(),
            codes in any::<[u16; 3]>(),
            bits in any::<[u32; 9]>(),
            duties in any::<[u16; 2]>(),
            faults in any::<u32>(),
            emergency_stop in any::<bool>(),
        ) {
            let f = bits.map(f32::from_bits);
            let telemetry = Telemetry {
                step,
                sample: Sample {
                    pressure: RawCode::of_part(codes[0], emergency_stop),
                    gas: AdcCode(codes[1]).into(),
                    length: AdcCode(codes[2]),
                    emergency_stop,
                    heard: !emergency_stop,
                    flooded: false,
                    missed_steps: codes[0] as u8,
                },
                pressure_pa: f[0],
                length_m: f[1],
                estimate: Estimate {
                    gas_k: f[2], gas_sd_k: f[3], valid: emergency_stop, wall_k: f[4], sensor_k: f[5],
                    mass_kg: f[6], heat_scale: f[7], sensor_lag_s: f[8],
                },
                command: Command {
                    inlet: Duty(duties[0]),
                    outlet: Duty(duties[1]),
                },
                mode: Mode::Pressure,
                limited: true,
                set_point: SetPoint::Duty { inlet: f[0], outlet: f[1] },
                faults: Faults(faults),
            };
            let frame = encode(&Message::Telemetry(telemetry)).unwrap();
            prop_assert_eq!(frame.iter().filter(|&&byte| byte == 0).count(), 1);
            let back = decode_all::<Message>(&mut Decoder::new(), &frame);
            // By its encoding: there NaN is equal to itself.
            prop_assert_eq!(back.len(), 1);
            prop_assert_eq!(encode(&back[0]).unwrap(), frame);
        }

        #[test]
        fn garbage_is_dropped_and_the_next_frame_arrives(
            garbage in proptest::collection::vec(any::<u8>(), 0..600),
        ) {
            let mut decoder = Decoder::new();
            prop_assert!(decode_all::<Request>(&mut decoder, &garbage).is_empty());
            decoder.push::<Request>(0);
            let request = Request { sequence: 3, command: HostCommand::Stop };
            let frame = encode(&request).unwrap();
            prop_assert_eq!(decode_all::<Request>(&mut decoder, &frame), vec![request]);
        }

        #[test]
        fn a_flipped_bit_is_noticed(position in 0_usize..60, bit in 0_u8..8) {
            let mut frame = encode(&Message::Telemetry(longest_telemetry())).unwrap();
            let position = position.min(frame.len() - 2);
            frame[position] ^= 1 << bit;
            let mut decoder = Decoder::new();
            prop_assert!(decode_all::<Message>(&mut decoder, &frame).is_empty());
            prop_assert!((1..=2).contains(&decoder.malformed()));
        }
    }
}
