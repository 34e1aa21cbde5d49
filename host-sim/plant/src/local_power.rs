//! x^p for a slowly moving x, without a call of `pow` at every step.

use thermyo_compute::math;

/// Terms of the binomial series; at [`RADIUS`] the first omitted one is below 1e-16.
const TERMS: usize = 5;
/// Relative distance from the reference beyond which a new reference is taken.
const RADIUS: f64 = 1.0e-3;

/// Evaluates x^p by the binomial series around a reference that follows x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalPower {
    exponent: f64,
    /// Binomial coefficients of (1 + e)^p, from the first order on.
    series: [f64; TERMS],
    inverse_reference: f64,
    power: f64,
}

impl LocalPower {
    /// Power with exponent p, starting near `x` > 0.
    pub fn new(exponent: f64, x: f64) -> Self {
        let mut series = [0.0; TERMS];
        let mut coefficient = 1.0;
        for (i, term) in series.iter_mut().enumerate() {
            coefficient *= (exponent - i as f64) / (i + 1) as f64;
            *term = coefficient;
        }
        Self { exponent, series, inverse_reference: 1.0 / x, power: math::pow(x, exponent) }
    }

    /// x^p, for x > 0.
    #[inline]
    pub fn at(&mut self, x: f64) -> f64 {
        let distance = x * self.inverse_reference - 1.0;
        // A NaN takes the exact branch, and stays NaN.
        if distance.abs() <= RADIUS {
            // In pairs, which do not wait for each other as they would in Horner's scheme.
            let [first, second, third, fourth, fifth] = self.series;
            let square = distance * distance;
            let beyond = third + distance * fourth + square * fifth;
            return self.power * (1.0 + distance * (first + distance * second + square * beyond));
        }
        self.inverse_reference = 1.0 / x;
        self.power = math::pow(x, self.exponent);
        self.power
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_pow() {
        for exponent in [-1.67, -1.4, -1.0, 0.4] {
            let mut local = LocalPower::new(exponent, 1e-4);
            for i in 0..3000 {
                let x = 1e-4 * (1.0 + 0.7 * math::sin(f64::from(i) * 0.01));
                let exact = math::pow(x, exponent);
                assert!((local.at(x) / exact - 1.0).abs() < 2e-15, "{x}^{exponent}");
            }
        }
    }
}
