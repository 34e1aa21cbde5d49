//! How the energy equation is closed: full balance, constant temperature, or the paper's eq. (9).
//!
//! Beside the mass m the plants integrate w = P V^e, with the exponent e chosen so that the
//! rate of change of the volume drops out of dw/dt. Kinks in V(t), from a piecewise-linear piston
//! or from stick and slip, then cost no accuracy, and a closed adiabatic compression is exact:
//!
//! - full balance, eq. (3), (4) with e = k:
//!   dw/dt = (k-1) V^(k-1) (cp (m_in T_in - m_out T) - Q)
//! - constant temperature, eq. (8) with e = 1: dw/dt = R T (m_in - m_out)
//! - the paper's blend, eq. (9) with e = a: dw/dt = V^(a-1) R T (a_in m_in - a_out m_out)

use super::Truth;
use super::flow::Streams;
use super::gas::IdealGas;
use thermyo_compute::math;
use thermyo_scenario::{HeatModel, Paper, PlantModel, Scenario};

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Balance,
    Isothermal { temperature_k: f64 },
    Paper(Blend),
}

/// Coefficients of eq. (9).
#[derive(Debug, Clone, Copy, PartialEq)]
struct Blend {
    charging: f64,
    discharging: f64,
    volume: f64,
}

/// The gas and its energy equation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closure {
    pub gas: IdealGas,
    kind: Kind,
}

impl Closure {
    /// The closure that a scenario asks for. The coefficients of eq. (9) stand for the heat
    /// transfer, so that `plant.model = "paper"` overrides `heat.model`.
    pub fn new(scenario: &Scenario) -> Self {
        let kind = match (scenario.plant.model, scenario.heat.model) {
            (PlantModel::Paper, _) => {
                let Paper { alpha_in, alpha_out, alpha } = scenario.paper;
                Kind::Paper(Blend { charging: alpha_in, discharging: alpha_out, volume: alpha })
            }
            (_, HeatModel::Isothermal) => {
                Kind::Isothermal { temperature_k: scenario.plant.gas_k() }
            }
            _ => Kind::Balance,
        };
        Self { gas: IdealGas::new(&scenario.gas), kind }
    }

    /// The exponent e of w = P V^e.
    pub fn exponent(&self) -> f64 {
        match self.kind {
            Kind::Balance => self.gas.k,
            Kind::Isothermal { .. } => 1.0,
            Kind::Paper(blend) => blend.volume,
        }
    }

    /// Whether the gas keeps its initial temperature.
    pub fn is_isothermal(&self) -> bool {
        matches!(self.kind, Kind::Isothermal { .. })
    }

    /// Gas temperature \[K\] at P \[Pa\], V \[m3\], m \[kg\], eq. (1).
    pub fn temperature(&self, pressure: f64, volume: f64, mass: f64) -> f64 {
        match self.kind {
            Kind::Isothermal { temperature_k } => temperature_k,
            _ => pressure * volume / (mass * self.gas.r),
        }
    }

    /// dw/dt, for V^(e-1), gas temperature T \[K\] and convective heat to the wall \[W\].
    pub fn rate(&self, volume_power: f64, streams: &Streams, temperature: f64, heat: f64) -> f64 {
        let gas = &self.gas;
        match self.kind {
            Kind::Balance => {
                (gas.k - 1.0)
                    * volume_power
                    * (gas.cp * streams.net_enthalpy_over_cp(temperature) - heat)
            }
            Kind::Isothermal { temperature_k } => gas.r * temperature_k * streams.net(),
            Kind::Paper(blend) => {
                let flow = blend.charging * streams.inflow - blend.discharging * streams.outflow;
                volume_power * gas.r * temperature * flow
            }
        }
    }

    /// Heat to the wall \[W\] without the part that is proportional to the work, see [`Self::heat_per_work`]. Eq. (3)
    /// solved for the heat, with the closure's own dU/dt.
    pub fn heat_of_streams(&self, streams: &Streams, temperature: f64, heat: f64) -> f64 {
        let gas = &self.gas;
        let enthalpy = gas.cp * streams.net_enthalpy_over_cp(temperature);
        match self.kind {
            Kind::Balance => heat,
            Kind::Isothermal { temperature_k } => enthalpy - gas.cv * temperature_k * streams.net(),
            Kind::Paper(blend) => {
                let flow = blend.charging * streams.inflow - blend.discharging * streams.outflow;
                enthalpy - gas.cv * temperature * flow
            }
        }
    }

    /// Work of the gas \[J\] from one pressure \[Pa\] and volume \[m3\] to another at constant w = P V^e: the integral
    /// of P dV.
    pub fn work(&self, before_pa: f64, before_m3: f64, after_pa: f64, after_m3: f64) -> f64 {
        let exponent = self.exponent();
        if exponent == 1.0 {
            return before_pa * before_m3 * math::log(after_m3 / before_m3);
        }
        (before_pa * before_m3 - after_pa * after_m3) / (exponent - 1.0)
    }

    /// Internal energy P V/(k-1) \[J\], eq. (4).
    pub fn internal_energy(&self, truth: &Truth) -> f64 {
        truth.pressure_pa * truth.volume_m3 / (self.gas.k - 1.0)
    }

    /// Heat to the wall per work of the gas \[-\]: eq. (7) for constant temperature.
    pub fn heat_per_work(&self) -> f64 {
        match self.kind {
            Kind::Balance => 0.0,
            Kind::Isothermal { .. } => -1.0,
            Kind::Paper(blend) => (blend.volume - 1.0) / (self.gas.k - 1.0) - 1.0,
        }
    }
}
