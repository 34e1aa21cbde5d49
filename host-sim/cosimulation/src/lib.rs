//! A scenario as a unit for other simulators: FMI 3.0 co-simulation, <https://fmi-standard.org>.
//!
//! ```text
//! modelDescription.xml   variables, units, the default experiment       description
//! resources/             the scenario and its tables                     archive
//! binaries/PLATFORM/     the C interface around the model, host-sim/fmu library
//! ```
//!
//! Outputs are columns of `trace.csv`, or `joint_trace.csv`, the same to the bit. A unit is the
//! [plant](Kind::Plant), whose valves the importer drives, or [plant and core](Kind::WithCore), as
//! in `thermyo run`.

pub mod description;
mod joint;
pub mod model;
mod muscle;
mod running;
pub mod scenario;
pub mod variables;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    Plant,
    /// The plant, and the core that drives it.
    WithCore,
}

impl Kind {
    pub const ALL: [Self; 2] = [Self::Plant, Self::WithCore];

    /// Name of the scenario in the unit's resources, which identifies the unit's kind.
    pub fn scenario_file(self) -> &'static str {
        match self {
            Self::Plant => "plant.toml",
            Self::WithCore => "plant_and_core.toml",
        }
    }
}
