//! The emulated board keeps the inlet shut: after a fault was acknowledged, after the
//! board was armed again, and whatever two hosts, the stop button and the USB cable do in any
//! order.

use model_core::{Config, Sample, SetPoint};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use std::env;
use system_tests::rig::{Rig, STARTUP_CHECK_STEPS, powered, silent};
use thermyo_boards::emulated::{Exchange, Port};
use thermyo_protocol::{Answer, HostCommand};

/// One millisecond \[ns\].
const MS: u64 = 1_000_000;
const LINK_TIMEOUT: u64 = 100 * MS;
/// Time until the step after a venting event has driven the valves.
const TO_VENT: u64 = 2 * MS;
/// Time from the sending of a request until the valves react.
const ON_THE_WAY: u64 = 15 * MS;
/// Longer than any PWM period.
const QUIET: u64 = 150 * MS;
/// Time until a host is connected after a cable was plugged in.
const ENUMERATION: u64 = 80 * MS;
/// Number of successive interleavings on the same board, and the length of each \[ms\].
const TOGETHER: u64 = 10;
const LENGTH_MS: u64 = 300;

fn scenario(pwm_hz: f64) -> String {
    format!(
        "[plant]\nmodel = \"lumped\"\n[supply]\npressure_pa = 600000.0\n[link]\ntimeout_s = 0.1\n\
         [valve]\npwm_hz = {pwm_hz}\n"
    )
}

fn fill(inlet: f32) -> SetPoint {
    SetPoint::Duty { inlet, outlet: 0.0 }
}

/// A muscle at a board with the longest PWM period, whose inlet is fully open.
fn filling(in_period_ms: u32) -> Rig {
    let mut rig = Rig::new(&scenario(12.346));
    rig.start(fill(1.0));
    for _ in 0..STARTUP_CHECK_STEPS + in_period_ms {
        rig.exchange_with(silent);
    }
    assert!(rig.exchange_with(silent).inlet_coil > 0.99);
    rig
}

/// Time for which the inlet is powered in the next milliseconds \[ms\].
fn inlet_ms(rig: &mut Rig) -> f64 {
    (0..250).map(|_| rig.exchange_with(silent).inlet_coil).sum()
}

#[test]
fn an_acknowledged_fault_opens_nothing() {
    let mut rig = filling(3);
    rig.exchange_with(|sample| Sample { emergency_stop: true, ..silent(sample) });
    rig.exchange_with(silent);
    assert_eq!(rig.exchange_with(silent).inlet_coil, 0.0);
    rig.board.send(HostCommand::ClearFaults);
    let ms = inlet_ms(&mut rig);
    assert!(ms == 0.0, "the inlet is open for {ms} ms after its fault was cleared");
}

#[test]
fn arming_after_a_lost_link_opens_nothing() {
    let mut rig = filling(3);
    let open = (0..150).map(|_| rig.exchange_with(silent).inlet_coil);
    let open_ms = open.take_while(|&share| share > 0.0).count();
    assert!(open_ms < 149, "the link is lost");
    rig.board.send(HostCommand::Arm { most_pa: None });
    let ms = inlet_ms(&mut rig);
    assert!(ms == 0.0, "the inlet is open for {ms} ms after the board was armed");
}

/// An order that may be, or was, carried out.
#[derive(Debug, Clone, Copy)]
struct Sent {
    port: Port,
    sent: u64,
    answered: u64,
    /// Number of messages from which its orders no longer hold.
    dead: u64,
}

impl Sent {
    /// Whether it was certainly carried out before the other one, or not at all.
    fn precedes(&self, other: &Self) -> bool {
        self.answered < other.sent || self.port == other.port && self.sent < other.sent
    }
}

/// A request without an answer yet.
struct Asked {
    command: HostCommand,
    sequence: u8,
    sent: Sent,
}

/// Tracks actions of hosts, button and cable, and whether the inlet may then be open: from the sent
/// and answered messages alone.
#[derive(Default)]
struct Witness {
    asked: Vec<Asked>,
    /// Set points, arming, and acknowledgements that may hold.
    drives: Vec<Sent>,
    arms: Vec<Sent>,
    clears: Vec<Sent>,
    /// Time of each host's last message.
    last_sent: [u64; 2],
    /// Time of the last request of any host that may change anything.
    last_order: u64,
    /// Times of the button's first press and last release; and whether it is pressed.
    button: Option<(u64, u64)>,
    pressed: bool,
    last_powered: u64,
    log: Vec<String>,
}

