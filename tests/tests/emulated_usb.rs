//! The link over the chip's own USB, alone and together with the UART.

use model_core::{Faults, SetPoint};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use system_tests::rig::{Rig, STARTUP_CHECK_STEPS, powered, silent};
use thermyo_boards::emulated::Port;
use thermyo_protocol::{Answer, HostCommand, PROTOCOL, Refusal, Timing};
use thermyo_simulation::board::BoardError;

/// Largest deviation of a step's start from its mean delay \[us\].
const JITTER_US: f64 = 5.0;
/// Largest time after [`LINK_TIMEOUT_MS`] until both coils are without power \[ms\].
const VENT_MS: u32 = 20;
const LINK_TIMEOUT_MS: u32 = 100;
const SCENARIO: &str = "[plant]\nmodel = \"lumped\"\n[supply]\npressure_pa = 600000.0\n\
                        [link]\ntimeout_s = 0.1\n";
const FILL: SetPoint = SetPoint::Duty { inlet: 0.3, outlet: 0.0 };

/// Runs with a host that reports regularly, for this time; returns whether the outlet was closed at
/// the end.
fn run(rig: &mut Rig, milliseconds: u32) -> bool {
    let mut closed = false;
    for ms in 0..milliseconds {
        if ms % 20 == 0 {
            rig.board.send(HostCommand::Alive);
        }
        closed = rig.exchange_with(silent).outlet_coil > 0.9;
    }
    closed
}

/// Lets time pass in which no host sends anything.
fn wait(rig: &mut Rig, milliseconds: u32) {
    for _ in 0..milliseconds {
        rig.exchange_with(silent);
    }
}

/// Worst start of a step, relative to the mean start \[us\].
fn jitter_us(timing: &Timing) -> f64 {
    f64::from(timing.jitter_worst_us) - f64::from(timing.jitter_mean_ns) * 1.0e-3
}

fn random(seed: u64) -> impl FnMut(u32) -> u32 {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    move |end| (random.next_u64() % u64::from(end)) as u32
}

#[test]
fn the_board_identifies_itself() {
    let mut rig = Rig::plugged(SCENARIO);
    let expected = "1209:0001 Thermyo Thermyo valve controller E6605838835B2A31";
    assert_eq!(rig.board.take_identities(), [expected]);
    assert_eq!(rig.board.version().unwrap().protocol, PROTOCOL);
}

/// A host's requests affect its own link only.
#[test]
fn each_line_has_its_own_telemetry() {
    let mut rig = Rig::plugged(SCENARIO);
    let frames = |rig: &mut Rig| {
        [Port::Uart, Port::Usb].map(|port| {
            rig.board.use_port(port);
            rig.board.take_telemetry().len()
        })
    };
    wait(&mut rig, 100);
    assert_eq!(frames(&mut rig), [0, 0], "no request yet");
    rig.board.ask(HostCommand::TelemetryDivider(1)).unwrap();
    frames(&mut rig);
    wait(&mut rig, 100);
    let [uart, usb] = frames(&mut rig);
    assert!(uart == 0 && (98..=102).contains(&usb), "{uart} {usb}");
    rig.board.use_port(Port::Uart);
    rig.board.ask(HostCommand::Version).unwrap();
    frames(&mut rig);
    wait(&mut rig, 100);
    let [uart, usb] = frames(&mut rig);
    assert!((9..=11).contains(&uart) && (98..=102).contains(&usb), "{uart} {usb}");
    rig.board.open(false);
    wait(&mut rig, 20);
    frames(&mut rig);
    rig.board.open(true);
    wait(&mut rig, 100);
    let [uart, usb] = frames(&mut rig);
    assert!((9..=11).contains(&uart) && usb <= 1, "closed and opened again: {uart} {usb}");
    assert_eq!(rig.board.timing().unwrap().dropped_telemetry, 0);
}

