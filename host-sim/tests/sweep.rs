//! `thermyo sweep` on the command line: every point equals the run of a file with its values.

use std::fs;
use std::path::{Path, PathBuf};

use crate::command_support::{Folder, Said, in_process as thermyo};

const SCENARIO: &str = "[run]\nduration_s = 4.0\nlog_every = 1\n[plant]\nmodel = \"full\"\n\
                        [muscle]\nzones = 4\n[drive]\nperiod_s = 1.0\n";
const GRID: [&str; 4] =
    ["--vary", "sensor.gas.time_constant_s=0.5:3.0:2", "--vary", "sensor.gas.position=0.25:1:2"];

/// Runs a sweep that has to succeed; returns its table.
fn sweep(scenario: &str, arguments: &[&str], out: &Path) -> String {
    let out_text = out.display().to_string();
    let all = [&["sweep", scenario, "--quiet", "--out", &out_text], arguments].concat();
    assert_eq!(thermyo(&all).ok().err, "", "{arguments:?}");
    fs::read_to_string(out.join("sweep.csv")).unwrap()
}

fn cells(line: &str) -> Vec<f64> {
    line.split(',').filter(|cell| !cell.is_empty()).map(|cell| cell.parse().unwrap()).collect()
}

fn read(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).unwrap()
}

/// RMS errors of gas sensor, wall sensor, model and estimate, and the share within two standard
/// deviations, from a trace's second half.
fn figures(trace: &str) -> [f64; 5] {
    let mut lines = trace.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let columns =
        ["sensor_gas_k", "sensor_wall_k", "model_k", "estimate_k", "gas_temperature_k", "time_s"]
            .map(|name| names.iter().position(|other| *other == name).unwrap());
    let deviation = names.iter().position(|name| *name == "estimate_sd_k").unwrap();
    let rows: Vec<Vec<f64>> = lines.map(cells).filter(|row| row[columns[5]] >= 2.0).collect();
    let count = rows.len() as f64;
    let error = |row: &Vec<f64>, column: usize| row[column] - row[columns[4]];
    let rms = |column: usize| {
        (rows.iter().map(|row| error(row, column).powi(2)).sum::<f64>() / count).sqrt()
    };
    let within = rows.iter().filter(|row| error(row, columns[3]).abs() <= 2.0 * row[deviation]);
    let [gas, wall, model, estimate, ..] = columns;
    [rms(gas), rms(wall), rms(model), rms(estimate), within.count() as f64 / count]
}

#[test]
fn every_point_is_the_run_that_the_file_would_give() {
    let folder = Folder::new();
    // The core's sensor follows the plant's, unless the file states otherwise.
    let scenario = folder.scenario(SCENARIO);
    let out = folder.path("out");
    let table = sweep(&scenario, &GRID, &out);
    let mut lines = table.lines();
    assert_eq!(
        lines.next().unwrap(),
        "point,sensor.gas.time_constant_s,sensor.gas.position,seed,settled_s,sensor_gas_rmse_k,\
         sensor_wall_rmse_k,model_rmse_k,estimate_rmse_k,estimate_within_2sd,\
         control_rms_error,overshoot,settling_s,unsettled,bandwidth_hz,limit_cycle_hz,limit_cycle_amplitude,\
         pulses_per_s,failure,checksum"
    );
    let rows: Vec<Vec<f64>> = lines.map(cells).collect();
    let expected = [[0.5, 0.25], [0.5, 1.0], [3.0, 0.25], [3.0, 1.0]];
    assert_eq!(rows.len(), expected.len());
    for (i, (row, [lag, position])) in rows.iter().zip(expected).enumerate() {
        assert_eq!(row[..5], [i as f64 + 1.0, lag, position, 1.0, 2.0]);
        let written =
            format!("{SCENARIO}[sensor.gas]\ntime_constant_s = {lag:?}\nposition = {position:?}\n");
        let single = folder.file("single.toml", &written);
        let place = folder.name("single");
        thermyo(&["run", &single, "--quiet", "--out", &place]).ok();
        let trace = fs::read_to_string(Path::new(&place).join("trace.csv")).unwrap();
        for (swept, run) in row[5..].iter().zip(figures(&trace)) {
            assert!((swept - run).abs() <= 1e-12 * run.abs(), "point {i}: {swept} and {run}");
        }
    }
    // Position and lag must both matter, or the comparison shows nothing.
    assert!(rows.iter().skip(1).all(|row| (row[5] / rows[0][5] - 1.0).abs() > 1e-3), "{table}");

    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("Within 1 K RMS") && page.contains("<svg"), "no map");
    assert!(!["src=", "<link", "<script"].iter().any(|text| page.contains(text)), "not by itself");
    let scenario = fs::read_to_string(out.join("scenario.toml")).unwrap();
    assert!(scenario.contains("zones = 4"), "{scenario}");
}

