//! The flashed image is tuned by the same experiment as the core in this process.

use std::path::Path;
use thermyo_boards::emulated::EmulatedBoard;
use thermyo_evaluate::tune::{ALL_WRONG, configured, off};
use thermyo_studies::tune::{HIGHEST_PA, tune};

#[test]
fn a_board_is_tuned() {
    let loaded = configured(&thermyo_evaluate::nominal().unwrap(), ALL_WRONG.1);
    let mut board = EmulatedBoard::new().unwrap();
    let tuned = tune(&loaded, Path::new("nominal"), HIGHEST_PA, &mut board).unwrap();
    println!("{}", tuned.findings.text());
    let plant = &loaded.plant;
    for (path, truth, (low, high)) in [
        ("friction.force_n", plant.friction.force_n, (-2.0, 2.0)),
        ("muscle.turns", plant.muscle.turns, (-0.5, 0.5)),
        ("valve.conductance_m3_s_pa", plant.valve.conductance_m3_s_pa, (-9.0, -4.0)),
        ("valve.switch_time_s", plant.valve.switch_time_s, (-15.0, -5.0)),
    ] {
        let error = off(&tuned, truth, path).percent;
        assert!((low..=high).contains(&error), "{path}: {error} %, allowed {low} to {high}");
    }
    let check = tuned.findings.check;
    assert!(tuned.findings.improved, "{check:?}");
    assert!((0.05..0.5).contains(&check.after.sine_rms_percent), "{check:?}");
}
