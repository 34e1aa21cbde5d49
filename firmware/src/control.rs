//! The control task: sample, step, drive.

use crate::black_box::BlackBox;
use crate::board::Valves;
use crate::kind::{self, Core, Sample, SetPoint, Telemetry};
use crate::shared::{Answer, Order, Requester, Shared, Tally};
use crate::source::Source;
use core::sync::atomic::Ordering;
use embassy_futures::select::{Either, select};
use embassy_time::Instant;
use embedded_hal::digital::OutputPin;
use model_core::Faults;
use thermyo_protocol::arbiter::Arbiter;
use thermyo_protocol::{Phase, Refusal};

/// Waits of [`Source::due`] without a sample after which the muscle is vented.
const PATIENCE: u32 = 4;

/// Steps for which a flood is reported after the last dropped request: a second.
const FLOODED_STEPS: u32 = 1000;

/// Steps between two status messages: half a second.
const STATUS_STEPS: u32 = 500;

/// The core between its sensors and its valves.
pub struct Control<'a, S, V, O> {
    core: &'a mut Core,
    source: S,
    valves: V,
    /// High while a joint is driven.
    brake_release: Option<O>,
    /// Feeds the watchdog in place of the supervisor while the busy flash blocks the thread.
    feed: fn(),
    black_box: &'static BlackBox,
    shared: &'static Shared,
    tally: Tally,
    next_step: u32,
    /// Whether the core has restarted and its first step must begin a PWM period.
    fresh: bool,
    /// Consecutive waits that ended without a sample.
    silence: u32,
    dropped_requests: u32,
    flooded_steps: u32,
    latched: Faults,
}

impl<'a, S: Source, V: Valves, O: OutputPin> Control<'a, S, V, O> {
    /// Creates the task's state with a core that has not stepped yet.
    pub fn new(
        core: &'a mut Core,
        source: S,
        (valves, brake_release): (V, Option<O>),
        feed: fn(),
        black_box: &'static BlackBox,
        shared: &'static Shared,
    ) -> Self {
        let latched = kind::latched(core);
        shared.set_first_failure(kind::first_failure(core));
        black_box.note(Phase::Starting);
        Self {
            core,
            source,
            valves,
            brake_release,
            feed,
            black_box,
            shared,
            tally: Tally::NONE,
            next_step: 0,
            fresh: true,
            silence: 0,
            dropped_requests: 0,
            flooded_steps: 0,
            latched,
        }
    }

