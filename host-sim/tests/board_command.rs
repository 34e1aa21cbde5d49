//! `thermyo board emulated` as users run it, one process after the other, and every command in
//! `docs/how-to/start-a-board.md`.

use serde_json::json;
use std::fs;
use std::net::{TcpListener, TcpStream};
use std::path::PathBuf;
use std::process::Child;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use thermyo_boards::image::{Variant, firmware};

use crate::board_support::{Bench, repository};

#[test]
fn a_board_is_configured_armed_driven_and_queried() {
    let bench = Bench::new();
    assert!(bench.ok("thermyo board emulated info").contains("the core's defaults"));
    let set = "thermyo board emulated set pressure 130000 --hold 1.5";
    assert!(bench.refused(set).contains("config write"));
    bench.ok("thermyo board emulated config write scenarios/contraction.toml");
    assert!(bench.refused(set).contains("not armed"));
    let out_of_range = bench.refused("thermyo board emulated set pressure 900000 --arm");
    assert!(
        out_of_range.contains("a pressure of 900 kPa: must be from 101.33 kPa (ambient, "),
        "{out_of_range}"
    );
    let bar = bench.refused("thermyo board emulated set pressure 1.3 --arm --hold 1");
    assert!(bar.contains(" kPa; use 1.3bar, which is 130000 Pa\n"), "{bar}");
    let duty = bench.refused("thermyo board emulated set duty 2 0 --arm --hold 1");
    assert!(duty.contains("a duty of the inlet of 200 %"), "{duty}");
    // A refused set point used to leave the board armed.
    assert!(bench.ok("thermyo board emulated info").contains("armed:         no"));
    fs::write(bench.path("bar.csv"), "time_s,pressure_pa\n0,1.2\n1,1.4\n").unwrap();
    let bar = bench.path("bar.csv").display().to_string();
    let bar = bench.refused(&format!("thermyo board emulated drive {bar} --arm --out out/drive"));
    assert!(
        bar.contains("bar.csv:2: column pressure_pa = 1.2: must be a number from 101325 to "),
        "{bar}"
    );
    assert_the_limits_are_stated(&bench);
    let held = bench.ok("thermyo board emulated set pressure 1.3bar --hold 1500ms");
    let last = held.lines().last().unwrap();
    let mean_kpa: f64 = last.split_whitespace().next().unwrap().parse().unwrap();
    assert!((128.0..132.0).contains(&mean_kpa), "{held}");
    // The armed pressure stops a flow and a contraction; the message sums that up in one sentence.
    let flow = bench.ok("thermyo board emulated set flow 1g/s --hold 2");
    assert!(flow.trim_end().ends_with("it is armed for; it vents"), "{flow}");
    let contraction = bench.ok("thermyo board emulated set contraction 5% --hold 1.5");
    let last = contraction.lines().last().unwrap();
    assert!(last.contains(" % contracted in the mean of the last second, "), "{contraction}");
    let si = bench.ok("thermyo board emulated set pressure 1.3bar --hold 1.5 --si");
    let last = si.lines().last().unwrap();
    let mean_pa: f64 = last.split_whitespace().next().unwrap().parse().unwrap();
    assert!((128_000.0..132_000.0).contains(&mean_pa), "{si}");
    assert!(held.contains(" degC +- ") && !si.contains("degC"), "{held}{si}");
    let shortest = bench.refused("thermyo board emulated set contraction 90%");
    assert!(shortest.contains(": a contraction of 90 %: must be from 0 to 37."), "{shortest}");
    let info = bench.ok("thermyo board emulated info");
    assert!(
        info.contains("contraction, ") && info.contains("armed:         up to 200.0"),
        "{info}"
    );
    assert!(info.contains(" RP2040, firmware "), "{info}");

    assert_another_muscle_is_warned_of(&bench);
    assert_configurations_are_returned(&bench);
    assert_a_drive_is_recorded(&bench);
}