/// The figures by which a gain is chosen, and what an error of the inertia does to them.
#[test]
fn the_figures_of_the_loop_are_in_the_table() {
    let folder = Folder::new();
    let text = "[run]\nduration_s = 6\n[plant]\nmodel = \"lumped\"\ninitial_pressure_pa = 290000\n[joint]\n\
                friction_n_m = 0.0\n[joint.controller]\ngain_n_m_rad = 40\n\
                [drive]\nshape = \"step\"\namplitude_rad = 0.3\nperiod_s = 4\n";
    let scenario = folder.file("joint.toml", text);
    let out = folder.path("out");
    let table = sweep(&scenario, &["--vary", "believed.joint.inertia_kg_m2=0.02,0.05"], &out);
    let mut lines = table.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let place = |name: &str| names.iter().position(|other| *other == name).unwrap();
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    let cell = |row: usize, name: &str| rows[row][place(name)].parse::<f64>().ok();
    assert!((0.05..1.0).contains(&cell(0, "settling_s").unwrap()), "{table}");
    assert!((0.0..0.2).contains(&cell(0, "overshoot").unwrap()), "{table}");
    assert_eq!([0, 1].map(|row| cell(row, "limit_cycle_hz").is_some()), [false, true], "{table}");
    assert!((0.01..0.3).contains(&cell(1, "limit_cycle_amplitude").unwrap()), "{table}");
    assert_eq!(cell(0, "bandwidth_hz"), None);
    assert!(read(&out, "report.html").contains(" 1 of 2 points have a limit cycle."));
}

/// Keys of the joint, of one muscle, and of both; each row has the figures of a run of the joint.
#[test]
fn a_joint_is_swept() {
    let folder = Folder::new();
    let text = "[run]\nduration_s = 1\n[plant]\nmodel = \"lumped\"\ninitial_pressure_pa = 290000\n\
                [joint]\n[drive]\nshape = \"sine\"\namplitude_rad = 0.2\n";
    let scenario = folder.file("joint.toml", text);
    let out = folder.path("out");
    let keys = [
        "--vary",
        "joint.inertia_kg_m2=0.01,0.03",
        "--vary",
        "joint.b.muscle.bladder_stiffness_n_m=700,900",
    ];
    let table = sweep(&scenario, &keys, &out);
    let mut lines = table.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 4);
    let cell = |row: usize, name: &str| {
        let place =
            names.iter().position(|other| *other == name).unwrap_or_else(|| panic!("{name}"));
        rows[row][place].parse::<f64>().unwrap_or(f64::NAN)
    };
    let written = format!(
        "{}[joint.b.muscle]\nbladder_stiffness_n_m = 700\n",
        text.replace("[joint]\n", "[joint]\ninertia_kg_m2 = 0.03\n")
    );
    let single = folder.file("single.toml", &written);
    let place = folder.name("single");
    thermyo(&["run", &single, "--quiet", "--out", &place]).ok();
    let summary = folder.json("single/summary.json");
    for (column, key) in [
        ("control_rms_error", "rms_error_rad"),
        ("end_error_rad", "end_error_rad"),
        ("rms_stiffness_error", "rms_stiffness_error"),
        ("pulses_per_s", "pulses_per_s"),
        ("limited", "limited"),
    ] {
        assert_eq!(Some(cell(2, column)), summary[key].as_f64(), "{column}");
    }
    assert_eq!(summary["highest_pressure_pa"][1].as_f64(), Some(cell(2, "highest_pressure_b_pa")));
    assert!(cell(0, "vented_s").is_nan() && cell(0, "model_rmse_k").is_nan(), "{table}");
    assert!(cell(0, "estimate_rmse_k") > 0.01 && cell(0, "estimate_rmse_k") < 5.0, "{table}");
    let page = read(&out, "report.html");
    assert!(page.contains("The set point is followed to ") && page.contains(" deg RMS at best"));
    // The page had a map of the temperatures only, and columns of methods that a joint does not have.
    assert!(page.contains(">Set point</h2>") && page.contains(">Tracking<"), "no map of the angle");
    assert!(!page.contains("not run") && !page.contains("forward model"), "not a joint's methods");

    let shard = |part: &str| {
        let out = folder.path(&part.replace('/', "-"));
        sweep(&scenario, &[&keys[..], &["--shard", part]].concat(), &out);
        out.display().to_string()
    };
    let (whole, parts) = (folder.path("whole"), [shard("1/2"), shard("2/2")]);
    let whole_text = whole.display().to_string();
    let merge = ["sweep", "--merge", &parts[0], &parts[1], "--quiet", "--out", &whole_text];
    thermyo(&merge).ok();
    assert_eq!(read(&whole, "sweep.csv"), table);
    for (vary, message) in [
        ("joint.radus_m=1,2", "unknown key joint.radus_m; did you mean joint.radius_m?"),
        ("joint.radius_m=0.02,0.4", "joint.mid_length_a_m"),
        ("load.force_n=1,2", "[load] is not used"),
    ] {
        let swept = thermyo(&["sweep", &scenario, "--vary", vary, "--quiet"]);
        swept.refused(message).in_one_line();
    }
}

