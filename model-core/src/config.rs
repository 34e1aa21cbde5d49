//! Everything that the core is configured with before it starts, and the range of each value.

use crate::math::limit;
use crate::parameter::{ConfigError, Parameter, parameters, within};
use crate::physics::chamber::{Braid, ChamberConfig, Muscle};
use crate::physics::friction::Friction;
use crate::physics::gas::{Gas, Reservoir};
use crate::physics::heat::{Heat, Wall};
use crate::physics::hysteresis::Hysteresis;
use crate::physics::leak::Leak;
use crate::physics::valve::{Valve, ValveKind};
use crate::sensing::{Sensing, Sensors};

/// Fixed step of the core.
pub const STEP_S: Parameter = Parameter {
    name: "step_s",
    default: 0.001,
    unit: "s",
    minimum: 1.0e-4,
    maximum: 0.1,
    meaning: "step of the core",
};

/// Configuration of the core. [`Config::default`] is the nominal muscle of the project's scenarios.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Config {
    /// Fixed step of the core \[s\].
    pub step_s: f32,
    /// The gas.
    pub gas: Gas,
    /// The surroundings.
    pub ambient: Ambient,
    /// The supply behind the inlet valve.
    pub supply: Supply,
    /// The chamber, which holds the gas.
    pub chamber: ChamberConfig,
    /// Leakage of the chamber.
    pub leak: Leak,
    /// Heat transfer.
    pub heat: Heat,
    /// The gas along the muscle.
    pub zones: Zones,
    /// Heat capacity of the wall.
    pub wall: Wall,
    /// Friction of the moving end.
    pub friction: Friction,
    /// Slip and creep of a muscle; [`Hysteresis::NONE`] for other chambers.
    pub hysteresis: Hysteresis,
    /// The load, or a fixed length.
    pub load: Load,
    /// Mass that moves with the chamber's end \[kg\].
    pub moving_mass_kg: f32,
    /// Inlet and outlet valve.
    pub valve: Valve,
    /// Kind of the valves: how a command opens them.
    pub valve_kind: ValveKind,
    /// Period of the valves' PWM, or time for which an analogue command is held, in steps of the core \[-\].
    pub pwm_period_steps: u16,
    /// The sensors and their converter.
    pub sensors: Sensors,
    /// Estimator tuning.
    pub estimator: EstimatorConfig,
    /// Controller tuning.
    pub controller: ControllerConfig,
    /// Absolute pressure above which the supervisor vents \[Pa\].
    pub pressure_limit_pa: f32,
    /// The link to the host.
    pub link: LinkConfig,
}

parameters! {
    /// The surroundings.
    "ambient": Ambient {
        pressure_pa: 101_325.0, "Pa", 1.0 to 1.0e8, "absolute pressure";
        temperature_k: 298.0, "K", 100.0 to 1000.0, "temperature";
    }
}

parameters! {
    /// The compressed air behind the inlet valve.
    "supply": Supply {
        pressure_pa: 700_000.0, "Pa", 1.0 to 1.0e8, "absolute pressure at no flow";
        temperature_k: 298.0, "K", 100.0 to 1000.0, "temperature of the gas that flows in";
    }
}

impl From<Ambient> for Reservoir {
    fn from(Ambient { pressure_pa, temperature_k }: Ambient) -> Self {
        Self { pressure_pa, temperature_k }
    }
}

impl From<Supply> for Reservoir {
    fn from(Supply { pressure_pa, temperature_k }: Supply) -> Self {
        Self { pressure_pa, temperature_k }
    }
}

parameters! {
    /// Link between host and board.
    "link": LinkConfig {
        timeout_s: 0.5, "s", 0.0 to 3600.0, "silence of the host after which the board vents; 0: it goes on alone";
    }
}

/// The load that the chamber moves, or the length at which it is held.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Load {
    /// A constant force \[N\].
    Isotonic {
        /// Force, positive if it pulls the ends apart \[N\].
        force_n: f32,
    },
    /// A fixed length \[m\].
    Isometric {
        /// Length \[m\].
        length_m: f32,
    },
}

