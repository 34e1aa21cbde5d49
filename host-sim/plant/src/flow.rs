//! Mass flow through valves (ISO 6358) and nozzles (isentropic), and its enthalpy.

use super::gas::IdealGas;
use std::f64::consts::PI;
use thermyo_compute::math;
use thermyo_scenario::Tube;

/// Standard reference atmosphere of ISO 8778 (ANR), pressure \[Pa\].
const ANR_PRESSURE_PA: f64 = 100_000.0;
/// Standard reference atmosphere of ISO 8778 (ANR), temperature \[K\].
const ANR_TEMPERATURE_K: f64 = 293.15;
/// Above this pressure ratio the flow is taken as linear in the pressure difference, as ISO 6358-3
/// recommends: the ideal laws have an infinite slope at zero flow.
const LINEAR_RATIO: f64 = 0.999;
/// [`LINEAR_RATIO`] of a tube, where viscous friction keeps the flow linear over a wider range.
const TUBE_LINEAR_RATIO: f64 = 0.98;

/// A flow path by ISO 6358: sonic conductance C, critical pressure ratio b.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Iso6358 {
    /// C rho0 sqrt(T0): choked mass flow is this times p1/sqrt(T1).
    choked: f64,
    critical_ratio: f64,
    /// 1 over (1 - the critical ratio).
    per_subsonic: f64,
    linear_ratio: f64,
    /// phi at `linear_ratio` over `1 - linear_ratio`.
    linear_slope: f64,
}

impl Iso6358 {
    /// A valve: C \[m3/(s Pa)\] at ANR, b \[-\] in 0..1, R \[J/(kg K)\].
    pub fn valve(sonic_conductance: f64, critical_ratio: f64, gas: &IdealGas) -> Self {
        Self::new(sonic_conductance, critical_ratio, LINEAR_RATIO, gas)
    }

    /// The leak's path, if there is a leak.
    pub fn leak(sonic_conductance: f64, critical_ratio: f64, gas: &IdealGas) -> Option<Self> {
        (sonic_conductance > 0.0).then(|| Self::valve(sonic_conductance, critical_ratio, gas))
    }

    /// A tube: linear up to a pressure drop of 2 %.
    pub fn tube(sonic_conductance: f64, critical_ratio: f64, gas: &IdealGas) -> Self {
        Self::new(sonic_conductance, critical_ratio, TUBE_LINEAR_RATIO, gas)
    }

    /// The connection of tube and muscle. Behind a line it passes no more than a loss-free nozzle
    /// of the line's bore, where the gas reaches the speed of sound.
    pub fn port(tube: &Tube, critical_ratio: f64, gas: &IdealGas) -> Self {
        let bore = tube.line().map_or(f64::INFINITY, |[_, diameter_m]| {
            0.25 * PI * diameter_m * diameter_m * choked_flow_function(gas.k) / gas.r.sqrt()
        });
        // As a conductance C, from the choked flow by p1/sqrt(T1).
        let bore = bore * gas.r * ANR_TEMPERATURE_K.sqrt() / ANR_PRESSURE_PA;
        Self::tube(tube.conductance_m3_s_pa.min(bore), critical_ratio, gas)
    }

    fn new(sonic_conductance: f64, critical_ratio: f64, linear_ratio: f64, gas: &IdealGas) -> Self {
        let linear_ratio = linear_ratio.max(0.5 * (1.0 + critical_ratio));
        let per_subsonic = 1.0 / (1.0 - critical_ratio);
        let position = (linear_ratio - critical_ratio) * per_subsonic;
        Self {
            choked: sonic_conductance * ANR_PRESSURE_PA / (gas.r * ANR_TEMPERATURE_K)
                * ANR_TEMPERATURE_K.sqrt(),
            critical_ratio,
            per_subsonic,
            linear_ratio,
            linear_slope: (1.0 - position * position).sqrt() / (1.0 - linear_ratio),
        }
    }