fn kills(dead: u64, all: &mut [Sent], which: impl Fn(&Sent) -> bool) {
    for sent in all.iter_mut().filter(|sent| which(sent)) {
        sent.dead = sent.dead.min(dead);
    }
}

impl Witness {
    fn send(&mut self, rig: &mut Rig, port: Port, command: HostCommand, now: u64) {
        rig.board.use_port(port);
        let sequence = rig.board.request(command);
        self.last_sent[port as usize] = now;
        if command == HostCommand::Alive {
            return;
        }
        self.last_order = now;
        let sent = Sent { port, sent: now, answered: u64::MAX, dead: u64::MAX };
        match command {
            HostCommand::Set(SetPoint::Vent) | HostCommand::Start(SetPoint::Vent) => (),
            HostCommand::Set(_) | HostCommand::Start(_) => self.drives.push(sent),
            HostCommand::Arm { .. } => self.arms.push(sent),
            HostCommand::ClearFaults => self.clears.push(sent),
            _ => (),
        }
        let name: String = format!("{command:?}").chars().take(60).collect();
        self.log.push(format!("{:.2} ms {port:?} {name}", now as f64 / MS as f64));
        self.asked.push(Asked { command, sequence, sent });
    }

    fn take_answers(&mut self, rig: &mut Rig, now: u64) {
        for Asked { command, sequence, sent } in std::mem::take(&mut self.asked) {
            rig.board.use_port(sent.port);
            match rig.board.take_answer(sequence) {
                Some(answer) => {
                    let text: String = format!("{answer:?}").chars().take(60).collect();
                    self.log.push(format!(
                        "{:.2} ms {:?} answers {sequence}: {text}",
                        now as f64 / MS as f64,
                        sent.port
                    ));
                    self.answered(command, Sent { answered: now, ..sent }, answer);
                }
                // The cable was pulled, or the request was dropped.
                None if now > sent.sent + 256 * MS => (),
                None => self.asked.push(Asked { command, sequence, sent }),
            }
        }
    }

    fn answered(&mut self, command: HostCommand, by: Sent, answer: Answer) {
        let same = |sent: &Sent| sent.port == by.port && sent.sent == by.sent;
        let done = matches!(answer, Answer::Done { .. });
        let list = match command {
            HostCommand::Set(_) | HostCommand::Start(_) => &mut self.drives,
            HostCommand::Arm { .. } => &mut self.arms,
            _ => &mut self.clears,
        };
        // If two of a kind are sent together, a refused one may stand for the other.
        if done {
            list.iter_mut().filter(|sent| same(sent)).for_each(|sent| sent.answered = by.answered);
        } else if list.iter().filter(|sent| same(sent)).count() == 1 {
            list.retain(|sent| !same(sent));
        }
        if !done {
            return;
        }
        let dead = by.answered + TO_VENT;
        match command {
            HostCommand::Stop => kills(dead, &mut self.drives, |drive| drive.sent < by.sent),
            HostCommand::Set(_) => {
                kills(dead + QUIET, &mut self.drives, |drive| drive.precedes(&by));
            }
            HostCommand::Start(_) | HostCommand::Arm { .. } | HostCommand::ClearFaults => {
                kills(dead, &mut self.drives, |drive| drive.precedes(&by));
            }
            HostCommand::Configure(_) => {
                kills(dead, &mut self.drives, |drive| drive.precedes(&by));
                kills(dead, &mut self.arms, |arm| arm.precedes(&by));
            }
            _ => (),
        }
    }

    fn press(&mut self, pressed: bool, now: u64) {
        if pressed && !self.pressed {
            self.button = Some((now, now));
            kills(now + TO_VENT, &mut self.drives, |_| true);
            kills(now + TO_VENT, &mut self.arms, |_| true);
            self.log.push(format!("{:.2} ms pressed", now as f64 / MS as f64));
        } else if let Some((_, released)) = &mut self.button
            && (pressed || self.pressed)
        {
            *released = now;
        }
        self.pressed = pressed;
    }