parameters! {
    /// Gas along the muscle, as modelled by the estimator's zones. By default it mixes at once.
    "zones": Zones {
        buoyancy_w_m2_k: 0.0, "W/(m2 K)", 0.0 to 1.0e5, "gas to wall by buoyancy, still gas at 2 bar, 20 K from its wall; 0: conduction alone";
        per_outflow: 0.0, "W/(m2 K) per kg/s", 0.0 to 1.0e9, "gas to wall, gained per outflow";
        stirring_decay_s: 0.0, "s", 0.0 to 100.0, "how long stirring by a flow outlasts it";
        recirculation: 0.0, "", 0.0 to 100.0, "volume that the jet exchanges with the gas beyond, per volume that comes in, at the port";
        jet_reach_m: 100.0, "m", 1.0e-4 to 100.0, "length over which the jet decays";
        diffusivity_m2_s: 100.0, "m2/s", 0.0 to 100.0, "mixing along the muscle between strokes";
        foil_position: 0.5, "", 0.0 to 1.0, "middle of the foil, from port 0 to closed end 1";
        foil_span: 0.0, "", 0.0 to 1.0, "part of the length that it averages over";
        forced_flow_kg_s: 0.0, "kg/s", 0.0 to 100.0, "flow at which those gains are counted: beside it they grow with flow^(2/3); 0: in proportion";
        bore_m: 0.0, "m", 0.0 to 10.0, "diameter of still gas with a radial profile; 0: even gas";
        foil_radius: 0.0, "", 0.0 to 1.0, "distance of the foil from the axis, share of the radius";
        outer_wall_j_k: 1.0, "J/K", 0.01 to 1.0e9, "heat capacity of the layer behind the wall that touches the gas";
        reversal_sd: 1.0e6, "", 0.0 to 1.0e6, "deviations of a pressure from which on a step's flow is against the valve that is open, as behind a hose";
        tube_m3: 0.0, "m3", 0.0 to 0.1, "part of the chamber's volume that is the tube: its gas has ambient temperature";
        hose_m3: 0.0, "m3", 0.0 to 0.1, "volume of a hose beyond that, likewise";
        warming_m3: 0.0, "m3", 0.0 to 0.1, "volume of them whose compression warms the gas that comes in";
        layers_w_k: 0.0, "W/K", 0.0 to 1.0e6, "conductance from the one to the other; 0: there is no other";
    }
}

parameters! {
    /// Estimator tuning. Standard deviations; "drift" is the gain of a random walk in one second.
    /// `docs/reference/estimator-keys.md` states how each is found.
    "estimator": EstimatorConfig {
        initial_sd_k: 3.0, "K", 0.0 to 100.0, "gas and wall temperature at the start";
        gas_drift_k: 0.3, "K", 0.0 to 100.0, "drift of the gas temperature's error";
        zone_drift: 0.1, "", 0.0 to 10.0, "drift of one zone's error, share of the gas's swing about the wall";
        wall_drift_k: 0.3, "K", 0.0 to 100.0, "drift of the wall temperature's error";
        heat_scale_sd: 0.4, "", 0.0 to 100.0, "logarithm of the heat transfer's scale";
        stirring_sd: 0.4, "", 0.0 to 100.0, "logarithm of the scale of what flows stir";
        lag_sd: 0.8, "", 0.0 to 100.0, "logarithm of the sensor's lag";
        housing_sd: 0.7, "", 0.0 to 100.0, "logarithm of the housing's lag";
        place_sd: 0.05, "", 0.0 to 1.0, "place of the foil, share of the length";
        memory_s: 300.0, "s", 1.0 to 1.0e6, "in which scales, lags and place, left alone, return";
        foil_sd_k: 0.5, "K", 0.0 to 100.0, "gas around the foil against its zone";
        foil_swing: 0.2, "", 0.0 to 10.0, "the same, share of the gas's swing about the wall";
        foil_memory_s: 0.4, "s", 0.001 to 1.0e6, "how long that lasts";
        reading_sd_k: 0.15, "K", 0.0 to 100.0, "mean reading of an interval, beside its noise";
        valid_sd_k: 2.5, "K", 0.0 to 100.0, "stated deviation up to which the estimate is valid";
    }
}

