//! Mass flow through a valve, ISO 6358, and its inverse.
//!
//! m = C p1 rho0 sqrt(T0/T1) phi(p2/p1): C the sonic conductance, b the critical pressure ratio,
//! rho0 the density at the reference atmosphere (ANR: 100 kPa, 293.15 K).

use crate::math::{inverse_sqrt, limit, sqrt};
use crate::parameter::{ConfigError, parameters};
use crate::physics::gas::{Gas, Reservoir};

/// Reference atmosphere (ISO 8778, ANR): pressure \[Pa\].
pub const REFERENCE_PRESSURE_PA: f32 = 100_000.0;
/// Reference atmosphere (ISO 8778, ANR): temperature \[K\].
pub const REFERENCE_TEMPERATURE_K: f32 = 293.15;
/// Square root of the reference temperature \[K^0.5\].
const SQRT_REFERENCE_K: f32 = 17.121_624;
/// Above this pressure ratio the flow is taken as linear in the pressure difference: the square
/// root's slope is infinite at no flow, a real valve's is not (laminar flow, ISO 6358-1 annex).
pub const LAMINAR_RATIO: f32 = 0.999;

/// Density at the reference atmosphere \[kg/m3\].
pub fn reference_density_kg_m3(gas: &Gas) -> f32 {
    REFERENCE_PRESSURE_PA / (gas.gas_constant_j_kg_k * REFERENCE_TEMPERATURE_K)
}

parameters! {
    /// A valve; conductance and critical ratio apply when it is open.
    "valve": Valve {
        conductance_m3_s_pa: 4.0e-9, "m3/(s Pa)", 1.0e-13 to 1.0e-3, "sonic conductance C at ANR (ISO 6358)";
        critical_ratio: 0.3, "", 0.01 to 0.99, "critical pressure ratio b";
        switch_time_s: 0.002, "s", 0.0 to 0.1, "from closed to open, and from open to closed";
        dead_time_s: 0.001, "s", 0.0 to 0.1, "between the pin and the first movement";
    }
}

parameters! {
    /// Static curve and bandwidth of a proportional valve.
    "valve": Spool {
        dead_band: 0.2, "", 0.0 to 0.9, "command of a proportional valve up to which it stays shut, share of the largest one";
        bandwidth_hz: 50.0, "Hz", 1.0 to 10000.0, "frequency at which a proportional valve's opening has fallen by 3 dB";
    }
}

impl Spool {
    /// Command \[-\] for an opening \[-\]: the inverse of a straight line from the dead band's end, shut, to the
    /// largest command, open.
    pub fn command(&self, opening: f32) -> f32 {
        if opening > 0.0 { self.dead_band + (1.0 - self.dead_band) * opening } else { 0.0 }
    }

    /// Opening \[-\] at rest for a command \[-\].
    pub fn opening(&self, command: f32) -> f32 {
        limit((command - self.dead_band) / (1.0 - self.dead_band), 0.0, 1.0)
    }

    /// Time constant of the first-order lag with this bandwidth \[s\].
    pub fn lag_s(&self) -> f32 {
        1.0 / (core::f32::consts::TAU * self.bandwidth_hz)
    }
}

/// Kind of both valves: how a command opens them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ValveKind {
    /// On or off: the command is the pulse's share of a PWM period.
    #[default]
    Switching,
    /// Opens in proportion: the command is an analogue value, held for a period.
    Proportional(Spool),
}

impl ValveKind {
    /// Whether a command is a pulse's share of a PWM period.
    pub fn is_switching(&self) -> bool {
        matches!(self, Self::Switching)
    }

    /// Delay of the valve behind its command: its dead time, and half of its stroke or its lag \[s\].
    pub fn late_s(&self, valve: &Valve) -> f32 {
        let moves_s = match self {
            Self::Switching => 0.5 * valve.switch_time_s,
            Self::Proportional(spool) => spool.lag_s(),
        };
        valve.dead_time_s + moves_s
    }

