//! Supply, valves, tube, nozzle and ambient.

use crate::declare::{choice, parameter, table};
use crate::preset::ValvePreset;
use model_core::parameter::Parameter;
use model_core::physics::valve::Spool;
use model_core::{config, physics};

/// Highest pressure at which gas is taken as ideal \[Pa\]. There, against reference equations of state, air and
/// nitrogen end an adiabatic filling up to 4.4 K too warm, and weigh 1.2 % too little (`docs/background/model.md`).
pub const IDEAL_GAS_PA: f64 = 3.0e6;

table! {
    "gas", "the ideal gas", believed, physical;
    Gas as physics::gas::Gas {
        core gas_constant_j_kg_k;
        core heat_capacity_ratio;
    }
}

table! {
    "ambient", "the surroundings", believed, physical;
    Ambient as config::Ambient {
        core pressure_pa;
        core temperature_k;
    }
}

table! {
    "supply", "the compressed air behind the inlet valve", believed, physical;
    Supply as config::Supply {
        // The core allows more, but the gas would not be ideal.
        core pressure_pa: real 700_000.0, "Pa", 1.0 to IDEAL_GAS_PA, "absolute pressure at no flow; beyond, no gas is ideal";
        core temperature_k;
        droop_pa_s_kg: real 2.0e7, "Pa s/kg", 0.0 to 1.0e12, "pressure that the regulator loses per mass flow (full)";
    }
}

/// Dead band of a proportional valve, as the core declares it.
pub const DEAD_BAND: Parameter = parameter(Spool::PARAMETERS, "dead_band");
/// Bandwidth of a proportional valve, as the core declares it.
pub const BANDWIDTH_HZ: Parameter = parameter(Spool::PARAMETERS, "bandwidth_hz");

choice! {
    /// How a command opens a valve.
    ValveKind {
        /// On or off, by pulses.
        Switching = "switching",
        /// In proportion to an analogue command.
        Proportional = "proportional",
    }
}

table! {
    "valve", "inlet and outlet valve (ISO 6358)", believed, physical;
    Valve as physics::valve::Valve {
        preset: choice ValvePreset::None, "a valve by its data sheet; a key in the file stands above its value";
        kind: choice ValveKind::Switching, "on or off by pulses, or opened in proportion (full)";
        core conductance_m3_s_pa;
        core critical_ratio;
        core switch_time_s;
        core dead_time_s;
        dead_band: from DEAD_BAND;
        bandwidth_hz: from BANDWIDTH_HZ;
        pwm_hz: real 100.0, "Hz", 0.01 to 1.0e5, "PWM frequency; of a proportional valve, how often its command changes";
    }
}

table! {
    "leak", "what the chamber leaks to ambient all the time (ISO 6358)", believed, physical;
    Leak as physics::leak::Leak {
        core conductance_m3_s_pa;
        core critical_ratio;
    }
}

table! {
    "tube", "the tube between valves and muscle (full)", believed, physical;
    Tube {
        volume_m3: real 6.0e-6, "m3", 1.0e-9 to 0.05, "volume, at the valves where there is a line";
        conductance_m3_s_pa: real 3.0e-8, "m3/(s Pa)", 1.0e-13 to 1.0e-3, "sonic conductance of tube and port, of the port where there is a line";
        length_m: optional "m", 0.0 to 10.0, "length of a line between that volume and the port, with diameter_m: sound and friction along it";
        diameter_m: optional "m", 5.0e-4 to 0.02, "bore of that line";
    }
}

impl Tube {
    /// Length and bore of the line \[m\], if it exists.
    pub fn line(&self) -> Option<[f64; 2]> {
        Some([self.length_m.filter(|length_m| *length_m > 0.0)?, self.diameter_m?])
    }
}

table! {
    /// Isentropic, choked below the critical ratio.
    "orifice", "the nozzle of a vessel", believed, physical;
    Orifice {
        diameter_m: real 0.001, "m", 1.0e-6 to 10.0, "diameter";
        discharge_coefficient: real 0.84, "", 0.01 to 1.0, "discharge coefficient";
    }
}
