//! Everything that the core is told before it starts, and what each value may be.

use crate::physics::gas::Gas;
use crate::physics::geometry::{Braid, Friction, Muscle};
use crate::physics::heat::Heat;
use crate::physics::valve::Valve;
use crate::sensing::front_end::FrontEnd;

/// Configuration of the core. [`Config::default`] is the nominal muscle of the project's scenarios.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Fixed step of the core \[s\].
    pub step_s: f32,
    /// The gas.
    pub gas: Gas,
    /// The surroundings.
    pub ambient: Reservoir,
    /// The supply behind the inlet valve.
    pub supply: Reservoir,
    /// What holds the gas.
    pub body: Body,
    /// Heat transfer and wall.
    pub heat: Heat,
    /// Friction of the muscle.
    pub friction: Friction,
    /// What the muscle pulls against.
    pub load: Load,
    /// Inlet and outlet valve.
    pub valve: Valve,
    /// How the valves are driven.
    pub drive: ValveDrive,
    /// The analog front ends.
    pub front_end: FrontEnd,
    /// The gas sensor's element.
    pub gas_sensor: GasSensor,
    /// Estimator tuning.
    pub estimator: EstimatorConfig,
    /// Controller tuning.
    pub controller: ControllerConfig,
    /// Above this absolute pressure the supervisor vents \[Pa\].
    pub pressure_limit_pa: f32,
    /// Silence of the host after which the supervisor vents what is driven \[s\]; 0: never, the board
    /// goes on alone.
    pub link_timeout_s: f32,
}

/// A reservoir of gas.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub struct Reservoir {
    /// Absolute pressure \[Pa\].
    pub pressure_pa: f32,
    /// Temperature \[K\].
    pub temperature_k: f32,
}

/// What holds the gas.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub enum Body {
    /// A McKibben muscle.
    Muscle(Muscle),
    /// A vessel, or a cylinder: volume = section * length.
    Vessel {
        /// Section \[m2\].
        section_m2: f32,
        /// Inner surface \[m2\].
        surface_m2: f32,
    },
}

/// What the muscle pulls against.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub enum Load {
    /// A constant force \[N\].
    Isotonic {
        /// Force \[N\].
        force_n: f32,
    },
    /// A fixed length \[m\].
    Isometric {
        /// Length \[m\].
        length_m: f32,
    },
}

/// How the valves are driven.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub struct ValveDrive {
    /// PWM period, in steps of the core \[-\].
    pub period_steps: u16,
    /// Shortest pulse worth giving \[s\]: shorter than the switching time it opens partly.
    pub minimum_pulse_s: f32,
    /// Time from closed to open, and from open to closed \[s\].
    pub switch_time_s: f32,
    /// Delay between the pin and the first movement \[s\].
    pub dead_time_s: f32,
}

/// The gas sensor's element.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub struct GasSensor {
    /// Lag of the element \[s\].
    pub time_constant_s: f32,
    /// Lag of the housing between gas and element, in series \[s\].
    pub housing_time_constant_s: f32,
    /// Noise of one conversion, standard deviation \[K\].
    pub noise_k: f32,
}

/// Estimator tuning. Standard deviations; "drift" is what a random walk gains in one second.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub struct EstimatorConfig {
    /// Gas and wall temperature at the start \[K\].
    pub initial_sd_k: f32,
    /// Drift of the gas temperature's error \[K\].
    pub gas_drift_k: f32,
    /// Drift of the wall temperature's error \[K\].
    pub wall_drift_k: f32,
    /// Logarithm of the heat-transfer scale, about the configured one \[-\].
    pub heat_scale_sd: f32,
    /// Logarithm of the sensor's lag, about the configured one \[-\].
    pub lag_sd: f32,
    /// Time in which scale and lag, left alone, return to what is configured \[s\].
    pub memory_s: f32,
    /// What the gas around the foil differs from the mean by, for a second or so \[K\].
    pub place_error_k: f32,
    /// Stated deviation up to which the estimate is marked as valid \[K\].
    pub valid_sd_k: f32,
}

impl EstimatorConfig {
    /// What a lag \[s\] leaves of an error of the gas around the foil, which lasts for a second \[-\].
    pub fn left_by_lag(lag_s: f32) -> f32 {
        const ERROR_S: f32 = 1.0;
        ERROR_S / (lag_s + ERROR_S)
    }

    /// What that lag leaves of [`Self::place_error_k`] in the reading \[K\].
    pub fn reading_bias_k(&self, lag_s: f32) -> f32 {
        self.place_error_k * Self::left_by_lag(lag_s)
    }
}

