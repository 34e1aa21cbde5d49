/// The operator and a board at a pseudo-terminal that answers every request.
#[cfg(unix)]
mod at_a_terminal {
    use super::super::*;
    use crate::target::Opened;
    use crate::word::Order;
    use model_core::{Config, SetPoint};
    use serialport::{SerialPort, TTYPort};
    use std::io::{ErrorKind, Read, Write};
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
    use std::sync::{Mutex, OnceLock};
    use thermyo_boards::live::LiveBoard;
    use thermyo_protocol::{
        Answer, Chip, Decoder, HostCommand, Image, Message, PROTOCOL, Reply, Request, Version,
        checksum, encode,
    };

    /// A limit against hanging, not a target.
    const HANGS: Duration = Duration::from_secs(60);

    fn until(what: &str, holds: impl Fn() -> bool) {
        let began = Instant::now();
        while !holds() {
            assert!(began.elapsed() < HANGS, "{what}");
            thread::sleep(Duration::from_millis(5));
        }
    }

    /// An operator of a board that answers as long as `hears` returns true for every request.
    fn operated(
        out: &Path,
        mut hears: impl FnMut(HostCommand) -> bool + Send + 'static,
    ) -> Operator<LiveBoard> {
        let (mut board, port) = TTYPort::pair().unwrap();
        board.set_timeout(Duration::from_millis(5)).unwrap();
        let target = Target::Port(port.name().unwrap());
        thread::spawn(move || {
            let (mut requests, mut bytes) = (Decoder::new(), [0; 64]);
            loop {
                let count = match board.read(&mut bytes) {
                    Ok(count) => count,
                    Err(error) if error.kind() == ErrorKind::TimedOut => continue,
                    Err(_) => return,
                };
                for byte in &bytes[..count] {
                    let Some(Request { sequence, command }) = requests.push(*byte) else {
                        continue;
                    };
                    if !hears(command) {
                        return;
                    }
                    let answer = answer(command);
                    let frame = encode(&Message::Reply(Reply { sequence, answer })).unwrap();
                    board.write_all(&frame).unwrap();
                }
            }
        });
        let Opened::Muscle(opened) = target.open().unwrap() else { panic!("it drives a joint") };
        // Dropped here, since it has kept the terminal open for the board.
        drop(port);
        Operator::new(target, *opened, out, Logs::default()).unwrap()
    }

    fn answer(command: HostCommand) -> Answer {
        let config = Config::default();
        match command {
            HostCommand::Version => Answer::Version(Version {
                protocol: PROTOCOL,
                firmware: [0, 1, 0],
                chip: Chip::Rp2040,
                image: Image::Muscle,
            }),
            HostCommand::ReadConfig => Answer::Config(config),
            HostCommand::Status => {
                Answer::Status(Status { config_checksum: checksum(&config), ..Status::AT_START })
            }
            HostCommand::Timing => Answer::Timing(Timing::default()),
            _ => Answer::Done { step: 0 },
        }
    }

    /// A restart, during which a board is silent, used to be reported as one that does not answer.
    #[test]
    fn a_board_that_starts_is_silent_and_not_reported() {
        let out = tempfile::tempdir().unwrap();
        let mut operator = operated(out.path(), |_| true);
        let mut silent_for = |silent_s| {
            operator.heard = Instant::now() - Duration::from_secs_f64(silent_s);
            operator.listen();
            let said = "the board does not answer";
            (operator.link, operator.shared.events().iter().any(|event| event.text == said))
        };
        assert_eq!(silent_for(0.6), (Link::Silent, false));
        assert_eq!(silent_for(3.0), (Link::Silent, true));
    }

    #[test]
    fn no_order_is_carried_out_between_a_vent_and_its_arrival() {
        let heard: Arc<Mutex<Vec<HostCommand>>> = Arc::default();
        let shared: Arc<OnceLock<Arc<Shared>>> = Arc::default();
        let out = tempfile::tempdir().unwrap();
        let set = |pressure_pa| Order::Set(SetPoint::Pressure { pressure_pa });
        let operator = operated(out.path(), {
            let (heard, shared) = (Arc::clone(&heard), Arc::clone(&shared));
            move |command| {
                let shared = shared.get();
                let driven = matches!(command, HostCommand::Set(_));
                if let Some(shared) = shared.filter(|_| driven) {
                    let orders = |from: u16| {
                        for i in from..from + 250 {
                            let pressure_pa = 1.3e5 + f32::from(i);
                            shared.orders.put(set(pressure_pa));
                            shared.orders.put(Order::Arm { most_pa: Some(pressure_pa) });
                            shared.orders.put(Order::Clear);
                            shared.orders.put(Order::Save);
                        }
                    };
                    orders(0);
                    shared.vent("a test");
                    orders(250);
                }
                heard.lock().unwrap().push(command);
                true
            }
        });
        let shared = shared.get_or_init(|| operator.shared());
        shared.orders.put(set(1.2e5));
        let heard = || heard.lock().unwrap().clone();
        let stopped = || heard().contains(&HostCommand::Stop);
        let operating = thread::spawn(move || operator.run(&|| false));
        until("it vents", stopped);
        shared.end();
        operating.join().unwrap();
        let heard = heard();
        let driven = heard.iter().position(|command| matches!(command, HostCommand::Set(_)));
        let after = heard[driven.unwrap() + 1..].iter().filter(|c| **c != HostCommand::Alive);
        let after: Vec<_> = after.collect();
        assert_eq!(after.first(), Some(&&HostCommand::Stop), "{after:?}");
        let moves = |c: &&&HostCommand| matches!(c, HostCommand::Set(_) | HostCommand::Arm { .. });
        assert_eq!(after.iter().find(moves), None, "what came before the vent is dropped");
    }