/// Checks refusals of profiles, limits and units; the board is armed up to 2 bar at the end.
fn assert_the_limits_are_stated(bench: &Bench) {
    // The whole profile is checked before the board is armed. A new configuration disarms.
    bench.ok("thermyo board emulated config write scenarios/contraction.toml");
    fs::write(bench.path("late.csv"), "time_s,value\n0,0.01\n0.2,0.02\n9,0.6\n").unwrap();
    let late = bench.path("late.csv").display().to_string();
    let drive = format!("thermyo board emulated drive {late} --arm --out out/drive");
    let unnamed = bench.refused(&drive);
    assert!(unnamed.contains("late.csv: column value: of which quantity? Name it "), "{unnamed}");
    let row = bench.refused(&format!("{drive} --kind contraction"));
    assert!(row.contains("late.csv:4: column value = 0.6: must be a number from 0 to 0."), "{row}");
    fs::write(
        bench.path("two.csv"),
        "time_s,contraction,pressure_pa\n0,0.1,120000\n1,0.1,120000\n",
    )
    .unwrap();
    let two = bench.path("two.csv").display().to_string();
    let two = bench.refused(&format!("thermyo board emulated drive {two} --arm --out out/drive"));
    let expected =
        "two.csv: has set points in pressure_pa and in contraction: must have one of them";
    assert!(two.contains(expected), "{two}");
    assert!(bench.ok("thermyo board emulated info").contains("armed:         no"));
    // Such tables used to be driven for no time, with exit code 0, or without an end.
    for (rows, end) in [("", "0.0"), ("1e300,120000\n", "1e300")] {
        let once = bench.path("once.csv");
        fs::write(&once, format!("time_s,pressure_pa\n0,120000\n{rows}")).unwrap();
        let drive =
            format!("thermyo board emulated drive {} --arm --out out/drive", once.display());
        let said = bench.refused(&drive);
        let expected = format!("once.csv: column time_s: ends at {end} s: must end after 0 s");
        assert!(said.contains(&expected), "{said}");
    }
    let high = bench.refused("thermyo board emulated arm --max-pressure 15bar");
    assert!(high.contains("a pressure of 1500 kPa: must be from 101.33 kPa (ambient, "), "{high}");
    assert!(bench.ok("thermyo board emulated arm --max-pressure 2bar").contains("200.0 kPa"));
    let above = bench.refused("thermyo board emulated set pressure 210000");
    assert!(above.contains("configured) to 200 kPa\n"), "{above}");
    fs::write(bench.path("above.csv"), "time_s,pressure_pa\n0,120000\n1,210000\n").unwrap();
    let above = bench.path("above.csv").display().to_string();
    let above = bench.refused(&format!("thermyo board emulated drive {above} --out out/drive"));
    let expected = "above.csv: pressure_pa = 210000 at 1 s: must be a number from 101325 to 2e5 Pa, \
                    as the board is armed";
    assert!(above.contains(expected), "{above}");
    let kilograms = bench.run("thermyo board emulated set pressure 5kg");
    kilograms.says("or one with its unit: Pa, kPa, MPa, bar, ");
}

/// The emulated board has a muscle at its pins, whatever its configuration.
fn assert_another_muscle_is_warned_of(bench: &Bench) {
    let warned = |text: &str| {
        let file = bench.path("muscle.toml");
        fs::write(&file, text).unwrap();
        let line = format!("thermyo board emulated config write {}", file.display());
        bench.run(&line).ok().err
    };
    assert_eq!(warned("[friction]\nforce_n = 3\n"), "");
    let other = warned("[muscle]\nrest_length_m = 0.2\n");
    let expected = "muscle.toml: another muscle is at the emulated board's pins: muscle.rest_length_m = 0.2, 0.3 there";
    assert!(other.contains(expected) && other.lines().count() == 1, "{other}");
    let file = bench.path("muscle.toml").display().to_string();
    let tune =
        format!("thermyo tune {file} --board port:emulated --max-pressure 1.1bar --out out/tune");
    let tune = bench.run(&tune).err;
    assert!(tune.contains(expected), "{tune}");
}

