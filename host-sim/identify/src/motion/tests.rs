//! Muscles with known slip and creep, from their own plan; values that a record cannot show; records that cannot be
//! used.

use super::*;
use crate::{IdentifyError, identify_table};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use std::sync::atomic::{AtomicUsize, Ordering};
use thermyo_files::shipped;
use thermyo_record::trace::Row as Sample;
use thermyo_scenario::DriveKind;
use thermyo_simulation::board::CoreBoard;
use thermyo_simulation::run;

const CONFIG: &str = "scenarios/motion.toml";

fn shipped_scenario() -> Loaded {
    thermyo_setup::parse(shipped::text("motion.toml"), CONFIG.as_ref()).unwrap()
}

fn table(text: &str) -> Table {
    Table::parse(text, "motion.csv".as_ref()).unwrap()
}

/// Set points of pressure from the plan.
fn planned(loaded: &Loaded) -> Vec<(f64, f64)> {
    let (text, _) = plan(loaded, CONFIG.as_ref()).unwrap();
    let plan = table(&text);
    let [times, pressures] = ["time_s", "pressure_pa"].map(|name| plan.filled(name).unwrap());
    times.into_iter().zip(pressures).collect()
}

/// Steps whose mean is a row: two periods of the valves, which shake the pressure.
const ROW_STEPS: u32 = 20;

/// Record of the plant at 50 rows a second, with noise of 20 um and 300 Pa.
fn record(loaded: &Loaded, points: Vec<(f64, f64)>) -> String {
    noisy_record(loaded, points, 300.0)
}

fn noisy_record(loaded: &Loaded, points: Vec<(f64, f64)>, noise_pa: f64) -> String {
    let driven = loaded.driven(DriveKind::Pressure, points);
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let mut text = "time_s,length_m,pressure_pa\n".to_owned();
    let mut sums = (0, [0.0; 3]);
    let mut observer = |row: &Sample| {
        let truth = &row.truth;
        let values = [truth.time_s, truth.length_m, truth.pressure_pa];
        let (count, sum) = &mut sums;
        *count += 1;
        for (sum, value) in sum.iter_mut().zip(values) {
            *sum += value;
        }
        if *count == ROW_STEPS {
            let [time_s, length_m, pressure_pa] = sum.map(|sum| sum / f64::from(ROW_STEPS));
            let [a, b]: [f64; 2] = std::array::from_fn(|_| StandardNormal.sample(&mut random));
            let (length_m, pressure_pa) = (length_m + 2e-5 * a, pressure_pa + noise_pa * b);
            text += &format!("{time_s:.4},{length_m:.6},{pressure_pa:.0}\n");
            sums = (0, [0.0; 3]);
        }
        Ok(())
    };
    run::run(&driven, &mut CoreBoard::default(), None, &mut observer).unwrap();
    text
}

/// Values of [`other`].
const TRUTHS: [(&str, f64); 7] = [
    ("muscle.slip_force_n", 9.0),
    ("muscle.slip_stiffness_n_m", 4500.0),
    ("muscle.creep_fast_n_m", 1800.0),
    ("muscle.creep_slow_n_m", 2100.0),
    ("muscle.creep_fast_s", 0.7),
    ("muscle.creep_slow_s", 15.0),
    ("muscle.bladder_saturation_n", 230.0),
];

/// A muscle other than the scenario's.
fn other() -> Loaded {
    shipped_scenario().with(|scenario| {
        scenario.load.mass_kg = 0.2;
        let muscle = &mut scenario.muscle;
        (muscle.bladder_saturation_n, muscle.bladder_strain) = (230.0, 0.026);
        (muscle.slip_force_n, muscle.slip_stiffness_n_m) = (9.0, 4500.0);
        (muscle.creep_fast_n_m, muscle.creep_fast_s) = (1800.0, 0.7);
        (muscle.creep_slow_n_m, muscle.creep_slow_s) = (2100.0, 15.0);
    })
}

