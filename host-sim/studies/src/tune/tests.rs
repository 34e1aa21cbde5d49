//! The values that are left on a board.

use super::*;
use model_core::Telemetry;
use thermyo_simulation::board::{BoardError, CoreBoard};

/// A simulated muscle that shakes in its last drive, the check with the tuned values.
struct Shaken {
    board: CoreBoard,
    drives: u32,
    shaken_m: f32,
    left: Option<Config>,
}

impl Bench for Shaken {
    fn drive(&mut self, driven: &Loaded, each: &mut dyn FnMut(&Telemetry)) -> Result<(), RunError> {
        self.drives += 1;
        let shaken_m = if self.drives == 3 { self.shaken_m } else { 0.0 };
        let mut bench = Simulated { board: &mut self.board, stopped: &|| false };
        bench.drive(driven, &mut |telemetry| {
            let mut telemetry = *telemetry;
            telemetry.length_m += if telemetry.step % 2 == 0 { shaken_m } else { -shaken_m };
            each(&telemetry);
        })
    }

    fn leave(&mut self, left: Left<'_, Config>) -> Result<(), BoardError> {
        self.left = Some(*left.config());
        Ok(())
    }
}

/// Values with which the muscle follows less closely used to be left on the board.
#[test]
fn values_that_are_worse_are_not_left_on_the_board() {
    let loaded =
        thermyo_setup::parse("[plant]\nmodel = \"lumped\"\n", Path::new("s.toml")).unwrap();
    for (shaken_m, adopted) in [(0.0, true), (0.5e-3, false)] {
        let mut bench = Shaken { board: CoreBoard::default(), drives: 0, shaken_m, left: None };
        let tuned = tune_on(&loaded, Path::new("s.toml"), HIGHEST_PA, &mut bench).unwrap();
        let headline = tuned.findings.headline();
        assert_eq!(tuned.findings.adopted, adopted, "{headline}");
        assert_eq!(headline.ends_with(": the former values are kept"), !adopted, "{headline}");
        assert_eq!(headline.contains(" less closely than before "), !adopted, "{headline}");
        let kept = if adopted { &tuned.scenario } else { &loaded };
        assert_eq!(bench.left, Some(core_config(&kept.believed)));
    }
}

/// A muscle from its preset has no friction except slip and creep, and a bladder that is no spring: it used to be
/// refused as too noisy for the first, and as negative for the second.
#[test]
fn a_muscle_without_friction_is_tuned() {
    let rig = "[valve]\npreset = \"mhe2-class\"\n[sensor.pressure]\npreset = \"hsc-150psi-a\"\n[load]\nkind = \"mass\"\n";
    for (muscle, mass_kg, friction_n) in [("dmsp-10", 2.0, 0.0), ("dmsp-20", 20.0, 15.0)] {
        let text = format!("[muscle]\npreset = \"{muscle}\"\n{rig}mass_kg = {mass_kg}\n");
        let loaded = thermyo_setup::parse(&text, Path::new("s.toml")).unwrap();
        let tuned = tune(&loaded, Path::new("s.toml"), 5.9e5, &mut CoreBoard::default());
        let tuned = tuned.unwrap_or_else(|error| panic!("{muscle}: {error}"));
        for (path, truth, within) in
            [("friction.force_n", friction_n, 1.0), ("muscle.bladder_stiffness_n_m", 0.0, 100.0)]
        {
            let found = number(&tuned.scenario.believed, path).unwrap();
            assert!((found - truth).abs() < within, "{muscle}: {path} = {found} of {truth}");
        }
    }
}

/// The conductance of short pulses is larger than that of open valves behind tube and regulator.
#[test]
fn switching_times_are_within_two_stated_errors() {
    for (pwm_hz, switch_time_s) in [(100.0, 0.002), (50.0, 0.004)] {
        let text = format!("[valve]\npwm_hz = {pwm_hz:?}\nswitch_time_s = {switch_time_s}\n");
        let text = format!("[plant]\nmodel = \"full\"\n[load]\nforce_n = 60\n{text}");
        let loaded = thermyo_setup::parse(&text, Path::new("s.toml")).unwrap();
        let tuned = tune(&loaded, Path::new("s.toml"), HIGHEST_PA, &mut CoreBoard::default());
        let tuned = tuned.unwrap_or_else(|error| panic!("{pwm_hz} Hz: {error}"));
        let found = tuned.findings.value("valve.switch_time_s").unwrap();
        let (after, error) = (found.after, found.standard_error.unwrap());
        assert!((after - switch_time_s).abs() < 2.0 * error, "{after} +- {error} s");
    }
}

