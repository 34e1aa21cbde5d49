//! Wrong uses of the `thermyo` binary: one clear line, the right exit code, no files left.

use serde_json::json;
use std::fs;
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command};
use std::time::Duration;

use crate::command_support::{Folder, Said, command, interrupted, thermyo};

#[test]
fn bad_input_is_one_line_and_exit_code_2() {
    let folder = Folder::new();
    let out = folder.name("out");
    let missing = folder.name("missing.toml");
    let unknown = folder.scenario("[heat]\niner_w_m2_k = 3.0\n");
    let misspelt = folder.name("scenaro.toml");
    let nominal = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/nominal.toml").to_owned();
    for (arguments, expected) in [
        (vec!["run", &missing], "missing.toml: no such file"),
        (vec!["rnu", &unknown], "a similar subcommand exists: 'run'"),
        (vec!["run", "nominal"], "nominal: no such file; did you mean scenarios/nominal.toml?"),
        (vec!["run", &misspelt], "did you mean "),
        (vec!["run", &unknown], "scenario.toml:2: unknown key heat.iner_w_m2_k"),
        (vec!["check", &unknown], "did you mean heat.inner_w_m2_k"),
        (
            vec!["run", &unknown, "--board", "toaster"],
            "must be core, emulated, serial:PORT or a PORT",
        ),
        (vec!["replay", &missing], "missing.toml: no such file"),
        (vec!["replay", env!("CARGO_MANIFEST_DIR")], "trace.csv: no such file"),
        (vec!["tune", &missing], "missing.toml: no such file"),
        (
            vec!["tune", &unknown, "--max-pressure", "nan"],
            "must be a number in Pa, or one with its unit: Pa, kPa, MPa, bar, mbar, psi",
        ),
        (
            vec!["tune", &unknown, "--max-pressure", "4"],
            "must be an absolute pressure of at least 100000 Pa (1 bar): use 4bar",
        ),
        (
            vec!["tune", &unknown, "--max-pressure", "-2bar"],
            "must be an absolute pressure of at least 100000 Pa (1 bar)",
        ),
        (
            vec!["tune", &nominal, "--max-pressure=1e9"],
            "--max-pressure: a highest pressure of 1000000000.0 Pa: must be from 101325 Pa (ambient) to ",
        ),
        (
            vec!["board", "emulated", "arm", "--max-pressure", "4"],
            "must be an absolute pressure of at least 100000 Pa (1 bar): use 4bar",
        ),
        (
            vec!["board", "emulated", "set", "pressure", "1,3e5"],
            "must be a number in Pa, or one with its unit: Pa, kPa, MPa, bar, mbar, psi",
        ),
        (
            vec!["board", "emulated", "set", "pressure", "1.3", "bar", "--arm"],
            "a unit follows its number without a space: 1.3bar",
        ),
        (
            vec!["board", "emulated", "set", "pressure", "130000", "--hold", "-1"],
            "must be a time from 0 to 1000000 s",
        ),
        (
            vec!["board", "emulated", "arm", "--max-pressure", "-1"],
            "must be an absolute pressure of at least 100000 Pa (1 bar)",
        ),
        (vec!["serve", "--port", "80x"], "must be a whole number from 1 to 65535"),
        (vec!["serve", "--port", "0"], "must be a whole number from 1 to 65535"),
        (
            vec!["evaluate", "tune", "--random", "3"],
            "--random goes with `evaluate estimator`, `evaluate plants`",
        ),
        (vec!["evaluate", "estimator", "--random", "0"], "must be a whole number from 1 to 10000"),
        (vec!["evaluate", "estimator", "--seed", "3"], "--random <N>"),
        (
            vec!["evaluate", "estimator", "--random", "3", "--seed", "x"],
            "must be a whole number from 0 to 18446744073709551615",
        ),
        (
            vec!["sweep", "x.toml", "--vary", "a=1:2", "--lhs", "ten"],
            "must be a whole number from 1 to 10000000",
        ),
        (
            vec!["evaluate", "tune", "--recording", "."],
            "--recording goes with `evaluate estimator`",
        ),
        (vec!["evaluate", "estimator", "--reference-lag", "1"], "--recording <DIR>"),
        (
            vec!["evaluate", "estimator", "--reference-lag", "1", "--random", "2"],
            "cannot be used with",
        ),
        (
            vec!["evaluate", "tune", "--out", "x"],
            "--out goes with `evaluate control`, `evaluate faults`",
        ),
        (
            vec!["fmu", &nominal, "-o", "x.txt"],
            "x.txt: must end in .fmu, by which importers know a unit: x.fmu",
        ),
        (vec!["evaluate", "truth"], "<DATA>"),
        (vec!["evaluate"], "Usage: thermyo evaluate <COMMAND>"),
        (vec!["evaluate", "estimater"], "a similar subcommand exists: 'estimator'"),
    ] {
        let mut all = arguments.clone();
        if ["run", "tune"].contains(&arguments[0]) {
            all.extend(["--out", &out]);
        }
        thermyo(&all).refused(expected);
        assert!(!folder.has("out"), "{arguments:?} left something");
    }
}

/// A pipe or a device may be endless, and opening a pipe waits for its writer.
#[cfg(unix)]
#[test]
fn only_regular_files_are_read() {
    let folder = Folder::new();
    let pipe = folder.path("pipe.csv");
    assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let writer = pipe.clone();
    // The thread ends with the process if the pipe has no reader.
    std::thread::spawn(move || {
        loop {
            let _ = fs::write(&writer, "time_s,pressure_pa\n0,1e5\n");
        }
    });
    let pipe = pipe.display().to_string();
    let text =
        "[run]\nduration_s = 0.1\n[drive]\nkind = \"pressure\"\nprofile_csv = \"pipe.csv\"\n";
    let profile = folder.scenario(text);
    let nominal = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/nominal.toml");
    let out = folder.name("out");
    for (arguments, file) in [
        (vec!["check", "/dev/null"], "/dev/null"),
        (vec!["check", &pipe], &pipe),
        (vec!["check", &profile], &pipe),
        (vec!["run", nominal, "--quiet", "--out", &out, "--measured", &pipe], &pipe),
        (vec!["identify", &pipe, "--quiet", "--out", &out, "--config", nominal], &pipe),
        (vec!["replay", &pipe, "--quiet", "--out", &out], &pipe),
        (vec!["compare", &pipe, &pipe, "--quiet", "--out", &out], &pipe),
    ] {
        let err = thermyo(&arguments).ends(2).err;
        let expected = format!("{file}: is a pipe or a device; a regular file is needed\n");
        assert!(err.ends_with(&expected), "{arguments:?}: {err}");
    }
}

