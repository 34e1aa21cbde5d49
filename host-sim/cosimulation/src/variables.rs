//! The variables of a unit. A variable's reference is its index in the list.

use super::Kind;
use thermyo_record::trace::COLUMNS;
use thermyo_record::units::{Unit, unit_of};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Variable {
    /// Its name; for an output, the column of `trace.csv`.
    pub name: &'static str,
    pub description: &'static str,
    /// Where its value comes from.
    pub role: Role,
}

/// Where a variable's value comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    Time,
    /// The importer, before the start: a Boolean.
    Parameter,
    /// The importer, between two steps.
    Input,
    Plant,
    /// The board, once per step.
    Sampled,
}

pub const TIME: u32 = 0;
/// Reference of the first input: the inlet's opening, or the set point.
pub const FIRST_INPUT: u32 = 1;
/// Reference of the outlet's opening, or of the switch that lets the scenario drive.
pub const SECOND: u32 = 2;

const TIME_S: Variable = Variable { name: "time_s", description: "Time", role: Role::Time };

/// Inputs of a plant.
const OPENINGS: [Variable; 2] = [
    input("duty_in", "Share of the PWM period for which the inlet is open, 0 to 1"),
    input("duty_out", "Share of the PWM period for which the outlet is open, 0 to 1"),
];

pub const SET_POINT: &str = "set_point";

/// Inputs of a core.
const DRIVE: [Variable; 2] = [
    input(SET_POINT, "Set point of the scenario's drive, where follow_scenario is false"),
    Variable {
        name: "follow_scenario",
        description: "The scenario's drive gives the set points; false: the input set_point does",
        role: Role::Parameter,
    },
];

const OF_PLANT: [Variable; 12] = [
    plant("pressure_pa", "Absolute pressure of the gas"),
    plant("volume_m3", "Volume of the gas"),
    plant("length_m", "Length of the muscle"),
    plant("mass_kg", "Mass of the gas"),
    plant("flow_in_kg_s", "Mass flow in, mean over the communication step"),
    plant("flow_out_kg_s", "Mass flow out, mean over the communication step"),
    plant("gas_temperature_k", "Mean temperature of the gas"),
    plant("wall_temperature_k", "Mean temperature of the wall"),
    sampled("sensor_gas_k", "Reading of the sensor in the gas"),
    sampled("sensor_wall_k", "Reading of the sensor in the wall"),
    sampled("measured_pressure_pa", "Absolute pressure as the core reads it"),
    sampled("measured_length_m", "Length as the core reads it"),
];

const OF_CORE: [Variable; 14] = [
    sampled("duty_in", "Share of the PWM period for which the inlet is open, 0 to 1"),
    sampled("duty_out", "Share of the PWM period for which the outlet is open, 0 to 1"),
    sampled("estimate_k", "Estimated temperature of the gas"),
    sampled("estimate_sd_k", "Standard deviation of the estimate"),
    sampled("estimate_valid", "1 where the estimate is to be relied on"),
    sampled("wall_estimate_k", "Estimated temperature of the wall"),
    sampled("sensor_estimate_k", "Estimated temperature of the sensor's element"),
    sampled("mass_estimate_kg", "Estimated mass of the gas"),
    sampled("heat_scale", "Estimated factor on the configured heat transfer"),
    sampled("sensor_lag_s", "Estimated lag of the sensor in the gas"),
    sampled("step", "Number of the core's step"),
    sampled("faults", "Faults, one bit each"),
    sampled("mode", "Mode of the core, by its number"),
    sampled("limited", "1 where the set point asks for more than the core gives"),
];

const fn input(name: &'static str, description: &'static str) -> Variable {
    Variable { name, description, role: Role::Input }
}

const fn plant(name: &'static str, description: &'static str) -> Variable {
    Variable { name, description, role: Role::Plant }
}

const fn sampled(name: &'static str, description: &'static str) -> Variable {
    Variable { name, description, role: Role::Sampled }
}

pub fn variables(kind: Kind) -> Vec<Variable> {
    match kind {
        Kind::Plant => [&[TIME_S], &OPENINGS[..], &OF_PLANT].concat(),
        Kind::WithCore => [&[TIME_S], &DRIVE[..], &OF_PLANT, &OF_CORE].concat(),
    }
}

impl Variable {
    pub fn column(&self) -> Option<usize> {
        COLUMNS.iter().position(|name| *name == self.name)
    }

    /// The unit at the end of its name; none for a ratio, a count or a flag.
    pub fn unit(&self) -> Option<&'static Unit> {
        unit_of(self.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_output_is_a_column_and_every_quantity_has_its_unit() {
        for kind in Kind::ALL {
            for variable in variables(kind) {
                let is_output = matches!(variable.role, Role::Plant | Role::Sampled);
                assert!(!is_output || variable.column().is_some(), "{}", variable.name);
            }
        }
        let unit = |name| plant(name, "").unit().map(|unit| unit.name);
        assert_eq!(unit("flow_in_kg_s"), Some("kg/s"));
        assert_eq!(unit("volume_m3"), Some("m3"));
        assert_eq!(unit("mass_kg"), Some("kg"));
        assert_eq!(unit("sensor_lag_s"), Some("s"));
        assert_eq!(unit("duty_in"), None);
    }

    #[test]
    fn the_inputs_are_where_their_references_say() {
        let names = |kind| variables(kind).iter().map(|v| v.name).collect::<Vec<_>>();
        assert_eq!(names(Kind::Plant)[..3], ["time_s", "duty_in", "duty_out"]);
        assert_eq!(names(Kind::WithCore)[..3], ["time_s", "set_point", "follow_scenario"]);
    }
}
