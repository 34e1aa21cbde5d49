//! Commands with a user at a terminal, and their failures: calibration, tuning, the monitor's keys,
//! a port that is in use, a full disk.
#![cfg(unix)]

use serialport::{SerialPort, TTYPort};
use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Output, Stdio};
use std::thread;
use std::time::Duration;
use thermyo_boards::image::{Variant, firmware};

use crate::board_support::{Bench, until};

fn signal(child: &Child, signal: &str) {
    let pid = child.id().to_string();
    let sent = std::process::Command::new("kill").args([signal, &pid]).status().unwrap();
    assert!(sent.success());
}

fn message(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn configured() -> Bench {
    let bench = Bench::new();
    bench.ok("thermyo board emulated config write scenarios/contraction.toml");
    bench
}

/// A bench with a configured joint.
fn configured_joint() -> Bench {
    firmware(Variant::Joint).unwrap();
    let bench = Bench::new();
    bench.ok("thermyo board emulated plug scenarios/joint_board.toml");
    bench.ok("thermyo board emulated config write scenarios/joint_board.toml");
    bench
}

/// Output of a calibration with these lines typed.
fn typed(bench: &Bench, line: &str, text: &str) -> Output {
    let mut command = bench.command(line);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
    child.wait_with_output().unwrap()
}

#[test]
fn a_sensor_is_calibrated_by_what_is_typed() {
    let bench = configured();
    let calibrate = "thermyo board emulated calibrate pressure --hold 250000";
    // A calibration must not arm the board.
    let refused = typed(&bench, calibrate, "101325\n252500\n");
    assert_eq!(refused.status.code(), Some(2), "{}", message(&refused));
    assert!(message(&refused).contains("not armed"), "{}", message(&refused));
    bench.ok("thermyo board emulated arm");
    let word = typed(&bench, calibrate, "one bar\n");
    assert_eq!(word.status.code(), Some(2), "{}", message(&word));
    assert!(
        message(&word).contains("one bar\": the reference must be a number in Pa, or one with")
    );
    // The unit is wrong: it is refused at the first point.
    let unit = typed(&bench, calibrate, "101.3\n");
    assert!(message(&unit).contains("the reference reads 0.10 kPa and the sensor 101."));
    // A reference far from the sensor's reading.
    bench.ok("thermyo board emulated arm");
    let wrong = typed(&bench, calibrate, "101325\n400000\n");
    assert_eq!((wrong.status.code(), message(&wrong).lines().count()), (Some(2), 1));
    let before = bench.vented();

    // After the second point, which was held, it vents.
    until("it has vented", || {
        let info = bench.ok("thermyo board emulated info --json");
        let info: serde_json::Value = serde_json::from_str(&info).unwrap();
        info["pressure_pa"].as_f64().unwrap() < 103_000.0
    });
    bench.ok("thermyo board emulated arm");
    // Typos do not end it.
    let done = typed(&bench, calibrate, "101,3\n101.325 kPa\n2.5\n2.525 bar\n");
    let text = String::from_utf8_lossy(&done.stdout).into_owned();
    assert!(done.status.success(), "{text}{}", message(&done));
    assert!(text.contains("it holds 250.0 kPa") && text.contains("put right by"), "{text}");
    // It reads 1 % more from now on, until the power goes, as the message states.
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
}

/// The computer is busy for a while, within the link's timeout.
#[test]
fn a_host_that_is_held_up_does_not_flood_its_board() {
    let bench = configured();
    let rows = (0..=80).map(|i| {
        let time_s = f64::from(i) * 0.1;
        format!("{time_s},{}\n", 1.3e5 + 1.0e4 * (3.0 * time_s).sin())
    });
    let profile = bench.path("sine.csv");
    fs::write(&profile, format!("time_s,pressure_pa\n{}", rows.collect::<String>())).unwrap();
    let mut command = bench.command(&format!(
        "thermyo board emulated drive {} --arm --quiet --json --out out/drive",
        profile.display()
    ));
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let trace = bench.path("out/drive/unfinished-1/trace.csv");
    until("it drives", || recorded(&fs::read_to_string(&trace).unwrap_or_default()).len() > 500);
    for _ in 0..3 {
        signal(&child, "-STOP");
        // How long it is held up is what is tried, and no wait for anything.
        thread::sleep(Duration::from_millis(350));
        signal(&child, "-CONT");
        let rows = || recorded(&fs::read_to_string(&trace).unwrap_or_default()).len();
        let before = rows();
        until("it goes on", || rows() > before + 300);
    }
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", message(&output));
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["core"]["faults"], 0, "{summary}");
    assert!(summary["control"]["rms_error"].as_f64().unwrap() < 2.5e3, "{summary}");
}