/// The board returns its configuration to the bit.
fn assert_configurations_are_returned(bench: &Bench) {
    let checksum = |bench: &Bench| {
        bench.json("thermyo board emulated info")["status"]["config_checksum"].clone()
    };
    let before = checksum(bench);
    let file = bench.path("read.toml").display().to_string();
    bench.ok(&format!("thermyo board emulated config read {file}"));
    assert!(
        bench.refused(&format!("thermyo board emulated config read {file}")).contains("exists")
    );
    bench.ok("thermyo board emulated config write scenarios/reproduce.toml");
    assert_ne!(checksum(bench), before);
    bench.ok(&format!("thermyo board emulated config write {file}"));
    assert_eq!(checksum(bench), before);
    fs::write(bench.path("wrong.toml"), "[valve]\ncritical_ratio = 7\n").unwrap();
    let wrong = bench.path("wrong.toml").display().to_string();
    let message = bench.refused(&format!("thermyo board emulated config write {wrong}"));
    assert!(message.contains("wrong.toml:2: valve.critical_ratio = 7"), "{message}");
    assert_eq!(checksum(bench), before, "refused as a whole");
}

/// A run on the board is recorded like a simulated one, and replays to the bit.
fn assert_a_drive_is_recorded(bench: &Bench) {
    fs::write(bench.path("steps.csv"), "time_s,pressure_pa\n0,120000\n0.2,140000\n0.6,125000\n")
        .unwrap();
    let steps = bench.path("steps.csv").display().to_string();
    // The drive begins once the muscle has vented.
    bench.ok("thermyo board emulated set pressure 2bar --arm --hold 1");
    let run = format!("thermyo board emulated drive {steps} --arm --quiet --out out/drive");
    let summary = bench.json(&run);
    assert_eq!(summary["lost_steps"], 0, "{summary}");
    assert!(summary["timing"]["step_mean_us"].as_f64().unwrap() > 10.0, "{summary}");
    let trace = fs::read_to_string(bench.path("out/drive/trace.csv")).unwrap();
    let first_pa: f64 = trace.lines().nth(1).unwrap().split(',').nth(1).unwrap().parse().unwrap();
    assert!(first_pa < 1.06e5, "{first_pa}");
    let replayed = bench.json("thermyo replay out/drive/trace.csv --out out/again");
    assert_eq!((&replayed["steps"], &replayed["mismatches"]), (&601.into(), &0.into()));
    let report = fs::read_to_string(bench.path("out/drive/report.html")).unwrap();
    for text in ["s on the emulated board, ", " µs<"] {
        assert!(report.contains(text), "{text}");
    }
}

/// A busy emulated board closes connections: the link is opened again, until patience ends.
#[test]
fn a_connection_that_is_closed_is_opened_again() {
    let bench = Bench::new();
    bench.ok("thermyo board emulated plug");
    let card = fs::read_dir(bench.path("")).unwrap().map(|file| file.unwrap().path());
    let card = card.into_iter().find(|file| file.extension().is_none() && file.is_file()).unwrap();
    let real = fs::read_to_string(&card).unwrap();
    let (port, build) = real.split_once(' ').unwrap();
    let door = TcpListener::bind("127.0.0.1:0").unwrap();
    let before_it = format!("{} {build}", door.local_addr().unwrap().port());
    let board = TcpStream::connect(("127.0.0.1", port.parse().unwrap())).unwrap();
    let turned_away = Arc::new(AtomicU32::new(0));
    let count = Arc::clone(&turned_away);
    // Closes the first connections, and connects the next one to the board.
    thread::spawn(move || {
        for client in door.incoming().map_while(Result::ok) {
            if count.fetch_add(1, Ordering::Relaxed) < 3 {
                continue;
            }
            for (mut from, mut to) in [(&client, &board), (&board, &client)]
                .map(|(from, to)| (from.try_clone().unwrap(), to.try_clone().unwrap()))
            {
                thread::spawn(move || std::io::copy(&mut from, &mut to));
            }
        }
    });
    // The board looks at its card every half second while it has a client.
    fs::write(&card, before_it).unwrap();
    assert!(bench.ok("thermyo board emulated info").contains(" RP2040, firmware "));
    assert!(turned_away.load(Ordering::Relaxed) > 3);

    // A port that accepts and stays silent: wiring is not to blame.
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    fs::write(&card, format!("{} {build}", silent.local_addr().unwrap().port())).unwrap();
    let message = bench.refused("thermyo board emulated info");
    assert!(message.contains("the emulated board does not answer (version): "), "{message}");
    assert!(!message.contains("wiring") && message.contains("board emulated plug"), "{message}");
}