#[test]
fn a_muscle_is_found_from_its_own_plan() {
    let muscle = other();
    let text = record(&muscle, planned(&muscle));
    let all: Vec<&str> = text.lines().collect();
    // A second record of the same muscle: the middle of the first.
    let second = [&all[..1], &all[3000..8000]].concat().join("\n") + "\n";
    let found =
        identify(&shipped_scenario(), CONFIG.as_ref(), &table(&text), Some(&table(&second)), &())
            .unwrap();
    let findings = &found.findings;
    println!("{}", findings.text());
    assert!(findings.holds && findings.open.is_empty(), "{findings:?}");
    for (key, truth) in TRUTHS {
        let Fitted { value, standard_error, .. } = findings.parameters[key];
        assert!((value / truth - 1.0).abs() < 0.1, "{key}: {value} for {truth}");
        let off = (value - truth).abs() / standard_error.unwrap();
        assert!(off < 6.0, "{key}: {value} for {truth}, {off} standard errors");
    }
    let [length_m, against_m] =
        [&findings.rmse, findings.against.as_ref().unwrap()].map(|left| left.length_m.unwrap());
    assert!((1.5e-5..1e-4).contains(&length_m), "{length_m} m");
    assert!((1.5e-5..2e-4).contains(&against_m), "{against_m} m");
}

/// A channel that is late by a row, 20 ms, used to give a fast creep 8 stated errors off without a word.
#[test]
fn a_channel_that_is_late_is_named() {
    let muscle = other();
    let text = record(&muscle, planned(&muscle));
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
    let late = |column: usize| {
        let row = |i: usize| {
            let mut row = rows[i].clone();
            row[column] = rows[if i > 1 { i - 1 } else { i }][column];
            row.join(",") + "\n"
        };
        let text: String = (0..rows.len()).map(row).collect();
        identify(&shipped_scenario(), CONFIG.as_ref(), &table(&text), None, &()).unwrap().findings
    };
    for (column, name) in [(1, "length_m"), (2, "pressure_pa")] {
        let found = late(column);
        println!("{}", found.text());
        let failed = found.failed().unwrap();
        let delay =
            failed.strip_prefix(&format!("{name} seems ")).unwrap_or_else(|| panic!("{failed}"));
        let delay_ms: f64 = delay.split(' ').next().unwrap().parse().unwrap();
        assert!((13.0..27.0).contains(&delay_ms) && !found.holds, "{failed}");
    }
}

/// A load that is 1 % heavier than configured, and a pressure reading that is 3 kPa too high.
#[test]
fn stated_errors_contain_a_load_and_a_pressure_that_are_off() {
    let lifts = |loaded: Loaded, mass_kg| loaded.with(|scenario| scenario.load.mass_kg = mass_kg);
    let muscle = lifts(other(), 5.05);
    let text = record(&muscle, planned(&muscle));
    let high = |line: &str| {
        let (rest, pressure_pa) = line.rsplit_once(',').unwrap();
        pressure_pa
            .parse()
            .map_or(format!("{line}\n"), |pa: f64| format!("{rest},{}\n", pa + 3.0e3))
    };
    let text: String = text.lines().map(high).collect();
    let believed = lifts(shipped_scenario(), 5.0);
    let found = identify(&believed, CONFIG.as_ref(), &table(&text), None, &()).unwrap().findings;
    println!("{}", found.text());
    for (key, truth) in TRUTHS {
        let Fitted { value, standard_error, .. } = found.parameters[key];
        let off = (value - truth).abs() / standard_error.unwrap();
        assert!(off < 3.0, "{key}: {value} for {truth}, {off} standard errors");
    }
}

/// Noise of pressure, as of a converter of 10 bits, moves the predicted slip and not the measured one: taken row by row
/// it used to make the slip 1.6 times as stiff.
#[test]
fn a_noisy_pressure_leaves_the_slip_as_stiff_as_it_is() {
    let muscle = other();
    let text = noisy_record(&muscle, planned(&muscle), 2000.0);
    let found =
        identify(&shipped_scenario(), CONFIG.as_ref(), &table(&text), None, &()).unwrap().findings;
    println!("{}", found.text());
    for (key, truth) in &TRUTHS[..4] {
        let ratio = found.parameters[*key].value / truth;
        assert!((0.85..1.15).contains(&ratio), "{key}: {ratio} of {truth}");
    }
}

