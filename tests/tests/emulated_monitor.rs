//! `thermyo monitor` on the emulated board, through a pseudo-terminal, and through its unplugging.
#![cfg(unix)]

use host_sim::commands::monitor::{Session, Status, draw};
use model_core::link::LastReset;
use model_core::{AdcCode, Sample};
use ratatui::Terminal;
use ratatui::backend::TestBackend;
use std::fs::File;
use std::time::{Duration, Instant};
use system_tests::skip_emulator;
use thermyo_boards::emulated::EmulatedBoard;
use thermyo_boards::pty::PtyBoard;
use thermyo_record::board_trace::Recorder;

const HEALTHY: Sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));

fn poll_until(session: &mut Session, done: impl Fn(&Session) -> bool) {
    let start = Instant::now();
    while !done(session) {
        session.poll().unwrap();
        assert!(start.elapsed() < Duration::from_secs(20), "{:?}", session.status());
    }
}

#[test]
fn the_monitor_shows_records_and_survives_unplugging() {
    if skip_emulator() {
        return;
    }
    let folder = std::env::temp_dir().join(format!("thermyo-monitor-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let trace = folder.join("trace.csv");
    // The port of a board that is unplugged and plugged in again keeps its name.
    let port = folder.join("port");
    let plug_in = || {
        let board = PtyBoard::new(EmulatedBoard::new().unwrap(), HEALTHY).unwrap();
        let _ = std::fs::remove_file(&port);
        std::os::unix::fs::symlink(board.port(), &port).unwrap();
        board
    };

    let board = plug_in();
    let recorder = Recorder::new(File::create(&trace).unwrap()).unwrap();
    let mut session = Session::open(port.to_str().unwrap(), recorder).unwrap();
    poll_until(&mut session, |session| session.rows() > 50 && session.timing().is_some());
    assert_eq!(session.status(), Status::Connected);
    assert_eq!(session.last_reset(), Some(LastReset::Power));

    let mut terminal = Terminal::new(TestBackend::new(80, 24)).unwrap();
    terminal.draw(|frame| draw(frame, &session)).unwrap();
    let screen = terminal.backend().to_string();
    let parts = ["connected", "Rp2040, firmware", "pressure", "kPa", "+-", "[K]"];
    // Nobody has configured the board.
    for text in parts.into_iter().chain(["not configured"]) {
        assert!(screen.contains(text), "{text} is not on the screen:\n{screen}");
    }

    // Nothing is cut off.
    for text in [
        "set point none: it vents",
        "not armed",
        "Ctrl-C vents and leaves",
        "late; 0 missed",
        "K, wall",
    ] {
        assert!(screen.contains(text), "{text} is not on the screen:\n{screen}");
    }

    // In half of the width it is folded.
    let mut narrow = Terminal::new(TestBackend::new(40, 24)).unwrap();
    narrow.draw(|frame| draw(frame, &session)).unwrap();
    let screen = narrow.backend().to_string();
    for text in [
        "space vents",
        "Ctrl-C vents and leaves",
        "pressure",
        "missed",
        "malformed",
        "not configured",
    ] {
        assert!(screen.contains(text), "{text} is not on the screen:\n{screen}");
    }

    // Where less is seen it goes on all the same.
    for (columns, rows) in [(40, 12), (20, 6), (1, 1)] {
        let mut small = Terminal::new(TestBackend::new(columns, rows)).unwrap();
        small.draw(|frame| draw(frame, &session)).unwrap();
    }

    // What it does not know its muscle for, it refuses.
    session.arm();
    poll_until(&mut session, |session| session.refused().is_some());

    // Who kills the monitor now has what it has shown.
    let shown = session.rows();
    poll_until(&mut session, |_| {
        std::fs::read_to_string(&trace).unwrap().lines().count() as u64 > shown
    });

    drop(board);
    poll_until(&mut session, |session| session.status() == Status::Unplugged);
    let rows = session.rows();
    terminal.draw(|frame| draw(frame, &session)).unwrap();
    assert!(terminal.backend().to_string().contains("unplugged"));

    let _board = plug_in();
    poll_until(&mut session, |session| session.rows() > rows + 50);
    assert_eq!((session.status(), session.connections()), (Status::Connected, 2));
    session.finish().unwrap();
    let recorded = std::fs::read_to_string(&trace).unwrap();
    assert_eq!(recorded.lines().count() as u64, session.rows() + 1);
    let columns = recorded.lines().next().unwrap().split(',').count();
    assert!(recorded.lines().all(|line| line.split(',').count() == columns));
    // The second board counts from 0, as soon as it has judged its sensors; time goes on.
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
    assert_eq!(session.configurations().len(), 1, "both boards were configured the same");
    std::fs::remove_dir_all(&folder).unwrap();
}
