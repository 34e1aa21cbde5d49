//! The search: weighted least squares by Levenberg and Marquardt, from several starts.

use super::balance::Failed;
use super::data::Data;
use super::parameter::Parameter;
use super::simulate::Experiment;
use nalgebra::{DMatrix, DVector};
use rand_distr::{Distribution, Uniform};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use thermyo_compute::parallel;
use thermyo_compute::parallel::Watch;
use thermyo_fit::search::{self, LeastSquares, central_slopes};
use thermyo_scenario::{Scenario, with_numbers};

/// Step of the differences in ln x: far above the integrators' rounding, far below a curvature.
const DIFFERENCE: f64 = 1e-4;
/// Relative change of the sum of squares, and of the parameters, at which a search has converged.
const TOLERANCE: f64 = 1e-8;
/// Evaluations per parameter before a search is given up.
const PATIENCE: usize = 30;
/// Weighted residual that stands for "no prediction": far worse than any real one.
const HOPELESS: f64 = 1e6;

#[derive(Debug, Clone, PartialEq)]
pub struct End {
    /// Coordinates of the parameters, see [`Parameter::place`].
    pub place: DVector<f64>,
    /// Sum of the squared weighted residuals.
    pub cost: f64,
    pub converged: bool,
}

/// The problem: a scenario, its parameters and the data.
#[derive(Clone)]
pub struct Problem<'a> {
    /// The scenario in which the parameters are replaced.
    pub scenario: &'a Scenario,
    pub parameters: &'a [Parameter],
    pub data: &'a Data,
    pub experiment: Experiment<'a>,
    pub watch: &'a dyn Watch,
}

impl Problem<'_> {
    pub fn scenario_at(&self, place: &DVector<f64>) -> Scenario {
        let values = self.parameters.iter().zip(place.iter());
        with_numbers(self.scenario, values.map(|(p, u)| (p.path.as_str(), p.value(*u))))
    }

    /// Prediction minus measurement, column by column, in the columns' own units.
    pub fn residuals(&self, place: &DVector<f64>) -> Result<Vec<f64>, Failed> {
        let predicted = self.experiment.predict(&self.scenario_at(place), self.watch)?;
        Ok(self.data.less_measured(predicted))
    }

    /// d(weighted residual)/d(ln x) by central differences.
    pub fn sensitivities(&self, place: &DVector<f64>) -> DMatrix<f64> {
        let size = |i: usize| DIFFERENCE / self.parameters[i].slope(place[i]);
        central_slopes(place, DIFFERENCE, size, |place| self.weighted(place))
    }

    /// Searches from the scenario's values and from others around them. When stopped, returns the
    /// finished searches.
    pub fn search(&self) -> Vec<End> {
        let ends = parallel::map_watched(&self.starts(), self.watch, |start| self.minimize(start));
        ends.into_iter().flatten().collect()
    }

    /// Starts by a Latin hypercube in the logarithms, the scenario's values first: each of equally
    /// many strata of a parameter's spread is used once.
    fn starts(&self) -> Vec<DVector<f64>> {
        let others = self.scenario.identify.starts as usize - 1;
        let mut random = Xoshiro256PlusPlus::seed_from_u64(self.scenario.run.seed);
        let unit = Uniform::new(0.0, 1.0).expect("the range is not empty");
        let mut draw = || -> f64 { unit.sample(&mut random) };
        let mut starts: Vec<DVector<f64>> = vec![DVector::zeros(self.parameters.len()); others + 1];
        for (i, parameter) in self.parameters.iter().enumerate() {
            starts[0][i] = parameter.place(parameter.given);
            let mut strata: Vec<usize> = (0..others).collect();
            for last in (1..others).rev() {
                strata.swap(last, (draw() * (last + 1) as f64) as usize);
            }
            for (start, stratum) in starts[1..].iter_mut().zip(strata) {
                let share = (stratum as f64 + draw()) / others as f64;
                let factor = self.scenario.identify.spread.powf(2.0 * share - 1.0);
                start[i] = parameter.place(parameter.given * factor);
            }
        }
        starts
    }

    pub fn minimize(&self, start: &DVector<f64>) -> Option<End> {
        let found = search::minimize(self, start.clone(), TOLERANCE, PATIENCE);
        if found.stopped {
            return None;
        }
        let hopeless = HOPELESS * HOPELESS;
        let converged = found.converged && found.cost < hopeless;
        Some(End { place: found.place, cost: found.cost, converged })
    }
}

impl LeastSquares for Problem<'_> {
    fn weighted(&self, place: &DVector<f64>) -> DVector<f64> {
        let len = self.data.values();
        let Ok(mut residuals) = self.residuals(place) else {
            return DVector::from_element(len, HOPELESS);
        };
        let columns = self.data.observed.iter();
        let deviations = columns.flat_map(|o| std::iter::repeat_n(o.deviation, o.points.len()));
        for (residual, deviation) in residuals.iter_mut().zip(deviations) {
            *residual /= deviation;
        }
        DVector::from_vec(residuals)
    }

    fn stopped(&self) -> bool {
        self.watch.stopped()
    }

    /// One-sided differences: accurate enough for the search, at half the cost.
    fn slopes(&self, place: &DVector<f64>, residuals: &DVector<f64>) -> DMatrix<f64> {
        let columns: Vec<DVector<f64>> = (0..place.len())
            .map(|i| {
                let step = DIFFERENCE / self.parameters[i].slope(place[i]);
                let mut shifted = place.clone();
                shifted[i] += step;
                (self.weighted(&shifted) - residuals) / step
            })
            .collect();
        DMatrix::from_columns(&columns)
    }
}
