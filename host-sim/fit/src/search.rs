//! Levenberg-Marquardt minimisation of a sum of squares, as all searches use it.

use nalgebra::{DMatrix, DVector};
use rmpfit::{MPConfig, MPError, MPFitter, MPMaxFev, MPPar, MPResult, MPSide, MPSuccess};

/// A sum of squares to minimise.
pub trait LeastSquares {
    /// Weighted residuals at a point of the search.
    fn weighted(&self, place: &DVector<f64>) -> DVector<f64>;

    /// d([`Self::weighted`])/d(place); `residuals` are those at `place`.
    fn slopes(&self, place: &DVector<f64>, residuals: &DVector<f64>) -> DMatrix<f64>;

    /// Whether the search should end early.
    fn stopped(&self) -> bool {
        false
    }
}

/// d(`of`)/d(place), by central differences; the `size` of each counts as `difference`.
pub fn central_slopes(
    place: &DVector<f64>,
    difference: f64,
    size: impl Fn(usize) -> f64,
    of: impl Fn(&DVector<f64>) -> DVector<f64>,
) -> DMatrix<f64> {
    let column = |i: usize| {
        let [above, below] = [size(i), -size(i)].map(|by| {
            let mut shifted = place.clone();
            shifted[i] += by;
            of(&shifted)
        });
        (above - below) / (2.0 * difference)
    };
    DMatrix::from_columns(&(0..place.len()).map(column).collect::<Vec<_>>())
}

#[derive(Debug)]
pub struct Found {
    pub place: DVector<f64>,
    /// Sum of the squared weighted residuals.
    pub cost: f64,
    /// Whether no better point is near.
    pub converged: bool,
    /// Whether the search ended early: [`LeastSquares::stopped`].
    pub stopped: bool,
}

/// Searches from one start until sum and point change by less than a relative `tolerance`. Gives up
/// after `patience` evaluations per parameter; a set of slopes counts as one.
pub fn minimize(
    problem: &dyn LeastSquares,
    start: DVector<f64>,
    tolerance: f64,
    patience: usize,
) -> Found {
    let residuals = problem.weighted(&start);
    let cost = residuals.norm_squared();
    // The library does not check this.
    if residuals.len() < start.len() {
        return Found { place: start, cost, converged: false, stopped: false };
    }
    let config = MPConfig {
        ftol: tolerance,
        xtol: tolerance,
        // The library requires a value above 0.
        gtol: f64::MIN_POSITIVE,
        // Scale of the first step, in the parameters' own coordinates.
        step_factor: 1.0,
        max_iter: usize::MAX,
        max_fev: MPMaxFev::Limited(patience * (start.len() + 1)),
        ..MPConfig::new()
    };
    let slopes = || MPPar { side: MPSide::User, ..MPPar::new() };
    let parameters = (0..start.len()).map(|_| slopes()).collect();
    let mut search =
        Search { problem, start: &start, place: start.clone(), residuals, config, parameters };
    let mut way = DVector::repeat(start.len(), 1.0);
    match search.mpfit(way.as_mut_slice()) {
        Ok(status) => Found {
            place: search.at(way.as_slice()),
            // The library's own norm may belong to a step that it has not taken.
            cost: DVector::from_vec(status.resid).norm_squared(),
            converged: status.success != MPSuccess::MaxIter,
            stopped: false,
        },
        Err(error) => {
            Found { place: start, cost, converged: false, stopped: matches!(error, MPError::Eval) }
        }
    }
}

struct Search<'a> {
    problem: &'a dyn LeastSquares,
    start: &'a DVector<f64>,
    /// Point evaluated last, and the residuals there.
    place: DVector<f64>,
    residuals: DVector<f64>,
    config: MPConfig,
    parameters: Vec<MPPar>,
}

impl Search<'_> {
    /// Point of the search after a way. The library's first step is a share of the distance to 0, which means nothing
    /// here: it is given the way from the start, plus 1.
    fn at(&self, way: &[f64]) -> DVector<f64> {
        self.start + DVector::from_row_slice(way).add_scalar(-1.0)
    }
}

