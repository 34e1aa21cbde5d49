//! Heat transfer from gas to wall.
//!
//! With the Nusselt number Nu = h D/lambda on the bore D, air in a cylinder gives off heat by
//!
//! ```text
//! still:   Nu^4 = 5.783^4 + Nu_n^4       conduction, or buoyancy where it is faster
//! stirred: Nu   = Nu_still + a_j 0.56 Re_j^0.67 + a_c 0.56 Re_c^0.67
//!          Re_j = 4 s_in/(pi d mu),  Re_c = 4 s_out/(pi D mu)
//!          ds/dt = (m - s)/tau        for either flow through the port
//! ```
//!
//! - 5.783 = j01^2: a cylinder that cools by conduction alone, once its profile has formed (law: the first root of J0).
//! - Nu_n is the larger of 0.48 Ra^(1/4) (laminar, Morgan, Adv. Heat Transfer 11, 1975, of horizontal cylinders from
//!   outside: assumed alike inside, where the same boundary layer runs down the same surface) and 0.104 Ra^0.352
//!   (turbulent, in closed vessels, the second term of Woodfield, Monde and Takano, J. Therm. Sci. Tech. 3, 2008). They
//!   meet at Ra = 3.2e6. Both are joined to conduction as Churchill and Usagi join asymptotes (AIChE J. 18, 1972).
//! - 0.56 Re_j^0.67 is Woodfield's first term, measured while vessels fill through a nozzle of diameter d. Since u d is
//!   the root of the jet's momentum over the density, Re_j is also the Reynolds number of what circulates across the
//!   bore. An outlet draws gas from all sides and sends no jet: what moves is the column in the bore, with Re_c. That it
//!   stirs by the same law is an assumption.
//! - a_j and a_c are the zone's shares: [`super::zones::Stirring`].
//! - tau, `heat.stirring_decay_s`, is how long stirring outlasts the flow. It is chosen so that pulses into and out of
//!   muscles relax as measured (`tests/plant_air.rs`).
//!
//! Flows and laws change slowly compared with an integration step: they are evaluated once per [`REFRESH_S`].

use super::flow::Iso6358;
use super::gas::{IdealGas, air_conductivity, air_viscosity};
use super::radial::{Conduction, Place, Profile};
use super::zones::{Shares, Stirring};
use std::f64::consts::PI;
use thermyo_compute::math;
use thermyo_scenario::{DriveKind, Heat, HeatModel, PlantKind, Scenario, Valve};

/// Longest time for which films and stirring flows are kept \[s\]; sound takes as long through the muscle.
pub const REFRESH_S: f64 = 1.0e-3;

/// Acceleration of gravity, which drives natural convection \[m/s2\].
const GRAVITY: f64 = 9.81;
/// Nusselt number of conduction in a cylinder: the square of J0's first root.
const CONDUCTION: f64 = 5.783_186;
/// Laminar natural convection, times Ra^(1/4).
const LAMINAR: f64 = 0.48;
/// Turbulent natural convection: its factor and its power of Ra, and where it exceeds the laminar one.
const TURBULENT: [f64; 2] = [0.104, 0.352];
const TURBULENT_RAYLEIGH: f64 = 3.2e6;
/// Forced convection: its factor and its power of Re.
const FORCED: [f64; 2] = [0.56, 0.67];

/// Temperature difference between gas and wall that is hardly reached \[K\]; natural convection grows with it.
pub const WALL_BELOW_GAS_K: f64 = 100.0;

/// Reason for a step that would be too short, where heat is what is fast.
pub const HEAT_TOO_LARGE: &str = "heat.scale, heat.inner_w_m2_k or heat.inner_per_flow is too large for the heat capacity of gas and wall";

/// Diameter of the jet where `heat.inlet_diameter_m` is left out \[m\]: the opening through which the gas enters.
pub fn inlet_diameter_m(scenario: &Scenario) -> f64 {
    let gas = IdealGas::new(&scenario.gas);
    let Valve { conductance_m3_s_pa, critical_ratio, .. } = scenario.valve;
    let through_orifice = [DriveKind::Closed, DriveKind::Discharge, DriveKind::Fill];
    let path = match scenario.plant.kind {
        PlantKind::Vessel if through_orifice.contains(&scenario.drive.kind) => {
            return scenario.orifice.diameter_m;
        }
        PlantKind::Vessel => Iso6358::valve(conductance_m3_s_pa, critical_ratio, &gas),
        _ => Iso6358::port(&scenario.tube, critical_ratio, &gas),
    };
    path.equivalent_diameter(&gas)
}

