//! Pt1000 in a half bridge, behind an amplifier:
//! 0.05 + 0.9 (r(T) - r(T_min)) / (r(T_max) - r(T_min)), r = R/(R + 4.7 kOhm), R the Pt1000.

use thermyo_scenario::GasSensor;

/// Resistor in series with the Pt1000 \[Ohm\].
const SERIES_OHM: f64 = 4700.0;

/// Fraction of the reference at a temperature \[K\].
pub fn share(sensor: &GasSensor, temperature_k: f64) -> f64 {
    let lowest = bridge_ratio(sensor.range_min_k);
    let span = bridge_ratio(sensor.range_max_k) - lowest;
    0.05 + 0.9 * ((bridge_ratio(temperature_k) - lowest) / span)
}

fn bridge_ratio(temperature_k: f64) -> f64 {
    let ohm = pt1000_ohm(temperature_k);
    ohm / (ohm + SERIES_OHM)
}

/// Resistance of a Pt1000 \[Ohm\] at a temperature \[K\], IEC 60751, 73 to 1123 K. Limited to the
/// ends, because the polynomials turn back far outside.
pub(super) fn pt1000_ohm(temperature_k: f64) -> f64 {
    const A: f64 = 3.9083e-3;
    const B: f64 = -5.775e-7;
    const C: f64 = -4.183e-12;
    let t = temperature_k.clamp(73.0, 1123.0) - 273.15;
    let below_zero = if t < 0.0 { C * (t - 100.0) * t * t * t } else { 0.0 };
    1000.0 * (1.0 + t * (A + t * B) + below_zero)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pt1000_matches_the_standards_table() {
        for (celsius, ohm) in
            [(-40.0, 842.7), (0.0, 1000.0), (25.0, 1097.4), (100.0, 1385.1), (200.0, 1758.6)]
        {
            let actual = pt1000_ohm(celsius + 273.15);
            assert!((actual - ohm).abs() < 0.06, "{celsius} degC: {actual}");
        }
    }
}
