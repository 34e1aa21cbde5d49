//! The ideal gas and the paper's reduced pressure equations.
//!
//! Paper: L. Kopecny, L. Zalud, "Sensors for Evaluation of Thermodynamical Model of pMA", 2013.
//! Equation numbers are the paper's throughout the crate.

use crate::parameter::parameters;

parameters! {
    /// Ideal gas with constant heat capacities; dry air by default.
    "gas": Gas {
        gas_constant_j_kg_k: 287.05, "J/(kg K)", 50.0 to 5000.0, "specific gas constant R";
        heat_capacity_ratio: 1.4, "", 1.01 to 1.7, "ratio of specific heats k = cp/cv";
    }
}

/// Gas at rest in a large volume.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reservoir {
    /// Absolute pressure \[Pa\].
    pub pressure_pa: f32,
    /// Temperature \[K\].
    pub temperature_k: f32,
}

impl Gas {
    /// Heat capacity at constant volume, cv = R/(k-1) \[J/(kg K)\].
    pub fn cv_j_kg_k(&self) -> f32 {
        self.gas_constant_j_kg_k / (self.heat_capacity_ratio - 1.0)
    }

    /// Heat capacity at constant pressure, cp = k R/(k-1) \[J/(kg K)\].
    pub fn cp_j_kg_k(&self) -> f32 {
        self.heat_capacity_ratio * self.cv_j_kg_k()
    }

    /// Gas mass \[kg\], eq. (1): m = P V/(R T).
    pub fn mass_kg(&self, pressure_pa: f32, volume_m3: f32, temperature_k: f32) -> f32 {
        pressure_pa * volume_m3 / (self.gas_constant_j_kg_k * temperature_k)
    }

    /// Absolute pressure \[Pa\], eq. (1): P = m R T/V.
    pub fn pressure_pa(&self, mass_kg: f32, volume_m3: f32, temperature_k: f32) -> f32 {
        mass_kg * self.gas_constant_j_kg_k * temperature_k / volume_m3
    }

    /// Temperature \[K\], eq. (1): T = P V/(m R).
    pub fn temperature_k(&self, pressure_pa: f32, volume_m3: f32, mass_kg: f32) -> f32 {
        pressure_pa * volume_m3 / (mass_kg * self.gas_constant_j_kg_k)
    }
}

/// State of the gas volume at one instant, for the reduced equations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GasVolume {
    /// Absolute pressure P \[Pa\].
    pub pressure_pa: f32,
    /// Gas temperature T \[K\].
    pub temperature_k: f32,
    /// Volume V \[m3\].
    pub volume_m3: f32,
    /// dV/dt \[m3/s\].
    pub volume_rate_m3_s: f32,
    /// Mass flow in \[kg/s\].
    pub inflow_kg_s: f32,
    /// Mass flow out \[kg/s\].
    pub outflow_kg_s: f32,
}

/// The coefficients of eq. (9), each between 1 (isothermal) and k (adiabatic).
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Blend {
    /// Charging.
    pub alpha_in: f32,
    /// Discharging.
    pub alpha_out: f32,
    /// Change of volume.
    pub alpha: f32,
}

/// dP/dt \[Pa/s\] of the adiabatic chamber, eq. (6). Assumes that the inflow has the chamber's
/// temperature; [`crate::physics::balance`] does not.
pub fn pressure_rate_adiabatic(gas: &Gas, chamber: &GasVolume) -> f32 {
    let k = gas.heat_capacity_ratio;
    pressure_rate_blended(gas, chamber, &Blend { alpha_in: k, alpha_out: k, alpha: k })
}

/// dP/dt \[Pa/s\] of the isothermal chamber, eq. (8).
pub fn pressure_rate_isothermal(gas: &Gas, chamber: &GasVolume) -> f32 {
    pressure_rate_blended(gas, chamber, &Blend { alpha_in: 1.0, alpha_out: 1.0, alpha: 1.0 })
}

/// dP/dt \[Pa/s\], eq. (9): R T/V (a_in m_in - a_out m_out) - a P/V dV/dt. With the volume of a
/// muscle (eq. 10, 11 in [`crate::physics::chamber::braid`]) this is eq. (12).
pub fn pressure_rate_blended(gas: &Gas, chamber: &GasVolume, blend: &Blend) -> f32 {
    let flow = blend.alpha_in * chamber.inflow_kg_s - blend.alpha_out * chamber.outflow_kg_s;
    (gas.gas_constant_j_kg_k * chamber.temperature_k * flow
        - blend.alpha * chamber.pressure_pa * chamber.volume_rate_m3_s)
        / chamber.volume_m3
}

