//! Columns of the records that are compared, of one muscle or of a joint, with their names and units.

use crate::run_report;
use std::f64::consts::PI;
use thermyo_files::number::in_unit;
use thermyo_files::table::Table;
use thermyo_files::units::{Unit, UnitSystem, si_of_column};
use thermyo_record::trace::COMPARABLE;

/// Columns of a joint in which two records of the same time can be compared.
const JOINT: [&str; 25] = [
    "angle_rad",
    "stiffness_n_m_rad",
    "torque_n_m",
    "speed_rad_s",
    "load_n_m",
    "measured_angle_rad",
    "disturbance_n_m",
    "a_pressure_pa",
    "b_pressure_pa",
    "a_length_m",
    "b_length_m",
    "a_tension_n",
    "b_tension_n",
    "a_gas_temperature_k",
    "b_gas_temperature_k",
    "a_estimate_k",
    "b_estimate_k",
    "a_sensor_gas_k",
    "b_sensor_gas_k",
    "a_wall_temperature_k",
    "b_wall_temperature_k",
    "a_duty_in",
    "b_duty_in",
    "a_duty_out",
    "b_duty_out",
];

const DEGREES: Unit = Unit { symbol: "deg", factor: 180.0 / PI };
const NEWTON_METRES: Unit = Unit { symbol: "N m", factor: 1.0 };

/// Columns of the mechanism: name, unit of the tables, and SI symbol.
const MECHANISM: [(&str, &str, Unit, &str); 7] = [
    ("angle_rad", "angle", DEGREES, "rad"),
    ("measured_angle_rad", "angle, as read", DEGREES, "rad"),
    ("speed_rad_s", "speed", Unit { symbol: "deg/s", factor: 180.0 / PI }, "rad/s"),
    ("stiffness_n_m_rad", "stiffness", Unit { symbol: "N m/rad", factor: 1.0 }, "N m/rad"),
    ("torque_n_m", "torque of the muscles", NEWTON_METRES, "N m"),
    ("load_n_m", "torque of the load", NEWTON_METRES, "N m"),
    ("disturbance_n_m", "torque that nothing configured explains", NEWTON_METRES, "N m"),
];

/// A heading, and the columns drawn below it.
type Drawn = (&'static str, &'static [&'static str]);

const MUSCLE_SECTIONS: [Drawn; 3] = [
    ("Temperature", &["gas_temperature_k", "estimate_k", "sensor_gas_k", "wall_temperature_k"]),
    ("Pressure and motion", &["pressure_pa", "length_m", "volume_m3"]),
    ("Air", &["mass_kg", "flow_in_kg_s", "flow_out_kg_s", "duty_in", "duty_out"]),
];

const JOINT_SECTIONS: [Drawn; 4] = [
    ("Joint", &["angle_rad", "stiffness_n_m_rad", "torque_n_m", "load_n_m", "disturbance_n_m"]),
    ("Muscles", &["a_pressure_pa", "b_pressure_pa", "a_tension_n", "b_tension_n"]),
    ("Valves", &["a_duty_in", "a_duty_out", "b_duty_in", "b_duty_out"]),
    (
        "Temperature",
        &["a_gas_temperature_k", "a_estimate_k", "b_gas_temperature_k", "b_estimate_k"],
    ),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subject {
    /// One muscle, or a vessel.
    Muscle,
    /// Two muscles on a pulley.
    Joint,
}

impl Subject {
    /// The subject of a record: only a joint has an angle.
    pub fn of(table: &Table) -> Self {
        match table.columns().iter().any(|column| column.name == "angle_rad") {
            true => Self::Joint,
            false => Self::Muscle,
        }
    }

    pub(super) fn columns(self) -> &'static [&'static str] {
        match self {
            Self::Muscle => &COMPARABLE,
            Self::Joint => &JOINT,
        }
    }

    pub(super) fn sections(self) -> &'static [Drawn] {
        match self {
            Self::Muscle => &MUSCLE_SECTIONS,
            Self::Joint => &JOINT_SECTIONS,
        }
    }

    /// Columns of the separate drawing.
    pub(super) fn drawn(self) -> &'static [&'static str] {
        match self {
            Self::Muscle => &["pressure_pa", "estimate_k", "sensor_gas_k", "length_m"],
            Self::Joint => &["angle_rad", "stiffness_n_m_rad", "a_pressure_pa", "b_pressure_pa"],
        }
    }
}

/// The muscle of a joint's column, and the column without it.
fn of_side(column: &str) -> Option<(&str, &str)> {
    column.split_once('_').filter(|(side, _)| ["a", "b"].contains(side))
}

pub(super) fn label(column: &str) -> String {
    let of_mechanism = MECHANISM.iter().find(|(name, ..)| *name == column);
    match (of_mechanism, of_side(column)) {
        (Some((_, label, ..)), _) => (*label).to_owned(),
        (None, Some((side, "tension_n"))) => format!("tension of muscle {side}"),
        (None, Some((side, of))) => format!("{} of muscle {side}", run_report::label(of)),
        (None, None) => run_report::label(column).to_owned(),
    }
}

/// The unit in which differences of a column are shown.
pub(super) fn unit(column: &str, units: UnitSystem) -> Unit {
    let of_mechanism = MECHANISM.iter().find(|(name, ..)| *name == column);
    let si = of_mechanism.map_or_else(|| si_of_column(column), |(.., si)| si);
    match units {
        UnitSystem::Si => Unit { symbol: si, factor: 1.0 },
        UnitSystem::Practical => {
            of_mechanism.map_or_else(|| Unit::of_column(column), |(_, _, unit, _)| *unit)
        }
    }
}

/// A difference of two values of a column with its unit.
pub(super) fn text(difference: f64, column: &str, units: UnitSystem) -> String {
    in_unit(difference, unit(column, units))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_a_joint_are_in_its_trace() {
        for column in JOINT {
            assert!(thermyo_joint::COLUMNS.contains(&column), "{column}");
        }
        for (_, columns) in JOINT_SECTIONS {
            assert!(columns.iter().all(|column| JOINT.contains(column)), "{columns:?}");
        }
    }

    #[test]
    fn a_torque_is_no_spring_rate() {
        for (column, practical, si) in [
            ("torque_n_m", "0.500 N m", "0.500 N m"),
            ("angle_rad", "28.6 deg", "0.500 rad"),
            ("speed_rad_s", "28.6 deg/s", "0.500 rad/s"),
            ("a_tension_n", "0.500 N", "0.500 N"),
            ("b_pressure_pa", "5.00×10⁻⁴ kPa", "0.500 Pa"),
            ("a_duty_in", "0.500", "0.500"),
        ] {
            assert_eq!(text(0.5, column, UnitSystem::Si), si, "{column}");
            assert_eq!(text(0.5, column, UnitSystem::Practical), practical, "{column}");
        }
        assert_eq!(label("b_gas_temperature_k"), "gas (plant) of muscle b");
    }
}