/// The core adds the line's travel to the dead time: it used to count twice, 7.4 ms instead of 1 behind 2 m.
#[test]
fn the_travel_through_a_line_is_no_dead_time() {
    for length_m in [1.0, 2.0] {
        let text = format!(
            "[plant]\nmodel = \"full\"\n[load]\nforce_n = 100\n[tube]\nlength_m = {length_m:?}\n\
             diameter_m = 0.004\nvolume_m3 = 1e-6\n"
        );
        let loaded = thermyo_setup::parse(&text, Path::new("s.toml")).unwrap();
        let tuned = tune(&loaded, Path::new("s.toml"), HIGHEST_PA, &mut CoreBoard::default());
        let tuned = tuned.unwrap_or_else(|error| panic!("{length_m} m: {error}"));
        let found_s = number(&tuned.scenario.believed, "valve.dead_time_s").unwrap();
        assert!((0.0..2.5e-3).contains(&found_s), "{length_m} m: {found_s} s");
        // Loops as slow as twice the delay are worse than the default's behind the longer one.
        assert_eq!(tuned.findings.adopted, length_m < 1.5, "{}", tuned.findings.headline());
    }
}

/// The plant's slip and creep differ from the core's configuration.
#[test]
fn slip_and_creep_are_found_on_a_board_and_leave_the_plant_alone() {
    let text = "[plant]\nmodel = \"lumped\"\n[muscle]\npreset = \"dmsp-10\"\n\
                [load]\nforce_n = 20.0\nmass_kg = 2.0\n\
                [believed.muscle]\nslip_force_n = 12.0\nslip_stiffness_n_m = 1500.0\n\
                creep_fast_n_m = 1200.0\ncreep_slow_s = 50.0\n";
    let file = Path::new("s.toml");
    let loaded = thermyo_setup::parse(text, file).unwrap();
    let mut board = CoreBoard::default();
    let mut bench = Simulated { board: &mut board, stopped: &|| false };
    let csv = motion_record(&loaded, file, HIGHEST_PA, &mut bench).unwrap();
    let found = motion_values(&loaded, file, (&csv, Path::new("motion.csv")), &()).unwrap();
    let findings = &found.findings;
    println!("{}", findings.text());
    assert!(findings.holds, "{:?}", findings.failed());
    for (key, truth) in [
        ("muscle.slip_force_n", 6.5),
        ("muscle.slip_stiffness_n_m", 3100.0),
        ("muscle.creep_fast_n_m", 2470.0),
        ("muscle.creep_fast_s", 0.45),
        ("muscle.creep_slow_n_m", 1500.0),
        ("muscle.creep_slow_s", 26.0),
    ] {
        assert_eq!(number(&found.scenario.believed, key), Some(findings.parameters[key].value));
        assert_eq!(number(&found.scenario.plant, key), Some(truth), "the plant's own");
        let error = findings.parameters[key].value / truth - 1.0;
        assert!(error.abs() < 0.1, "{key}: {error}");
    }
}

/// A muscle that needs more than the usual 4 bar used to be refused without a hint how to allow more.
#[test]
fn a_pressure_that_does_not_move_the_muscle_names_one_that_does() {
    let refused = |text: &str, most_pa: f64| {
        let file = Path::new("s.toml");
        let loaded = thermyo_setup::parse(text, file).unwrap();
        tune(&loaded, file, most_pa, &mut CoreBoard::default()).unwrap_err().to_string()
    };
    let short = "[muscle]\npreset = \"dmsp-10\"\nrest_length_m = 0.2\n[load]\nforce_n = 20\n";
    let more = refused(short, HIGHEST_PA);
    assert!(
        more.ends_with(
            "at most 400 kPa are allowed: --max-pressure 5.1bar or more, the more its friction takes"
        ),
        "{more}"
    );
    let low = refused(&format!("{short}[supply]\npressure_pa = 5e5\n"), HIGHEST_PA);
    assert!(low.contains("at most 400 kPa are allowed: 85 % of supply.pressure_pa, and "), "{low}");
    // The pressure is enough for the law, and too little for friction and valves: load and sensor used to be blamed.
    let lifts = "[plant]\nmodel = \"full\"\n[load]\nkind = \"isotonic\"\nforce_n = 100\n";
    let stuck = refused(lifts, 1.7e5);
    assert!(
        stuck.contains("are 170 kPa too little for load and friction (--max-pressure)"),
        "{stuck}"
    );
    let short = refused(lifts, 2.0e5);
    assert!(
        short.starts_with("no step up to 200 kPa kept the inlet open for 30 ms: allow more ("),
        "{short}"
    );
}

/// A length or an actuator that shows nothing is refused before anything moves.
#[test]
fn a_motion_that_shows_nothing_is_refused() {
    let refused = |text: &str| {
        let file = Path::new("s.toml");
        let loaded = thermyo_setup::parse(text, file).unwrap();
        let mut bench =
            Shaken { board: CoreBoard::default(), drives: 0, shaken_m: 0.0, left: None };
        let refused = motion_record(&loaded, file, HIGHEST_PA, &mut bench).unwrap_err();
        assert_eq!(bench.drives, 0);
        refused.to_string()
    };
    let still = refused("[load]\nkind = \"isometric\"\n");
    assert!(still.starts_with("load.kind = \"isometric\": nothing moves"), "{still}");
    let vessel = refused("[plant]\nkind = \"vessel\"\nmodel = \"lumped\"\n");
    assert!(vessel.contains("plant.kind = \"vessel\": must be \"muscle\""), "{vessel}");
}