    /// Lets time pass, from the beginning of an exchange.
    fn look(&mut self, begun: u64, now: u64, exchange: &Exchange) -> Result<(), String> {
        for index in 0..self.drives.len() {
            let Sent { port, answered, dead, .. } = self.drives[index];
            let silent_since = self.last_sent[port as usize];
            if dead > begun && begun > silent_since + LINK_TIMEOUT + ON_THE_WAY {
                self.drives[index].dead = begun;
                let driven = answered < u64::MAX && self.last_powered + QUIET / 3 > begun;
                let pressed = self.button.is_some_and(|(_, released)| released + QUIET > begun);
                if driven && !pressed && self.last_order + QUIET < begun {
                    kills(begun, &mut self.arms, |_| true);
                    self.log.push(format!("{:.2} ms link lost", begun as f64 / MS as f64));
                }
            }
        }
        for list in [&mut self.drives, &mut self.arms, &mut self.clears] {
            list.retain(|sent| sent.dead > begun && sent.sent + 20_000 * MS > now);
        }
        if powered(exchange) {
            self.last_powered = now;
        }
        if exchange.inlet_coil == 0.0 {
            return Ok(());
        }
        let cleared = |arm: &Sent| {
            self.button.is_none_or(|(pressed, released)| {
                begun < pressed + TO_VENT
                    || self
                        .clears
                        .iter()
                        .any(|clear| clear.answered > released && arm.answered >= clear.sent)
            })
        };
        let armed =
            |drive: &Sent| self.arms.iter().any(|arm| drive.answered >= arm.sent && cleared(arm));
        if self.drives.iter().any(armed) {
            return Ok(());
        }
        Err(format!(
            "the inlet is powered from {:.2} to {:.2} ms\n{:?}\n{:?}\n{:?}\n{}",
            begun as f64 / MS as f64,
            now as f64 / MS as f64,
            self.drives,
            self.arms,
            self.button,
            self.log[self.log.len().saturating_sub(30)..].join("\n")
        ))
    }
}

/// The same random numbers on every machine.
struct Random(Xoshiro256PlusPlus);

impl Random {
    fn below(&mut self, end: u64) -> u64 {
        self.0.next_u64() % end
    }

    fn once_in(&mut self, count: u64) -> bool {
        self.below(count) == 0
    }

    fn set_point(&mut self) -> SetPoint {
        let share = self.below(1000) as f32 / 1000.0;
        match self.below(4) {
            0 => SetPoint::Pressure { pressure_pa: 2.0e5 + 3.0e5 * share },
            1 => SetPoint::Contraction { contraction: 0.05 + 0.2 * share },
            _ => fill(0.2 + 0.8 * share),
        }
    }

    /// Requests that a host sends together.
    fn requests(&mut self, config: &Config) -> Vec<HostCommand> {
        let arm = HostCommand::Arm { most_pa: None };
        let set = HostCommand::Set(self.set_point());
        let start = HostCommand::Start(self.set_point());
        let nan = SetPoint::Pressure { pressure_pa: f32::NAN };
        let bad = Config { step_s: f32::NAN, ..*config };
        match self.below(20) {
            0..3 => vec![HostCommand::ClearFaults, arm, set],
            3 | 4 => vec![arm, set],
            5 | 6 => vec![set],
            7 => vec![start],
            8 => vec![HostCommand::Configure(*config), arm, start],
            9 => vec![HostCommand::Configure(*config)],
            10 => vec![HostCommand::ClearFaults],
            11 => vec![arm],
            12 => vec![HostCommand::Set(SetPoint::Vent)],
            13 => vec![HostCommand::Set(nan)],
            14 => vec![HostCommand::Arm { most_pa: Some(f32::NAN) }],
            15 => vec![HostCommand::Configure(bad)],
            16 => vec![HostCommand::Start(nan)],
            _ => vec![HostCommand::Stop],
        }
    }
}

impl Random {
    /// The two parts of a millisecond, with the port that is served in each.
    fn slices(&mut self) -> [(Port, u64); 2] {
        let first = 1 + self.below(MS - 1);
        if self.once_in(2) {
            return [(Port::Usb, first), (Port::Uart, MS - first)];
        }
        [(Port::Uart, first), (Port::Usb, MS - first)]
    }

