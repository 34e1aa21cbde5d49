//! The plant, its chamber and its load.

use super::air::IDEAL_GAS_PA;
use crate::declare::{choice, table};
use crate::geometry::Dimensions;
use crate::preset::MusclePreset;
use model_core::physics;

choice! {
    PlantKind {
        Muscle = "muscle",
        /// A rigid vessel, or one with a prescribed volume.
        Vessel = "vessel",
        Cylinder = "cylinder",
        /// A chamber given by measurements.
        Table = "table",
    }
}

choice! {
    PlantModel {
        /// Axial zones, wall layers, moving mass, switching valves.
        Full = "full",
        /// One zone, quasi-static load, ideal valves.
        Lumped = "lumped",
        /// The paper's eq. (12). A vessel has one zone in every model; `paper` applies eq. (9) to it.
        Paper = "paper",
    }
}

table! {
    "plant", "the simulated actuator", physical;
    Plant {
        kind: choice PlantKind::Muscle, "what holds the gas";
        model: choice PlantModel::Full, "zones, wall layers and real valves; one zone; the paper's eq. (12)";
        initial_pressure_pa: real 120_000.0, "Pa", 1.0 to IDEAL_GAS_PA, "absolute pressure at the start; beyond, no gas is ideal";
        initial_temperature_k: real 298.0, "K", 100.0 to 1000.0, "temperature of gas, wall and sensors at the start";
        initial_gas_temperature_k: optional "K", 100.0 to 1000.0, "that of the gas, where it is not the wall's: a record that begins in the middle of a motion";
    }
}

impl Plant {
    pub fn gas_k(&self) -> f64 {
        self.initial_gas_temperature_k.unwrap_or(self.initial_temperature_k)
    }
}

table! {
    /// A file states the first five in one of two ways, and the loader computes the others.
    "muscle", "the McKibben muscle: thread_length_m and turns, or diameter_m and braid_angle_deg, with rest_length_m; the others follow", believed, physical;
    Muscle as physics::hysteresis::Hysteresis {
        preset: choice MusclePreset::None, "a muscle with public figures; a key in the file stands above its value";
        thread_length_m: real Dimensions::nominal().thread_length_m, "m", 0.01 to 10.0, "thread length b";
        turns: real Dimensions::nominal().turns, "", 0.1 to 1000.0, "thread turns n";
        rest_length_m: real Dimensions::nominal().rest_length_m, "m", 0.005 to 10.0, "length at rest, the longest";
        diameter_m: real Dimensions::nominal().diameter_m, "m", 1.0e-7 to 30.0, "diameter at rest";
        braid_angle_deg: real Dimensions::nominal().braid_angle_deg, "deg", 3.0 to 54.0, "angle of the threads to the axis at rest";
        zones: whole usize, 8, 1 to 64, "axial zones of gas and wall (full)";
        bladder_stiffness_n_m: real 600.0, "N/m", 0.0 to 1.0e6, "stiffness of the bladder against contraction";
        bladder_saturation_n: real 0.0, "N", 0.0 to 1.0e6, "force K1 that the bladder holds back with once it is full";
        bladder_strain: real 0.02, "", 0.001 to 1.0, "contraction e1 over which it fills, share of the rest length";
        slack_m: real 0.0, "m", -0.1 to 0.1, "part d0 of the length that is no braid";
        core slip_force_n;
        core slip_stiffness_n_m;
        core slip_pressure_factor;
        core creep_fast_n_m;
        core creep_fast_s;
        core creep_slow_n_m;
        core creep_slow_s;
        // The core's value includes the volume of the tube.
        dead_volume_m3: real 5.0e-6, "m3", 0.0 to 0.05, "volume of the end fittings";
    }
}

table! {
    "vessel", "the vessel", believed, physical;
    Vessel {
        volume_m3: real 0.001, "m3", 1.0e-9 to 1.0e6, "gas volume, without volume_csv";
        surface_m2: real 0.06, "m2", 0.0 to 1.0e3, "inner surface";
        wall_heat_capacity_j_k: real 500.0, "J/K", 0.01 to 1.0e9, "heat capacity of the wall";
        volume_csv: csv "volume_m3", "volume over time, of a moving piston";
        dead_volume_m3: real 0.0, "m3", 0.0 to 1.0e6, "added to what volume_csv gives";
        characteristic_length_m: real 0.1, "m", 0.001 to 300.0, "diameter, for the heat-transfer correlation and for the position of a piston";
    }
}

impl Vessel {
    /// Section that turns the volume into the length that the sensor shows \[m2\].
    pub fn section_m2(&self) -> f64 {
        std::f64::consts::PI / 4.0 * self.characteristic_length_m * self.characteristic_length_m
    }
}

table! {
    /// The defaults are those of Richer and Hurmuzlu, the paper's \[1\], for a pneumatic cylinder: charging close to
    /// adiabatic, discharging close to isothermal, the rest between.
    "paper", "coefficients of eq. (9) and (12), from 1 (isothermal) to k (adiabatic)", physical;
    Paper {
        alpha_in: real 1.1, "", 1.0 to 1.7, "charging";
        alpha_out: real 1.1, "", 1.0 to 1.7, "discharging";
        alpha: real 1.1, "", 1.0 to 1.7, "change of volume";
    }
}

choice! {
    LoadKind {
        Isotonic = "isotonic",
        Isometric = "isometric",
        /// A mass that pressure lifts: its weight and, in `full`, its inertia.
        Mass = "mass",
    }
}

table! {
    "load", "the moved load", believed, physical;
    Load {
        kind: choice LoadKind::Isotonic, "a constant force, a fixed length, a mass that pressure lifts";
        force_n: real 100.0, "N", -1.0e6 to 1.0e6, "the force; positive where it pulls the ends apart (isotonic)";
        length_m: real 0.26, "m", 0.001 to 10.0, "the length held (isometric)";
        mass_kg: real 2.0, "kg", 0.0 to 1.0e5, "the mass (mass); what moves with the end (isotonic, full)";
    }
}
