//! The ideal gas of eq. (1), and the transport properties of air.

/// An ideal gas with constant heat capacities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdealGas {
    /// Specific gas constant R \[J/(kg K)\].
    pub r: f64,
    /// Heat-capacity ratio k \[-\].
    pub k: f64,
    /// Specific heat at constant volume, R/(k-1) \[J/(kg K)\].
    pub cv: f64,
    /// Specific heat at constant pressure, k R/(k-1) \[J/(kg K)\].
    pub cp: f64,
}

impl IdealGas {
    pub fn new(gas: &thermyo_scenario::Gas) -> Self {
        let (r, k) = (gas.gas_constant_j_kg_k, gas.heat_capacity_ratio);
        let cv = r / (k - 1.0);
        Self { r, k, cv, cp: k * cv }
    }
}

/// Dynamic viscosity of air \[Pa s\], Sutherland's law (White, Viscous Fluid Flow, table 1-2).
pub fn air_viscosity(temperature_k: f64) -> f64 {
    sutherland(temperature_k, 1.716e-5, 111.0)
}

/// Thermal conductivity of air \[W/(m K)\], Sutherland's law (White, table 1-3).
pub fn air_conductivity(temperature_k: f64) -> f64 {
    sutherland(temperature_k, 0.0241, 194.0)
}

fn sutherland(temperature_k: f64, at_273_k: f64, constant_k: f64) -> f64 {
    let ratio = temperature_k / 273.0;
    at_273_k * ratio * ratio.sqrt() * (273.0 + constant_k) / (temperature_k + constant_k)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn air_at_300_k_matches_the_tables() {
        // Incropera, table A.4: 184.6e-7 Pa s and 26.3e-3 W/(m K).
        assert!((air_viscosity(300.0) / 184.6e-7 - 1.0).abs() < 0.01);
        assert!((air_conductivity(300.0) / 26.3e-3 - 1.0).abs() < 0.01);
    }
}
