//! The full energy balance of the gas, eq. (3), with the inflow's own temperature.
//!
//! Mass m and internal energy U are the integrated states; T = U/(m cv) and P = (k-1) U/V follow,
//! so pressure and temperature stay continuous when a flow starts, stops or reverses.

use crate::math::CompensatedSum;
use crate::physics::gas::Gas;

/// Everything that acts on the gas during one step, as means over the step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exchange {
    /// Mass flow in \[kg/s\].
    pub inflow_kg_s: f32,
    /// Temperature of the gas that flows in \[K\].
    pub inflow_temperature_k: f32,
    /// Mass flow out \[kg/s\]; it leaves with the gas's own temperature.
    pub outflow_kg_s: f32,
    /// Conductance from gas to wall \[W/K\].
    pub wall_w_k: f32,
    /// Temperature of the wall \[K\].
    pub wall_temperature_k: f32,
    /// Volume at the start of the step \[m3\].
    pub volume_start_m3: f32,
    /// Volume at the end of the step \[m3\].
    pub volume_end_m3: f32,
}

/// Gas mass and internal energy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GasState {
    mass_kg: CompensatedSum,
    energy_j: CompensatedSum,
}

impl GasState {
    /// Gas at a pressure \[Pa\], temperature \[K\] and volume \[m3\].
    ///
    /// ```
    /// use model_core::physics::balance::GasState;
    /// use model_core::physics::gas::Gas;
    ///
    /// let state = GasState::new(&Gas::default(), 1.0e5, 300.0, 1.0e-3);
    /// assert!((state.mass_kg() * 287.05 * 300.0 / 100.0 - 1.0).abs() < 1.0e-5);
    /// ```
    pub fn new(gas: &Gas, pressure_pa: f32, temperature_k: f32, volume_m3: f32) -> Self {
        let mass = gas.mass_kg(pressure_pa, volume_m3, temperature_k);
        Self {
            mass_kg: CompensatedSum::new(mass),
            energy_j: CompensatedSum::new(mass * gas.cv_j_kg_k() * temperature_k),
        }
    }

    /// Gas mass \[kg\].
    pub fn mass_kg(&self) -> f32 {
        self.mass_kg.value()
    }

    /// Internal energy U = m cv T \[J\].
    pub fn energy_j(&self) -> f32 {
        self.energy_j.value()
    }

    /// Gas temperature T = U/(m cv) \[K\].
    pub fn temperature_k(&self, gas: &Gas) -> f32 {
        self.energy_j() / (self.mass_kg() * gas.cv_j_kg_k())
    }

    /// Absolute pressure P = (k-1) U/V \[Pa\].
    pub fn pressure_pa(&self, gas: &Gas, volume_m3: f32) -> f32 {
        (gas.heat_capacity_ratio - 1.0) * self.energy_j() / volume_m3
    }

