//! The scenario: everything that one run needs, in SI, with a default for every key.
//!
//! The field names are the TOML keys. [`super::schema`] holds unit, range and meaning of each;
//! the defaults are here, in the `Default` implementations, and nowhere else.

use super::faults::Faults;
use model_core::config::{ControllerConfig, EstimatorConfig};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// A complete scenario. `[believed]` has been split off before: see [`super::Loaded`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
pub struct Scenario {
    /// Length of the run, time step, seed.
    pub run: Run,
    /// The gas in the muscle or vessel.
    pub gas: Gas,
    /// The surroundings.
    pub ambient: Ambient,
    /// The compressed-air supply behind the inlet valve.
    pub supply: Supply,
    /// What is simulated, and how finely.
    pub plant: Plant,
    /// The McKibben muscle.
    pub muscle: Muscle,
    /// The rigid vessel, or a vessel with a prescribed piston.
    pub vessel: Vessel,
    /// Coefficients of the paper's blended pressure equation (9), (12).
    pub paper: Paper,
    /// Heat transfer from gas to wall and from wall to ambient.
    pub heat: Heat,
    /// The wall: bladder and braid, or the vessel's metal.
    pub wall: Wall,
    /// Friction of braid and bladder.
    pub friction: Friction,
    /// What the muscle pulls.
    pub load: Load,
    /// Inlet and outlet valve (ISO 6358).
    pub valve: Valve,
    /// Tube between valve and muscle (`full` only).
    pub tube: Tube,
    /// Nozzle of a vessel.
    pub orifice: Orifice,
    /// The set point that drives the run.
    pub drive: Drive,
    /// Sensors and their ranges.
    pub sensor: Sensors,
    /// Estimator tuning, the core's own.
    pub estimator: EstimatorConfig,
    /// Controller tuning, the core's own.
    pub controller: ControllerConfig,
    /// Line between host and board.
    pub link: Link,
    /// Faults that the run injects.
    pub faults: Faults,
    /// What `thermyo identify` fits.
    pub identify: Identify,
}

impl Scenario {
    /// Whether the plant is a muscle with zones, wall layers and real valves.
    pub fn is_full_muscle(&self) -> bool {
        self.plant.kind == PlantKind::Muscle && self.plant.model == PlantModel::Full
    }
}

/// Length of the run, time step, seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Run {
    /// Simulated time \[s\].
    pub duration_s: f64,
    /// Step of the core and of the exchange between plant and board \[s\].
    pub step_s: f64,
    /// Seed of every random number of the run.
    pub seed: u64,
    /// One trace row per that many steps.
    pub log_every: u64,
}

impl Default for Run {
    fn default() -> Self {
        Self { duration_s: 100.0, step_s: 0.001, seed: 1, log_every: 10 }
    }
}

/// Ideal gas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Gas {
    /// Specific gas constant R \[J/(kg K)\].
    pub gas_constant_j_kg_k: f64,
    /// Ratio of specific heats k \[-\].
    pub heat_capacity_ratio: f64,
}

impl Default for Gas {
    fn default() -> Self {
        Self { gas_constant_j_kg_k: 287.05, heat_capacity_ratio: 1.4 }
    }
}

/// The surroundings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ambient {
    /// Absolute pressure \[Pa\].
    pub pressure_pa: f64,
    /// Temperature \[K\].
    pub temperature_k: f64,
}

impl Default for Ambient {
    fn default() -> Self {
        Self { pressure_pa: 101_325.0, temperature_k: 298.0 }
    }
}

/// The compressed-air supply.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Supply {
    /// Absolute pressure at no flow \[Pa\].
    pub pressure_pa: f64,
    /// Temperature of the gas that flows in \[K\].
    pub temperature_k: f64,
    /// Regulator droop: pressure lost per mass flow \[Pa s/kg\] (`full` only).
    pub droop_pa_s_kg: f64,
}

impl Default for Supply {
    fn default() -> Self {
        Self { pressure_pa: 700_000.0, temperature_k: 298.0, droop_pa_s_kg: 2.0e7 }
    }
}

/// Which plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlantKind {
    /// A McKibben muscle.
    Muscle,
    /// A rigid vessel, or one with a prescribed volume.
    Vessel,
}

/// How finely the plant is simulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlantModel {
    /// Axial zones, wall layers, moving mass, switching valves.
    Full,
    /// One zone, quasi-static load, ideal valves.
    Lumped,
    /// The paper's eq. (12).
    Paper,
}

/// What is simulated.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Plant {
    /// Muscle or vessel.
    pub kind: PlantKind,
    /// Fidelity. A vessel has one zone in every one; `paper` applies eq. (9) to it.
    pub model: PlantModel,
    /// Absolute pressure at the start \[Pa\].
    pub initial_pressure_pa: f64,
    /// Temperature of gas, wall and sensors at the start \[K\].
    pub initial_temperature_k: f64,
}

