//! After any failure of the firmware the valves are safe within 100 ms, and it can report the cause.

use model_core::config::LinkConfig;
use model_core::{AdcCode, Command, Config, Faults, Sample, SetPoint, SetPointError, Telemetry};
use system_tests::rig::{Rig, STARTUP_CHECK_STEPS, silent};
use thermyo_boards::emulated::{Exchange, Injection, Place, START_MS};
use thermyo_protocol::{HostCommand, LastReset, Phase, Refusal};

/// Valves must be safe within this time \[ms\].
const SAFE_MS: u32 = 100;

/// Turns the control task's next instruction into an endless loop.
const HANG: Injection = Injection::Hang { place: Place::Control, instruction: 1 };

/// Changes the muscle's sample before the board reads it.
type Change = fn(Sample) -> Sample;
const AS_IT_IS: Change = |sample| sample;
const PRESSED: Change = |sample| Sample { emergency_stop: true, ..sample };
const SHORTED: Change = |sample| Sample { pressure: AdcCode(0).into(), ..sample };

fn fill(inlet: f32) -> SetPoint {
    SetPoint::Duty { inlet, outlet: 0.0 }
}

/// A muscle that follows the core's model, at a board right after power-on. Even if filled for long, it stays below its
/// pressure limit.
fn lumped() -> Rig {
    Rig::new("[plant]\nmodel = \"lumped\"\n[supply]\npressure_pa = 600000.0\n")
}

/// A board whose inlet is half open and whose outlet is closed.
fn filling() -> Rig {
    let mut rig = lumped();
    rig.start(fill(0.5));
    let shares = mean_shares(&mut rig, STARTUP_CHECK_STEPS + 40, 20);
    assert!((0.49..=0.51).contains(&shares.0) && shares.1 > 0.999, "{shares:?}");
    rig
}