impl Default for EstimatorConfig {
    fn default() -> Self {
        Self {
            initial_sd_k: 3.0,
            gas_drift_k: 0.1,
            wall_drift_k: 0.05,
            heat_scale_sd: 0.25,
            lag_sd: 0.15,
            memory_s: 100.0,
            place_error_k: 0.87,
            valid_sd_k: 1.0,
        }
    }
}

/// Controller tuning; `docs/control.md` says how each is found.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "link", derive(serde::Serialize, serde::Deserialize))]
pub struct ControllerConfig {
    /// Time in which the pressure loop closes an error \[s\]; at least one PWM period acts.
    pub pressure_loop_s: f32,
    /// Reset time of the pressure loop's integral \[s\].
    pub pressure_reset_s: f32,
    /// Fastest change of the pressure's set point \[Pa/s\].
    pub pressure_rate_pa_s: f32,
    /// Pressure error that is left alone at rest \[Pa\].
    pub pressure_dead_zone_pa: f32,
    /// Time in which the contraction loop closes an error of the gas mass \[s\].
    pub length_loop_s: f32,
    /// Weight of an error of length against one of pressure \[-\]; 1: the gas spring's own.
    pub length_gain: f32,
    /// How far ahead the length error is looked for, by its speed \[s\].
    pub length_lead_s: f32,
    /// Friction compensated, as a share of the Coulomb force \[-\]; above 1 for a Stribeck surplus.
    pub friction_gain: f32,
    /// Load that the loop learns per length error and time \[N/(m s)\].
    pub load_gain_n_m_s: f32,
    /// Largest load that it learns, either way \[N\].
    pub load_limit_n: f32,
    /// Largest length error that it learns from, share of the rest length \[-\].
    pub learning_band: f32,
    /// Natural frequency of the reference \[rad/s\].
    pub reference_rad_s: f32,
    /// Fastest contraction of the reference, share of the rest length \[1/s\].
    pub contraction_rate_per_s: f32,
    /// Largest acceleration of the reference, share of the rest length \[1/s2\].
    pub contraction_acceleration_per_s2: f32,
    /// Length error that is left alone at rest, share of the rest length \[-\].
    pub contraction_dead_zone: f32,
    /// Stiffness with which friction builds up after a turn \[N/m\].
    pub presliding_n_m: f32,
    /// Viscous friction \[N s/m\].
    pub viscous_n_s_m: f32,
    /// What moves with the muscle's end \[kg\].
    pub moving_mass_kg: f32,
}

impl Default for ControllerConfig {
    fn default() -> Self {
        Self {
            pressure_loop_s: 0.014,
            pressure_reset_s: 0.3,
            pressure_rate_pa_s: 1.0e7,
            pressure_dead_zone_pa: 1500.0,
            length_loop_s: 0.014,
            length_gain: 1.0,
            length_lead_s: 0.01,
            friction_gain: 1.03,
            load_gain_n_m_s: 4.0e4,
            load_limit_n: 300.0,
            learning_band: 0.005,
            reference_rad_s: 90.0,
            contraction_rate_per_s: 0.7,
            contraction_acceleration_per_s2: 30.0,
            contraction_dead_zone: 0.0015,
            // Neither is part of the lumped model.
            presliding_n_m: 1.0e5,
            viscous_n_s_m: 0.0,
            moving_mass_kg: 0.0,
        }
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            step_s: 0.001,
            gas: Gas::AIR,
            ambient: Reservoir { pressure_pa: 101_325.0, temperature_k: 298.0 },
            supply: Reservoir { pressure_pa: 700_000.0, temperature_k: 298.0 },
            body: Body::Muscle(Muscle {
                // 300 mm by 20 mm at rest, threads at 23 deg.
                braid: Braid { thread_length_m: 0.325_908_1, turns: 2.026_714 },
                rest_length_m: 0.3,
                bladder_stiffness_n_m: 600.0,
                dead_volume_m3: 5.0e-6,
            }),
            heat: Heat {
                inner_w_m2_k: 90.0,
                inner_per_flow: 1.0e5,
                outer_w_m2_k: 8.0,
                outer_per_speed: 60.0,
                wall_heat_capacity_j_k: 65.0,
            },
            friction: Friction {
                force_n: 15.0,
                reference_temperature_k: 298.0,
                softening_per_k: 0.01,
                heat_fraction: 0.9,
            },
            load: Load::Isotonic { force_n: 100.0 },
            valve: Valve { conductance_m3_s_pa: 4.0e-9, critical_ratio: 0.3 },
            drive: ValveDrive {
                period_steps: 10,
                minimum_pulse_s: 0.001,
                switch_time_s: 0.002,
                dead_time_s: 0.001,
            },
            front_end: FrontEnd {
                pressure_range_pa: 700_000.0,
                pressure_noise_pa: 150.0,
                length_range_m: 0.4,
                gas_min_k: 270.0,
                gas_max_k: 330.0,
                wide_code_lsb: 8.9,
            },
            gas_sensor: GasSensor {
                time_constant_s: 3.0,
                housing_time_constant_s: 0.2,
                noise_k: 0.05,
            },
            estimator: EstimatorConfig::default(),
            controller: ControllerConfig::default(),
            pressure_limit_pa: 0.985 * 700_000.0,
            link_timeout_s: 0.5,
        }
    }
}

