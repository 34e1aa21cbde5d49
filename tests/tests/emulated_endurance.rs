//! Hundreds of hangs, emergency stops and floods, at random, with a muscle at the emulated board.
//!
//! `cargo test` runs a few of each. All of them take long:
//! `cargo test --release -p system-tests emulated_endurance -- --ignored --nocapture`

use model_core::control::Mode;
use model_core::{Command, Faults, Sample, SetPoint};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use std::ops::{Range, RangeInclusive};
use std::thread;
use system_tests::rig::{Rig, STARTUP_CHECK_STEPS, powered};
use thermyo_boards::emulated::{Exchange, Injection, Place, START_MS};
use thermyo_protocol::{HostCommand, LastReset, Name, Phase, Request, encode};

/// Both coils must be without power within this time \[ms\].
const SAFE_MS: f64 = 100.0;
/// Worst delay of a step's start under a flood \[us\]; 16 is reached.
const JITTER_US: u32 = 20;
/// Worst delay without a flood \[us\].
const QUIET_JITTER_US: u32 = 5;
/// Mean time of the core's step in contraction control, 94.6 us, and over ten minutes, in which it moves more.
const STEP_MEAN_NS: u32 = 96_000;
const LONG_STEP_MEAN_NS: u32 = 97_500;
/// Worst time of the core's step, 189 us.
const STEP_WORST_US: u32 = 195;
/// Longest PWM period of the board \[steps\].
const LONGEST_PERIOD: u32 = 81;
/// Largest duty that a flood commands \[-\].
const FLOOD_INLET: f32 = 0.3;
/// One millisecond \[ns\].
const MS: u32 = 1_000_000;

/// The same random numbers on every machine.
struct Random(Xoshiro256PlusPlus);

impl Random {
    fn new(seed: u64) -> Self {
        Self(Xoshiro256PlusPlus::seed_from_u64(seed))
    }

    fn below(&mut self, end: u32) -> u32 {
        (self.0.next_u64() % u64::from(end)) as u32
    }

    fn share(&mut self) -> f32 {
        self.below(1000) as f32 / 1000.0
    }
}

/// Unused part of the stack's 24 KiB \[bytes\]. Floods of all requests reach each place that takes most of it.
const STACK_UNUSED: RangeInclusive<u32> = 4 * 1024..=14 * 1024;

/// A muscle whose valves follow pulses of any length, at a board with this PWM period.
fn rig(period_steps: u32) -> Rig {
    let rig = Rig::new(&scenario(period_steps));
    assert_eq!(u32::from(rig.muscle.config().pwm_period_steps), period_steps);
    rig
}

fn scenario(period_steps: u32) -> String {
    let pwm_hz = 1000.0 / f64::from(period_steps);
    format!(
        "[plant]\nmodel = \"lumped\"\n[supply]\npressure_pa = 600000.0\n\
         [valve]\npwm_hz = {pwm_hz}\nswitch_time_s = 0.0\ndead_time_s = 0.0\n"
    )
}

/// Runs the halves of a number of cases in parallel, each on its own board.
fn side_by_side<T: Send>(cases: u32, half: impl Fn(Range<u32>) -> T + Sync) -> [T; 2] {
    thread::scope(|scope| {
        let first = scope.spawn(|| half(0..cases / 2));
        let second = half(cases / 2..cases);
        [first.join().expect("its assertions hold"), second]
    })
}

/// Runs until the injected hang occurs. Returns the steps since the inlet was powered.
fn meet(rig: &mut Rig) -> Option<u32> {
    let mut powered_at = 0;
    for before in 1..=500 {
        // Gives the thread something to do.
        if before % 5 == 1 {
            rig.board.send(HostCommand::Timing);
        }
        let exchange = rig.exchange();
        if powered(&exchange) {
            powered_at = before;
        }
        if !exchange.hang_to_come {
            return Some(before - powered_at);
        }
    }
    None
}

