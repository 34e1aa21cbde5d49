//! Two hosts at one emulated board, over UART and USB: only the host whose order holds keeps it alive, and a stop
//! overtakes earlier orders.

use model_core::control::SetPointError;
use model_core::{Config, SetPoint};
use system_tests::rig::{Rig, STARTUP_CHECK_STEPS, powered, silent};
use thermyo_boards::emulated::Port;
use thermyo_protocol::{Answer, HostCommand, Name, Refusal};

/// One microsecond \[ns\].
const US: u32 = 1_000;
const LINK_TIMEOUT_MS: u32 = 100;
const FILL: SetPoint = SetPoint::Duty { inlet: 0.3, outlet: 0.0 };

fn scenario(pwm_hz: f64) -> String {
    format!(
        "[plant]\nmodel = \"lumped\"\n[supply]\npressure_pa = 600000.0\n[link]\ntimeout_s = 0.1\n\
         [valve]\npwm_hz = {pwm_hz}\n"
    )
}

/// The other port.
fn other(port: Port) -> Port {
    match port {
        Port::Uart => Port::Usb,
        Port::Usb => Port::Uart,
    }
}

/// Lets a host at this port fill the muscle, and report every 20 ms.
fn fill(rig: &mut Rig, port: Port) {
    rig.board.use_port(port);
    rig.board.ask(HostCommand::ClearFaults).unwrap();
    rig.start(FILL);
    let mut closed = false;
    for ms in 0..STARTUP_CHECK_STEPS + 60 {
        if ms % 20 == 0 {
            rig.board.send(HostCommand::Alive);
        }
        closed = rig.exchange_with(silent).outlet_coil > 0.9;
    }
    assert!(closed, "{port:?}: it fills");
}

/// Each refused request, sent repeatedly over the other port.
#[test]
fn a_refused_request_of_another_host_keeps_no_set_point_alive() {
    let mut rig = Rig::plugged(&scenario(100.0));
    let nan = SetPoint::Pressure { pressure_pa: f32::NAN };
    let refused = [
        HostCommand::Set(nan),
        HostCommand::Start(nan),
        HostCommand::Arm { most_pa: Some(f32::NAN) },
        HostCommand::Configure(Config { step_s: f32::NAN, ..*rig.muscle.config() }),
    ];
    for port in [Port::Uart, Port::Usb] {
        for command in refused {
            fill(&mut rig, port);
            rig.board.use_port(other(port));
            let mut last_powered_ms = 0;
            let mut answers = 0;
            let mut asked = None;
            for ms in 1..=LINK_TIMEOUT_MS + 100 {
                if ms % 20 == 1 {
                    asked = Some(rig.board.request(command));
                }
                if powered(&rig.exchange_with(silent)) {
                    last_powered_ms = ms;
                }
                match asked.and_then(|sequence| rig.board.take_answer(sequence)) {
                    None => (),
                    Some(Answer::Refused(_)) => answers += 1,
                    Some(answer) => panic!("{command:?}: {answer:?}"),
                }
            }
            assert_eq!(answers, 10, "{command:?}");
            let expected = LINK_TIMEOUT_MS - 22..=LINK_TIMEOUT_MS + 20;
            assert!(
                expected.contains(&last_powered_ms),
                "{port:?}, {command:?}: held for {last_powered_ms} ms after its host's last word"
            );
        }
    }
}

/// Orders that the other host sends together, so that they are on their way while the stop is carried out.
fn sent_before(rig: &Rig) -> [Vec<HostCommand>; 4] {
    let arm = HostCommand::Arm { most_pa: None };
    let configure = HostCommand::Configure(*rig.muscle.config());
    [
        vec![HostCommand::Start(FILL)],
        vec![HostCommand::Set(FILL)],
        vec![arm, HostCommand::Start(FILL), HostCommand::Set(FILL)],
        vec![configure, arm, HostCommand::Start(FILL)],
    ]
}

