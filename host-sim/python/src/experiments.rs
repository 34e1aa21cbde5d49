//! Experiments on a board: tuning, and stops with both valves shut.

use crate::error::{self, BoardError};
use crate::run::{Signals, plain};
use pyo3::prelude::*;
use std::cell::RefCell;
use std::path::Path;
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_protocol::Refusal;
use thermyo_setup::core_config::core_config;
use thermyo_setup::{Loaded, from_config};
use thermyo_simulation::board;
use thermyo_simulation::run::RunError;
use thermyo_studies::drive::LiveBench;
use thermyo_studies::stops::{Asked, Findings, LiveRows, Plan, Record, RowBench, measured};
use thermyo_studies::tune::{self, TuneError, Tuned};

/// Ends an experiment at Ctrl-C.
pub struct Watch(RefCell<Signals>);

impl Watch {
    pub fn new() -> Self {
        Self(RefCell::new(Signals::new()))
    }

    pub fn stopped(&self) -> bool {
        self.0.borrow_mut().go_on().is_err()
    }

    pub fn raise(self) -> PyResult<()> {
        self.0.into_inner().raise()
    }
}

fn refused(error: impl std::fmt::Display) -> PyErr {
    BoardError::new_err(error.to_string())
}

/// Tunes a board on its muscle, whose load is the scenario's.
pub fn tune_on(
    live: &mut LiveBoard,
    loaded: &Loaded,
    file: &Path,
    most_pa: Option<f64>,
) -> PyResult<Tuned> {
    let highest_pa = tune::highest_pa(&core_config(&loaded.believed), most_pa)
        .map_err(|error| refused(format!("most_pa: {error}")))?;
    let watch = Watch::new();
    let stopped = || watch.stopped();
    let mut bench = LiveBench::new(live, "tune", highest_pa, &stopped).map_err(error::board)?;
    let tuned = tune::tune_on(loaded, file, highest_pa, &mut bench);
    watch.raise()?;
    tuned.map_err(|error| match error {
        TuneError::Input(error) => error::input(error),
        TuneError::Run(error) => run(error),
        TuneError::Refused(why) => refused(why),
    })
}

/// The content of `summary.json` of `thermyo tune`, and the tuned scenario as TOML.
pub fn tuned<'py>(py: Python<'py>, tuned: &Tuned) -> PyResult<Bound<'py, PyAny>> {
    let findings = plain(py, &tuned.findings)?;
    findings.set_item("scenario", thermyo_setup::render(&tuned.scenario))?;
    Ok(findings)
}

/// Measures stops on a board with the muscle of its configuration.
pub fn measure_stop(live: &mut LiveBoard, asked: &Asked, arm: bool) -> PyResult<Findings> {
    let config = live.config().map_err(error::board)?;
    tune::highest_pa(&config, asked.highest_pa)
        .map_err(|error| refused(format!("most_pa: {error}")))?;
    let loaded = from_config::to_scenario(&config).map_err(refused)?.scenario;
    let armed_pa = if arm { None } else { live.status().map_err(error::board)?.armed_pa };
    if !arm && armed_pa.is_none() {
        let not_armed = Refusal::SetPoint(model_core::SetPointError::NotArmed);
        return Err(error::board(board::BoardError::Refused(not_armed)));
    }
    let plan = Plan::new(&loaded, &config, asked, armed_pa).map_err(refused)?;
    let port = live.port().to_owned();
    let mut bench = LiveRows::arm(live, config, &plan, arm).map_err(error::board)?;
    let (watch, mut record) = (Watch::new(), Record::default());
    let outcome = bench.measure(&plan, &mut record, &mut |_| watch.stopped());
    watch.raise()?;
    outcome.map_err(run)?;
    let findings = measured(&record, &plan, &loaded, &port);
    findings.failed().map_or(Ok(findings), |why| Err(refused(why)))
}

fn run(error: RunError) -> PyErr {
    match error {
        RunError::Board(error) => error::board(error),
        error => error::run(error),
    }
}