/// Coefficient of heat transfer from gas to wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InnerHeat {
    law: Law,
    scale: f64,
    stirring_decay_s: f64,
    /// Shares where the gas is one zone.
    whole: Shares,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Law {
    /// No heat passes.
    None,
    /// A constant, and a part that grows with inflow.
    Constant {
        /// Still gas \[W/(m2 K)\].
        still: f64,
        /// Added per inflow \[W/(m2 K) per kg/s\].
        per_flow: f64,
    },
    /// The laws at the head of this module.
    Correlation(Air),
}

/// Air in a cylinder.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Air {
    /// Diameter of vessel or muscle D \[m\].
    diameter_m: f64,
    jet_diameter_m: f64,
    gas: IdealGas,
}

/// Coefficient of heat transfer while it is kept: `still_w_m2_k + per_inflow * inflow`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Film {
    /// Without inflow \[W/(m2 K)\].
    pub still_w_m2_k: f64,
    /// Added per inflow \[W/(m2 K) per kg/s\].
    pub per_inflow: f64,
    /// Heat flux at no difference to the wall \[W/m2\], which the gas's radial profile causes.
    pub profile_w_m2: f64,
}

impl Film {
    /// Coefficient \[W/(m2 K)\] at this inflow \[kg/s\].
    #[inline]
    pub fn coefficient(&self, inflow: f64) -> f64 {
        self.still_w_m2_k + self.per_inflow * inflow
    }

    /// Heat flux \[W/m2\] from gas that is `above_wall_k` warmer than its wall \[K\].
    #[inline]
    pub fn flux(&self, inflow: f64, above_wall_k: f64) -> f64 {
        self.coefficient(inflow) * above_wall_k + self.profile_w_m2
    }
}

/// A zone's gas while its film is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    pub film: Film,
    pub profile: Profile,
    /// Conduction until the next refresh, if the profile matters.
    conduction: Option<Conduction>,
    /// Share of conduction in the heat that passes: stirring makes the profile flat.
    still_share: f64,
}

impl Section {
    /// Section of this film, with an even profile.
    pub fn flat(film: Film) -> Self {
        Self { film, profile: Profile::default(), conduction: None, still_share: 0.0 }
    }

    /// How much warmer than the mean \[K\] the gas is at a place; the mean is `above_wall_k` above the wall \[K\].
    pub fn above_mean(&self, place: &Place, above_wall_k: f64) -> f64 {
        self.still_share * place.above_mean(&self.profile, above_wall_k)
    }
}

/// Flows through the port, as the gas still feels them \[kg/s\].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stirred {
    pub inflow: f64,
    pub outflow: f64,
}

/// Nusselt numbers of forced convection in a zone whose share is 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Forced {
    jet: f64,
    column: f64,
}

/// Heat transfer linearised about a working point, for the core's configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linearised {
    /// Coefficient of still gas \[W/(m2 K)\].
    pub still_w_m2_k: f64,
    /// Added per lasting inflow and per lasting outflow \[W/(m2 K) per kg/s\].
    pub per_inflow: f64,
    pub per_outflow: f64,
}

impl Forced {
    /// Nusselt number in a zone of these shares.
    fn in_zone(&self, shares: &Shares) -> f64 {
        shares.jet * self.jet + shares.column * self.column
    }
}

