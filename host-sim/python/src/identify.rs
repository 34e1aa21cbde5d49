//! `identify`, from a file or from columns.

use crate::error::{self, RunError, ScenarioError};
use crate::run::{plain, to_csv};
use crate::scenario;
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::PyMapping;
use std::ffi::CString;
use std::path::{Path, PathBuf};
use thermyo_files::table::{Table, read_record};
use thermyo_identify::identify_table;
use thermyo_joint::JointLoaded;
use thermyo_studies::joint_tune::{self, RecordError};

/// Identifies the plant's parameters from recorded data, a muscle from a static map, or a joint. Returns
/// the content of `summary.json`, and under "scenario" the identified scenario as TOML.
#[pyfunction]
#[pyo3(signature = (data, scenario, against = None))]
pub fn identify<'py>(
    py: Python<'py>,
    data: &Bound<'py, PyAny>,
    scenario: &Bound<'py, PyAny>,
    against: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    if let Some(joint) = scenario::joint(scenario, None)? {
        return identify_joint(&joint, data, against);
    }
    let loaded = scenario::load(scenario, None)?;
    let config = scenario::name(scenario);
    let (table, file) = table(data, "data")?;
    let against = against.map(|other| self::table(other, "against")).transpose()?;
    let against = against.as_ref().map(|(table, _)| table);
    let found = py
        .detach(|| identify_table(&loaded, &config, &table, &file, against, &()))
        .map_err(error::identify)?;
    let findings = plain(py, &found.findings())?;
    findings.set_item("scenario", thermyo_setup::render(found.scenario()))?;
    Ok(findings)
}

fn identify_joint<'py>(
    joint: &JointLoaded,
    data: &Bound<'py, PyAny>,
    against: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = data.py();
    if against.is_some() {
        return Err(ScenarioError::new_err("against: is for one muscle: leave it out for a joint"));
    }
    let (table, _) = table(data, "data")?;
    let found = py.detach(|| joint_tune::identify(joint, &table)).map_err(|error| match error {
        RecordError::Input(error) => error::input(error),
        RecordError::Refused(refusal) => RunError::new_err(format!("nothing was found: {refusal}")),
    })?;
    for warning in &found.warnings {
        warn(py, warning)?;
    }
    let findings = plain(py, &found.findings())?;
    findings.set_item("scenario", thermyo_joint::render(&found.scenario))?;
    Ok(findings)
}

fn warn(py: Python<'_>, text: &impl ToString) -> PyResult<()> {
    let text = CString::new(text.to_string())?;
    PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 1)
}

/// Reads a table, and its name for messages.
fn table(given: &Bound<'_, PyAny>, name: &str) -> PyResult<(Table, PathBuf)> {
    if let Ok(columns) = given.cast::<PyMapping>() {
        let name = Path::new(name);
        let table = Table::parse(&to_csv(columns)?, name).map_err(error::input)?;
        return Ok((table, name.to_path_buf()));
    }
    let path: PathBuf = given.extract()?;
    let table = read_record(&path).map_err(error::input)?;
    if let Some(damage) = table.damage() {
        warn(given.py(), damage)?;
    }
    Ok((table, path))
}