#[test]
fn a_sweep_with_a_set_point_has_its_tracking_error() {
    let folder = Folder::new();
    let text = "[run]\nduration_s = 2\n[drive]\nkind = \"contraction\"\nshape = \"sine\"\n\
                amplitude = \"2 %\"\n";
    let scenario = folder.scenario(text);
    let out = folder.path("out");
    let table = sweep(&scenario, &["--vary", "drive.period_s=250ms,2s"], &out);
    let errors: Vec<f64> = table.lines().skip(1).map(|line| cells(line)[9]).collect();
    assert!(errors.len() == 2 && errors[0] > 1e-3 && errors[0] != errors[1], "{table}");
    let summary = fs::read_to_string(out.join("summary.json")).unwrap();
    let sentence = " The set point is followed to ";
    assert!(summary.contains(sentence) && summary.contains(" % of rest length RMS at best"));
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains(">list<") && !page.contains(">linear<"), "values of a list");
}

/// A study in three shards.
struct Shards {
    folder: Folder,
    scenario: String,
    places: [String; 3],
}

impl Shards {
    const GRID: [&str; 4] =
        ["--vary", "believed.heat.scale=0.5:1.3:4:log", "--vary", "run.seed=1:3:3"];

    fn new() -> Self {
        let folder = Folder::new();
        let scenario = folder.scenario(
            "[run]\nduration_s = 1.0\n[plant]\nmodel = \"lumped\"\n[believed.heat]\nscale = 0.7\n",
        );
        let places = ["a", "b", "c"].map(|name| folder.name(name));
        for (shard, place) in ["1/3", "2/3", "3/3"].iter().zip(&places) {
            let own = [&Self::GRID[..], &["--shard", shard]].concat();
            assert_eq!(sweep(&scenario, &own, Path::new(place)).lines().count(), 5);
        }
        Self { folder, scenario, places }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path(name)
    }

    /// Merges the shards into `merged`.
    fn merge(&self, places: &[&str]) -> Said {
        let merged = self.path("merged").display().to_string();
        thermyo(&[&["sweep", "--merge"], places, &["--out", &merged]].concat())
    }

    fn merge_all(&self) -> Said {
        self.merge(&self.places.each_ref().map(String::as_str))
    }
}

#[test]
fn shards_add_up_to_the_whole_to_the_byte() {
    let shards = Shards::new();
    let whole = sweep(&shards.scenario, &Shards::GRID, &shards.path("whole"));
    assert_eq!(whole.lines().count(), 13);
    let merged = shards.path("merged");
    let [a, b, c] = shards.places.each_ref().map(String::as_str);

    let missing = "4 of 12 points are missing: point 2 (believed.heat.scale = 0.5, run.seed = 2), ";
    shards.merge(&[a, c]).refused(missing).says(" and 1 more");
    assert!(!merged.exists(), "something was written");

    assert_eq!(shards.merge(&[c, a, b]).ok().err, "");
    for name in ["sweep.csv", "summary.json", "report.html", "scenario.toml", "study.json"] {
        assert!(read(&merged, name) == read(&shards.path("whole"), name), "{name}");
    }
    let reports = [a, merged.to_str().unwrap()].map(|place| read(Path::new(place), "report.html"));
    assert_eq!(reports.map(|page| page.contains("Shard 1/")), [true, false]);

    let other = shards.path("other");
    sweep(&shards.scenario, &["--vary", "run.seed=1:3:3"], &other);
    let other = other.display().to_string();
    for (places, message) in [
        ([a, other.as_str()], "not the same sweep as in"),
        ([a, &shards.scenario], "no folder of a sweep"),
    ] {
        shards.merge(&places).refused(message);
    }
}

