//! Whatever happens to the firmware, the valves are safe within 100 ms and it can say afterwards
//! what happened.

use host_sim::board::Board;
use host_sim::board::BoardError;
use host_sim::board::emulated::{EmulatedBoard, Exchange, Injection};
use model_core::supervisor::JUDGING_STEPS;
use model_core::wire::{Answer, HostCommand, LastReset, Phase, Refusal};
use model_core::{AdcCode, Command, Config, Faults, Sample, SetPoint, SetPointError, Telemetry};
use system_tests::skip_emulator;

/// Valves must be safe within this time \[ms\].
const SAFE_MS: u32 = 100;

const HEALTHY: Sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));

fn fill(inlet: f32) -> SetPoint {
    SetPoint::Duty { inlet, outlet: 0.0 }
}

/// A board whose inlet is half open and whose outlet is closed.
fn filling() -> EmulatedBoard {
    let mut board = EmulatedBoard::new().unwrap();
    board.start(&Config::default(), fill(0.5)).unwrap();
    let judging_ms = u32::from(JUDGING_STEPS);
    let shares = mean_shares(&mut board, judging_ms + 40, 20);
    assert!((0.49..=0.51).contains(&shares.0) && shares.1 > 0.999, "{shares:?}");
    board
}

/// Mean powered shares of the coils over the last `count` of `total` milliseconds.
fn mean_shares(board: &mut EmulatedBoard, total: u32, count: u32) -> (f64, f64) {
    let mut sums = (0.0, 0.0);
    for ms in 0..total {
        let exchange = board.exchange(&HEALTHY).unwrap();
        if ms >= total - count {
            sums.0 += exchange.inlet_coil;
            sums.1 += exchange.outlet_coil;
        }
    }
    (sums.0 / f64::from(count), sums.1 / f64::from(count))
}

fn vented(exchange: &Exchange) -> bool {
    exchange.inlet_coil == 0.0 && exchange.outlet_coil == 0.0
}

/// Time until both coils are without power for good \[ms\].
fn time_to_vent(board: &mut EmulatedBoard, sample: &Sample) -> u32 {
    let vented: Vec<bool> = (0..200).map(|_| vented(&board.exchange(sample).unwrap())).collect();
    assert_eq!(vented.last(), Some(&true), "never vents");
    vented.iter().rposition(|&vented| !vented).map_or(0, |last| last as u32 + 1)
}

fn last_telemetry(board: &mut EmulatedBoard, sample: &Sample) -> Telemetry {
    board.take_telemetry();
    for _ in 0..15 {
        board.exchange(sample).unwrap();
    }
    *board.take_telemetry().last().unwrap()
}

#[test]
fn valves_are_safe_before_the_first_sample_and_without_a_set_point() {
    if skip_emulator() {
        return;
    }
    let mut board = EmulatedBoard::new().unwrap();
    for _ in 0..50 {
        assert!(vented(&board.exchange(&HEALTHY).unwrap()));
    }
    assert_eq!(board.last_reset().unwrap(), LastReset::Power);
}

#[test]
fn the_emergency_stop_vents_and_latches() {
    if skip_emulator() {
        return;
    }
    let mut board = filling();
    let pressed = Sample { emergency_stop: true, ..HEALTHY };
    let ms = time_to_vent(&mut board, &pressed);
    assert!((1..=20).contains(&ms), "{ms} ms");
    // Released: still latched, still vented, and the fault output says so.
    assert_eq!(time_to_vent(&mut board, &HEALTHY), 0);
    assert!(board.exchange(&HEALTHY).unwrap().fault_output);
    let telemetry = last_telemetry(&mut board, &HEALTHY);
    assert_eq!(telemetry.faults, Faults::EMERGENCY_STOP);
    assert_eq!(telemetry.command, Command::VENT);
    board.ask(HostCommand::ClearFaults).unwrap();
    assert!((0..30).map(|_| board.exchange(&HEALTHY).unwrap()).all(|exchange| vented(&exchange)));
    assert!(!board.exchange(&HEALTHY).unwrap().fault_output);
}

