//! A scenario that runs without an end, with parameters that change meanwhile.

use model_core::Faults;
use model_core::Telemetry;
use model_core::control::Mode;
use thermyo_record::trace::{COLUMNS, Row, cells_text};
use thermyo_scenario::Document;
use thermyo_setup::Loaded;
use thermyo_simulation::board::CoreBoard;
use thermyo_simulation::run::{Run, run};

/// File name in messages.
const ORIGIN: &str = "scenario.toml";
/// Longer than any use of the page \[s\].
const ENDLESS_S: f64 = 1.0e9;

/// A run in progress.
pub struct Live {
    /// Present values, with the duration of the text.
    loaded: Loaded,
    run: Run,
    board: CoreBoard,
    /// Warnings about its text, a line each.
    warnings: String,
    latest: Option<(Mode, Faults)>,
}

/// First line of a trace.
pub fn header() -> String {
    COLUMNS.join(",")
}

fn parsed(text: &str) -> Result<Loaded, String> {
    Ok(parsed_with_warnings(text)?.0)
}

/// The scenario, and the warnings of `thermyo run`, a line each.
fn parsed_with_warnings(text: &str) -> Result<(Loaded, String), String> {
    let document = Document::parse(text, ORIGIN.as_ref()).map_err(|error| error.to_string())?;
    let named = document.plant.iter().chain(document.believed.iter());
    if let Some(entry) = named.into_iter().find(|entry| entry.path().ends_with("_csv")) {
        let line = entry.line.map_or(String::new(), |line| format!(":{line}"));
        return Err(format!(
            "{ORIGIN}{line}: {}: this page takes no CSV file: leave the key out, or run the scenario with \
             `thermyo run`",
            entry.path(),
        ));
    }
    let (loaded, warnings) = thermyo_setup::parse_with_warnings(text, ORIGIN.as_ref())
        .map_err(|error| error.to_string())?;
    let lines: Vec<String> = warnings.iter().map(ToString::to_string).collect();
    Ok((loaded, lines.join("\n")))
}

/// The same scenario without an end, every step logged.
fn endless(loaded: &Loaded) -> Loaded {
    let mut endless = loaded.clone();
    endless.plant.run.duration_s = ENDLESS_S;
    endless.plant.run.log_every = 1;
    endless
}

/// Runs a scenario to its end and returns its trace.
pub fn trace(text: &str) -> Result<Vec<u8>, String> {
    let loaded = parsed(text)?;
    let mut trace = header().into_bytes();
    trace.push(b'\n');
    let mut observer = |row: &Row| {
        trace.extend_from_slice(cells_text(row.cells()).as_bytes());
        trace.push(b'\n');
        Ok(())
    };
    run(&loaded, &mut CoreBoard::default(), None, &mut observer)
        .map_err(|error| error.to_string())?;
    Ok(trace)
}

impl Live {
    /// Starts at rest at time zero.
    pub fn start(text: &str) -> Result<Self, String> {
        let (loaded, warnings) = parsed_with_warnings(text)?;
        Self::of(loaded, warnings)
    }

    fn of(loaded: Loaded, warnings: String) -> Result<Self, String> {
        let mut board = CoreBoard::default();
        let run =
            Run::start(&endless(&loaded), &mut board, None).map_err(|error| error.to_string())?;
        Ok(Self { loaded, run, board, warnings, latest: None })
    }

    /// Present parameters of the plant, as JSON.
    pub fn settings(&self) -> Vec<u8> {
        serde_json::to_vec(&self.loaded.plant).expect("a scenario is plain data")
    }

    /// Sets a key's number.
    pub fn turn(&mut self, key: &str, value: f64, configured: bool) -> Result<(), String> {
        let mut turned = self.loaded.clone();
        let known = thermyo_scenario::number(&turned.believed, key)
            == thermyo_scenario::number(&turned.plant, key);
        turned.plant = thermyo_scenario::with_numbers(&turned.plant, [(key, value)]);
        if configured && known {
            turned.believed = thermyo_scenario::with_numbers(&turned.believed, [(key, value)]);
        }
        // The core's drive is always that of the plant.
        turned.believed.drive = turned.plant.drive.clone();
        // Checked like a file, with the same messages.
        let turned = parsed(&thermyo_setup::render(&turned))?;
        if configured {
            *self = Self::of(turned, self.warnings.clone())?;
            return Ok(());
        }
        self.run
            .retune(&endless(&turned).plant, &mut self.board)
            .map_err(|error| error.to_string())?;
        self.loaded = turned;
        Ok(())
    }

    /// Runs `steps` steps, and adds the cells of every `every`-th row to `rows`.
    pub fn advance(&mut self, steps: u32, every: u32, rows: &mut Vec<f64>) -> Result<(), String> {
        let Self { run, board, latest, .. } = self;
        let mut observer = |row: &Row| {
            let Telemetry { step, mode, faults, .. } = row.telemetry;
            *latest = Some((mode, faults));
            if step.is_multiple_of(every.max(1)) {
                rows.extend_from_slice(&row.cells());
            }
            Ok(())
        };
        for _ in 0..steps {
            run.step(board, &mut observer).map_err(|error| error.to_string())?;
        }
        Ok(())
    }

    pub fn state(&self) -> String {
        match self.latest {
            None => String::new(),
            Some((now, faults)) => {
                let named = Mode::NAMES.iter().find(|(mode, _)| *mode == now);
                format!("{}\n{faults}", named.map_or("", |(_, name)| name))
            }
        }
    }

    /// Warnings of `thermyo run`, a line each.
    pub fn warnings(&self) -> String {
        self.warnings.clone()
    }

    /// The scenario with its present values.
    pub fn scenario(&self) -> String {
        thermyo_setup::render(&self.loaded)
    }
}