/// Mean powered shares of the coils over the last `count` of `total` milliseconds.
fn mean_shares(rig: &mut Rig, total: u32, count: u32) -> (f64, f64) {
    let mut sums = (0.0, 0.0);
    for ms in 0..total {
        let exchange = rig.exchange();
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

/// Time until both coils stay without power \[ms\].
fn time_to_vent(rig: &mut Rig, change: impl Fn(Sample) -> Sample) -> u32 {
    let vented: Vec<bool> = (0..200).map(|_| vented(&rig.exchange_with(&change))).collect();
    assert_eq!(vented.last(), Some(&true), "never vents");
    vented.iter().rposition(|&vented| !vented).map_or(0, |last| last as u32 + 1)
}

/// A started board sends nothing until the host has reported, which it does every 100 ms.
fn until_asked(rig: &mut Rig) {
    rig.pass(100);
}

/// Starts a board that is configured to run without a host.
fn start_alone(rig: &mut Rig, set_point: SetPoint) {
    let alone = Config { link: LinkConfig { timeout_s: 0.0 }, ..*rig.muscle.config() };
    let arm = HostCommand::Arm { most_pa: None };
    for command in [HostCommand::Configure(alone), arm, HostCommand::Start(set_point)] {
        rig.board.ask(command).unwrap();
    }
}

fn last_telemetry(rig: &mut Rig, change: Change) -> Telemetry {
    rig.board.take_telemetry();
    for _ in 0..15 {
        rig.exchange_with(change);
    }
    *rig.board.take_telemetry().last().unwrap()
}

#[test]
fn valves_are_safe_before_the_first_sample_and_without_a_set_point() {
    let mut rig = lumped();
    for _ in 0..50 {
        assert!(vented(&rig.exchange()));
    }
    assert_eq!(rig.board.last_reset().unwrap(), LastReset::Power);
}

#[test]
fn the_emergency_stop_vents_and_latches() {
    let mut rig = filling();
    let ms = time_to_vent(&mut rig, PRESSED);
    assert!((1..=20).contains(&ms), "{ms} ms");
    // After the release the fault is still latched, the muscle still vented, and the fault output on.
    assert_eq!(time_to_vent(&mut rig, AS_IT_IS), 0);
    assert!(rig.exchange().fault_output);
    let telemetry = last_telemetry(&mut rig, AS_IT_IS);
    assert_eq!(telemetry.faults, Faults::EMERGENCY_STOP);
    assert_eq!(telemetry.command, Command::VENT);
    rig.board.ask(HostCommand::ClearFaults).unwrap();
    assert!((0..30).map(|_| rig.exchange()).all(|exchange| vented(&exchange)));
    assert!(!rig.exchange().fault_output);
}

/// Starts in quick succession neither hide a fault nor keep a valve powered.
#[test]
fn starts_do_not_go_round_the_supervisor() {
    for (change, set_point, every_ms) in [(SHORTED, fill(1.0), 9), (AS_IT_IS, fill(0.5), 5)] {
        let mut rig = filling();
        let mut powered_ms = 0.0;
        for ms in 0..400 {
            if ms % every_ms == 0 {
                rig.board.send(HostCommand::Start(set_point));
            }
            powered_ms += rig.exchange_with(change).inlet_coil;
        }
        // The inlet continues until the first start is carried out.
        assert!(powered_ms < 5.0, "powered for {powered_ms} ms of 400");
        let faults = last_telemetry(&mut rig, change).faults;
        assert_eq!(faults.intersects(Faults::PRESSURE_SENSOR), every_ms == 9, "{faults:?}");
    }
}

/// Latched faults and the first failure survive a restart of the board until they are cleared.
#[test]
fn latched_faults_survive_a_restart() {
    let mut rig = filling();
    rig.exchange_with(PRESSED);
    rig.exchange();
    rig.board.inject(HANG);
    while rig.exchange().restarts == 0 {}
    rig.pass(START_MS);
    let both = Faults::EMERGENCY_STOP.with(Faults::NOT_CONFIGURED);
    assert_eq!(last_telemetry(&mut rig, AS_IT_IS).faults, both);
    let first = rig.first_failure();
    assert_eq!(first.faults, Faults::EMERGENCY_STOP);
    assert!((30..60).contains(&first.step) && first.pressure_pa > 1.1e5, "{first:?}");
    rig.start(fill(0.5));
    assert_eq!(mean_shares(&mut rig, 100, 50), (0.0, 0.0), "it is configured, and vents");
    assert_eq!(last_telemetry(&mut rig, AS_IT_IS).faults, Faults::EMERGENCY_STOP);
    rig.board.ask(HostCommand::ClearFaults).unwrap();
    rig.start(fill(0.5));
    assert!(mean_shares(&mut rig, 100, 20).0 > 0.49);
}

/// A nonsensical set point is refused by name, and changes nothing.
#[test]
fn nonsense_is_refused() {
    let mut rig = filling();
    for (set_point, key) in [
        (SetPoint::Contraction { contraction: f32::NAN }, "contraction"),
        (SetPoint::Contraction { contraction: 0.4 }, "contraction"),
        (SetPoint::Pressure { pressure_pa: f32::INFINITY }, "pressure_pa"),
        (SetPoint::MassFlowCycle { flow_kg_s: 1.0e-4, period_s: 0.0 }, "period_s"),
        (SetPoint::Duty { inlet: 1.31, outlet: 0.0 }, "inlet"),
    ] {
        for command in [HostCommand::Set(set_point), HostCommand::Start(set_point)] {
            let text = rig.refused(command).to_string();
            assert!(text.starts_with(key) && text.contains("must be from 0"), "{text}");
            let shares = mean_shares(&mut rig, 20, 20);
            assert!((0.49..=0.51).contains(&shares.0), "it goes on: {shares:?}");
        }
    }
}

/// Silence of the host vents a driven muscle within the configured time.
#[test]
fn a_lost_link_vents() {
    let mut rig = lumped();
    let pressure = SetPoint::Pressure { pressure_pa: 4.0e5 };
    rig.start(pressure);
    let held = |rig: &mut Rig, ms| mean_shares(rig, ms, 20).1 > 0.9;
    assert!(held(&mut rig, 100), "it fills");
    let powered: Vec<bool> = (0..700).map(|_| !vented(&rig.exchange_with(silent))).collect();
    let until_vented = powered.iter().rposition(|&powered| powered).unwrap();
    assert!((380..=501).contains(&until_vented), "{until_vented} ms");
    assert_eq!(last_telemetry(&mut rig, AS_IT_IS).faults, Faults::LINK_LOST);
    rig.board.ask(HostCommand::Arm { most_pa: None }).unwrap();
    rig.board.ask(HostCommand::Set(pressure)).unwrap();
    assert!(held(&mut rig, 100), "armed again, it goes on");
    // A board configured to run without a host continues.
    start_alone(&mut rig, pressure);
    for _ in 0..2000 {
        rig.exchange_with(silent);
    }
    assert!(rig.exchange_with(silent).outlet_coil > 0.9);
}

/// The stop also acts at once at the longest PWM period.
#[test]
fn the_emergency_stop_does_not_wait_for_the_period() {
    for after_ms in [1, 30, 60, 80] {
        let mut rig = Rig::new("[plant]\nmodel = \"lumped\"\n[valve]\npwm_hz = 12.346\n");
        assert_eq!(rig.muscle.config().pwm_period_steps, 81);
        rig.start(fill(1.0));
        rig.pass(STARTUP_CHECK_STEPS + after_ms);
        let ms = time_to_vent(&mut rig, PRESSED);
        assert!((1..=2).contains(&ms), "{ms} ms");
    }
}

#[test]
fn a_frozen_pressure_vents() {
    let mut rig = filling();
    let frozen = rig.muscle.sample();
    let ms = time_to_vent(&mut rig, |_| frozen);
    assert!((10..=SAFE_MS).contains(&ms), "{ms} ms");
    // The length is frozen as well, which alone would not vent.
    let first = rig.first_failure();
    assert_eq!(first.faults, Faults::PRESSURE_SENSOR.with(Faults::LENGTH_SENSOR));
}

#[test]
fn a_hang_of_the_control_task_ends_in_the_watchdog() {
    let mut rig = filling();
    rig.board.inject(HANG);
    let ms = time_to_vent(&mut rig, AS_IT_IS);
    assert!((10..=SAFE_MS).contains(&ms), "{ms} ms");
    let reason = rig.board.last_reset().unwrap();
    assert!(matches!(reason, LastReset::Watchdog { .. }), "{reason:?}");
    assert_eq!(rig.exchange().restarts, 1);
    // The board runs again on the defaults, is not configured, and accepts no set point.
    let set = HostCommand::Set(SetPoint::Pressure { pressure_pa: 5.0e5 });
    let faults = SetPointError::Faults(Faults::NOT_CONFIGURED);
    assert_eq!(rig.refused(set), Refusal::SetPoint(faults));
    assert_eq!(rig.refused(HostCommand::Start(fill(0.5))), Refusal::NotConfigured);
    rig.start(fill(0.5));
    assert!(mean_shares(&mut rig, 100, 20).0 > 0.49);
}

#[test]
fn a_fault_of_the_processor_vents_at_once_and_is_remembered() {
    let mut rig = filling();
    rig.board.inject(Injection::Fault);
    let ms = time_to_vent(&mut rig, AS_IT_IS);
    assert!((1..=2).contains(&ms), "{ms} ms");
    match rig.board.last_reset().unwrap() {
        LastReset::HardFault { address, phase: Phase::Waiting } => {
            assert!((0x2000_0000..0x2002_0000).contains(&address), "{address:#x}");
        }
        other => panic!("{other:?}"),
    }
    assert_eq!(rig.exchange().restarts, 1);
}

/// The stack lies at the bottom of RAM: it overwrites nothing, and the watchdog vents.
#[test]
fn an_overflowing_stack_vents_and_is_remembered() {
    let mut rig = filling();
    rig.board.inject(Injection::StackOverflow);
    let ms = time_to_vent(&mut rig, AS_IT_IS);
    assert!((10..=60).contains(&ms), "{ms} ms");
    let last_reset = rig.board.last_reset().unwrap();
    assert!(matches!(last_reset, LastReset::Watchdog { .. }), "{last_reset:?}");
    assert_eq!(rig.exchange().restarts, 1);
}

/// Fraction of a second for which the LED is on, how often it turns on, and the fault output.
fn shown(rig: &mut Rig, change: Change) -> (f64, usize, bool) {
    let second: Vec<Exchange> = (0..1000).map(|_| rig.exchange_with(change)).collect();
    let lit = second.iter().filter(|exchange| exchange.led).count() as f64 / 1000.0;
    // The second begins anywhere in the pattern, so its end precedes its beginning.
    let flashes = (0..1000).filter(|&i| second[i].led && !second[(i + 999) % 1000].led).count();
    assert!(second.iter().all(|exchange| exchange.fault_output == second[0].fault_output));
    (lit, flashes, second[0].fault_output)
}

/// A board that waits for its configuration shows it in every frame and with its LED, after power-on
/// and after a restart; the fault output is for faults only.
#[test]
fn a_board_without_configuration_reports_it() {
    let mut rig = lumped();
    let waits = |rig: &mut Rig| {
        rig.board.take_telemetry();
        let shown = shown(rig, AS_IT_IS);
        let frames = rig.board.take_telemetry();
        assert!((95..=101).contains(&frames.len()), "{} frames in a second", frames.len());
        for frame in frames {
            assert_eq!((frame.faults, frame.command), (Faults::NOT_CONFIGURED, Command::VENT));
        }
        shown
    };
    until_asked(&mut rig);
    assert_eq!(waits(&mut rig), (0.1, 1, false), "off, on shortly every second");
    rig.start(fill(0.0));
    rig.pass(30);
    assert_eq!(shown(&mut rig, AS_IT_IS), (0.9, 1, false), "on, off shortly every second");
    for _ in 0..30 {
        rig.exchange_with(PRESSED);
    }
    assert_eq!(shown(&mut rig, PRESSED), (0.5, 5, true), "five flashes");
    rig.exchange();
    rig.board.ask(HostCommand::ClearFaults).unwrap();
    rig.board.inject(HANG);
    while rig.exchange().restarts == 0 {}
    rig.pass(START_MS);
    assert_eq!(waits(&mut rig), (0.3, 3, false), "three flashes, a pause");
}

/// An overrun is counted even if an order arrives with it; four missed steps are tolerated, and a fifth together with
/// them vents.
#[test]
fn missed_steps_are_counted_and_vent_when_they_come_together() {
    let mut rig = filling();
    // 5.3 ms, starting a tenth of a step before a step, or a millisecond more.
    let overrun = |rig: &mut Rig, milliseconds: u32| {
        let sample = rig.muscle.sample();
        rig.board.inject(Injection::AdcStalled(true));
        rig.board.send(HostCommand::Set(fill(0.5)));
        rig.pass(milliseconds);
        rig.board.run(&sample, 300_000).unwrap();
        rig.board.inject(Injection::AdcStalled(false));
        rig.board.run(&sample, 700_000).unwrap();
        rig.pass(20);
        let counts = rig.board.take_telemetry().iter().map(|t| t.sample.missed_steps).collect();
        let counts: Vec<u8> = counts;
        let reported: u32 = counts.into_iter().map(u32::from).sum();
        (reported, rig.board.timing().unwrap().missed_steps)
    };
    rig.board.take_telemetry();
    assert_eq!(overrun(&mut rig, 5), (4, 4));
    mean_shares(&mut rig, 90, 20);
    assert_eq!(last_telemetry(&mut rig, AS_IT_IS).faults, Faults::NONE);
    assert!(mean_shares(&mut rig, 20, 20).0 > 0.49, "it goes on");
    let (reported, counted) = overrun(&mut rig, 6);
    assert_eq!((reported, counted), (5, 9));
    assert_eq!(last_telemetry(&mut rig, AS_IT_IS).faults, Faults::MISSED_STEPS);
    assert_eq!(mean_shares(&mut rig, 20, 20), (0.0, 0.0));
    assert_eq!(rig.exchange().restarts, 0);
}

#[test]
fn a_stalled_converter_ends_in_the_watchdog_with_its_phase() {
    let mut rig = filling();
    rig.board.inject(Injection::AdcStalled(true));
    let ms = time_to_vent(&mut rig, AS_IT_IS);
    assert!((10..=SAFE_MS).contains(&ms), "{ms} ms");
    // Right after a restart: a stall that ended sooner would leave a late board that waits.
    let before = rig.exchange().restarts;
    let again = (0..START_MS + 100).any(|_| rig.exchange().restarts > before);
    assert!(again, "the watchdog bites as long as it lasts");
    rig.board.inject(Injection::AdcStalled(false));
    rig.pass(START_MS);
    assert_eq!(rig.board.last_reset().unwrap(), LastReset::Watchdog { phase: Phase::Sampling });
}

#[test]
fn a_million_random_bytes_change_nothing() {
    let mut rig = lumped();
    // No request gets through, so the board is configured to run without a host.
    start_alone(&mut rig, fill(0.5));
    mean_shares(&mut rig, 90, 20);
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
    rig.board.write(&garbage);
    // Ten bits per byte at 921600 baud.
    let ms = 1_000_000 / 92 + 20;
    for step in 0..ms {
        let exchange = rig.exchange_with(silent);
        assert_eq!(exchange.restarts, 0, "restarted at {step} ms");
        assert!(exchange.outlet_coil > 0.999, "the outlet opened at {step} ms");
    }
    rig.board.read();
    // One zero synchronises the link again, and everything was counted.
    rig.board.write(&[0]);
    let timing = rig.board.timing().unwrap();
    println!("{timing:?}");
    assert!((3000..=5000).contains(&timing.malformed_frames), "{timing:?}");
    assert_eq!(timing.missed_steps, 0, "{timing:?}");
    let shares = mean_shares(&mut rig, 40, 20);
    assert!((0.49..=0.51).contains(&shares.0), "{shares:?}");
}