    /// Limit of the firmware: 16 requests at once, one more every 4 ms.
    #[test]
    fn a_flood_of_orders_and_vents_stays_within_what_a_board_carries_out() {
        const REQUESTS: f64 = 16.0;
        const EVERY_S: f64 = 0.004;
        let [dropped, vents] = [(); 2].map(|()| Arc::new(AtomicU32::new(0)));
        let shared: Arc<OnceLock<Arc<Shared>>> = Arc::default();
        let out = tempfile::tempdir().unwrap();
        let operator = operated(out.path(), {
            let (dropped, vents) = (Arc::clone(&dropped), Arc::clone(&vents));
            let shared = Arc::clone(&shared);
            let (mut left, mut since) = (REQUESTS, Instant::now());
            move |command| {
                left = REQUESTS.min(left + since.elapsed().as_secs_f64() / EVERY_S);
                since = Instant::now();
                left -= if command == HostCommand::Save { 4.0 } else { 1.0 };
                dropped.fetch_add(u32::from(left < 0.0), Ordering::Relaxed);
                vents.fetch_add(u32::from(command == HostCommand::Stop), Ordering::Relaxed);
                if let Some(shared) = shared.get() {
                    shared.orders.put(Order::Clear);
                    shared.orders.put(Order::Save);
                    shared.vent("a test");
                }
                true
            }
        });
        let shared = shared.get_or_init(|| operator.shared());
        shared.vent("a test");
        let operating = thread::spawn(move || operator.run(&|| false));
        until("it vents", || vents.load(Ordering::Relaxed) > 40);
        shared.end();
        operating.join().unwrap();
        assert_eq!(dropped.load(Ordering::Relaxed), 0);
    }

    #[test]
    fn neither_a_vent_nor_the_end_waits_for_a_port_that_is_opened() {
        static OPENING: AtomicBool = AtomicBool::new(false);
        let out = tempfile::tempdir().unwrap();
        let gone = Arc::new(AtomicBool::new(false));
        let mut operator = operated(out.path(), {
            let gone = Arc::clone(&gone);
            move |_| !gone.load(Ordering::Relaxed)
        });
        operator.reopen = |_| {
            OPENING.store(true, Ordering::Relaxed);
            loop {
                thread::park();
            }
        };
        let shared = operator.shared();
        gone.store(true, Ordering::Relaxed);
        let operating = thread::spawn(move || operator.run(&|| false));
        until("the port is opened again", || OPENING.load(Ordering::Relaxed));
        shared.vent("a test");
        let vented = || shared.events().iter().any(|event| event.text.contains("no link"));
        until("the vent is seen to", vented);
        shared.end();
        until("it ends", || operating.is_finished());
    }

    #[test]
    fn the_other_image_at_a_lost_port_is_reported_once() {
        static TRIED: AtomicU32 = AtomicU32::new(0);
        let gone = Arc::new(AtomicBool::new(false));
        let out = tempfile::tempdir().unwrap();
        let mut operator = operated(out.path(), {
            let gone = Arc::clone(&gone);
            move |_| !gone.load(Ordering::Relaxed)
        });
        operator.reopen = |_| {
            TRIED.fetch_add(1, Ordering::Relaxed);
            Err(BoardError::Refused(Refusal::OtherImage { joint: true }))
        };
        let shared = operator.shared();
        gone.store(true, Ordering::Relaxed);
        let operating = thread::spawn(move || operator.run(&|| false));
        until("the port is opened three times", || TRIED.load(Ordering::Relaxed) == 3);
        let image = Refusal::OtherImage { joint: true }.to_string();
        let events = shared.events();
        let reported = events.iter().filter(|event| event.text.contains(&image)).count();
        assert_eq!(reported, 1, "{events:?}");
        shared.end();
        until("it ends", || operating.is_finished());
    }
}