/// The plant has the viscous part in addition to creep: identified as creep it would count twice.
#[test]
fn viscous_friction_is_no_creep() {
    let viscous = |loaded: Loaded| loaded.with(|scenario| scenario.friction.viscous_n_s_m = 400.0);
    let muscle = viscous(other());
    let text = record(&muscle, planned(&muscle));
    let configured = viscous(shipped_scenario());
    let found = identify(&configured, CONFIG.as_ref(), &table(&text), None, &()).unwrap().findings;
    println!("{}", found.text());
    for (key, truth) in &TRUTHS[..5] {
        let ratio = found.parameters[*key].value / truth;
        assert!((0.93..1.07).contains(&ratio), "{key}: {ratio} of {truth}");
    }
}

/// Rows of a muscle between ends that a load cell holds at these lengths, by time; the first half second is vented.
fn framed(duration_s: f64, of: impl Fn(f64) -> (f64, f64)) -> Vec<record::Row> {
    let row = |i: u32| {
        let time_s = 0.01 * f64::from(i);
        let (length_m, pressure_pa) = of(time_s);
        let pressure_pa = if time_s < 0.5 { 101_325.0 } else { pressure_pa };
        record::Row { time_s, length_m, pressure_pa, force_n: 0.0, weight: 1.0 }
    };
    (0..(100.0 * duration_s) as u32).map(row).collect()
}

/// A muscle whose ends are closer together than its length does not push, and creeps from its own length on.
#[test]
fn a_slack_muscle_pulls_by_nothing_and_has_its_own_length() {
    let mut scenario = shipped_scenario().plant;
    scenario.friction.viscous_n_s_m = 10.0;
    let forces = |by_cell| {
        let rows = framed(0.51, |_| (0.23, 6.0e5));
        Law::of(&scenario, by_cell).forces(&rows, &Start::default())
    };
    let (slack, pushed) = (forces(true), forces(false));
    assert!(slack[..50].iter().all(|force_n| *force_n == 0.0), "{slack:?}");
    assert!(pushed[49] < -150.0, "{pushed:?}");
    // 20 mm in 10 ms: slip, both creeps, of which the fast one has lost 1 % on the way, and viscous friction.
    let held_n = 6.5 + 0.02 * (0.989 * 2470.0 + 1500.0) + 10.0 * 2.0;
    let more_n = pushed[50] - slack[50];
    assert!((more_n / held_n - 1.0).abs() < 0.01, "{more_n} N of {held_n}");
}

/// A search once tried a slack so large that the muscle is longer than its record, and the command crashed.
#[test]
fn a_muscle_longer_than_its_record_has_the_longest_length() {
    let mut scenario = shipped_scenario().plant;
    scenario.muscle.slack_m = 0.1;
    let rows = framed(0.6, |_| (0.23, 6.0e5));
    let pulls_back = Start { slip_n: 0.0, slow_n: -1000.0 };
    let lengths = Law::of(&scenario, false).lengths(&rows, &pulls_back);
    assert!(lengths.iter().all(|length_m| *length_m == 0.25), "{lengths:?}");
}

#[test]
fn a_muscle_is_found_between_ends_where_it_is_slack_at_times() {
    let rows = framed(40.0, |time_s| {
        let pressure_pa = [4.0e5, 6.0e5, 5.0e5][(time_s / 13.4) as usize];
        (0.235 - 0.012 * (0.6 * time_s).sin(), pressure_pa)
    });
    let truth = other().plant;
    let forces = Law::of(&truth, true).forces(&rows, &Start::default());
    let slack = forces.iter().filter(|force_n| **force_n == 0.0).count();
    assert!((200..2000).contains(&slack), "slack in {slack} rows");
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let noisy = rows.iter().zip(forces).map(|(row, force_n)| {
        let [a, b, c]: [f64; 3] = std::array::from_fn(|_| StandardNormal.sample(&mut random));
        let (length_m, pressure_pa) = (row.length_m + 2e-5 * a, row.pressure_pa + 300.0 * b);
        (format!("{},{length_m},{pressure_pa}", row.time_s), force_n + 0.5 * c)
    });
    let noisy: Vec<_> = noisy.collect();
    let identified = |force_unit: f64| {
        let line = |(row, force_n): &(String, f64)| format!("{row},{}\n", force_unit * force_n);
        let text: String = noisy.iter().map(line).collect();
        let table = table(&format!("time_s,length_m,pressure_pa,force_n\n{text}"));
        identify(&shipped_scenario(), CONFIG.as_ref(), &table, None, &()).unwrap().findings
    };
    let failed = identified(0.001).failed().unwrap();
    assert!(failed.contains("another rest length, load or unit"), "{failed}");
    let found = identified(1.0);
    println!("{}", found.text());
    assert!(found.holds, "{:?}", found.remarks);
    for key in ["slip_force_n", "creep_fast_n_m", "creep_slow_n_m", "bladder_saturation_n"] {
        let key = format!("muscle.{key}");
        let ratio =
            found.parameters[key.as_str()].value / thermyo_scenario::number(&truth, &key).unwrap();
        assert!((0.9..1.1).contains(&ratio), "{key}: {ratio}");
    }
    let length_m = found.rmse.length_m.unwrap();
    assert!((1e-5..2e-4).contains(&length_m), "{length_m} m");
}