parameters! {
    /// Controller tuning; `docs/reference/controller-keys.md` states how each is found.
    "controller": ControllerConfig {
        pressure_loop_s: 0.014, "s", 0.001 to 10.0, "time in which the pressure loop closes an error";
        pressure_reset_s: 0.3, "s", 0.01 to 10000.0, "reset time of the pressure loop's integral";
        pressure_rate_pa_s: 1.0e7, "Pa/s", 1.0 to 1.0e9, "fastest change of the pressure's set point";
        pressure_dead_zone_pa: 1500.0, "Pa", 0.0 to 1.0e6, "pressure error that is left alone at rest";
        length_loop_s: 0.014, "s", 0.001 to 10.0, "time in which the contraction loop closes an error of the gas mass";
        length_gain: 1.0, "", 0.0 to 10.0, "weight of an error of length against one of pressure";
        length_lead_s: 0.01, "s", 0.0 to 10.0, "how far ahead the length error is looked for, by its speed";
        friction_gain: 1.03, "", 0.0 to 2.0, "friction compensated, share of friction.force_n; above 1 for a Stribeck surplus";
        load_gain_n_m_s: 4.0e4, "N/(m s)", 0.0 to 1.0e7, "force that the contraction loop adds per length error and time";
        load_limit_n: 300.0, "N", 0.0 to 1.0e5, "largest load beside the configured one, either way";
        learning_band: 0.002, "", 0.0 to 1.0, "largest length error that it integrates, share of the rest length";
        reference_rad_s: 90.0, "rad/s", 0.01 to 10000.0, "natural frequency of the contraction's reference";
        contraction_rate_per_s: 0.7, "1/s", 0.0001 to 100.0, "fastest contraction of the reference, share of the rest length";
        contraction_acceleration_per_s2: 30.0, "1/s2", 0.0001 to 10000.0, "largest acceleration of the reference, share of the rest length";
        contraction_dead_zone: 0.0006, "", 0.0 to 0.1, "length error that is left alone at rest, share of the rest length";
        minimum_pulse_s: 0.001, "s", 0.0 to 0.1, "shortest valve pulse worth giving; below valve.switch_time_s it opens partly";
    }
}

impl Default for Config {
    fn default() -> Self {
        Self {
            step_s: STEP_S.default as f32,
            gas: Gas::default(),
            ambient: Ambient::default(),
            supply: Supply::default(),
            chamber: ChamberConfig::Muscle(Muscle {
                // 300 mm by 20 mm at rest, threads at 23 deg.
                braid: Braid { thread_length_m: 0.325_908_1, turns: 2.026_714 },
                rest_length_m: 0.3,
                bladder_stiffness_n_m: 600.0,
                bladder_saturation_n: 0.0,
                bladder_strain: 0.02,
                slack_m: 0.0,
                dead_volume_m3: 5.0e-6,
            }),
            leak: Leak::default(),
            heat: Heat::default(),
            zones: Zones::default(),
            wall: Wall::default(),
            friction: Friction::default(),
            hysteresis: Hysteresis::default(),
            load: Load::Isotonic { force_n: 100.0 },
            moving_mass_kg: 0.0,
            valve: Valve::default(),
            valve_kind: ValveKind::default(),
            pwm_period_steps: 10,
            sensors: Sensors::default(),
            estimator: EstimatorConfig::default(),
            controller: ControllerConfig::default(),
            pressure_limit_pa: 0.985 * 700_000.0,
            link: LinkConfig::default(),
        }
    }
}

impl Config {
    /// Highest absolute pressure to which a set point is followed, 5 % of the gauge pressure below the limit, so that
    /// overshoot on the way there does not trip it \[Pa\].
    pub fn working_limit_pa(&self) -> f32 {
        self.pressure_limit_pa - self.pressure_margin_pa()
    }

    /// Distance from the working limit to the pressure at which the muscle vents \[Pa\].
    pub fn pressure_margin_pa(&self) -> f32 {
        0.05 * (self.pressure_limit_pa - self.ambient.pressure_pa)
    }

    /// Steps for which a valve may still pass gas after it was last driven. A pulse ends at most one period after its
    /// duty; of an exponential 0.7 % remains after five time constants.
    pub fn passing_steps(&self) -> u16 {
        let after_steps = match self.valve_kind {
            ValveKind::Switching => 0,
            ValveKind::Proportional(spool) => {
                ((self.valve.dead_time_s + 5.0 * spool.lag_s()) / self.step_s) as u16
            }
        };
        self.pwm_period_steps.max(after_steps).saturating_add(1)
    }

    /// The configured sensors, before their first reading.
    pub fn sensing(&self) -> Sensing {
        Sensing::new(&self.sensors, self.step_s, self.ambient.pressure_pa)
    }

