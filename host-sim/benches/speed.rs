//! Simulated time per wall-clock time, with the core in the loop at 1 kHz and the trace written.
//!
//! `item/s` is the factor: simulated seconds per second, on one core. Targets: lumped 2000, full 300.

use divan::Bencher;
use divan::counter::ItemsCount;
use std::io;
use thermyo_record::board_trace::Recorder;
use thermyo_record::trace::{COLUMNS, Row};
use thermyo_scenario::PlantModel;
use thermyo_simulation::board::CoreBoard;
use thermyo_simulation::run;

fn main() {
    divan::main();
}

#[divan::bench(args = [PlantModel::Lumped, PlantModel::Paper, PlantModel::Full], sample_count = 10)]
fn real_time_factor(bencher: Bencher, model: PlantModel) {
    let default = thermyo_setup::parse("", "default".as_ref()).expect("the defaults are valid");
    let mut loaded = default.with_model(model);
    loaded.plant.run.duration_s = 20.0;
    bencher.counter(ItemsCount::new(20_u64)).bench_local(|| {
        let mut writer =
            Recorder::with_columns(io::sink(), &COLUMNS).expect("a sink takes everything");
        let mut observer = |row: &Row| writer.push(&row.cells());
        run::run(&loaded, &mut CoreBoard::default(), None, &mut observer)
            .expect("the default scenario runs")
    });
}