/// The identified slip contains the friction of the record: configured in addition, a muscle's friction would be
/// compensated twice.
#[test]
fn friction_does_not_stay_beside_the_slip_that_contains_it() {
    let mut muscle = shipped_scenario();
    muscle.plant.identify.parameters =
        ["muscle.slip_force_n", "muscle.slip_stiffness_n_m"].map(str::to_owned).to_vec();
    for scenario in [&mut muscle.plant, &mut muscle.believed] {
        (scenario.friction.force_n, scenario.friction.stribeck_force_n) = (5.0, 1.0);
    }
    let table = table(&record(&muscle, planned(&muscle)));
    let found = identify(&muscle, CONFIG.as_ref(), &table, None, &()).unwrap();
    let slip_n = found.findings.parameters["muscle.slip_force_n"].value;
    assert!((10.0..15.0).contains(&slip_n), "{slip_n} N of 6.5 and 6 N");
    for scenario in [&found.scenario.plant, &found.scenario.believed] {
        assert_eq!((scenario.friction.force_n, scenario.friction.stribeck_force_n), (0.0, 0.0));
    }
    let text = found.findings.text();
    let remark = "friction.stribeck_force_n, 6.00 N, are now 0: muscle.slip_force_n has them";
    assert!(text.contains(remark), "{text}");
}

/// A weight, as `thermyo init` writes it, used to be taken for the default 100 N of `load.force_n`.
#[test]
fn a_weight_is_a_load() {
    let row = |i: usize| format!("{},{},2e5,", 0.02 * i as f64, 0.24 - 1e-4 * i as f64);
    let table = table(&rows(row).replace(",force_n", "").replace("2e5,", "2e5"));
    let loaded = |kind, force_n, key: &str| {
        shipped_scenario().with(|scenario| {
            let load = &mut scenario.load;
            (load.kind, load.force_n, load.mass_kg) = (kind, force_n, 5.0);
            scenario.identify.parameters = vec![key.to_owned()];
        })
    };
    let found = |loaded| identify(&loaded, CONFIG.as_ref(), &table, None, &());
    let weight = found(loaded(LoadKind::Mass, 100.0, SLIP_FORCE)).unwrap().findings;
    let force = found(loaded(LoadKind::Isotonic, 5.0 * 9.806_65, SLIP_FORCE)).unwrap().findings;
    assert_eq!((weight.rmse, weight.parameters), (force.rmse, force.parameters));
    let error = found(loaded(LoadKind::Mass, 100.0, "load.force_n")).unwrap_err().to_string();
    assert!(error.contains("load.kind = \"mass\": must be \"isotonic\""), "{error}");
}

/// The law of a scenario without `[identify]`, as `thermyo init` writes it, used to be printed as fitted although it
/// was not.
#[test]
fn laws_of_a_scenario_that_names_no_keys_are_fitted_as_the_shipped_one() {
    let bare = shipped_scenario().with(|scenario| scenario.identify.parameters.clear());
    assert_eq!(baseline::keys(&bare), baseline::keys(&shipped_scenario()));
}

