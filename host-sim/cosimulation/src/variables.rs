//! The variables of a unit. A variable's reference is its index in the list.

use super::Kind;
use thermyo_record::units::{Unit, unit_of};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Variable {
    /// Name of the variable; for an output, the column of the trace.
    pub name: &'static str,
    pub description: &'static str,
    pub role: Role,
}

/// Source of a variable's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    Time,
    /// The importer, before the start: a Boolean.
    Parameter,
    /// The importer, between two steps.
    Input,
    /// The importer, between two steps: a share of time from 0 to 1.
    Opening,
    Plant,
    /// The board, once per step.
    Sampled,
}

/// Reference of the first input; the others follow.
pub const FIRST_INPUT: u32 = 1;

const TIME_S: Variable = Variable { name: "time_s", description: "Time", role: Role::Time };

const OPENINGS: [Variable; 2] = [
    opening("duty_in", "Share of the PWM period for which the inlet is open, 0 to 1"),
    opening("duty_out", "Share of the PWM period for which the outlet is open, 0 to 1"),
];

pub const SET_POINT: &str = "set_point";

const DRIVE: [Variable; 2] = [
    input(SET_POINT, "Set point of the scenario's drive, where follow_scenario is false"),
    Variable {
        name: "follow_scenario",
        description: "The scenario's drive gives the set points; false: the input set_point does",
        role: Role::Parameter,
    },
];

pub const ANGLE: &str = "angle_reference_rad";
pub const STIFFNESS: &str = "stiffness_reference_n_m_rad";

/// Inputs of a joint's plant.
const JOINT_OPENINGS: [Variable; 5] = [
    opening("a_duty_in", "Share of the PWM period for which the inlet of muscle a is open"),
    opening("a_duty_out", "Share of the PWM period for which the outlet of muscle a is open"),
    opening("b_duty_in", "Share of the PWM period for which the inlet of muscle b is open"),
    opening("b_duty_out", "Share of the PWM period for which the outlet of muscle b is open"),
    input("load_n_m", "Torque from outside, positive towards growing angles"),
];

/// Inputs of a joint's core.
const JOINT_DRIVE: [Variable; 4] = [
    input(ANGLE, "Set point of the angle, where follow_scenario is false"),
    input(STIFFNESS, "Set point of the stiffness, where follow_scenario is false"),
    input("load_n_m", "Torque from outside, where follow_scenario is false"),
    Variable {
        name: "follow_scenario",
        description: "The scenario's drive gives set points and torque; false: the inputs do",
        role: Role::Parameter,
    },
];

/// Outputs of both muscles of a joint.
macro_rules! of_both {
    ($($role:ident $name:literal $text:literal,)*) => {
        [
            $($role(concat!("a_", $name), concat!($text, " of muscle a")),)*
            $($role(concat!("b_", $name), concat!($text, " of muscle b")),)*
        ]
    };
}

const OF_ARM: [Variable; 4] = [
    plant("angle_rad", "Angle of the joint"),
    plant("speed_rad_s", "Speed of the joint"),
    plant("torque_n_m", "Torque of both tendons on the pulley"),
    plant("stiffness_n_m_rad", "Stiffness of the gas behind shut valves"),
];

const OF_MUSCLES: [Variable; 12] = of_both! {
    plant "pressure_pa" "Absolute pressure of the gas",
    plant "length_m" "Length",
    plant "tension_n" "Tension of the tendon",
    plant "gas_temperature_k" "Mean temperature of the gas",
    plant "wall_temperature_k" "Mean temperature of the wall",
    sampled "sensor_gas_k" "Reading of the sensor in the gas",
};

const OF_JOINT_CORE: [Variable; 10] = [
    sampled("measured_angle_rad", "Angle as the core reads it"),
    sampled("estimated_speed_rad_s", "Estimated speed"),
    sampled("estimated_torque_n_m", "Estimated torque of both muscles"),
    sampled("estimated_stiffness_n_m_rad", "Estimated stiffness"),
    sampled("disturbance_n_m", "Torque that the core finds unexplained"),
    sampled("reference_rad", "Reference of the angle, after its limits"),
    sampled("step", "Number of the core's step"),
    sampled("faults", "Faults of the joint, one bit each"),
    sampled("mode", "Mode of the core, by its number"),
    sampled("limited", "1 where the set point asks for more than the pressures give"),
];

const OF_MUSCLE_CORES: [Variable; 24] = of_both! {
    sampled "duty_in" "Share of the PWM period for which the inlet is open",
    sampled "duty_out" "Share of the PWM period for which the outlet is open",
    sampled "estimate_k" "Estimated temperature of the gas",
    sampled "estimate_sd_k" "Standard deviation of the estimate",
    sampled "estimate_valid" "1 where the estimate is to be relied on",
    sampled "wall_estimate_k" "Estimated temperature of the wall",
    sampled "sensor_estimate_k" "Estimated temperature of the sensor's element",
    sampled "mass_estimate_kg" "Estimated mass of the gas",
    sampled "heat_scale" "Estimated factor on the configured heat transfer",
    sampled "sensor_lag_s" "Estimated lag of the sensor in the gas",
    sampled "measured_pressure_pa" "Absolute pressure as the core reads it",
    sampled "faults" "Faults, one bit each,",
};

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

const fn opening(name: &'static str, description: &'static str) -> Variable {
    Variable { name, description, role: Role::Opening }
}

const fn plant(name: &'static str, description: &'static str) -> Variable {
    Variable { name, description, role: Role::Plant }
}

const fn sampled(name: &'static str, description: &'static str) -> Variable {
    Variable { name, description, role: Role::Sampled }
}

/// Variables of one muscle or vessel.
pub fn of_muscle(kind: Kind) -> Vec<Variable> {
    match kind {
        Kind::Plant => [&[TIME_S], &OPENINGS[..], &OF_PLANT].concat(),
        Kind::WithCore => [&[TIME_S], &DRIVE[..], &OF_PLANT, &OF_CORE].concat(),
    }
}

/// Variables of a joint.
pub fn of_joint(kind: Kind) -> Vec<Variable> {
    match kind {
        Kind::Plant => [&[TIME_S], &JOINT_OPENINGS[..], &OF_ARM, &OF_MUSCLES].concat(),
        Kind::WithCore => {
            [&[TIME_S], &JOINT_DRIVE[..], &OF_ARM, &OF_MUSCLES, &OF_JOINT_CORE, &OF_MUSCLE_CORES]
                .concat()
        }
    }
}

impl Variable {
    /// The unit in the suffix of the name; none for a ratio, a count or a flag.
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
            for (variables, columns) in [
                (of_muscle(kind), &thermyo_record::trace::COLUMNS[..]),
                (of_joint(kind), &thermyo_joint::COLUMNS[..]),
            ] {
                for variable in variables {
                    let is_output = matches!(variable.role, Role::Plant | Role::Sampled);
                    assert!(!is_output || columns.contains(&variable.name), "{}", variable.name);
                }
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
    fn the_inputs_come_first() {
        for kind in Kind::ALL {
            for variables in [of_muscle(kind), of_joint(kind)] {
                let is_input =
                    |variable: &&Variable| matches!(variable.role, Role::Input | Role::Opening);
                let inputs = variables.iter().filter(is_input).count();
                let first = FIRST_INPUT as usize;
                assert!(variables[first..first + inputs].iter().all(|v| is_input(&v)));
            }
        }
    }
}
