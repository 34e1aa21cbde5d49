//! NTC thermistor as the lower leg of a divider: R/(R + series).

use model_core::sensing::gas::Ntc;
use thermyo_compute::math;

/// Fraction of the reference at a temperature \[K\].
pub fn share(ntc: &Ntc, temperature_k: f64) -> f64 {
    let inverse_k = |x: f64| {
        let [square, cube] = [ntc.square_per_k, ntc.cube_per_k].map(f64::from);
        1.0 / 298.15 + x / f64::from(ntc.beta_k) + square * x * x + cube * x * x * x
    };
    // The resistance falls with the temperature: limited to 1e-5 to 1e5 times that at 25 degC.
    let (mut low, mut high) = (-11.5, 11.5);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if inverse_k(middle) * temperature_k < 1.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    let resistance_ohm = f64::from(ntc.resistance_ohm) * math::exp(low);
    resistance_ohm / (resistance_ohm + f64::from(ntc.series_ohm))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_beta_equation() {
        let ntc = Ntc::default();
        for kelvin in [250.0_f64, 298.15, 350.0] {
            let ohm = 1e4 * math::exp(f64::from(ntc.beta_k) * (1.0 / kelvin - 1.0 / 298.15));
            assert!((share(&ntc, kelvin) - ohm / (ohm + 1e4)).abs() < 1e-9, "{kelvin}");
        }
    }
}