    /// Advances by `step_s` with the midpoint rule (second order); returns the heat that passed to
    /// the wall \[J\].
    ///
    /// eq. (2): dm/dt = m_in - m_out.
    /// eq. (3): dU/dt = -h A (T - T_w) + cp (m_in T_in - m_out T) - P dV/dt, with k cv = cp.
    pub fn step(&mut self, gas: &Gas, exchange: &Exchange, step_s: f32) -> f32 {
        let cv = gas.cv_j_kg_k();
        let cp = gas.cp_j_kg_k();
        let volume_change = exchange.volume_end_m3 - exchange.volume_start_m3;
        let net_flow = exchange.inflow_kg_s - exchange.outflow_kg_s;
        let energy_change = |mass: f32, energy: f32, volume: f32| {
            let temperature = energy / (mass * cv);
            let pressure = (gas.heat_capacity_ratio - 1.0) * energy / volume;
            let heat = exchange.wall_w_k * (temperature - exchange.wall_temperature_k) * step_s;
            let enthalpy = cp
                * (exchange.inflow_kg_s * exchange.inflow_temperature_k
                    - exchange.outflow_kg_s * temperature)
                * step_s;
            (enthalpy - heat - pressure * volume_change, heat)
        };
        let mass = self.mass_kg();
        let energy = self.energy_j();
        let (start, _) = energy_change(mass, energy, exchange.volume_start_m3);
        let (middle, heat) = energy_change(
            mass + 0.5 * net_flow * step_s,
            energy + 0.5 * start,
            exchange.volume_start_m3 + 0.5 * volume_change,
        );
        self.mass_kg.add(net_flow * step_s);
        self.energy_j.add(middle);
        heat
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const STEP_S: f32 = 0.001;

    fn closed(volume: f32) -> Exchange {
        Exchange {
            inflow_kg_s: 0.0,
            inflow_temperature_k: 298.0,
            outflow_kg_s: 0.0,
            wall_w_k: 0.0,
            wall_temperature_k: 298.0,
            volume_start_m3: volume,
            volume_end_m3: volume,
        }
    }

    proptest! {
        /// Adiabatic discharge through a choked restriction, m_out = c P/sqrt(T):
        /// T/T0 = (1 + (k-1)/2 t/tau)^-2 with tau = m0/m_out(0).
        #[test]
        fn adiabatic_discharge(p0 in 2.0e5_f32..9.0e5, t0 in 260.0_f32..340.0, tau in 1.0_f32..30.0) {
            let gas = Gas::default();
            let volume = 2.0e-4;
            let mut state = GasState::new(&gas, p0, t0, volume);
            let m0 = f64::from(state.mass_kg());
            let choked = m0 as f32 / tau / (p0 / crate::math::sqrt(t0));
            let mut exchange = closed(volume);
            let flow = |p: f32, t: f32| choked * p / crate::math::sqrt(t);
            let steps = 2000;
            for _ in 0..steps {
                // Flow at the middle of the step, from a half step at the present flow.
                let mut half = state;
                exchange.outflow_kg_s =
                    flow(state.pressure_pa(&gas, volume), state.temperature_k(&gas));
                half.step(&gas, &exchange, 0.5 * STEP_S);
                exchange.outflow_kg_s =
                    flow(half.pressure_pa(&gas, volume), half.temperature_k(&gas));
                state.step(&gas, &exchange, STEP_S);
            }
            let time = f64::from(steps) * f64::from(STEP_S);
            let base = 1.0 + 0.2 * time / f64::from(tau);
            let t = f64::from(t0) * base.powi(-2);
            let p = f64::from(p0) * base.powf(-7.0);
            prop_assert!((f64::from(state.temperature_k(&gas)) / t - 1.0).abs() < 1e-4);
            prop_assert!((f64::from(state.pressure_pa(&gas, volume)) / p - 1.0).abs() < 1e-4);
        }

        /// Adiabatic filling: U grows by cp T_in per mass; an evacuated vessel tends to k T_in.
        #[test]
        fn adiabatic_filling(flow in 1.0e-4_f32..2.0e-3, t_in in 270.0_f32..320.0) {
            let gas = Gas::default();
            let volume = 2.0e-4;
            let mut state = GasState::new(&gas, 1.0e5, 298.0, volume);
            let (m0, u0) = (f64::from(state.mass_kg()), f64::from(state.energy_j()));
            let exchange = Exchange {
                inflow_kg_s: flow, inflow_temperature_k: t_in, ..closed(volume)
            };
            for _ in 0..1000 {
                state.step(&gas, &exchange, STEP_S);
            }
            let added = f64::from(flow);
            let u = u0 + f64::from(gas.cp_j_kg_k()) * added * f64::from(t_in);
            let t = u / (f64::from(gas.cv_j_kg_k()) * (m0 + added));
            prop_assert!((f64::from(state.temperature_k(&gas)) / t - 1.0).abs() < 1e-4);
        }

        /// Closed and adiabatic: P V^k is constant; with a wall of infinite conductance: P V.
        #[test]
        fn closed_compression(ratio in 0.3_f32..2.0, isothermal in any::<bool>()) {
            let gas = Gas::default();
            let v0 = 2.0e-4;
            let mut state = GasState::new(&gas, 2.0e5, 298.0, v0);
            let steps = 4000;
            for i in 0..steps {
                let at = |i: i32| v0 * (1.0 + (ratio - 1.0) * i as f32 / steps as f32);
                let exchange = Exchange {
                    volume_start_m3: at(i),
                    volume_end_m3: at(i + 1),
                    wall_w_k: if isothermal { 150.0 } else { 0.0 },
                    ..closed(v0)
                };
                state.step(&gas, &exchange, STEP_S);
            }
            let exponent = if isothermal { 1.0 } else { 1.4 };
            let p = 2.0e5 * f64::from(ratio).powf(-exponent);
            let pressure = f64::from(state.pressure_pa(&gas, v0 * ratio));
            // 150 W/K is not infinite: the compression power of some 10 W leaves 0.1 K.
            let bound = if isothermal { 1e-3 } else { 1e-4 };
            prop_assert!((pressure / p - 1.0).abs() < bound, "{pressure} for {p}");
        }
    }

    /// 10^7 steps that cancel in pairs: nothing may drift.
    #[test]
    fn ten_million_steps_do_not_drift() {
        let gas = Gas::default();
        let volume = 2.0e-4;
        let mut state = GasState::new(&gas, 2.0e5, 298.0, volume);
        let start = state.mass_kg();
        let inflow = Exchange { inflow_kg_s: 3.6e-4, wall_w_k: 1.0, ..closed(volume) };
        let outflow = Exchange { outflow_kg_s: 3.6e-4, wall_w_k: 1.0, ..closed(volume) };
        for i in 0..10_000_000 {
            state.step(&gas, if i % 2 == 0 { &inflow } else { &outflow }, STEP_S);
        }
        assert!((state.mass_kg() / start - 1.0).abs() < 1e-6, "{} {start}", state.mass_kg());
        assert!((state.temperature_k(&gas) - 298.0).abs() < 0.1);
    }
}