/// Hangs one instruction after another; returns the worst time to vent \[ms\], and how often the board reported that
/// control was waiting, sampling, stepping or driving when it ended.
fn hangs(cases: Range<u32>) -> (u32, [u32; 5]) {
    let mut random = Random::new(u64::from(cases.start));
    let mut rig = rig(10);
    let (mut worst_ms, mut phases) = (0, [0; 5]);
    for case in cases {
        let set_point = match random.below(3) {
            0 => SetPoint::Duty { inlet: 0.1 + 0.9 * random.share(), outlet: 0.0 },
            1 => SetPoint::Pressure { pressure_pa: 4.0e5 },
            _ => SetPoint::Contraction { contraction: 0.25 + 0.03 * random.share() },
        };
        rig.start(set_point);
        rig.pass(STARTUP_CHECK_STEPS + 10 + random.below(30));
        let (place, instructions) = match case % 3 {
            0 => (Place::Control, 20_000),
            1 => (Place::Thread, 5_000),
            _ => (Place::Interrupts, 3_000),
        };
        let restarts = rig.exchange().restarts;
        let injection = Injection::Hang { place, instruction: 1 + random.below(instructions) };
        rig.board.inject(injection);
        let since_powered =
            meet(&mut rig).unwrap_or_else(|| panic!("case {case}: {injection:?} is not met"));
        // A period with the outlet open may be among the steps.
        assert!(since_powered < 20, "case {case}: nothing to vent, {set_point:?}");
        let (mut until_vented, mut running_ms) = (1, 0);
        for ms in 2..150 + START_MS {
            let exchange = rig.exchange();
            if powered(&exchange) {
                until_vented = ms;
            }
            // Runs until the board listens again.
            running_ms += u32::from(exchange.restarts > restarts);
            if running_ms > START_MS {
                break;
            }
        }
        assert!(
            f64::from(until_vented) <= SAFE_MS,
            "case {case}: {until_vented} ms, {injection:?}"
        );
        worst_ms = worst_ms.max(until_vented);
        match rig.board.last_reset().unwrap() {
            LastReset::Watchdog { phase } => phases[phase as usize] += 1,
            other => panic!("case {case}: {other:?}"),
        }
        assert_eq!(rig.exchange().restarts, restarts + 1, "case {case}");
    }
    (worst_ms, phases)
}

fn assert_hangs_vent(cases: u32) {
    let [first, second] = side_by_side(cases, hangs);
    let worst_ms = first.0.max(second.0);
    let phases: [u32; 5] = std::array::from_fn(|i| first.1[i] + second.1[i]);
    println!("{cases} hangs: vented within {worst_ms} ms; phases {phases:?}");
    assert!((40..=100).contains(&worst_ms), "{worst_ms} ms");
    assert!(phases[Phase::Stepping as usize] > 0 && phases[Phase::Waiting as usize] > 0);
}

/// Presses emergency stops, ten for every PWM period; returns the worst time to vent \[ms\].
fn stops(cases: Range<u32>) -> f64 {
    let mut random = Random::new(u64::from(cases.start) + 77);
    let mut rig = rig(1);
    let mut worst_ms = 0.0_f64;
    for case in cases {
        // Takes every period once, in an order of large strides.
        let period = 1 + case / 10 * 37 % LONGEST_PERIOD;
        if case % 10 == 0 {
            rig.replace_muscle(&scenario(period));
            rig.start(SetPoint::Vent);
            rig.pass(STARTUP_CHECK_STEPS);
        }
        let inlet = 0.02 + 0.98 * random.share();
        rig.board.send(HostCommand::Set(SetPoint::Duty { inlet, outlet: 0.0 }));
        // The set point acts from the next period on, in all of which its outlet's coil is powered.
        let mut last = rig.exchange();
        for _ in 0..period + 5 + random.below(period) {
            last = rig.exchange();
        }
        assert!(last.outlet_coil > 0.99, "case {case}: nothing to vent");
        let pressed = |sample| Sample { emergency_stop: true, ..sample };
        let before = random.below(MS - 1) + 1;
        rig.run(before, |sample| sample);
        let (mut elapsed, mut until_vented) = (0, 0);
        let mut note = |exchange: Exchange, nanoseconds: u32| {
            elapsed += nanoseconds;
            if powered(&exchange) {
                until_vented = elapsed;
            }
        };
        // Small steps at first, which set the resolution of the time.
        let mut rest = 3 * MS - before;
        while rest > 0 {
            let slice = rest.min(MS / 20);
            note(rig.run(slice, pressed), slice);
            rest -= slice;
        }
        for _ in 0..period + 20 {
            note(rig.exchange_with(pressed), MS);
        }
        let until_vented = f64::from(until_vented) / f64::from(MS);
        assert!(until_vented <= SAFE_MS, "case {case}, period {period}: {until_vented} ms");
        worst_ms = worst_ms.max(until_vented);
        rig.exchange();
        rig.board.send(HostCommand::ClearFaults);
        rig.board.send(HostCommand::Arm { most_pa: None });
        rig.exchange();
        rig.exchange();
    }
    worst_ms
}

