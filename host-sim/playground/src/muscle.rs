//! The scenario of one muscle.

use crate::kind::{ENDLESS_S, Kind, WRITTEN, no_file};
use model_core::Faults;
use model_core::control::Mode;
use serde_json::{Value, json};
use thermyo_record::trace::{COLUMNS, Row};
use thermyo_scenario::Document;
use thermyo_setup::Loaded;
use thermyo_simulation::board::CoreBoard;
use thermyo_simulation::run::Run;

pub struct Muscle(Loaded);

pub struct MuscleRun {
    run: Run,
    board: CoreBoard,
    latest: Option<(Mode, Faults)>,
}

impl Kind for Muscle {
    const COLUMNS: &'static [&'static str] = &COLUMNS;
    type Run = MuscleRun;

    fn parse(text: &str, origin: &str) -> Result<(Self, String), String> {
        let document = Document::parse(text, origin.as_ref()).map_err(|error| error.to_string())?;
        let named = document.plant.iter().chain(document.believed.iter());
        if let Some(entry) = named.into_iter().find(|entry| entry.path().ends_with("_csv")) {
            return Err(no_file(origin, &entry.path(), entry.line));
        }
        let (loaded, warnings) = thermyo_setup::parse_with_warnings(text, origin.as_ref())
            .map_err(|error| error.to_string())?;
        let lines: Vec<String> = warnings.iter().map(ToString::to_string).collect();
        Ok((Self(loaded), lines.join("\n")))
    }

    fn render(&self) -> String {
        thermyo_setup::render(&self.0)
    }

    fn settings(&self) -> Value {
        json!(self.0.plant)
    }

    fn turned(&self, values: &[(String, f64)], configured: bool) -> Result<Self, String> {
        let mut turned = self.0.clone();
        let values = values.iter().map(|(key, value)| (key.as_str(), *value));
        let known = |(key, _): &(&str, f64)| {
            thermyo_scenario::number(&self.0.believed, key)
                == thermyo_scenario::number(&self.0.plant, key)
        };
        turned.plant = thermyo_scenario::with_numbers(&turned.plant, values.clone());
        if configured {
            let known = values.filter(known);
            turned.believed = thermyo_scenario::with_numbers(&turned.believed, known);
        }
        // The core's drive is always the plant's.
        turned.believed.drive = turned.plant.drive.clone();
        // Checked like a file, with the same messages.
        Ok(Self::parse(&Self(turned).render(), WRITTEN)?.0)
    }

    fn endless(&self) -> Self {
        let mut endless = self.0.clone();
        endless.plant.run.duration_s = ENDLESS_S;
        endless.plant.run.log_every = 1;
        Self(endless)
    }

    fn start(&self) -> Result<MuscleRun, String> {
        let mut board = CoreBoard::default();
        let run = Run::start(&self.0, &mut board, None).map_err(|error| error.to_string())?;
        Ok(MuscleRun { run, board, latest: None })
    }

    fn retune(&self, run: &mut MuscleRun) -> Result<(), String> {
        run.run.retune(&self.0.plant, &mut run.board).map_err(|error| error.to_string())
    }

    fn step(run: &mut MuscleRun, mut rows: Option<&mut Vec<f64>>) -> Result<bool, String> {
        let MuscleRun { run, board, latest } = run;
        let mut observer = |row: &Row| {
            *latest = Some((row.telemetry.mode, row.telemetry.faults));
            if let Some(rows) = &mut rows {
                rows.extend_from_slice(&row.cells());
            }
            Ok(())
        };
        run.step(board, &mut observer).map_err(|error| error.to_string())
    }

    fn state(run: &MuscleRun) -> String {
        run.latest.map_or(String::new(), |(mode, faults)| format!("{}\n{faults}", mode.name()))
    }
}