/// The true gas temperature of a run takes the place of a reference sensor.
#[test]
fn a_recording_is_judged_by_its_reference() {
    let folder = Folder::new();
    folder.run("[run]\nduration_s = 30\n", "record").ok();
    let place = folder.name("record");
    let judge = |more: &[&str]| {
        let all = ["evaluate", "estimator", "--quiet", "--recording", &place];
        thermyo(&[&all[..], more].concat())
    };
    judge(&[]).refused("trace.csv: column reference_gas_k is missing").in_one_line();

    let text = folder.read("record/trace.csv");
    let as_recorded = |name: &str| {
        let header = text.lines().next().unwrap();
        let renamed = header.replace("gas_temperature_k", "reference_gas_k");
        let judged = text.replacen(header, &renamed.replace("estimate_k", name), 1);
        folder.file("record/trace.csv", &judged);
    };
    as_recorded("estimate_k");
    let lines = judge(&["--json"]).ok();
    let (trace, quiet) = (folder.name("record/trace.csv"), "--quiet");
    let by_file = thermyo(&["evaluate", "estimator", quiet, "--json", "--recording", &trace]);
    assert_eq!(by_file.ok().out, lines.out);
    let lines = lines.json();
    let figure = |name: &str| {
        let all = lines[0]["figures"].as_array().unwrap();
        all.iter().find(|figure| figure["name"] == name).unwrap()["value"].as_f64().unwrap()
    };
    println!("{lines:#}");
    assert!((0.02..0.4).contains(&figure("error_k")), "{}", figure("error_k"));
    assert!((10.0..16.0).contains(&figure("bare_k")), "{}", figure("bare_k"));
    let whole_k = folder.json("record/summary.json")["rmse_k"]["sensor_gas"].as_f64().unwrap();
    assert!((figure("bare_k") / whole_k - 1.0).abs() < 0.2, "of the whole run: {whole_k}");
    let within = figure("within_2sd");
    assert!((0.85..=1.0).contains(&within), "{within}");
    let table = judge(&["--reference-lag", "0.1"]);
    assert!(table.out.contains("reference_lag_s 0.100"));
    as_recorded("estimated_k");
    judge(&[]).refused("estimate_k");
}

#[test]
fn a_recording_too_short_for_figures_is_refused_with_what_it_takes() {
    let folder = Folder::new();
    let columns = "time_s,estimate_k,estimate_sd_k,sensor_gas_k,reference_gas_k";
    let file = folder.file("trace.csv", &format!("{columns}\n0,300,1,299,300\n20,300,1,299,300\n"));
    thermyo(&["evaluate", "estimator", "--recording", &file])
        .refused("column reference_gas_k: must have 50 values or more from 10 s on, and has 1");
}

#[test]
fn a_hold_in_milliseconds_is_doubted() {
    let folder = Folder::new();
    let file = folder.scenario(
        "[plant]\nkind = \"vessel\"\ninitial_pressure_pa = 3e5\n[leak]\nconductance_m3_s_pa = 1e-13\n[drive]\nkind = \"closed\"\n[identify]\n\
         parameters = [\"leak.conductance_m3_s_pa\"]\nstarts = 1\n",
    );
    let rows: String = (0..401).map(|i| format!("{},{}\n", 10 * i, 300_000 - 50 * i)).collect();
    let data = folder.file("hold.csv", &format!("time_s,pressure_pa\n{rows}"));
    let out = folder.name("out");
    let said = thermyo(&["identify", "--config", &file, &data, "--quiet", "--out", &out]);
    said.says("warning: ")
        .says("hold.csv: column time_s: it lasts 4000 s, with 10 s a row: is it in ms?");
}

#[test]
fn a_port_that_is_not_there_is_named() {
    let folder = Folder::new();
    let file = folder.scenario("");
    thermyo(&["run", &file, "--board", "serial:/dev/no-such-port"]).refused("/dev/no-such-port");
}

#[cfg(unix)]
#[test]
fn a_path_without_a_serial_port_is_reported() {
    let folder = Folder::new();
    let file = folder.scenario("");
    let output = thermyo(&["run", &file, "--board", "serial:/dev/null"]);
    output.refused("/dev/null: is no serial port");
}

/// Its run used to end with "the plant diverged", and far outside with a panic.
#[test]
fn a_table_that_does_not_reach_to_where_a_run_begins_is_refused() {
    let folder = Folder::new();
    folder.file("bellows.csv", thermyo_files::shipped::text("bellows.csv"));
    let bellows = thermyo_files::shipped::text("bellows.toml");
    for (from, to) in [
        ("[plant]", "[plant]\ninitial_pressure_pa = 480000"),
        ("force_n = -40.0", "force_n = -1e6"),
        ("[load]", "[ambient]\npressure_pa = 1e8\n[load]"),
    ] {
        let file = folder.file("b.toml", &bellows.replace(from, to));
        thermyo(&["check", &file])
            .refused("plant.initial_pressure_pa = ")
            .says("at a length in table.csv, 0.08 to 0.13 m, and this one holds it at ");
    }
}

#[test]
fn implausible_values_give_a_warning_and_run() {
    let folder = Folder::new();
    let text =
        "[run]\nduration_s = 0.1\n[plant]\nmodel = \"lumped\"\n[supply]\npressure_pa = 7e4\n";
    let file = folder.scenario(text);
    let out = folder.name("out");
    for arguments in [&["run", &file, "--quiet", "--out", &out][..], &["check", &file, "--quiet"]] {
        let warning =
            "scenario.toml:6: supply.pressure_pa = 70000.0: not above ambient.pressure_pa";
        thermyo(arguments).ok().says(warning).in_one_line();
    }
}

