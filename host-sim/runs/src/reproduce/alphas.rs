//! The coefficients of eq. (9), fitted to a plant.
//!
//! ```text
//! P(t) - P(0) = alpha_in I[R T m_in/V] - alpha_out I[R T m_out/V] - alpha I[P dV/V]     integral of (9)
//! ```
//!
//! within each half stroke, with the plant's own flows, volume and temperature, which obey
//! P V = m R T. Linear least squares; standard errors by leaving out one stroke at a time.

use super::Signals;
use nalgebra::{Matrix3, Vector3};
use thermyo_scenario::Scenario;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coefficient {
    pub value: f64,
    pub standard_error: f64,
}

/// Normal equations: squares, right side.
type Normal = (Matrix3<f64>, Vector3<f64>);

/// alpha_in, alpha_out and alpha of a run with this period; none if the run does not determine them.
pub fn fitted(signals: &Signals, plant: &Scenario, period_s: f64) -> Option<[Coefficient; 3]> {
    let strokes = (signals.time_s.last()? / period_s).round() as usize;
    let parts: Vec<Normal> =
        (0..strokes).map(|stroke| of_stroke(signals, plant, period_s, stroke)).collect();
    let sum = |out: Option<usize>| {
        let counted = parts.iter().enumerate().filter(|(i, _)| Some(*i) != out);
        let zero = (Matrix3::zeros(), Vector3::zeros());
        let (squares, right) =
            counted.fold(zero, |all: Normal, (_, part)| (all.0 + part.0, all.1 + part.1));
        squares.cholesky().map(|squares| squares.solve(&right))
    };
    let values = sum(None)?;
    let others: Vec<Vector3<f64>> =
        (0..strokes).map(|out| sum(Some(out))).collect::<Option<_>>()?;
    let count = strokes as f64;
    Some([0, 1, 2].map(|i| {
        let mean = others.iter().map(|other| other[i]).sum::<f64>() / count;
        let squares: f64 = others.iter().map(|other| (other[i] - mean).powi(2)).sum();
        Coefficient { value: values[i], standard_error: ((count - 1.0) / count * squares).sqrt() }
    }))
}

fn of_stroke(signals: &Signals, plant: &Scenario, period_s: f64, stroke: usize) -> Normal {
    let mut normal: Normal = (Matrix3::zeros(), Vector3::zeros());
    let gas_constant = plant.gas.gas_constant_j_kg_k;
    for half in 0..2 {
        let from_s = (stroke as f64 + 0.5 * f64::from(half)) * period_s;
        let from = signals.time_s.partition_point(|time_s| *time_s < from_s - 1e-9);
        let to = signals.time_s.partition_point(|time_s| *time_s < from_s + 0.5 * period_s - 1e-9);
        let mut integrals = Vector3::zeros();
        for row in from + 1..to {
            let between = |values: &[f64]| 0.5 * (values[row] + values[row - 1]);
            let step_s = signals.time_s[row] - signals.time_s[row - 1];
            let volume_m3 = between(&signals.volume_m3);
            let per_kg = gas_constant * between(&signals.gas_k) / volume_m3 * step_s;
            integrals[0] += per_kg * signals.flow_in_kg_s[row];
            integrals[1] -= per_kg * signals.flow_out_kg_s[row];
            integrals[2] -= between(&signals.pressure_pa) / volume_m3
                * (signals.volume_m3[row] - signals.volume_m3[row - 1]);
            let risen_pa = signals.pressure_pa[row] - signals.pressure_pa[from];
            normal.0 += integrals * integrals.transpose();
            normal.1 += integrals * risen_pa;
        }
    }
    normal
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pressure that follows eq. (9) exactly returns its coefficients.
    #[test]
    fn known_coefficients_are_found() {
        let (alpha_in, alpha_out, alpha) = (1.35, 1.05, 1.2);
        let plant = Scenario::default();
        let gas_constant = plant.gas.gas_constant_j_kg_k;
        let (period_s, step_s) = (5.0, 0.001);
        let mut signals = Signals::default();
        let (mut pressure_pa, mut mass_kg) = (2.0e5, 2.4e-4);
        let volume_at = |time_s: f64| 1.0e-4 * (1.2 + 0.2 * (1.3 * time_s).sin());
        for row in 0..20_001 {
            let time_s = f64::from(row) * step_s;
            let filling = (time_s / period_s + 1e-9).fract() < 0.5;
            let [inflow, outflow] = if filling { [2e-5, 0.0] } else { [0.0, 2e-5] };
            let volume_m3 = volume_at(time_s);
            if row > 0 {
                let before_m3 = volume_at(time_s - step_s);
                let gas_k = pressure_pa * before_m3 / (mass_kg * gas_constant);
                let flow = alpha_in * inflow - alpha_out * outflow;
                pressure_pa += gas_constant * gas_k / before_m3 * flow * step_s
                    - alpha * pressure_pa * (volume_m3 / before_m3 - 1.0);
                mass_kg += (inflow - outflow) * step_s;
            }
            signals.time_s.push(time_s);
            signals.pressure_pa.push(pressure_pa);
            signals.volume_m3.push(volume_m3);
            signals.gas_k.push(pressure_pa * volume_m3 / (mass_kg * gas_constant));
            signals.flow_in_kg_s.push(inflow);
            signals.flow_out_kg_s.push(outflow);
        }
        let found = fitted(&signals, &plant, period_s).unwrap();
        for (found, expected) in found.iter().zip([alpha_in, alpha_out, alpha]) {
            assert!((found.value - expected).abs() < 5e-3, "{found:?}, {expected}");
            assert!(found.standard_error < 5e-3, "{found:?}");
        }
    }
}