/// Five seconds of a fast sine show no creep of half a minute.
#[test]
fn what_a_record_does_not_show_stays_open() {
    let muscle = shipped_scenario();
    let points = (0..250).map(|i| {
        let t = 0.02 * f64::from(i);
        (t, 2.0e5 + 9.0e4 * (9.0 * t).sin())
    });
    let text = record(&muscle, points.collect());
    let found = identify(&muscle, CONFIG.as_ref(), &table(&text), None, &()).unwrap();
    let Findings { open, holds, parameters, .. } = &found.findings;
    println!("{}", found.findings.text());
    assert!(!holds && open.contains(&"muscle.creep_slow_s"), "{open:?}");
    assert!(!found.findings.text().contains("taken as absolute"));
    let slow = &parameters["muscle.creep_slow_s"];
    assert_eq!((slow.value, slow.standard_error), (26.0, None));
    assert_eq!(found.scenario.plant.muscle.creep_slow_s, 26.0);
    assert!(found.findings.failed().unwrap().contains("--plan motion"));
}

/// Gauge pressures fit as well as absolute ones, with another bladder: only a vented muscle distinguishes them.
#[test]
fn a_record_that_never_vents_is_named() {
    let muscle = shipped_scenario();
    let points = (0..100).map(|i| (0.1 * f64::from(i), 3.0e5 + 9.0e4 * (0.5 * f64::from(i)).sin()));
    let text = record(&muscle, points.collect());
    let (head, rows) = text.split_once('\n').unwrap();
    let filled: String = rows.lines().skip(100).map(|row| format!("{row}\n")).collect();
    let table = table(&format!("{head}\n{filled}"));
    let found = identify(&muscle, CONFIG.as_ref(), &table, None, &()).unwrap();
    let text = found.findings.text();
    assert!(
        text.contains("pressure_pa is taken as absolute, which no row of a vented muscle shows"),
        "{text}"
    );
}

/// Offsets fit as well as the truth: 7.5 mm of length used to become 7.5 mm of slack, and the command was silent.
#[test]
fn offsets_are_named() {
    let doubts = |rest_m: f64, off_m: f64, off_pa: f64, force: &str| {
        let row = |i: usize| {
            let (way_m, gauge_pa) = (8e-4 * rest_m * i as f64, 4e3 * i as f64);
            let cells = (rest_m - way_m + off_m, 101_325.0 + gauge_pa + off_pa);
            format!("{},{},{}{force}", 0.02 * i as f64, cells.0, cells.1)
        };
        let text = rows(row);
        let text = if force.is_empty() { text.replace(",force_n", "") } else { text };
        let muscle = shipped_scenario().with(|scenario| scenario.muscle.rest_length_m = rest_m);
        Record::of(&table(&text), &muscle.plant).unwrap().doubts(&muscle.plant).join("; ")
    };
    for rest_m in [0.06, 0.1, 0.15, 0.25, 0.3, 0.5] {
        assert_eq!(doubts(rest_m, 0.01 * rest_m, -5e3, ""), "");
        assert_eq!(doubts(rest_m, -0.01 * rest_m, 5e3, ""), "");
        // Between ends that a load cell holds, a muscle has any length.
        assert_eq!(doubts(rest_m, -0.05 * rest_m, 0.0, ",9"), "");
    }
    let length = "the largest length_m, 0.2575 m, is 7.5 mm off muscle.rest_length_m = 0.25";
    assert!(doubts(0.25, 0.0075, 0.0, "").starts_with(length));
    assert!(doubts(0.25, -0.0125, 0.0, "").contains(", is -12.5 mm off"));
    let pressure = "the lowest pressure_pa, 86325 Pa, is below ambient.pressure_pa = 101325.0";
    assert!(doubts(0.25, 0.0, -15e3, "").starts_with(pressure));
    assert!(doubts(0.25, 0.0, 3e4, "").starts_with("pressure_pa is taken as absolute"));
}

/// Stops after this number of questions.
struct StopsAfter {
    questions: AtomicUsize,
}

impl Watch for StopsAfter {
    fn stopped(&self) -> bool {
        self.questions.fetch_add(1, Ordering::Relaxed) >= 4
    }
}

