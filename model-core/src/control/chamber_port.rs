//! Inputs of the loops: readings, and the gas still moved by the last pulse.

use super::valve_drive::FlowDrive;
use crate::config::Config;
use crate::math::limit;
use crate::physics::chamber::Chamber;
use crate::physics::gas::Reservoir;
use crate::sample::Estimate;

/// Measured and estimated inputs of the controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feedback {
    /// Measured absolute pressure \[Pa\].
    pub pressure_pa: f32,
    /// Measured length \[m\]; without its sensor, the length derived from pressure and load.
    pub length_m: f32,
    /// Half the width of the wide code whose middle the length is \[m\]; 0: no wide code.
    pub length_wide_m: f32,
    /// Whether the length is not measured.
    pub length_lost: bool,
    /// The estimate of the step before.
    pub estimate: Estimate,
}

impl Feedback {
    /// Within a wide code the length may be anywhere. Returns the feedback with the length nearest to the reference:
    /// the code's middle would be an error that no valve can correct. A reference outside the code is further off than
    /// the dead zone: the valves act until the length has left the code.
    pub(super) fn nearest_to(self, reference_m: f32, zone_m: f32) -> Self {
        let Self { length_m, length_wide_m, .. } = self;
        let within_m = limit(length_wide_m - zone_m, 0.0, f32::MAX);
        Self { length_m: limit(reference_m, length_m - within_m, length_m + within_m), ..self }
    }

    /// The gas in the muscle, as a valve sees it.
    pub fn muscle(&self) -> Reservoir {
        Reservoir { pressure_pa: self.pressure_pa, temperature_k: self.estimate.gas_k }
    }
}

/// The gas at the valves' side of a loop, for one period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChamberPort {
    /// PWM period \[s\].
    pub period_s: f32,
    /// Its reciprocal \[Hz\]: a division is expensive without an FPU.
    pub pwm_hz: f32,
    /// Absolute pressure \[Pa\].
    pub pressure_pa: f32,
    /// Gas volume \[m3\].
    pub volume_m3: f32,
    /// Mass that the last pulse still moves, positive into the muscle \[kg\].
    pub in_flight_kg: f32,
    /// Mass that leaks in the coming period \[kg\].
    pub leaked_kg: f32,
    /// Whether the last period's valve could not pass the requested mass.
    pub saturated: bool,
    /// Temperature of the gas that comes in \[K\] ...
    pub inflow_k: f32,
    /// ... and of the gas that leaves \[K\].
    pub gas_k: f32,
    /// Reciprocal of the heat-capacity ratio \[-\].
    pub per_k: f32,
    /// Specific gas constant \[J/(kg K)\].
    pub gas_constant_j_kg_k: f32,
}

impl ChamberPort {
    /// Creates the port behind the valves of `drive`, at the start of a period; `per_k` is the reciprocal of the
    /// heat-capacity ratio.
    pub fn new(
        config: &Config,
        chamber: &impl Chamber,
        feedback: &Feedback,
        drive: &FlowDrive,
        per_k: f32,
    ) -> Self {
        let period_s = drive.period_s();
        let leaked_kg = if config.leak.leaks() {
            let Config { leak, gas, ambient, .. } = config;
            // Air that leaks in is not compensated by venting.
            let flow_kg_s = leak.mass_flow_kg_s(gas, feedback.muscle(), (*ambient).into());
            period_s * limit(flow_kg_s, 0.0, f32::MAX)
        } else {
            0.0
        };
        Self {
            period_s,
            pwm_hz: drive.pwm_hz(),
            pressure_pa: feedback.pressure_pa,
            volume_m3: chamber.volume_m3(feedback.length_m),
            in_flight_kg: drive.in_flight_kg(),
            leaked_kg,
            saturated: drive.saturated(),
            inflow_k: config.supply.temperature_k,
            gas_k: feedback.estimate.gas_k,
            per_k,
            gas_constant_j_kg_k: config.gas.gas_constant_j_kg_k,
        }
    }

    /// Gas mass at the estimated temperature, eq. (1) \[kg\].
    pub fn gas_mass_kg(&self) -> f32 {
        self.pressure_pa * self.volume_m3 / (self.gas_constant_j_kg_k * self.gas_k)
    }

    /// Gas mass \[kg\] that a change of pressure \[Pa\] and of volume \[m3\] needs, from eq. (6): (V dP/k + P dV)/(R
    /// T). T is the temperature of the gas that passes the port: the supply's inwards, the estimate outwards (the
    /// balance (3), where (5) has one T for both).
    pub fn mass_kg(&self, change_pa: f32, change_m3: f32) -> f32 {
        let energy_j = self.volume_m3 * change_pa * self.per_k + self.pressure_pa * change_m3;
        let port_k = if energy_j > 0.0 { self.inflow_k } else { self.gas_k };
        energy_j / (self.gas_constant_j_kg_k * port_k)
    }
}

#[cfg(test)]
impl ChamberPort {
    /// Air of 298 K at rest, and periods of 10 ms.
    pub fn of_air(pressure_pa: f32, volume_m3: f32) -> Self {
        Self {
            period_s: 0.01,
            pwm_hz: 100.0,
            pressure_pa,
            volume_m3,
            in_flight_kg: 0.0,
            leaked_kg: 0.0,
            saturated: false,
            inflow_k: 298.0,
            gas_k: 298.0,
            per_k: 1.0 / 1.4,
            gas_constant_j_kg_k: 287.05,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A code from 254.5 to 255.5 mm, and a dead zone of 0.2 mm.
    #[test]
    fn a_reference_in_a_wide_code_is_met_and_one_beside_it_is_not() {
        let feedback = Feedback {
            pressure_pa: 2.0e5,
            length_m: 0.255,
            length_wide_m: 5.0e-4,
            length_lost: false,
            estimate: Estimate::default(),
        };
        let error_m = |reference_m: f32, zone_m: f32| {
            feedback.nearest_to(reference_m, zone_m).length_m - reference_m
        };
        for within_m in [0.2547, 0.255, 0.2553] {
            assert!(error_m(within_m, 2.0e-4).abs() < 1e-6, "{within_m}");
        }
        for (beside_m, side) in [(0.2544, 1.0), (0.2556, -1.0)] {
            assert!((0.2e-3..0.4e-3).contains(&(side * error_m(beside_m, 2.0e-4))), "{beside_m}");
        }
        // With a dead zone wider than the code, or without a wide code, the length stays the code's middle.
        assert_eq!(feedback.nearest_to(0.2552, 1.0e-3).length_m, 0.255);
        let exact = Feedback { length_wide_m: 0.0, ..feedback };
        assert_eq!(exact.nearest_to(0.2552, 0.0).length_m, 0.255);
    }
}