/// The pressure of one muscle, with both held; an arm that hangs still gives no two angles.
#[test]
fn a_joints_sensors_are_calibrated_by_what_is_typed() {
    let bench = configured_joint();
    let same = typed(&bench, "thermyo board emulated calibrate angle", "0deg\n1deg\n");
    assert_eq!(same.status.code(), Some(2), "{}", message(&same));
    assert!(message(&same).contains("the two points are "), "{}", message(&same));
    bench.ok("thermyo board emulated arm");
    let calibrate = "thermyo board emulated calibrate pressure --muscle b --hold 2bar";
    let done = typed(&bench, calibrate, "101.325 kPa\n2.02 bar\n");
    let text = String::from_utf8_lossy(&done.stdout).into_owned();
    assert!(done.status.success(), "{text}{}", message(&done));
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
    let mut child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It asks.
    child.stdout.as_mut().unwrap().read_exact(&mut [0]).unwrap();
    signal(&child, "-INT");
    // Its input stays open: a user who presses Ctrl-C has not closed the terminal.
    until("it ends", || child.try_wait().unwrap().is_some());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", message(&output));
    bench.vented();
}

#[test]
fn a_tune_that_is_interrupted_vents_and_leaves_nothing() {
    let bench = configured();
    let mut command = bench.command(
        "thermyo tune scenarios/contraction.toml --board port:emulated --out out/tune --quiet",
    );
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    // Another program that asks is refused once the tune has the board.
    until("it has the board", || {
        let asked = bench.run("thermyo board emulated info");
        !asked.status.success() && message(&asked).contains("another program")
    });
    signal(&child, "-INT");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", message(&output));
    assert!(!bench.path("out/tune").exists(), "half a result is left");
    let info = bench.vented();
    assert!(info.contains("configuration: tune, "), "{info}");
}

#[test]
fn stops_are_measured_only_when_armed_and_an_interrupt_vents() {
    let bench = configured();
    let measure = "thermyo measure stop emulated --stops 3 --wait 6 --out out/stops --quiet";
    let refused = bench.run(measure);
    assert_eq!(refused.status.code(), Some(2), "{}", message(&refused));
    assert!(message(&refused).contains("not armed"), "{}", message(&refused));
    assert!(!bench.path("out/stops").exists());
    let mut command = bench.command(&format!("{measure} --arm --max-pressure 250000"));
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    until("it has the board", || {
        let asked = bench.run("thermyo board emulated info");
        !asked.status.success() && message(&asked).contains("another program")
    });
    signal(&child, "-INT");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", message(&output));
    bench.vented();
}

#[test]
fn a_joint_whose_set_point_is_interrupted_vents() {
    firmware(Variant::Joint).unwrap();
    let bench = Bench::new();
    let scenario = "scenarios/joint_board.toml";
    bench.ok(&format!("thermyo board emulated plug {scenario}"));
    bench.ok(&format!("thermyo board emulated config write {scenario}"));
    let mut command =
        bench.command("thermyo board emulated set torque 0.5 --stiffness 8 --arm --hold 60");
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    child.stdout.as_mut().unwrap().read_exact(&mut [0]).unwrap();
    signal(&child, "-INT");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", message(&output));
    let stopped = message(&output);
    assert!(
        stopped.starts_with("thermyo: stopped at ") && stopped.contains(" s of 60 s"),
        "{stopped}"
    );
    assert!(String::from_utf8_lossy(&output.stdout).ends_with("; it vents\n"));
    bench.vented();
}

/// A set point that is held for a minute, once its first line is printed.
fn holding(bench: &Bench) -> Child {
    let mut command = bench.command("thermyo board emulated set pressure 130000 --arm --hold 60");
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    child.stdout.as_mut().unwrap().read_exact(&mut [0; 20]).unwrap();
    child
}