impl MPFitter for Search<'_> {
    fn eval(&mut self, way: &[f64], residuals: &mut [f64]) -> MPResult<()> {
        if self.problem.stopped() {
            return Err(MPError::Eval);
        }
        let place = self.at(way);
        if self.place != place {
            self.residuals = self.problem.weighted(&place);
            self.place = place;
        }
        residuals.copy_from_slice(self.residuals.as_slice());
        Ok(())
    }

    fn jacobian(
        &mut self,
        way: &[f64],
        residuals: &mut [f64],
        slopes: &mut [Option<Vec<f64>>],
    ) -> MPResult<()> {
        self.eval(way, residuals)?;
        let columns = self.problem.slopes(&self.place, &self.residuals);
        for (slope, column) in slopes.iter_mut().zip(columns.column_iter()) {
            if let Some(slope) = slope {
                slope.copy_from_slice(column.as_slice());
            }
        }
        Ok(())
    }

    fn number_of_points(&self) -> usize {
        self.residuals.len()
    }

    fn config(&self) -> &MPConfig {
        &self.config
    }

    fn parameters(&self) -> &[MPPar] {
        &self.parameters
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley, whose floor is `floor` above 0, at (1, 1).
    struct Valley {
        floor: f64,
    }

    impl LeastSquares for Valley {
        fn weighted(&self, place: &DVector<f64>) -> DVector<f64> {
            let bend = 10.0 * (place[1] - place[0] * place[0]);
            DVector::from_vec(vec![bend, 1.0 - place[0], self.floor.sqrt()])
        }

        fn slopes(&self, place: &DVector<f64>, residuals: &DVector<f64>) -> DMatrix<f64> {
            assert_eq!(*residuals, self.weighted(place));
            DMatrix::from_row_slice(3, 2, &[-20.0 * place[0], 10.0, -1.0, 0.0, 0.0, 0.0])
        }
    }

    fn start() -> DVector<f64> {
        DVector::from_vec(vec![-1.2, 1.0])
    }

    #[test]
    fn a_search_ends_at_the_minimum_with_its_cost() {
        for floor in [0.0, 7.0] {
            let found = minimize(&Valley { floor }, start(), 1e-8, 30);
            assert!(found.converged && !found.stopped, "{found:?}");
            assert!((found.cost - floor).abs() < 1e-9, "{found:?}");
            assert!((&found.place - DVector::from_element(2, 1.0)).norm() < 1e-3, "{found:?}");
        }
    }

    /// Points visited in a search for 1000, whose steps hardly change the residual.
    struct Flat(std::cell::RefCell<Vec<f64>>);

    impl LeastSquares for Flat {
        fn weighted(&self, place: &DVector<f64>) -> DVector<f64> {
            self.0.borrow_mut().push(place[0]);
            DVector::from_vec(vec![1.0 - 0.001 * place[0], 1.0])
        }

        fn slopes(&self, _: &DVector<f64>, _: &DVector<f64>) -> DMatrix<f64> {
            DMatrix::from_row_slice(2, 1, &[-0.001, 0.0])
        }
    }

    #[test]
    fn the_first_step_is_no_leap_wherever_the_search_starts() {
        for start in [-20.0, 0.0, 0.3, 20.0] {
            let flat = Flat(Vec::new().into());
            let found = minimize(&flat, DVector::from_element(1, start), 1e-8, 30);
            let first = flat.0.borrow()[1] - start;
            assert!((0.5..1.5).contains(&first), "{start}: {first}");
            assert!((found.place[0] - 1000.0).abs() < 1.0, "{start}: {found:?}");
        }
    }

    #[test]
    fn a_search_without_patience_or_with_too_few_residuals_has_not_converged() {
        let impatient = minimize(&Valley { floor: 0.0 }, start(), 1e-8, 1);
        assert!(!impatient.converged, "{impatient:?}");
        let lost = minimize(&Valley { floor: 0.0 }, DVector::zeros(4), 1e-8, 30);
        assert!(!lost.converged && lost.place == DVector::zeros(4), "{lost:?}");
    }
}
