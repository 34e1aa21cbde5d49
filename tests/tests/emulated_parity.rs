//! The flashed image computes the same as the core on the host, to the bit, and in time.

use model_core::{Config, Sample};
use std::ops::RangeInclusive;
use system_tests::log::lines;
use system_tests::parity::{self, STEPS};
use thermyo_boards::emulated::EmulatedBoard;
use thermyo_boards::image::{Variant, firmware};
use thermyo_protocol::{Answer, Chip, HostCommand, Image, PROTOCOL, Refusal};
use thermyo_simulation::board::BoardError;

/// PWM period of the configuration in use.
const PERIOD_STEPS: f64 = 10.0;

/// Mean time of the core's step, 80 us, and the worst, including the link's interrupts, 157 us.
const STEP_MEAN_NS: RangeInclusive<u32> = 74_000..=85_000;
const STEP_WORST_US: RangeInclusive<u32> = 147..=167;

/// Largest deviation of a step's start from its mean delay \[us\].
const JITTER_US: u32 = 5;

#[test]
fn ten_thousand_steps_to_the_bit_and_on_time() {
    let mut board = EmulatedBoard::new().unwrap();
    let mut duties_and_pins = Vec::new();
    let started = std::time::Instant::now();
    let record = parity::run(&mut board, |board, outcome| {
        duties_and_pins.push((outcome.actuation, board.shown().unwrap().actuation()));
    });
    let real_time_factor = f64::from(STEPS) * 1.0e-3 / started.elapsed().as_secs_f64();
    record.assert_same_on_the_host();

    // The timer holds the core's commands, and the pins follow the timer: their open times add up
    // to the duties', except for the period under way.
    let (mut ahead, mut open) = ((0.0, 0.0), (0.0, 0.0));
    for (row, (set, pins)) in record.rows.iter().zip(&duties_and_pins) {
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
    let jitter_us = timing.jitter_worst_us.saturating_sub(timing.jitter_mean_ns / 1000);
    assert!(jitter_us <= JITTER_US, "{timing:?}");
    assert!(STEP_MEAN_NS.contains(&timing.step_mean_ns), "{timing:?}");
    assert!(STEP_WORST_US.contains(&timing.step_worst_us), "{timing:?}");
}

#[test]
fn the_board_identifies_itself_and_refuses_unsupported_requests() {
    let image = firmware(Variant::Standard).unwrap();
    let mut board = EmulatedBoard::with_image(&image).unwrap();
    let version = board.version().unwrap();
    assert_eq!(
        (version.protocol, version.chip, version.image),
        (PROTOCOL, Chip::Rp2040, Image::Muscle)
    );

    let refusal = |board: &mut EmulatedBoard, command| match board.ask(command) {
        Err(BoardError::Refused(refusal)) => refusal,
        other => panic!("{other:?}"),
    };
    let config = Config { step_s: 0.002, ..Config::default() };
    let refused = refusal(&mut board, HostCommand::Configure(config));
    assert_eq!(refused, Refusal::Step { board_us: 1000 });
    let config = Config { pwm_period_steps: 500, ..Config::default() };
    let refused = refusal(&mut board, HostCommand::Configure(config));
    assert_eq!(refused, Refusal::Period { maximum_steps: 81 });
    let mut config = Config::default();
    config.valve.critical_ratio = f32::NAN;
    assert_eq!(refusal(&mut board, HostCommand::Configure(config)), Refusal::Config);
    let refused = refusal(&mut board, HostCommand::Step(Sample::default()));
    assert_eq!(refused, Refusal::NoHostSamples);

    // The earlier configuration is still there, whole.
    assert_eq!(board.ask(HostCommand::ReadConfig).unwrap(), Answer::Config(Config::default()));
    assert!(lines(&image, &board.take_log()).iter().any(|line| line.contains("thermyo firmware")));
}