impl InnerHeat {
    /// Heat transfer of `[heat]`; the diameters \[m\] of the vessel and of the opening for the gas matter only for the
    /// correlation.
    fn new(
        heat: &Heat,
        gas: &IdealGas,
        diameter_m: f64,
        path_diameter_m: f64,
        whole: Shares,
    ) -> Self {
        let jet_diameter_m = heat.inlet_diameter_m.unwrap_or(path_diameter_m);
        let law = match heat.model {
            HeatModel::Adiabatic | HeatModel::Isothermal => Law::None,
            HeatModel::Constant => {
                Law::Constant { still: heat.inner_w_m2_k, per_flow: heat.inner_per_flow }
            }
            HeatModel::Correlation => {
                Law::Correlation(Air { diameter_m, jet_diameter_m, gas: *gas })
            }
        };
        Self { law, scale: heat.scale, stirring_decay_s: heat.stirring_decay_s, whole }
    }

    /// Heat transfer of a scenario's moving chamber, whose gas has this diameter and length \[m\].
    pub fn of_chamber(scenario: &Scenario, diameter_m: f64, length_m: f64) -> Self {
        let gas = IdealGas::new(&scenario.gas);
        let whole = Stirring::new(1, length_m, diameter_m).zones()[0];
        Self::new(&scenario.heat, &gas, diameter_m, inlet_diameter_m(scenario), whole)
    }

    /// Heat transfer of a scenario's vessel.
    pub fn of_vessel(scenario: &Scenario) -> Self {
        let gas = IdealGas::new(&scenario.gas);
        let diameter_m = scenario.vessel.characteristic_length_m;
        let path_m = inlet_diameter_m(scenario);
        Self::new(&scenario.heat, &gas, diameter_m, path_m, Shares::VESSEL)
    }

    /// Shares of gas that forms one zone.
    pub fn whole(&self) -> &Shares {
        &self.whole
    }

    /// Linearises about a working point: pressure \[Pa\], gas and wall temperature \[K\], flow \[kg/s\], for gas of one
    /// zone.
    pub fn linearised(&self, pressure: f64, gas_k: f64, wall_k: f64, flow: f64) -> Linearised {
        let at = |inflow, outflow| {
            let forced = self.forced(&Stirred { inflow, outflow }, gas_k);
            self.film(pressure, gas_k, wall_k, &forced, &self.whole).coefficient(inflow)
        };
        let still_w_m2_k = at(0.0, 0.0);
        Linearised {
            still_w_m2_k,
            per_inflow: (at(flow, 0.0) - still_w_m2_k) / flow,
            per_outflow: (at(0.0, flow) - still_w_m2_k) / flow,
        }
    }

    /// Fastest rate \[1/s\] at which the gas follows its wall, for a volume \[m3\], a surface \[m2\], pressure \[Pa\],
    /// temperature \[K\] and the largest inflow \[kg/s\].
    pub fn fastest_rate(
        &self,
        gas: &IdealGas,
        (pressure, gas_k): (f64, f64),
        (volume, surface): (f64, f64),
        (inflow, shares): (f64, &Shares),
    ) -> f64 {
        let conductance = surface * self.largest(pressure, gas_k, inflow, shares);
        conductance * gas.r * gas_k / (gas.cv * pressure * volume)
    }

    /// Largest coefficient \[W/(m2 K)\] at this pressure \[Pa\] and gas temperature \[K\], for a flow either way
    /// \[kg/s\].
    pub fn largest(&self, pressure: f64, gas_k: f64, flow: f64, shares: &Shares) -> f64 {
        let forced = self.forced(&Stirred { inflow: flow, outflow: flow }, gas_k);
        self.film(pressure, gas_k, gas_k - WALL_BELOW_GAS_K, &forced, shares).coefficient(flow)
    }

    /// Stirring after `step_s` \[s\] with these mean flows \[kg/s\]; a constant coefficient has none.
    pub fn stirred(&self, stirred: &Stirred, flows: (f64, f64), step_s: f64) -> Stirred {
        if !matches!(self.law, Law::Correlation(_)) {
            return Stirred::default();
        }
        let steps = step_s / self.stirring_decay_s;
        // e^-x to its second order, and still below 1 for steps beyond the decay.
        let left = 1.0 / (1.0 + steps * (1.0 + 0.5 * steps));
        Stirred {
            inflow: flows.0 + left * (stirred.inflow - flows.0),
            outflow: flows.1 + left * (stirred.outflow - flows.1),
        }
    }