#[test]
fn a_saved_configuration_survives_a_power_cut() {
    let bench = Bench::new();
    let info = |bench: &Bench| bench.ok("thermyo board emulated info");
    assert!(
        bench.refused("thermyo board emulated config save").contains("does not know its muscle")
    );
    bench.ok("thermyo board emulated config write scenarios/contraction.toml");
    assert!(bench.ok("thermyo board emulated config save").contains("from flash"));
    assert!(bench.ok("thermyo board emulated history").contains("neither vented by itself nor"));
    bench.ok("thermyo board emulated unplug");
    let found = info(&bench);
    assert!(found.contains("contraction, ") && found.contains("from flash"), "{found}");
    assert!(found.contains("armed:         no"), "{found}");
    bench.ok("thermyo board emulated config forget");
    bench.ok("thermyo board emulated unplug");
    let found = info(&bench);
    assert!(found.contains("the core's defaults") && found.contains("not configured"), "{found}");
}

/// The board used to be opened first, so that an error in the file name waited for it.
#[test]
fn a_file_that_is_refused_is_so_without_a_board() {
    let bench = Bench::new();
    let said = bench.refused("thermyo board /dev/nothing config write absent.toml");
    assert!(said.ends_with("absent.toml: no such file\n"), "{said}");
}

/// Earlier, only `config write` warned.
#[test]
fn a_scenario_that_is_plugged_in_is_warned_of() {
    let bench = Bench::new();
    let scenario = bench.path("loose.toml");
    fs::write(&scenario, "[supply]\npressure_pa = 7\n").unwrap();
    let line = format!("thermyo board emulated plug {}", scenario.display());
    let warned = bench.run(&line).ok().err;
    assert!(warned.contains("loose.toml:2: supply.pressure_pa = 7.0: not above "), "{warned}");
}

/// A table of twelve rows makes the longest configuration, which the flash used to refuse as worn out.
#[test]
fn the_longest_configuration_is_saved_too() {
    let bench = Bench::new();
    let shipped =
        |name: &str| fs::read_to_string(repository().join("scenarios").join(name)).unwrap();
    let rows = shipped("bellows.csv") + "0.135,2.0395e-04,661.5\n";
    fs::write(bench.path("twelve.csv"), rows).unwrap();
    let scenario = bench.path("a-name-of-24-characters.toml");
    let digital = "\n[sensor.gas]\nkind = \"max31865\"\n[sensor.pressure]\nkind = \"mpr\"\n";
    let text = shipped("bellows.toml").replace("bellows.csv", "twelve.csv") + digital;
    fs::write(&scenario, text).unwrap();
    let scenario = scenario.display();
    bench.ok(&format!("thermyo board emulated plug {scenario}"));
    bench.ok(&format!("thermyo board emulated config write {scenario}"));
    assert!(bench.ok("thermyo board emulated config save").contains("from flash"));
    bench.ok(&format!("thermyo board emulated plug {scenario}"));
    let found = bench.ok("thermyo board emulated info");
    assert!(found.contains("a-name-of-24-characters, ") && found.contains("from flash"), "{found}");
}

#[test]
fn commands_to_a_board_print_json_on_request() {
    let bench = Bench::new();
    for (line, key, expected) in [
        ("plug", "/plugged", json!(true)),
        ("config write scenarios/contraction.toml", "/config_name", json!("contraction")),
        ("config save", "/config_checksum", json!(null)),
        ("config read out/read.toml", "/file", json!(null)),
        ("clear", "/faults", json!(null)),
        ("arm", "/armed_pa", json!(null)),
        ("set pressure 130000 --hold 1", "/mean_pressure_pa", json!(null)),
        ("stop", "/mode", json!("vent")),
        ("info", "/version/protocol", json!(null)),
        ("history", "", json!(null)),
        ("config forget", "/saved", json!(false)),
        ("unplug", "/plugged", json!(false)),
    ] {
        let printed = bench.ok(&format!("thermyo board emulated {line} --json --quiet"));
        let json: serde_json::Value = serde_json::from_str(&printed).unwrap_or_default();
        let value = json.pointer(key).unwrap_or_else(|| panic!("{line}: {printed}"));
        assert!(!value.is_null(), "{line}: {printed}");
        assert!(expected.is_null() || *value == expected, "{line}: {printed}");
    }
    assert_eq!(bench.ok("thermyo board emulated plug --quiet"), "");
    assert_eq!(bench.ok("thermyo board emulated stop --quiet"), "");
    assert!(bench.ok("thermyo board emulated info --quiet").contains("faults:"));
}

