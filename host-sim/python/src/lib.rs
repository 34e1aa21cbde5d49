//! The Python package `thermyo`: runs, the plant and the core step by step, identification, boards.
//!
//! `thermyo.pyi` documents the interface. Long calls release the interpreter's lock.

mod board;
mod calibrate;
mod core;
mod error;
mod experiments;
mod held;
mod identify;
mod muscle;
mod run;
mod scenario;
mod set_point;
mod sweep;

use pyo3::prelude::*;

/// Thermodynamics of a pneumatic muscle: simulate it, estimate its gas temperature, drive it.
#[pymodule]
mod thermyo {
    #[pymodule_export]
    use super::board::{Board, Stream};
    #[pymodule_export]
    use super::core::{Core, Output};
    #[pymodule_export]
    use super::error::{BoardError, RunError, ScenarioError, ScenarioWarning};
    #[pymodule_export]
    use super::identify::identify;
    #[pymodule_export]
    use super::muscle::{Muscle, Readings};
    #[pymodule_export]
    use super::run::{run, to_csv};
    #[pymodule_export]
    use super::scenario::check;
    #[pymodule_export]
    use super::sweep::Sweep;

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        // If numpy is missing, the first array would panic.
        module.py().import("numpy")?;
        module.add("Run", super::run::results(module.py())?.getattr("Run")?)?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
