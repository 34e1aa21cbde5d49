//! Tests of the plant.

mod plant_air;
mod plant_faults;
mod plant_full;
mod plant_joint;
mod plant_lumped;
mod plant_runs;
mod plant_support;
mod plant_vessel;