#[test]
fn measurements_are_compared_in_units_or_refused() {
    let folder = Folder::new();
    let file = folder.scenario("[run]\nduration_s = 0.1\n[plant]\nmodel = \"lumped\"\n");
    let out = folder.name("out");
    let run = |text: &str| {
        let measured = folder.file("m.csv", text);
        thermyo(&["run", &file, "--measured", &measured, "--quiet", "--out", &out])
    };
    for (text, message) in [
        (
            "time_s,pressure_pa\n5,1e5\n",
            "m.csv:2: column time_s = 5.0: must be at most 0.1 s somewhere",
        ),
        ("time_s\n0\n", "m.csv: has no column to compare beside time_s"),
        ("time_s,step,code_gas\n0,1,1\n", "m.csv: has no column to compare beside time_s"),
        ("time_s;pressure_pa\n0,0;1e5\n", "m.csv:1: cells are separated by semicolons"),
        ("time_s\tpressure_pa\n0\t1e5\n", "m.csv:1: cells are separated by tabs"),
        ("t,pressure_pa\n0,1e5\n", "m.csv: column time_s is missing; the file has t, pressure_pa"),
    ] {
        run(text).refused(message);
        assert!(!folder.has("out"));
    }
    let output = run("time_s,pressure_pa,step\n0,130000,7\n0.05,130000,7\n9,130000,7\n").ok();
    let printed = output.says("1 of 3 rows lie after the end of the run at 0.1 s").out;
    assert!(printed.contains("measured pressure_pa: RMS difference "), "{printed}");
    assert!(printed.contains(" kPa, largest "), "{printed}");
    assert!(!printed.contains("measured step"), "{printed}");
}

#[test]
fn a_set_point_is_reported_with_its_unit() {
    let folder = Folder::new();
    let text =
        "[run]\nduration_s = 0.5\n[plant]\nmodel = \"lumped\"\n[drive]\nkind = \"contraction\"\n";
    let printed = folder.run(text, "out").ok().out;
    assert!(printed.contains(" % of rest length, overshoot "), "{printed}");
    assert_eq!(folder.json("out/summary.json")["control"]["quantity"], "contraction");
    let page = folder.read("out/report.html");
    assert!(page.contains("set point") && page.contains("Tracking error [% of rest length]"));
    assert!(!page.contains("last stroke"));
}

#[test]
fn figures_are_in_practical_units_and_in_si_on_request() {
    let folder = Folder::new();
    let text = "[run]\nduration_s = 0.5\n[plant]\nmodel = \"lumped\"\n\
                [drive]\nkind = \"pressure\"\npressure_pa = \"1.6 bar\"\n";
    let file = folder.scenario(text);
    let out = folder.name("out");
    let printed = |arguments: &[&str]| thermyo(&[arguments, &["--out", &out]].concat()).ok().out;
    let numbers = |text: &str, begin: &str, end: &str| -> Vec<f64> {
        let (_, rest) = text.split_once(begin).unwrap_or_else(|| panic!("{begin}: {text}"));
        let (range, _) = rest.split_once(end).unwrap_or_else(|| panic!("{end}: {text}"));
        range.split(" to ").map(|number| number.parse().unwrap()).collect()
    };
    let [practical, si] = [&["run", &file][..], &["run", &file, "--si"]].map(printed);
    let (shown_kpa, shown_pa) =
        (numbers(&practical, "pressure ", " kPa, "), numbers(&si, "pressure ", " Pa, "));
    let (celsius, kelvin) = (numbers(&practical, "gas ", " degC\n"), numbers(&si, "gas ", " K\n"));
    for (shown, in_si) in shown_kpa.iter().zip(shown_pa) {
        assert!((shown * 1e3 - in_si).abs() <= 51.0, "{practical}{si}");
    }
    for (shown, in_si) in celsius.iter().zip(kelvin) {
        assert!((shown + 273.15 - in_si).abs() < 0.11, "{practical}{si}");
    }
    assert!(practical.contains("set point: RMS error ") && practical.contains(" kPa, "));
    assert!(si.contains(" Pa, overshoot ") || si.contains(" Pa, at the end "), "{si}");
    let (earlier, compared) = (format!("{out}/earlier-1"), folder.name("compared"));
    let both = thermyo(&["compare", &out, &earlier, "--si", "--out", &compared]).ok().out;
    assert!(both.contains("pressure_pa            RMS 0 Pa, mean 0 Pa"));
}

/// A joint's columns have their own names; a joint and a muscle have none in common.
#[test]
fn runs_of_joints_are_compared() {
    let folder = Folder::new();
    let run = |name: &str, text: &str| {
        let text = format!("[run]\nduration_s = 0.3\n[plant]\nmodel = \"lumped\"\n{text}");
        folder.run(&text, name).ok();
        folder.name(name)
    };
    let joint = |angle_rad: f64| format!("[joint]\n[drive]\nangle_rad = {angle_rad}\n");
    let (first, second) = (run("first", &joint(0.0)), run("second", &joint(0.1)));
    let out = folder.name("compared");
    let printed = thermyo(&["compare", &first, &second, "--out", &out]).ok().out;
    assert!(printed.contains("angle_rad              RMS 5.73 deg, mean 5.73 deg"), "{printed}");
    assert!(printed.contains("torque_n_m             RMS ") && printed.contains(" N m, "));
    let tracking = format!("{second}\nset point: RMS error ");
    assert!(
        printed.contains(&tracking) && printed.contains("; stiffness, RMS error "),
        "{printed}"
    );
    // Only the angle that is not 0 has an overshoot.
    assert_eq!(printed.matches(" deg, overshoot ").count(), 1, "{printed}");
    let page = folder.read("compared/report.html");
    assert!(page.contains("tension of muscle b") && page.contains("Stiffness"));

    let muscle = run("muscle", "");
    let refused = format!("{first} is of a joint and {muscle} of one muscle: compare runs of");
    thermyo(&["compare", &muscle, &first]).refused(&refused);
}