/// A folder with a damaged label is not skipped: its points would be reported as missing.
#[test]
fn a_damaged_label_of_a_shard_is_reported() {
    let shards = Shards::new();
    let label = shards.path("b/study.json");
    let text = fs::read_to_string(&label).unwrap();
    for cut in [text[..text.len() / 2].to_owned(), text.replace("run.seed=1:3:3", "run.seed")] {
        fs::write(&label, cut).unwrap();
        let [a, b, c] = shards.places.each_ref().map(String::as_str);
        let err = shards.merge(&[b, a, c]).ends(2).err;
        let expected = format!("thermyo: {}: is damaged (", label.display());
        assert!(err.starts_with(&expected), "{err}");
    }
}

#[test]
fn no_altered_bit_of_a_table_is_accepted() {
    let shards = Shards::new();
    let table = shards.path("b/sweep.csv");
    let text = fs::read(&table).unwrap();
    for place in 0..text.len() - 1 {
        let mut altered = text.clone();
        altered[place] ^= 1 << (place % 7);
        fs::write(&table, &altered).unwrap();
        let err = shards.merge_all().ends(2).err;
        let line = 1 + text[..place].iter().filter(|byte| **byte == b'\n').count();
        // If the end of a row is damaged, the message names the row's first line.
        let named = format!("thermyo: {}:{line}: ", table.display());
        assert!(err.starts_with(&named), "byte {place}: {err}");
    }
    assert!(!shards.path("merged").exists());
    let mut altered = text.clone();
    let rows: Vec<usize> = (0..text.len()).filter(|place| text[*place] == b'\n').collect();
    altered[rows[1] - 1] ^= 1;
    altered[rows[2] - 1] ^= 1;
    fs::write(&table, &altered).unwrap();
    let said = "b/sweep.csv:2: does not match its checksum, nor does a line below it; run that shard again";
    shards.merge_all().says(said);
    // The same command runs the damaged points again, and reports it.
    let begin = ["sweep", &shards.scenario, "--quiet", "--out", &shards.places[1]];
    let again = thermyo(&[&begin[..], &Shards::GRID, &["--shard", "2/3"]].concat()).ok();
    again.says("2 of 4 points were done and are kept; what is damaged is run again: ");
    assert_eq!(fs::read(&table).unwrap(), text);
}

#[test]
fn words_and_a_hypercube() {
    let folder = Folder::new();
    let scenario = folder.scenario("[run]\nduration_s = 0.2\n");
    let words = ["--vary", "plant.model=lumped,full", "--vary", "run.seed=1,5"];
    let table = sweep(&scenario, &words, &folder.path("words"));
    let starts: Vec<&str> = table.lines().skip(1).map(|line| &line[..line.len().min(14)]).collect();
    for (start, expected) in
        starts.iter().zip(["1,lumped,1,1,", "2,lumped,5,5,", "3,full,1,1,", "4,full,5,5,"])
    {
        assert!(start.starts_with(expected), "{table}");
    }
    let page = read(&folder.path("words"), "report.html");
    assert!(
        page.contains(">lumped</text>") && page.contains(">words</td>"),
        "no words on the axis"
    );

    let cube = [
        "--lhs",
        "20",
        "--seed",
        "7",
        "--vary",
        "believed.heat.scale=0.5:1.3:log",
        "--vary",
        "muscle.zones=2:6",
        "--vary",
        "plant.model=lumped,full",
        "--vary",
        "heat.scale=0.7:1.3",
    ];
    let (one, two) = (folder.path("one"), folder.path("two"));
    let table = sweep(&scenario, &cube, &one);
    assert_eq!(table, sweep(&scenario, &cube, &two));
    let page = read(&one, "report.html");
    assert!(page.contains(">lumped</text>"), "no words on the axis");
    assert!(!page.contains(".</b> </figcaption>"), "a figure without a caption");
    let column = |key: usize| -> Vec<&str> {
        table.lines().skip(1).map(|line| line.split(',').nth(key).unwrap()).collect()
    };
    assert_eq!(column(3).iter().filter(|word| **word == "full").count(), 10);
    for zones in 2..=6 {
        let count = column(2).iter().filter(|cell| **cell == zones.to_string()).count();
        assert_eq!(count, 4, "{zones} zones");
    }
    let scales = column(4).into_iter().map(|cell| cell.parse::<f64>().unwrap());
    let mut parts: Vec<usize> = scales.map(|scale| ((scale - 0.7) / 0.03) as usize).collect();
    parts.sort_unstable();
    assert_eq!(parts, (0..20).collect::<Vec<_>>());
}

