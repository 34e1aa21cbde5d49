//! Exceptions, with the messages of the command.

use model_core::control::SetPointField;
use model_core::{Faults, SetPointError};
use pyo3::exceptions::{PyRuntimeError, PyUserWarning, PyValueError};
use pyo3::{PyErr, PyResult, create_exception};
use std::fmt::Display;
use std::ops::RangeInclusive;
use thermyo_files::input::InputError;
use thermyo_identify::IdentifyError;
use thermyo_protocol::Refusal;
use thermyo_simulation::board;
use thermyo_simulation::run;

create_exception!(
    thermyo,
    ScenarioError,
    PyValueError,
    "A scenario or a table of data cannot be used: file, line, key, what is there and what is allowed."
);
create_exception!(
    thermyo,
    ScenarioWarning,
    PyUserWarning,
    "A scenario is valid and makes no sense."
);
create_exception!(thermyo, RunError, PyRuntimeError, "A run that had begun could not go on.");
create_exception!(
    thermyo,
    BoardError,
    PyRuntimeError,
    "A board cannot be used, or refuses a request."
);

/// Checks a number from the caller.
pub fn within<T>(name: &str, value: T, allowed: RangeInclusive<T>) -> PyResult<T>
where
    T: PartialOrd + Display,
{
    if allowed.contains(&value) {
        return Ok(value);
    }
    let (least, most) = (allowed.start(), allowed.end());
    Err(PyValueError::new_err(format!("{name} = {value}: must be from {least} to {most}")))
}

/// Checks a seed, which Python may pass as a negative number.
pub fn seed(value: i128) -> PyResult<u64> {
    Ok(within("seed", value, 0..=u64::MAX.into())? as u64)
}

pub fn input(error: InputError) -> PyErr {
    ScenarioError::new_err(error.to_string())
}

pub fn run(error: run::RunError) -> PyErr {
    match error {
        // Detected before the first step: an error of the scenario.
        run::RunError::Build(_) | run::RunError::Config(_) => {
            ScenarioError::new_err(error.to_string())
        }
        _ => RunError::new_err(error.to_string()),
    }
}

pub fn joint(error: thermyo_joint::RunError) -> PyErr {
    match error {
        thermyo_joint::RunError::Build(_) | thermyo_joint::RunError::Config(_) => {
            ScenarioError::new_err(error.to_string())
        }
        _ => RunError::new_err(error.to_string()),
    }
}

pub fn identify(error: IdentifyError) -> PyErr {
    match error {
        IdentifyError::Diverged(_) => RunError::new_err(error.to_string()),
        _ => ScenarioError::new_err(error.to_string()),
    }
}

/// Error in a sweep's `vary`; here the command's options are keywords.
pub fn sweep(error: impl Display) -> PyErr {
    let text = error.to_string().replace("--vary", "vary").replace("--lhs", "lhs");
    ScenarioError::new_err(text)
}

/// The message, and the method that helps, if there is one.
pub fn board(error: board::BoardError) -> PyErr {
    use SetPointError::{Faults as Latched, NotArmed};
    let remedy = match error {
        board::BoardError::Refused(
            Refusal::NotConfigured | Refusal::SetPoint(Latched(Faults::NOT_CONFIGURED)),
        ) => ": board.configure(scenario)",
        board::BoardError::Refused(Refusal::SetPoint(NotArmed)) => ": board.arm()",
        _ => "",
    };
    if let board::BoardError::Pressure { pressure_pa, least_pa, most_pa } = error {
        return pressure_range("pressure_pa", [pressure_pa, least_pa, most_pa]);
    }
    match error {
        // States the keyword's name and its unit.
        board::BoardError::Refused(Refusal::SetPoint(range @ SetPointError::Range { .. })) => {
            let now =
                match range {
                    SetPointError::Range {
                        field: SetPointField::Armed, value, minimum, ..
                    } if value < minimum => board::LEAST_IS_NOW,
                    _ => "",
                };
            BoardError::new_err(format!("{range}{now}"))
        }
        error => BoardError::new_err(format!("{error}{remedy}")),
    }
}

/// As [`board()`], for `board.arm`, whose keyword has another name.
pub fn arming(error: board::BoardError) -> PyErr {
    match error {
        board::BoardError::Pressure { pressure_pa, least_pa, most_pa } => {
            pressure_range("most_pa", [pressure_pa, least_pa, most_pa])
        }
        error => self::board(error),
    }
}

/// The allowed pressures, with the keyword's name and in its unit.
fn pressure_range(name: &str, [pressure_pa, least_pa, most_pa]: [f32; 3]) -> PyErr {
    // Rounded inwards, so that the printed values are allowed.
    let (least, most) = (least_pa.ceil(), most_pa.floor());
    let meant = [("bar", 1e5), ("kPa", 1e3)].into_iter().find_map(|(unit, unit_pa)| {
        let meant_pa = pressure_pa * unit_pa;
        let can_be = (least_pa..=most_pa).contains(&meant_pa);
        can_be.then(|| format!("; {pressure_pa} {unit} is {name}={meant_pa:.0}"))
    });
    BoardError::new_err(format!(
        "{name} = {pressure_pa}: must be from {least} (ambient, as the board is configured) to {most}{}",
        meant.unwrap_or_default()
    ))
}

pub fn silent(asked: &'static str) -> PyErr {
    board(board::BoardError::Silent { asked })
}

pub fn set_point(error: SetPointError) -> PyErr {
    match error {
        SetPointError::Range { .. } => PyValueError::new_err(error.to_string()),
        SetPointError::NotArmed => BoardError::new_err("the core is not armed: core.arm()"),
        _ => BoardError::new_err(error.to_string()),
    }
}