    pub async fn run(mut self) -> ! {
        loop {
            self.black_box.note(Phase::Waiting);
            let turn = select(self.source.due(), self.shared.orders.receive()).await;
            let heartbeat = &self.shared.heartbeat;
            heartbeat.store(heartbeat.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
            match turn {
                Either::First(Some((due, missed))) => self.step(due, missed),
                Either::First(None) => {
                    self.silence += 1;
                    if self.silence >= PATIENCE {
                        self.valves.drive(kind::VENT);
                    }
                }
                Either::Second((requester, order)) => {
                    let answer = match self.obey(order, requester) {
                        Ok(()) => Answer::Done { step: self.next_step },
                        Err(refusal) => Answer::Refused(refusal),
                    };
                    if let Some(requester) = requester {
                        requester.line.answer(requester.sequence, answer);
                    }
                }
            }
        }
    }

    /// Runs one step, which was due at `due`; `missed` steps before it were left out.
    fn step(&mut self, due: Instant, missed: u32) {
        self.silence = 0;
        let start = Instant::now();
        self.black_box.note(Phase::Sampling);
        let turn = self.shared.arbitrate(Arbiter::step);
        let sample = self.sample(missed, turn.heard);
        if turn.stop {
            self.core.vent();
        }
        if turn.ask {
            self.shared.lines.iter().for_each(|line| line.silence_check.signal(()));
        }
        self.black_box.note(Phase::Stepping);
        let before = Instant::now();
        let telemetry = self.core.step(&sample);
        let after = Instant::now();
        self.black_box.note(Phase::Driving);
        let checking = kind::is_checking(&telemetry);
        if self.fresh && !checking {
            self.valves.restart(kind::modulation(self.core.config()), kind::commands(&telemetry));
            self.fresh = false;
        } else {
            self.valves.drive(kind::commands(&telemetry));
        }
        self.next_step = kind::step(&telemetry).wrapping_add(u32::from(!checking));
        self.publish(telemetry);
        self.tally.missed_steps += missed;
        self.tally.add(us(due, start), us(before, after), us(start, Instant::now()));
        self.shared.set_tally(self.tally);
    }

    fn sample(&mut self, missed: u32, heard: bool) -> Sample {
        let dropped = self.shared.dropped_requests.load(Ordering::Relaxed);
        if dropped != self.dropped_requests {
            self.dropped_requests = dropped;
            self.flooded_steps = FLOODED_STEPS;
        }
        self.flooded_steps = self.flooded_steps.saturating_sub(1);
        Sample {
            heard,
            flooded: self.flooded_steps > 0,
            missed_steps: missed.try_into().unwrap_or(u8::MAX),
            ..self.source.sample(self.core.config())
        }
    }

    /// Publishes a step to the other tasks and the hosts.
    fn publish(&mut self, telemetry: Telemetry) {
        let Self { core, shared, .. } = self;
        shared.faults.store(kind::faults(&telemetry).0, Ordering::Relaxed);
        if kind::latched(core) != self.latched {
            self.latched = kind::latched(core);
            let first = kind::first_failure(core);
            self.black_box.record(first, self.latched);
            let known = shared.first_failure();
            shared.set_first_failure(first);
            // Latched faults also change when they are cleared: that is no new event.
            if let Some(first) = first.filter(|_| first != known) {
                shared.failed.signal(first);
            }
        }
        // During the startup check a set point may be pending.
        let vented = core.set_point() == SetPoint::Vent;
        shared.vented.store(vented, Ordering::Relaxed);
        if let Some(brake_release) = &mut self.brake_release {
            // A pin of this chip cannot fail.
            let _ = brake_release.set_state(kind::moves(&telemetry).into());
        }
        let busy_steps = shared.flash_busy_steps.load(Ordering::Relaxed);
        if busy_steps > 0 {
            shared.flash_busy_steps.store(busy_steps - 1, Ordering::Relaxed);
            (self.feed)();
        }
        if core.armed_pa() != shared.status().armed_pa {
            shared.change_status(|status| {
                (status.armed_pa, status.step) = (core.armed_pa(), self.next_step);
            });
        } else if (self.tally.steps as u32).is_multiple_of(STATUS_STEPS) {
            shared.post_status();
        }
        // The core's own count does not advance during the startup check.
        let checking = kind::is_checking(&telemetry);
        let step = if checking { self.tally.steps as u32 } else { kind::step(&telemetry) };
        let arbiter = shared.arbitrate(|arbiter| *arbiter);
        for (index, line) in shared.lines.iter().enumerate() {
            if line.wants(step, arbiter.obeys(index)) {
                line.post(kind::message(telemetry));
            }
        }
    }

    /// Carries out an order completely, or not at all if it is refused.
    fn obey(&mut self, order: Order, requester: Option<Requester>) -> Result<(), Refusal> {
        let Self { core, shared, .. } = self;
        let ticket = requester.filter(|_| order.may_drive()).map(|requester| requester.ticket);
        // Checked here, where no stop can intervene.
        if ticket.is_some_and(|ticket| !shared.arbitrate(|arbiter| arbiter.admits(ticket))) {
            return Err(Refusal::Overtaken);
        }
        if ticket.is_some() && shared.arbitrate(Arbiter::take_stop) {
            // The stop before it on its own line must not be carried out after it.
            core.vent();
        }
        match order {
            Order::Configure { checksum, .. } => {
                shared.with_prepared(checksum, |other| {
                    core.disarm();
                    core.restart_as(other);
                    Ok(())
                })?;
            }
            Order::Start(set_point) => {
                let checksum = shared.status().config_checksum;
                shared.with_prepared(checksum, |other| kind::start(core, other, set_point))?;
            }
            Order::Arm(most_pa) => core.arm(most_pa)?,
            Order::Set(set_point) => core.set(set_point)?,
            Order::ClearFaults => core.clear_faults(),
        }
        if let Some(ticket) = ticket {
            shared.arbitrate(|arbiter| arbiter.obey(ticket));
        }
        let restarted = matches!(order, Order::Configure { .. } | Order::Start(_));
        if restarted {
            self.next_step = 0;
            self.fresh = true;
            shared.parts.enable(core.config());
        }
        if restarted || core.armed_pa() != shared.status().armed_pa {
            shared.change_status(|status| {
                if let Order::Configure { checksum, source, name } = order {
                    status.config_checksum = checksum;
                    status.config_source = source;
                    status.config_name = name;
                }
                status.starts = status.starts.wrapping_add(restarted.into());
                (status.armed_pa, status.step) = (core.armed_pa(), self.next_step);
            });
        }
        if matches!(order, Order::Start(_) | Order::Set(_)) {
            // At once: the flash must not be written before the next step publishes this.
            shared.vented.store(false, Ordering::Relaxed);
        }
        Ok(())
    }
}

/// Time between two instants \[us\].
fn us(from: Instant, to: Instant) -> u32 {
    to.saturating_duration_since(from).as_micros() as u32
}
