//! Scenarios from Python: a file, its text, or a dict.

use crate::error::{self, ScenarioError, ScenarioWarning};
use pyo3::prelude::*;
use pyo3::types::{PyList, PyMapping, PyString, PyTuple};
use std::ffi::CString;
use std::path::{Path, PathBuf};
use thermyo_files::input::{InputError, quoted, read_text};
use thermyo_joint::JointLoaded;
use thermyo_scenario::Document;
use thermyo_scenario::joint::{JointDocument, is_joint};
use thermyo_setup::Loaded;
use thermyo_sweep::Swept;
use toml::{Table, Value};

/// Name in messages of a scenario that is not a file.
const NAME: &str = "scenario";
/// The key that the keyword `seed` replaces.
const SEED: &str = "run.seed";
/// A text with this ending names a file.
const SUFFIX: &str = ".toml";
/// Depth beyond that of the tables of any scenario; stops a dict that contains itself.
const DEEPEST: usize = 32;

/// The scenario with every default filled in and its meaning, as TOML: the output of `thermyo
/// check`.
#[pyfunction]
#[pyo3(signature = (scenario))]
pub fn check(scenario: &Bound<'_, PyAny>) -> PyResult<String> {
    Ok(match joint(scenario, None)? {
        Some(joint) => thermyo_joint::render(&joint),
        None => thermyo_setup::render(&load(scenario, None)?),
    })
}

/// Loads and checks the scenario of a joint; `None` if it is of one chamber.
pub fn joint(
    given: &Bound<'_, PyAny>,
    seed: Option<&Bound<'_, PyAny>>,
) -> PyResult<Option<JointLoaded>> {
    let Source { text, origin, from_dict } = Source::of(given)?;
    if !is_joint(&text) {
        return Ok(None);
    }
    let wrong = |error| error::input(placed(error, &origin, from_dict));
    let mut document = JointDocument::parse(&text, &origin).map_err(wrong)?;
    for muscle in &mut document.muscles {
        set_seed(muscle, seed)?;
    }
    thermyo_joint::joint(&document).map(Some).map_err(wrong)
}

fn set_seed(document: &mut Document, seed: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
    let Some(seed) = seed else { return Ok(()) };
    let seed = value(SEED, seed, 0)?.to_string();
    document
        .set_word(SEED, &seed)
        .map_err(|problem| error::input(InputError::file(&document.origin, problem)))
}

/// Loads and checks a scenario, and issues its warnings.
pub fn load(given: &Bound<'_, PyAny>, seed: Option<&Bound<'_, PyAny>>) -> PyResult<Loaded> {
    let py = given.py();
    let (mut document, from_dict) = document(given)?;
    set_seed(&mut document, seed)?;
    let without_line = |error| placed(error, &document.origin, from_dict);
    let loaded = thermyo_setup::assemble(&document).map_err(|e| error::input(without_line(e)))?;
    for warning in thermyo_setup::warnings(&document, &loaded) {
        let text = CString::new(without_line(warning).to_string())?;
        PyErr::warn(py, &py.get_type::<ScenarioWarning>(), &text, 2)?;
    }
    Ok(loaded)
}

/// Reads a scenario; also returns whether it is a dict.
fn document(given: &Bound<'_, PyAny>) -> PyResult<(Document, bool)> {
    let Source { text, origin, from_dict } = Source::of(given)?;
    let document = Document::parse(&text, &origin);
    let document = document.map_err(|e| error::input(placed(e, &origin, from_dict)))?;
    Ok((document, from_dict))
}

/// Reads a scenario, of one chamber or of a joint, for a sweep to set its keys.
pub fn swept(given: &Bound<'_, PyAny>) -> PyResult<Swept> {
    let Source { text, origin, from_dict } = Source::of(given)?;
    Swept::parse(&text, &origin).map_err(|e| error::input(placed(e, &origin, from_dict)))
}

/// A scenario as TOML.
struct Source {
    text: String,
    /// Its path, or its name in messages.
    origin: PathBuf,
    from_dict: bool,
}