#[test]
fn a_search_that_is_stopped_has_no_result() {
    let muscle = shipped_scenario();
    let points =
        (0..250).map(|i| (0.02 * f64::from(i), 2.0e5 + 9.0e4 * (0.2 * f64::from(i)).sin()));
    let table = table(&record(&muscle, points.collect()));
    let watch = StopsAfter { questions: AtomicUsize::new(0) };
    let data = Path::new("motion.csv");
    let stopped = identify_table(&muscle, CONFIG.as_ref(), &table, data, None, &watch);
    assert!(matches!(stopped, Err(IdentifyError::Stopped { .. })));
    let asked = watch.questions.load(Ordering::Relaxed);
    assert!((5..100).contains(&asked), "it went on for {asked} evaluations");
}

/// Neither the origin of the times nor a value at its limit depends on the last digits.
#[test]
fn a_record_may_begin_anywhere() {
    let muscle = shipped_scenario();
    let points: Vec<(f64, f64)> = (0..1500)
        .map(|i| 0.02 * f64::from(i))
        .map(|time_s| (time_s, 2.0e5 + 9.0e4 * (0.9 * time_s).sin() + 2e3 * time_s))
        .collect();
    let text = record(&muscle, points);
    let moved = |first_s: f64| {
        let line = |line: &str| match line.split_once(',') {
            Some((time, rest)) => match time.parse::<f64>() {
                Ok(time_s) => format!("{:.4},{rest}\n", first_s + time_s),
                Err(_) => format!("{line}\n"),
            },
            None => String::new(),
        };
        let text: String = text.lines().map(line).collect();
        Record::of(&table(&text), &muscle.plant).unwrap()
    };
    let usual = moved(0.0);
    for first_s in [-7.5, 1.0, 1.0e5] {
        let other = moved(first_s);
        assert!(other == usual && other.thinned(200) == usual.thinned(200), "{first_s} s");
    }
}

/// Read in minutes, rows are too close together or, if there are few, the motion is too fast.
#[test]
fn a_record_in_minutes_is_named() {
    let read = |rows_per_s: f64| {
        let mut text = "time_s,length_m,pressure_pa\n".to_owned();
        for i in 0..400 {
            let time_s = f64::from(i) / rows_per_s;
            let swing = (4.0 * time_s).sin();
            let (length_m, pressure_pa) = (0.23 - 0.015 * swing, 2.0e5 + 9.0e4 * swing);
            text += &format!("{},{length_m},{pressure_pa}\n", time_s / 60.0);
        }
        Record::of(&table(&text), &shipped_scenario().plant).unwrap_err().to_string()
    };
    let close = "motion.csv:3: column time_s = 0.0003333333333333333: must be at least 0.0004 s after the row before \
                 it: is this min or h?";
    assert!(read(50.0).starts_with(close), "{}", read(50.0));
    let fast = read(20.0);
    assert!(fast.starts_with("motion.csv:7: column time_s = 0.00416"), "{fast}");
    assert!(
        fast.contains("no more than 2.50 m/s, 10 times muscle.rest_length_m in a second"),
        "{fast}"
    );
}