/// Cargo builds every image under the same name. This cargo takes each from the bench's images, and lasts a while
/// longer, during which the other command builds.
#[cfg(unix)]
#[test]
fn images_that_two_commands_build_at_once_are_not_mistaken() {
    let images = [Variant::Standard, Variant::Joint].map(|variant| firmware(variant).unwrap());
    let bench = Bench::new();
    let (cargo, target) = (bench.path("cargo"), bench.path("target"));
    let built = target.join("firmware/thumbv6m-none-eabi/release");
    fs::create_dir_all(&built).unwrap();
    let [standard, joint] = images.each_ref().map(|image| image.display());
    let built = built.display();
    let script = format!(
        "#!/bin/sh\ncase \"$*\" in\n*joint*) cp {joint} {built}/firmware ;;\n*) cp {standard} {built}/firmware ;;\n\
         esac\nsleep 0.5\n"
    );
    fs::write(&cargo, script).unwrap();
    fs::set_permissions(&cargo, std::os::unix::fs::PermissionsExt::from_mode(0o755)).unwrap();
    let flash = |drive: &str, options: &str| {
        let drive = bench.path(drive);
        fs::create_dir_all(&drive).unwrap();
        fs::write(drive.join("INFO_UF2.TXT"), "Board-ID: RPI-RP2\n").unwrap();
        let mut command = bench.command(&format!("thermyo flash {} {options}", drive.display()));
        (command.env("CARGO", &cargo).env("CARGO_TARGET_DIR", &target).spawn().unwrap(), drive)
    };
    let written = |(mut command, drive): (Child, PathBuf)| {
        assert!(command.wait().unwrap().success());
        fs::read(drive.join("thermyo.uf2")).unwrap()
    };
    let alone =
        [("one", ""), ("two", "--joint")].map(|(drive, joint)| written(flash(drive, joint)));
    let both = [("three", ""), ("four", "--joint")].map(|(drive, joint)| flash(drive, joint));
    assert!(alone[0] != alone[1]);
    assert!(both.map(written) == alone, "an image is that of the other command");
}

