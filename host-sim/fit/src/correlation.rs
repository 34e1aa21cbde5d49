//! How long the errors of a model last.

/// 1 + 2 (rho_1 + rho_2 + ...), up to the first correlation that is not positive, beyond which
/// there is only noise (Geyer, Statist. Sci. 7, 1992). About zero, not about the mean: a bias is an
/// error too.
pub fn correlation_rows(residuals: &[f64]) -> f64 {
    let square: f64 = residuals.iter().map(|r| r * r).sum();
    if square == 0.0 {
        return 1.0;
    }
    let correlation = |lag: usize| -> f64 {
        residuals.iter().zip(&residuals[lag..]).map(|(a, b)| a * b).sum::<f64>() / square
    };
    let positive = (1..residuals.len()).map(correlation).take_while(|rho| *rho > 0.0);
    1.0 + 2.0 * positive.sum::<f64>()
}
