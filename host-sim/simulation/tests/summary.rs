//! The figures of a run's summary, on runs.

use thermyo_files::units::UnitSystem;
use thermyo_plant::Ledger;
use thermyo_record::summary::{Accumulator, Ending};
use thermyo_record::tracking::{Controlled, Tracked};
use thermyo_simulation::run;

#[test]
fn a_run_that_was_cut_short_has_no_error_at_the_end() {
    let text = "[run]\nduration_s = 1.0\nlog_every = 1\n[plant]\nmodel = \"lumped\"\n[drive]\n\
                kind = \"pressure\"\n";
    let loaded = thermyo_setup::parse(text, "test".as_ref()).unwrap();
    let rows = run::rows(&loaded).unwrap();
    let ended_at = |steps: usize| {
        let mut accumulator =
            Accumulator::new(loaded.plant.run.duration_s, Tracked::of(&loaded.plant), None);
        rows[..steps].iter().for_each(|row| accumulator.add(row, Some(row.truth.pressure_pa)));
        let ending = Ending {
            limit_cycle: None,
            wall_clock_s: 1.0,
            board: "core",
            period_s: None,
            controlled: Some(Controlled::Pressure),
            rest_length_m: None,
            ledger: Ledger::default(),
            axial_wall_k: Vec::new(),
            axial_gas_k: Vec::new(),
            timing: None,
        };
        accumulator.finish(ending).control.unwrap()
    };
    let cut = ended_at(500);
    assert_eq!(cut.followed.steady_error, None);
    assert!(cut.followed.rms_error > 1000.0);
    assert!(
        cut.text(UnitSystem::Practical).starts_with("set point: RMS error ")
            && !cut.text(UnitSystem::Practical).contains("at the end")
    );
    assert!(serde_json::to_value(cut).unwrap()["steady_error"].is_null());
    let whole = ended_at(rows.len());
    let mean: f64 = rows[900..].iter().map(|row| row.truth.pressure_pa - row.set_point).sum();
    let mean = mean / rows[900..].len() as f64;
    assert!((whole.followed.steady_error.unwrap() - mean).abs() < 1e-9 * mean.abs(), "{mean}");
    assert!(whole.text(UnitSystem::Practical).contains(", at the end "));
}

/// A run of the nominal muscle, or of another scenario.
fn control(text: &str) -> serde_json::Value {
    let text = format!("[run]\nlog_every = 1\n{text}");
    let loaded = thermyo_setup::parse(&text, "test".as_ref()).unwrap();
    let summary = run::on_core(&loaded, |_| ()).unwrap();
    serde_json::to_value(summary.control.unwrap()).unwrap()
}

/// The warning of a run about a loop that swings.
fn unrest(text: &str) -> Option<String> {
    let loaded = thermyo_setup::parse(text, "test".as_ref()).unwrap();
    run::on_core(&loaded, |_| ()).unwrap().unrest()
}

#[test]
fn a_loop_that_swings_is_said_to_rest_only_if_it_does() {
    let held = "[drive]\nkind = \"pressure\"\npressure_pa = \"2.5 bar\"\n[run]\nduration_s = 3\n";
    assert_eq!(unrest(held), None);
    let frictionless = "[run]\nduration_s = 3\n[friction]\nforce_n = 0\nviscous_n_s_m = 0\n\
                        stribeck_force_n = 0\n[load]\nmass_kg = 5\n[drive]\nkind = \"contraction\"\n\
                        contraction = 0.1\n";
    for text in [frictionless, &format!("{held}[leak]\nconductance_m3_s_pa = 3e-9\n")] {
        let swings = unrest(text).unwrap();
        assert!(swings.contains("until its set point ends at 3.0 s, and does not "), "{swings}");
    }
}

#[test]
fn an_estimate_that_is_worse_than_it_states_is_reported() {
    // A foil beside the wall that is believed on the axis.
    let text = "[drive]\nperiod_s = 30\nflow_kg_s = 6e-5\n[plant]\nmodel = \"full\"\n\
                [sensor.gas]\nradius = 0.9\n[believed.sensor.gas]\nradius = 0.0\n";
    let loaded = thermyo_setup::parse(text, "test".as_ref()).unwrap();
    let summary = run::on_core(&loaded, |_| ()).unwrap();
    let warning = summary.overconfidence().unwrap();
    assert!(warning.contains("within two of its stated standard deviations only 1"), "{warning}");
}

/// A chirp's bandwidth is where sines of their own lose 3 dB.
#[test]
fn a_chirp_has_the_bandwidth_of_sines() {
    let driven = |duration_s: f64, shape: &str| {
        control(&format!(
            "duration_s = {duration_s}\n[drive]\nkind = \"contraction\"\noffset = \"10 %\"\n\
             amplitude = \"1%\"\nshape = {shape}\n"
        ))
    };
    let chirp = driven(20.0, "\"chirp\"\nperiod_s = 1");
    let bandwidth_hz = chirp["bandwidth_hz"].as_f64().unwrap();
    let gain = |hz: f64| {
        let sine = driven(2.0, &format!("\"sine\"\nperiod_s = {:.3}", 1.0 / hz));
        assert!(sine["bandwidth_hz"].is_null(), "{sine}");
        sine["gain"].as_f64().unwrap()
    };
    let [below, above] = [0.8, 1.25].map(|share| gain(share * bandwidth_hz));
    assert!(below > 0.75 && above < 0.68, "{bandwidth_hz} Hz: {below}, {above}");
}