    /// d(stirred)/dt for these flows \[kg/s\].
    pub fn stirring_rates(&self, stirred: &Stirred, flows: (f64, f64)) -> [f64; 2] {
        [flows.0 - stirred.inflow, flows.1 - stirred.outflow].map(|lag| lag / self.stirring_decay_s)
    }

    /// Forced convection by the stirring, in gas of this temperature \[K\].
    pub fn forced(&self, stirred: &Stirred, gas_k: f64) -> Forced {
        let Law::Correlation(Air { diameter_m, jet_diameter_m, .. }) = self.law else {
            return Forced { jet: 0.0, column: 0.0 };
        };
        let viscosity = air_viscosity(gas_k);
        let [factor, power] = FORCED;
        let nusselt = |flow: f64, width_m: f64| {
            let reynolds = 4.0 * flow / (PI * width_m * viscosity);
            factor * math::pow(reynolds, power)
        };
        Forced {
            jet: nusselt(stirred.inflow, jet_diameter_m),
            column: nusselt(stirred.outflow, diameter_m),
        }
    }

    /// Film of a zone at this pressure \[Pa\], gas and wall temperature \[K\].
    pub fn film(
        &self,
        pressure: f64,
        gas_k: f64,
        wall_k: f64,
        forced: &Forced,
        shares: &Shares,
    ) -> Film {
        match self.law {
            Law::None => Film::default(),
            Law::Constant { still, per_flow } => Film {
                still_w_m2_k: self.scale * still,
                per_inflow: self.scale * per_flow * shares.inflow,
                profile_w_m2: 0.0,
            },
            Law::Correlation(air) => {
                let film_k = 0.5 * (gas_k + wall_k);
                let conductivity = air_conductivity(film_k);
                let nusselt = air.still(pressure, film_k, gas_k - wall_k, conductivity)
                    + forced.in_zone(shares);
                Film {
                    still_w_m2_k: self.scale * nusselt * conductivity / air.diameter_m,
                    ..Film::default()
                }
            }
        }
    }

    /// The zone's gas for the next [`REFRESH_S`] after `before`, at this pressure \[Pa\], gas and wall temperature
    /// \[K\].
    pub fn section(
        &self,
        before: &Section,
        (pressure, gas_k, wall_k): (f64, f64, f64),
        forced: &Forced,
        shares: &Shares,
    ) -> Section {
        let Law::Correlation(air) = self.law else {
            return Section::flat(self.film(pressure, gas_k, wall_k, forced, shares));
        };
        let above_wall_k = gas_k - wall_k;
        let mut profile = before.profile;
        if let Some(conduction) = &before.conduction {
            conduction.advance(&mut profile, above_wall_k);
        }
        let film_k = 0.5 * (gas_k + wall_k);
        let conductivity = air_conductivity(film_k);
        let still = air.still(pressure, film_k, above_wall_k, conductivity);
        let stirred = forced.in_zone(shares);
        // rho cp of the gas, and its conductivity with buoyancy.
        let capacity_j_m3_k = pressure / (air.gas.r * gas_k) * air.gas.cp;
        let effective = self.scale * conductivity * still / CONDUCTION;
        let square = air.diameter_m * air.diameter_m;
        let conduction = Conduction::new(4.0 * effective * REFRESH_S / (capacity_j_m3_k * square));
        let (share, rest_k) = conduction.lost(&profile);
        // Volume over surface is D/4.
        let per_kelvin = 0.25 * capacity_j_m3_k * air.diameter_m / REFRESH_S;
        Section {
            film: Film {
                still_w_m2_k: per_kelvin * share
                    + self.scale * stirred * conductivity / air.diameter_m,
                per_inflow: 0.0,
                profile_w_m2: per_kelvin * rest_k,
            },
            profile,
            conduction: Some(conduction),
            still_share: still / (still + stirred),
        }
    }
}