/// A scenario with a joint brings the joint's image, two muscles and their arm.
#[test]
fn a_joint_is_plugged_in_by_its_scenario() {
    firmware(Variant::Joint).unwrap();
    let bench = Bench::new();
    let scenario = "scenarios/joint_board.toml";
    let plugged = bench.ok(&format!("thermyo board emulated plug {scenario}"));
    assert_eq!(plugged, "plugged in: a joint\n");
    let muscle = bench.refused("thermyo board emulated config write scenarios/contraction.toml");
    assert!(muscle.contains("has no [joint]") && muscle.contains("emulated plug"), "{muscle}");
    let set = "thermyo board emulated set angle 20deg --stiffness 14";
    assert!(bench.refused(set).contains("config write"));
    let written = bench.ok(&format!("thermyo board emulated config write {scenario}"));
    assert!(written.starts_with("joint_board, "), "{written}");
    assert!(bench.refused(set).contains("not armed"));
    let degrees = bench.refused("thermyo board emulated set angle 20 --stiffness 14 --arm");
    assert!(degrees.ends_with(" to 45.837 deg, the stops; use 20deg\n"), "{degrees}");
    let beyond = bench.refused("thermyo board emulated set angle 90deg --stiffness 14 --arm");
    assert!(beyond.ends_with(" to 45.837 deg, the stops\n"), "{beyond}");
    // Used to propose 2deg.
    let radians = bench.refused("thermyo board emulated set angle 2rad --stiffness 14 --arm");
    assert!(radians.ends_with(" to 45.837 deg, the stops\n"), "{radians}");
    assert!(bench.ok("thermyo board emulated info").contains("armed:         no"));
    let armed = bench.ok("thermyo board emulated arm --max-pressure 5bar");
    assert!(armed.contains("500.0 kPa, absolute, in either muscle; above 5"), "{armed}");
    let held = bench.json(&format!("{set} --hold 1.5"));
    let angle_rad = held["angle_rad"].as_f64().unwrap();
    assert!((angle_rad - 0.349).abs() < 0.02, "{held}");
    let stiffness = held["stiffness_n_m_rad"].as_f64().unwrap();
    assert!((stiffness - 14.0).abs() < 1.0, "{held}");
    assert_pressures_and_duties_are_taken(&bench);
    assert_a_lock_ends(&bench);
    let info = bench.ok("thermyo board emulated info");
    assert!(info.contains(", a joint\n") && info.contains("; 0 missed of "), "{info}");
    for (sensor, why) in [
        ("gas", "give --muscle a or --muscle b"),
        ("length --muscle a", "calibrate angle"),
        ("angle --muscle a", "leave out --muscle"),
    ] {
        let refused = bench.refused(&format!("thermyo board emulated calibrate {sensor}"));
        assert!(refused.contains(why), "{refused}");
    }
    let history = bench.ok("thermyo board emulated history");
    assert!(history.contains("neither vented by itself nor"), "{history}");
    assert_a_configuration_comes_back(&bench);
    bench.ok(&format!("thermyo board emulated config write {scenario}"));
    assert_a_joint_is_driven(&bench);
    assert_eq!(bench.ok("thermyo board emulated stop"), "both muscles vent\n");
    let left = bench.ok("thermyo board emulated clear");
    assert!(left.starts_with("no fault is left; it vents until "), "{left}");

    bench.ok("thermyo board emulated plug");
    assert!(!bench.ok("thermyo board emulated info").contains("a joint"));
    let angle = bench.refused("thermyo board emulated calibrate angle");
    assert!(angle.contains("the board drives one muscle"), "{angle}");
    let joint = bench.refused(&format!("thermyo board emulated config write {scenario}"));
    assert!(joint.contains("has a [joint]") && joint.contains("emulated plug"), "{joint}");
    assert_eq!(bench.refused(&format!("thermyo board emulated drive {scenario} --arm")), joint);
    assert!(bench.refused(set).contains("thermyo flash --joint"));
}

/// A configuration that is read and written back stays the same.
fn assert_a_configuration_comes_back(bench: &Bench) {
    let read = bench.path("read.toml").display().to_string();
    let checksum = |line: &str| {
        let printed = bench.json(&format!("thermyo board emulated config {line} {read}"));
        printed["config_checksum"].clone()
    };
    let was = checksum("read");
    assert!(was.is_number(), "{was}");
    assert!(fs::read_to_string(&read).unwrap().contains("[joint]"));
    let refused = bench.refused(&format!("thermyo board emulated config read {read}"));
    assert!(refused.contains("exists"), "{refused}");
    assert_eq!(checksum("write"), was);
}

fn assert_pressures_and_duties_are_taken(bench: &Bench) {
    let set = "thermyo board emulated set";
    let held = bench.json(&format!("{set} pressures 2bar 2.5bar --hold 1.5"));
    for (side, wanted_pa) in [2.0e5, 2.5e5].into_iter().enumerate() {
        let pressure_pa = held["pressure_pa"][side].as_f64().unwrap();
        assert!((pressure_pa - wanted_pa).abs() < 4000.0, "{held}");
    }
    let bar = bench.refused(&format!("{set} pressures 2bar 1.3"));
    assert!(bar.contains(" kPa; use 1.3bar, which is 130000 Pa\n"), "{bar}");
    let high = bench.refused(&format!("{set} pressures 2bar 9bar"));
    let expected = "a pressure of 900 kPa: must be from 101.33 kPa (ambient, as the board is configured) to 689.5 kPa";
    assert!(high.contains(expected), "{high}");
    // Inlet of muscle a open, outlet of muscle b.
    let filled = bench.json(&format!("{set} duties 30% 0 0 1 --hold 0.3"));
    let [a, b] = [0, 1].map(|side: usize| filled["pressure_pa"][side].as_f64().unwrap());
    assert!(a > b + 5.0e4, "{filled}");
    let duty = bench.refused(&format!("{set} duties 0 0 1.1 0"));
    assert!(duty.contains("a duty of the inlet of 110 %: must be from 0 to 100 %"), "{duty}");
}