    /// Checks every value.
    ///
    /// # Errors
    /// The first value that is not a number or lies outside of its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        match self {
            Self::Switching => Ok(()),
            Self::Proportional(spool) => spool.check(),
        }
    }
}

impl Valve {
    /// Subsonic flow function phi \[-\]: 1 where choked, 0 at no pressure difference.
    pub fn flow_function(&self, pressure_ratio: f32) -> f32 {
        let b = self.critical_ratio;
        let ellipse = |ratio: f32| {
            let x = (ratio - b) / (1.0 - b);
            sqrt(1.0 - x * x)
        };
        if pressure_ratio <= b {
            1.0
        } else if pressure_ratio <= LAMINAR_RATIO {
            ellipse(pressure_ratio)
        } else {
            let slope = ellipse(LAMINAR_RATIO) / (1.0 - LAMINAR_RATIO);
            limit(slope * (1.0 - pressure_ratio), 0.0, 1.0)
        }
    }

    /// Mass flow \[kg/s\] of the fully open valve to the absolute pressure `downstream_pa`; 0 if the pressure
    /// difference is reversed.
    pub fn mass_flow_kg_s(&self, gas: &Gas, upstream: Reservoir, downstream_pa: f32) -> f32 {
        let Reservoir { pressure_pa: upstream_pa, temperature_k: upstream_k } = upstream;
        if !(upstream_pa > downstream_pa && upstream_k > 0.0) {
            return 0.0;
        }
        let reference_density = reference_density_kg_m3(gas);
        self.conductance_m3_s_pa
            * upstream_pa
            * reference_density
            * SQRT_REFERENCE_K
            * inverse_sqrt(upstream_k)
            * self.flow_function(downstream_pa / upstream_pa)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Litres per minute at the reference atmosphere.
    fn anr_l_min(gas: &Gas, flow_kg_s: f32) -> f32 {
        let density = reference_density_kg_m3(gas);
        flow_kg_s / density * 60_000.0
    }

    /// C = 2 dm3/(s bar), b = 0.3, 0.4 MPa gauge upstream, 20 degC.
    #[test]
    fn iso_6358_vector() {
        let valve = Valve { conductance_m3_s_pa: 2.0e-8, ..Valve::default() };
        let gas = Gas::default();
        let upstream = Reservoir { pressure_pa: 500_000.0, temperature_k: 293.15 };
        let choked = valve.mass_flow_kg_s(&gas, upstream, 100_000.0);
        assert!((anr_l_min(&gas, choked) / 600.0 - 1.0).abs() < 1e-4);
        let subsonic = valve.mass_flow_kg_s(&gas, upstream, 400_000.0);
        assert!((anr_l_min(&gas, subsonic) / 419.91 - 1.0).abs() < 1e-4);
    }

    proptest! {
        #[test]
        fn the_command_gives_its_opening(
            dead_band in 0.0_f32..0.9, bandwidth_hz in 1.0_f32..1.0e4, opening in 0.0_f32..1.0
        ) {
            let spool = Spool { dead_band, bandwidth_hz };
            let command = spool.command(opening);
            prop_assert!(command <= 1.0 + 1e-6 && (opening == 0.0 || command >= dead_band));
            prop_assert!((spool.opening(command) - opening).abs() < 1e-5, "{command}");
            prop_assert_eq!(spool.opening(0.999 * dead_band), 0.0);
        }

        #[test]
        fn flow_function_is_monotonic_and_continuous(
            b in 0.05_f32..0.95, r in 0.0_f32..1.2
        ) {
            let valve = Valve { critical_ratio: b, ..Valve::default() };
            let here = valve.flow_function(r);
            prop_assert!((0.0..=1.0).contains(&here));
            prop_assert!(valve.flow_function(r + 1e-5) <= here + 1e-6);
            prop_assert!(here - valve.flow_function(r + 1e-5) < 0.02);
        }
    }
}