    /// Sends a request or several, or none. Returns the time until which the port is left alone.
    fn ask(
        &mut self,
        rig: &mut Rig,
        witness: &mut Witness,
        port: Port,
        config: &Config,
        now: u64,
    ) -> u64 {
        if self.once_in(300) {
            return now + (60 + self.below(150)) * MS;
        }
        if self.once_in(25) {
            for command in self.requests(config) {
                witness.send(rig, port, command, now);
            }
        } else if self.once_in(15) {
            witness.send(rig, port, HostCommand::Alive, now);
        }
        0
    }
}

/// Runs these interleavings on one board; returns the time for which the inlet was powered \[ms\].
fn interleave(seed: u64) -> Result<f64, String> {
    let mut random = Random(Xoshiro256PlusPlus::seed_from_u64(seed));
    let pwm_hz = [100.0, 12.346, 500.0, 20.0][(seed % 4) as usize];
    let mut rig = Rig::new(&scenario(pwm_hz));
    rig.board.connect_usb().map_err(|error| error.to_string())?;
    let config = *rig.muscle.config();
    let mut witness = Witness::default();
    let mut now = 0;
    for port in [Port::Usb, Port::Uart] {
        witness.send(&mut rig, port, HostCommand::Configure(config), now);
    }
    let mut powered_ms = 0.0;
    let mut busy_until = [10 * MS; 2];
    let mut pressed_ms = 0;
    let mut unplugged_ms = 0;
    for _ in 0..TOGETHER * LENGTH_MS {
        if pressed_ms == 0 && random.once_in(150) {
            pressed_ms = 1 + random.below(4);
        }
        witness.press(pressed_ms > 0, now);
        pressed_ms = pressed_ms.saturating_sub(1);
        if unplugged_ms > 0 {
            unplugged_ms -= 1;
            if unplugged_ms == 0 {
                rig.board.plug(true);
                rig.board.open(true);
                busy_until[Port::Usb as usize] = now + ENUMERATION;
            }
        } else if random.once_in(400) {
            rig.board.plug(false);
            rig.board.use_port(Port::Usb);
            rig.board.discard();
            unplugged_ms = 3 + random.below(60);
            busy_until[Port::Usb as usize] = u64::MAX;
        }
        let ports = random.slices();
        let mut set_duty = Default::default();
        for (port, slice) in ports {
            rig.board.use_port(port);
            let index = port as usize;
            if now >= busy_until[index] && rig.board.waiting() == 0 {
                busy_until[index] = random.ask(&mut rig, &mut witness, port, &config, now);
            }
            let emergency_stop = witness.pressed;
            let exchange = rig.run(slice as u32, |sample| Sample { emergency_stop, ..sample });
            let begun = now;
            now += slice;
            witness.take_answers(&mut rig, now);
            witness.look(begun, now, &exchange)?;
            powered_ms += exchange.inlet_coil * slice as f64 / MS as f64;
            set_duty = exchange.set_duty();
            if exchange.restarts > 0 {
                return Err("it has restarted".to_owned());
            }
        }
        rig.muscle.advance(set_duty);
    }
    Ok(powered_ms)
}

/// Checks interleavings of many seeds; `THERMYO_SEED` gives the only seed.
fn assert_only_what_may_be_driven_is(interleavings: u64) {
    let only = env::var("THERMYO_SEED").ok().map(|text| text.parse().expect("a whole number"));
    let seeds = only.map_or(0..interleavings / TOGETHER, |seed: u64| seed..seed + 1);
    let mut powered_ms = 0.0;
    for seed in seeds.clone() {
        match interleave(seed) {
            Ok(ms) => powered_ms += ms,
            Err(why) => panic!("THERMYO_SEED={seed}: {why}"),
        }
    }
    let total_ms = (seeds.end - seeds.start) * TOGETHER * LENGTH_MS;
    println!("seeds {seeds:?}: the inlet was powered for {powered_ms:.0} of {total_ms} ms");
    let share = powered_ms / total_ms as f64;
    assert!(only.is_some() || (0.02..0.9).contains(&share), "{share}");
}

#[test]
fn a_hundred_interleavings_of_two_hosts_drive_only_allowed_orders() {
    assert_only_what_may_be_driven_is(100);
}

#[test]
#[ignore = "minutes: cargo test --release -p system-tests emulated_still -- --ignored --nocapture"]
fn a_thousand_interleavings_of_two_hosts_drive_only_allowed_orders() {
    assert_only_what_may_be_driven_is(1000);
}
