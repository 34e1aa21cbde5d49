//! The stored configuration on the emulated board: power fails in every operation of its flash.

use model_core::{AdcCode, Config, Faults, Sample, SetPoint};
use system_tests::rig::{Rig, STARTUP_CHECK_STEPS};
use thermyo_boards::emulated::{EmulatedBoard, Injection, START_MS};
use thermyo_boards::image::{Variant, firmware, prepare_emulator};
use thermyo_protocol::{
    Answer, ConfigSource, Event, HostCommand, Name, PROTOCOL, Refusal, Status, checksum,
};
use thermyo_simulation::board::BoardError;

/// Number of saves that are cut in each of their operations: some 13 fill a sector.
const ROUNDS: u32 = 15;
/// Fractions of an operation's time after which power fails.
const DONE: [f32; 4] = [0.0, 0.3, 0.7, 0.98];
/// Default time between two frames of telemetry \[ms\].
const TELEMETRY_MS: u32 = 10;
/// Time in which the board accepts two more large requests \[ms\].
const REQUESTS_MS: u32 = 40;
/// Time until the answer to a save that erases in both copies \[ms\].
const SAVE_MS: u32 = 150;

/// Largest deviation of a step's start from its mean delay \[us\].
const JITTER_US: u32 = 5;

/// Cuts the power at once, during any operation of the flash.
const AT_ONCE: u32 = u32::MAX;

const HEALTHY: Sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));

/// A configuration that differs from others in its link timeout.
fn config(number: u32) -> Config {
    let mut config = Config::default();
    config.link.timeout_s = 1.0 + number as f32 / 100.0;
    config
}

fn pass(board: &mut EmulatedBoard, milliseconds: u32) {
    for _ in 0..milliseconds {
        let exchange = board.exchange(&HEALTHY).unwrap();
        assert_eq!(exchange.flash_violations, 0);
    }
}

fn operations(board: &mut EmulatedBoard) -> u32 {
    board.exchange(&HEALTHY).unwrap().flash_operations
}

fn read(board: &mut EmulatedBoard) -> Config {
    match board.ask(HostCommand::ReadConfig).unwrap() {
        Answer::Config(config) => config,
        other => panic!("{other:?}"),
    }
}

fn status(board: &mut EmulatedBoard) -> Status {
    match board.ask(HostCommand::Status).unwrap() {
        Answer::Status(status) => status,
        other => panic!("{other:?}"),
    }
}

fn save(board: &mut EmulatedBoard, config: &Config) {
    // Keeps within the rate of requests.
    pass(board, REQUESTS_MS);
    board.ask(HostCommand::Configure(*config)).unwrap();
    board.ask(HostCommand::Save).unwrap();
}

/// Cuts and restores the power while nothing is written.
fn cut_the_power(board: &mut EmulatedBoard) {
    board.inject(Injection::PowerCut { operation: AT_ONCE, done: 0.0 });
    pass(board, START_MS);
}

#[test]
fn a_saved_configuration_survives_the_power_and_is_forgotten_when_asked() {
    let mut board = EmulatedBoard::new().unwrap();
    pass(&mut board, START_MS);
    let refused = board.ask(HostCommand::Save);
    assert!(matches!(refused, Err(BoardError::Refused(Refusal::NotConfigured))), "{refused:?}");
    let name = Name::new("seven");
    pass(&mut board, REQUESTS_MS);
    board.ask(HostCommand::Configure(config(7))).unwrap();
    board.ask(HostCommand::Name(name)).unwrap();
    board.ask(HostCommand::Save).unwrap();
    assert_eq!(status(&mut board).config_source, ConfigSource::Flash);
    cut_the_power(&mut board);
    assert_eq!(read(&mut board), config(7));
    let found = status(&mut board);
    assert_eq!((found.config_source, found.config_name), (ConfigSource::Flash, name));
    assert_eq!((found.config_checksum, found.armed_pa), (checksum(&config(7)), None));
    pass(&mut board, TELEMETRY_MS);
    let telemetry = board.take_telemetry().last().copied().unwrap();
    assert!(!telemetry.faults.intersects(Faults::NOT_CONFIGURED), "{telemetry:?}");
    board.ask(HostCommand::Arm { most_pa: None }).unwrap();
    board.ask(HostCommand::Start(SetPoint::Duty { inlet: 0.5, outlet: 0.0 })).unwrap();
    // The board vents during the startup check and then drives by itself.
    let refused = board.ask(HostCommand::Forget);
    assert!(matches!(refused, Err(BoardError::Refused(Refusal::NotVented))), "{refused:?}");
    board.ask(HostCommand::Stop).unwrap();
    pass(&mut board, 2);
    board.ask(HostCommand::Forget).unwrap();
    assert_eq!(status(&mut board).config_source, ConfigSource::Host);
    cut_the_power(&mut board);
    assert_eq!(read(&mut board), Config::default());
    pass(&mut board, TELEMETRY_MS);
    let telemetry = board.take_telemetry().last().copied().unwrap();
    assert!(telemetry.faults.intersects(Faults::NOT_CONFIGURED), "{telemetry:?}");
}

/// Firmware of another protocol, whose bytes may mean something else, does not accept the configuration as its own.
#[test]
fn a_saved_configuration_names_its_protocol() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("flash");
    let image = firmware(Variant::Standard).unwrap();
    let mut board = EmulatedBoard::with_flash(&prepare_emulator().unwrap(), &image, &file).unwrap();
    save(&mut board, &config(7));
    let flash = std::fs::read(file).unwrap();
    let mut buffer = [0; 1024];
    let bytes: &[u8] = postcard::to_slice(&config(7), &mut buffer).unwrap();
    let place = flash.windows(bytes.len()).position(|window| window == bytes).unwrap();
    // The protocol comes before its number.
    assert_eq!(flash[place - 6..place - 4], PROTOCOL.to_le_bytes());
}

