//! Configuration of a joint, and the ranges of its values.

use super::encoder::AnglePart;
use super::pulley::{Lever, Shape};
use crate::config::{Config, Load};
use crate::parameter::{ConfigError, parameters, within};
use crate::physics::chamber::{AnyChamber, Chamber};
use core::f32::consts::TAU;

/// Distance that a muscle keeps from either end of its range of lengths, share of the rest length \[-\].
const CLEARANCE: f32 = 0.001;

/// Smallest and largest radius between the stops, in `joint.radius_m` \[-\].
const RADII: [f32; 2] = [0.05, 20.0];
/// Number of intervals between the stops at whose ends radii and lengths are checked.
const INTERVALS: f32 = 16.0;
/// Keys under which a radius of muscle a or muscle b is refused.
const RADIUS_KEYS: [&str; 2] = [
    "joint.radius_a_per_rad (radius between the stops, in joint.radius_m)",
    "joint.radius_b_share (radius between the stops, in joint.radius_m)",
];

/// Smallest angle from a stop to the jump of an AS5600's reading: more than a stop gives way \[rad\].
const CLEAR_RAD: f32 = 0.1;

parameters! {
    /// The mechanism. Muscle a shortens as the angle grows: L_a = mid_length_a_m - r q, L_b = mid_length_b_m + r q; for
    /// a varying radius, by its integral from angle 0: see [`pulley`](super::pulley).
    "joint": Mechanism {
        radius_m: 0.02, "m", 1.0e-3 to 10.0, "radius of the pulley; of one that varies, that of muscle a at angle 0";
        radius_a_per_rad: 0.0, "1/rad", -100.0 to 100.0, "how the radius of muscle a varies: share of radius_m per angle";
        radius_a_per_rad2: 0.0, "1/rad2", -100.0 to 100.0, "the same per square of the angle";
        radius_a_per_rad3: 0.0, "1/rad3", -100.0 to 100.0, "the same per cube of the angle";
        radius_b_share: 1.0, "", 0.01 to 100.0, "radius of muscle b at angle 0, in radius_m";
        radius_b_per_rad: 0.0, "1/rad", -100.0 to 100.0, "how the radius of muscle b varies: share of radius_m per angle";
        radius_b_per_rad2: 0.0, "1/rad2", -100.0 to 100.0, "the same per square of the angle";
        radius_b_per_rad3: 0.0, "1/rad3", -100.0 to 100.0, "the same per cube of the angle";
        mid_length_a_m: 0.27, "m", 1.0e-3 to 10.0, "length of muscle a at angle 0";
        mid_length_b_m: 0.27, "m", 1.0e-3 to 10.0, "length of muscle b at angle 0";
        inertia_kg_m2: 0.02, "kg m2", 1.0e-6 to 1.0e4, "moment of inertia about the axis";
        gravity_n_m: 0.0, "N m", 0.0 to 1.0e6, "largest torque of gravity: mass, standard gravity and lever";
        gravity_angle_rad: 0.0, "rad", -6.3 to 6.3, "angle at which the arm hangs";
        viscous_n_m_s: 0.05, "N m s/rad", 0.0 to 1.0e4, "viscous friction of the bearing";
        friction_n_m: 0.0, "N m", 0.0 to 1.0e4, "dry friction of the bearing, beside that of the muscles";
        minimum_rad: -0.8, "rad", -6.3 to 6.3, "lower stop";
        maximum_rad: 0.8, "rad", -6.3 to 6.3, "upper stop";
        sensor_minimum_rad: -1.0, "rad", -12.6 to 12.6, "angle at 5 % of the potentiometer's reference, or where an AS5600 reads 0";
        sensor_maximum_rad: 1.0, "rad", -12.6 to 12.6, "angle at 95 % of the potentiometer's reference; an AS5600 has one turn";
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
        damping_per_s: 14.0, "1/s", 0.0 to 1.0e3, "torque per error of the speed and inertia";
        integral_n_m_rad_s: 120.0, "N m/(rad s)", 0.0 to 1.0e6, "torque per error of the angle and time, at rest";
        integral_limit_n_m: 2.0, "N m", 0.0 to 1.0e6, "most of it, either way, beside twice the dry friction";
        observer_rad_s: 80.0, "rad/s", 0.1 to 1.0e3, "two poles of the observer: angle and speed";
        disturbance_rad_s: 22.0, "rad/s", 0.1 to 1.0e3, "its third one: torque that nothing configured explains";
        observer_share: 0.8, "", 0.0 to 1.0, "share of the observed disturbance that is compensated";
        lead_s: 0.004, "s", 0.0 to 0.1, "how late gas comes, beside the valve's own delay: a quarter of a PWM period for pulses that wait, 2.9 ms for a metre of hose";
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
    /// Muscles a and b. Their load is [`Load::Isometric`]: it has no force of its own, the mechanism sets the length.
    pub muscles: [Config; 2],
    /// The mechanism.
    pub mechanism: Mechanism,
    /// Tuning of the controller.
    pub tuning: JointTuning,
    /// Type of the angle's sensor.
    pub angle_part: AnglePart,
}

impl Mechanism {
    /// Shapes of the radii of muscles a and b.
    pub fn shapes(&self) -> [Shape; 2] {
        let Self { radius_a_per_rad, radius_a_per_rad2, radius_a_per_rad3, .. } = *self;
        let Self { radius_b_share, radius_b_per_rad, radius_b_per_rad2, radius_b_per_rad3, .. } =
            *self;
        [
            Shape([1.0, radius_a_per_rad, radius_a_per_rad2, radius_a_per_rad3]),
            Shape([radius_b_share, radius_b_per_rad, radius_b_per_rad2, radius_b_per_rad3]),
        ]
    }

    /// Whether both radii equal `radius_m` at every angle.
    fn is_round(&self) -> bool {
        let varies = self.radius_a_per_rad.to_bits()
            | self.radius_a_per_rad2.to_bits()
            | self.radius_a_per_rad3.to_bits()
            | self.radius_b_per_rad.to_bits()
            | self.radius_b_per_rad2.to_bits()
            | self.radius_b_per_rad3.to_bits();
        varies | (self.radius_b_share.to_bits() ^ 1.0_f32.to_bits()) == 0
    }

    /// Length of each muscle at an angle \[m\].
    #[inline(never)] // In three places: as small as can be.
    pub fn lengths_m(&self, angle_rad: f32) -> [f32; 2] {
        let [a_rad, b_rad] = if self.is_round() {
            [angle_rad; 2]
        } else {
            self.shapes().map(|shape| shape.wound_rad(angle_rad))
        };
        [self.mid_length_a_m - self.radius_m * a_rad, self.mid_length_b_m + self.radius_m * b_rad]
    }

    /// Lever of each muscle at an angle: more expensive than its length by two divisions.
    #[inline(never)]
    pub fn levers(&self, angle_rad: f32) -> [Lever; 2] {
        if self.is_round() {
            return [Lever::PLAIN; 2];
        }
        let [a, b] = self.shapes();
        [a.lever(angle_rad, -self.radius_m), b.lever(angle_rad, self.radius_m)]
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
    /// assert_eq!(config.check().unwrap_err().field, "joint.mid_length_a_m (less the pulley's way to the stop)");
    /// ```
    ///
    /// # Errors
    /// The first value that is not a number or lies outside of its range.
    #[cold] // Once at a start: as small as can be.
    pub fn check(&self) -> Result<(), ConfigError> {
        let Self { muscles: [a, b], mechanism, tuning, .. } = self;
        a.check()?;
        b.check()?;
        mechanism.check()?;
        tuning.check()?;
        for config in [a, b] {
            // One load acts on both muscles, which is the case for no single muscle.
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
        self.check_angle()?;
        let apart_rad = (1.0 / INTERVALS) * (maximum_rad - minimum_rad);
        let mut angle_rad = minimum_rad;
        while angle_rad < maximum_rad {
            self.check_pulley(angle_rad)?;
            angle_rad += apart_rad;
        }
        self.check_pulley(maximum_rad)
    }

    /// Checks radii and lengths at an angle between the stops.
    #[inline(never)] // In two places: as small as can be.
    fn check_pulley(&self, angle_rad: f32) -> Result<(), ConfigError> {
        let [of_a, of_b] = self.mechanism.levers(angle_rad);
        let [least, most] = RADII;
        within(RADIUS_KEYS[0], of_a.share, least, most)?;
        within(RADIUS_KEYS[1], of_b.share, least, most)?;
        self.check_lengths(self.mechanism.lengths_m(angle_rad))
    }

    /// Checks that both muscles can have their lengths at a stop \[m\].
    ///
    /// # Errors
    /// For the first muscle that cannot.
    #[cold]
    pub fn check_lengths(&self, [length_a_m, length_b_m]: [f32; 2]) -> Result<(), ConfigError> {
        let [a, b] = &self.muscles;
        let key = "joint.mid_length_a_m (less the pulley's way to the stop)";
        within_lengths(key, a, length_a_m)?;
        within_lengths("joint.mid_length_b_m (and the pulley's way to the stop)", b, length_b_m)
    }

    /// Upper end of the angle sensor's range \[rad\]; for an AS5600 a turn above the lower end.
    pub fn sensor_maximum_rad(&self) -> f32 {
        match self.angle_part {
            AnglePart::Potentiometer => self.mechanism.sensor_maximum_rad,
            AnglePart::As5600 => self.mechanism.sensor_minimum_rad + TAU,
        }
    }

    /// Checks that every angle between the stops has a reading.
    fn check_angle(&self) -> Result<(), ConfigError> {
        let Mechanism { minimum_rad, maximum_rad, .. } = self.mechanism;
        let [least, most] = [self.mechanism.sensor_minimum_rad, self.mechanism.sensor_maximum_rad];
        match self.angle_part {
            AnglePart::Potentiometer => {
                within("joint.sensor_minimum_rad", least, -12.6, minimum_rad)?;
                within("joint.sensor_maximum_rad", most, maximum_rad, 12.6)
            }
            AnglePart::As5600 => {
                let turn_rad = TAU - 2.0 * CLEAR_RAD;
                let key = "joint.maximum_rad (an AS5600 reads one turn)";
                within(key, maximum_rad, minimum_rad + 0.01, minimum_rad + turn_rad)?;
                let lowest_rad = maximum_rad + CLEAR_RAD - TAU;
                let key = "joint.sensor_minimum_rad (where an AS5600's turn begins)";
                within(key, least, lowest_rad, minimum_rad - CLEAR_RAD)
            }
        }
    }
}

/// Checks that a muscle can have this length \[m\].
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
            angle_part: AnglePart::default(),
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
        let field = with(|config| config.mechanism.radius_a_per_rad = 1.3);
        assert!(field.starts_with("joint.radius_a_per_rad (radius between the stops"), "{field}");
        // Negative only in the middle of the way.
        let field = with(|config| {
            (config.mechanism.radius_b_share, config.mechanism.radius_b_per_rad2) = (0.04, 2.0);
        });
        assert!(field.starts_with("joint.radius_b_share (radius between the stops"), "{field}");
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

    #[test]
    fn a_turn_that_ends_between_the_stops_is_refused() {
        let field = |minimum_rad: f32, maximum_rad: f32, sensor_minimum_rad: f32| {
            let mut config =
                JointConfig { angle_part: AnglePart::As5600, ..JointConfig::default() };
            let mechanism = &mut config.mechanism;
            (mechanism.minimum_rad, mechanism.maximum_rad) = (minimum_rad, maximum_rad);
            mechanism.sensor_minimum_rad = sensor_minimum_rad;
            // Only for a potentiometer.
            mechanism.sensor_maximum_rad = 0.0;
            config.check_angle().map_err(|error| error.field).err()
        };
        assert_eq!(field(-0.8, 0.8, -1.0), None);
        assert_eq!(field(-0.8, 0.8, -5.3), None);
        for beginning in [-0.85, 0.0, -5.4] {
            let refused = field(-0.8, 0.8, beginning).unwrap();
            assert!(refused.starts_with("joint.sensor_minimum_rad ("), "{refused}");
        }
        assert_eq!(field(-3.0, 3.0, -3.1), None);
        let refused = field(-3.1, 3.1, -3.2).unwrap();
        assert!(refused.starts_with("joint.maximum_rad ("), "{refused}");
    }
}
