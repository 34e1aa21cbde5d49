//! The line to the host: [`model_core::wire`] over any serial port.

use crate::shared::{Order, Shared};
use crate::source::STEP;
use core::sync::atomic::Ordering;
use embedded_io_async::{Read, Write};
use model_core::wire::{
    Answer, Chip, Decoder, HostCommand, LastReset, PROTOCOL, Refusal, Request, Version, encode,
};
use model_core::{Config, Core, SetPoint};

/// What the link can tell about the board.
#[derive(Clone, Copy)]
pub struct Identity {
    /// The chip.
    pub chip: Chip,
    /// Why it started.
    pub last_reset: LastReset,
    /// Longest PWM period of its valves, in steps.
    pub maximum_period_steps: u16,
}

/// Sends what the tasks post.
pub async fn send<W: Write>(mut port: W, shared: &'static Shared) -> ! {
    loop {
        let message = shared.outbox.receive().await;
        // Every message fits a frame; a line that fails has nobody to tell.
        if let Ok(frame) = encode(&message) {
            let _ = port.write_all(&frame).await;
        }
    }
}

/// Carries out what the host asks.
pub async fn receive<R: Read>(mut port: R, identity: Identity, shared: &'static Shared) -> ! {
    let mut decoder = Decoder::new();
    let mut config = Config::default();
    let mut chunk = [0; 32];
    loop {
        // After an error of the line the frame at hand will not pass its checksum.
        let count = port.read(&mut chunk).await.unwrap_or(0);
        for &byte in chunk.iter().take(count) {
            if let Some(Request { sequence, command }) = decoder.push(byte) {
                match carry_out(command, &mut config, &identity, shared).await {
                    Outcome::Answer(answer) => shared.answer(sequence, answer),
                    Outcome::Order(order) => shared.orders.send((sequence, order)).await,
                    Outcome::Silent => (),
                }
            }
            shared.malformed.store(decoder.malformed(), Ordering::Relaxed);
        }
    }
}

/// What follows from a request.
#[allow(clippy::large_enum_variant)]
enum Outcome {
    /// An answer at once.
    Answer(Answer),
    /// Control carries it out and answers.
    Order(Order),
    /// The step's telemetry is the answer.
    Silent,
}

async fn carry_out(
    command: HostCommand,
    config: &mut Config,
    identity: &Identity,
    shared: &'static Shared,
) -> Outcome {
    match command {
        HostCommand::Version => Outcome::Answer(Answer::Version(Version {
            protocol: PROTOCOL,
            firmware: FIRMWARE,
            chip: identity.chip,
            hil: cfg!(feature = "hil"),
        })),
        HostCommand::ReadConfig => Outcome::Answer(Answer::Config(*config)),
        HostCommand::Configure(wanted) => match check(&wanted, identity) {
            Ok(core) => {
                *config = wanted;
                Outcome::Order(Order::Replace(core))
            }
            Err(refusal) => Outcome::Answer(Answer::Refused(refusal)),
        },
        HostCommand::Start(set_point) => match Core::new(config) {
            Ok(mut core) => {
                core.set(set_point);
                Outcome::Order(Order::Replace(core))
            }
            Err(error) => Outcome::Answer(Answer::Refused(error.into())),
        },
        HostCommand::Set(set_point) => Outcome::Order(Order::Set(set_point)),
        HostCommand::Stop => Outcome::Order(Order::Set(SetPoint::Vent)),
        HostCommand::ClearFaults => Outcome::Order(Order::ClearFaults),
        HostCommand::TelemetryDivider(divider) => {
            shared.set_telemetry_divider(divider);
            Outcome::Answer(Answer::Done { step: shared.tally().steps })
        }
        HostCommand::Timing => Outcome::Answer(Answer::Timing(shared.timing())),
        HostCommand::LastReset => Outcome::Answer(Answer::LastReset(identity.last_reset)),
        HostCommand::Step(sample) => {
            if cfg!(feature = "hil") {
                shared.samples.send(sample).await;
                Outcome::Silent
            } else {
                Outcome::Answer(Answer::Refused(Refusal::NoHostSamples))
            }
        }
    }
}

/// A core for the configuration, if the board can run it.
fn check(config: &Config, identity: &Identity) -> Result<Core, Refusal> {
    let board_us = STEP.as_micros() as u32;
    if (config.step_s * 1.0e6 + 0.5) as u32 != board_us {
        return Err(Refusal::Step { board_us });
    }
    if config.drive.period_steps > identity.maximum_period_steps {
        return Err(Refusal::Period { maximum_steps: identity.maximum_period_steps });
    }
    Core::new(config).map_err(Refusal::from)
}

/// Version of this firmware, from its manifest.
pub const FIRMWARE: [u16; 3] = [
    number(env!("CARGO_PKG_VERSION_MAJOR")),
    number(env!("CARGO_PKG_VERSION_MINOR")),
    number(env!("CARGO_PKG_VERSION_PATCH")),
];

const fn number(text: &str) -> u16 {
    match u16::from_str_radix(text, 10) {
        Ok(number) => number,
        Err(_) => panic!("cargo gives whole numbers"),
    }
}