/// Sends a stop these numbers of microseconds after the other host's orders; afterwards each of the hosts drives as
/// before.
fn assert_a_stop_overtakes(delays_us: impl Iterator<Item = u32> + Clone) {
    let mut rig = Rig::plugged(&scenario(100.0));
    let mut refused = 0;
    for port in [Port::Uart, Port::Usb] {
        fill(&mut rig, port);
        for orders in sent_before(&rig) {
            for delay_us in delays_us.clone() {
                let case = format!("{orders:?} over {port:?}, stopped {delay_us} us later");
                rig.board.use_port(port);
                rig.board.ask(HostCommand::Arm { most_pa: None }).unwrap();
                // Start within a step.
                rig.run(1 + delay_us * 377 % 1000 * US, silent);
                let sent: Vec<u8> =
                    orders.iter().map(|&command| rig.board.request(command)).collect();
                if delay_us > 0 {
                    rig.run(delay_us * US, silent);
                }
                rig.board.use_port(other(port));
                let stop = rig.board.request(HostCommand::Stop);
                let mut stopped_ms = None;
                let mut last_powered_ms = 0;
                for ms in 1..=STARTUP_CHECK_STEPS + 40 {
                    if powered(&rig.exchange_with(silent)) {
                        last_powered_ms = ms;
                    }
                    if stopped_ms.is_none() && rig.board.take_answer(stop).is_some() {
                        stopped_ms = Some(ms);
                    }
                }
                let stopped_ms = stopped_ms.unwrap_or_else(|| panic!("{case}: no answer"));
                assert!(
                    last_powered_ms <= stopped_ms + 2,
                    "{case}: answered after {stopped_ms} ms, powered after {last_powered_ms} ms"
                );
                rig.board.use_port(port);
                for sequence in sent {
                    match rig.board.take_answer(sequence) {
                        Some(Answer::Refused(_)) => refused += 1,
                        Some(Answer::Done { .. }) => (),
                        answer => panic!("{case}: {answer:?}"),
                    }
                }
            }
        }
        // Another order of either line drives.
        for port in [port, other(port)] {
            fill(&mut rig, port);
        }
    }
    println!("{refused} orders refused");
    assert!(refused > 0);
}

#[test]
fn a_stop_overtakes_earlier_orders_of_another_host() {
    assert_a_stop_overtakes((0..=600).step_by(60));
}

#[test]
#[ignore = "a minute: cargo test --release -p system-tests emulated_hosts -- --ignored --nocapture"]
fn a_stop_overtakes_at_every_moment() {
    assert_a_stop_overtakes((0..=1500).step_by(5));
}

/// A set point to vent is never refused, whatever was sent before it or after another host's stop.
#[test]
fn a_set_point_to_vent_is_never_overtaken() {
    let mut rig = Rig::plugged(&scenario(100.0));
    fill(&mut rig, Port::Usb);
    rig.board.send(HostCommand::Stop);
    rig.board.send(HostCommand::Set(FILL));
    rig.run(300 * US, silent);
    rig.board.use_port(Port::Uart);
    let refused = rig.board.request(HostCommand::Set(FILL));
    let vent = rig.board.request(HostCommand::Set(SetPoint::Vent));
    for _ in 0..10 {
        rig.exchange_with(silent);
    }
    let answers = [refused, vent].map(|sequence| rig.board.take_answer(sequence));
    assert!(
        matches!(answers, [Some(Answer::Refused(Refusal::Overtaken)), Some(Answer::Done { .. })]),
        "{answers:?}"
    );
    assert!((0..50).all(|_| !powered(&rig.exchange_with(silent))));
}

/// The stop is amid the orders of its own host.
#[test]
fn orders_after_a_stop_on_its_line_hold() {
    let mut rig = Rig::plugged(&scenario(100.0));
    for port in [Port::Uart, Port::Usb] {
        fill(&mut rig, port);
        for waits in [true, false] {
            rig.board.send(HostCommand::Stop);
            if waits {
                rig.exchange_with(silent);
            }
            rig.board.ask(HostCommand::Set(FILL)).unwrap();
            for _ in 0..20 {
                rig.exchange_with(silent);
            }
            let outlet_coil = rig.exchange_with(silent).outlet_coil;
            assert!(outlet_coil > 0.9, "{port:?}, waits: {waits}");
        }
    }
}

