//! A tuning with progress: the bench of `thermyo tune`, with its telemetry on the page.

use model_core::{Config, Telemetry};
use std::path::Path;
use thermyo_boards::live::LiveBoard;
use thermyo_files::input::InputError;
use thermyo_files::output::OutputDir;
use thermyo_setup::Loaded;
use thermyo_simulation::board::BoardError;
use thermyo_simulation::run::RunError;
use thermyo_studies::drive::LiveBench;
use thermyo_studies::tune;
use thermyo_studies::tune::{Bench, Left, TuneError, Tuned};

/// Progress of one run of the tuning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Number of the run, from 1 on.
    pub number: u32,
    pub duration_s: f64,
    pub time_s: f64,
}

struct Watched<'a, 'b> {
    bench: LiveBench<'a, LiveBoard>,
    show: &'b mut dyn FnMut(&Telemetry, Part),
    parts: u32,
}

impl Bench for Watched<'_, '_> {
    fn drive(&mut self, driven: &Loaded, each: &mut dyn FnMut(&Telemetry)) -> Result<(), RunError> {
        self.parts += 1;
        let run = &driven.plant.run;
        let (number, duration_s, step_s) = (self.parts, run.duration_s, run.step_s);
        let show = &mut *self.show;
        self.bench.drive(driven, &mut |telemetry| {
            let time_s = f64::from(telemetry.step) * step_s;
            show(telemetry, Part { number, duration_s, time_s });
            each(telemetry);
        })
    }

    fn leave(&mut self, left: Left<'_, Config>) -> Result<(), BoardError> {
        self.bench.leave(left)
    }
}

/// Tunes a board's configuration; `show` gets every step's telemetry.
pub fn tune(
    configured: &Loaded,
    highest_pa: f64,
    bench: LiveBench<'_, LiveBoard>,
    show: &mut dyn FnMut(&Telemetry, Part),
) -> Result<Tuned, TuneError> {
    let mut watched = Watched { bench, show, parts: 0 };
    tune::tune_on(configured, Path::new("the board's configuration"), highest_pa, &mut watched)
}

pub fn write(tuned: &Tuned, folder: &Path, name: &str) -> Result<(), InputError> {
    let mut files = OutputDir::create(folder)?;
    let json = serde_json::to_string_pretty(&tuned.findings).expect("plain data") + "\n";
    files.text("summary.json", &json)?;
    files.text("tuned.toml", &thermyo_setup::render(&tuned.scenario))?;
    files.text("report.html", &tune::page(tuned, name))?;
    files.publish().map(drop)
}