/// Runs that cannot be compared as a whole are still compared, with a warning.
#[test]
fn runs_of_another_kind_are_compared_with_a_warning() {
    let folder = Folder::new();
    let run = |name: &str, text: &str| {
        folder.run(text, name).ok();
        folder.name(name)
    };
    let muscle = run("muscle", "[run]\nduration_s = 0.2\n[plant]\nmodel = \"lumped\"\n");
    let short = run("short", "[run]\nduration_s = 0.1\n[plant]\nmodel = \"lumped\"\n");
    let text = "[run]\nduration_s = 0.2\n[plant]\nkind = \"vessel\"\ninitial_pressure_pa = 6e5\n\
                [drive]\nkind = \"discharge\"\n";
    let vessel = run("vessel", text);
    let out = folder.name("compared");
    for (other, warning) in [
        (
            &vessel,
            format!(
                "{vessel} has plant.kind = \"vessel\" and {muscle} \"muscle\": another kind of"
            ),
        ),
        (
            &short,
            format!("{short} lasts 0.1 s and {muscle} 0.2 s: only the common time is compared"),
        ),
    ] {
        let output = thermyo(&["compare", &muscle, other, "--quiet", "--out", &out]).ok();
        output.says(&format!("thermyo: warning: {warning}"));
    }
}

#[test]
fn quiet_leaves_notes_out() {
    let folder = Folder::new();
    let run = |quiet: &[&str]| {
        let mut run = command(&["run", "scenarios/contraction.toml", "--out", "out"]);
        let output = run.args(quiet).current_dir(folder.path("")).output().unwrap();
        Said::of("run", output).ok().err
    };
    // The scenario is the program's own, and the second run moves the result of the first.
    assert!(run(&[]).contains("is not here"));
    assert!(run(&[]).contains("is now in"));
    assert_eq!(run(&["--quiet"]), "");
}

#[test]
fn a_report_begins_with_what_matters() {
    let folder = Folder::new();
    let page = |text: &str, measured: Option<&str>| {
        let (file, out) = (folder.scenario(text), folder.name("out"));
        let measured = measured.map(|measured| folder.file("m.csv", measured));
        let mut arguments = vec!["run", &file, "--quiet", "--out", &out];
        arguments.extend(measured.iter().flat_map(|file| ["--measured", file]));
        (thermyo(&arguments).ok().out, folder.read("out/report.html"))
    };
    // The core is configured with 0.1 s for a sensor of 10 s.
    let (printed, wrong_lag) = page(
        "[run]\nduration_s = 3.0\n[plant]\nmodel = \"lumped\"\n[sensor.gas]\ntime_constant_s = 10.0\n\
         [believed.sensor.gas]\ntime_constant_s = 0.1\n",
        None,
    );
    assert!(
        printed.contains("warning: the estimate is surer of itself than it may be"),
        "{printed}"
    );
    let (before, _) = wrong_lag.split_once("<figure ").unwrap();
    assert!(before.contains("The estimate is surer of itself") && before.contains("✗ missed"));

    let vessel = "[run]\nduration_s = 1.0\n[plant]\nkind = \"vessel\"\ninitial_pressure_pa = 6e5\n[drive]\n\
                  kind = \"discharge\"\n";
    let (_, alone) = page(vessel, None);
    assert!(alone.contains("Absolute pressure in the vessel"));
    let (_, measured) = page(vessel, Some("time_s,pressure_pa\n0,600000\n0.5,590000\n1,580000\n"));
    let (before, figures) = measured.split_once("<figure ").unwrap();
    assert!(before.contains("The run misses the measurement: pressure by "), "{before}");
    assert!(
        figures.starts_with("id=\"fig-1\"")
            && figures.contains("Points: measured. Lines: the run.")
    );
    for page in [alone, measured] {
        assert!(!page.contains("muscle answers") && !page.contains("last stroke"));
    }
}

#[test]
fn check_and_replay_take_json_and_quiet() {
    let folder = Folder::new();
    let text = "[run]\nduration_s = 0.1\nlog_every = 1\n[plant]\nmodel = \"lumped\"\n";
    folder.run(text, "out").ok();
    let [file, out, trace, again] =
        ["scenario.toml", "out", "out/trace.csv", "again"].map(|name| folder.name(name));
    for (arguments, key) in [
        (&["check", &file, "--json", "--quiet"][..], "plant"),
        (&["replay", &trace, "--json", "--quiet", "--out", &again], "mismatches"),
        (&["compare", &out, &trace, "--json", "--out", &again], ""),
    ] {
        let json = thermyo(arguments).ok().json();
        assert!(key.is_empty() || json.get(key).is_some(), "{json}");
    }
    assert!(folder.has("again/earlier-1/report.html"));
    assert!(thermyo(&["check", &file, "--quiet"]).out.is_empty());
    // The file, or its folder.
    for recorded in [&trace, &out] {
        let output = thermyo(&["replay", recorded, "--out", &again]);
        assert!(output.out.starts_with("101 of 101 recorded steps replayed, 0 differ\n"));
    }
}

/// The text of a table with another cell in this line, counted from the header's 1.
fn with_cell(table: &str, line: usize, column: &str, cell: &str) -> String {
    let mut lines: Vec<String> = table.lines().map(str::to_owned).collect();
    let place = lines[0].split(',').position(|name| name == column).unwrap();
    let mut cells: Vec<&str> = lines[line - 1].split(',').collect();
    cells[place] = cell;
    lines[line - 1] = cells.join(",");
    lines.join("\n") + "\n"
}

#[test]
fn a_replayed_record_has_codes_and_flags_that_can_be() {
    let folder = Folder::new();
    let run = "[run]\nduration_s = 0.1\nlog_every = 1\n[plant]\nmodel = \"lumped\"\n";
    for (joint, name, wrong) in [
        (
            "",
            "trace.csv",
            &[
                ("code_gas", "70000", "from 0 to 32760"),
                ("code_pressure", "100.5", "from 0 to 32760"),
                ("heard", "2", "from 0 to 1"),
                ("faults", "-1", "from 0 to 4294967295"),
            ][..],
        ),
        (
            "[joint]\n",
            "joint_trace.csv",
            &[
                ("b_code_gas", "40000", "from 0 to 32760"),
                ("code_angle", "-3", "from 0 to 32760"),
                ("set_point_kind", "9", "from 0 to 5"),
            ][..],
        ),
    ] {
        folder.run(&format!("{run}{joint}"), name).ok();
        let trace = format!("{name}/{name}");
        let text = folder.read(&trace);
        for (column, cell, allowed) in wrong {
            folder.file(&trace, &with_cell(&text, 52, column, cell));
            let output = thermyo(&["replay", &folder.name(name), "--out", &folder.name("again")]);
            output.refused(&format!("{name}:52: column {column} = ")).says(allowed);
            assert!(!folder.has("again"));
        }
    }
}