/// A course on the joint's board is recorded like a simulated run, and replays to the bit.
fn assert_a_joint_is_driven(bench: &Bench) {
    let course = bench.path("course.csv");
    let drive = format!("thermyo board emulated drive {} --out out/drive", course.display());
    let write = |rows: &str| {
        fs::write(&course, format!("time_s,angle_rad,stiffness_n_m_rad\n0,0,14\n{rows}")).unwrap();
    };
    write("0.5,0.95,14\n");
    let far = bench.refused(&format!("{drive} --arm"));
    assert!(
        far.contains("course.csv:3: column angle_rad = 0.95: must be a number from -0.8"),
        "{far}"
    );
    write("");
    assert!(bench.refused(&drive).contains("column time_s: ends at 0.0 s: must end after 0 s"));
    write("0.2,0,14\n0.6,0.2,14\n0.8,0.2,12\n");
    assert!(bench.refused(&drive).contains("not armed"));
    assert!(bench.refused(&format!("{drive} --kind duty")).contains("are for one muscle"));
    let muscle = "thermyo board emulated drive scenarios/contraction.toml --arm";
    let muscle = bench.refused(muscle);
    assert!(muscle.contains("contraction.toml: has no [joint], and the board drives"), "{muscle}");
    let driven = bench.json(&format!("{drive} --arm"));
    assert_eq!((&driven["duration_s"], &driven["lost_steps"]), (&0.8.into(), &0.into()));
    // On a busy machine set points come late: 0.024 rad with six programs per processor.
    assert!(driven["rms_error_rad"].as_f64().unwrap() < 0.05, "{driven}");
    let page = fs::read_to_string(bench.path("out/drive/report.html")).unwrap();
    // A board measures neither of them.
    assert!(page.contains("estimate") && !page.contains("(plant)") && !page.contains("Tension"));
    let replayed = bench.json("thermyo replay out/drive --out out/again");
    assert_eq!((&replayed["steps"], &replayed["mismatches"]), (&801.into(), &0.into()));
}

/// Without a time to hold.
fn assert_a_lock_ends(bench: &Bench) {
    let set = "thermyo board emulated set";
    let negative = bench.refused(&format!("{set} torque 0.5 --stiffness -8"));
    assert!(negative.contains("a stiffness of -8 N m/rad: must be from 0 to "), "{negative}");

    assert!(bench.refused(&format!("{set} lock")).contains("joint.lock_s = 0: must be above 0"));
    let text = fs::read_to_string(repository().join("scenarios/joint_board.toml")).unwrap();
    let locking = bench.path("locking.toml");
    fs::write(&locking, text.replace("[joint]", "[joint]\nlock_s = 0.8")).unwrap();
    bench.ok(&format!("thermyo board emulated config write {}", locking.display()));
    let locked = bench.ok(&format!("{set} lock --arm"));
    assert!(locked.contains(", locked\n") && locked.ends_with(", vent; it vents\n"), "{locked}");
}

/// The lines that begin with `thermyo` in code blocks of the document, for the emulated board.
fn documented(document: &str) -> Vec<String> {
    let text = fs::read_to_string(repository().join(document)).unwrap();
    let lines =
        text.lines().filter_map(|line| line.trim_start().strip_prefix("thermyo board PORT "));
    let commands = lines.map(|line| line.split("  ").next().unwrap_or(line).trim());
    commands.map(|line| format!("thermyo board emulated {line}")).collect()
}

#[test]
fn every_line_of_the_document_runs() {
    let bench = Bench::new();
    let lines = documented("docs/how-to/start-a-board.md");
    assert!(lines.len() >= 8, "{lines:?}");
    for line in lines {
        bench.ok(&line);
    }
}