#[test]
fn a_step_starts_on_time_while_both_lines_are_busy() {
    let mut rig = Rig::plugged(SCENARIO);
    rig.start(SetPoint::Contraction { contraction: 0.1 });
    rig.board.use_port(Port::Uart);
    rig.board.ask(HostCommand::TelemetryDivider(1)).unwrap();
    let mut frames = [0, 0];
    let mut busy_cycles = 0;
    for ms in 0..2000_u32 {
        for port in [Port::Usb, Port::Uart] {
            rig.board.use_port(port);
            if ms.is_multiple_of(10) {
                rig.board.send(HostCommand::Timing);
            }
            frames[port as usize] += rig.board.take_telemetry().len();
        }
        rig.board.use_port(Port::Usb);
        if ms.is_multiple_of(10) {
            let contraction = if ms % 1000 < 500 { 0.1 } else { 0.15 };
            rig.board.send(HostCommand::Set(SetPoint::Contraction { contraction }));
        }
        let exchange = rig.exchange_with(silent);
        assert_eq!(exchange.restarts, 0, "{ms} ms");
        busy_cycles += u64::from(exchange.busy_cycles);
    }
    let timing = rig.board.timing().unwrap();
    let busy = busy_cycles as f64 / (2000.0 * 200_000.0);
    println!(
        "both lines: {:.1} us from the mean start at worst, {:.1} % busy, {timing:?}",
        jitter_us(&timing),
        100.0 * busy
    );
    assert!((0.0..=JITTER_US).contains(&jitter_us(&timing)), "{timing:?}");
    assert_eq!((timing.missed_steps, timing.dropped_requests, timing.malformed_frames), (0, 0, 0));
    assert!(frames.iter().all(|count| (1950..=2100).contains(count)), "{frames:?}");
    assert!(timing.dropped_telemetry < 10, "{timing:?}");
}

/// A bus full of random bytes: requests are dropped, and neither steps nor telemetry are lost.
#[test]
fn a_flood_over_usb_changes_nothing() {
    for command in [HostCommand::Version, HostCommand::Timing, HostCommand::ReadConfig] {
        let mut rig = Rig::plugged(SCENARIO);
        rig.start(FILL);
        run(&mut rig, 100);
        for _ in 0..300 {
            while rig.board.waiting() < 4096 {
                rig.board.send(command);
            }
            rig.exchange_with(silent);
        }
        rig.board.use_port(Port::Uart);
        let timing = rig.board.timing().unwrap();
        println!("flood of {command:?}: {timing:?}");
        assert_eq!(
            (timing.missed_steps, rig.exchange().restarts),
            (0, 0),
            "{command:?}: {timing:?}"
        );
        assert!(timing.dropped_requests > 1000, "{command:?}: {timing:?}");
        assert!(jitter_us(&timing) <= 20.0, "{command:?}: {timing:?}");
        rig.board.send(HostCommand::Stop);
        let until_vented = (0..50).filter(|_| powered(&rig.exchange_with(silent))).count();
        // A host that requests the version has just connected, so nothing keeps its set point
        // alive.
        let least = usize::from(command != HostCommand::Version);
        assert!((least..=5).contains(&until_vented), "{command:?}: {until_vented} ms");
    }
}

/// Checks a board that is plugged in, queried and unplugged at any moment and in any order.
fn assert_it_can_be_plugged_in(cycles: u32) {
    let mut random = random(5);
    let mut rig = Rig::plugged(SCENARIO);
    rig.board.take_identities();
    for cycle in 0..cycles {
        rig.board.plug(false);
        wait(&mut rig, 1 + random(10));
        // Now and then the cable is in for too short a time.
        if cycle % 4 == 0 {
            rig.board.plug(true);
            wait(&mut rig, 8 + random(8));
            rig.board.plug(false);
            wait(&mut rig, 1 + random(10));
        }
        rig.board.connect_usb().unwrap_or_else(|error| panic!("cycle {cycle}: {error}"));
        // The cable may have been pulled amid a frame.
        rig.board.write(&[0]);
        assert_eq!(rig.board.version().unwrap().protocol, PROTOCOL, "cycle {cycle}");
        match cycle % 3 {
            0 => rig.board.write(&[7, 7]),
            1 => rig.board.send(HostCommand::TelemetryDivider(1)),
            _ => drop(rig.board.ask(HostCommand::ReadConfig).unwrap()),
        }
        wait(&mut rig, 5 + random(20));
        assert!(!rig.board.take_telemetry().is_empty() || cycle % 3 != 1, "cycle {cycle}");
    }
    rig.board.use_port(Port::Uart);
    let timing = rig.board.timing().unwrap();
    println!("{cycles} cycles: {timing:?}");
    assert_eq!((timing.missed_steps, rig.exchange().restarts), (0, 0), "{timing:?}");
    // For 3 ms after the cable was pulled the bus does not count as suspended; a third of the hosts
    // is sent a frame per step.
    assert!(timing.dropped_telemetry <= cycles, "{timing:?}");
    assert!(jitter_us(&timing) <= JITTER_US, "{timing:?}");
}

