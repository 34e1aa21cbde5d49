//! The control task: sample, step, drive.

use crate::black_box::BlackBox;
use crate::board::Valves;
use crate::shared::{Answer, Message, Order, Shared, Tally};
use crate::source::Source;
use core::sync::atomic::Ordering;
use embassy_futures::select::{Either, select};
use embassy_time::Instant;
use model_core::control::Mode;
use model_core::link::{Phase, Refusal};
use model_core::{Command, Core, Sample, SetPoint, SetPointError};

/// Waits of [`Source::due`] without a sample after which the valves are not left as they are.
const PATIENCE: u32 = 4;

/// Steps for which a flood of requests is told after the last one that was dropped: a second.
const FLOODED_STEPS: u32 = 1000;

/// Steps between two messages of what changes rarely: half a second.
const STATUS_STEPS: u64 = 500;

/// Runs for ever. `feed` feeds the watchdog: the supervisor's business, but while the flash is busy the thread
/// stands still.
pub async fn run<S: Source, V: Valves>(
    core: &mut Core,
    mut source: S,
    mut valves: V,
    feed: fn(),
    black_box: &'static BlackBox,
    shared: &'static Shared,
) -> ! {
    let mut tally = Tally::NONE;
    let mut next_step = 0;
    let mut fresh = true;
    let mut silence = 0;
    let mut dropped_requests = 0;
    let mut flooded_steps = 0;
    let mut latched = core.supervisor().latched();
    shared.set_first_failure(core.supervisor().first_failure());
    black_box.note(Phase::Starting);
    loop {
        black_box.note(Phase::Waiting);
        let turn = select(source.due(), shared.orders.receive()).await;
        shared.heartbeat.store(shared.heartbeat.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
        match turn {
            Either::First(Some((due, missed))) => {
                silence = 0;
                let start = Instant::now();
                black_box.note(Phase::Sampling);
                let dropped = shared.dropped_requests.load(Ordering::Relaxed);
                if dropped != dropped_requests {
                    dropped_requests = dropped;
                    flooded_steps = FLOODED_STEPS;
                }
                flooded_steps = flooded_steps.saturating_sub(1);
                let sample = Sample {
                    heard: shared.take_heard(),
                    flooded: flooded_steps > 0,
                    missed_steps: missed.try_into().unwrap_or(u8::MAX),
                    ..source.sample(&core.config().sensors)
                };
                if Shared::take(&shared.stop) {
                    core.vent();
                }
                black_box.note(Phase::Stepping);
                let before = Instant::now();
                let telemetry = core.step(&sample);
                let after = Instant::now();
                black_box.note(Phase::Driving);
                let judging = telemetry.mode == Mode::Judging;
                if fresh && !judging {
                    valves.restart(core.config().pwm_period_steps, telemetry.command);
                    fresh = false;
                } else {
                    valves.drive(telemetry.command);
                }
                next_step = telemetry.step.wrapping_add(u32::from(!judging));
                shared.faults.store(telemetry.faults.0, Ordering::Relaxed);
                if core.supervisor().latched() != latched {
                    latched = core.supervisor().latched();
                    let first = core.supervisor().first_failure();
                    black_box.record(first, latched);
                    shared.set_first_failure(first);
                    if let Some(first) = first {
                        shared.failed.signal(first);
                    }
                }
                // While the sensors are judged there may be a set point to come.
                let vented = telemetry.set_point == SetPoint::Vent;
                shared.vented.store(vented, Ordering::Relaxed);
                let busy_steps = shared.flash_busy_steps.load(Ordering::Relaxed);
                if busy_steps > 0 {
                    shared.flash_busy_steps.store(busy_steps - 1, Ordering::Relaxed);
                    feed();
                }
                if core.armed_pa() != shared.status().armed_pa {
                    shared.change_status(|status| {
                        (status.armed_pa, status.step) = (core.armed_pa(), next_step);
                    });
                } else if tally.steps.is_multiple_of(STATUS_STEPS) {
                    shared.tell_status();
                }
                // While the sensors are judged the core's own count stands still.
                let step = if judging { tally.steps as u32 } else { telemetry.step };
                for line in shared.lines.iter().filter(|line| line.wants(step)) {
                    line.post(Message::Telemetry(telemetry));
                }
                tally.missed_steps += missed;
                tally.add(us(due, start), us(before, after), us(start, Instant::now()));
                shared.set_tally(tally);
            }
            Either::First(None) => {
                silence += 1;
                if silence >= PATIENCE {
                    valves.drive(Command::VENT);
                }
            }
            Either::Second((asker, order)) => {
                let outcome = match order {
                    Order::Configure { .. } => {
                        shared.prepared().map_or(Err(Refusal::NotConfigured), |other| {
                            core.disarm();
                            core.restart_as(other);
                            Ok(())
                        })
                    }
                    Order::Start(set_point) => start(core, shared.prepared(), set_point),
                    Order::Arm(most_pa) => core.arm(most_pa).map_err(Refusal::from),
                    Order::Set(set_point) => core.set(set_point).map_err(Refusal::from),
                    Order::ClearFaults => {
                        core.clear_faults();
                        Ok(())
                    }
                };
                let restarted =
                    outcome.is_ok() && matches!(order, Order::Configure { .. } | Order::Start(_));
                if restarted {
                    next_step = 0;
                    fresh = true;
                    #[cfg(feature = "parts")]
                    shared.parts.want(&core.config().sensors);
                }
                if restarted || core.armed_pa() != shared.status().armed_pa {
                    shared.change_status(|status| {
                        if let Order::Configure { checksum, source, name } = order {
                            status.config_checksum = checksum;
                            status.config_source = source;
                            status.config_name = name;
                        }
                        status.starts = status.starts.wrapping_add(restarted.into());
                        (status.armed_pa, status.step) = (core.armed_pa(), next_step);
                    });
                }
                if outcome.is_ok() && matches!(order, Order::Start(_) | Order::Set(_)) {
                    // Before the next step says so.
                    shared.vented.store(false, Ordering::Relaxed);
                }
                let answer = match outcome {
                    Ok(()) => Answer::Done { step: next_step },
                    Err(refusal) => Answer::Refused(refusal),
                };
                if let Some(asker) = asker {
                    asker.line.answer(asker.sequence, answer);
                }
            }
        }
    }
}

/// Starts anew with a set point, which is checked as if the other core had been armed as this one is.
fn start(core: &mut Core, other: Option<Core>, set_point: SetPoint) -> Result<(), Refusal> {
    let mut other = other.ok_or(Refusal::NotConfigured)?;
    if let Some(armed_pa) = core.armed_pa() {
        other.arm(Some(armed_pa))?;
        other.set(set_point)?;
    } else if set_point != SetPoint::Vent {
        return Err(SetPointError::NotArmed.into());
    }
    core.restart_as(other);
    Ok(())
}

/// Time between two instants \[us\].
fn us(from: Instant, to: Instant) -> u32 {
    to.saturating_duration_since(from).as_micros() as u32
}
