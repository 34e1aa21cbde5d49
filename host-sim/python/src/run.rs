//! Whole runs, and tables of their columns.

use crate::error;
use crate::scenario;
use numpy::{AllowTypeChange, IntoPyArray, PyArrayLike1};
use pyo3::exceptions::{PyMemoryError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyMapping, PyModule};
use serde::Serialize;
use std::ffi::CString;
use std::io;
use std::time::{Duration, Instant};
use thermyo_files::units::Unit;
use thermyo_record::trace::{COLUMNS, Row, cells_text};
use thermyo_scenario::Scenario;
use thermyo_simulation::board::CoreBoard;
use thermyo_simulation::run as simulation;

/// Key of the summary beside the columns.
pub const SUMMARY: &str = "summary";
/// Interval at which Ctrl-C is checked.
const LOOK: Duration = Duration::from_millis(50);

/// Checks for Ctrl-C while the interpreter's lock is released.
pub struct Signals {
    looked: Instant,
    raised: Option<PyErr>,
}

impl Signals {
    pub fn new() -> Self {
        Self { looked: Instant::now(), raised: None }
    }

    /// Returns an error if the work must stop.
    pub fn go_on(&mut self) -> io::Result<()> {
        if self.looked.elapsed() > LOOK {
            self.looked = Instant::now();
            self.raised = Python::attach(|py| py.check_signals()).err();
        }
        if self.raised.is_some() { Err(io::ErrorKind::Interrupted.into()) } else { Ok(()) }
    }

    /// Raises the exception that stopped the work.
    pub fn raise(self) -> PyResult<()> {
        self.raised.map_or(Ok(()), Err)
    }
}

/// The Python part of the package, `results.py`.
pub fn results(py: Python<'_>) -> PyResult<&Bound<'_, PyModule>> {
    static MODULE: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    let module = MODULE.get_or_try_init(py, || {
        let code = CString::new(include_str!("results.py"))?;
        let module = PyModule::from_code(py, &code, c"thermyo/results.py", c"thermyo.results")?;
        let units = PyDict::new(py);
        for name in COLUMNS.into_iter().chain(thermyo_joint::COLUMNS) {
            let Unit { symbol, factor } = Unit::of_column(name);
            units.set_item(name, (symbol, factor))?;
        }
        module.getattr("Run")?.setattr("_units", units)?;
        PyResult::Ok(module.unbind())
    })?;
    Ok(module.bind(py))
}

/// Runs a scenario: the columns of trace.csv as numpy arrays, and the summary under "summary"; for a joint of
/// joint_trace.csv.
#[pyfunction]
#[pyo3(signature = (scenario, seed = None))]
pub fn run<'py>(
    py: Python<'py>,
    scenario: &Bound<'py, PyAny>,
    seed: Option<&Bound<'_, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    if let Some(loaded) = scenario::joint(scenario, seed)? {
        let mut table = Table::new(&thermyo_joint::COLUMNS, &loaded.muscles[0].plant)?;
        let mut observer = |row: &thermyo_joint::Row| table.push(row.cells());
        let result = py.detach(|| thermyo_joint::run(&loaded, &mut observer));
        return table.finish(py, result.map_err(error::joint));
    }
    let loaded = scenario::load(scenario, seed)?;
    let mut table = Table::new(&COLUMNS, &loaded.plant)?;
    let mut observer = |row: &Row| table.push(row.cells());
    let result =
        py.detach(|| simulation::run(&loaded, &mut CoreBoard::default(), None, &mut observer));
    table.finish(py, result.map_err(error::run))
}

/// Columns of a run under way.
struct Table {
    names: &'static [&'static str],
    columns: Vec<Vec<f64>>,
    signals: Signals,
}

impl Table {
    /// Raises if the memory does not suffice: the allocation itself would end the interpreter.
    fn new(names: &'static [&'static str], scenario: &Scenario) -> PyResult<Self> {
        let rows = (scenario.run.steps() / scenario.run.log_every) as usize + 2;
        let mut columns = vec![Vec::new(); names.len()];
        for column in &mut columns {
            column.try_reserve_exact(rows).map_err(|_| {
                PyMemoryError::new_err(format!(
                    "{rows} rows of {} columns: with a larger run.log_every there are fewer",
                    names.len()
                ))
            })?;
        }
        Ok(Self { names, columns, signals: Signals::new() })
    }

    fn push(&mut self, cells: impl IntoIterator<Item = f64>) -> io::Result<()> {
        for (column, cell) in self.columns.iter_mut().zip(cells) {
            column.push(cell);
        }
        self.signals.go_on()
    }

    /// The run as a Python object.
    fn finish<'py>(
        self,
        py: Python<'py>,
        summary: PyResult<impl Serialize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        self.signals.raise()?;
        let summary = summary?;
        let table = PyDict::new(py);
        for (name, column) in self.names.iter().zip(self.columns) {
            table.set_item(name, column.into_pyarray(py))?;
        }
        table.set_item(SUMMARY, plain(py, &summary)?)?;
        results(py)?.getattr("Run")?.call1((table,))
    }
}

/// Columns as the text of a CSV file: for a run, the bytes of its trace.csv. A summary is left out.
#[pyfunction]
#[pyo3(signature = (columns))]
pub fn to_csv(columns: &Bound<'_, PyMapping>) -> PyResult<String> {
    let mut names = Vec::new();
    let mut table = Vec::new();
    for (name, column) in scenario::entries(columns)? {
        let name: String = name.extract()?;
        if name == SUMMARY {
            continue;
        }
        if name.contains([',', '"', '\n', '\r']) {
            let text = format!("column {name:?}: must have no comma, quotation mark or line end");
            return Err(PyValueError::new_err(text));
        }
        table.push(numbers(&name, &column)?);
        names.push(name);
    }
    let rows = table.first().map_or(0, Vec::len);
    if let Some(other) = table.iter().position(|column| column.len() != rows) {
        return Err(PyValueError::new_err(format!(
            "column {} has {} rows and column {} has {rows}: must be as many",
            names[other],
            table[other].len(),
            names[0]
        )));
    }
    let mut text = names.join(",") + "\n";
    for row in 0..rows {
        text += &cells_text(table.iter().map(|column| column[row]));
        text.push('\n');
    }
    Ok(text)
}

fn numbers(name: &str, column: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let array = column.extract::<PyArrayLike1<'_, f64, AllowTypeChange>>();
    let array = array.map_err(|error| {
        if error.is_instance_of::<PyValueError>(column.py()) {
            return PyValueError::new_err(format!("column {name}: {}", error.value(column.py())));
        }
        PyTypeError::new_err(format!("column {name}: must be a list or an array of numbers"))
    })?;
    Ok(array.as_array().to_vec())
}

/// Figures as Python dicts, lists and numbers.
pub fn plain<'py>(py: Python<'py>, figures: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(figures).expect("figures are plain data");
    py.import("json")?.call_method1("loads", (text,))
}
