//! The links to the host: [`thermyo_protocol`] over every serial port at once.

use crate::kind::{self, HostCommand, Request};
use crate::shared::{Answer, Line, Order, Requester, Shared, StoreRequest};
use crate::source::STEP;
use core::sync::atomic::Ordering;
use embassy_futures::select::{Either, select};
use embassy_futures::yield_now;
use embassy_time::{Duration, Instant, Timer, with_deadline};
use embedded_io_async::{Read, Write};
use model_core::Config;
use thermyo_protocol::{
    Chip, ConfigSource, Decoder, Image, LastReset, Name, PROTOCOL, Refusal, Version, encode,
};

/// Properties of the board that the link reports or checks.
#[derive(Clone, Copy)]
pub struct Identity {
    pub chip: Chip,
    pub last_reset: LastReset,
    pub maximum_period_steps: u16,
    /// Restarts the board into its boot loader, if it has one.
    pub boot_loader: Option<fn() -> !>,
}

/// Sends what the tasks post.
pub async fn send<W: Write>(mut port: W, line: &'static Line) -> ! {
    // Ends a frame truncated by a loss of power, so that the first answer is not lost with it.
    let _ = port.write_all(&[0]).await;
    loop {
        let message = line.outbox.receive().await;
        // Every message fits a frame, and the failure of a line cannot be reported over it.
        if let Ok(frame) = encode(&message) {
            let _ = port.write_all(&frame).await;
        }
    }
}

/// Rate limit: requests that may come at once, and the time after which one more may come. A host
/// that sends set points at 100 Hz and a few queries needs half of it.
const RATION: u32 = 16;
const RATION_EVERY: Duration = Duration::from_millis(4);

struct Ration {
    left: u32,
    since: Instant,
}

impl Ration {
    /// Whether a request that counts as `cost` requests may be carried out now.
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

    /// Time from which a request that counts as `cost` requests may be carried out.
    fn until(&self, cost: u32) -> Instant {
        self.since + RATION_EVERY * cost.saturating_sub(self.left)
    }
}

/// Number of requests that a command counts as. A new core takes a millisecond. The receiver's
/// buffer does not fill up after four in a row.
fn cost(command: &HostCommand) -> u32 {
    match command {
        HostCommand::Configure(_)
        | HostCommand::ConfigureJoint(_)
        | HostCommand::Start(_)
        | HostCommand::StartJoint(_)
        | HostCommand::Save
        | HostCommand::Forget => 4,
        _ => 1,
    }
}

/// Time to send an answer before the board restarts.
const ANSWERING: Duration = Duration::from_millis(20);

/// Bytes of a port, as they arrive.
struct Incoming<R> {
    port: R,
    line: &'static Line,
    shared: &'static Shared,
    chunk: [u8; 32],
    next: usize,
    end: usize,
}

impl<R: Read> Incoming<R> {
    /// Waits until there is a byte to take; no byte is lost if the wait is cancelled.
    async fn arrived(&mut self) {
        let index = self.shared.index(self.line);
        while self.next == self.end {
            // `read` does not yield while bytes wait.
            yield_now().await;
            match select(self.port.read(&mut self.chunk), self.line.silence_check.wait()).await {
                Either::First(count) => {
                    // After an error of the port the current frame fails its checksum.
                    (self.next, self.end) = (0, count.unwrap_or(0));
                    self.shared.arbitrate(|arbiter| arbiter.read(index));
                }
                // `select` has polled `read` first.
                Either::Second(()) => self.shared.arbitrate(|arbiter| arbiter.silent(index)),
            }
        }
    }

    /// Takes a byte that has arrived.
    fn next(&mut self) -> Option<u8> {
        let byte = *self.chunk.get(self.next..self.end)?.first()?;
        self.next += 1;
        Some(byte)
    }
}

/// Carries out requests at a rate that leaves the other tasks their time. A request that comes too
/// early waits, so a host that waits for each answer is only slowed. If more arrive meanwhile, it
/// is dropped and counted, but a stop is always carried out.
pub async fn receive<R: Read>(
    port: R,
    line: &'static Line,
    identity: Identity,
    shared: &'static Shared,
) -> ! {
    while !shared.recalled.load(Ordering::Relaxed) {
        Timer::after_millis(1).await;
    }
    let mut incoming = Incoming { port, line, shared, chunk: [0; 32], next: 0, end: 0 };
    let mut decoder = Decoder::new();
    let mut ration = Ration { left: RATION, since: Instant::now() };
    let index = shared.index(line);
    let mut frame = None;
    loop {
        incoming.arrived().await;
        while let Some(byte) = incoming.next() {
            let ticket =
                *frame.get_or_insert_with(|| shared.arbitrate(|arbiter| arbiter.begin(index)));
            if byte == 0 {
                frame = None;
            }
            if let Some(Request { sequence, command }) = decoder.push(byte) {
                line.open();
                shared.arbitrate(|arbiter| {
                    arbiter.hear(index);
                    match command {
                        HostCommand::Stop => arbiter.stop(index),
                        HostCommand::Version => arbiter.greet(index),
                        _ => (),
                    }
                });
                // Samples need no limit: each one comes after the answer to the previous one.
                let unlimited = cfg!(feature = "hil") && matches!(command, HostCommand::Step(_));
                if !unlimited && !ration.take(cost(&command)) {
                    let affordable = ration.until(cost(&command));
                    if with_deadline(affordable, incoming.arrived()).await.is_ok() {
                        shared.drop_request();
                        continue;
                    }
                    ration.take(cost(&command));
                }
                let requester = Requester { line, sequence, ticket };
                let outcome = carry_out(command, &identity, line, shared);
                hand_on(outcome, requester, shared).await;
            }
            line.malformed.store(decoder.malformed(), Ordering::Relaxed);
        }
    }
}

