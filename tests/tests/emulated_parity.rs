//! The image that is flashed computes what the core computes on the host, to the bit, and on time.

use host_sim::board::emulated::EmulatedBoard;
use host_sim::board::{Board, BoardError};
use host_sim::replay::{Row, replay};
use model_core::wire::{Answer, Chip, HostCommand, PROTOCOL, Refusal};
use model_core::{AdcCode, Config, Sample, SetPoint};
use system_tests::skip_emulator;

const STEPS: u32 = 10_000;

/// A sample that moves as a muscle's would, with noise in the last bits.
fn sample(step: u32) -> Sample {
    let noise = |seed: u32| (step.wrapping_mul(2_654_435_761).wrapping_add(seed) >> 27) as u16;
    let stroke = f64::from(step) * std::f64::consts::TAU / 2500.0;
    let code = |middle: f64, swing: f64, phase: f64, seed: u32| {
        AdcCode((middle + swing * (stroke + phase).sin()) as u16 + noise(seed))
    };
    Sample {
        pressure: code(13_000.0, 5_000.0, 0.0, 1),
        gas: code(16_000.0, 800.0, -1.2, 2),
        length: code(21_000.0, -1_500.0, -0.2, 3),
        // Two sensors fail for a while, and the line of the emergency stop opens once.
        emergency_stop: step == 8000,
    }
}

#[test]
fn ten_thousand_steps_to_the_bit_and_on_time() {
    if skip_emulator() {
        return;
    }
    let mut board = EmulatedBoard::new().unwrap();
    let mut config = Config::default();
    config.load = model_core::config::Load::Isotonic { force_n: 120.0 };
    let cycle = SetPoint::MassFlowCycle { flow_kg_s: 3.6e-4, period_s: 2.0 };
    let pressure = SetPoint::Pressure { pressure_pa: 3.0e5 };
    board.start(&config, cycle).unwrap();

    let mut rows = Vec::new();
    let started = std::time::Instant::now();
    for step in 0..=STEPS {
        let mut now = sample(step);
        if (3000..3200).contains(&step) {
            now.gas = AdcCode(0);
        }
        if (4000..4200).contains(&step) {
            now.length = AdcCode(32_760);
        }
        if step == 5000 {
            board.set(pressure).unwrap();
        }
        let outcome = board.step(&now).unwrap();
        if let Some(telemetry) = outcome.telemetry {
            // What was fed is what was read: the conversions add up to the code.
            let mut fed = sample(telemetry.step);
            if (3000..3200).contains(&telemetry.step) {
                fed.gas = AdcCode(0);
            }
            if (4000..4200).contains(&telemetry.step) {
                fed.length = AdcCode(32_760);
            }
            assert_eq!(telemetry.sample, fed, "step {}", telemetry.step);
            // The set point arrives with the step: it holds from the next one on.
            let set_point = match telemetry.step {
                0 => Some(cycle),
                5001 => Some(pressure),
                _ => None,
            };
            rows.push(Row { set_point, telemetry });
        }
    }
    let real_time_factor = f64::from(STEPS) * 1.0e-3 / started.elapsed().as_secs_f64();
    assert_eq!(rows.len(), STEPS as usize);
    assert!(rows.iter().zip(0..).all(|(row, step)| row.telemetry.step == step));
    let outcome = replay(&config, &rows).unwrap();
    assert_eq!((outcome.mismatches, outcome.first), (0, None));
    // The run was worth comparing: both valves moved, and the emergency stop vented.
    let duties: std::collections::BTreeSet<_> = rows
        .iter()
        .map(|row| (row.telemetry.command.inlet, row.telemetry.command.outlet))
        .collect();
    assert!(duties.len() > 50, "{} commands", duties.len());
    assert!(rows[9000].telemetry.faults.intersects(model_core::Faults::EMERGENCY_STOP));

    let timing = board.timing().unwrap();
    println!("{timing:?}, {real_time_factor:.2} times real time");
    assert!(timing.steps > STEPS);
    assert_eq!((timing.missed_steps, timing.dropped_telemetry, timing.malformed_frames), (0, 0, 0));
    assert!((1..=20).contains(&timing.jitter_worst_us), "{timing:?}");
    assert!((20_000..=150_000).contains(&timing.step_mean_ns), "{timing:?}");
    assert!((50..=300).contains(&timing.step_worst_us), "{timing:?}");
    assert!(real_time_factor > 0.5, "{real_time_factor} times real time");
}

#[test]
fn the_board_says_who_it_is_and_refuses_what_it_cannot_do() {
    if skip_emulator() {
        return;
    }
    let mut board = EmulatedBoard::new().unwrap();
    let version = board.version().unwrap();
    assert_eq!((version.protocol, version.chip, version.hil), (PROTOCOL, Chip::Rp2040, false));

    let refusal = |board: &mut EmulatedBoard, command| match board.ask(command) {
        Err(BoardError::Refused(refusal)) => refusal,
        other => panic!("{other:?}"),
    };
    let mut config = Config::default();
    config.step_s = 0.002;
    let refused = refusal(&mut board, HostCommand::Configure(config));
    assert_eq!(refused, Refusal::Step { board_us: 1000 });
    let mut config = Config::default();
    config.drive.period_steps = 500;
    let refused = refusal(&mut board, HostCommand::Configure(config));
    assert_eq!(refused, Refusal::Period { maximum_steps: 102 });
    let mut config = Config::default();
    config.valve.critical_ratio = f32::NAN;
    assert_eq!(refusal(&mut board, HostCommand::Configure(config)), Refusal::Config);
    let refused = refusal(&mut board, HostCommand::Step(Sample::default()));
    assert_eq!(refused, Refusal::NoHostSamples);

    // The configuration of before is still there, whole.
    assert_eq!(board.ask(HostCommand::ReadConfig).unwrap(), Answer::Config(Config::default()));
    assert!(board.take_log().iter().any(|line| line.contains("thermyo firmware")));
}