impl Default for Plant {
    fn default() -> Self {
        Self {
            kind: PlantKind::Muscle,
            model: PlantModel::Full,
            initial_pressure_pa: 120_000.0,
            initial_temperature_k: 298.0,
        }
    }
}

/// The McKibben muscle. Either (`thread_length_m`, `turns`) or (`diameter_m`, `braid_angle_deg`)
/// with `rest_length_m` say its geometry; after loading all five are filled in.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Muscle {
    /// Thread length b \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub thread_length_m: Option<f64>,
    /// Thread turns n \[-\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turns: Option<f64>,
    /// Length at rest, also the longest length: the load rests on a stop there \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rest_length_m: Option<f64>,
    /// Diameter at rest \[m\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diameter_m: Option<f64>,
    /// Angle of the threads to the axis at rest \[deg\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub braid_angle_deg: Option<f64>,
    /// Axial zones of gas and wall (`full` only).
    pub zones: usize,
    /// Stiffness of the bladder against contraction \[N/m\].
    pub bladder_stiffness_n_m: f64,
    /// Volume of end fittings, not swept by the braid \[m3\].
    pub dead_volume_m3: f64,
}

impl Default for Muscle {
    fn default() -> Self {
        Self {
            thread_length_m: None,
            turns: None,
            rest_length_m: None,
            diameter_m: None,
            braid_angle_deg: None,
            zones: 8,
            bladder_stiffness_n_m: 600.0,
            dead_volume_m3: 5.0e-6,
        }
    }
}

/// The vessel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Vessel {
    /// Gas volume; with `volume_csv` only the default for times before its first row \[m3\].
    pub volume_m3: f64,
    /// Inner surface \[m2\].
    pub surface_m2: f64,
    /// Heat capacity of the wall \[J/K\].
    pub wall_heat_capacity_j_k: f64,
    /// Volume over time: a CSV with the columns time_s,volume_m3.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub volume_csv: Option<PathBuf>,
    /// Added to what `volume_csv` gives: a stroke says nothing about what lies behind it \[m3\].
    pub dead_volume_m3: f64,
    /// Characteristic length for the heat-transfer correlation \[m\].
    pub characteristic_length_m: f64,
}

impl Vessel {
    /// Section that turns its volume into the length that its sensor shows \[m2\].
    pub fn section_m2(&self) -> f64 {
        std::f64::consts::PI / 4.0 * self.characteristic_length_m * self.characteristic_length_m
    }
}

impl Default for Vessel {
    fn default() -> Self {
        Self {
            volume_m3: 0.001,
            surface_m2: 0.06,
            wall_heat_capacity_j_k: 500.0,
            volume_csv: None,
            dead_volume_m3: 0.0,
            characteristic_length_m: 0.1,
        }
    }
}

/// Coefficients of eq. (9), (12), each between 1 (isothermal) and k (adiabatic).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Paper {
    /// Charging.
    pub alpha_in: f64,
    /// Discharging.
    pub alpha_out: f64,
    /// Change of volume.
    pub alpha: f64,
}

impl Default for Paper {
    /// The choice of Richer and Hurmuzlu, the paper's \[1\], for a pneumatic cylinder: charging
    /// close to adiabatic, discharging close to isothermal, the rest between.
    fn default() -> Self {
        Self { alpha_in: 1.1, alpha_out: 1.1, alpha: 1.1 }
    }
}

/// How heat passes between gas and wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HeatModel {
    /// No heat passes.
    Adiabatic,
    /// The gas keeps its initial temperature.
    Isothermal,
    /// `inner_w_m2_k + inner_per_flow * inflow`.
    Constant,
    /// Nusselt correlations for filling and discharging.
    Correlation,
}

/// Heat transfer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Heat {
    /// Gas to wall.
    pub model: HeatModel,
    /// Gas to wall: factor on what `model` gives \[-\].
    pub scale: f64,
    /// Gas to wall, still gas \[W/(m2 K)\].
    pub inner_w_m2_k: f64,
    /// Gas to wall, gained per inflow (forced convection) \[W/(m2 K) per kg/s\].
    pub inner_per_flow: f64,
    /// Wall to ambient, muscle at rest \[W/(m2 K)\].
    pub outer_w_m2_k: f64,
    /// Wall to ambient, gained per contraction speed \[W/(m2 K) per m/s\].
    pub outer_per_speed: f64,
}

impl Default for Heat {
    fn default() -> Self {
        Self {
            model: HeatModel::Constant,
            scale: 1.0,
            inner_w_m2_k: 90.0,
            inner_per_flow: 1.0e5,
            outer_w_m2_k: 8.0,
            outer_per_speed: 60.0,
        }
    }
}