/// Starts in quick succession neither hide a fault nor keep a valve powered.
#[test]
fn starts_do_not_go_round_the_supervisor() {
    if skip_emulator() {
        return;
    }
    let shorted = Sample { pressure: AdcCode(0), ..HEALTHY };
    for (sample, set_point, every_ms) in [(shorted, fill(1.0), 9), (HEALTHY, fill(0.5), 5)] {
        let mut board = filling();
        let mut powered_ms = 0.0;
        for ms in 0..400 {
            if ms % every_ms == 0 {
                board.send(HostCommand::Start(set_point));
            }
            powered_ms += board.exchange(&sample).unwrap().inlet_coil;
        }
        // Until the first start is carried out the inlet goes on.
        assert!(powered_ms < 5.0, "powered for {powered_ms} ms of 400");
        let faults = last_telemetry(&mut board, &sample).faults;
        assert_eq!(faults.intersects(Faults::PRESSURE_SENSOR), sample == shorted, "{faults:?}");
    }
}

/// What is latched, and what was first, stays so over a restart of the board, until it is cleared.
#[test]
fn latched_faults_survive_a_restart() {
    if skip_emulator() {
        return;
    }
    let mut board = filling();
    board.exchange(&Sample { emergency_stop: true, ..HEALTHY }).unwrap();
    board.exchange(&HEALTHY).unwrap();
    board.inject(Injection::Hang);
    while board.exchange(&HEALTHY).unwrap().restarts == 0 {}
    let both = Faults::EMERGENCY_STOP.with(Faults::NOT_CONFIGURED);
    assert_eq!(last_telemetry(&mut board, &HEALTHY).faults, both);
    let first = match board.ask(HostCommand::FirstFailure).unwrap() {
        Answer::FirstFailure(Some(first)) => first,
        other => panic!("{other:?}"),
    };
    assert_eq!((first.faults, first.pressure), (Faults::EMERGENCY_STOP, HEALTHY.pressure));
    assert!((30..60).contains(&first.step), "{first:?}");
    let started = board.start(&Config::default(), fill(0.5));
    assert!(started.is_ok(), "it is configured: {started:?}");
    assert_eq!(mean_shares(&mut board, 100, 50), (0.0, 0.0), "and vents");
    assert_eq!(last_telemetry(&mut board, &HEALTHY).faults, Faults::EMERGENCY_STOP);
    board.ask(HostCommand::ClearFaults).unwrap();
    board.start(&Config::default(), fill(0.5)).unwrap();
    assert!(mean_shares(&mut board, 100, 20).0 > 0.49);
}

/// A set point that is nonsense is refused by name, and changes nothing.
#[test]
fn nonsense_is_refused() {
    if skip_emulator() {
        return;
    }
    let mut board = filling();
    for (set_point, key) in [
        (SetPoint::Contraction { contraction: f32::NAN }, "contraction"),
        (SetPoint::Contraction { contraction: 0.4 }, "contraction"),
        (SetPoint::Pressure { pressure_pa: f32::INFINITY }, "pressure_pa"),
        (SetPoint::MassFlowCycle { flow_kg_s: 1.0e-4, period_s: 0.0 }, "period_s"),
        (SetPoint::Duty { inlet: 1.31, outlet: 0.0 }, "inlet"),
    ] {
        for command in [HostCommand::Set(set_point), HostCommand::Start(set_point)] {
            match board.ask(command) {
                Err(BoardError::Refused(refusal)) => {
                    let text = refusal.to_string();
                    assert!(text.starts_with(key) && text.contains("must be from 0"), "{text}");
                }
                other => panic!("{other:?}"),
            }
        }
    }
    let shares = mean_shares(&mut board, 20, 20);
    assert!((0.49..=0.51).contains(&shares.0), "it goes on: {shares:?}");
}