/// The same holds if pressure and length drive a muscle and its gas sensor is compared.
#[test]
fn a_record_of_a_gas_sensor_in_other_units_is_named() {
    let scenario = "[muscle]\nrest_length_m = 0.25\n[identify]\nparameters = [\"sensor.gas.time_constant_s\"]\n\
                    columns = [\"sensor_gas_k\"]\n";
    let loaded = thermyo_setup::parse(scenario, CONFIG.as_ref()).unwrap();
    let message = |time_unit: f64, rows_per_s: f64, length: fn(f64) -> f64, pressure_unit: f64| {
        let mut text = "time_s,length_m,pressure_pa,sensor_gas_k,duty_in,duty_out\n".to_owned();
        for i in 0..400 {
            let time_s = f64::from(i) / rows_per_s;
            let swing = (4.0 * time_s).sin();
            let (length_m, pressure_pa) =
                (length(0.23 - 0.015 * swing), pressure_unit * (2.0e5 + 9.0e4 * swing));
            text += &format!("{},{length_m},{pressure_pa},298,0,0\n", time_unit * time_s);
        }
        let said = |text: &str| {
            let data = Path::new("motion.csv");
            let found = identify_table(&loaded, CONFIG.as_ref(), &table(text), data, None, &());
            found.unwrap_err().to_string()
        };
        // So are the columns from which stops are found.
        let measured = said(&text.replace("length_m,p", "measured_length_m,measured_p"));
        assert!(time_unit < 1.0 || measured == said(&text).replace("column ", "column measured_"));
        said(&text)
    };
    for (error, end) in [
        (
            message(1.0 / 60.0, 50.0, |l| l, 1.0),
            "is this min or h? Leave out rows of a faster record",
        ),
        (message(1.0 / 60.0, 20.0, |l| l, 1.0), "is this min or h?"),
        (message(1.0, 50.0, |l| 1.0 - l / 0.25, 1.0), "is this a contraction, or a stroke?"),
        (message(1.0, 50.0, |l| 104.0 - l / 0.0025, 1.0), "is this a contraction, or a stroke?"),
        (message(1.0, 50.0, |l| 260.0 - 1e3 * l, 1.0), "is this a contraction, or a stroke?"),
        (message(1.0, 50.0, |l| 1e3 * l, 1.0), "is this mm?"),
        (message(1.0, 50.0, |l| 1e2 * l, 1.0), "is this cm?"),
        (message(1.0, 50.0, |l| l, 1e-3), "is this kPa, or psi?"),
    ] {
        assert!(error.starts_with("motion.csv:") && error.ends_with(end), "{error}");
    }
}

/// Times are checked first: the speeds of unordered rows would be taken for another unit.
#[test]
fn times_of_a_gas_sensor_that_do_not_rise_are_named() {
    let scenario =
        "[identify]\nparameters = [\"sensor.gas.time_constant_s\"]\ncolumns = [\"sensor_gas_k\"]\n";
    let loaded = thermyo_setup::parse(scenario, CONFIG.as_ref()).unwrap();
    let message = |time_s: fn(i32) -> f64| {
        let mut text = "time_s,length_m,pressure_pa,sensor_gas_k,duty_in,duty_out\n".to_owned();
        for i in 0..400 {
            let swing = (0.04 * f64::from(i)).sin();
            let (length_m, pressure_pa) = (0.28 - 0.015 * swing, 2.0e5 + 9.0e4 * swing);
            let duty = u8::from((0.04 * f64::from(i)).cos() > 0.0);
            text += &format!("{},{length_m},{pressure_pa},298,{duty},{}\n", time_s(i), 1 - duty);
        }
        let data = Path::new("r.csv");
        identify_table(&loaded, CONFIG.as_ref(), &table(&text), data, None, &())
            .unwrap_err()
            .to_string()
    };
    fn at(i: i32) -> f64 {
        0.01 * f64::from(i)
    }
    for (error, start) in [
        (message(|i| at(399 - i)), "motion.csv:3: column time_s = 3.98: must be at least 3.99,"),
        (message(|i| at(i % 200)), "motion.csv:202: column time_s = 0.0: must be at least 1.99,"),
        (
            message(|i| at(i / 2)),
            "motion.csv:3: column time_s = 0.0: must be later than the row before it",
        ),
    ] {
        assert!(error.starts_with(start), "{error}");
    }
}

/// A record of 100 rows; `of` returns the cells of a row.
fn rows(of: impl Fn(usize) -> String) -> String {
    let head = "time_s,length_m,pressure_pa,force_n\n".to_owned();
    (0..100).fold(head, |text, i| text + &of(i) + "\n")
}

