//! Duration over which the errors of a model persist.

/// Lag up to which every lag counts; longer lags are sampled in steps of up to lag/EXACT rows, over which a correlation
/// hardly changes. All lags of a million rows would take hours.
const EXACT: usize = 128;

/// 1 + 2 (rho_1 + rho_2 + ...), up to the first correlation that is not positive, beyond which there is only noise
/// (Geyer, Statist. Sci. 7, 1992). The correlation is about zero, not about the mean: a bias is an error too.
pub fn correlation_rows(residuals: &[f64]) -> f64 {
    let square: f64 = residuals.iter().map(|r| r * r).sum();
    if square == 0.0 {
        return 1.0;
    }
    let correlation = |lag: usize| -> f64 {
        residuals.iter().zip(&residuals[lag..]).map(|(a, b)| a * b).sum::<f64>() / square
    };
    let (mut sum, mut lag) = (0.0, 1);
    while lag < residuals.len() {
        let step = 1 + lag / EXACT;
        let rho = correlation(lag);
        if rho <= 0.0 {
            break;
        }
        sum += step as f64 * rho;
        lag += step;
    }
    1.0 + 2.0 * sum
}

#[cfg(test)]
mod tests {
    use super::correlation_rows;

    /// A bias correlates over the whole record, and every lag of it used to be summed: half of the rows squared.
    #[test]
    fn a_bias_lasts_as_long_as_a_million_rows() {
        let rows = correlation_rows(&vec![0.1; 1_000_000]);
        assert!((rows / 1.0e6 - 1.0).abs() < 0.01, "{rows}");
    }

    #[test]
    fn long_lags_are_summed_as_if_each_counted() {
        let residuals: Vec<f64> = (0..6000).map(|i| (f64::from(i) * 5.0e-4).cos()).collect();
        let square: f64 = residuals.iter().map(|r| r * r).sum();
        let rho = |lag: usize| -> f64 {
            residuals.iter().zip(&residuals[lag..]).map(|(a, b)| a * b).sum::<f64>() / square
        };
        let every: f64 = (1..6000).map(rho).take_while(|rho| *rho > 0.0).sum();
        let ratio = correlation_rows(&residuals) / (1.0 + 2.0 * every);
        assert!((ratio - 1.0).abs() < 0.01, "{ratio}");
    }
}
