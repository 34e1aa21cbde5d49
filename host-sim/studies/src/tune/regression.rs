//! Linear least squares with standard errors that account for correlated residuals.

use nalgebra::{DMatrix, DVector};
use thermyo_fit::correlation_rows;

/// Smallest allowed eigenvalue of the scaled normal matrix: below it the measurements do not
/// determine some combination of the coefficients.
const SINGULAR: f64 = 1e-9;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measure {
    pub value: f64,
    pub error: f64,
}

impl Measure {
    /// Mean of two measures of one quantity; its error is at least half of their difference.
    pub fn between(self, other: Self) -> Self {
        let half = 0.5 * (self.value - other.value).abs();
        Self {
            value: f64::midpoint(self.value, other.value),
            error: half.max(0.5 * self.error.hypot(other.error)),
        }
    }

    /// The measure of a linear function of this quantity.
    pub fn scaled(self, factor: f64, term: f64) -> Self {
        Self { value: factor * self.value + term, error: factor.abs() * self.error }
    }

    pub fn less(self, other: Self) -> Self {
        Self { value: self.value - other.value, error: self.error.hypot(other.error) }
    }
}

/// Coefficients of a linear model, with their covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit<const N: usize> {
    coefficients: [f64; N],
    covariance: DMatrix<f64>,
    /// Measured minus fitted, row by row.
    pub residuals: Vec<f64>,
}

/// Fits y = sum of coefficient times column to rows of (columns, y); none if there are fewer rows
/// than twice the coefficients, or the rows do not determine them all.
///
/// The covariance is s^2 t (X'X)^-1: s^2 the mean square of the residuals, t their integrated
/// autocorrelation time in rows, since model errors persist from row to row.
pub fn least_squares<const N: usize>(rows: &[([f64; N], f64)]) -> Option<Fit<N>> {
    let columns = DMatrix::from_fn(rows.len(), N, |row, i| rows[row].0[i]);
    let y = DVector::from_fn(rows.len(), |row, _| rows[row].1);
    let Solution { coefficients, covariance, residuals } = solve(&columns, &y)?;
    let coefficients = std::array::from_fn(|i| coefficients[i]);
    Some(Fit { coefficients, covariance, residuals })
}

/// Coefficients of a linear model of any number of columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    pub coefficients: DVector<f64>,
    pub covariance: DMatrix<f64>,
    /// Measured minus fitted, row by row.
    pub residuals: Vec<f64>,
}

/// As [`least_squares`].
pub fn solve(columns: &DMatrix<f64>, y: &DVector<f64>) -> Option<Solution> {
    let (rows, count) = columns.shape();
    if rows < 2 * count {
        return None;
    }
    // Scaled to columns of length 1, so that units do not matter.
    let lengths = DVector::from_fn(count, |i, _| columns.column(i).norm());
    if lengths.iter().any(|length| !(*length > 0.0 && length.is_finite())) {
        return None;
    }
    let scaled = DMatrix::from_fn(rows, count, |row, i| columns[(row, i)] / lengths[i]);
    let normal = scaled.transpose() * &scaled;
    let open = normal.clone().symmetric_eigenvalues().min() < SINGULAR;
    let inverse = normal.cholesky().filter(|_| !open)?.inverse();
    let coefficients = (&inverse * scaled.transpose() * y).component_div(&lengths);
    let residuals = y - columns * &coefficients;
    let variance =
        residuals.norm_squared() / (rows - count) as f64 * correlation_rows(residuals.as_slice());
    let covariance = DMatrix::from_fn(count, count, |i, j| {
        variance * inverse[(i, j)] / (lengths[i] * lengths[j])
    });
    Some(Solution { coefficients, covariance, residuals: residuals.as_slice().to_vec() })
}

impl<const N: usize> Fit<N> {
    /// A function `of` the coefficients, with its error from the gradient.
    pub fn measure(&self, of: impl Fn(&[f64; N]) -> f64) -> Measure {
        let gradient = DVector::from_fn(N, |i, _| {
            let step = 1e-3 * self.covariance[(i, i)].sqrt().max(f64::MIN_POSITIVE);
            let at = |shift: f64| {
                let mut moved = self.coefficients;
                moved[i] += shift;
                of(&moved)
            };
            (at(step) - at(-step)) / (2.0 * step)
        });
        let variance = (gradient.transpose() * &self.covariance * &gradient)[0];
        Measure { value: of(&self.coefficients), error: variance.sqrt() }
    }

    /// Root mean square of the residuals.
    pub fn rms(&self) -> f64 {
        let square: f64 = self.residuals.iter().map(|r| r * r).sum();
        (square / self.residuals.len() as f64).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    #[test]
    fn the_stated_errors_are_those_of_repeated_fits() {
        let fits: u32 = 400;
        let outside = (0..fits)
            .filter(|seed| {
                let mut random = Xoshiro256PlusPlus::seed_from_u64(u64::from(*seed));
                let rows: Vec<([f64; 2], f64)> = (0..200)
                    .map(|row| {
                        let x = f64::from(row) / 200.0;
                        let noise: f64 = StandardNormal.sample(&mut random);
                        ([1.0, x], 3.0 + 2.0 * x + 0.1 * noise)
                    })
                    .collect();
                let ratio = least_squares(&rows).unwrap().measure(|c| c[1] / c[0]);
                (ratio.value - 2.0 / 3.0).abs() > 2.0 * ratio.error
            })
            .count();
        // 4.6 % of a normal distribution; estimating the deviation from the residuals adds some.
        assert!((0.01..0.10).contains(&(outside as f64 / f64::from(fits))), "{outside}");
    }

    #[test]
    fn undetermined_coefficients_have_no_fit() {
        let same: Vec<_> = (0..9).map(|i| ([f64::from(i), 2.0 * f64::from(i)], 1.0)).collect();
        assert_eq!(least_squares(&same), None);
        let nothing: Vec<_> = (0..9).map(|i| ([f64::from(i), 0.0], 1.0)).collect();
        assert_eq!(least_squares(&nothing), None);
        assert_eq!(least_squares(&[([1.0], 1.0)]), None);
    }

    #[test]
    fn measures_that_disagree_are_no_more_certain_than_their_difference() {
        let one = Measure { value: 1.0, error: 0.1 };
        let close = one.between(Measure { value: 1.02, error: 0.1 });
        assert!((close.value - 1.01).abs() < 1e-12 && (close.error - 0.0707).abs() < 1e-3);
        let far = one.between(Measure { value: 2.0, error: 0.1 });
        assert!((far.error - 0.5).abs() < 1e-12);
    }
}
