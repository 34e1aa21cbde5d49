//! Commands with a user at a terminal, and their failures: calibration, tuning, the monitor's keys,
//! a port that is in use, a full disk.
#![cfg(unix)]

use serialport::{SerialPort, TTYPort};
use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;
use thermyo_boards::image::{Variant, firmware};

use crate::board_support::{Bench, repository, until};
use crate::command_support::{Said, interrupted};

fn signal(child: &Child, signal: &str) {
    let pid = child.id().to_string();
    assert!(Command::new("kill").args([signal, &pid]).status().unwrap().success());
}

fn configured() -> Bench {
    let bench = Bench::new();
    bench.ok("thermyo board emulated config write scenarios/contraction.toml");
    bench
}

fn configured_joint() -> Bench {
    firmware(Variant::Joint).unwrap();
    let bench = Bench::new();
    bench.ok("thermyo board emulated plug scenarios/joint_board.toml");
    bench.ok("thermyo board emulated config write scenarios/joint_board.toml");
    bench
}

/// Output of a calibration for these typed lines.
fn typed(bench: &Bench, line: &str, text: &str) -> Said {
    let mut child = bench.command(line).stdin(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
    Said::of(line, child.wait_with_output().unwrap())
}

/// End of a running command.
fn end(child: Child) -> Said {
    Said::of("the command", child.wait_with_output().unwrap())
}

#[test]
fn a_sensor_is_calibrated_by_what_is_typed() {
    let bench = configured();
    let calibrate = "thermyo board emulated calibrate pressure --hold 250000";
    // A calibration must not arm the board, and has no option for it.
    let unarmed = typed(&bench, calibrate, "101325\n252500\n").ends(2);
    assert!(unarmed.err.ends_with("is not armed: `thermyo board PORT arm`\n"), "{}", unarmed.err);
    bench.ok("thermyo board emulated arm");
    let word = typed(&bench, calibrate, "one bar\n").ends(2);
    word.says("one bar\": the reference must be a number in Pa, or one with");
    // The unit is wrong, which is refused at the first point.
    let unit = typed(&bench, calibrate, "101.3\n");
    unit.says("the reference reads 0.10 kPa and the sensor 101.");
    // A reference far from the sensor's reading.
    bench.ok("thermyo board emulated arm");
    typed(&bench, calibrate, "101325\n400000\n").ends(2).in_one_line();
    let before = bench.vented();

    // After the second point, which was held, the board vents.
    until("it has vented", || {
        bench.json("thermyo board emulated info")["pressure_pa"].as_f64().unwrap() < 103_000.0
    });
    bench.ok("thermyo board emulated arm");
    // Typos do not end the calibration.
    let text = typed(&bench, calibrate, "101,3\n101.325 kPa\n2.5\n2.525 bar\n").ok().out;
    assert!(text.contains("it holds 250.0 kPa") && text.contains("put right by"), "{text}");
    // The sensor reads 1 % more from now on, until power is lost, as the message states.
    assert!(text.contains("not saved"), "{text}");
    let after = bench.ok("thermyo board emulated info");
    assert!(after.contains("armed:         no") && after.contains("contraction, "), "{after}");
    let checksum = |info: &str| {
        let line = info.lines().find(|line| line.starts_with("configuration:")).unwrap().to_owned();
        line.split(", ").nth(1).unwrap().to_owned()
    };
    assert_ne!(checksum(&before), checksum(&after));
    let file = bench.path("calibrated.toml").display().to_string();
    bench.ok(&format!("thermyo board emulated config read {file}"));
    let scenario = fs::read_to_string(&file).unwrap();
    assert!(scenario.contains("gain"), "{scenario}");
    // A scenario from before the calibration used to remove it without a message.
    let same = bench.run(&format!("thermyo board emulated config write {file}")).ok();
    assert_eq!(same.err, "");
    let lost = bench.run("thermyo board emulated config write scenarios/contraction.toml").ok();
    lost.in_one_line().says("contraction.toml: the board loses its calibration: sensor.pressure.");
}

/// The computer is busy for a while, but not longer than the link's timeout.
#[test]
fn a_host_that_is_held_up_does_not_flood_its_board() {
    let bench = configured();
    let rows = (0..=80).map(|i| {
        let time_s = f64::from(i) * 0.1;
        format!("{time_s},{}\n", 1.3e5 + 1.0e4 * (3.0 * time_s).sin())
    });
    let profile = bench.path("sine.csv");
    fs::write(&profile, format!("time_s,pressure_pa\n{}", rows.collect::<String>())).unwrap();
    let child = bench.start(&format!(
        "thermyo board emulated drive {} --arm --quiet --json --out out/drive",
        profile.display()
    ));
    let trace = bench.path("out/drive/unfinished-1/trace.csv");
    until("it drives", || recorded(&fs::read_to_string(&trace).unwrap_or_default()).len() > 500);
    for _ in 0..3 {
        signal(&child, "-STOP");
        // The length of the pause is the subject of the test, not a wait.
        thread::sleep(Duration::from_millis(350));
        signal(&child, "-CONT");
        let rows = || recorded(&fs::read_to_string(&trace).unwrap_or_default()).len();
        let before = rows();
        until("it goes on", || rows() > before + 300);
    }
    let summary = end(child).ok().json();
    assert_eq!(summary["core"]["faults"], 0, "{summary}");
    assert!(summary["control"]["rms_error"].as_f64().unwrap() < 2.5e3, "{summary}");
}

/// Calibrates the pressure of one muscle while both are held; an arm that hangs still does not give
/// two angles.
#[test]
fn a_joints_sensors_are_calibrated_by_what_is_typed() {
    let bench = configured_joint();
    let same = typed(&bench, "thermyo board emulated calibrate angle", "0deg\n1deg\n");
    same.ends(2).says("the two points are ");
    bench.ok("thermyo board emulated arm");
    let calibrate = "thermyo board emulated calibrate pressure --muscle b --hold 2bar";
    let text = typed(&bench, calibrate, "101.325 kPa\n2.02 bar\n").ok().out;
    assert!(text.contains("it holds 200.0 kPa") && text.contains("put right by"), "{text}");
    let file = bench.path("calibrated.toml").display().to_string();
    bench.ok(&format!("thermyo board emulated config read {file}"));
    let scenario = fs::read_to_string(&file).unwrap();
    let of_b = scenario.split("[joint.b.sensor.pressure]").nth(1).expect("b differs from a");
    assert!(of_b.split("\n[").next().unwrap().contains("gain = 1.0"), "{scenario}");
}

#[test]
fn a_calibration_that_is_interrupted_vents() {
    let bench = configured();
    let mut command = bench.command("thermyo board emulated calibrate gas");
    let mut child = command.stdin(Stdio::piped()).spawn().unwrap();
    // The calibration asks a question.
    child.stdout.as_mut().unwrap().read_exact(&mut [0]).unwrap();
    signal(&child, "-INT");
    // The input stays open: a user who presses Ctrl-C has not closed the terminal.
    until("it ends", || child.try_wait().unwrap().is_some());
    end(child).ends(130);
    bench.vented();
}

/// Sends Ctrl-C once a command has the board, so that another program's request is refused.
fn interrupted_with_the_board(bench: &Bench, child: Child) -> Said {
    until("it has the board", || {
        let asked = bench.run("thermyo board emulated info");
        asked.code != Some(0) && asked.err.contains("another program")
    });
    interrupted(child).ends(130)
}

#[test]
fn a_tune_that_is_interrupted_vents_and_leaves_nothing() {
    let bench = Bench::new();
    let written = bench.ok("thermyo board emulated config write scenarios/nominal.toml");
    let child = bench.start(
        "thermyo tune scenarios/contraction.toml --board port:emulated --out out/tune --quiet",
    );
    interrupted_with_the_board(&bench, child);
    assert!(!bench.path("out/tune").exists(), "half a result is left");
    // The board was left with the scenario's configuration.
    let info = bench.vented();
    assert!(info.contains(&format!("configuration: {}", written.trim_end())), "{info}");
}

#[test]
fn stops_are_measured_only_when_armed_and_an_interrupt_vents() {
    let bench = configured();
    let measure = "thermyo measure stop emulated --stops 3 --wait 6 --out out/stops --quiet";
    bench.run(measure).ends(2).says("not armed");
    assert!(!bench.path("out/stops").exists());
    let child = bench.start(&format!("{measure} --arm --max-pressure 250000"));
    let stopped = interrupted_with_the_board(&bench, child);
    assert_eq!(stopped.err.matches("stopped").count(), 1, "{}", stopped.err);
    bench.vented();
}

#[test]
fn a_joint_whose_set_point_is_interrupted_vents() {
    let bench = configured_joint();
    let set = "thermyo board emulated set torque 0.5 --stiffness 8 --arm --hold 60";
    let mut child = bench.start(set);
    child.stdout.as_mut().unwrap().read_exact(&mut [0]).unwrap();
    let stopped = interrupted(child).ends(130).says(" s of 60 s");
    assert!(stopped.err.starts_with("thermyo: stopped at "), "{}", stopped.err);
    assert!(stopped.out.ends_with("; it vents\n"), "{}", stopped.out);
    bench.vented();
}

/// A set point that is held for a minute, once its first line is printed.
fn holding(bench: &Bench) -> Child {
    let mut child = bench.start("thermyo board emulated set pressure 130000 --arm --hold 60");
    child.stdout.as_mut().unwrap().read_exact(&mut [0; 20]).unwrap();
    child
}

/// A program that was killed cannot vent, and later programs only ask.
#[test]
fn a_program_that_asks_keeps_no_set_point_alive() {
    let bench = configured();
    let mut child = holding(&bench);
    signal(&child, "-KILL");
    child.wait().unwrap();
    let info = bench.vented();
    assert!(info.contains("link lost"), "{info}");
    // Arming clears that fault, even if earlier telemetry still reports it.
    bench.ok("thermyo board emulated set pressure 130000 --arm --hold 0.2");
}

/// A joint that has locked used to be reported as vented.
#[test]
fn a_joint_that_may_have_locked_is_not_reported_as_vented() {
    let bench = configured_joint();
    let text = fs::read_to_string(repository().join("scenarios/joint_board.toml")).unwrap();
    let locking = bench.path("locking.toml");
    fs::write(&locking, text.replace("[joint]", "[joint]\nlock_s = 0.8")).unwrap();
    bench.ok(&format!("thermyo board emulated config write {}", locking.display()));
    let mut child =
        bench.start("thermyo board emulated set angle 5deg --stiffness 10 --arm --hold 60");
    child.stdout.as_mut().unwrap().read_exact(&mut [0; 20]).unwrap();
    signal(&child, "-KILL");
    child.wait().unwrap();
    until("it is in its history", || {
        let history = bench.ok("thermyo board emulated history");
        history.starts_with("locked or vented by link lost at ")
    });
    bench.ok("thermyo board emulated set angle 5deg --stiffness 10 --arm --hold 0.2");
}

/// The reader of the figures ends, as in `thermyo monitor PORT | head`.
#[test]
fn a_monitor_whose_output_is_closed_keeps_its_record() {
    let bench = configured();
    let mut child = bench.start("thermyo monitor emulated --out out/monitor");
    let mut out = child.stdout.take().unwrap();
    out.read_exact(&mut [0; 20]).unwrap();
    drop(out);
    let said = end(child).ok();
    assert!(said.err.is_empty(), "{}", said.err);
    assert!(bench.path("out/monitor/trace.csv").exists());
}

/// Starts a command and waits until this file has more than `bytes` bytes.
fn recording(bench: &Bench, line: &str, file: &str, bytes: u64) -> Child {
    let (child, file) = (bench.start(line), bench.path(file));
    until("it records", || fs::metadata(&file).is_ok_and(|found| found.len() > bytes));
    child
}

#[test]
fn a_drive_that_is_cut_reports_it() {
    let bench = configured();
    let profile = bench.path("held.csv");
    fs::write(&profile, "time_s,pressure_pa\n0,130000\n60,130000\n").unwrap();
    let drive = format!("thermyo board emulated drive {} --arm --out out/drive", profile.display());
    let child = recording(&bench, &drive, "out/drive/unfinished-1/trace.csv", 20_000);
    let Said { out: text, err, .. } = interrupted(child).ends(130).says("thermyo: stopped at ");
    assert!(text.contains(" s of 60 s driven, "), "{text}");
    assert_eq!(format!("{text}{err}").matches("stopped").count(), 1, "{text}");
    let summary = fs::read(bench.path("out/drive/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
    assert_eq!(summary["stopped_of_s"], 60.0, "{summary}");
    assert!((0.01..59.0).contains(&summary["duration_s"].as_f64().unwrap()), "{summary}");
    let report = fs::read_to_string(bench.path("out/drive/report.html")).unwrap();
    assert!(
        report.contains("Stopped by Ctrl-C: ")
            && report.contains(" s of 60 s on the emulated board")
    );
    bench.vented();
}

#[test]
fn a_set_point_that_expires_is_reported() {
    let bench = configured();
    let Said { out: text, err, .. } = interrupted(holding(&bench)).ends(130).says(" s of 60 s\n");
    assert!(text.contains("it vents") && !text.contains("stopped"), "{text}");
    assert_eq!(err.matches("stopped").count(), 1, "{err}");
    bench.vented();
}

/// A command at its own terminal, which accepts keys.
struct AtTerminal {
    child: Child,
    keys: TTYPort,
    /// Stays open while keys are pressed; otherwise the reads fail.
    _held: TTYPort,
}

impl AtTerminal {
    fn new(mut command: Command) -> Self {
        let (mut keys, held) = TTYPort::pair().unwrap();
        keys.set_timeout(Duration::from_millis(1)).unwrap();
        let name = held.name().unwrap();
        let terminal = fs::File::options().read(true).write(true).open(name).unwrap();
        command.stdin(terminal.try_clone().unwrap()).stdout(terminal);
        Self { child: command.spawn().unwrap(), keys, _held: held }
    }

    fn press(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).unwrap();
    }

    /// Reads the output, so that the command does not block; returns it.
    fn look(&mut self) -> String {
        let (mut picture, mut shown) = ([0; 65_536], String::new());
        while let Ok(count @ 1..) = self.keys.read(&mut picture) {
            shown += &String::from_utf8_lossy(&picture[..count]);
        }
        shown
    }
}

#[test]
fn the_monitors_keys_arm_drive_and_vent() {
    let bench = configured();
    let mut monitor = AtTerminal::new(bench.command("thermyo monitor emulated --out out/monitor"));
    let unfinished = bench.path("out/monitor/unfinished-1/trace.csv");
    let rows = |monitor: &mut AtTerminal, holds: &dyn Fn(&[Vec<String>]) -> bool, what: &str| {
        until(what, || {
            monitor.look();
            holds(&recorded(&fs::read_to_string(&unfinished).unwrap_or_default()))
        });
    };
    let set_point = |value: &'static str| {
        move |rows: &[Vec<String>]| {
            rows.last().is_some_and(|row| row.iter().any(|cell| cell == value))
        }
    };
    rows(&mut monitor, &|rows| rows.len() > 20, "it records");
    // The refusal names the key that helps.
    monitor.press("\x1b[C");
    let mut shown = String::new();
    until("it is refused", || {
        shown += &monitor.look();
        shown.contains("not armed: arm it first; a arms it")
    });
    monitor.press("a");
    // 25 kPa up from ambient, in steps of 5 kPa, then 5 more.
    monitor.press("\x1b[C");
    rows(&mut monitor, &set_point("125000"), "right");
    monitor.press("\x1b[A");
    rows(&mut monitor, &set_point("130000"), "up");
    monitor.press(" ");
    rows(&mut monitor, &|rows| !set_point("130000")(rows), "space vents");
    monitor.press("q");
    until("it leaves", || {
        monitor.look();
        monitor.child.try_wait().unwrap().is_some()
    });
    assert!(monitor.child.wait().unwrap().success());
    assert!(bench.path("out/monitor/trace.csv").is_file());
    assert!(bench.path("out/monitor/scenario.toml").is_file());

    // Ctrl-C quits too, with its own exit code.
    let mut monitor = AtTerminal::new(bench.command("thermyo monitor emulated --out out/monitor"));
    rows(&mut monitor, &|rows| rows.len() > 20, "it records again");
    monitor.press("\x03");
    until("it is stopped", || {
        monitor.look();
        monitor.child.try_wait().unwrap().is_some()
    });
    assert_eq!(monitor.child.wait().unwrap().code(), Some(130));
}

/// Without a time the command states how it ends, and a terminal shows that in one line.
#[test]
fn a_set_point_without_a_time_says_how_it_ends() {
    let bench = configured();
    let set = bench.command("thermyo board emulated set pressure 130000 --arm");
    let mut held = AtTerminal::new(set);
    let mut shown = String::new();
    until("it holds", || {
        shown += &held.look();
        shown.matches("kPa").count() > 5
    });
    held.press("\x03");
    signal(&held.child, "-INT");
    until("it is stopped", || {
        shown += &held.look();
        held.child.try_wait().unwrap().is_some()
    });
    let ended = end(held.child).ends(130).says("Ctrl-C ends it, and vents\n");
    assert!(!ended.err.contains("60"), "{}", ended.err);
    // The readings, rewritten in one line, and the sentence at the end.
    let lines: Vec<&str> = shown.trim().split('\n').collect();
    assert!(
        lines[0].matches("\r\u{1b}").count() + lines[0].matches("\u{1b}[K").count() > 4,
        "{shown:?}"
    );
    assert!(lines.len() <= 2, "{shown:?}");
}

#[test]
fn a_monitor_without_a_screen_records() {
    let bench = configured();
    let start = |line| recording(&bench, line, "out/monitor/unfinished-1/trace.csv", 20_000);
    // As `timeout` sends it.
    let child = start("thermyo monitor emulated --every 10 --quiet --out out/monitor");
    signal(&child, "-TERM");
    assert_eq!(end(child).ends(130).out, "");
    assert!(fs::metadata(bench.path("out/monitor/trace.csv")).unwrap().len() > 20_000);
    // A record of every tenth step does not contain every sample, and the message names the option.
    let gaps = bench.refused("thermyo replay out/monitor --out out/again");
    assert!(gaps.contains("`thermyo monitor PORT --every 1`"), "{gaps}");

    let child = start("thermyo monitor emulated --json --out out/monitor");
    let taken = bench.refused("thermyo board emulated plug");
    assert!(taken.contains("emulated: another program has it open: close that one"), "{taken}");
    bench.ok("thermyo board emulated unplug");
    let json = end(child).ends(2).says("the line to the board is gone").json();
    assert!(json["rows"].as_u64().unwrap() > 20, "{json}");
    assert_the_record_replays(&bench);
}

/// Columns of the joint, the raw samples among them, and its scenario: the record is replayed.
#[test]
fn a_monitor_records_a_joint() {
    let bench = configured_joint();
    let monitor = "thermyo monitor emulated --log mcap --out out/monitor";
    // For longer than the second after which it prints a line: a row takes 555 bytes.
    let trace = "out/monitor/unfinished-1/joint_trace.csv";
    let child = recording(&bench, monitor, trace, 1_000_000);
    signal(&child, "-TERM");
    let shown = end(child).ends(130).out;
    assert!(shown.contains(" N m/rad, ") && shown.contains("set point none: it vents"), "{shown}");
    assert!(shown.contains("rows recorded: ") && shown.contains("joint_trace.csv"), "{shown}");
    assert!(bench.path("out/monitor/trace.mcap").exists());
    let replayed = bench.ok("thermyo replay out/monitor --out out/again");
    let (steps, _) = replayed.split_once(" of ").unwrap();
    assert!(steps.parse::<u32>().unwrap() > 20, "{replayed}");
    // Without a start of the core in the record, equal bits are not claimed.
    let whole = replayed.contains(" recorded steps replayed, 0 differ");
    assert!(whole || replayed.contains("the record has no start of the core"), "{replayed}");
}

/// A monitor's record begins at any step of the core; it used to be refused.
fn assert_the_record_replays(bench: &Bench) {
    let rows = fs::read_to_string(bench.path("out/monitor/trace.csv")).unwrap().lines().count() - 1;
    let replayed = bench.ok("thermyo replay out/monitor --out out/again");
    let note = replayed.lines().find(|line| line.contains("replayed from")).expect(&replayed);
    assert!(note.contains(&format!(" of {rows} rows")), "{replayed}");
    let json = bench.json("thermyo replay out/monitor/trace.csv --out out/again");
    let part = ["rows_before", "steps", "rows_after"].map(|key| json[key].as_u64().unwrap());
    assert_eq!(part.iter().sum::<u64>(), rows as u64, "{json}");
    assert!(part[1] > 20, "{json}");
}

fn recorded(trace: &str) -> Vec<Vec<String>> {
    let rows = trace.lines().skip(1).filter(|_| trace.ends_with('\n'));
    rows.map(|row| row.split(',').map(str::to_owned).collect()).collect()
}

/// A limit on the size of files simulates a full disk.
#[test]
fn a_disk_that_fills_during_a_drive_vents_and_is_reported() {
    let bench = configured();
    let whole = fs::read_to_string(repository().join("scenarios/contraction.toml"));
    let short = whole.unwrap().replace("duration_s = 5.0", "duration_s = 0.1");
    fs::write(bench.path("short.toml"), short).unwrap();
    // Full during the drive, and when the report is written.
    for (profile, kib, unwritable) in
        [("scenarios/contraction.toml", "100", "trace.csv"), ("short.toml", "50", "report.html")]
    {
        let output = Command::new("bash")
            .arg("-c")
            .arg(
                "trap '' XFSZ; ulimit -f $3; exec \"$0\" board emulated drive \"$1\" --arm --quiet --out \"$2\"",
            )
            .arg(env!("CARGO_BIN_EXE_thermyo"))
            .arg(if profile == "short.toml" { bench.path(profile) } else { PathBuf::from(profile) })
            .arg(bench.path("out/drive"))
            .arg(kib)
            .env("TMPDIR", bench.path(""))
            .current_dir(repository())
            .output()
            .unwrap();
        let said = Said::of("drive on a full disk", output).ends(2).err;
        let [kept, error] = said.trim().lines().collect::<Vec<_>>()[..] else { panic!("{said}") };
        assert!(error.contains(unwritable), "{error}");
        let (_, record) = kept.split_once("thermyo: the record so far is in ").expect(&said);
        let trace = fs::read_to_string(Path::new(record).join("trace.csv")).unwrap();
        assert!(trace.lines().count() > 50, "{trace}");
        bench.vented();
    }
}

#[test]
fn a_profile_for_another_chamber_is_refused() {
    let bench = Bench::new();
    fs::write(bench.path("vessel.toml"), "[plant]\nkind = \"vessel\"\n").unwrap();
    let vessel = bench.path("vessel.toml").display().to_string();
    bench.ok(&format!("thermyo board emulated config write {vessel}"));
    let refused =
        bench.refused("thermyo board emulated drive scenarios/contraction.toml --arm --quiet");
    let wrong = "plant.kind = \"muscle\": must be what the board was configured with, \"vessel\"";
    assert!(refused.contains(wrong), "{refused}");
    let refused = bench.refused("thermyo board emulated set contraction 0.1 --arm");
    assert!(refused.contains("this chamber does not move"), "{refused}");
    bench.vented();
}
