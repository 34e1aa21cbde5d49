//! The control task: sample, step, drive.

use crate::black_box::BlackBox;
use crate::board::Valves;
use crate::shared::{Order, Shared, Tally};
use crate::source::Source;
use core::sync::atomic::Ordering;
use embassy_futures::select::{Either, select};
use embassy_time::Instant;
use model_core::control::Mode;
use model_core::link::{Answer, ConfigSource, Message, Name, Phase, Status};
use model_core::{Command, Core, Sample};

/// Waits of [`Source::due`] without a sample after which the valves are not left as they are.
const PATIENCE: u32 = 4;

/// Steps for which a flood of requests is told after the last one that was dropped: a second.
const FLOODED_STEPS: u32 = 1000;

/// Steps between two messages of what changes rarely: half a second.
const STATUS_STEPS: u64 = 500;

/// Runs for ever.
pub async fn run<S: Source, V: Valves>(
    mut core: Core,
    mut source: S,
    mut valves: V,
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
                    heard: Shared::take(&shared.heard),
                    flooded: flooded_steps > 0,
                    missed_steps: missed.try_into().unwrap_or(u8::MAX),
                    ..source.sample()
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
                }
                let status = shared.status();
                if core.armed_pa() != status.armed_pa {
                    shared.tell(Status { armed_pa: core.armed_pa(), step: next_step, ..status });
                } else if tally.steps.is_multiple_of(STATUS_STEPS) {
                    shared.tell(status);
                }
                let divider = u32::from(shared.telemetry_divider());
                // While the sensors are judged the core's own count stands still.
                let step = if judging { tally.steps as u32 } else { telemetry.step };
                if cfg!(feature = "hil") || divider > 0 && step.is_multiple_of(divider) {
                    shared.post(Message::Telemetry(telemetry));
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
            Either::Second((sequence, order)) => {
                let mut status = shared.status();
                if let Order::Configure { checksum } = order {
                    core.disarm();
                    status.config_checksum = checksum;
                    status.config_source = ConfigSource::Host;
                    status.config_name = Name::NONE;
                }
                let outcome = match order {
                    Order::Configure { .. } | Order::Restart => {
                        if let Some(other) = shared.prepared() {
                            core.restart_as(other);
                        }
                        next_step = 0;
                        fresh = true;
                        status.starts = status.starts.wrapping_add(1);
                        Ok(())
                    }
                    Order::Arm(most_pa) => core.arm(most_pa),
                    Order::Set(set_point) => core.set(set_point),
                    Order::ClearFaults => {
                        core.clear_faults();
                        Ok(())
                    }
                };
                // Set points are in the telemetry.
                if !matches!(order, Order::Set(_)) {
                    (status.armed_pa, status.step) = (core.armed_pa(), next_step);
                    shared.tell(status);
                }
                let answer = match outcome {
                    Ok(()) => Answer::Done { step: next_step },
                    Err(error) => Answer::Refused(error.into()),
                };
                shared.answer(sequence, answer);
            }
        }
    }
}

/// Time between two instants \[us\].
fn us(from: Instant, to: Instant) -> u32 {
    to.saturating_duration_since(from).as_micros() as u32
}
