//! How well the data determine the parameters.
//!
//! With the sensitivities J of the weighted residuals to the logarithms of the parameters, split by
//! measured column c, and H = sum of J_c' J_c, the covariance of the logarithms is
//!
//! ```text
//! C = H^-1 (sum of v_c J_c' J_c) H^-1,   v_c = max(1, s_c^2 t_c)
//! ```
//!
//! s_c^2 is the mean square of the column's weighted residuals: 1 where they are the sensor's noise, more where the
//! model is wrong too. A model's error persists from row to row, so that the rows hold less information than their
//! number suggests: t_c is the integrated autocorrelation time of the residuals in rows, and n_c/t_c the effective
//! number of them. Residuals below the stated noise do not make the result more certain.

use super::data::Observed;
use nalgebra::{DMatrix, DVector};
use thermyo_fit::correlation_rows;

/// Statistics of the residuals of one measured column.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Misfit {
    /// Root mean square, in the column's own unit.
    pub rms: f64,
    /// Integrated autocorrelation time, in rows, at least 1.
    pub correlation_rows: f64,
    /// Factor on the variance that the stated noise alone would give.
    pub inflation: f64,
}

impl Misfit {
    /// Computes the statistics. `residuals` are in the column's unit; `freedom` is the fraction of the rows that the
    /// parameters leave free, (N - p)/N.
    pub fn new(residuals: &[f64], deviation: f64, freedom: f64) -> Self {
        let count = residuals.len() as f64;
        let mean_square = residuals.iter().map(|r| r * r).sum::<f64>() / count;
        let correlation_rows = correlation_rows(residuals);
        let chi_square = mean_square / (deviation * deviation) / freedom;
        Self {
            rms: mean_square.sqrt(),
            correlation_rows,
            inflation: (chi_square * correlation_rows).max(1.0),
        }
    }
}

/// Covariance of the logarithms of the parameters; `None` if the data leave some combination of them open.
pub fn covariance(
    sensitivities: &DMatrix<f64>,
    observed: &[Observed],
    misfits: &[Misfit],
) -> Option<DMatrix<f64>> {
    let count = sensitivities.ncols();
    if count == 0 {
        return Some(DMatrix::zeros(0, 0));
    }
    // Scaled to columns of length 1, so that units do not matter.
    let lengths = DVector::from_fn(count, |i, _| sensitivities.column(i).norm());
    if lengths.iter().any(|length| *length <= f64::MIN_POSITIVE) {
        return None;
    }
    let scaled = DMatrix::from_fn(sensitivities.nrows(), count, |row, i| {
        sensitivities[(row, i)] / lengths[i]
    });
    let mut information = DMatrix::zeros(count, count);
    let mut spread = DMatrix::zeros(count, count);
    let mut first = 0;
    for (observed, misfit) in observed.iter().zip(misfits) {
        let rows = scaled.rows(first, observed.points.len());
        let part = rows.transpose() * rows;
        spread += misfit.inflation * &part;
        information += part;
        first += observed.points.len();
    }
    // Below this, only the error of the sensitivities' finite differences remains.
    let singular = information.clone().symmetric_eigenvalues().min() < 1e-10;
    let inverse = information.cholesky().filter(|_| !singular)?.inverse();
    let scaled = &inverse * spread * &inverse;
    Some(DMatrix::from_fn(count, count, |i, j| scaled[(i, j)] / (lengths[i] * lengths[j])))
}

#[cfg(test)]
mod tests {
    use super::super::data::Quantity;
    use super::*;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    /// Fits straight lines through noise with correlation `memory` from row to row; returns the
    /// fraction of fits whose slope is wrong by more than two standard errors.
    fn outside_two(memory: f64) -> f64 {
        const ROWS: usize = 400;
        const FITS: u64 = 400;
        let lines = DMatrix::from_fn(ROWS, 2, |row, i| [1.0, row as f64 / ROWS as f64][i]);
        let points = vec![(0.0, 0.0); ROWS];
        let observed = [Observed { quantity: Quantity::Pressure, points, deviation: 1.0 }];
        let outside = (0..FITS).filter(|seed| {
            let mut random = Xoshiro256PlusPlus::seed_from_u64(*seed);
            let mut last = 0.0;
            let noise = DVector::from_fn(ROWS, |_, _| {
                let fresh: f64 = StandardNormal.sample(&mut random);
                last = memory * last + 2.0 * (1.0 - memory * memory).sqrt() * fresh;
                last
            });
            let inverse = (lines.transpose() * &lines).try_inverse().unwrap();
            let found = &inverse * lines.transpose() * &noise;
            let residuals = &noise - &lines * &found;
            let freedom = 1.0 - 2.0 / ROWS as f64;
            let misfit = Misfit::new(residuals.as_slice(), 1.0, freedom);
            let covariance = covariance(&lines, &observed, &[misfit]).unwrap();
            found[1].abs() > 2.0 * covariance[(1, 1)].sqrt()
        });
        outside.count() as f64 / FITS as f64
    }

    #[test]
    fn standard_errors_hold_for_white_and_for_correlated_residuals() {
        // 4.6 % of a normal distribution; estimating the deviation from the residuals adds some.
        let (white, correlated) = (outside_two(0.0), outside_two(0.9));
        assert!((0.01..0.10).contains(&white), "{white}");
        assert!((0.02..0.16).contains(&correlated), "{correlated}");
    }

    #[test]
    fn nothing_searched_inside_its_limits_has_an_empty_covariance() {
        let points = vec![(0.0, 0.0); 3];
        let observed = [Observed { quantity: Quantity::Pressure, points, deviation: 1.0 }];
        let misfit = [Misfit::new(&[1.0, -1.0, 1.0], 1.0, 1.0)];
        let found = covariance(&DMatrix::zeros(3, 0), &observed, &misfit);
        assert_eq!(found, Some(DMatrix::zeros(0, 0)));
    }

    #[test]
    fn undetermined_parameters_have_no_covariance() {
        let points = vec![(0.0, 0.0); 3];
        let observed = [Observed { quantity: Quantity::Pressure, points, deviation: 1.0 }];
        let misfit = [Misfit::new(&[1.0, -1.0, 1.0], 1.0, 1.0)];
        let same = DMatrix::from_row_slice(3, 2, &[1.0, 2.0, 2.0, 4.0, 3.0, 6.0]);
        assert_eq!(covariance(&same, &observed, &misfit), None);
        let nothing = DMatrix::from_row_slice(3, 2, &[1.0, 0.0, 2.0, 0.0, 3.0, 0.0]);
        assert_eq!(covariance(&nothing, &observed, &misfit), None);
    }
}