    /// Mass flow \[kg/s\] from upstream (p1 \[Pa\], T1 \[K\]) to downstream p2 <= p1.
    #[inline]
    pub fn mass_flow(&self, upstream_pa: f64, upstream_k: f64, downstream_pa: f64) -> f64 {
        let ratio = downstream_pa / upstream_pa;
        let choked = self.choked * upstream_pa / upstream_k.sqrt();
        if ratio <= self.critical_ratio {
            choked
        } else if ratio < self.linear_ratio {
            let position = (ratio - self.critical_ratio) * self.per_subsonic;
            choked * (1.0 - position * position).sqrt()
        } else {
            choked * self.linear_slope * (1.0 - ratio)
        }
    }

    /// Largest change of mass flow per pressure difference \[kg/(s Pa)\]. It sets the fastest time
    /// constant of a volume behind this path.
    pub fn steepest(&self, upstream_k: f64) -> f64 {
        self.choked / upstream_k.sqrt() * self.linear_slope
    }

    /// Diameter of a loss-free nozzle that chokes at the same flow \[m\].
    pub fn equivalent_diameter(&self, gas: &IdealGas) -> f64 {
        let area = self.choked * gas.r.sqrt() / choked_flow_function(gas.k);
        (4.0 * area / PI).sqrt()
    }
}

/// An isentropic converging nozzle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nozzle {
    /// Discharge coefficient times throat area over sqrt(R).
    conductance: f64,
    k: f64,
    critical_ratio: f64,
    choked: f64,
}

impl Nozzle {
    pub fn new(diameter_m: f64, discharge_coefficient: f64, gas: &IdealGas) -> Self {
        Self {
            conductance: discharge_coefficient * PI / 4.0 * diameter_m * diameter_m / gas.r.sqrt(),
            k: gas.k,
            critical_ratio: math::pow(2.0 / (gas.k + 1.0), gas.k / (gas.k - 1.0)),
            choked: choked_flow_function(gas.k),
        }
    }

    /// Mass flow \[kg/s\] from upstream stagnation (p1 \[Pa\], T1 \[K\]) to downstream p2 <= p1.
    pub fn mass_flow(&self, upstream_pa: f64, upstream_k: f64, downstream_pa: f64) -> f64 {
        let ratio = downstream_pa / upstream_pa;
        let function = if ratio <= self.critical_ratio {
            self.choked
        } else if ratio < LINEAR_RATIO {
            self.subsonic(ratio)
        } else {
            self.subsonic(LINEAR_RATIO) * (1.0 - ratio) / (1.0 - LINEAR_RATIO)
        };
        self.conductance * upstream_pa / upstream_k.sqrt() * function
    }

    fn subsonic(&self, ratio: f64) -> f64 {
        let root = math::pow(ratio, 1.0 / self.k);
        (2.0 * self.k / (self.k - 1.0) * root * (root - ratio)).sqrt()
    }
}

/// Choked flow function: m sqrt(R T1) / (A p1).
fn choked_flow_function(k: f64) -> f64 {
    k.sqrt() * math::pow(2.0 / (k + 1.0), (k + 1.0) / (2.0 * (k - 1.0)))
}

/// All flows into and out of a volume at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Streams {
    /// Mass flow in \[kg/s\].
    pub inflow: f64,
    /// Sum of inflow times its temperature \[kg K/s\].
    pub inflow_temperature: f64,
    /// Mass flow out, at the temperature of the volume \[kg/s\].
    pub outflow: f64,
}

impl Streams {
    /// Adds the flow between the volume (p, T) and a reservoir (p, T), in the direction of the
    /// pressures; `law` gives the flow from upstream (p, T) to downstream p.
    pub fn add(
        &mut self,
        (pressure, temperature): (f64, f64),
        (reservoir_pressure, reservoir_temperature): (f64, f64),
        law: impl Fn(f64, f64, f64) -> f64,
    ) {
        if reservoir_pressure > pressure {
            let flow = law(reservoir_pressure, reservoir_temperature, pressure);
            self.inflow += flow;
            self.inflow_temperature += flow * reservoir_temperature;
        } else {
            self.outflow += law(pressure, temperature, reservoir_pressure);
        }
    }

    /// Prescribed flows \[kg/s\], with the inflow at `inflow_k` \[K\].
    pub fn given(inflow: f64, inflow_k: f64, outflow: f64) -> Self {
        Self { inflow, inflow_temperature: inflow * inflow_k, outflow }
    }

