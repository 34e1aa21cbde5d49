//! The line to the host: [`model_core::link`] over any serial port.

use crate::keep;
use crate::shared::{Order, Shared};
use crate::source::STEP;
use core::sync::atomic::Ordering;
use embassy_futures::yield_now;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};
use model_core::link::{
    Answer, Chip, Decoder, HostCommand, LastReset, PROTOCOL, Refusal, Request, Version, checksum,
    encode,
};
use model_core::{Config, Core};

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

/// Requests in a row that are carried out without a pause, and the time in which one more may come. A
/// host that drives at 100 Hz and asks now and then needs half of that.
const RATION: u32 = 16;
const RATION_EVERY: Duration = Duration::from_millis(4);

/// What is left to carry out of what a host may ask.
struct Ration {
    left: u32,
    since: Instant,
}

impl Ration {
    /// Whether one more request may be carried out now, which counts as `cost` of them.
    fn take(&mut self, cost: u32) -> bool {
        let now = Instant::now();
        while self.since + RATION_EVERY <= now {
            if self.left == RATION {
                self.since = now;
                break;
            }
            self.since += RATION_EVERY;
            self.left += 1;
        }
        let enough = self.left >= cost;
        if enough {
            self.left -= cost;
        }
        enough
    }
}

/// A new core takes a millisecond: four of them in a row, and the receiver's buffer is not yet full.
fn cost(command: &HostCommand) -> u32 {
    if matches!(command, HostCommand::Configure(_) | HostCommand::Start(_)) { 4 } else { 1 }
}

/// Carries out what the host asks, as much of it as leaves the other tasks their time: the rest is
/// dropped and counted. To stop is always carried out.
pub async fn receive<R: Read>(mut port: R, identity: Identity, shared: &'static Shared) -> ! {
    let mut decoder = Decoder::new();
    let mut chunk = [0; 32];
    let mut ration = Ration { left: RATION, since: Instant::now() };
    loop {
        // After an error of the line the frame at hand will not pass its checksum.
        let count = port.read(&mut chunk).await.unwrap_or(0);
        for &byte in chunk.iter().take(count) {
            if let Some(Request { sequence, command }) = decoder.push(byte) {
                shared.heard.store(true, Ordering::Relaxed);
                if command == HostCommand::Stop {
                    shared.stop.store(true, Ordering::Relaxed);
                }
                // Its samples come one at a time, each after the answer to the one before.
                let unlimited = cfg!(feature = "hil") && matches!(command, HostCommand::Step(_));
                if !unlimited && !ration.take(cost(&command)) {
                    shared.dropped_requests.store(
                        shared.dropped_requests.load(Ordering::Relaxed).wrapping_add(1),
                        Ordering::Relaxed,
                    );
                    continue;
                }
                match carry_out(command, &identity, shared).await {
                    Outcome::Answer(answer) => shared.answer(sequence, answer),
                    Outcome::Order(order) => shared.orders.send((sequence, order)).await,
                    Outcome::Restart(order) => {
                        time_to_restart().await;
                        shared.orders.send((sequence, order)).await;
                    }
                    Outcome::Silent => (),
                }
            }
            shared.malformed.store(decoder.malformed(), Ordering::Relaxed);
        }
        // While bytes wait, `read` does not.
        yield_now().await;
    }
}

/// What follows from a request.
#[allow(clippy::large_enum_variant)] // One at a time.
enum Outcome {
    /// An answer at once.
    Answer(Answer),
    /// Control carries it out and answers.
    Order(Order),
    /// Control starts anew with the core that is prepared, and answers.
    Restart(Order),
    /// The step's telemetry is the answer, or there is none.
    Silent,
}

async fn carry_out(command: HostCommand, identity: &Identity, shared: &'static Shared) -> Outcome {
    match command {
        HostCommand::Version => Outcome::Answer(Answer::Version(Version {
            protocol: PROTOCOL,
            firmware: FIRMWARE,
            chip: identity.chip,
            hil: cfg!(feature = "hil"),
        })),
        HostCommand::ReadConfig => {
            Outcome::Answer(Answer::Config(shared.config().unwrap_or_default()))
        }
        HostCommand::Configure(wanted) => match check(&wanted, identity) {
            Ok(core) => {
                shared.prepare(core);
                Outcome::Restart(Order::Configure { checksum: checksum(&wanted) })
            }
            Err(refusal) => Outcome::Answer(Answer::Refused(refusal)),
        },
        HostCommand::Start(set_point) => match shared.prepare_set_point(set_point) {
            Ok(()) => Outcome::Restart(Order::Restart),
            Err(refusal) => Outcome::Answer(Answer::Refused(refusal)),
        },
        HostCommand::Set(set_point) => Outcome::Order(Order::Set(set_point)),
        HostCommand::Stop => Outcome::Answer(done(shared)),
        HostCommand::ClearFaults => Outcome::Order(Order::ClearFaults),
        HostCommand::TelemetryDivider(divider) => {
            shared.set_telemetry_divider(divider);
            Outcome::Answer(done(shared))
        }
        HostCommand::Timing => Outcome::Answer(Answer::Timing(shared.timing())),
        HostCommand::LastReset => Outcome::Answer(Answer::LastReset(identity.last_reset)),
        HostCommand::FirstFailure => Outcome::Answer(Answer::FirstFailure(shared.first_failure())),
        HostCommand::Arm { most_pa } => Outcome::Order(Order::Arm(most_pa)),
        HostCommand::Status => Outcome::Answer(Answer::Status(shared.status())),
        HostCommand::Name(config_name) => {
            shared.set_config_name(config_name);
            Outcome::Answer(done(shared))
        }
        HostCommand::Save => match shared.config() {
            Some(config) => Outcome::Answer(told(
                keep::save(&config, &shared.status().config_name).await,
                shared,
            )),
            None => Outcome::Answer(Answer::Refused(Refusal::NotConfigured)),
        },
        HostCommand::Forget => Outcome::Answer(told(keep::forget().await, shared)),
        HostCommand::History(number) => {
            Outcome::Answer(Answer::Event(keep::event(number, identity, shared)))
        }
        HostCommand::Alive => Outcome::Silent,
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

/// Done at once.
fn done(shared: &Shared) -> Answer {
    Answer::Done { step: shared.tally().steps as u32 }
}

/// Done, or why not.
fn told(outcome: Result<(), Refusal>, shared: &Shared) -> Answer {
    outcome.map_or_else(Answer::Refused, |()| done(shared))
}

/// Time that a restart of the core may take: nothing else runs while one is copied.
const RESTARTING: Duration = Duration::from_micros(350);

/// Waits until the core can be restarted before the next step is due.
async fn time_to_restart() {
    let now = Instant::now();
    let into_us = now.as_micros() % STEP.as_micros();
    if into_us + RESTARTING.as_micros() > STEP.as_micros() {
        Timer::at(now + STEP - Duration::from_micros(into_us)).await;
    }
}

/// A core for the configuration, if the board can run it.
fn check(config: &Config, identity: &Identity) -> Result<Core, Refusal> {
    let board_us = STEP.as_micros() as u32;
    if (config.step_s * 1.0e6 + 0.5) as u32 != board_us {
        return Err(Refusal::Step { board_us });
    }
    if config.pwm_period_steps > identity.maximum_period_steps {
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
