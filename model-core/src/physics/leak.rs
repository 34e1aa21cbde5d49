//! Permanent leakage from the chamber to ambient, through fittings and bladder. It follows the law of the valves, ISO
//! 6358.

use crate::parameter::parameters;
use crate::physics::gas::{Gas, Reservoir};
use crate::physics::valve::Valve;

parameters! {
    /// Leakage of the chamber; `thermyo identify` finds it from a hold.
    "leak": Leak {
        conductance_m3_s_pa: 0.0, "m3/(s Pa)", 0.0 to 1.0e-3, "sonic conductance C at ANR (ISO 6358) from the gas to ambient; 0: nothing leaks";
        critical_ratio: 0.3, "", 0.01 to 0.99, "critical pressure ratio b";
    }
}

impl Leak {
    /// Whether there is a leak: without one nothing needs to be computed.
    pub fn leaks(&self) -> bool {
        self.conductance_m3_s_pa > 0.0
    }

    /// Mass flow \[kg/s\] from the gas in the chamber to ambient; negative if the gas is below ambient pressure.
    ///
    /// ```
    /// use model_core::physics::gas::{Gas, Reservoir};
    /// use model_core::physics::leak::Leak;
    ///
    /// let leak = Leak { conductance_m3_s_pa: 1.0e-11, ..Leak::default() };
    /// let muscle = Reservoir { pressure_pa: 5.0e5, temperature_k: 293.15 };
    /// let room = Reservoir { pressure_pa: 1.0e5, temperature_k: 293.15 };
    /// // 5e-6 m3/s of 1.188 kg/m3.
    /// let flow_kg_s = leak.mass_flow_kg_s(&Gas::default(), muscle, room);
    /// assert!((flow_kg_s / 5.942e-6 - 1.0).abs() < 1.0e-3);
    /// ```
    pub fn mass_flow_kg_s(&self, gas: &Gas, chamber: Reservoir, ambient: Reservoir) -> f32 {
        let path = Valve {
            conductance_m3_s_pa: self.conductance_m3_s_pa,
            critical_ratio: self.critical_ratio,
            switch_time_s: 0.0,
            dead_time_s: 0.0,
        };
        if chamber.pressure_pa < ambient.pressure_pa {
            -path.mass_flow_kg_s(gas, ambient, chamber.pressure_pa)
        } else {
            path.mass_flow_kg_s(gas, chamber, ambient.pressure_pa)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::balance::{Exchange, GasState};

    const AMBIENT_PA: f64 = 1.0e5;
    const ROOM: Reservoir = Reservoir { pressure_pa: AMBIENT_PA as f32, temperature_k: GAS_K };
    const GAS_K: f32 = 293.15;
    const VOLUME_M3: f32 = 2.0e-4;

    /// Time in units of V/(C rho0 R sqrt(T0 T)) in which gas that keeps its temperature falls towards ambient over x:
    /// ln(P0/P) down to x = b, from there on the integral of dx/(x phi(x)), with x = b + (1 - b) sin a.
    fn times(x: f64, x0: f64, b: f64) -> f64 {
        let root = (1.0 - 2.0 * b).sqrt();
        let primitive = |x: f64| {
            let half = (0.5 * ((x - b) / (1.0 - b)).asin()).tan();
            (1.0 - b) / root * ((b * half + 1.0 - b - root) / (b * half + 1.0 - b + root)).ln()
        };
        let choked = x.min(b) / x0.min(b);
        choked.ln() + primitive(x.max(b)) - primitive(x0.max(b))
    }

    #[test]
    fn a_leak_at_constant_temperature_falls_as_the_closed_form_says() {
        let leak = Leak { conductance_m3_s_pa: 2.0e-9, ..Leak::default() };
        let gas = Gas::default();
        let per_s = f64::from(leak.conductance_m3_s_pa) * 1.0e5 / f64::from(VOLUME_M3);
        // Choked throughout, through the critical ratio of 0.3, subsonic throughout.
        for (from_pa, to) in [(8.0e5_f32, 0.29), (5.0e5, 0.8), (2.0e5, 0.99)] {
            let mut state = GasState::new(&gas, from_pa, GAS_K, VOLUME_M3);
            let from = AMBIENT_PA / f64::from(from_pa);
            let seconds = times(to, from, 0.3) / per_s;
            let steps = 20_000;
            let step_s = (seconds / f64::from(steps)) as f32;
            let mut exchange = Exchange {
                inflow_kg_s: 0.0,
                inflow_temperature_k: GAS_K,
                outflow_kg_s: 0.0,
                // As fast as a step can take, for the gas that is left at the end.
                wall_w_k: state.mass_kg() * (from / to) as f32 * gas.cv_j_kg_k() / step_s,
                wall_temperature_k: GAS_K,
                volume_start_m3: VOLUME_M3,
                volume_end_m3: VOLUME_M3,
            };
            let flow_kg_s = |state: &GasState| {
                let pressure_pa = state.pressure_pa(&gas, VOLUME_M3);
                let chamber = Reservoir { pressure_pa, temperature_k: GAS_K };
                leak.mass_flow_kg_s(&gas, chamber, ROOM)
            };
            for _ in 0..steps {
                let mut half = state;
                exchange.outflow_kg_s = flow_kg_s(&state);
                half.step(&gas, &exchange, 0.5 * step_s);
                exchange.outflow_kg_s = flow_kg_s(&half);
                state.step(&gas, &exchange, step_s);
            }
            let found = AMBIENT_PA / f64::from(state.pressure_pa(&gas, VOLUME_M3));
            assert!((found / to - 1.0).abs() < 1e-4, "from {from_pa} Pa to {found}, not {to}");
        }
    }

    #[test]
    fn it_leaks_either_way_and_not_through_what_is_tight() {
        let gas = Gas::default();
        let chamber = |pressure_pa| Reservoir { pressure_pa, temperature_k: GAS_K };
        let leak = Leak { conductance_m3_s_pa: 1.0e-9, ..Leak::default() };
        let out = leak.mass_flow_kg_s(&gas, chamber(1.1e5), chamber(1.0e5));
        assert!(out > 0.0);
        assert_eq!(leak.mass_flow_kg_s(&gas, chamber(1.0e5), chamber(1.1e5)), -out);
        assert_eq!(Leak::default().mass_flow_kg_s(&gas, chamber(5.0e5), chamber(1.0e5)), 0.0);
    }
}