/// A board after its startup check that fills its muscle.
fn driving() -> Rig {
    let mut rig = Rig::new("[plant]\nmodel = \"lumped\"\n");
    rig.start(SetPoint::Duty { inlet: 0.5, outlet: 0.0 });
    rig.pass(STARTUP_CHECK_STEPS + 20);
    rig
}

/// A board that drives refuses to save and continues.
#[test]
fn a_board_that_drives_does_not_save() {
    let mut rig = driving();
    let before = rig.exchange().flash_operations;
    for command in [HostCommand::Save, HostCommand::Forget] {
        assert_eq!(rig.refused(command), Refusal::NotVented);
        rig.pass(100);
    }
    let exchange = rig.exchange();
    assert_eq!(exchange.flash_operations, before);
    assert!(exchange.outlet_coil > 0.99, "{exchange:?}");
}

/// Control continues while the flash is busy, to the millisecond, and the watchdog does not bite.
#[test]
fn control_goes_on_while_the_flash_is_busy() {
    let mut board = EmulatedBoard::new().unwrap();
    pass(&mut board, START_MS);
    let before = board.timing().unwrap();
    let first = operations(&mut board);
    for number in 0..30 {
        save(&mut board, &config(number));
    }
    let after = board.timing().unwrap();
    let made = operations(&mut board) - first;
    println!("30 saves: {made} operations, {after:?}");
    assert!((90..400).contains(&made), "{made}");
    assert_eq!(after.missed_steps, before.missed_steps, "{after:?}");
    let jitter_us = after.jitter_worst_us.saturating_sub(after.jitter_mean_ns / 1000);
    assert!(jitter_us <= JITTER_US, "{after:?}");
    assert_eq!(board.exchange(&HEALTHY).unwrap().restarts, 0);
    assert_eq!(read(&mut board), config(29));
}

/// The last venting event survives a loss of power.
#[test]
fn the_last_failure_survives_the_power() {
    let mut rig = driving();
    rig.exchange_with(|sample| Sample { emergency_stop: true, ..sample });
    rig.pass(SAVE_MS);
    let none_before = |rig: &mut Rig| {
        let before = rig.board.ask(HostCommand::History(1)).unwrap();
        assert!(matches!(before, Answer::Event(None)), "{before:?}");
    };
    // Clearing it is no further event.
    rig.board.ask(HostCommand::ClearFaults).unwrap();
    rig.exchange();
    none_before(&mut rig);
    cut_the_power(&mut rig.board);
    let failure = |answer| match answer {
        Answer::FirstFailure(Some(first)) | Answer::Event(Some(Event::Vented(first))) => first,
        other => panic!("{other:?}"),
    };
    for command in [HostCommand::FirstFailure, HostCommand::History(0)] {
        let first = failure(rig.board.ask(command).unwrap());
        assert_eq!(first.faults, Faults::EMERGENCY_STOP);
        assert!(first.pressure_pa > 1.05e5, "{first:?}");
    }
    // A failure recalled at the start is not recorded again.
    none_before(&mut rig);
}

/// Power fails in every operation of saves that fill the pages of both copies, erase them and start over: each time the
/// board starts, and has the old configuration or the new one, whole; and the next save is kept.
#[test]
fn power_that_fails_while_it_saves_leaves_the_old_or_the_new_configuration() {
    let mut board = EmulatedBoard::new().unwrap();
    pass(&mut board, START_MS);
    save(&mut board, &config(0));
    let (mut number, mut cuts, mut old, mut new) = (0, 0, 0, 0);
    // Saves until the pages have come round, cutting each save in every one of its operations.
    for round in 0..ROUNDS {
        let mut operation = 1;
        loop {
            let done = DONE[(round as usize + operation as usize) % DONE.len()];
            number += 1;
            pass(&mut board, REQUESTS_MS);
            let wanted = config(number);
            board.ask(HostCommand::Configure(wanted)).unwrap();
            let before = board.exchange(&HEALTHY).unwrap().power_cuts;
            board.inject(Injection::PowerCut { operation, done });
            board.send(HostCommand::Save);
            let mut exchange = board.exchange(&HEALTHY).unwrap();
            for _ in 0..SAVE_MS {
                if exchange.power_cuts > before {
                    break;
                }
                exchange = board.exchange(&HEALTHY).unwrap();
            }
            if exchange.power_cuts == before {
                // The save had fewer operations, so all of them have been cut.
                board.inject(Injection::PowerCut { operation: AT_ONCE, done: 0.0 });
                pass(&mut board, START_MS);
                assert_eq!(read(&mut board), wanted);
                break;
            }
            cuts += 1;
            pass(&mut board, SAVE_MS + START_MS);
            let found = read(&mut board);
            if found == wanted {
                new += 1;
            } else {
                assert_eq!(found, config(number - 1), "cut {cuts}: operation {operation}, {done}");
                old += 1;
                number -= 1;
            }
            operation += 1;
        }
        assert_eq!(board.exchange(&HEALTHY).unwrap().restarts, 0);
    }
    println!("{cuts} cuts: {old} times the old configuration, {new} times the new one");
    assert!(cuts > 80 && old > 20 && new > 20, "{cuts}: {old} {new}");
}