fn assert_stops_vent(cases: u32) {
    let [first, second] = side_by_side(cases, stops);
    let worst_ms = first.max(second);
    println!("{cases} emergency stops: vented within {worst_ms} ms");
    assert!((0.5..=3.0).contains(&worst_ms), "{worst_ms} ms");
}

#[derive(Debug, Clone, Copy)]
#[allow(clippy::large_enum_variant)] // Only a handful exist.
enum Flood {
    /// One request repeatedly.
    Of(HostCommand),
    /// All requests, with set points of every kind, in any order.
    Mixed,
    /// The same, with garbage and damaged frames between them.
    Garbled,
}

/// Every request that a host can make; set points open the inlet by [`FLOOD_INLET`] at most.
fn requests(rig: &Rig) -> [HostCommand; 19] {
    let fill = SetPoint::Duty { inlet: FLOOD_INLET, outlet: 0.0 };
    [
        HostCommand::Version,
        HostCommand::ReadConfig,
        HostCommand::Configure(*rig.muscle.config()),
        HostCommand::Start(fill),
        HostCommand::Set(fill),
        HostCommand::Stop,
        HostCommand::ClearFaults,
        HostCommand::TelemetryDivider(1),
        HostCommand::Timing,
        HostCommand::LastReset,
        HostCommand::FirstFailure,
        HostCommand::Alive,
        HostCommand::Step(Sample::default()),
        HostCommand::Arm { most_pa: None },
        HostCommand::Status,
        HostCommand::Name(Name::new("flood")),
        HostCommand::Save,
        HostCommand::Forget,
        HostCommand::History(0),
    ]
}

impl Flood {
    /// Keeps the link to the board full.
    fn pour(self, rig: &mut Rig, random: &mut Random) {
        while rig.board.waiting() < 200 {
            let all = requests(rig);
            // Every second one is a set point.
            let set = HostCommand::Set(SetPoint::Vent);
            let any = *all.get(random.below(38) as usize).unwrap_or(&set);
            match self {
                Self::Of(command) => rig.board.send(command),
                Self::Mixed | Self::Garbled => rig.board.send(match (any, random.below(16)) {
                    // Refused and accepted ones.
                    (HostCommand::Set(_), 0..4) => HostCommand::Set(SetPoint::Duty {
                        // A share may be 0, and 1 is allowed.
                        inlet: 1.001 + random.share(),
                        outlet: 0.0,
                    }),
                    (HostCommand::Set(_), 4..8) => {
                        HostCommand::Set(SetPoint::Contraction { contraction: f32::NAN })
                    }
                    (HostCommand::Set(_), _) => {
                        let inlet = FLOOD_INLET * (0.5 + 0.5 * random.share());
                        HostCommand::Set(SetPoint::Duty { inlet, outlet: 0.0 })
                    }
                    // These requests would keep the muscle vented, so they are rare.
                    (
                        HostCommand::Configure(_)
                        | HostCommand::Start(_)
                        | HostCommand::Stop
                        | HostCommand::Arm { .. }
                        | HostCommand::ClearFaults,
                        1..,
                    ) => HostCommand::Alive,
                    (other, _) => other,
                }),
            }
            if matches!(self, Self::Garbled) {
                let garbage: Vec<u8> =
                    (0..random.below(20)).map(|_| random.below(256) as u8).collect();
                rig.board.write(&garbage);
                // A command to open the inlet fully, in a frame with one wrong bit.
                let command = HostCommand::Set(SetPoint::Duty { inlet: 1.0, outlet: 0.0 });
                let mut frame = encode(&Request { sequence: 0, command }).unwrap();
                frame[1 + random.below(8) as usize] ^= 1 << random.below(8);
                rig.board.write(&[0]);
                rig.board.write(&frame);
            }
        }
    }
}