#[test]
fn the_limits_of_one_key_say_whose_they_are() {
    let folder = Folder::new();
    let scenario = folder.scenario("[run]\nduration_s = 0.2\n");
    let out = folder.path("out");
    sweep(&scenario, &["--vary", "run.seed=1:2:2"], &out);
    let page = read(&out, "report.html");
    let (_, limits) = page.split_once(">Limits</h2>").unwrap();
    let (limits, _) = limits.split_once("</table>").unwrap();
    assert_eq!(limits.matches("<tr>").count(), 5, "{limits}");
    assert!(limits.contains(">estimate</td>"), "{limits}");
}

/// Claim of docs/figures.md and docs/how-to/choose-a-sensor.md on the shipped scenario: for 1 K the
/// bare sensor needs a time constant of 0.054 s, and the estimate works with 10 s.
#[test]
fn the_estimate_is_content_with_a_slow_sensor() {
    let folder = Folder::new();
    let scenario = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/sensor.toml");
    let vary = ["--vary", "sensor.gas.time_constant_s=0.03:3:3:log"];
    let table = sweep(scenario, &vary, &folder.path(""));
    let rows: Vec<Vec<f64>> = table.lines().skip(1).map(cells).collect();
    let (bare, estimate) = (4, 7);
    // An element on the axis swings more than the mean of the gas, however fast it is.
    assert!((2.0..3.5).contains(&rows[0][bare]) && rows[1][bare] > 4.0, "{table}");
    assert!((0.6..1.1).contains(&rows[0][estimate]), "{table}");
    assert!((0.2..0.5).contains(&rows[2][estimate]), "{table}");
}

#[test]
fn keys_without_effect_are_named() {
    let folder = Folder::new();
    let text = "[run]\nduration_s = 1.0\n[plant]\nmodel = \"lumped\"\n";
    let scenario = folder.scenario(text);
    let out = folder.name("out");
    let vary =
        ["--vary", "sensor.gas.time_constant_s=1:2:2", "--vary", "sensor.gas.position=0:1:2"];
    let swept = thermyo(&[&["sweep", &scenario, "--quiet", "--out", &out], &vary[..]].concat());
    let said = swept.ok().out;
    assert!(said.contains("sensor.gas.position changes nothing"), "{said}");
    assert!(!said.contains("time_constant_s changes nothing"), "{said}");
}

#[test]
fn a_range_in_another_unit_is_warned_of() {
    let folder = Folder::new();
    let scenario = folder.scenario("[run]\nduration_s = 0.1\n[plant]\nmodel = \"lumped\"\n");
    let joint = "[run]\nduration_s = 0.1\n[joint]\n[sensor.gas]\nkind = \"max31865\"\n";
    let joint = folder.file("joint.toml", joint);
    let sweep = |scenario: &str, vary: &[&str]| {
        let out = folder.name("out");
        let vary = vary.iter().flat_map(|range| ["--vary", range]);
        let all: Vec<&str> = ["sweep", scenario, "--out", &out].into_iter().chain(vary).collect();
        thermyo(&all).ok().err
    };
    let pascal = "supply.pressure_pa=4:8:3";
    let warning =
        "warning: --vary supply.pressure_pa=4:8:3: supply.pressure_pa = 4.0: not above ambient";
    assert!(sweep(&scenario, &[pascal]).contains(warning));
    assert!(!sweep(&scenario, &["supply.pressure_pa=4bar:8bar:2"]).contains("warning"));
    // With one of the models the key has an effect.
    let position = "sensor.gas.position=0:1:2";
    assert!(sweep(&scenario, &[position]).contains("sensor.gas.position = 0: not used"));
    assert!(!sweep(&scenario, &[position, "plant.model=lumped,full"]).contains("warning"));
    let said = sweep(&joint, &[pascal]);
    assert!(said.contains(warning), "{said}");
}