/// One host starts a pressure that the other host's configuration, which is on its way, does not allow.
#[test]
fn a_start_runs_no_configuration_of_another_host() {
    let mut rig = Rig::plugged(&scenario(100.0));
    let low = Config { pressure_limit_pa: 250_000.0, ..*rig.muscle.config() };
    let start = SetPoint::Pressure { pressure_pa: 400_000.0 };
    let mut overtaken = 0;
    for lead_us in (0..=1_200).step_by(50) {
        fill(&mut rig, Port::Uart);
        rig.board.use_port(Port::Usb);
        let configured = rig.board.request(HostCommand::Configure(low));
        rig.run(lead_us * US, silent);
        rig.board.use_port(Port::Uart);
        let started = rig.board.request(HostCommand::Start(start));
        for _ in 0..20 {
            rig.exchange_with(silent);
        }
        rig.board.use_port(Port::Usb);
        let answer = rig.board.take_answer(configured);
        assert!(matches!(answer, Some(Answer::Done { .. })), "{answer:?}");
        rig.board.use_port(Port::Uart);
        match rig.board.take_answer(started) {
            Some(Answer::Done { .. })
            | Some(Answer::Refused(Refusal::SetPoint(SetPointError::NotArmed))) => (),
            Some(Answer::Refused(Refusal::Overtaken)) => overtaken += 1,
            answer => panic!("{lead_us} us after the configuration: {answer:?}"),
        }
    }
    assert!(overtaken > 0);
}

/// A program at the USB port that reads nothing: its answers are lost, and no other host waits for it.
#[test]
fn a_host_that_does_not_read_keeps_no_other_from_stopping() {
    let mut rig = Rig::plugged(&scenario(100.0));
    fill(&mut rig, Port::Uart);
    rig.board.use_port(Port::Usb);
    rig.board.ask(HostCommand::TelemetryDivider(1)).unwrap();
    rig.board.stop_reading(true);
    for ms in 0..60 {
        if ms % 20 == 0 {
            rig.board.use_port(Port::Usb);
            rig.board.send(HostCommand::History(0));
        }
        rig.board.use_port(Port::Uart);
        rig.board.send(HostCommand::Alive);
        assert!(rig.exchange_with(silent).outlet_coil > 0.9, "{ms} ms: it fills");
    }
    assert!(rig.board.ask(HostCommand::Timing).is_ok());
    rig.board.send(HostCommand::History(0));
    rig.board.send(HostCommand::Stop);
    let filling = (0..50).filter(|_| powered(&rig.exchange_with(silent))).count();
    assert!(filling <= 3, "{filling} ms");
    for _ in 0..200 {
        rig.exchange_with(silent);
    }
    assert!(matches!(rig.board.ask(HostCommand::History(0)), Ok(Answer::Event(_))));
}

/// Commands of a script follow each other faster than the board accepts requests.
#[test]
fn a_host_that_waits_for_each_answer_loses_no_request() {
    let mut rig = Rig::plugged(&scenario(100.0));
    let config = *rig.muscle.config();
    rig.exchange_with(silent);
    for port in [Port::Uart, Port::Usb] {
        rig.board.use_port(port);
        for turn in 0..20 {
            for command in [
                HostCommand::Version,
                HostCommand::TelemetryDivider(10),
                HostCommand::Configure(config),
                HostCommand::Name(Name::new("script")),
                HostCommand::Status,
                HostCommand::Stop,
            ] {
                let answer = rig.board.ask(command);
                assert!(answer.is_ok(), "{port:?}, turn {turn}, {command:?}: {answer:?}");
            }
        }
    }
    let timing = rig.board.timing().unwrap();
    assert_eq!((timing.dropped_requests, timing.missed_steps), (0, 0), "{timing:?}");

    // Telemetry of every step fills the UART, and a status comes twice a second.
    rig.board.use_port(Port::Uart);
    rig.board.ask(HostCommand::TelemetryDivider(1)).unwrap();
    for turn in 0..200 {
        let answer = rig.board.ask(HostCommand::Timing);
        assert!(answer.is_ok(), "turn {turn}: {answer:?}");
        rig.exchange_with(silent);
    }
}