/// A flood of `milliseconds`, before an emergency stop and before a stop, which it must not delay.
fn flood(rig: &mut Rig, flood: Flood, milliseconds: u32, random: &mut Random) {
    let period = usize::from(rig.muscle.config().pwm_period_steps);
    rig.board.discard();
    rig.board.write(&[0]);
    rig.exchange();
    rig.board.send(HostCommand::ClearFaults);
    rig.exchange();
    rig.start(SetPoint::Duty { inlet: FLOOD_INLET, outlet: 0.0 });
    rig.pass(STARTUP_CHECK_STEPS + period as u32 + 5);
    let mut inlet = Vec::new();
    let mut poured = |rig: &mut Rig, emergency_stop: bool| {
        flood.pour(rig, random);
        let exchange = rig.exchange_with(|sample| Sample { emergency_stop, ..sample });
        assert_eq!(exchange.restarts, 0, "{flood:?}: restarted");
        inlet.push(exchange.inlet_coil);
        exchange
    };
    for _ in 0..milliseconds {
        poured(rig, false);
    }
    // The emergency stop stays open: clearing faults does not help.
    let exchanges: Vec<Exchange> = (0..120 + period).map(|_| poured(rig, true)).collect();
    let stopped = exchanges.iter().rposition(powered).map_or(0, |last| last + 1);
    assert!(stopped <= 3, "{flood:?}: {stopped} ms to the emergency stop");
    for _ in 0..milliseconds {
        poured(rig, false);
    }
    let limit = f64::from(FLOOD_INLET) + 0.01;
    let most = inlet.windows(period).map(|window| window.iter().sum::<f64>() / period as f64);
    let most = most.fold(0.0, f64::max);
    let commands_vent = matches!(
        flood,
        Flood::Of(
            HostCommand::Configure(_)
                | HostCommand::Start(_)
                | HostCommand::Stop
                | HostCommand::Arm { .. }
                | HostCommand::ClearFaults
        )
    );
    let least = if commands_vent { 0.0 } else { 0.1 };
    assert!(
        (least..=limit).contains(&most),
        "{flood:?}: the inlet was powered for {most} of a period"
    );

    assert_stops(rig, flood, period);
    rig.board.discard();
    rig.board.write(&[0]);
    rig.board.take_telemetry();
    // Soon the host may ask a few things at once again: after the accepted saves, and later after a long flood.
    let saves = matches!(flood, Flood::Of(HostCommand::Save | HostCommand::Forget) | Flood::Mixed);
    rig.pass(if saves { 400 } else { (3 * milliseconds / 10).max(80) });
    let faults = rig.board.take_telemetry().last().map(|telemetry| telemetry.faults);
    assert!(faults.unwrap().intersects(Faults::LINK_FLOODED), "{flood:?}: {faults:?}");
}

/// Sends the host's own stop, amid its earlier requests.
fn assert_stops(rig: &mut Rig, flood: Flood, period: usize) {
    rig.board.send(HostCommand::Stop);
    let stopping = rig.board.waiting().div_ceil(92);
    let after: Vec<Exchange> = (0..100 + period)
        .map(|_| {
            while rig.board.waiting() < 200 {
                rig.board.send(HostCommand::Timing);
            }
            rig.exchange()
        })
        .collect();
    let stopped = after.iter().rposition(powered).map_or(0, |last| last + 1);
    assert!(stopped <= stopping + 3, "{flood:?}: {stopped} ms to stop");
}

/// Floods at one PWM period; returns their effect on control and watchdog.
fn assert_floods_change_nothing(period: u32, milliseconds: u32, each: bool) {
    let mut rig = rig(period);
    let mut random = Random::new(period.into());
    let floods = requests(&rig).map(Flood::Of).into_iter().filter(|_| each);
    let mut dropped_requests = 0;
    for kind in floods.chain([Flood::Mixed, Flood::Garbled]) {
        flood(&mut rig, kind, milliseconds, &mut random);
        let timing = rig.board.timing().unwrap_or_else(|error| panic!("{kind:?}: {error}"));
        let name: String = format!("{kind:?}").chars().take_while(|c| !" {".contains(*c)).collect();
        println!("{period} steps, {name}: {timing:?}");
        assert_eq!(timing.missed_steps, 0, "{kind:?}");
        assert!(timing.jitter_worst_us <= JITTER_US, "{kind:?}: {timing:?}");
        assert!(timing.dropped_requests > dropped_requests + 20, "{kind:?}: {timing:?}");
        dropped_requests = timing.dropped_requests;
        let unused = rig.exchange().stack_unused;
        println!("{unused} bytes of the stack are not used");
        assert!(STACK_UNUSED.contains(&unused), "{kind:?}: {unused} bytes");
    }
}