/// A value that the core cannot work with.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "link", derive(serde::Serialize))]
pub struct ConfigError {
    /// Which one.
    pub field: &'static str,
    /// What it is.
    pub value: f32,
    /// Smallest value allowed.
    pub minimum: f32,
    /// Largest value allowed.
    pub maximum: f32,
}

impl core::fmt::Display for ConfigError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { field, value, minimum, maximum } = self;
        write!(f, "{field} = {value}: must be from {minimum} to {maximum}")
    }
}

impl core::error::Error for ConfigError {}

impl Config {
    /// Highest absolute pressure that a set point is followed to, a twentieth of the gauge pressure
    /// below the limit: what overshoots on the way there does not trip it \[Pa\].
    pub fn working_limit_pa(&self) -> f32 {
        self.pressure_limit_pa - 0.05 * (self.pressure_limit_pa - self.ambient.pressure_pa)
    }

    /// Checks every value.
    ///
    /// # Errors
    /// The first value that is not a number or lies outside of its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        within("step_s", self.step_s, 1.0e-4, 0.1)?;
        within("gas.gas_constant_j_kg_k", self.gas.gas_constant_j_kg_k, 50.0, 5000.0)?;
        within("gas.heat_capacity_ratio", self.gas.heat_capacity_ratio, 1.01, 1.7)?;
        within("ambient.pressure_pa", self.ambient.pressure_pa, 1.0, 1.0e8)?;
        within("ambient.temperature_k", self.ambient.temperature_k, 100.0, 1000.0)?;
        within("supply.pressure_pa", self.supply.pressure_pa, 1.0, 1.0e8)?;
        within("supply.temperature_k", self.supply.temperature_k, 100.0, 1000.0)?;
        match self.body {
            Body::Muscle(muscle) => {
                let b = muscle.braid.thread_length_m;
                within("muscle.thread_length_m", b, 0.01, 10.0)?;
                within("muscle.turns", muscle.braid.turns, 0.1, 1000.0)?;
                within("muscle.rest_length_m", muscle.rest_length_m, 0.578 * b, 0.999 * b)?;
                within("muscle.bladder_stiffness_n_m", muscle.bladder_stiffness_n_m, 0.0, 1.0e6)?;
                within("muscle.dead_volume_m3", muscle.dead_volume_m3, 0.0, 0.1)?;
            }
            Body::Vessel { section_m2, surface_m2 } => {
                within("vessel.section_m2", section_m2, 1.0e-7, 1.0e5)?;
                within("vessel.surface_m2", surface_m2, 0.0, 1.0e3)?;
            }
        }
        within("heat.inner_w_m2_k", self.heat.inner_w_m2_k, 0.0, 1.0e5)?;
        within("heat.inner_per_flow", self.heat.inner_per_flow, 0.0, 1.0e9)?;
        within("heat.outer_w_m2_k", self.heat.outer_w_m2_k, 0.0, 1.0e5)?;
        within("heat.outer_per_speed", self.heat.outer_per_speed, 0.0, 1.0e6)?;
        within("wall.heat_capacity_j_k", self.heat.wall_heat_capacity_j_k, 0.01, 1.0e9)?;
        within("friction.force_n", self.friction.force_n, 0.0, 1.0e5)?;
        within(
            "friction.reference_temperature_k",
            self.friction.reference_temperature_k,
            100.0,
            1000.0,
        )?;
        within("friction.softening_per_k", self.friction.softening_per_k, -0.2, 0.2)?;
        within("friction.heat_fraction", self.friction.heat_fraction, 0.0, 1.0)?;
        match self.load {
            Load::Isotonic { force_n } => within("load.force_n", force_n, 0.0, 1.0e6)?,
            Load::Isometric { length_m } => within("load.length_m", length_m, 0.001, 10.0)?,
        }
        within("valve.conductance_m3_s_pa", self.valve.conductance_m3_s_pa, 1.0e-13, 1.0e-3)?;
        within("valve.critical_ratio", self.valve.critical_ratio, 0.01, 0.99)?;
        within("valve.period_steps", f32::from(self.drive.period_steps), 1.0, 1000.0)?;
        within("valve.minimum_pulse_s", self.drive.minimum_pulse_s, 0.0, 0.1)?;
        within("valve.switch_time_s", self.drive.switch_time_s, 0.0, 0.1)?;
        within("valve.dead_time_s", self.drive.dead_time_s, 0.0, 0.1)?;
        let front_end = &self.front_end;
        within("sensor.pressure.range_pa", front_end.pressure_range_pa, 1.0e3, 1.0e9)?;
        within("sensor.pressure.noise_pa", front_end.pressure_noise_pa, 0.0, 1.0e8)?;
        within("sensor.length.range_m", front_end.length_range_m, 0.001, 100.0)?;
        within("sensor.gas.range_min_k", front_end.gas_min_k, 73.0, 800.0)?;
        within("sensor.gas.range_max_k", front_end.gas_max_k, front_end.gas_min_k + 1.0, 1100.0)?;
        within("adc.wide_code_lsb", front_end.wide_code_lsb, 0.0, 100.0)?;
        within("sensor.gas.time_constant_s", self.gas_sensor.time_constant_s, 0.001, 1.0e3)?;
        let housing_s = self.gas_sensor.housing_time_constant_s;
        within("sensor.gas.housing_time_constant_s", housing_s, 0.0, 1.0e3)?;
        within("sensor.gas.noise_k", self.gas_sensor.noise_k, 0.0, 100.0)?;
        let estimator = &self.estimator;
        for (field, value) in [
            ("estimator.initial_sd_k", estimator.initial_sd_k),
            ("estimator.gas_drift_k", estimator.gas_drift_k),
            ("estimator.wall_drift_k", estimator.wall_drift_k),
            ("estimator.heat_scale_sd", estimator.heat_scale_sd),
            ("estimator.lag_sd", estimator.lag_sd),
            ("estimator.place_error_k", estimator.place_error_k),
            ("estimator.valid_sd_k", estimator.valid_sd_k),
        ] {
            within(field, value, 0.0, 100.0)?;
        }
        within("estimator.memory_s", estimator.memory_s, 1.0, 1.0e6)?;
        let controller = &self.controller;
        for (field, value, minimum, maximum) in [
            ("controller.pressure_loop_s", controller.pressure_loop_s, 0.001, 10.0),
            ("controller.pressure_reset_s", controller.pressure_reset_s, 0.01, 1.0e4),
            ("controller.pressure_rate_pa_s", controller.pressure_rate_pa_s, 1.0, 1.0e9),
            ("controller.pressure_dead_zone_pa", controller.pressure_dead_zone_pa, 0.0, 1.0e6),
            ("controller.length_loop_s", controller.length_loop_s, 0.001, 10.0),
            ("controller.length_gain", controller.length_gain, 0.0, 10.0),
            ("controller.length_lead_s", controller.length_lead_s, 0.0, 10.0),
            ("controller.friction_gain", controller.friction_gain, 0.0, 2.0),
            ("controller.load_gain_n_m_s", controller.load_gain_n_m_s, 0.0, 1.0e7),
            ("controller.load_limit_n", controller.load_limit_n, 0.0, 1.0e5),
            ("controller.learning_band", controller.learning_band, 0.0, 1.0),
            ("controller.reference_rad_s", controller.reference_rad_s, 0.01, 1.0e4),
            ("controller.contraction_rate_per_s", controller.contraction_rate_per_s, 1.0e-4, 100.0),
            (
                "controller.contraction_acceleration_per_s2",
                controller.contraction_acceleration_per_s2,
                1.0e-4,
                1.0e4,
            ),
            ("controller.contraction_dead_zone", controller.contraction_dead_zone, 0.0, 0.1),
            ("controller.presliding_n_m", controller.presliding_n_m, 0.0, 1.0e9),
            ("controller.viscous_n_s_m", controller.viscous_n_s_m, 0.0, 1.0e6),
            ("controller.moving_mass_kg", controller.moving_mass_kg, 0.0, 1.0e6),
        ] {
            within(field, value, minimum, maximum)?;
        }
        within("pressure_limit_pa", self.pressure_limit_pa, 1.0, 1.0e9)?;
        within("link.timeout_s", self.link_timeout_s, 0.0, 3600.0)
    }
}

/// Not inlined: some eighty calls.
#[inline(never)]
fn within(field: &'static str, value: f32, minimum: f32, maximum: f32) -> Result<(), ConfigError> {
    if value >= minimum && value <= maximum {
        Ok(())
    } else {
        Err(ConfigError { field, value, minimum, maximum })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_holds() {
        assert_eq!(Config::default().check(), Ok(()));
    }

    #[test]
    fn nonsense_is_named() {
        let mut config = Config::default();
        config.valve.critical_ratio = f32::NAN;
        assert_eq!(config.check().unwrap_err().field, "valve.critical_ratio");
        let mut config = Config::default();
        config.friction.heat_fraction = 1.5;
        let error = config.check().unwrap_err();
        assert_eq!((error.value, error.minimum, error.maximum), (1.5, 0.0, 1.0));
    }
}