/// Silence of the host vents what is driven, within the time that is configured.
#[test]
fn a_lost_link_vents() {
    if skip_emulator() {
        return;
    }
    let mut board = EmulatedBoard::new().unwrap();
    let pressure = SetPoint::Pressure { pressure_pa: 4.0e5 };
    board.start(&Config::default(), pressure).unwrap();
    assert!(mean_shares(&mut board, 100, 20).0 > 0.9, "it fills");
    // The line moves with its noise: it is not frozen.
    let silent = |ms: u32| Sample {
        heard: false,
        pressure: AdcCode(HEALTHY.pressure.0 + ms as u16 % 2),
        ..HEALTHY
    };
    let driven =
        |board: &mut EmulatedBoard, ms| board.exchange(&silent(ms)).unwrap().inlet_coil > 0.0;
    let until_vented = (0..700).rposition(|ms| driven(&mut board, ms)).unwrap();
    assert!((380..=501).contains(&until_vented), "{until_vented} ms");
    assert_eq!(last_telemetry(&mut board, &HEALTHY).faults, Faults::LINK_LOST);
    board.ask(HostCommand::ClearFaults).unwrap();
    board.ask(HostCommand::Set(pressure)).unwrap();
    assert!(mean_shares(&mut board, 40, 20).0 > 0.9, "cleared, it goes on");
    // And a board that is told to go on alone does.
    let alone = Config { link_timeout_s: 0.0, ..Config::default() };
    board.start(&alone, pressure).unwrap();
    board.step(&HEALTHY).unwrap();
    for ms in 0..2000 {
        board.exchange(&silent(ms)).unwrap();
    }
    assert!(board.exchange(&silent(0)).unwrap().inlet_coil > 0.9);
}

/// Valid requests at the full rate of the line take nothing from control, and stop is stop.
#[test]
fn a_flood_of_requests_changes_nothing() {
    if skip_emulator() {
        return;
    }
    for command in [
        HostCommand::Set(fill(0.5)),
        HostCommand::ReadConfig,
        HostCommand::Timing,
        HostCommand::Configure(Config::default()),
        HostCommand::Start(fill(0.5)),
    ] {
        let mut board = filling();
        let moving =
            |ms: u32| Sample { pressure: AdcCode(HEALTHY.pressure.0 + ms as u16 % 2), ..HEALTHY };
        for ms in 0..400 {
            while board.waiting() < 400 {
                board.send(command);
            }
            let exchange = board.exchange(&moving(ms)).unwrap();
            assert_eq!(exchange.restarts, 0, "restarted at {ms} ms of {command:?}");
        }
        board.discard();
        board.write(&[0]);
        for ms in 0..100 {
            board.exchange(&moving(ms)).unwrap();
        }
        board.take_telemetry();
        let timing = board.timing().unwrap();
        assert_eq!(timing.missed_steps, 0, "{command:?}: {timing:?}");
        assert!(timing.dropped_requests > 20, "{command:?}: {timing:?}");
        let faults = last_telemetry(&mut board, &HEALTHY).faults;
        assert!(faults.intersects(Faults::LINK_FLOODED), "{faults:?}");
        board.send(HostCommand::Stop);
        let ms = time_to_vent(&mut board, &HEALTHY);
        assert!(ms <= 3, "{ms} ms to stop after {command:?}");
    }
}

/// At the longest PWM period too.
#[test]
fn the_emergency_stop_does_not_wait_for_the_period() {
    if skip_emulator() {
        return;
    }
    let mut config = Config::default();
    config.drive.period_steps = 102;
    for after_ms in [1, 30, 60, 100] {
        let mut board = EmulatedBoard::new().unwrap();
        board.start(&config, SetPoint::Duty { inlet: 1.0, outlet: 0.0 }).unwrap();
        board.step(&HEALTHY).unwrap();
        for _ in 0..after_ms {
            board.exchange(&HEALTHY).unwrap();
        }
        let ms = time_to_vent(&mut board, &Sample { emergency_stop: true, ..HEALTHY });
        assert!((1..=2).contains(&ms), "{ms} ms");
    }
}