/// The muscle's wall.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Wall {
    /// Heat capacity of bladder and braid together \[J/K\].
    pub heat_capacity_j_k: f64,
    /// Part of it that is the braid, the outer layer \[-\] (`full` only).
    pub outer_fraction: f64,
    /// Conductance from the inner to the outer layer, whole surface \[W/K\] (`full` only).
    pub conductance_w_k: f64,
}

impl Default for Wall {
    fn default() -> Self {
        Self { heat_capacity_j_k: 65.0, outer_fraction: 0.3, conductance_w_k: 3.0 }
    }
}

/// Friction of braid and bladder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Friction {
    /// Coulomb friction at the reference temperature \[N\].
    pub force_n: f64,
    /// Reference temperature of `force_n` \[K\].
    pub reference_temperature_k: f64,
    /// beta in F = F_ref exp(-beta (T_w - T_ref)) \[1/K\].
    pub softening_per_k: f64,
    /// Share of the friction heat that goes into the wall \[-\]; the rest leaves to ambient.
    pub heat_fraction: f64,
    /// Stribeck: force at standstill above `force_n` \[N\] (`full` only).
    pub stribeck_force_n: f64,
    /// Stribeck: speed at which that surplus has fallen to 1/e \[m/s\] (`full` only).
    pub stribeck_speed_m_s: f64,
    /// Viscous part \[N s/m\] (`full` only).
    pub viscous_n_s_m: f64,
    /// Stiffness of the presliding bristles \[N/m\] (`full` only).
    pub presliding_stiffness_n_m: f64,
}

impl Default for Friction {
    fn default() -> Self {
        Self {
            force_n: 15.0,
            reference_temperature_k: 298.0,
            softening_per_k: 0.01,
            heat_fraction: 0.9,
            stribeck_force_n: 4.0,
            stribeck_speed_m_s: 0.005,
            viscous_n_s_m: 40.0,
            presliding_stiffness_n_m: 40_000.0,
        }
    }
}

/// What the muscle pulls against.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LoadKind {
    /// A constant force.
    Isotonic,
    /// A fixed length.
    Isometric,
    /// A hanging mass: its weight, and in `full` its inertia.
    Mass,
}

/// The load.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Load {
    /// Kind of load.
    pub kind: LoadKind,
    /// Isotonic: the force \[N\].
    pub force_n: f64,
    /// Isometric: the length held \[m\].
    pub length_m: f64,
    /// Mass: the mass \[kg\]. Isotonic in `full`: what moves with the muscle's end.
    pub mass_kg: f64,
}

impl Default for Load {
    fn default() -> Self {
        Self { kind: LoadKind::Isotonic, force_n: 100.0, length_m: 0.26, mass_kg: 2.0 }
    }
}

/// Inlet and outlet valve, ISO 6358.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Valve {
    /// Sonic conductance C \[m3/(s Pa)\] at ANR.
    pub conductance_m3_s_pa: f64,
    /// Critical pressure ratio b \[-\].
    pub critical_ratio: f64,
    /// Time from closed to open, and from open to closed \[s\].
    pub switch_time_s: f64,
    /// Delay between the pin and the first movement \[s\].
    pub dead_time_s: f64,
    /// PWM frequency \[Hz\].
    pub pwm_hz: f64,
}

impl Default for Valve {
    fn default() -> Self {
        Self {
            conductance_m3_s_pa: 4.0e-9,
            critical_ratio: 0.3,
            switch_time_s: 0.002,
            dead_time_s: 0.001,
            pwm_hz: 100.0,
        }
    }
}

/// Tube between the valves and the muscle's port.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tube {
    /// Volume \[m3\].
    pub volume_m3: f64,
    /// Sonic conductance of tube and port \[m3/(s Pa)\].
    pub conductance_m3_s_pa: f64,
}

impl Default for Tube {
    fn default() -> Self {
        Self { volume_m3: 6.0e-6, conductance_m3_s_pa: 3.0e-8 }
    }
}

/// Nozzle of a vessel: isentropic, choked below the critical ratio.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Orifice {
    /// Diameter \[m\].
    pub diameter_m: f64,
    /// Discharge coefficient \[-\].
    pub discharge_coefficient: f64,
}

impl Default for Orifice {
    fn default() -> Self {
        Self { diameter_m: 0.001, discharge_coefficient: 0.84 }
    }
}

/// What drives the run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DriveKind {
    /// Constant inflow for half of the period, the same outflow for the other half.
    MassFlow,
    /// Inlet duty (positive) or outlet duty (negative) from the profile.
    Duty,
    /// Pressure set point.
    Pressure,
    /// Contraction set point.
    Contraction,
    /// Vessel: nozzle open to ambient. Muscle: outlet open.
    Discharge,
    /// Vessel: nozzle open to the supply. Muscle: inlet open.
    Fill,
    /// Everything closed.
    Closed,
}