    /// Checks every value.
    ///
    /// # Errors
    /// The first value that is not a number or lies outside of its range.
    #[cold] // Once at a start: as small as can be.
    pub fn check(&self) -> Result<(), ConfigError> {
        within("run.step_s", self.step_s, STEP_S.minimum as f32, STEP_S.maximum as f32)?;
        self.gas.check()?;
        self.ambient.check()?;
        self.supply.check()?;
        self.chamber.check()?;
        self.leak.check()?;
        self.heat.check()?;
        self.zones.check()?;
        self.wall.check()?;
        self.friction.check()?;
        self.hysteresis.check()?;
        match self.load {
            Load::Isotonic { force_n } => within("load.force_n", force_n, -1.0e6, 1.0e6)?,
            Load::Isometric { length_m } => within("load.length_m", length_m, 0.001, 10.0)?,
        }
        within("load.mass_kg", self.moving_mass_kg, 0.0, 1.0e6)?;
        // The longest switching time depends on the PWM period.
        Valve { switch_time_s: 0.0, ..self.valve }.check()?;
        within(
            "valve.pwm_hz (its period, in steps)",
            f32::from(self.pwm_period_steps),
            1.0,
            1000.0,
        )?;
        const SLOWEST_S: f32 = 0.1;
        // With a little room, as both have been rounded.
        let period_s = f32::from(self.pwm_period_steps) * self.step_s * 1.000_001;
        let slowest_s = limit(period_s, 0.0, SLOWEST_S);
        within("valve.switch_time_s", self.valve.switch_time_s, 0.0, slowest_s)?;
        within("controller.minimum_pulse_s", self.controller.minimum_pulse_s, 0.0, slowest_s)?;
        self.valve_kind.check()?;
        self.sensors.check()?;
        self.estimator.check()?;
        self.controller.check()?;
        let limit = "sensor.pressure.range_pa (the pressure limit below it)";
        within(limit, self.pressure_limit_pa, 1.0, 1.0e9)?;
        self.link.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::SMALLEST;

    #[test]
    fn the_default_holds() {
        assert_eq!(Config::default().check(), Ok(()));
    }

    /// Otherwise the other valve opens before the poppet is shut.
    #[test]
    fn a_valve_switches_within_a_period() {
        let mut config = Config { pwm_period_steps: 3, ..Config::default() };
        config.valve.switch_time_s = 0.003;
        assert_eq!(config.check(), Ok(()));
        config.valve.switch_time_s = 0.003_01;
        let error = config.check().unwrap_err();
        assert_eq!((error.field, error.minimum), ("valve.switch_time_s", 0.0));
        assert!((error.maximum / 0.003 - 1.0).abs() < 1e-5, "{error}");
        config.pwm_period_steps = 1000;
        config.valve.switch_time_s = 0.101;
        assert_eq!(config.check().unwrap_err().maximum, 0.1);
    }

    /// Otherwise no pulse is ever given.
    #[test]
    fn the_shortest_pulse_fits_into_a_period() {
        let mut config = Config::default();
        config.controller.minimum_pulse_s = 0.01;
        assert_eq!(config.check(), Ok(()));
        config.controller.minimum_pulse_s = 0.0101;
        let error = config.check().unwrap_err();
        assert_eq!(error.field, "controller.minimum_pulse_s");
        assert!((error.maximum / 0.01 - 1.0).abs() < 1e-5, "{error}");
    }

    /// A subnormal number is zero on one processor and not on another.
    #[test]
    fn next_to_nothing_is_refused_and_nothing_is_not() {
        type Field = fn(&mut Config) -> &mut f32;
        let fields: [(&str, Field); 3] = [
            ("link.timeout_s", |config| &mut config.link.timeout_s),
            ("leak.conductance_m3_s_pa", |config| &mut config.leak.conductance_m3_s_pa),
            ("adc.wide_code_lsb", |config| &mut config.sensors.adc.wide_code_lsb),
        ];
        for (key, field) in fields {
            let with = |value| {
                let mut config = Config::default();
                *field(&mut config) = value;
                config.check()
            };
            for value in [1.0e-40, f32::MIN_POSITIVE, f32::from_bits(1), 0.99 * SMALLEST] {
                assert_eq!(with(value).map_err(|error| error.field), Err(key), "{value:e}");
            }
            assert_eq!([0.0, -0.0, SMALLEST].map(with), [Ok(()); 3], "{key}");
        }
        let load = Load::Isotonic { force_n: -1.0e-40 };
        let error = Config { load, ..Config::default() }.check().unwrap_err();
        let text = std::string::ToString::to_string(&error);
        assert_eq!(text, "load.force_n = -1e-40: must be 0, or 1e-20 or more in size");
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
