//! No data are lost: the record of a killed run can be read, damage is reported and affects only
//! the rows behind it, and no result is overwritten.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use crate::command_support::{Folder, Said, command, thermyo};

const RUN: &str = "[run]\nduration_s = 0.5\nlog_every = 1\n[plant]\nmodel = \"lumped\"\n";

fn name(path: &Path) -> String {
    path.display().to_string()
}

/// A folder with a scenario, and the folder for its results.
fn place(scenario: &str) -> (Folder, String, PathBuf) {
    let folder = Folder::new();
    let file = folder.file("given.toml", scenario);
    let out = folder.path("out");
    (folder, file, out)
}

/// Starts a command and kills it once the file has this many bytes.
fn killed(arguments: &[&str], file: &Path, bytes: u64) {
    let mut child = command(arguments).spawn().unwrap();
    let start = Instant::now();
    while fs::metadata(file).map_or(0, |metadata| metadata.len()) < bytes {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        assert!(start.elapsed() < Duration::from_secs(180), "{}: nothing comes", file.display());
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
}

#[test]
fn a_killed_run_is_replayed_to_its_last_row() {
    let (_folder, scenario, out) = place(&RUN.replace("0.5", "100000.0"));
    let trace = out.join("unfinished-1/trace.csv");
    killed(&["run", &scenario, "--quiet", "--out", &name(&out)], &trace, 400_000);
    let text = fs::read_to_string(&trace).unwrap();
    let rows = text.matches('\n').count() - 1;
    assert!(rows > 900, "{rows} rows");
    let replay = ["replay", &name(&trace), "--json", "--out", &name(&out.join("replay"))];
    let Said { out: printed, err, .. } = thermyo(&replay).ok();
    assert!(printed.contains(&format!("\"steps\": {rows}")), "{rows} rows, {printed}");
    assert_eq!(err.is_empty(), text.ends_with('\n'), "{err}");
}

#[test]
fn a_killed_sweep_goes_on_where_it_was() {
    let (folder, scenario, out) = place("[run]\nduration_s = 10.0\n[plant]\nmodel = \"lumped\"\n");
    let unfinished = out.join("unfinished-1");
    let table = unfinished.join("sweep.csv");
    let seeds = ["sweep", &scenario, "--quiet", "--vary", "run.seed=1:300:300"];
    let out_name = name(&out);
    let arguments = [&seeds[..], &["--out", &out_name]].concat();
    killed(&arguments, &table, 5000);
    let text = fs::read_to_string(&table).unwrap();
    let done = text.matches('\n').count() - 1;
    assert!((10..290).contains(&done), "{text}");
    // As if the sweep had been killed within a row.
    fs::write(&table, &text[..text.len() - 5]).unwrap();

    // Another process at work is not disturbed.
    let begun = fs::File::open(unfinished.join("begun.txt")).unwrap();
    begun.lock().unwrap();
    thermyo(&arguments).refused("unfinished-1: another thermyo is at work");
    drop(begun);

    // Another sweep in the same folder is separate.
    let other = ["sweep", &scenario, "--quiet", "--vary", "run.seed=1:2:2", "--out", &out_name];
    assert_eq!(thermyo(&other).ok().err, "");
    assert!(table.exists());

    let kept =
        format!("{} of 300 points were done and are kept; at work when it ended: point ", done - 1);
    thermyo(&arguments).ok().says(&kept).says("(run.seed = ");
    assert!(!unfinished.exists(), "begun.txt or more is left");
    let whole = folder.path("whole");
    thermyo(&[&seeds[..], &["--out", &name(&whole)]].concat()).ok();
    for file in ["sweep.csv", "summary.json", "report.html", "study.json"] {
        let [resumed, at_once] = [&out, &whole].map(|folder| fs::read(folder.join(file)).unwrap());
        assert!(resumed == at_once, "{file}");
    }
}

/// A record that is sent to somebody comes without the profile and the load, whose set points it contains.
#[test]
fn a_record_is_replayed_without_the_files_of_its_drive() {
    let folder = Folder::new();
    folder.file("value.csv", "time_s,value\n0,150000\n0.2,250000\n0.3,200000\n");
    folder.file("duty.csv", "time_s,duty\n0,0.1\n0.2,0.3\n0.3,-0.2\n");
    folder.file("course.csv", "time_s,angle_rad,stiffness_n_m_rad\n0,0.2,14\n0.3,0.4,12\n");
    folder.file("load.csv", "time_s,torque_n_m\n0,0\n0.4,1\n");
    // Angle 0 is beyond these stops, and the angle's sensor never works.
    let joint = "[joint]\nminimum_rad = 0.1\n[joint.a.faults]\nlength = \"open\"\n[drive]\n\
                 profile_csv = \"course.csv\"\nload_csv = \"load.csv\"\n";
    let drives = [
        ("muscle", "[drive]\nkind = \"pressure\"\nprofile_csv = \"value.csv\"\n"),
        ("duty", "[drive]\nkind = \"duty\"\nprofile_csv = \"duty.csv\"\n"),
        ("joint", joint),
    ];
    let run = |drive: &str, out: &str| {
        let file = folder.file("given.toml", &format!("{RUN}{drive}"));
        thermyo(&["run", &file, "--quiet", "--out", &folder.name(out)])
    };
    for (name, drive) in drives {
        run(drive, name).ok();
    }
    for file in ["value.csv", "duty.csv", "course.csv", "load.csv"] {
        fs::remove_file(folder.path(file)).unwrap();
    }
    for (name, drive) in drives {
        let replay = ["replay", &folder.name(name), "--out", &folder.name("again")];
        let Said { out: printed, .. } = thermyo(&replay).ok();
        assert!(printed.contains("501 of 501 recorded steps replayed, 0 differ"), "{printed}");
        run(drive, "none").refused("drive.profile_csv: ").refused("no such file");
    }
}

/// A result that was moved once needed the tables of its scenario, by the path that they had had.
#[test]
fn a_result_has_the_tables_of_its_scenario() {
    let folder = Folder::new();
    let tables = [
        ("volume.csv", "time_s,volume_m3\n0,0.001\n0.5,0.0012\n"),
        (
            "pulley.csv",
            "angle_rad,radius_a_m,radius_b_m\n-1,0.018,0.022\n0,0.02,0.02\n1,0.022,0.018\n",
        ),
        ("course.csv", "time_s,angle_rad,stiffness_n_m_rad\n0,0.2,14\n0.3,0.4,12\n"),
        ("load.csv", "time_s,torque_n_m\n0,0\n0.4,1\n"),
        ("value.csv", "time_s,value\n0,150000\n0.2,250000\n"),
        ("bellows.csv", include_str!("../../scenarios/bellows.csv")),
    ];
    for (name, text) in tables {
        folder.file(name, text);
    }
    let bellows = "kind = \"table\"\n[table]\ncsv = \"bellows.csv\"\n[load]\nkind = \"isotonic\"\nforce_n = -40.0\n";
    let scenarios = [
        ("vessel", "kind = \"vessel\"\n[vessel]\nvolume_csv = \"volume.csv\"\n".to_owned()),
        (
            "bellows",
            format!("{bellows}[drive]\nkind = \"pressure\"\nprofile_csv = \"value.csv\"\n"),
        ),
        (
            "joint",
            "[joint]\nradius_csv = \"pulley.csv\"\n[drive]\nprofile_csv = \"course.csv\"\nload_csv = \"load.csv\"\n"
                .to_owned(),
        ),
    ];
    for (name, scenario) in &scenarios {
        let file = folder.file("given.toml", &format!("{RUN}{scenario}"));
        thermyo(&["run", &file, "--quiet", "--out", &folder.name(name)]).ok();
    }
    for (name, _) in tables {
        fs::remove_file(folder.path(name)).unwrap();
    }
    for (name, _) in &scenarios {
        let moved = folder.name(&format!("moved_{name}"));
        fs::rename(folder.path(name), &moved).unwrap();
        let Said { out: printed, .. } =
            thermyo(&["replay", &moved, "--out", &folder.name("again")]).ok();
        assert!(printed.contains("501 of 501 recorded steps replayed, 0 differ"), "{printed}");
        let scenario = format!("{moved}/scenario.toml");
        let out = folder.name(&format!("second_{name}"));
        thermyo(&["run", &scenario, "--quiet", "--out", &out]).ok();
        let trace = if *name == "joint" { "joint_trace.csv" } else { "trace.csv" };
        let [first, second] =
            [&moved, &out].map(|place| fs::read_to_string(Path::new(place).join(trace)).unwrap());
        assert!(first == second, "{name}");
    }
}

#[test]
fn a_damaged_record_is_read_up_to_the_damage() {
    let (_folder, scenario, out) = place(RUN);
    thermyo(&["run", &scenario, "--out", &name(&out)]).ok();
    let trace = out.join("trace.csv");
    let whole = fs::read(&trace).unwrap();
    let ends: Vec<usize> = (0..whole.len()).filter(|i| whole[*i] == b'\n').collect();
    assert_eq!(ends.len(), 502);

    let mut torn = whole.clone();
    // Cut within the last number of row 300, which without its last digits is still a number.
    torn.truncate(ends[300] - 1);
    let mut holed = whole.clone();
    holed[ends[200] + 5..ends[205]].fill(0);
    let mut burnt = whole.clone();
    burnt[ends[100] + 3] = 0xff;
    for (bytes, rows, message, lost) in [
        (torn, 299, "trace.csv:301: the last line has no end: it may be cut; ", ""),
        (
            holed,
            200,
            "trace.csv:202: 2 cells in this row: must be 37, one per column; ",
            ", without the 296 lines behind it",
        ),
        (burnt, 100, "trace.csv:102: is not UTF-8 text; ", ", without the 400 lines behind it"),
    ] {
        fs::write(&trace, bytes).unwrap();
        let again = out.join("again");
        let measured = ["run", &scenario, "--measured", &name(&trace), "--out", &name(&again)];
        let replayed = ["replay", &name(&trace), "--json", "--out", &name(&out.join("replay"))];
        for (arguments, printed) in [
            (&replayed[..], format!("\"steps\": {rows}")),
            (&measured[..], "measured pressure_pa: RMS difference".to_owned()),
        ] {
            let output = thermyo(arguments).ok();
            let expected = format!("{message}read up to there: {rows} rows{lost}");
            let first = output.err.lines().next().unwrap_or_default();
            assert!(first.ends_with(&expected), "{arguments:?}: {first}");
            assert!(output.out.contains(&printed), "{arguments:?}");
        }
    }

    // A table without rows is no record.
    fs::write(&trace, &whole[..ends[0] + 20]).unwrap();
    let output = thermyo(&["replay", &name(&trace), "--out", &name(&out.join("none"))]);
    assert!(!out.join("none").exists());
    output.refused("trace.csv:2: the last line has no end");
}

#[test]
fn identify_uses_whole_rows_and_refuses_impossible_values() {
    let closed = "[plant]\nkind = \"vessel\"\n[drive]\nkind = \"closed\"\n[identify]\nstarts = 1\n\
                  parameters = [\"heat.scale\"]\n";
    let (folder, config, out) = place(closed);
    let rows: String = (0..50).map(|i| format!("{i},{}\n", 5.0e5 - 1.0e3 * f64::from(i))).collect();
    let identify = |text: &str| {
        let (data, out) = (folder.file("data.csv", text), name(&out));
        thermyo(&["identify", &data, "--config", &config, "--out", &out, "--quiet"])
    };
    let Said { code, err, .. } = identify(&format!("time_s,pressure_pa\n{rows}50,4500"));
    let expected =
        "data.csv:52: the last line has no end: it may be cut; read up to there: 50 rows";
    assert!(code != Some(2) && err.lines().next().unwrap().ends_with(expected), "{err}");

    // The truncated line used to be named beside the missing column.
    identify("pressure_pa,sensor_gas_k\n5e5,300\n4e5,29")
        .refused("data.csv: column time_s is missing")
        .in_one_line();

    // A pressure of 4.5, given in bar.
    let expected = "data.csv:52: column pressure_pa = 4.5: must be a number from 1000 to 1e8 Pa";
    identify(&format!("time_s,pressure_pa\n{rows}50,4.5\n51,4.4\n")).refused(expected);
}

/// A fit to the rows before the damage would meet any target.
#[test]
fn published_data_that_are_damaged_are_refused() {
    let rows: String = (0..9).map(|i| format!("{i},{},0.003\n", 780_000 + i)).collect();
    let spring = format!("time_s,pressure_pa,volume_m3\n{rows}");
    let map = "rest_length_m,gauge_pressure_pa,length_m,force_n\n0.25,600000,0.25,497\n0.25,200000,0.25,145\n\
               0.25,600000,0.236,356\n0.25,200000,0.236,78\n0.25,600000,0.207,120\n";
    let (spring_csv, map_csv) = ("gas_spring/upper_2022-01-28.csv", "muscle_static/five.csv");
    let vessel_csv = "dynamic/vessel_a.csv";
    for (file, text, message) in [
        (
            spring_csv,
            spring.replace("5,780005", "%&,780005"),
            ".csv:7: column time_s = %&: must be a finite number",
        ),
        (
            spring_csv,
            spring.trim_end().to_owned(),
            ".csv:10: the last line has no end: it may be cut",
        ),
        (
            "hyddown/air_discharge.csv",
            "time_s,pressure_pa\n0,8e5\n1\n".to_owned(),
            ".csv:3: 1 cells in this row: must be 2, one per column",
        ),
        (map_csv, map.trim_end().to_owned(), ".csv:6: the last line has no end: it may be cut"),
        (
            map_csv,
            map.to_owned(),
            "five.csv: 5 readings with a force above 1 % of the largest: must be at least 6; five are fitted, the \
             others compared",
        ),
        (
            vessel_csv,
            "time_s,pressure_pa\n0,7e5\n5,6.9e5\n".to_owned(),
            "a.csv: column time_s: 0 rows from 15.0 s on: must be 10 or more",
        ),
        (
            vessel_csv,
            "time_s,pressure_pa\n0,700\n50,690\n".to_owned(),
            "a.csv:2: column pressure_pa = 700.0: must be absolute and in Pa, and at least 20000 somewhere: is this kPa?",
        ),
        (
            vessel_csv,
            "time_s,pressure_pa\n0,7e5\n50,6.9e5\n40,6.8e5\n".to_owned(),
            "a.csv:4: column time_s = 40.0: must be later than the row before it, at 50.0 s",
        ),
        (
            "dynamic/antagonist_5050.csv",
            "time_s,force_command_n,length_1_m,length_2_m,pressure_1_pa,pressure_2_pa\n0,1,0.2,0.2,3e5,3e5\n".to_owned(),
            "_5050.csv: column time_s: 0 rows before its last 9.0 s, which are compared: must be 10 or more",
        ),
        (
            vessel_csv,
            "time_s,pressure_pa\n0,7e5\n15000,6.9e5\n30000,6.8e5\n".to_owned(),
            "a.csv:3: column time_s = 15000.0: must be at most 10.0 s after the row before it, which shows a leak: is \
             this ms, or are rows left out?",
        ),
        (
            "hyddown/air_discharge.csv",
            "time_s,pressure_pa\n0,8e5\n1,7e5\n2,6e5\n".to_owned(),
            "air_discharge.csv: column sensor_gas_k is missing, or empty in every row",
        ),
        (
            spring_csv,
            "time_s,pressure_pa,volume_m3\n0,8e5,\n1,7e5,\n2,6e5,\n".to_owned(),
            "2022-01-28.csv: column volume_m3 is missing, or empty in every row",
        ),
        (
            "dynamic/cylinder_o-ring257_1bar.csv",
            "length_m,pressure_pa,force_n\n0,2e5,1\n1,2e5,2\n2,2e5,3\n".to_owned(),
            "cylinder_o-ring257_3bar.csv: no such file",
        ),
        (
            "muscle_static/equal.csv",
            map_of(&|_, _| 100.0),
            "equal.csv: the muscle found in it cannot be driven: the core refuses its configuration: muscle.slack_m",
        ),
        (
            "notes.txt",
            String::new(),
            "there is no muscle_static/*.csv, gas_spring/upper_2022-01-28.csv,",
        ),
    ] {
        let folder = Folder::new();
        fs::create_dir_all(folder.path(file).parent().unwrap()).unwrap();
        folder.file(file, &text);
        let output = thermyo(&["evaluate", "truth", &folder.name(""), "--quiet"]);
        output.refused(message).in_one_line();
    }
    let folder = Folder::new();
    fs::create_dir(folder.path("dynamic")).unwrap();
    let in_and_out: String = [0, 1, 2, 3, 2, 1, 0].map(|m| format!("{m},201325,1\n")).concat();
    for bar in [1, 3, 5, 7] {
        let text = format!("length_m,pressure_pa,force_n\n{in_and_out}");
        folder.file(&format!("dynamic/cylinder_o-ring257_{bar}bar.csv"), &text);
    }
    thermyo(&["evaluate", "truth", &folder.name("")])
        .refused("_7bar.csv: column pressure_pa: 100000 Pa above ambient in the mean: must be above the 100000 Pa")
        .in_one_line();
    let folder = Folder::new();
    fs::create_dir(folder.path("motion")).unwrap();
    folder.file("motion.csv", "");
    folder.file("motion/a.CSV", "time_s,length_m,pressure_pa\n0,0.25,1e5\n");
    folder.file("motion/a.toml", "[plant]\nkind = \"cylinder\"\n[load]\nforce_n = -100\n");
    for (name, message) in [
        ("motion.csv", "is a file; a folder is needed"),
        ("absent", "absent: no such file"),
        ("", "plant.kind = \"cylinder\": must be \"muscle\" for a record of motion"),
    ] {
        thermyo(&["evaluate", "truth", &folder.name(name)]).refused(message).in_one_line();
    }
    // A part at rest used to be fitted, or to be held out with 0 N.
    for (from, to, part) in [(0, 40, "last four"), (60, 100, "first six")] {
        let row = |i: i32| {
            let up = f64::from((i - from).clamp(0, to - from));
            format!("{},{},{}\n", 0.02 * f64::from(i), 0.25 - 2e-4 * up, 1e5 + 4e3 * up)
        };
        let text: String = (0..100).map(row).collect();
        let folder = Folder::new();
        fs::create_dir(folder.path("motion")).unwrap();
        folder.file("motion/a.csv", &format!("time_s,length_m,pressure_pa\n{text}"));
        let message = format!("a.csv: column length_m: in the {part} tenths, which are ");
        thermyo(&["evaluate", "truth", &folder.name("")]).refused(&message).in_one_line();
    }
}

/// Twelve readings of a muscle, up to 5.4 bar.
fn map_of(force_n: &dyn Fn(f64, f64) -> f64) -> String {
    let row = |i: u32| {
        let (gauge_pa, length_m) = (1e5 + 4e4 * f64::from(i), 0.2 + 0.004 * f64::from(i));
        format!("0.25,{gauge_pa},{length_m},{}\n", force_n(gauge_pa, length_m))
    };
    let rows = (0..12).map(row).collect::<String>();
    format!("rest_length_m,gauge_pressure_pa,length_m,force_n\n{rows}")
}

#[test]
fn absolute_pressures_of_a_published_map_are_asked_about() {
    let folder = Folder::new();
    fs::create_dir(folder.path("muscle_static")).unwrap();
    let map = map_of(&|gauge_pa, length_m| 2e-3 * gauge_pa * (length_m - 0.17))
        + "0.25,701325,0.25,110\n";
    folder.file("muscle_static/a.csv", &map);
    thermyo(&["evaluate", "truth", &folder.name("")]).says(
        "a.csv: line 14: a gauge pressure of 701325 Pa is above the 598675 Pa that supply.pressure_pa gives: if the \
         pressures are absolute, subtract the ambient one.",
    );
}

#[test]
fn a_result_is_never_overwritten() {
    let (_folder, scenario, out) = place(RUN);
    let read = |file: &str| fs::read_to_string(out.join(file)).unwrap();
    let run = |seed: &str| {
        fs::write(&scenario, RUN.replace("0.5", &format!("0.5\nseed = {seed}"))).unwrap();
        thermyo(&["run", &scenario, "--out", &name(&out)])
    };
    assert_eq!(run("1").err, "");
    let (first, summary) = (read("trace.csv"), read("summary.json"));

    // A failed run leaves the earlier result in place.
    run("\"x\"").ends(2);
    assert_eq!(read("trace.csv"), first);

    run("2").ok().says("the earlier result in ").says("/earlier-1").in_one_line();
    assert_ne!(read("trace.csv"), first);
    assert_eq!((read("earlier-1/trace.csv"), read("earlier-1/summary.json")), (first, summary));
    assert!(read("earlier-1/scenario.toml").contains("seed = 1 "));
    assert!(read("scenario.toml").contains("seed = 2 "));
    assert!(read("report.html").len() > 1000 && read("earlier-1/report.html").len() > 1000);
    // An earlier result is a record like any other.
    let trace = name(&out.join("earlier-1/trace.csv"));
    thermyo(&["replay", &trace, "--out", &name(&out.join("replay"))]).ok();
}

#[test]
fn a_result_does_not_move_its_record() {
    let (_folder, scenario, out) = place(RUN);
    let [record, trace] = [name(&out), name(&out.join("trace.csv"))];
    thermyo(&["run", &scenario, "--quiet", "--out", &record]).ok();
    for arguments in [
        &["compare", &record, &trace][..],
        &["replay", &record],
        &["identify", &trace, "--config", &scenario],
    ] {
        let refused = thermyo(&[arguments, &["--out", &record]].concat());
        refused.refused("is the record itself: give another folder").in_one_line();
    }
    assert!(out.join("trace.csv").exists() && !out.join("earlier-1").exists());
}

#[test]
fn a_scenario_of_the_user_is_not_moved_with_an_earlier_result() {
    let folder = Folder::new();
    let scenario = folder.scenario(RUN);
    let run = thermyo(&["run", &scenario, "--out", &folder.name("")]);
    run.refused("scenario.toml: belongs to no earlier result").in_one_line();
    assert_eq!(folder.read("scenario.toml"), RUN);
    assert_eq!(folder.path("").read_dir().unwrap().count(), 1);
}

#[test]
fn a_monitor_that_finds_no_board_leaves_the_last_recording() {
    let folder = Folder::new();
    folder.file("trace.csv", "time_s\n1\n");
    folder.file("config.json", "[]\n");
    let output = thermyo(&["monitor", "/dev/no-such-port", "--out", &folder.name("")]);
    output.refused("/dev/no-such-port");
    assert_eq!(folder.read("trace.csv"), "time_s\n1\n");
    assert_eq!(fs::read_dir(folder.path("")).unwrap().count(), 2, "something else is left");
}

/// The joint's trace has another name, and would be taken for that of the run beside it.
#[test]
fn the_trace_of_a_joint_moves_with_its_result() {
    let (folder, scenario, out) = place(RUN);
    let joint = include_str!("../../scenarios/joint.toml");
    let joint = joint.replace("duration_s = 6.0", "duration_s = 0.1");
    let joint = folder.file("joint.toml", &joint);
    for scenario in [&joint, &scenario] {
        thermyo(&["run", scenario, "--out", &name(&out)]).ok();
    }
    assert!(!out.join("joint_trace.csv").exists());
    assert!(out.join("earlier-1/joint_trace.csv").exists());
}

/// A limit on the size of files, in KiB, simulates a full disk.
#[cfg(unix)]
fn on_a_full_disk(most_kib: u32, arguments: &[&str]) -> Said {
    let output = Command::new("bash")
        .arg("-c")
        .arg(format!("trap '' XFSZ; ulimit -f {most_kib}; exec \"$0\" \"$@\""))
        .arg(env!("CARGO_BIN_EXE_thermyo"))
        .args(arguments)
        .output();
    Said::of("on a full disk", output.unwrap())
}

#[cfg(unix)]
#[test]
fn a_full_disk_leaves_no_half_of_a_single_file() {
    let folder = Folder::new();
    let file = folder.name("mine.toml");
    let rig =
        "--muscle dmsp-10 --valve mhe2-class --pressure-sensor hsc-150psi-a --load 5 --supply 7bar";
    let arguments: Vec<&str> = ["init", "--out", &file].into_iter().chain(rig.split(' ')).collect();
    on_a_full_disk(0, &arguments).refused("mine.toml: cannot be written").in_one_line();
    assert!(!folder.has("mine.toml"), "it would be refused as one that exists already");
}

#[cfg(unix)]
#[test]
fn a_full_disk_leaves_the_earlier_result() {
    let (_folder, scenario, out) = place(RUN);
    thermyo(&["run", &scenario, "--out", &name(&out)]).ok();
    let first = fs::read_to_string(out.join("summary.json")).unwrap();
    fs::write(&scenario, RUN.replace("0.5", "20.0")).unwrap();
    let full = on_a_full_disk(300, &["run", &scenario, "--out", &name(&out)]);
    full.refused("out/trace.csv: cannot be written").in_one_line();
    assert_eq!(fs::read_to_string(out.join("summary.json")).unwrap(), first);
    assert_eq!(fs::read_dir(&out).unwrap().count(), 4, "something half is left");
}