#[test]
fn a_frozen_pressure_vents() {
    if skip_emulator() {
        return;
    }
    let mut board = filling();
    let ms = time_to_vent(&mut board, &HEALTHY);
    assert!((10..=SAFE_MS).contains(&ms), "{ms} ms");
    // The length stands still as well, which alone would not vent.
    let both = Faults::PRESSURE_SENSOR.with(Faults::LENGTH_SENSOR);
    assert_eq!(last_telemetry(&mut board, &HEALTHY).faults, both);
}

#[test]
fn a_hang_of_the_control_task_ends_in_the_watchdog() {
    if skip_emulator() {
        return;
    }
    let mut board = filling();
    board.inject(Injection::Hang);
    let ms = time_to_vent(&mut board, &HEALTHY);
    assert!((10..=SAFE_MS).contains(&ms), "{ms} ms");
    let reason = board.last_reset().unwrap();
    assert!(matches!(reason, LastReset::Watchdog { .. }), "{reason:?}");
    assert_eq!(board.exchange(&HEALTHY).unwrap().restarts, 1);
    // It runs again, on defaults that nobody has told it: it says so, and takes no set point.
    let telemetry = last_telemetry(&mut board, &HEALTHY);
    assert_eq!((telemetry.command, telemetry.faults), (Command::VENT, Faults::NOT_CONFIGURED));
    let refused = |answer| match answer {
        Err(BoardError::Refused(refusal)) => refusal,
        other => panic!("{other:?}"),
    };
    let set = board.ask(HostCommand::Set(SetPoint::Pressure { pressure_pa: 5.0e5 }));
    let faults = SetPointError::Faults(Faults::NOT_CONFIGURED);
    assert_eq!(refused(set), Refusal::SetPoint(faults));
    assert_eq!(refused(board.ask(HostCommand::Start(fill(0.5)))), Refusal::NotConfigured);
    board.start(&Config::default(), fill(0.5)).unwrap();
    assert!(mean_shares(&mut board, 100, 20).0 > 0.49);
}

#[test]
fn a_stalled_converter_ends_in_the_watchdog_which_knows_the_phase() {
    if skip_emulator() {
        return;
    }
    let mut board = filling();
    board.inject(Injection::AdcStalled(true));
    let ms = time_to_vent(&mut board, &HEALTHY);
    assert!((10..=SAFE_MS).contains(&ms), "{ms} ms");
    board.inject(Injection::AdcStalled(false));
    for _ in 0..200 {
        board.exchange(&HEALTHY).unwrap();
    }
    assert_eq!(board.last_reset().unwrap(), LastReset::Watchdog { phase: Phase::Sampling });
}

#[test]
fn a_million_random_bytes_change_nothing() {
    if skip_emulator() {
        return;
    }
    let mut board = EmulatedBoard::new().unwrap();
    // No word of the host gets through: the board goes on alone.
    let alone = Config { link_timeout_s: 0.0, ..Config::default() };
    board.start(&alone, fill(0.5)).unwrap();
    mean_shares(&mut board, 90, 20);
    // xorshift32 (Marsaglia 2003)
    let mut state = 0x1234_5678_u32;
    let garbage: Vec<u8> = (0..1_000_000)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            (state >> 24) as u8
        })
        .collect();
    board.write(&garbage);
    // Ten bits a byte at 921600 baud.
    let ms = 1_000_000 / 92 + 20;
    for step in 0..ms {
        // A line that stands still would be a fault.
        let pressure = AdcCode(HEALTHY.pressure.0 + step as u16 % 2);
        let exchange = board.exchange(&Sample { pressure, heard: false, ..HEALTHY }).unwrap();
        assert_eq!(exchange.restarts, 0, "restarted at {step} ms");
        assert!(exchange.outlet_coil > 0.999, "the outlet opened at {step} ms");
    }
    board.read();
    // The line is in step again after one zero, and everything was counted.
    board.write(&[0]);
    let timing = board.timing().unwrap();
    println!("{timing:?}");
    assert!((3000..=5000).contains(&timing.malformed_frames), "{timing:?}");
    assert_eq!(timing.missed_steps, 0, "{timing:?}");
    let shares = mean_shares(&mut board, 40, 20);
    assert!((0.49..=0.51).contains(&shares.0), "{shares:?}");
}