#[test]
fn a_slow_sine_is_followed_and_a_fast_one_is_late() {
    let sine = |period_s: f64| {
        control(&format!(
            "duration_s = {}\n[drive]\nkind = \"contraction\"\nshape = \"sine\"\noffset = \"10 %\"\n\
             amplitude = \"2%\"\nperiod_s = {period_s}\n",
            4.0 * period_s
        ))
    };
    let figure = |control: &serde_json::Value, name: &str| control[name].as_f64().unwrap();
    let (slow, fast) = (sine(4.0), sine(0.1));
    assert!((0.97..1.03).contains(&figure(&slow, "gain")), "{slow}");
    assert!((-8.0..0.5).contains(&figure(&slow, "phase_deg")), "{slow}");
    assert!(figure(&fast, "gain") < 0.7 && figure(&fast, "phase_deg") < -30.0, "{fast}");
    assert!(figure(&fast, "rms_error") > 3.0 * figure(&slow, "rms_error"), "{fast}");
    let diagnosis = fast["diagnosis"].as_str().unwrap();
    assert!(diagnosis.contains("fully open ") && diagnosis.contains("limits you"), "{diagnosis}");
    assert!(slow["diagnosis"].as_str().unwrap().contains("the loop, not the valve"), "{slow}");
}

#[test]
fn steps_settle_and_their_pulses_are_counted() {
    let steps = control(
        "duration_s = 8\n[drive]\nkind = \"pressure\"\nshape = \"step\"\noffset = \"2 bar\"\n\
         amplitude = \"1 bar\"\nperiod_s = 4\n",
    );
    let settled_s = steps["settled_s"].as_f64().unwrap();
    assert!((0.02..1.0).contains(&settled_s), "{steps}");
    assert_eq!((&steps["unsettled"], &steps["gain"]), (&0.into(), &serde_json::Value::Null));
    let pulses_per_s = steps["pulses_per_s"].as_f64().unwrap();
    assert!((0.5..60.0).contains(&pulses_per_s), "{steps}");
}

/// A jump of 2 bar shortly before the end used to count in the mean.
#[test]
fn the_error_at_the_end_is_not_that_of_a_jump() {
    let steady_pa = |duration_s: f64| {
        control(&format!(
            "duration_s = {duration_s}\n[drive]\nkind = \"pressure\"\nshape = \"step\"\n\
             offset = \"3 bar\"\namplitude = \"1 bar\"\nperiod_s = 4\n"
        ))["steady_error"]
            .as_f64()
    };
    // The jumps are at 2, 4, 6, ... s.
    assert!(steady_pa(9.9).is_some_and(|pa| pa.abs() < 2e3), "{:?}", steady_pa(9.9));
    assert!(steady_pa(10.5).is_some_and(|pa| pa.abs() < 6e3), "{:?}", steady_pa(10.5));
    assert_eq!(steady_pa(10.01), None);
}

/// The way down to the first set point used to count as an overshoot of half of it, and the value's
/// excess below it as none.
#[test]
fn an_overshoot_downwards_is_one_and_the_way_there_is_none() {
    let fallen = |valve: &str| {
        let found = control(&format!(
            "duration_s = 3\n[plant]\ninitial_pressure_pa = \"3 bar\"\n[drive]\n\
             kind = \"pressure\"\npressure_pa = \"2 bar\"\n{valve}"
        ));
        found["overshoot"].as_f64().unwrap()
    };
    let [tight, late] = [
        fallen(""),
        fallen("[valve]\ndead_time_s = 0.03\n[believed.valve]\ndead_time_s = 0.001\n"),
    ];
    assert!((0.0..0.02).contains(&tight), "{tight}");
    assert!((0.03..0.1).contains(&late), "{late}");
}

/// A course that hardly moves used to be overshot by many times its range, which was the way to its
/// start.
#[test]
fn overshoot_is_of_the_way_to_a_course_that_hardly_moves() {
    let control = control(
        "duration_s = 1\n[drive]\nkind = \"pressure\"\nshape = \"sine\"\noffset = \"2.5 bar\"\n\
         amplitude = \"100 Pa\"\nperiod_s = 10\n",
    );
    let overshoot = control["overshoot"].as_f64().unwrap();
    assert!((0.001..0.1).contains(&overshoot), "{control}");
}

/// Changes of their command used to be printed as pulses.
#[test]
fn valves_that_open_in_proportion_have_no_pulses() {
    let text =
        "[run]\nduration_s = 1\n[valve]\nkind = \"proportional\"\n[drive]\nkind = \"pressure\"\n";
    let loaded = thermyo_setup::parse(text, "test".as_ref()).unwrap();
    let control = run::on_core(&loaded, |_| ()).unwrap().control.unwrap();
    assert_eq!(control.pulses_per_s, None);
    let printed = control.text(UnitSystem::Practical);
    assert!(printed.contains("\nvalves: ") && !printed.contains("pulses"), "{printed}");
}