/// Answers a request, or passes it on to the task that does.
async fn hand_on(outcome: Outcome, requester: Requester, shared: &'static Shared) {
    match outcome {
        Outcome::Answer(answer) => requester.line.answer(requester.sequence, answer),
        Outcome::Order(order) => shared.order(Some(requester), order).await,
        Outcome::Restart(order) => shared.restart(Some(requester), order).await,
        // Without waiting: a stop may come next.
        Outcome::Store(request) => {
            if shared.store_requests.try_send((requester, request)).is_err() {
                shared.drop_request();
            }
        }
        Outcome::Leave(boot_loader) => {
            requester.line.answer(requester.sequence, done(shared));
            Timer::after(ANSWERING).await;
            boot_loader()
        }
        #[cfg(feature = "hil")]
        Outcome::Step(sample) => shared.samples.send(sample).await,
        Outcome::Silent => (),
    }
}

#[allow(clippy::large_enum_variant)] // One at a time.
pub enum Outcome {
    Answer(Answer),
    /// Control carries it out and answers.
    Order(Order),
    /// Control restarts as the prepared core and answers.
    Restart(Order),
    /// The keeper carries it out and answers.
    Store(StoreRequest),
    /// The request is answered, and then the board enters its boot loader.
    Leave(fn() -> !),
    /// One step, with its telemetry as the answer.
    #[cfg(feature = "hil")]
    Step(kind::Sample),
    Silent,
}

fn carry_out(
    command: HostCommand,
    identity: &Identity,
    line: &'static Line,
    shared: &'static Shared,
) -> Outcome {
    match command {
        HostCommand::Version => Outcome::Answer(Answer::Version(Version {
            protocol: PROTOCOL,
            firmware: FIRMWARE,
            chip: identity.chip,
            image: kind::IMAGE,
        })),
        HostCommand::Stop => Outcome::Answer(done(shared)),
        HostCommand::ClearFaults => Outcome::Order(Order::ClearFaults),
        HostCommand::TelemetryDivider(divider) => {
            line.set_telemetry_divider(divider);
            Outcome::Answer(done(shared))
        }
        HostCommand::Timing => Outcome::Answer(Answer::Timing(shared.timing())),
        HostCommand::LastReset => Outcome::Answer(Answer::LastReset(identity.last_reset)),
        HostCommand::FirstFailure => Outcome::Answer(Answer::FirstFailure(shared.first_failure())),
        HostCommand::Arm { most_pa } => Outcome::Order(Order::Arm(most_pa)),
        HostCommand::Status => Outcome::Answer(Answer::Status(shared.status())),
        HostCommand::Name(config_name) => {
            shared.change_status(|status| status.config_name = config_name);
            Outcome::Answer(done(shared))
        }
        HostCommand::Save => Outcome::Store(StoreRequest::Save),
        HostCommand::Forget => Outcome::Store(StoreRequest::Forget),
        HostCommand::History(number) => Outcome::Store(StoreRequest::Event(number)),
        HostCommand::Alive => Outcome::Silent,
        HostCommand::BootLoader => match identity.boot_loader {
            None => Outcome::Answer(Answer::Refused(Refusal::NoBootLoader)),
            Some(_) if !shared.vented() => Outcome::Answer(Answer::Refused(Refusal::NotVented)),
            Some(boot_loader) => Outcome::Leave(boot_loader),
        },
        other => kind::carry_out(other, identity, line, shared),
    }
}

pub fn done(shared: &Shared) -> Answer {
    Answer::Done { step: shared.tally().steps as u32 }
}

/// Stages a core with a configuration that the board can run, and returns the order to restart as it.
pub fn configure(
    config: &kind::Config,
    identity: &Identity,
    shared: &'static Shared,
    source: ConfigSource,
    name: Name,
) -> Result<Order, Refusal> {
    kind::check(config, identity)?;
    Ok(Order::Configure { checksum: shared.prepare(config)?, source, name })
}

/// Refuses a request that only the other image accepts.
pub fn other_image() -> Outcome {
    Outcome::Answer(Answer::Refused(Refusal::OtherImage { joint: kind::IMAGE == Image::Joint }))
}

/// Checks whether the board can run a muscle's configuration, apart from its sensors and values.
pub fn check_muscle(config: &Config, identity: &Identity) -> Result<(), Refusal> {
    let board_us = STEP.as_micros() as u32;
    if (config.step_s * 1.0e6 + 0.5) as u32 != board_us {
        return Err(Refusal::Step { board_us });
    }
    if config.pwm_period_steps > identity.maximum_period_steps {
        return Err(Refusal::Period { maximum_steps: identity.maximum_period_steps });
    }
    Ok(())
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