/// A program that was killed cannot vent, and those after it only ask.
#[test]
fn a_program_that_asks_keeps_no_set_point_alive() {
    let bench = configured();
    let mut child = holding(&bench);
    signal(&child, "-KILL");
    child.wait().unwrap();
    let info = bench.vented();
    assert!(info.contains("link lost"), "{info}");
}

/// Sends Ctrl-C once this file has more than so many bytes; returns the output.
fn interrupted(mut command: std::process::Command, file: &std::path::Path, bytes: u64) -> Output {
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    until("it records", || fs::metadata(file).is_ok_and(|found| found.len() > bytes));
    signal(&child, "-INT");
    child.wait_with_output().unwrap()
}

#[test]
fn a_drive_that_is_cut_reports_it() {
    let bench = configured();
    let profile = bench.path("held.csv");
    fs::write(&profile, "time_s,pressure_pa\n0,130000\n60,130000\n").unwrap();
    let drive = format!("thermyo board emulated drive {} --arm --out out/drive", profile.display());
    let trace = bench.path("out/drive/unfinished-1/trace.csv");
    let cut = interrupted(bench.command(&drive), &trace, 20_000);
    assert_eq!(cut.status.code(), Some(130), "{}", message(&cut));
    let text = String::from_utf8_lossy(&cut.stdout).into_owned();
    assert!(text.contains(" s of 60 s driven, "), "{text}");
    assert!(message(&cut).contains("thermyo: stopped at "), "{}", message(&cut));
    assert_eq!(format!("{text}{}", message(&cut)).matches("stopped").count(), 1, "{text}");
    let summary = fs::read(bench.path("out/drive/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
    assert_eq!(summary["stopped_of_s"], 60.0, "{summary}");
    assert!((0.01..59.0).contains(&summary["duration_s"].as_f64().unwrap()), "{summary}");
    let report = fs::read_to_string(bench.path("out/drive/report.html")).unwrap();
    assert!(report.contains("Stopped by Ctrl-C: ") && report.contains(" s of 60 s on the board"));
    bench.vented();
}

#[test]
fn a_set_point_that_expires_is_reported() {
    let bench = configured();
    let child = holding(&bench);
    signal(&child, "-INT");
    let cut = child.wait_with_output().unwrap();
    assert_eq!(cut.status.code(), Some(130), "{}", message(&cut));
    assert!(message(&cut).contains(" s of 60 s\n"), "{}", message(&cut));
    let text = String::from_utf8_lossy(&cut.stdout).into_owned();
    assert!(text.contains("it vents") && !text.contains("stopped"), "{text}");
    assert_eq!(message(&cut).matches("stopped").count(), 1, "{}", message(&cut));
    bench.vented();
}

/// A command at a terminal of its own, which accepts keys.
struct AtTerminal {
    child: Child,
    keys: TTYPort,
    /// Stays open while keys are pressed: without it the reads fail.
    _held: TTYPort,
}

impl AtTerminal {
    fn new(mut command: std::process::Command) -> Self {
        let (mut keys, held) = TTYPort::pair().unwrap();
        keys.set_timeout(Duration::from_millis(1)).unwrap();
        let name = held.name().unwrap();
        let terminal = fs::File::options().read(true).write(true).open(name).unwrap();
        command.stdin(terminal.try_clone().unwrap()).stdout(terminal).stderr(Stdio::piped());
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
    // Its refusal has the key that helps.
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

/// Without a time it says how it ends, and a terminal has one line of it.
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
    let output = held.child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", message(&output));
    assert!(message(&output).contains("Ctrl-C ends it, and vents\n"), "{}", message(&output));
    assert!(!message(&output).contains("60"), "{}", message(&output));
    // The readings, in one line again and again, and the sentence at the end.
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
    let unfinished = bench.path("out/monitor/unfinished-1/trace.csv");
    let start = |line: &str| {
        let mut command = bench.command(line);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let child = command.spawn().unwrap();
        until("it records", || fs::metadata(&unfinished).is_ok_and(|found| found.len() > 20_000));
        child
    };
    // As `timeout` sends it.
    let child = start("thermyo monitor emulated --every 10 --quiet --out out/monitor");
    signal(&child, "-TERM");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", message(&output));
    assert!(output.stdout.is_empty(), "{}", String::from_utf8_lossy(&output.stdout));
    assert!(fs::metadata(bench.path("out/monitor/trace.csv")).unwrap().len() > 20_000);
    // A row of every tenth step is no record of every sample, and the message has the option.
    let gaps = bench.refused("thermyo replay out/monitor --out out/again");
    assert!(gaps.contains("`thermyo monitor PORT --every 1`"), "{gaps}");

    let child = start("thermyo monitor emulated --json --out out/monitor");
    bench.ok("thermyo board emulated unplug");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", message(&output));
    assert!(message(&output).contains("the line to the board is gone"), "{}", message(&output));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(json["rows"].as_u64().unwrap() > 20, "{json}");
    assert_the_record_replays(&bench);
}

/// Columns of the joint, the raw samples among them, and its scenario: the record is replayed.
#[test]
fn a_monitor_records_a_joint() {
    let bench = configured_joint();
    let unfinished = bench.path("out/monitor/unfinished-1/joint_trace.csv");
    let mut command = bench.command("thermyo monitor emulated --log mcap --out out/monitor");
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let child = command.spawn().unwrap();
    // For longer than the second after which it prints a line: a row takes 555 bytes.
    until("it records", || fs::metadata(&unfinished).is_ok_and(|found| found.len() > 1_000_000));
    signal(&child, "-TERM");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", message(&output));
    let shown = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(shown.contains(" N m/rad, ") && shown.contains("set point none: it vents"), "{shown}");
    assert!(shown.contains("rows recorded: ") && shown.contains("joint_trace.csv"), "{shown}");
    assert!(bench.path("out/monitor/trace.mcap").exists());
    let replayed = bench.ok("thermyo replay out/monitor --out out/again");
    let (steps, _) = replayed.split_once(" of ").unwrap();
    assert!(steps.parse::<u32>().unwrap() > 20, "{replayed}");
    // Without a start of the core in the record no equal bits are claimed.
    let whole = replayed.contains(" recorded steps replayed, 0 differ");
    assert!(whole || replayed.contains("the record has no start of the core"), "{replayed}");
}

/// A monitor's record begins at any step of the core: it was refused.
fn assert_the_record_replays(bench: &Bench) {
    let rows = fs::read_to_string(bench.path("out/monitor/trace.csv")).unwrap().lines().count() - 1;
    let replayed = bench.ok("thermyo replay out/monitor --out out/again");
    let note = replayed.lines().find(|line| line.contains("replayed from")).expect(&replayed);
    assert!(note.contains(&format!(" of {rows} rows")), "{replayed}");
    let json = bench.ok("thermyo replay out/monitor/trace.csv --json --out out/again");
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
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
    let whole =
        fs::read_to_string(crate::board_support::repository().join("scenarios/contraction.toml"));
    let short = whole.unwrap().replace("duration_s = 5.0", "duration_s = 0.1");
    fs::write(bench.path("short.toml"), short).unwrap();
    // Full during the drive, and when the report is written.
    for (profile, kib, unwritable) in
        [("scenarios/contraction.toml", "100", "trace.csv"), ("short.toml", "50", "report.html")]
    {
        let mut command = std::process::Command::new("bash");
        command
            .arg("-c")
            .arg(
                "trap '' XFSZ; ulimit -f $3; exec \"$0\" board emulated drive \"$1\" --arm --quiet --out \"$2\"",
            )
            .arg(env!("CARGO_BIN_EXE_thermyo"))
            .arg(if profile == "short.toml" { bench.path(profile) } else { PathBuf::from(profile) })
            .arg(bench.path("out/drive"))
            .arg(kib)
            .env("TMPDIR", bench.path(""))
            .current_dir(crate::board_support::repository());
        let output = command.output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", message(&output));
        let said = message(&output);
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

#[test]
fn ports_are_listed_as_json_too() {
    let bench = Bench::new();
    let list: serde_json::Value = serde_json::from_str(&bench.ok("thermyo ports --json")).unwrap();
    assert!(list.is_array(), "{list}");
    assert!(!bench.ok("thermyo ports").is_empty());
}