impl Source {
    fn of(given: &Bound<'_, PyAny>) -> PyResult<Self> {
        let origin = name(given);
        if let Ok(dict) = given.cast::<PyMapping>() {
            return Ok(Self { text: table("", dict, 0)?.to_string(), origin, from_dict: true });
        }
        let text = if let Some(path) = file(given) {
            read_text(&path).map_err(error::input)?
        } else if let Ok(text) = given.cast::<PyString>() {
            text.to_cow()?.into_owned()
        } else {
            let kind = given.get_type().name()?;
            let allowed = "a path, a text that ends with .toml, the TOML itself or a dict";
            let text = format!("a scenario of type {kind}: must be {allowed}");
            return Err(ScenarioError::new_err(text));
        };
        Ok(Self { text, origin, from_dict: false })
    }
}

/// The scenario's path, or its name in messages.
pub fn name(given: &Bound<'_, PyAny>) -> PathBuf {
    file(given).unwrap_or_else(|| PathBuf::from(NAME))
}

fn file(given: &Bound<'_, PyAny>) -> Option<PathBuf> {
    let path: PathBuf = given.extract().ok()?;
    let is_text = given.is_instance_of::<PyString>();
    (!is_text || path.to_string_lossy().ends_with(SUFFIX)).then_some(path)
}

/// Drops line numbers of a text generated from a dict.
fn placed(mut error: InputError, origin: &Path, from_dict: bool) -> InputError {
    if from_dict && error.file == origin {
        error.line = None;
    }
    error
}

fn table(path: &str, dict: &Bound<'_, PyMapping>, depth: usize) -> PyResult<Table> {
    entries(dict)?
        .iter()
        .map(|(key, item)| {
            let key = name_within(path, key)?;
            let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
            let item = value(&path, item, depth + 1)?;
            Ok((key, item))
        })
        .collect()
}

pub fn entries<'py>(
    mapping: &Bound<'py, PyMapping>,
) -> PyResult<Vec<(Bound<'py, PyAny>, Bound<'py, PyAny>)>> {
    mapping.items()?.extract()
}

/// A key of the table at `path`.
fn name_within(path: &str, key: &Bound<'_, PyAny>) -> PyResult<String> {
    let place = if path.is_empty() { String::new() } else { format!("{path}: ") };
    let Ok(name) = key.extract::<String>() else {
        let written = quoted(&key.repr()?.to_cow()?);
        let text = format!("{NAME}: {place}key {written}: must be a text");
        return Err(ScenarioError::new_err(text));
    };
    if name.contains('.') {
        let nested = name.replace('.', "\": {\"");
        let ends = "}".repeat(name.split('.').count());
        return Err(ScenarioError::new_err(format!(
            "{NAME}: {place}unknown key {name:?}: a table is a dict, {{\"{nested}\": ...{ends}"
        )));
    }
    Ok(name)
}

fn value(path: &str, item: &Bound<'_, PyAny>, depth: usize) -> PyResult<Value> {
    if depth > DEEPEST {
        let path = quoted(path);
        let text = format!("{NAME}: {path}: must not be nested more than {DEEPEST} deep");
        return Err(ScenarioError::new_err(text));
    }
    if let Ok(dict) = item.cast::<PyMapping>() {
        return table(path, dict, depth).map(Value::Table);
    }
    if item.is_instance_of::<PyList>() || item.is_instance_of::<PyTuple>() {
        let items = item.try_iter()?.map(|item| value(path, &item?, depth + 1));
        return items.collect::<PyResult<_>>().map(Value::Array);
    }
    if let Ok(flag) = item.extract() {
        return Ok(Value::Boolean(flag));
    }
    if let Ok(whole) = item.extract() {
        return Ok(Value::Integer(whole));
    }
    if let Ok(number) = item.extract() {
        return Ok(Value::Float(number));
    }
    // A text, or a path.
    item.extract::<PathBuf>()
        .ok()
        .and_then(|text| text.into_os_string().into_string().ok())
        .map(Value::String)
        .ok_or_else(|| refused(path, item))
}

fn refused(path: &str, item: &Bound<'_, PyAny>) -> PyErr {
    let written = item.repr().map_or_else(|_| String::new(), |text| quoted(&text.to_string()));
    let allowed = "a number, a text, a bool, a list of texts, a path or a dict";
    ScenarioError::new_err(format!("{NAME}: {path} = {written}: must be {allowed}"))
}