/// The set point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Drive {
    /// Kind of set point.
    pub kind: DriveKind,
    /// Period of the cycle \[s\].
    pub period_s: f64,
    /// Mass flow in and out \[kg/s\].
    pub flow_kg_s: f64,
    /// Pressure set point \[Pa\].
    pub pressure_pa: f64,
    /// Contraction set point, a fraction of the rest length \[-\].
    pub contraction: f64,
    /// Set point over time: a CSV with the columns time_s,value.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub profile_csv: Option<PathBuf>,
}

impl Default for Drive {
    fn default() -> Self {
        Self {
            kind: DriveKind::MassFlow,
            period_s: 5.0,
            flow_kg_s: 3.6e-4,
            pressure_pa: 300_000.0,
            contraction: 0.1,
            profile_csv: None,
        }
    }
}

/// The four sensors.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
pub struct Sensors {
    /// Pt1000 foil in the gas.
    pub gas: GasSensor,
    /// Sensor in the braided wall.
    pub wall: WallSensor,
    /// Absolute pressure.
    pub pressure: PressureSensor,
    /// Muscle length.
    pub length: LengthSensor,
}

/// Pt1000 foil in the gas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GasSensor {
    /// Lag \[s\].
    pub time_constant_s: f64,
    /// Noise of one conversion, standard deviation \[K\].
    pub noise_k: f64,
    /// Middle of the foil, 0 at the port, 1 at the closed end \[-\] (`full` only).
    pub position: f64,
    /// Part of the muscle's length that the foil averages over \[-\] (`full` only).
    pub span: f64,
    /// Lowest temperature that the front end resolves \[K\].
    pub range_min_k: f64,
    /// Highest temperature that the front end resolves \[K\].
    pub range_max_k: f64,
    /// n in tau ~ (density at the start / density)^n: the lag of a sensor that the gas film around
    /// it slows. 0.5 for free convection and for laminar flow across it \[-\].
    pub density_exponent: f64,
    /// Lag of the light housing around the foil, in series with it \[s\] (`full` only).
    pub housing_time_constant_s: f64,
}

impl Default for GasSensor {
    fn default() -> Self {
        Self {
            time_constant_s: 3.0,
            noise_k: 0.05,
            position: 0.5,
            span: 0.25,
            range_min_k: 270.0,
            range_max_k: 330.0,
            density_exponent: 0.0,
            housing_time_constant_s: 0.2,
        }
    }
}

/// Sensor in the braided wall.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WallSensor {
    /// Lag \[s\].
    pub time_constant_s: f64,
    /// Noise of one reading, standard deviation \[K\].
    pub noise_k: f64,
    /// Where along the muscle, 0 at the port, 1 at the closed end \[-\] (`full` only).
    pub position: f64,
}

impl Default for WallSensor {
    fn default() -> Self {
        Self { time_constant_s: 3.0, noise_k: 0.05, position: 0.5 }
    }
}

/// Absolute pressure sensor, ratiometric, 10 to 90 % of the reference over its range.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PressureSensor {
    /// Lag \[s\].
    pub time_constant_s: f64,
    /// Noise of one conversion, standard deviation \[Pa\].
    pub noise_pa: f64,
    /// Full scale \[Pa\]; the range starts at 0.
    pub range_pa: f64,
}

impl Default for PressureSensor {
    fn default() -> Self {
        Self { time_constant_s: 0.0005, noise_pa: 150.0, range_pa: 700_000.0 }
    }
}

/// Length potentiometer, 0 to `range_m`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LengthSensor {
    /// Lag \[s\].
    pub time_constant_s: f64,
    /// Noise of one conversion, standard deviation \[m\].
    pub noise_m: f64,
    /// Full scale \[m\]; the range starts at 0.
    pub range_m: f64,
}

impl Default for LengthSensor {
    fn default() -> Self {
        Self { time_constant_s: 0.0005, noise_m: 2.0e-5, range_m: 0.4 }
    }
}

/// Line between host and board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Link {
    /// Silence of the host after which the board vents \[s\]; 0: never.
    pub timeout_s: f64,
}

impl Default for Link {
    fn default() -> Self {
        Self { timeout_s: 0.5 }
    }
}

/// What `thermyo identify` fits, and from where it starts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Identify {
    /// Paths of the scenario's keys whose values are fitted, such as `heat.inner_w_m2_k`.
    pub parameters: Vec<String>,
    /// Measured columns that the plant is compared with; empty: all of them that the data has.
    pub columns: Vec<String>,
    /// Starts of the search: the scenario's own values, and others drawn around them.
    pub starts: u64,
    /// The others lie within this factor of the scenario's values, either way \[-\].
    pub spread: f64,
}

impl Default for Identify {
    fn default() -> Self {
        Self { parameters: Vec::new(), columns: Vec::new(), starts: 6, spread: 2.0 }
    }
}
