//! The scenario: all inputs of one run, in SI, with a default for every key.
//!
//! Field names are the TOML keys; [`super::declare`] explains how to declare tables and add
//! parameters.

mod air;
mod chambers;
mod faults;
mod losses;
mod plant;
mod run;
mod sensors;

pub use air::*;
pub use chambers::{Acts, Cylinder, Table as ChamberTable};
pub use faults::*;
pub use losses::*;
pub use plant::*;
pub use run::*;
pub use sensors::*;

use super::declare::keys_of;
use super::key::Table;
use model_core::config::{ControllerConfig, EstimatorConfig};
use model_core::sensing::gas::{Max31865, Ntc};
use model_core::sensing::pressure::Mpr;
use serde::{Deserialize, Serialize};

/// A complete scenario, with a field for each table of [`TABLES`]. `[believed]` has already been split off: see
/// `thermyo_setup::Loaded`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
pub struct Scenario {
    pub run: Run,
    pub gas: Gas,
    pub ambient: Ambient,
    pub supply: Supply,
    pub plant: Plant,
    pub muscle: Muscle,
    pub vessel: Vessel,
    pub cylinder: Cylinder,
    pub table: ChamberTable,
    /// Rows of the table's file: length \[m\], volume \[m3\], force \[N\].
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub table_rows: Vec<[f64; 3]>,
    pub paper: Paper,
    pub heat: Heat,
    /// Gas along the muscle, as configured in the core.
    pub zones: Zones,
    pub wall: Wall,
    pub friction: Friction,
    pub load: Load,
    pub valve: Valve,
    pub leak: Leak,
    pub tube: Tube,
    pub orifice: Orifice,
    pub drive: Drive,
    pub adc: Adc,
    pub sensor: Sensors,
    pub estimator: EstimatorConfig,
    pub controller: ControllerConfig,
    pub link: Link,
    pub faults: Faults,
    pub identify: Identify,
}

/// Every table, in the order of [`Scenario`].
pub static TABLES: &[Table] = &[
    Run::TABLE,
    Gas::TABLE,
    Ambient::TABLE,
    Supply::TABLE,
    Plant::TABLE,
    Muscle::TABLE,
    Vessel::TABLE,
    Cylinder::TABLE,
    ChamberTable::TABLE,
    Paper::TABLE,
    Heat::TABLE,
    Zones::TABLE,
    Wall::TABLE,
    Friction::TABLE,
    Load::TABLE,
    Valve::TABLE,
    Leak::TABLE,
    Tube::TABLE,
    Orifice::TABLE,
    Drive::TABLE,
    Adc::TABLE,
    GasSensor::TABLE,
    WallSensor::TABLE,
    PressureSensor::TABLE,
    LengthSensor::TABLE,
    Table::new(
        "sensor.ntc",
        "thermistor, where sensor.gas.kind = \"ntc\"",
        &keys_of::<{ Ntc::PARAMETERS.len() }>(Ntc::PARAMETERS),
    )
    .believed(),
    Table::new(
        "sensor.max31865",
        "platinum resistor on a MAX31865, where sensor.gas.kind = \"max31865\"",
        &keys_of::<{ Max31865::PARAMETERS.len() }>(Max31865::PARAMETERS),
    )
    .believed(),
    Table::new(
        "sensor.mpr",
        "Honeywell MPR, where sensor.pressure.kind = \"mpr\"",
        &keys_of::<{ Mpr::PARAMETERS.len() }>(Mpr::PARAMETERS),
    )
    .believed(),
    Table::new(
        "estimator",
        "estimator tuning; a drift is what a random walk gains in one second",
        &keys_of::<{ EstimatorConfig::PARAMETERS.len() }>(EstimatorConfig::PARAMETERS),
    )
    .believed(),
    Table::new(
        "controller",
        "controller tuning",
        &keys_of::<{ ControllerConfig::PARAMETERS.len() }>(ControllerConfig::PARAMETERS),
    )
    .believed(),
    Link::TABLE,
    FaultWindow::TABLE,
    Identify::TABLE,
];

impl Scenario {
    /// Whether the plant has zones, wall layers, moving mass and real valves.
    pub fn moves_in_full(&self) -> bool {
        self.plant.kind != PlantKind::Vessel && self.plant.model == PlantModel::Full
    }

    /// PWM period of a board and of its valves, in steps of the core, which counts them.
    pub fn pwm_period_steps(&self) -> u16 {
        (1.0 / (self.valve.pwm_hz * self.run.step_s)).round().max(1.0) as u16
    }

    /// PWM period \[s\].
    pub fn pwm_period_s(&self) -> f64 {
        f64::from(self.pwm_period_steps()) * self.run.step_s
    }
}
