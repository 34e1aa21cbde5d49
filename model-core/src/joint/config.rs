//! Configuration of a joint, and what its values may be.

use crate::config::{Config, Load};
use crate::parameter::{ConfigError, parameters, within};
use crate::physics::chamber::{AnyChamber, Chamber};

/// Length that a muscle keeps free towards either end of its lengths, share of the rest length \[-\].
const CLEARANCE: f32 = 0.001;

parameters! {
    /// The mechanism. Muscle a shortens as the angle grows: L_a = mid_length_a_m - r q, L_b = mid_length_b_m + r q.
    "joint": Mechanism {
        radius_m: 0.02, "m", 1.0e-3 to 10.0, "radius of the pulley";
        mid_length_a_m: 0.27, "m", 1.0e-3 to 10.0, "length of muscle a at angle 0";
        mid_length_b_m: 0.27, "m", 1.0e-3 to 10.0, "length of muscle b at angle 0";
        inertia_kg_m2: 0.02, "kg m2", 1.0e-6 to 1.0e4, "moment of inertia about the axis";
        gravity_n_m: 0.0, "N m", 0.0 to 1.0e6, "largest torque of gravity: mass, standard gravity and lever";
        gravity_angle_rad: 0.0, "rad", -6.3 to 6.3, "angle at which the arm hangs";
        viscous_n_m_s: 0.05, "N m s/rad", 0.0 to 1.0e4, "viscous friction of the bearing";
        friction_n_m: 0.0, "N m", 0.0 to 1.0e4, "dry friction of the bearing, beside that of the muscles";
        minimum_rad: -0.8, "rad", -6.3 to 6.3, "lower stop";
        maximum_rad: 0.8, "rad", -6.3 to 6.3, "upper stop";
        sensor_minimum_rad: -1.0, "rad", -12.6 to 12.6, "angle at 5 % of the potentiometer's reference";
        sensor_maximum_rad: 1.0, "rad", -12.6 to 12.6, "angle at 95 % of it";
        torque_limit_n_m: 4.0, "N m", 1.0e-3 to 1.0e6, "torque that nothing configured explains, at which the joint vents";
        lock_s: 0.0, "s", 0.0 to 600.0, "longest time of a lock, after which the joint vents; 0: it never locks";
    }
}

parameters! {
    /// Tuning of the joint's controller.
    "joint": JointTuning {
        reference_rad_s: 30.0, "rad/s", 0.1 to 1.0e3, "natural frequency of the angle's reference";
        reference_speed_rad_s: 4.0, "rad/s", 1.0e-3 to 1.0e3, "fastest speed of the reference";
        reference_torque_n_m: 2.5, "N m", 1.0e-3 to 1.0e6, "torque that accelerates the reference beside the set point's own acceleration, at most";
        stiffness_rate_n_m_rad_s: 100.0, "N m/(rad s)", 1.0e-3 to 1.0e6, "fastest change of the stiffness";
        gain_n_m_rad: 12.0, "N m/rad", 0.0 to 1.0e5, "torque per error of the angle, beside the gas's own stiffness";
        damping_per_s: 15.0, "1/s", 0.0 to 1.0e3, "torque per error of the speed and inertia";
        integral_n_m_rad_s: 120.0, "N m/(rad s)", 0.0 to 1.0e6, "torque per error of the angle and time";
        integral_limit_n_m: 2.0, "N m", 0.0 to 1.0e6, "most of it, either way";
        observer_rad_s: 50.0, "rad/s", 0.1 to 1.0e3, "three poles of the observer of speed and disturbance";
        observer_share: 0.8, "", 0.0 to 1.0, "share of the observed disturbance that is compensated";
        mass_loop_s: 0.014, "s", 1.0e-3 to 10.0, "time in which the gas masses close an error";
        quiet_n_m: 0.02, "N m", 0.0 to 1.0e3, "torque for which no pulse is given";
        waits_n_m: 0.2, "N m", 0.0 to 1.0e3, "torque for which a muscle has no pulse in two periods after each other";
        dead_zone_rad: 0.003, "rad", 0.0 to 1.0, "error of the angle that is left alone at rest";
        dead_zone_stiffness: 0.02, "", 0.0 to 1.0, "the same of the stiffness, share of it";
    }
}

/// Configuration of a joint of two muscles.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct JointConfig {
    /// Muscles a and b. Their load is [`Load::Isometric`]: no force of its own, the mechanism sets the length.
    pub muscles: [Config; 2],
    /// The mechanism.
    pub mechanism: Mechanism,
    /// Tuning of the controller.
    pub tuning: JointTuning,
}

impl Mechanism {
    /// Length of each muscle at an angle \[m\].
    pub fn lengths_m(&self, angle_rad: f32) -> [f32; 2] {
        let way_m = self.radius_m * angle_rad;
        [self.mid_length_a_m - way_m, self.mid_length_b_m + way_m]
    }
}

