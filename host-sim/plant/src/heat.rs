//! Heat transfer from gas to wall.

use super::flow::Iso6358;
use super::gas::{IdealGas, air_conductivity, air_viscosity};
use std::f64::consts::PI;
use thermyo_compute::math;
use thermyo_scenario::{DriveKind, Heat, HeatModel, PlantKind, PlantModel, Scenario};

/// Acceleration of gravity, which drives natural convection \[m/s2\].
const GRAVITY: f64 = 9.81;

/// So far from each other gas and wall hardly come; natural convection grows with it \[K\].
pub const WALL_BELOW_GAS_K: f64 = 100.0;

/// Why steps would have to be too short, where it is heat that is fast.
pub const HEAT_TOO_LARGE: &str = "heat.scale, heat.inner_w_m2_k or heat.inner_per_flow is too large for the heat capacity of gas and wall";

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
    /// From `[heat]`; the diameters of vessel and of what the gas comes through \[m\] matter for the correlation only.
    fn new(heat: &Heat, gas: &IdealGas, diameter_m: f64, path_diameter_m: f64) -> Self {
        let jet_diameter_m = heat.inlet_diameter_m.unwrap_or(path_diameter_m);
        let law = match heat.model {
            HeatModel::Adiabatic | HeatModel::Isothermal => Law::None,
            HeatModel::Constant => {
                Law::Constant { still: heat.inner_w_m2_k, per_flow: heat.inner_per_flow }
            }
            HeatModel::Correlation => Law::Correlation { diameter_m, jet_diameter_m, gas: *gas },
        };
        Self { law, scale: heat.scale }
    }

    /// That of a scenario's plant, whose vessel or muscle has that diameter \[m\].
    pub fn of(scenario: &Scenario, diameter_m: f64) -> Self {
        let gas = IdealGas::new(&scenario.gas);
        let ratio = scenario.valve.critical_ratio;
        let path = match (scenario.plant.kind, scenario.plant.model, scenario.drive.kind) {
            (PlantKind::Vessel, _, DriveKind::Closed | DriveKind::Discharge | DriveKind::Fill) => {
                let orifice_m = scenario.orifice.diameter_m;
                return Self::new(&scenario.heat, &gas, diameter_m, orifice_m);
            }
            (kind, PlantModel::Full, _) if kind != PlantKind::Vessel => {
                Iso6358::port(&scenario.tube, ratio, &gas)
            }
            _ => Iso6358::valve(scenario.valve.conductance_m3_s_pa, ratio, &gas),
        };
        Self::new(&scenario.heat, &gas, diameter_m, path.equivalent_diameter(&gas))
    }

    /// Coefficient of still gas \[W/(m2 K)\] and what it gains per inflow \[W/(m2 K) per kg/s\], about
    /// a working point: pressure \[Pa\], gas and wall temperature \[K\], inflow \[kg/s\].
    pub fn linearised(&self, pressure: f64, gas_k: f64, wall_k: f64, inflow: f64) -> (f64, f64) {
        let at = |inflow| self.coefficient(pressure, gas_k, wall_k, inflow);
        (at(0.0), (at(inflow) - at(0.0)) / inflow)
    }

    /// Fastest rate \[1/s\] at which gas in that volume \[m3\], at that pressure \[Pa\] and temperature \[K\], follows its
    /// wall of that surface \[m2\], for the largest inflow \[kg/s\].
    pub fn fastest_rate(
        &self,
        gas: &IdealGas,
        (pressure, gas_k): (f64, f64),
        (volume, surface): (f64, f64),
        inflow: f64,
    ) -> f64 {
        let conductance =
            surface * self.coefficient(pressure, gas_k, gas_k - WALL_BELOW_GAS_K, inflow);
        conductance * gas.r * gas_k / (gas.cv * pressure * volume)
    }

    /// Coefficient \[W/(m2 K)\] at that pressure \[Pa\], gas and wall temperature \[K\], inflow \[kg/s\].
    pub fn coefficient(&self, pressure: f64, gas_k: f64, wall_k: f64, inflow: f64) -> f64 {
        let coefficient = match self.law {
            Law::None => 0.0,
            Law::Constant { still, per_flow } => still + per_flow * inflow,
            Law::Correlation { diameter_m, jet_diameter_m, gas } => {
                let film = 0.5 * (gas_k + wall_k);
                let (viscosity, conductivity) = (air_viscosity(film), air_conductivity(film));
                let density_per_viscosity = pressure / (gas.r * film) / viscosity;
                let prandtl = gas.cp * viscosity / conductivity;
                let grashof = GRAVITY / film
                    * (gas_k - wall_k).abs()
                    * (diameter_m * diameter_m * diameter_m)
                    * (density_per_viscosity * density_per_viscosity);
                let reynolds = 4.0 * inflow / (PI * jet_diameter_m * viscosity);
                let nusselt =
                    0.56 * math::pow(reynolds, 0.67) + 0.104 * math::pow(grashof * prandtl, 0.352);
                nusselt * conductivity / diameter_m
            }
        };
        self.scale * coefficient
    }
}