#[test]
fn bad_arguments_are_named_and_nothing_is_written() {
    let folder = Folder::new();
    let scenario = folder.scenario("");
    let out = folder.path("out");
    let out_text = out.display().to_string();
    for (varied, message) in [
        ("heat.iner_w_m2_k=1:2:3", "unknown key heat.iner_w_m2_k; did you mean heat.inner_w_m2_k?"),
        (
            "supply.presure_pa=4bar:8bar:3",
            "unknown key supply.presure_pa; did you mean supply.pressure_pa?",
        ),
        ("plant.kind=1:2:2", "plant.kind takes no number: it is one of \"muscle\", \"vessel\""),
        ("sensor.gas=1:2:2", "sensor.gas takes no number: it is a table of keys"),
        ("sensor.gas.position=0:2:3", "sensor.gas.position = 2: must be a number from 0 to 1"),
        ("muscle.zones=1:2:3", "muscle.zones = 1.5: must be a whole number from 1 to 64"),
        ("plant.model=full,fall", "plant.model = fall: must be one of"),
        ("sensor.gas.span=wide,narrow", "sensor.gas.span = wide: must be a number from 0 to 1"),
        ("believed.run.seed=1:2:2", "believed.run.seed: the core does not know"),
        (
            "sensor.gas.range_min_k=200:400:2",
            "--vary sensor.gas.range_min_k=200:400:2: at sensor.gas.range_min_k = 400: ",
        ),
        ("drive.profile_csv=a.csv,b.csv", "drive.profile_csv names a file, and a sweep varies"),
        ("sensor.gas.span", "must be KEY=FROM:TO:COUNT"),
        ("sensor.gas.span=0:x:2", "TO = \"x\": must be a number"),
        ("sensor.gas.span=0:1:1", "FROM must equal TO"),
        ("sensor.gas.span=0:1:3:log", "FROM must be above 0"),
    ] {
        thermyo(&["sweep", &scenario, "--quiet", "--out", &out_text, "--vary", varied])
            .refused(message)
            .says("--vary");
        assert!(!out.exists(), "{varied} left something");
    }
    let span = ["--vary", "sensor.gas.span=0:1:2"];
    for (arguments, message) in [
        (vec![], "--vary"),
        (vec!["--vary", "sensor.gas.span=0:1"], "must have a COUNT"),
        ([&span[..], &["--lhs", "5"]].concat(), "must have no COUNT"),
        (
            vec!["--lhs", "0", "--vary", "sensor.gas.span=0:1"],
            "must be a whole number from 1 to 10000000",
        ),
        (span.repeat(2), "sensor.gas.span is varied twice"),
        ([&span[..], &["--shard", "3/2"]].concat(), "I from 1 to N"),
        ([&span[..], &["--shard", "3/3"]].concat(), "there are 2 points"),
        ([&span[..], &["--within", "0"]].concat(), "must be a number above 0"),
    ] {
        let all = [&["sweep", &scenario, "--out", &out_text], &arguments[..]].concat();
        thermyo(&all).refused(message);
        assert!(!out.exists(), "{arguments:?} left something");
    }
}

/// A failed point keeps the others, and is reported.
#[test]
fn a_diverged_point_is_empty_and_reported() {
    let folder = Folder::new();
    folder.file("piston.csv", "time_s,volume_m3\n0,0.001\n1,0.000001\n");
    let scenario = folder.scenario("[run]\nduration_s = 0.5\n[plant]\nkind = \"vessel\"\n[vessel]\nvolume_csv = \"piston.csv\"\n\
         [heat]\nmodel = \"adiabatic\"\n[drive]\nkind = \"closed\"\n",
    );
    let out = folder.path("out");
    let out_text = out.display().to_string();
    let vary = ["--vary", "run.duration_s=0.5:1:2"];
    let all = [&["sweep", &scenario, "--quiet", "--out", &out_text], &vary[..]].concat();
    thermyo(&all).ends(1).says(
        "1 of 2 points failed, the first is point 2 (run.duration_s = 1): the plant diverged",
    );
    let table = fs::read_to_string(out.join("sweep.csv")).unwrap();
    assert!(table.lines().nth(1).is_some_and(|line| cells(line).len() == 10), "{table}");
    let failed = "2,1,1,0.5,,,,,,,,,,,,,,\"the plant diverged at ";
    assert!(table.lines().nth(2).is_some_and(|line| line.starts_with(failed)), "{table}");
}