/// Heat flow into the gas \[W\] that keeps it isothermal, eq. (7):
/// q_in - q_out = P dV/dt - (P/rho)(m_in - m_out), with P/rho = R T.
pub fn isothermal_heat_w(gas: &Gas, chamber: &GasVolume) -> f32 {
    chamber.pressure_pa * chamber.volume_rate_m3_s
        - gas.gas_constant_j_kg_k
            * chamber.temperature_k
            * (chamber.inflow_kg_s - chamber.outflow_kg_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Integrates a reduced equation with the midpoint rule, mass along with pressure; the flow and
    /// dV/dt are functions of the state. Returns pressure and temperature after `steps` of 1 ms.
    fn integrate(
        rate: fn(&Gas, &GasVolume) -> f32,
        mut chamber: GasVolume,
        steps: u32,
        outflow: impl Fn(&GasVolume) -> f32,
    ) -> GasVolume {
        let gas = Gas::default();
        let step_s = 1.0e-3;
        let advance = |from: &GasVolume, at: &GasVolume, step_s: f32| {
            let mass = gas.mass_kg(from.pressure_pa, from.volume_m3, from.temperature_k);
            let pressure_pa = from.pressure_pa + rate(&gas, at) * step_s;
            let volume_m3 = from.volume_m3 + at.volume_rate_m3_s * step_s;
            let mass = mass - at.outflow_kg_s * step_s;
            let temperature_k = gas.temperature_k(pressure_pa, volume_m3, mass);
            let next = GasVolume { pressure_pa, temperature_k, volume_m3, ..*from };
            GasVolume { outflow_kg_s: outflow(&next), ..next }
        };
        chamber.outflow_kg_s = outflow(&chamber);
        for _ in 0..steps {
            let middle = advance(&chamber, &chamber, 0.5 * step_s);
            chamber = advance(&chamber, &middle, step_s);
        }
        chamber
    }

    const START: GasVolume = GasVolume {
        pressure_pa: 6.0e5,
        temperature_k: 300.0,
        volume_m3: 2.0e-4,
        volume_rate_m3_s: 0.0,
        inflow_kg_s: 0.0,
        outflow_kg_s: 0.0,
    };

    /// Choked discharge by eq. (8) and (6): P0 exp(-t/tau), and P0 (1 + (k-1)/2 t/tau)^(-2k/(k-1)).
    #[test]
    fn discharge_by_the_reduced_equations() {
        let tau = 2.0;
        let choked = Gas::default().mass_kg(6.0e5, 2.0e-4, 300.0) / tau / (6.0e5 / 300_f32.sqrt());
        let flow =
            |chamber: &GasVolume| choked * chamber.pressure_pa / chamber.temperature_k.sqrt();
        let isothermal = integrate(pressure_rate_isothermal, START, 2000, flow);
        assert!(
            (f64::from(isothermal.pressure_pa) / (6.0e5 * (-1.0_f64).exp()) - 1.0).abs() < 1e-4
        );
        assert!((isothermal.temperature_k / 300.0 - 1.0).abs() < 1e-4);
        let adiabatic = integrate(pressure_rate_adiabatic, START, 2000, flow);
        let base = 1.2_f64;
        assert!((f64::from(adiabatic.pressure_pa) / (6.0e5 * base.powi(-7)) - 1.0).abs() < 1e-4);
        assert!((f64::from(adiabatic.temperature_k) / (300.0 * base.powi(-2)) - 1.0).abs() < 1e-4);
    }

    /// Closed compression to half of the volume: P V is constant by eq. (8), P V^k by eq. (6).
    #[test]
    fn compression_by_the_reduced_equations() {
        let start = GasVolume { volume_rate_m3_s: -1.0e-4, ..START };
        for (rate, exponent) in [
            (pressure_rate_isothermal as fn(&Gas, &GasVolume) -> f32, 1.0),
            (pressure_rate_adiabatic as fn(&Gas, &GasVolume) -> f32, 1.4),
        ] {
            let end = integrate(rate, start, 1000, |_| 0.0);
            let ratio = f64::from(START.volume_m3) / f64::from(end.volume_m3);
            assert!((ratio - 2.0).abs() < 1e-4);
            let expected = 6.0e5 * ratio.powf(exponent);
            assert!((f64::from(end.pressure_pa) / expected - 1.0).abs() < 1e-4);
        }
    }

    proptest! {
        #[test]
        fn state_equation_is_its_own_inverse(
            p in 1.0e4_f32..2.0e6, v in 1.0e-6_f32..1.0, t in 150.0_f32..600.0
        ) {
            let gas = Gas::default();
            let m = gas.mass_kg(p, v, t);
            prop_assert!((gas.pressure_pa(m, v, t) / p - 1.0).abs() < 1e-6);
            prop_assert!((gas.temperature_k(p, v, m) / t - 1.0).abs() < 1e-6);
        }

        /// Eq. (5) holds for the heat of eq. (7) and the pressure rate of eq. (8), and for no heat
        /// with eq. (6).
        #[test]
        fn reduced_forms_satisfy_the_energy_equation(
            p in 1.0e5_f32..7.0e5, v in 5.0e-5_f32..5.0e-4, t in 220.0_f32..380.0,
            dv in -1.0e-3_f32..1.0e-3, inflow in 0.0_f32..3.0e-3, outflow in 0.0_f32..3.0e-3
        ) {
            let gas = Gas::default();
            let chamber = GasVolume {
                pressure_pa: p, temperature_k: t, volume_m3: v, volume_rate_m3_s: dv,
                inflow_kg_s: inflow, outflow_kg_s: outflow,
            };
            let k = gas.heat_capacity_ratio;
            let density = p / (gas.gas_constant_j_kg_k * t);
            let residual = |heat: f32, rate: f32| {
                (k - 1.0) / (k * p) * heat + (inflow - outflow) / density - dv - v / (k * p) * rate
            };
            let scale = inflow / density + outflow / density + dv.abs() + 1e-9;
            let isothermal =
                residual(isothermal_heat_w(&gas, &chamber), pressure_rate_isothermal(&gas, &chamber));
            let adiabatic = residual(0.0, pressure_rate_adiabatic(&gas, &chamber));
            prop_assert!(isothermal.abs() < 1e-5 * scale, "{isothermal} of {scale}");
            prop_assert!(adiabatic.abs() < 1e-5 * scale, "{adiabatic} of {scale}");
        }
    }
}
