//! Simulated time per wall-clock time, with the core in the loop at 1 kHz and the trace written.
//!
//! `item/s` is the factor: simulated seconds per second, on one core. Targets: lumped 2000, full 300.

use divan::Bencher;
use divan::counter::ItemsCount;
use host_sim::board::CoreBoard;
use host_sim::files::trace::{Row, TraceWriter};
use host_sim::scenario::{self, PlantModel};
use host_sim::simulation::run;
use std::io;

fn main() {
    divan::main();
}

#[divan::bench(args = [PlantModel::Lumped, PlantModel::Paper, PlantModel::Full], sample_count = 10)]
fn real_time_factor(bencher: Bencher, model: PlantModel) {
    let default = scenario::parse("", "default".as_ref()).expect("the defaults are valid");
    let mut loaded = default.with_model(model);
    loaded.plant.run.duration_s = 20.0;
    bencher.counter(ItemsCount::new(20_u64)).bench_local(|| {
        let mut writer = TraceWriter::new(io::sink()).expect("a sink takes everything");
        let mut observer = |row: &Row| writer.write(&row.cells());
        run::run(&loaded, &mut CoreBoard::default(), None, &mut observer)
            .expect("the default scenario runs")
    });
}