    /// Net mass flow in \[kg/s\].
    pub fn net(&self) -> f64 {
        self.inflow - self.outflow
    }

    /// Net enthalpy flow in, over cp, for a volume at this temperature \[kg K/s\].
    pub fn net_enthalpy_over_cp(&self, temperature: f64) -> f64 {
        self.inflow_temperature - self.outflow * temperature
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn air() -> IdealGas {
        IdealGas::new(&thermyo_scenario::Gas::default())
    }

    /// Litres per minute at ANR.
    fn anr_l_min(mass_flow: f64, gas: &IdealGas) -> f64 {
        mass_flow * gas.r * ANR_TEMPERATURE_K / ANR_PRESSURE_PA * 60_000.0
    }

    #[test]
    fn iso_6358_example() {
        // C = 2 dm3/(s bar), b = 0.3, upstream 0.4 MPa gauge, 20 degC, atmosphere 100 kPa.
        let gas = air();
        let valve = Iso6358::valve(2.0e-8, 0.3, &gas);
        let choked = anr_l_min(valve.mass_flow(500_000.0, 293.15, 100_000.0), &gas);
        assert!((choked - 600.0).abs() < 1e-9, "{choked}");
        let subsonic = anr_l_min(valve.mass_flow(500_000.0, 293.15, 400_000.0), &gas);
        assert!((subsonic - 419.91).abs() < 0.005, "{subsonic}");
    }

    #[test]
    fn flow_laws_are_continuous_and_monotonic() {
        let gas = air();
        let valve = Iso6358::valve(2.0e-8, 0.3, &gas);
        let nozzle = Nozzle::new(0.002, 0.84, &gas);
        let laws: [&dyn Fn(f64) -> f64; 2] =
            [&|p2| valve.mass_flow(5e5, 300.0, p2), &|p2| nozzle.mass_flow(5e5, 300.0, p2)];
        for law in laws {
            let choked = law(0.0);
            let mut last = choked;
            for i in 0..=100_000 {
                let flow = law(5e5 * f64::from(i) / 100_000.0);
                assert!(flow <= last * (1.0 + 1e-12) && last - flow < 0.01 * choked, "step {i}");
                last = flow;
            }
            assert_eq!(last, 0.0);
        }
    }

    #[test]
    fn choked_nozzle_of_air() {
        // m sqrt(T)/(A p) = 0.040418 s sqrt(K)/m for air (Anderson, Modern Compressible Flow).
        let flow = Nozzle::new((4.0 / PI).sqrt(), 1.0, &air()).mass_flow(1.0, 1.0, 0.1);
        assert!((flow - 0.040_415).abs() < 1e-5, "{flow}");
    }

    #[test]
    fn a_line_passes_no_more_than_its_bore() {
        let gas = air();
        let tube = |conductance_m3_s_pa, length_m| {
            let tube =
                Tube { conductance_m3_s_pa, length_m, diameter_m: Some(0.004), ..Tube::default() };
            Iso6358::port(&tube, 0.3, &gas)
        };
        let flow = |path: Iso6358| path.mass_flow(5e5, 300.0, 1e5);
        let nozzle = Nozzle::new(0.004, 1.0, &gas).mass_flow(5e5, 300.0, 1e5);
        assert!((flow(tube(1.0e-6, Some(4.0))) / nozzle - 1.0).abs() < 1e-12);
        assert_eq!(tube(1.0e-9, Some(4.0)), Iso6358::tube(1.0e-9, 0.3, &gas));
        assert_eq!(tube(1.0e-6, None), Iso6358::tube(1.0e-6, 0.3, &gas));
    }

    #[test]
    fn reverse_flow_carries_the_other_side() {
        let valve = Iso6358::valve(2.0e-8, 0.3, &air());
        let mut streams = Streams::default();
        streams.add((2e5, 400.0), (1e5, 300.0), |p, t, q| valve.mass_flow(p, t, q));
        assert!(streams.inflow == 0.0 && streams.outflow > 0.0);
        streams.add((2e5, 400.0), (3e5, 300.0), |p, t, q| valve.mass_flow(p, t, q));
        assert!((streams.inflow_temperature / streams.inflow - 300.0).abs() < 1e-9);
    }
}