/// Contraction control with a muscle that has all effects, and a moving set point.
fn assert_no_step_is_missed(seconds: u32, mean_ns: u32) {
    let mut rig = Rig::new("[plant]\nmodel = \"full\"\n");
    let divider = 10;
    rig.start(SetPoint::Contraction { contraction: 0.05 });
    rig.board.send(HostCommand::TelemetryDivider(divider));
    let (mut frames, mut moved) = (0, 0);
    let mut worst = Faults::NONE;
    for ms in 0..seconds * 1000 {
        if ms % 10 == 0 {
            let phase = f64::from(ms) * 1.0e-3 * std::f64::consts::TAU * 0.5;
            let contraction = (0.14 + 0.08 * phase.sin()) as f32;
            rig.board.send(HostCommand::Set(SetPoint::Contraction { contraction }));
        }
        assert_eq!(rig.exchange().restarts, 0, "restarted at {ms} ms");
        for telemetry in rig.board.take_telemetry() {
            frames += u32::from(telemetry.mode != Mode::StartupCheck);
            moved += u32::from(telemetry.command != Command::CLOSED);
            worst = worst.with(telemetry.faults);
        }
    }
    let timing = rig.board.timing().unwrap();
    println!("{seconds} s of contraction control: {timing:?}, {moved} of {frames} frames move");
    assert_eq!((timing.missed_steps, timing.dropped_telemetry, timing.malformed_frames), (0, 0, 0));
    assert_eq!((worst, timing.dropped_requests), (Faults::NONE, 0));
    assert!(timing.jitter_worst_us <= QUIET_JITTER_US, "{timing:?}");
    assert!((85_000..=mean_ns).contains(&timing.step_mean_ns), "{timing:?}");
    assert!((170..=STEP_WORST_US).contains(&timing.step_worst_us), "{timing:?}");
    let due = seconds * 1000 / u32::from(divider);
    assert!((due - 10..=due + 60).contains(&frames), "{frames} frames of {due}");
    assert!(moved > frames / 10, "{moved} of {frames} frames move anything");
}

#[test]
fn hangs_anywhere_vent() {
    assert_hangs_vent(24);
}

#[test]
fn emergency_stops_at_any_instant_vent() {
    assert_stops_vent(40);
}

#[test]
fn floods_change_nothing() {
    assert_floods_change_nothing(10, 100, true);
    assert_floods_change_nothing(1, 100, false);
    assert_floods_change_nothing(LONGEST_PERIOD, 210, false);
}

#[test]
fn contraction_control_is_on_time() {
    assert_no_step_is_missed(5, STEP_MEAN_NS);
}

#[test]
#[ignore = "minutes, even in release: cargo test --release -p system-tests emulated_endurance -- --ignored --nocapture"]
fn a_thousand_hangs_vent() {
    assert_hangs_vent(1000);
}

#[test]
#[ignore = "minutes, even in release: cargo test --release -p system-tests emulated_endurance -- --ignored --nocapture"]
fn a_thousand_emergency_stops_vent() {
    assert_stops_vent(1020);
}

#[test]
#[ignore = "minutes, even in release: cargo test --release -p system-tests emulated_endurance -- --ignored --nocapture"]
fn long_floods_change_nothing() {
    for period in [1, 10, LONGEST_PERIOD] {
        assert_floods_change_nothing(period, 1000, true);
    }
}

#[test]
#[ignore = "minutes, even in release: cargo test --release -p system-tests emulated_endurance -- --ignored --nocapture"]
fn ten_minutes_of_contraction_control_miss_no_step() {
    assert_no_step_is_missed(600, LONG_STEP_MEAN_NS);
}