/// The values found are in the written scenario; bad input and lost data leave nothing.
#[test]
fn a_joint_is_tuned() {
    let folder = Folder::new();
    let text = "[plant]\nmodel = \"lumped\"\ninitial_pressure_pa = 2.5e5\n[joint]\ngravity_n_m = 4\n\
                inertia_kg_m2 = 0.03\n[believed.joint]\ngravity_n_m = 0\ninertia_kg_m2 = 0.015\n";
    let file = folder.scenario(text);
    let output = thermyo(&["tune", &file, "--out", &folder.name("out"), "--json", "--quiet"]).ok();
    assert_eq!((output.json()["open"].clone(), output.err.as_str()), (json!([]), ""));
    let tuned = thermyo_joint::load(&folder.path("out/tuned.toml")).unwrap().unwrap();
    let found = tuned.believed.gravity_n_m;
    assert!((3.8..4.2).contains(&found) && found != 4.0, "{found} N m");
    let found = tuned.believed.inertia_kg_m2;
    assert!((0.028..0.032).contains(&found) && found != 0.03, "{found} kg m2");
    assert_eq!((tuned.joint.gravity_n_m, tuned.joint.inertia_kg_m2), (4.0, 0.03));
    assert!(folder.read("out/report.html").contains("Balance of torques"));

    let none = folder.name("nothing");
    let lost = format!("{text}[joint.a.faults]\nlength = \"open\"\nfrom_s = 5\n");
    let lost = folder.scenario(&lost);
    let radius = folder.file("radius.toml", "[joint]\nradius_m = 0.2\n");
    let spool = folder.file("spool.toml", "[valve]\nkind = \"proportional\"\n[joint]\n");
    let one = folder.file("one.toml", "[valve]\nkind = \"proportional\"\n");
    let pulses = "nothing was tuned: valve.kind = \"proportional\": the experiment measures pulses";
    for (arguments, code, expected) in [
        (vec![spool.as_str()], 2, pulses),
        (vec![&one], 2, pulses),
        (vec![lost.as_str()], 1, "nothing was tuned: faults during the experiment: joint: angle "),
        (
            vec![&lost, "--board", "emulated"],
            2,
            "a joint is tuned with the core in this process, or ",
        ),
        (
            vec![&lost, "--max-pressure=1e9"],
            2,
            "--max-pressure: a highest pressure of 1000000000.0",
        ),
        (vec![&radius], 2, "radius.toml:2: joint.mid_length_a_m"),
    ] {
        let arguments = [&["tune"][..], &arguments, &["--out", &none, "--quiet"]].concat();
        let output = thermyo(&arguments).ends(code).says(expected).in_one_line();
        assert!(output.out.is_empty() && !folder.has("nothing"), "{arguments:?}");
    }
}

/// Good and bad input of a joint: the scenario of its results is the one that ran.
#[test]
fn a_joint_runs_and_leaves_what_it_ran() {
    let folder = Folder::new();
    let text = "[run]\nduration_s = 0.3\n[plant]\nmodel = \"lumped\"\n[joint]\ngravity_n_m = 2\n\
                [joint.b.muscle]\nbladder_stiffness_n_m = 700\n[believed.joint]\ngravity_n_m = 3\n\
                [joint.a.heat]\ninlet_diameter_m = 0.003\n[joint.a.believed.heat]\nscale = 1.3\n\
                [drive]\nload_csv = \"load.csv\"\n";
    folder.file("load.csv", "time_s,torque_n_m\n0,0\n0.3,0.5\n");
    let file = folder.scenario(text);
    let run = |file: &str, name: &str| {
        let output = thermyo(&["run", file, "--json", "--quiet", "--out", &folder.name(name)]);
        assert_eq!(output.ok().json()["faults"], json!([[], [], []]));
        assert!(
            ["report.html", "summary.json"]
                .iter()
                .all(|file| folder.has(&format!("{name}/{file}")))
        );
        folder.read(&format!("{name}/joint_trace.csv"))
    };
    let first = run(&file, "first");
    let header = first.lines().next().unwrap();
    assert!(header.starts_with("time_s,angle_rad,angle_reference_rad,stiffness_n_m_rad,"));
    assert_eq!(first.lines().count(), 32);
    let again = folder.name("first/scenario.toml");
    assert_eq!(first, run(&again, "again"));
    let bad = folder.scenario("[joint]\nradius_m = 0.2\n");
    for arguments in
        [vec!["run", &bad], vec!["check", &bad], vec!["run", &bad, "--board", "emulated"]]
    {
        thermyo(&arguments).refused("joint.mid_length_a_m").in_one_line();
    }
}

#[test]
fn a_joint_that_cannot_be_as_stiff_as_it_should_says_for_how_long() {
    let folder = Folder::new();
    let limited = |stiffness_n_m_rad: u32, faults: &str| {
        let text = format!(
            "[run]\nduration_s = 2\n[plant]\nmodel = \"lumped\"\n[joint]\n[drive]\n\
             shape = \"constant\"\nstiffness_n_m_rad = {stiffness_n_m_rad}\n{faults}"
        );
        let file = folder.scenario(&text);
        let output = thermyo(&["run", &file, "--quiet", "--out", &folder.name("out")]).ok();
        let line = output.out.lines().find(|line| line.starts_with("limited for"));
        line.map(str::to_owned)
    };
    assert_eq!(limited(14, ""), None);
    let line = limited(60, "").unwrap();
    assert!(line.contains(" % of the time: the range of pressures gave less stiffness"), "{line}");
    // It vents for the second half of the run.
    let line = limited(60, "[joint.a.faults]\nlength = \"open\"\nfrom_s = 1\n").unwrap();
    let percent: f64 = line.split(' ').nth(2).unwrap().parse().unwrap();
    assert!((1.0..50.0).contains(&percent), "{line}");
}

