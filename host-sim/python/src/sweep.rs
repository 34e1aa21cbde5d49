//! Sweeps, a point at a time: for engines that distribute them over machines.

use crate::error;
use crate::run::{Signals, results};
use crate::scenario;
use pyo3::exceptions::{PyIndexError, PyTypeError};
use pyo3::prelude::*;
use thermyo_sweep::{Latin, MOST_POINTS, Range, Shard, Sweep as Points};

/// The points of `thermyo sweep`, and the rows of its table.
#[pyclass(frozen, module = "thermyo")]
pub struct Sweep {
    points: Points,
}

#[pymethods]
impl Sweep {
    #[new]
    #[pyo3(signature = (scenario, vary, lhs = None, seed = 1))]
    fn new(
        scenario: &Bound<'_, PyAny>,
        vary: &Bound<'_, PyAny>,
        lhs: Option<i64>,
        seed: i128,
    ) -> PyResult<Self> {
        let seed = error::seed(seed)?;
        let lhs = lhs.map(|lhs| error::within("lhs", lhs, 1..=MOST_POINTS as i64)).transpose()?;
        let scenario = scenario::swept(scenario)?;
        let texts = vary.extract::<Vec<String>>().map_err(|_| {
            PyTypeError::new_err(
                "vary: must be a list of texts, such as [\"plant.model=lumped,full\"]",
            )
        })?;
        let ranges = texts.iter().map(|text| {
            text.parse::<Range>().map_err(|e| error::sweep(format!("vary {text}: {e}")))
        });
        let latin = lhs.map(|points| Latin { points: points as usize, seed });
        let points = Points::of(scenario, ranges.collect::<PyResult<_>>()?, latin, Shard::WHOLE)
            .map_err(error::sweep)?;
        Ok(Self { points })
    }

    fn __len__(&self) -> usize {
        self.points.study.plan.points()
    }

    #[getter]
    fn header(&self) -> String {
        self.points.study.csv_header()
    }

    /// "KEY = VALUE, ...".
    fn values(&self, point: i64) -> PyResult<String> {
        self.known(point).map(|index| self.points.study.values_text(index))
    }

    fn row(&self, py: Python<'_>, point: i64) -> PyResult<String> {
        let index = self.known(point)?;
        let mut signals = Signals::new();
        let point = py.detach(|| self.points.point(index, &mut || signals.go_on()));
        signals.raise()?;
        Ok(self.points.study.csv_row(&point))
    }

    /// The row as a dict.
    fn record<'py>(&self, py: Python<'py>, point: i64) -> PyResult<Bound<'py, PyAny>> {
        let row = self.row(py, point)?;
        results(py)?.getattr("record")?.call1((self.header(), row))
    }
}

impl Sweep {
    /// Index of a point; points count from 1 as in the table.
    fn known(&self, point: i64) -> PyResult<usize> {
        let all = self.points.study.plan.points();
        match usize::try_from(point) {
            Ok(point) if (1..=all).contains(&point) => Ok(point - 1),
            _ => Err(PyIndexError::new_err(format!("point {point}: must be 1 to {all}"))),
        }
    }
}
