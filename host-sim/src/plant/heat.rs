//! Heat transfer from gas to wall.

use super::gas::{IdealGas, air_conductivity, air_viscosity};
use crate::scenario::{Heat, HeatModel};
use std::f64::consts::PI;

/// Acceleration of gravity, which drives natural convection \[m/s2\].
const GRAVITY: f64 = 9.81;

/// Coefficient of heat transfer from gas to wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InnerHeat {
    law: Law,
    /// `heat.scale`.
    scale: f64,
}

/// What the coefficient follows.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Law {
    /// No heat passes.
    None,
    /// A constant, and a part that grows with inflow.
    Constant {
        /// Still gas \[W/(m2 K)\].
        still: f64,
        /// Gained per inflow \[W/(m2 K) per kg/s\].
        per_flow: f64,
    },
    /// Woodfield, Monde and Takano (J. Therm. Sci. Tech. 3, 2008): Nu = 0.56 Re_d^0.67 + 0.104 Ra_D^0.352,
    /// Re at the inlet jet, Nu and Ra on the vessel's diameter. Without inflow its second term,
    /// natural convection in a cylinder, remains; it is used for discharge too.
    Correlation {
        /// Inner diameter of the vessel or muscle D \[m\].
        diameter_m: f64,
        /// Diameter of the jet d \[m\].
        jet_diameter_m: f64,
        /// The gas.
        gas: IdealGas,
    },
}

impl InnerHeat {
    /// From `[heat]`; the diameters of vessel and jet \[m\] matter for the correlation only.
    pub fn new(heat: &Heat, gas: &IdealGas, diameter_m: f64, jet_diameter_m: f64) -> Self {
        let law = match heat.model {
            HeatModel::Adiabatic | HeatModel::Isothermal => Law::None,
            HeatModel::Constant => {
                Law::Constant { still: heat.inner_w_m2_k, per_flow: heat.inner_per_flow }
            }
            HeatModel::Correlation => Law::Correlation { diameter_m, jet_diameter_m, gas: *gas },
        };
        Self { law, scale: heat.scale }
    }

    /// Coefficient \[W/(m2 K)\] at that pressure \[Pa\], gas and wall temperature \[K\], inflow \[kg/s\].
    pub fn coefficient(&self, pressure: f64, gas_k: f64, wall_k: f64, inflow: f64) -> f64 {
        let coefficient = match self.law {
            Law::None => 0.0,
            Law::Constant { still, per_flow } => still + per_flow * inflow,
            Law::Correlation { diameter_m, jet_diameter_m, gas } => {
                let film = 0.5 * (gas_k + wall_k);
                let (viscosity, conductivity) = (air_viscosity(film), air_conductivity(film));
                let density = pressure / (gas.r * film);
                let prandtl = gas.cp * viscosity / conductivity;
                let grashof = GRAVITY / film
                    * (gas_k - wall_k).abs()
                    * diameter_m.powi(3)
                    * (density / viscosity).powi(2);
                let reynolds = 4.0 * inflow / (PI * jet_diameter_m * viscosity);
                let nusselt = 0.56 * reynolds.powf(0.67) + 0.104 * (grashof * prandtl).powf(0.352);
                nusselt * conductivity / diameter_m
            }
        };
        self.scale * coefficient
    }
}