/// Commands for one muscle name the commands that take a joint, not all tables of a muscle.
#[test]
fn a_joint_is_refused_in_one_line_with_the_way_out() {
    let folder = Folder::new();
    let file = folder.scenario("[run]\nduration_s = 1\n[joint]\nradius_m = 0.02\n");
    let data = folder.file("data.csv", "time_s,pressure_pa\n0,1e5\n");
    for (arguments, expected) in [
        (
            &["measure", "stop", &file][..],
            ":3: [joint] is not used: this takes one muscle; a joint, each table of it under a header of its own, is \
             for `thermyo run`",
        ),
        (&["identify", &data, "--config", &file], "data.csv: column angle_rad is missing"),
    ] {
        thermyo(arguments).refused(expected).in_one_line();
    }
}

/// A joint's samples are in its trace: the core gives the same bits again, even if it vented or locked.
#[test]
fn a_joints_run_is_replayed_to_the_bit() {
    let folder = Folder::new();
    let text = "[run]\nduration_s = 0.8\nlog_every = 1\n[plant]\nmodel = \"lumped\"\n\
                initial_pressure_pa = 290000\n[joint]\nlock_s = 0.2\n[joint.a.faults]\n\
                length = \"open\"\nfrom_s = 0.5\n[drive]\nshape = \"sine\"\namplitude_rad = 0.3\n";
    let file = folder.scenario(text);
    let path = |name: &str| folder.name(name);
    let (run, again) = (path("run"), path("again"));
    let output = thermyo(&["run", &file, "--quiet", "--log", "mcap", "--out", &run]).ok();
    assert!(output.out.contains("both muscles vented at 0.7"));
    assert!(fs::metadata(path("run/trace.mcap")).unwrap().len() > 100_000);
    let output = thermyo(&["replay", &run, "--out", &again]).ok();
    assert!(output.out.starts_with("801 of 801 recorded steps replayed, 0 differ\n"));
    let encoder = text.replace("[joint]\n", "[joint]\nsensor_kind = \"as5600\"\n");
    let (encoded, of_encoder) = (folder.scenario(&encoder), path("encoder"));
    thermyo(&["run", &encoded, "--quiet", "--out", &of_encoder]).ok();
    let output = thermyo(&["replay", &of_encoder, "--out", &again]);
    assert!(output.out.starts_with("801 of 801 recorded steps replayed, 0 differ\n"));
    let emulated = thermyo(&["replay", &run, "--board", "emulated", "--out", &again]);
    emulated.refused("leave out --board");

    // Too short and too uniform for values; the arguments for one muscle are not accepted.
    let trace = path("run/joint_trace.csv");
    let found = thermyo(&["identify", &trace, "--config", &file, "--out", &path("identified")]);
    found.ends(1).says("nothing was found: the balance of torques");
    assert!(!folder.has("identified/summary.json"));
    let planned = thermyo(&["identify", "--plan", "motion", "--config", &file]);
    planned.refused("are for one muscle");

    let text = folder.read("run/joint_trace.csv");
    folder.file("run/joint_trace.csv", &with_cell(&text, 302, "a_duty_in", "0.123"));
    let output = thermyo(&["replay", &trace, "--quiet", "--out", &again]).ends(1);
    output.says("1 of 801 steps differ, the first is step 300: a_duty_in = 0.123");
}

