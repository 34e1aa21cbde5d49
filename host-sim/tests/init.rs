//! `thermyo init` and presets: a scenario from flags, nothing overwritten, keys above presets.

use std::fs;
use thermyo_files::input::InputError;
use thermyo_scenario::DriveKind;
use thermyo_scenario::preset::{MusclePreset, PressurePreset};
use thermyo_setup::Loaded;

use crate::command_support::{Folder, Said, command};

/// Runs the command in a folder, without a terminal.
fn thermyo(folder: &Folder, arguments: &[&str]) -> Said {
    let output = command(arguments).current_dir(folder.path("")).output().unwrap();
    Said::of(&arguments.join(" "), output)
}

const FLAGS: [&str; 11] = [
    "init",
    "--muscle",
    "dmsp-10",
    "--valve",
    "mhe2-class",
    "--pressure-sensor",
    "hsc-150psi-a",
    "--load",
    "5",
    "--supply",
    "700000",
];

#[test]
fn flags_make_a_scenario_that_runs_and_nothing_is_overwritten() {
    let folder = Folder::new();
    let Said { out, err, .. } = thermyo(&folder, &FLAGS).ok();
    assert_eq!(err, "");
    for part in ["muscle.toml is written", "thermyo tune", "friction.force_n"] {
        assert!(out.contains(part), "{part}: {out}");
    }
    let written = folder.read("muscle.toml");
    let loaded = thermyo_setup::load(&folder.path("muscle.toml")).unwrap();
    assert_eq!((loaded.plant.muscle.slip_force_n, loaded.plant.load.mass_kg), (6.5, 5.0));
    assert!((loaded.plant.valve.conductance_m3_s_pa - 3.93e-9).abs() < 1e-15);
    thermyo(&folder, &FLAGS).refused("muscle.toml: exists already");
    assert_eq!(folder.read("muscle.toml"), written);
}

/// The drive used to be a contraction of 10 % in any case, which most of these rigs do not reach.
#[test]
fn every_rig_of_presets_drives_what_it_reaches() {
    let folder = Folder::new();
    let own = ["--rest-length", "0.3", "--diameter", "0.02", "--braid-angle", "25"];
    let mut number = 0;
    for muscle in MusclePreset::WORDS {
        for sensor in PressurePreset::WORDS {
            for (load, supply) in [("10", "600000"), ("3", "1.6bar"), ("100", "8bar")] {
                number += 1;
                let name = format!("{number}.toml");
                let mut arguments = vec!["init", "--out", &name, "--muscle", muscle];
                arguments.extend(["--valve", "mhe2-class", "--pressure-sensor", sensor]);
                arguments.extend(["--load", load, "--supply", supply]);
                arguments.extend(own.iter().filter(|_| *muscle == "none"));
                let out = thermyo(&folder, &arguments).ok().out;
                let (loaded, warnings) =
                    thermyo_setup::load_with_warnings(&folder.path(&name)).unwrap();
                let reached = |warning: &&InputError| warning.to_string().contains("drive.");
                assert!(!warnings.iter().any(|warning| reached(&warning)), "{warnings:?}");
                let lifts = loaded.plant.drive.kind == DriveKind::Contraction;
                assert_eq!(lifts, !out.contains("drives a pressure"), "{arguments:?}: {out}");
                assert!(load != "100" || !lifts || *muscle != "dmsp-10", "{arguments:?}");
            }
        }
    }
}