#[test]
fn a_hundred_times_plugged_in_and_out() {
    assert_it_can_be_plugged_in(100);
}

/// Ways in which a host leaves.
#[derive(Debug, Clone, Copy)]
enum Loss {
    /// The cable is pulled.
    Unplugged,
    /// The program ends.
    Closed,
    /// The program hangs.
    Silent,
}

/// Loses the host at a random moment, while another host watches over the other port.
fn assert_a_lost_host_vents(cases: u32) {
    let mut random = random(6);
    let (mut least, mut worst) = (u32::MAX, 0);
    let mut rig = Rig::plugged(SCENARIO);
    for case in 0..cases {
        let (port, other) =
            if case % 4 == 3 { (Port::Uart, Port::Usb) } else { (Port::Usb, Port::Uart) };
        rig.board.connect_usb().unwrap();
        rig.board.use_port(port);
        rig.board.ask(HostCommand::ClearFaults).unwrap();
        rig.start(FILL);
        assert!(run(&mut rig, STARTUP_CHECK_STEPS + 40 + random(60)), "case {case}: it fills");
        let last = random(1_000_000);
        rig.board.send(HostCommand::Alive);
        rig.run(last, silent);
        let loss = [Loss::Unplugged, Loss::Closed, Loss::Silent][random(3) as usize];
        if port == Port::Usb {
            rig.board.plug(!matches!(loss, Loss::Unplugged));
            rig.board.open(matches!(loss, Loss::Silent));
        }
        rig.board.use_port(other);
        let mut until_vented = 0;
        for ms in 1..=LINK_TIMEOUT_MS + 100 {
            if ms % 20 == 0 {
                rig.board.send(HostCommand::Timing);
            }
            if powered(&rig.exchange_with(silent)) {
                until_vented = ms;
            }
        }
        assert!(
            until_vented <= LINK_TIMEOUT_MS + VENT_MS,
            "case {case}: {until_vented} ms, {loss:?} at {port:?}"
        );
        least = least.min(until_vented);
        worst = worst.max(until_vented);
        rig.board.take_telemetry();
        run(&mut rig, 30);
        let telemetry = rig.board.take_telemetry();
        let faults = telemetry.last().map(|telemetry| telemetry.faults);
        // If the other line is unplugged too, there is no host left to report to.
        if port == Port::Usb {
            assert_eq!(faults, Some(Faults::LINK_LOST), "case {case}");
        }
    }
    println!("{cases} lost hosts: vented after {least} to {worst} ms");
    assert!(least >= LINK_TIMEOUT_MS - 22, "{least} ms");
}

#[test]
fn a_host_that_is_lost_vents() {
    assert_a_lost_host_vents(12);
}

#[test]
#[ignore = "minutes: cargo test --release -p system-tests emulated_usb -- --ignored --nocapture"]
fn a_hundred_hosts_that_are_lost_vent() {
    assert_a_lost_host_vents(100);
}

#[test]
fn the_board_leaves_for_its_boot_loader_only_while_it_vents() {
    for port in [Port::Usb, Port::Uart] {
        let mut rig = Rig::plugged(SCENARIO);
        rig.board.use_port(port);
        rig.start(FILL);
        assert!(run(&mut rig, 100));
        match rig.board.ask(HostCommand::BootLoader) {
            Err(BoardError::Refused(Refusal::NotVented)) => (),
            other => panic!("{other:?}"),
        }
        assert!(run(&mut rig, 50), "it goes on");
        rig.board.ask(HostCommand::Stop).unwrap();
        run(&mut rig, 20);
        assert!(matches!(rig.board.ask(HostCommand::BootLoader).unwrap(), Answer::Done { .. }));
        let exchanges: Vec<_> = (0..60).map(|_| rig.exchange_with(silent)).collect();
        let left = exchanges.iter().position(|exchange| exchange.boot_loader).unwrap();
        assert!((10..=30).contains(&left), "after {left} ms");
        assert!(exchanges.iter().all(|exchange| !powered(exchange)));
    }
}