#[test]
fn a_record_that_cannot_be_used_is_named_with_its_line() {
    let good = |i: usize| (0.02 * i as f64, 0.25 - 2e-4 * i as f64, 101_325.0 + 4e3 * i as f64);
    let with = |change: &dyn Fn(usize, (f64, f64, f64)) -> (f64, f64, f64), force_n: f64| {
        let text = rows(|i| {
            let (t, l, p) = change(i, good(i));
            format!("{t:.3},{l:.6},{p:.1},{force_n}")
        });
        let scenario = shipped_scenario().plant;
        Record::of(&table(&text), &scenario).map_err(|error| error.to_string())
    };
    assert!(with(&|_, row| row, 5.0).is_ok());
    for (message, change) in [
        (
            "motion.csv:52: column time_s = 4.0: must be within 0.400 s of the row before it",
            (&|i: usize, (t, l, p): (f64, f64, f64)| (t + if i > 49 { 3.0 } else { 0.0 }, l, p))
                as &dyn Fn(usize, (f64, f64, f64)) -> (f64, f64, f64),
        ),
        ("motion.csv:22: column time_s = 0.0: must be later", &|i, (t, l, p)| {
            (if i == 20 { 0.0 } else { t }, l, p)
        }),
        ("motion.csv:2: column length_m = 250.0: must be a length from 0.125", &|_, (t, l, p)| {
            (t, 1000.0 * l, p)
        }),
        ("motion.csv:2: column length_m = -0.25: must be a length from 0.125", &|_, (t, l, p)| {
            (t, -l, p)
        }),
        (
            "motion.csv:3: column time_s = 20.0: must be at most 0.200 s after the row before it, as slip and creep \
             need: is this ms, or are rows left out?",
            &|_, (t, l, p)| (1000.0 * t, l, p),
        ),
        ("motion.csv:3: column time_s = 4.0: must be at most 0.200 s", &|_, (t, l, p)| {
            (200.0 * t, l, p)
        }),
        (
            "motion.csv:101: column pressure_pa = 497.3: must be absolute and in Pa",
            &|_, (t, l, p)| (t, l, 0.001 * p),
        ),
        ("motion.csv:2: column pressure_pa = 0.0: must be absolute", &|_, (t, l, p)| {
            (t, l, p - 101_325.0)
        }),
        (
            "motion.csv:52: column pressure_pa = 30000000.0: must be at most 3000000.0 Pa",
            &|i, (t, l, p)| (t, l, if i == 50 { 3e7 } else { p }),
        ),
    ] {
        let error = with(change, 5.0).unwrap_err();
        assert!(error.starts_with(message), "{error}");
    }
    let units = [
        ("kPa", 1e-3),
        ("kPa, or psi", 1.0 / 6895.0),
        ("mbar", 1e-2),
        ("bar", 1e-5),
        ("MPa", 1e-6),
    ];
    for (word, factor) in units {
        let error = with(&|_, (t, l, p)| (t, l, factor * p), 5.0).unwrap_err();
        assert!(error.ends_with(&format!("is this {word}?")), "{error}");
    }
    let error = with(&|_, (t, l, p)| (t, 1000.0 * l, p), 5.0).unwrap_err();
    assert!(error.ends_with("is this mm?"), "{error}");
    // The noise of a contraction at rest is negative.
    let error = with(&|_, (t, l, p)| (t, 0.2499 - l, p), 5.0).unwrap_err();
    assert!(error.ends_with("is this a contraction, or a stroke?"), "{error}");
    let error = with(&|_, (t, l, p)| (t, l, p - 101_325.0), 5.0).unwrap_err();
    assert!(error.contains("is this gauge pressure?"), "{error}");
    let error = with(&|_, row| row, 0.0).unwrap_err();
    let message = "motion.csv:2: column force_n = 0.0: must be above 0 somewhere: is the load cell connected?";
    assert!(error.starts_with(message), "{error}");
    // Only the sign is wrong: a stroke measured from the other end.
    let text = rows(|i| {
        let (t, l, p) = good(i);
        format!("{t:.3},{:.6},{p:.1},", 0.5 - l - 0.02)
    })
    .replace(",force_n", "")
    .replace(",\n", "\n");
    let error = Record::of(&table(&text), &shipped_scenario().plant).unwrap_err().to_string();
    let message =
        "motion.csv:101: column length_m = 0.2498: must be shorter where the pressure is higher";
    assert!(error.starts_with(message), "{error}");
    let text = rows(|i| {
        let (t, l, p) = good(i);
        format!("{t:.3},{l:.6},{p:.1},{}", if i == 60 { -50.0 } else { 100.0 })
    });
    let error = Record::of(&table(&text), &shipped_scenario().plant).unwrap_err().to_string();
    assert!(error.starts_with("motion.csv:62: column force_n = -50.0: must be a pull"), "{error}");
}