/// The sensor's range is far below the supply, and the load moves later than the gas arrives.
#[test]
fn a_rig_with_a_heavy_load_and_a_sensor_of_a_small_range_does_not_vent() {
    let folder = Folder::new();
    for (number, (diameter, length, valve, load)) in [
        ("30mm", "0.3", "mhe4-class", "20"),
        ("30mm", "0.15", "mhe2-class", "20"),
        ("20mm", "0.15", "mhe2-class", "8"),
        ("20mm", "0.3", "mhj10-class", "8"),
    ]
    .into_iter()
    .enumerate()
    {
        let name = format!("{number}.toml");
        let mut arguments = vec!["init", "--out", &name, "--muscle", "none", "--braid-angle", "25"];
        arguments.extend(["--diameter", diameter, "--rest-length", length, "--valve", valve]);
        arguments.extend(["--pressure-sensor", "mpr-25psi-a", "--load", load, "--supply", "7bar"]);
        let out = thermyo(&folder, &arguments).ok().out;
        assert!(!out.contains("drives a pressure"), "{out}");
        let text = folder.read(&name) + "\n[run]\nduration_s = 3\n";
        fs::write(folder.path(&name), text).unwrap();
        let said = thermyo(&folder, &["run", &name]).ok();
        assert!(!said.out.contains("vented"), "{arguments:?}: {}", said.out);
    }
}

/// The command beside a key finds it.
#[test]
fn the_unknown_keys_are_those_of_the_default_heat_transfer() {
    let folder = Folder::new();
    let out = thermyo(&folder, &FLAGS).out;
    assert!(out.contains("heat.scale, sensor.gas.time_constant_s: stops"), "{out}");
    assert!(!out.contains("heat.inner_w_m2_k"), "{out}");
}

#[test]
fn a_missing_or_wrong_answer_is_named_and_nothing_is_written() {
    let folder = Folder::new();
    for (arguments, message) in [
        (&FLAGS[..1], "--muscle is missing: none, dmsp-10, dmsp-20; there is no terminal"),
        (&FLAGS[..9], "--supply is missing"),
        (&["init", "--muscle", "dmsp-30"][..], "--muscle must be one of none, dmsp-10, dmsp-20"),
        (
            &[&FLAGS[..10], &["7"]].concat(),
            "--supply must be absolute, and above the 101325 Pa of the air; 7 bar is 7bar",
        ),
        (
            &[&FLAGS[..10], &["700"]].concat(),
            "--supply must be absolute, and above the 101325 Pa of the air; 700 kPa is 700kPa",
        ),
        (
            &["init", "--muscle", "none", "--rest-length", "250"][..],
            "--rest-length must be a number from 0.005 to 10 m; for 250 mm use 0.25 or 250mm",
        ),
        (&["init", "--muscle", "none"][..], "--rest-length is missing: a number from 0.005"),
    ] {
        thermyo(&folder, arguments).refused(message);
    }
    assert_eq!(fs::read_dir(folder.path("")).unwrap().count(), 0);
}

fn warned(text: &str) -> (Loaded, Vec<String>) {
    let (loaded, warnings) = thermyo_setup::parse_with_warnings(text, "own.toml".as_ref()).unwrap();
    (loaded, warnings.iter().map(ToString::to_string).collect())
}

#[test]
fn a_key_stands_above_its_preset_and_one_line_says_so() {
    let text = "[muscle]\npreset = \"dmsp-10\"\nslip_force_n = 9.0\nrest_length_m = 0.3\ncreep_slow_s = 20\n";
    let (loaded, lines) = warned(text);
    let muscle = &loaded.plant.muscle;
    assert_eq!((muscle.slip_force_n, muscle.rest_length_m, muscle.creep_slow_s), (9.0, 0.3, 20.0));
    assert!((muscle.diameter_m - 0.013_87).abs() < 1e-12, "{muscle:?}");
    assert_eq!(
        lines,
        [
            "own.toml:2: muscle.preset = \"dmsp-10\": muscle.slip_force_n, muscle.creep_slow_s of the file stand \
             above it"
        ]
    );
    let text = "[valve]\npreset = \"mhe2-class\"\nkind = \"proportional\"\n";
    let (_, lines) = warned(text);
    let line = "own.toml:2: valve.preset = \"mhe2-class\": valve.kind of the file stands above it";
    assert!(lines.contains(&line.to_owned()), "{lines:?}");
    // A length of the user's own used to give a warning in every run.
    for length in ["", "rest_length_m = 0.25\n"] {
        let (_, none) = warned(&format!("[muscle]\npreset = \"dmsp-20\"\n{length}"));
        assert!(none.is_empty(), "{none:?}");
    }
}
