//! The figures of a run's summary, on runs.

use thermyo_plant::Ledger;
use thermyo_record::summary::{Accumulator, Controlled, Ending};
use thermyo_record::trace::Row;
use thermyo_simulation::board::CoreBoard;
use thermyo_simulation::run;

#[test]
fn a_run_that_was_cut_short_has_no_error_at_the_end() {
    let text = "[run]\nduration_s = 1.0\nlog_every = 1\n[plant]\nmodel = \"lumped\"\n[drive]\n\
                kind = \"pressure\"\n";
    let loaded = thermyo_setup::parse(text, "test".as_ref()).unwrap();
    let mut rows = Vec::new();
    let mut observer = |row: &Row| {
        rows.push(*row);
        Ok(())
    };
    run::run(&loaded, &mut CoreBoard::default(), None, &mut observer).unwrap();
    let ended_at = |steps: usize| {
        let mut accumulator = Accumulator::new(loaded.plant.run.duration_s, None);
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
    assert_eq!(cut.steady_error, None);
    assert!(cut.rms_error > 1000.0);
    assert!(cut.text().starts_with("set point: RMS error ") && !cut.text().contains("at the end"));
    assert!(serde_json::to_value(cut).unwrap()["steady_error"].is_null());
    let whole = ended_at(rows.len());
    let mean: f64 = rows[900..].iter().map(|row| row.truth.pressure_pa - row.set_point).sum();
    let mean = mean / rows[900..].len() as f64;
    assert!((whole.steady_error.unwrap() - mean).abs() < 1e-9 * mean.abs(), "{mean}");
    assert!(whole.text().contains(", at the end "));
}