impl JointConfig {
    /// Checks every value, and that both muscles can have every angle between the stops.
    ///
    /// ```
    /// use model_core::joint::JointConfig;
    ///
    /// let mut config = JointConfig::default();
    /// assert!(config.check().is_ok());
    /// config.mechanism.radius_m = 0.2;
    /// assert_eq!(config.check().unwrap_err().field, "joint.mid_length_a_m (less joint.radius_m times the stop)");
    /// ```
    ///
    /// # Errors
    /// The first value that is not a number or lies outside of its range.
    #[cold] // Once at a start: as small as can be.
    pub fn check(&self) -> Result<(), ConfigError> {
        let Self { muscles: [a, b], mechanism, tuning } = self;
        a.check()?;
        b.check()?;
        mechanism.check()?;
        tuning.check()?;
        for config in [a, b] {
            // One load acts on both, which no single muscle has.
            let is_held = matches!(config.load, Load::Isometric { .. });
            within(
                "load.kind (1: isometric, as of both muscles of a joint)",
                f32::from(u8::from(is_held)),
                1.0,
                1.0,
            )?;
        }
        within("run.step_s (of muscle b, as of muscle a)", b.step_s, a.step_s, a.step_s)?;
        let steps = [a, b].map(|config| f32::from(config.pwm_period_steps));
        let [of_a, of_b] = steps;
        within("valve.pwm_hz (its period, of muscle b as of muscle a)", of_b, of_a, of_a)?;
        let [of_a, of_b] =
            [a, b].map(|config| f32::from(u8::from(config.valve_kind.is_switching())));
        within("valve.kind (1: switching, of muscle b as of muscle a)", of_b, of_a, of_a)?;
        let Mechanism { minimum_rad, maximum_rad, .. } = *mechanism;
        within("joint.maximum_rad", maximum_rad, minimum_rad + 0.01, 6.3)?;
        let [least, most] = [mechanism.sensor_minimum_rad, mechanism.sensor_maximum_rad];
        within("joint.sensor_minimum_rad", least, -12.6, minimum_rad)?;
        within("joint.sensor_maximum_rad", most, maximum_rad, 12.6)?;
        for stop_rad in [minimum_rad, maximum_rad] {
            let [length_a_m, length_b_m] = mechanism.lengths_m(stop_rad);
            within_lengths(
                "joint.mid_length_a_m (less joint.radius_m times the stop)",
                a,
                length_a_m,
            )?;
            within_lengths(
                "joint.mid_length_b_m (and joint.radius_m times the stop)",
                b,
                length_b_m,
            )?;
        }
        Ok(())
    }
}

/// That a muscle can have this length \[m\].
fn within_lengths(field: &'static str, config: &Config, length_m: f32) -> Result<(), ConfigError> {
    let chamber = AnyChamber::new(&config.chamber);
    let clear_m = CLEARANCE * chamber.rest_length_m();
    within(field, length_m, chamber.shortest_m() + clear_m, chamber.longest_m())
}

impl Default for JointConfig {
    fn default() -> Self {
        let muscle = Config { load: Load::Isometric { length_m: 0.27 }, ..Config::default() };
        Self {
            muscles: [muscle; 2],
            mechanism: Mechanism::default(),
            tuning: JointTuning::default(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::valve::{Spool, ValveKind};

    #[test]
    fn what_no_pair_can_be_is_refused_by_its_key() {
        let default = JointConfig::default();
        assert_eq!(default.check(), Ok(()));
        let with = |change: fn(&mut JointConfig)| {
            let mut config = default;
            change(&mut config);
            config.check().unwrap_err().field
        };
        let field = with(|config| config.mechanism.mid_length_b_m = 0.32);
        assert!(field.starts_with("joint.mid_length_b_m"), "{field}");
        let field = with(|config| config.mechanism.minimum_rad = 0.9);
        assert_eq!(field, "joint.maximum_rad");
        let field = with(|config| config.muscles[1].pwm_period_steps = 20);
        assert!(field.starts_with("valve.pwm_hz"), "{field}");
        let field = with(|config| {
            config.muscles[1].valve_kind = ValveKind::Proportional(Spool::default());
        });
        assert!(field.starts_with("valve.kind"), "{field}");
        let field = with(|config| config.muscles[0].load = Load::Isotonic { force_n: 10.0 });
        assert!(field.starts_with("load.kind"), "{field}");
        let field = with(|config| config.mechanism.sensor_maximum_rad = 0.7);
        assert_eq!(field, "joint.sensor_maximum_rad");
        let field = with(|config| config.mechanism.inertia_kg_m2 = f32::NAN);
        assert_eq!(field, "joint.inertia_kg_m2");
    }
}
