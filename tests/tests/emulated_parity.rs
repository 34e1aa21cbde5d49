//! The image that is flashed computes what the core computes on the host, to the bit, and on time.

use host_sim::board::emulated::EmulatedBoard;
use host_sim::board::{Board, BoardError, CoreBoard};
use host_sim::commands::replay::{Row, replay};
use model_core::link::{Answer, Chip, HostCommand, PROTOCOL, Refusal};
use model_core::{AdcCode, Config, Sample, SetPoint};
use system_tests::rig::Muscle;
use system_tests::skip_emulator;

const STEPS: u32 = 10_000;
/// A PWM period of the configuration that is run.
const PERIOD_STEPS: f64 = 10.0;

/// Worst time of the core's step, the line's interrupts included \[us\].
const STEP_WORST_US: u32 = 300;

/// Two sensors fail for a while, and the line of the emergency stop opens once.
fn with_faults(step: u32, sample: Sample) -> Sample {
    let gas = if (3000..3200).contains(&step) { AdcCode(0) } else { sample.gas };
    let length = if (4000..4200).contains(&step) { AdcCode(32_760) } else { sample.length };
    Sample { gas, length, emergency_stop: step == 8000, ..sample }
}

#[test]
fn ten_thousand_steps_to_the_bit_and_on_time() {
    if skip_emulator() {
        return;
    }
    let mut board = EmulatedBoard::new().unwrap();
    let mut muscle = Muscle::new("[plant]\nmodel = \"lumped\"\n[load]\nforce_n = 120.0\n");
    let config = *muscle.config();
    let cycle = SetPoint::MassFlowCycle { flow_kg_s: 3.6e-4, period_s: 2.0 };
    let pressure = SetPoint::Pressure { pressure_pa: 3.0e5 };
    board.start(&config, cycle).unwrap();

    let (mut rows, mut fed, mut duties_and_pins) = (Vec::new(), Vec::new(), Vec::new());
    let started = std::time::Instant::now();
    for step in 0..=STEPS {
        if step == 5000 {
            board.set(pressure).unwrap();
        }
        fed.push(with_faults(step, muscle.sample()));
        let outcome = board.step(&fed[step as usize]).unwrap();
        muscle.advance(outcome.actuation);
        duties_and_pins.push((outcome.actuation, board.shown().unwrap().actuation()));
        if let Some(telemetry) = outcome.telemetry {
            // What was fed is what was read: the conversions add up to the code.
            let Sample { heard, .. } = telemetry.sample;
            let sample = Sample { heard, ..fed[telemetry.step as usize] };
            assert_eq!(telemetry.sample, sample, "step {}", telemetry.step);
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
    let outcome = replay(&mut CoreBoard::default(), &config, &rows).unwrap();
    assert_eq!((outcome.mismatches, outcome.first), (0, None));
    // The run was worth comparing: both valves moved, and the emergency stop vented.
    let duties: std::collections::BTreeSet<_> = rows
        .iter()
        .map(|row| (row.telemetry.command.inlet, row.telemetry.command.outlet))
        .collect();
    assert!(duties.len() > 50, "{} commands", duties.len());
    assert!(rows[9000].telemetry.faults.intersects(model_core::Faults::EMERGENCY_STOP));

    // The timer holds what the core commanded, and the pins do what the timer holds: their time
    // open adds up to the duties', but for the period that is under way.
    let (mut ahead, mut open) = ((0.0, 0.0), (0.0, 0.0));
    for (row, (set, pins)) in rows.iter().zip(&duties_and_pins) {
        let command = row.telemetry.command;
        assert!((set.inlet - f64::from(command.inlet.share())).abs() < 1e-4, "{set:?} {row:?}");
        assert!((set.outlet - f64::from(command.outlet.share())).abs() < 1e-4, "{set:?} {row:?}");
        open = (open.0 + pins.inlet, open.1 + pins.outlet);
        ahead = (ahead.0 + pins.inlet - set.inlet, ahead.1 + pins.outlet - set.outlet);
        assert!(ahead.0.abs() < PERIOD_STEPS && ahead.1.abs() < PERIOD_STEPS, "{ahead:?}");
    }
    assert!(open.0 > 100.0 && open.1 > 1000.0, "{open:?}");

    let timing = board.timing().unwrap();
    println!("{timing:?}, {real_time_factor:.2} times real time");
    assert!(timing.steps > u64::from(STEPS));
    assert_eq!((timing.missed_steps, timing.dropped_telemetry, timing.malformed_frames), (0, 0, 0));
    assert!((1..=20).contains(&timing.jitter_worst_us), "{timing:?}");
    assert!((20_000..=150_000).contains(&timing.step_mean_ns), "{timing:?}");
    assert!((50..=STEP_WORST_US).contains(&timing.step_worst_us), "{timing:?}");
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
    let config = Config { step_s: 0.002, ..Config::default() };
    let refused = refusal(&mut board, HostCommand::Configure(config));
    assert_eq!(refused, Refusal::Step { board_us: 1000 });
    let config = Config { pwm_period_steps: 500, ..Config::default() };
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
