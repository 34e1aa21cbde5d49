//! `thermyo monitor` on the emulated board, through a pseudo-terminal, while it is unplugged and
//! plugged in again.
#![cfg(unix)]

use host_sim::commands::monitor::{EVERY, Session, Status, view};
use model_core::{AdcCode, Sample};
use std::fs::File;
use std::time::{Duration, Instant};
use thermyo_boards::emulated::EmulatedBoard;
use thermyo_boards::live::LiveBoard;
use thermyo_boards::pty::PtyBoard;
use thermyo_files::units::UnitSystem;
use thermyo_protocol::LastReset;
use thermyo_record::board_trace::Recorder;

const HEALTHY: Sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));

fn poll_until(session: &mut Session<LiveBoard>, done: impl Fn(&Session<LiveBoard>) -> bool) {
    let start = Instant::now();
    while !done(session) {
        session.poll().unwrap();
        assert!(start.elapsed() < Duration::from_secs(180), "{:?}", session.status());
    }
}

#[test]
fn the_monitor_shows_records_and_survives_unplugging() {
    let folder = std::env::temp_dir().join(format!("thermyo-monitor-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let trace = folder.join("trace.csv");
    // The port of a board keeps its name when it is unplugged and plugged in again.
    let port = folder.join("port");
    let plug_in = || {
        let board = PtyBoard::new(EmulatedBoard::new().unwrap(), HEALTHY).unwrap();
        let _ = std::fs::remove_file(&port);
        std::os::unix::fs::symlink(board.port(), &port).unwrap();
        board
    };

    let board = plug_in();
    let recorder = Recorder::new(File::create(&trace).unwrap()).unwrap();
    let mut session = Session::<LiveBoard>::open(port.to_str().unwrap(), EVERY, recorder).unwrap();
    // The board reports twice a second whether it is armed.
    poll_until(&mut session, |session| session.rows() > 1000 && session.timing().is_some());
    assert_eq!(session.status(), Status::Connected);
    assert_eq!(session.last_reset(), Some(LastReset::Power));

    let shown = |session: &Session<LiveBoard>| {
        let figures = view::figures(session, UnitSystem::Practical).unwrap();
        assert!(!figures.contains('\n'), "{figures}");
        view::notes(session, UnitSystem::Practical).join("\n") + "\n" + &figures
    };
    let text = shown(&session);
    for part in [
        "connected, RP2040, firmware",
        // The board has no configuration yet.
        "not configured",
        "not armed",
        " kPa (set point none: it vents), ",
        " mm, gas ",
        " +- ",
        "degC, wall",
        "late; 0 missed",
        "malformed",
    ] {
        assert!(text.contains(part), "{part} is not in:\n{text}");
    }

    // Without a configuration the board refuses to be armed.
    session.arm();
    poll_until(&mut session, |session| session.refused().is_some());
    assert!(shown(&session).contains("refused: "), "{}", shown(&session));

    // The file contains every displayed row, so that killing the monitor loses none.
    let seen = session.rows();
    poll_until(&mut session, |_| {
        std::fs::read_to_string(&trace).unwrap().lines().count() as u64 > seen
    });

    drop(board);
    poll_until(&mut session, |session| session.status() == Status::Unplugged);
    let rows = session.rows();
    assert!(shown(&session).contains("unplugged"), "{}", shown(&session));

    let _board = plug_in();
    poll_until(&mut session, |session| session.rows() > rows + 50);
    assert_eq!((session.status(), session.connections()), (Status::Connected, 2));
    session.finish().unwrap();
    assert_recorded_as_one(&std::fs::read_to_string(&trace).unwrap(), session.rows());
    assert_eq!(session.configurations().len(), 1, "both boards were configured the same");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Asserts one record for the rows of two boards in succession.
fn assert_recorded_as_one(recorded: &str, rows: u64) {
    assert_eq!(recorded.lines().count() as u64, rows + 1);
    let columns = recorded.lines().next().unwrap().split(',').count();
    assert!(recorded.lines().all(|line| line.split(',').count() == columns));
    // The second board counts from 0, once its startup check is over; time continues.
    let column = |name: &str| -> Vec<f64> {
        let index = recorded.lines().next().unwrap().split(',').position(|column| column == name);
        let index = index.unwrap_or_else(|| panic!("no column {name}"));
        let cells = recorded.lines().skip(1).map(|line| line.split(',').nth(index).unwrap());
        cells.map(|cell| cell.parse().unwrap()).collect()
    };
    let (times, steps) = (column("time_s"), column("step"));
    assert_eq!(times[0], 0.0);
    assert!(times.is_sorted_by(|a, b| a < b), "time falls");
    assert_eq!(steps.windows(2).filter(|pair| pair[1] < pair[0]).count(), 1, "no restart");
}
