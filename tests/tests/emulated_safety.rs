//! Whatever happens to the firmware, the valves are safe within 100 ms and it can say afterwards
//! what happened.

use host_sim::board::Board;
use host_sim::board::emulated::{EmulatedBoard, Exchange, Injection};
use model_core::supervisor::JUDGING_STEPS;
use model_core::wire::{HostCommand, LastReset, Phase};
use model_core::{AdcCode, Command, Config, Duty, Faults, Sample, SetPoint, Telemetry};
use system_tests::skip_emulator;

/// Valves must be safe within this time \[ms\].
const SAFE_MS: u32 = 100;

const HEALTHY: Sample = Sample {
    pressure: AdcCode(7770),
    gas: AdcCode(15_950),
    length: AdcCode(23_757),
    emergency_stop: false,
};

/// A board whose inlet is half open and whose outlet is closed.
fn filling() -> EmulatedBoard {
    let mut board = EmulatedBoard::new().unwrap();
    let command = Command { inlet: Duty::from_share(0.5), outlet: Duty::ZERO };
    board.start(&Config::default(), SetPoint::Duty(command)).unwrap();
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
    let fill = |share| {
        SetPoint::Duty(Command { inlet: Duty::from_share(share), outlet: Duty::ZERO })
    };
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
    // It runs again, and vents until it is told otherwise.
    let telemetry = last_telemetry(&mut board, &HEALTHY);
    assert_eq!((telemetry.command, telemetry.faults), (Command::VENT, Faults::NONE));
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
    let mut board = filling();
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
        let exchange = board.exchange(&Sample { pressure, ..HEALTHY }).unwrap();
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
