//! What every search has in common: a sum of squares, made small by Levenberg and Marquardt.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt, TerminationReason};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};
use thermyo_compute::stop;

/// What is to be made small.
pub trait LeastSquares {
    /// Weighted residuals at a place of the search.
    fn weighted(&self, place: &DVector<f64>) -> DVector<f64>;

    /// d([`Self::weighted`])/d(place), given what they are there.
    fn slopes(&self, place: &DVector<f64>, residuals: &DVector<f64>) -> DMatrix<f64>;
}

/// Where a search ended.
#[derive(Debug)]
pub struct Found {
    /// What was searched.
    pub place: DVector<f64>,
    /// Sum of the squared weighted residuals.
    pub cost: f64,
    /// Why it ended.
    pub termination: TerminationReason,
}

impl Found {
    /// Whether it was ended on its way, by [`thermyo_compute::stop`].
    pub fn stopped(&self) -> bool {
        matches!(self.termination, TerminationReason::User(_))
    }
}

/// Searches from one start.
pub fn minimize<P: LeastSquares>(
    problem: &P,
    start: DVector<f64>,
    solver: &LevenbergMarquardt<f64>,
) -> Found {
    let residuals = problem.weighted(&start);
    let (search, report) = solver.minimize(Search { problem, place: start, residuals });
    Found {
        cost: search.residuals.norm_squared(),
        place: search.place,
        termination: report.termination,
    }
}

/// One search under way.
struct Search<'a, P> {
    problem: &'a P,
    place: DVector<f64>,
    residuals: DVector<f64>,
}

impl<P: LeastSquares> LeastSquaresProblem<f64, Dyn, Dyn> for Search<'_, P> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, place: &DVector<f64>) {
        self.place.copy_from(place);
        self.residuals = self.problem.weighted(place);
    }

    fn params(&self) -> DVector<f64> {
        self.place.clone()
    }

    // None ends the search.
    fn residuals(&self) -> Option<DVector<f64>> {
        (!stop::wanted()).then(|| self.residuals.clone())
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        (!stop::wanted()).then(|| self.problem.slopes(&self.place, &self.residuals))
    }
}
