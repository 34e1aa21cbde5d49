//! Losses of energy: heat through the wall, and friction.

use crate::declare::{choice, table};
use model_core::{config, physics};

choice! {
    /// Heat transfer between gas and wall.
    HeatModel {
        /// No heat transfer.
        Adiabatic = "adiabatic",
        /// The gas keeps its initial temperature.
        Isothermal = "isothermal",
        /// `inner_w_m2_k + inner_per_flow * inflow`.
        Constant = "constant",
        /// Laws of still and of stirred air.
        Correlation = "correlation",
    }
}

table! {
    "heat", "heat transfer", believed, physical;
    Heat as physics::heat::Heat {
        model: choice HeatModel::Correlation, "from gas to wall: laws of still and stirred air; inner_w_m2_k and inner_per_flow; none; as much as keeps the temperature";
        scale: real 1.0, "", 1.0e-3 to 1.0e3, "gas to wall: factor on what model gives";
        // Chosen so that pulses into and out of muscles relax as measured: host-sim/plant/tests/plant_air.rs.
        stirring_decay_s: real 0.3, "s", 0.001 to 100.0, "how long stirring by a flow through the port outlasts it (correlation)";
        inlet_diameter_m: optional "m", 1.0e-5 to 1.0, "of the jet that stirs the gas, where it is not that of orifice, valve or tube (correlation)";
        core inner_w_m2_k;
        core inner_per_flow;
        core outer_w_m2_k;
        core outer_per_speed;
    }
}

choice! {
    /// Origin of the core's values for the gas along the muscle.
    ZonesSource {
        /// Laws and dimensions of the plant.
        Plant = "plant",
        /// The keys of the table.
        Keys = "keys",
    }
}

table! {
    "zones", "gas along the muscle, as the core's estimator has it; the plant has its own laws", believed;
    Zones as config::Zones {
        source: choice ZonesSource::Plant, "from the other tables; from the keys of this one, as in the scenario of a board's configuration";
        core buoyancy_w_m2_k;
        core per_outflow;
        core stirring_decay_s;
        core recirculation;
        core jet_reach_m;
        core diffusivity_m2_s;
        core foil_position;
        core foil_span;
        core forced_flow_kg_s;
        core bore_m;
        core foil_radius;
        core outer_wall_j_k;
        core reversal_sd;
        core tube_m3;
        core hose_m3;
        core warming_m3;
        core layers_w_k;
    }
}

table! {
    "wall", "the muscle's wall", believed, physical;
    Wall as physics::heat::Wall {
        core heat_capacity_j_k;
        outer_fraction: real 0.3, "", 0.01 to 0.99, "part of it that is the braid (full)";
        conductance_w_k: real 3.0, "W/K", 0.0 to 1.0e6, "from the inner to the outer layer (full)";
    }
}

table! {
    "friction", "friction of braid and bladder", believed, physical;
    Friction as physics::friction::Friction {
        core force_n;
        core reference_temperature_k;
        core softening_per_k;
        // The loader uses a seal's value for a cylinder.
        core pressure_factor;
        core heat_fraction;
        stribeck_force_n: real 4.0, "N", 0.0 to 1.0e5, "surplus at standstill (full)";
        stribeck_speed_m_s: real 0.005, "m/s", 1.0e-6 to 10.0, "speed at which that surplus has fallen to 1/e (full)";
        // The core's defaults of these two suit the plants `lumped` and `paper`, which lack both.
        core viscous_n_s_m: real 40.0, "N s/m", 0.0 to 1.0e6, "viscous part (full)";
        core presliding_stiffness_n_m: real 40_000.0, "N/m", 0.0 to 1.0e9, "stiffness of the presliding bristles (full)";
    }
}