/// Ctrl-C, as a terminal sends it, once there is something to interrupt; returns the command's end.
fn ctrl_c(arguments: &[&str], out: &Path, begun: impl Fn() -> bool) -> Said {
    let mut command = command(arguments);
    let child: Child = command.args(["--quiet", "--out"]).arg(out).spawn().unwrap();
    while !begun() {
        std::thread::sleep(Duration::from_millis(5));
    }
    interrupted(child).ends(130)
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_the_finished_rows_and_exits_130() {
    let folder = Folder::new();
    let file = folder.scenario("[run]\nduration_s = 1e5\n[plant]\nmodel = \"lumped\"\n");
    let vary = "sensor.gas.position=0.0:1.0:60";
    for (arguments, name) in
        [(&["run", &file][..], "trace.csv"), (&["sweep", &file, "--vary", vary], "sweep.csv")]
    {
        if name == "sweep.csv" {
            folder.scenario("[run]\nduration_s = 10.0\n");
        }
        let out = folder.path(name);
        let file = out.join("unfinished-1").join(name);
        let begun = || fs::read_to_string(&file).is_ok_and(|text| text.lines().count() > 1);
        ctrl_c(arguments, &out, begun).says("so far are in ");
        let text = fs::read_to_string(&file).unwrap();
        assert!(text.ends_with('\n') && text.lines().count() > 1);
    }
}

/// Interrupted work keeps its finished parts, and lists them.
#[cfg(unix)]
#[test]
fn ctrl_c_ends_tune_identify_and_evaluate_with_130() {
    let folder = Folder::new();
    let text = "[run]\nduration_s = 300.0\n[plant]\nmodel = \"lumped\"\n[identify]\nstarts = 100\n\
                parameters = [\"heat.scale\", \"friction.force_n\"]\n";
    folder.run(text, "recorded").ok();
    let [file, trace] = ["scenario.toml", "recorded/trace.csv"].map(|name| folder.name(name));
    let fine = folder.file("fine.toml", "[run]\nstep_s = 1e-4\n");
    // The signal is sent from this point on: by then the handler of Ctrl-C is installed.
    for (arguments, from, expected) in [
        (&["tune", &fine][..], "", "the experiment was not finished, nothing is kept"),
        (&["tune", &file, "--plan", "motion"], "motion.csv", "not finished, its record is "),
        (&["identify", &trace, "--config", &file], "", " of 100 searches "),
        (&["evaluate", "control"], "", "finished"),
    ] {
        let out = folder.path(arguments[0]).join(from);
        // Without a file there is only the folder of the results.
        let begun = match from {
            "" => out.clone(),
            file => out.join("unfinished-1").join(file),
        };
        ctrl_c(arguments, &out, || begun.exists()).says(expected);
        assert!(!out.join("summary.json").exists() && !out.join("report.html").exists());
    }
}

#[test]
fn completions_and_manual_cover_every_command() {
    let folder = Folder::new();
    let out = folder.name("man");
    thermyo(&["man", "--out", &out]).ok();
    for name in ["thermyo", "thermyo-run", "thermyo-compare"] {
        assert!(folder.read(&format!("man/{name}.1")).contains(".SH NAME"), "{name}");
    }
    let printed = thermyo(&["man", "--out", &out, "--json"]).json();
    assert!(printed["page"].as_str().unwrap().ends_with("thermyo.1"), "{printed}");
    assert!(thermyo(&["man", "--out", &out, "--quiet"]).out.is_empty());
    for shell in ["bash", "zsh", "fish"] {
        let script = thermyo(&["completions", shell]).out;
        assert!(script.contains("compare") && script.contains("max-pressure"), "{shell}");
        assert!(!script.contains("emulated-board"), "{shell}");
        let printed = thermyo(&["completions", shell, "--json", "--quiet"]).json();
        assert_eq!((&printed["shell"], &printed["script"]), (&shell.into(), &script.into()));
    }
}

#[test]
fn an_output_folder_that_cannot_be_written_is_named() {
    let folder = Folder::new();
    let file = folder.scenario("[run]\nduration_s = 0.1\n");
    let (taken, below) = (folder.file("taken", "a file"), folder.name("taken/below"));
    for arguments in [
        &["run", &file][..],
        &["tune", &file],
        &["sweep", &file, "--vary", "load.force_n=1:2:2"],
        &["man"],
        &["playground"],
        &["serve"],
    ] {
        let expected = "taken: is a file; a folder is needed";
        for out in [&taken, &below] {
            thermyo(&[arguments, &["--out", out]].concat()).refused(expected).in_one_line();
        }
    }
    assert_eq!(folder.read("taken"), "a file");
}

/// A limit on the size of files simulates a full disk.
#[cfg(unix)]
#[test]
fn a_full_disk_leaves_nothing_behind() {
    let folder = Folder::new();
    let file = folder.scenario("[run]\nduration_s = 20.0\n[plant]\nmodel = \"lumped\"\n");
    let output = Command::new("bash")
        .arg("-c")
        .arg("trap '' XFSZ; ulimit -f 100; exec \"$0\" run \"$1\" --out \"$2\"")
        .arg(env!("CARGO_BIN_EXE_thermyo"))
        .args([&file, &folder.name("out")])
        .output()
        .unwrap();
    Said::of("run on a full disk", output).refused("trace.csv: cannot be written");
    assert!(!folder.has("out"), "half a result is left");
}

#[test]
fn a_unit_that_exists_is_left_before_anything_is_built() {
    let folder = Folder::new();
    let file = folder.scenario("");
    let unit = folder.file("muscle.fmu", "mine");
    let output = thermyo(&["fmu", &file, "--out", &unit]);
    output.refused("muscle.fmu: exists already, and is left");
    assert_eq!(folder.read("muscle.fmu"), "mine");
    let below = format!("{unit}/other.fmu");
    thermyo(&["fmu", &file, "-o", &below]).refused("muscle.fmu: is a file; a folder is needed");
    assert_eq!(folder.read("muscle.fmu"), "mine");
}

/// No folder can be created in /proc, not even by the superuser.
#[cfg(target_os = "linux")]
#[test]
fn a_unit_that_cannot_be_written_is_named() {
    let folder = Folder::new();
    let file = folder.scenario("");
    let output = command(&["fmu", &file, "-o", "muscle.fmu"]).current_dir("/proc").output();
    let said = Said::of("fmu in /proc", output.unwrap());
    said.refused("thermyo: muscle.fmu: cannot be written: ").in_one_line();
}

#[test]
fn a_run_that_would_not_end_does_not_begin() {
    let folder = Folder::new();
    for (text, message) in [
        (
            "[plant]\nmodel = \"full\"\n[tube]\nvolume_m3 = 1e-9\n[valve]\nconductance_m3_s_pa = 1e-6\n",
            "scenario.toml:4: tube.volume_m3 = 1e-9: tube.volume_m3 is too small for valve.conductance_m3_s_pa and ",
        ),
        (
            "[plant]\nmodel = \"full\"\n[friction]\nviscous_n_s_m = 1e6\npresliding_stiffness_n_m = 1e9\n[load]\nmass_kg = 0.01\n",
            "friction.viscous_n_s_m is too large for load.mass_kg, or for the 50 g of a muscle's slack end: it asks",
        ),
        (
            "[plant]\nmodel = \"lumped\"\n[valve]\nconductance_m3_s_pa = 1e-3\n",
            "valve.conductance_m3_s_pa is too large for the gas's volume: it asks",
        ),
    ] {
        folder.run(text, "out").refused(message).says(" s, at least 1e-7 s are taken");
        assert!(!folder.has("out"), "half a result is left");
    }
}

#[test]
fn a_slow_simulation_is_warned_of_at_its_key() {
    let folder = Folder::new();
    let of = |volume: &str| {
        let text = format!(
            "[run]\nduration_s = 0.01\n[plant]\nmodel = \"full\"\n[tube]\nvolume_m3 = {volume}\n"
        );
        folder.run(&text, "out").ok()
    };
    of("1e-8")
        .says("warning: ")
        .in_one_line()
        .says("scenario.toml:6: tube.volume_m3 = 1e-8: tube.volume_m3 is too small for valve.")
        .says("s make the simulation slow; it is fast with 1e-6 s or more");
    assert!(!of("1e-7").err.contains("warning: "));
}

#[test]
fn a_trace_that_fills_a_disk_is_announced() {
    let folder = Folder::new();
    let taken = folder.file("taken", "a file");
    for (name, more, rows) in [
        ("muscle.toml", "", "the trace will have 100000001 rows, about 44 GB; with a larger run."),
        (
            "joint.toml",
            "[joint]\n",
            "the trace will have 100000001 rows, about 84 GB; with a larger run.",
        ),
    ] {
        let text = format!("[run]\nduration_s = 1e5\nlog_every = 1\n{more}");
        let file = folder.file(name, &text);
        let output = thermyo(&["run", &file, "--out", &taken]);
        let warning = format!("thermyo: warning: {file}:3: run.log_every = 1: {rows}");
        output.refused("taken: is a file").says(&warning);
        folder.file(name, &text.replace("= 1e5", "= 1e3"));
        thermyo(&["run", &file, "--out", &taken]).refused("taken: is a file").in_one_line();
    }
}

#[test]
fn a_diverging_plant_stops_with_time_and_state() {
    let folder = Folder::new();
    // A vessel whose piston compresses the gas to a thousandth: the temperature leaves every range.
    folder.file("piston.csv", "time_s,volume_m3\n0,0.001\n1,0.000001\n");
    let text = "[run]\nduration_s = 1.0\n[plant]\nkind = \"vessel\"\n[vessel]\nvolume_csv = \"piston.csv\"\n\
                [heat]\nmodel = \"adiabatic\"\n[drive]\nkind = \"closed\"\n";
    let output = folder.run(text, "out").ends(1);
    output.says("the plant diverged at 0.9").says("temperature =").says("a step before");
    assert!(!folder.has("out"), "half a result is left");
}

#[test]
fn a_shipped_scenario_runs_where_its_file_is_not() {
    let folder = Folder::new();
    let check = |file: &str| {
        let output = command(&["check", file]).current_dir(folder.path("")).output();
        Said::of(file, output.unwrap())
    };
    check("scenarios/bellows.toml").ok().says("scenarios/bellows.toml is not here");
    let meant = "scenarios/bellow.toml: no such file; did you mean scenarios/bellows.toml?";
    check("scenarios/bellow.toml").refused(meant);

    // The user's own scenario takes precedence.
    fs::create_dir(folder.path("scenarios")).unwrap();
    folder.file("scenarios/bellows.toml", "[run]\nduration_s = 7.0\n");
    let own = check("scenarios/bellows.toml");
    assert_eq!(own.err, "");
    assert!(own.out.contains("duration_s = 7.0"));
}

#[test]
fn a_vented_run_reports_time_and_cause() {
    let folder = Folder::new();
    let ran = |faults: &str| {
        let text = format!(
            "[run]\nduration_s = 3.0\n[plant]\nmodel = \"lumped\"\n[drive]\nkind = \"pressure\"\n\
             pressure_pa = 250000.0\n{faults}"
        );
        let printed = folder.run(&text, "out").ok().out;
        let core = folder.json("out/summary.json")["core"].clone();
        (printed, core, folder.read("out/report.html"))
    };
    let (printed, core, page) = ran("[faults]\npressure = \"open\"\nfrom_s = 2.0\nuntil_s = 2.5\n");
    let found = "vented from 2.01 s: pressure sensor, overpressure";
    assert!(printed.contains(&format!("\nwarning: the core {found}\n")), "{printed}");
    assert_eq!(core["fault_names"], json!(["pressure sensor", "overpressure"]));
    assert_eq!(core["faults"], 6);
    let vented_s = core["vented_s"].as_f64().unwrap();
    assert!((2.001..2.02).contains(&vented_s), "{vented_s}");
    assert!(core["shown_s"].is_null(), "{core}");
    let (before, figures) = page.split_once("<figure ").unwrap();
    let (lead, tiles) = before.split_once("class=\"tiles\"").unwrap();
    assert!(
        lead.contains(&format!("class=\"lead\">The core {found}. The absolute pressure misses"))
    );
    let label = "Vented from: pressure sensor, overpressure";
    assert!(tiles.contains(label) && figures.contains(label));
    let (_, tracking) = tiles.split_once("Tracking error, RMS").unwrap();
    let (tracking, _) = tracking.split_once("class=\"tile\"").unwrap();
    assert!(tracking.contains("✗ missed") && !tracking.contains("✓"), "{tracking}");

    // The message used to be "the core shown from".
    let (printed, _, page) = ran("[sensor.gas]\nnoise_k = 3.0\n");
    let found = printed.lines().find(|line| line.starts_with("warning: the core ")).unwrap();
    assert!(found.starts_with("warning: the core reported from 0."), "{found}");
    assert!(found.ends_with(" s: gas sensor") && page.contains("Reported from: gas sensor"));

    let (printed, core, page) = ran("");
    assert!(!printed.contains("vented"), "{printed}");
    assert!(core["vented_s"].is_null() && core["fault_names"] == json!([]), "{core}");
    let (before, _) = page.split_once("<figure ").unwrap();
    assert!(before.contains("The absolute pressure follows its set point with an error of "));
    assert!(!before.contains("ented"), "{before}");
}

#[test]
fn a_last_stroke_is_one_that_was_made() {
    let folder = Folder::new();
    for (duration_s, shown) in [("0.001", false), ("0.4", false), ("0.5", true), ("0.7", true)] {
        let text = format!(
            "[run]\nduration_s = {duration_s}\n[plant]\nmodel = \"lumped\"\n[drive]\nperiod_s = 0.5\n"
        );
        folder.run(&text, "out").ok();
        let page = folder.read("out/report.html");
        assert_eq!(page.contains("The last stroke."), shown, "{duration_s}");
        assert_eq!(page.contains("<td data-column=\"Quantity\">Strokes</td>"), shown);
    }
}

#[test]
fn ports_are_listed_as_json_too() {
    assert!(thermyo(&["ports", "--json"]).ok().json().is_array());
    assert!(!thermyo(&["ports"]).ok().out.is_empty());
}

#[test]
fn a_page_that_cannot_be_served_is_refused_in_one_line() {
    let folder = Folder::new();
    let out = folder.name("out");
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    for (arguments, expected) in [
        (&["scenarios/nowhere.toml"][..], "nowhere.toml"),
        (&["/dev/nothing"], "/dev/nothing"),
        (&["emulated", "--port", &port], "another program has it"),
    ] {
        thermyo(&[&["serve", "--out", &out], arguments].concat()).refused(expected).in_one_line();
    }
    assert!(!folder.has("out"), "nothing is left behind");
}