impl Air {
    /// Nusselt number of still gas at this pressure \[Pa\], film temperature and difference to the wall \[K\].
    fn still(&self, pressure: f64, film_k: f64, difference_k: f64, conductivity: f64) -> f64 {
        let viscosity = air_viscosity(film_k);
        let cubed = self.diameter_m * self.diameter_m * self.diameter_m;
        let density = pressure / (self.gas.r * film_k);
        // Grashof times Prandtl number.
        let rayleigh = GRAVITY * difference_k.abs() * cubed * self.gas.cp * density * density
            / (film_k * viscosity * conductivity);
        let convection4 = if rayleigh > TURBULENT_RAYLEIGH {
            let [factor, power] = TURBULENT;
            let nusselt = factor * math::pow(rayleigh, power);
            nusselt * nusselt * nusselt * nusselt
        } else {
            const LAMINAR4: f64 = LAMINAR * LAMINAR * LAMINAR * LAMINAR;
            LAMINAR4 * rayleigh
        };
        const CONDUCTION4: f64 = CONDUCTION * CONDUCTION * CONDUCTION * CONDUCTION;
        (CONDUCTION4 + convection4).sqrt().sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A muscle of 15 bores behind a port of 0.22 bores.
    fn heat_in(bore_m: f64) -> InnerHeat {
        let scenario = Scenario {
            heat: Heat { inlet_diameter_m: Some(0.22 * bore_m), ..Heat::default() },
            ..Scenario::default()
        };
        InnerHeat::of_chamber(&scenario, bore_m, 15.0 * bore_m)
    }

    fn coefficient(heat: &InnerHeat, pressure: f64, difference_k: f64, stirred: &Stirred) -> f64 {
        let (wall_k, gas_k) = (298.0, 298.0 + difference_k);
        let forced = heat.forced(stirred, gas_k);
        heat.film(pressure, gas_k, wall_k, &forced, heat.whole()).coefficient(0.0)
    }

    /// The table of `docs/background/model.md`, printed with `cargo test -p thermyo-plant table -- --nocapture`. A
    /// stroke of 0.36 g/s in 20 mm, at the same speed in the others, has just stirred the gas.
    #[test]
    fn the_table_of_the_documentation() {
        let page = include_str!("../../../docs/background/model.md");
        let mut missing = 0;
        for bore_mm in [10, 20, 30, 40] {
            let bore_m = 1e-3 * f64::from(bore_mm);
            let heat = heat_in(bore_m);
            let flow = 0.36e-3 * (bore_m / 0.02) * (bore_m / 0.02);
            for bar in ["1.2", "3", "5", "7"] {
                let pressure = 1e5 * bar.parse::<f64>().unwrap();
                let still = [5.0, 10.0, 20.0]
                    .map(|kelvin| coefficient(&heat, pressure, kelvin, &Stirred::default()));
                let after = |inflow, outflow| {
                    coefficient(&heat, pressure, 10.0, &Stirred { inflow, outflow })
                };
                let after = [
                    after(flow, 0.0),
                    after(flow * math::exp(-1.0), 0.0),
                    after(0.0, flow),
                    after(0.0, flow * math::exp(-1.0)),
                ];
                let cells: Vec<String> =
                    still.iter().chain(&after).map(|h| format!("{h:.1}")).collect();
                let row = format!("| {bore_mm} | {bar} | {} |", cells.join(" | "));
                println!("{row}");
                missing += usize::from(!page.contains(&row));
            }
        }
        assert_eq!(missing, 0, "docs/background/model.md lacks rows that are printed above");
    }

    /// Woodfield's two terms meet the laminar law where that law ends, and conduction is the floor.
    #[test]
    fn still_air_is_continuous_and_never_below_conduction() {
        let air = Air {
            diameter_m: 0.05,
            jet_diameter_m: 0.01,
            gas: IdealGas::new(&thermyo_scenario::Gas::default()),
        };
        let conductivity = air_conductivity(300.0);
        let mut last = 0.0;
        for i in 0..2500 {
            let pressure = 1e3 * math::pow(1.004, f64::from(i));
            let nusselt = air.still(pressure, 300.0, 10.0, conductivity);
            assert!(nusselt >= CONDUCTION && nusselt > last, "{pressure} Pa: {nusselt}");
            assert!(last == 0.0 || nusselt < 1.01 * last, "{pressure} Pa: {nusselt} after {last}");
            last = nusselt;
        }
        assert!(last > 50.0, "{last}");
    }
}
