//! Set points of a joint: which of them it accepts, and its errors for the others.

use super::config::{JointConfig, Mechanism};
use super::guard::JointFaults;
use super::reference::Motion;
use crate::math::limit;
use crate::sample::Faults;

/// Longest time for which a motion continues with its speed and acceleration without a different set point: ten set
/// points of a host that sends a hundred a second \[s\].
pub const LONGEST_S: f32 = 0.1;

/// Highest speed \[rad/s\] and acceleration \[rad/s2\] of a set point, beyond those of muscles of any size.
const FASTEST_RAD_S: f32 = 1.0e3;
const LARGEST_RAD_S2: f32 = 1.0e6;
/// Largest torque \[N m\] and stiffness \[N m/rad\] of a set point.
const LARGEST: f32 = 1.0e6;

/// The quantity that a joint is asked to reach.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum JointSetPoint {
    /// Both inlets closed, both outlets open.
    #[default]
    Vent,
    /// Fixed openings of muscles a and b, as fractions of the PWM period.
    Duty {
        /// Inlets open, 0 to 1 \[-\].
        inlet: [f32; 2],
        /// Outlets open, 0 to 1 \[-\].
        outlet: [f32; 2],
    },
    /// Absolute pressures of muscles a and b.
    Pressures {
        /// Pressures, 0 to the configured limit \[Pa\].
        pressure_pa: [f32; 2],
    },
    /// A torque with a stiffness behind shut valves, at any angle.
    Torque {
        /// Torque, positive towards growing angles \[N m\].
        torque_n_m: f32,
        /// Stiffness \[N m/rad\].
        stiffness_n_m_rad: f32,
    },
    /// An angle with a stiffness. A motion that comes with its speed and acceleration is followed without lag; a step
    /// has neither. Until the next set point it continues with them, for [`LONGEST_S`] at most, and then rests where it
    /// has arrived. Angles that come without either, 20 times a second or more, are a motion too: they continue with
    /// their differences for one and a half intervals at most, and then rest at the last angle. An angle that follows a
    /// rest is a step.
    Angle(Motion),
    /// All four valves shut, for `joint.lock_s` at most; then both muscles vent.
    Lock,
}

/// A value of a joint's set point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum JointField {
    /// Share of the time for which an inlet is open.
    Inlet,
    /// Share of the time for which an outlet is open.
    Outlet,
    /// Pressure of a muscle.
    Pressure,
    /// Torque.
    Torque,
    /// Stiffness.
    Stiffness,
    /// Angle.
    Angle,
    /// Speed.
    Speed,
    /// Acceleration.
    Acceleration,
    /// Highest pressure for which a joint is armed.
    Armed,
}

impl JointField {
    /// Key of the value, including the unit.
    pub const fn key(self) -> &'static str {
        match self {
            Self::Inlet => "inlet",
            Self::Outlet => "outlet",
            Self::Pressure => "pressure_pa",
            Self::Torque => "torque_n_m",
            Self::Stiffness => "stiffness_n_m_rad",
            Self::Angle => "angle_rad",
            Self::Speed => "speed_rad_s",
            Self::Acceleration => "acceleration_rad_s2",
            Self::Armed => "armed_pa",
        }
    }
}

/// Reason why a set point is not accepted; the set point before then stays.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum JointError {
    /// A value is not a number, or out of its range.
    Range {
        /// The value that was refused.
        field: JointField,
        /// Its size, in the unit of its key.
        value: f32,
        /// Smallest permitted value.
        minimum: f32,
        /// Largest permitted value.
        maximum: f32,
    },
    /// Faults of muscles a and b, or of the joint, are present or latched.
    Faults([Faults; 2], JointFaults),
    /// The joint has not been armed since a fault last made it vent.
    NotArmed,
    /// `joint.lock_s` is 0.
    NeverLocks,
}

impl core::fmt::Display for JointError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Range { field, value, minimum, maximum } => {
                write!(f, "{} = {value}: must be from {minimum} to {maximum}", field.key())
            }
            Self::Faults(muscles, joint) => {
                write!(f, "vents until this is cleared: ")?;
                let mut part = "";
                for (name, faults) in ["a", "b"].into_iter().zip(muscles) {
                    if *faults != Faults::NONE {
                        write!(f, "{part}muscle {name}: {faults}")?;
                        part = "; ";
                    }
                }
                if *joint != JointFaults::NONE {
                    write!(f, "{part}joint: {joint}")?;
                }
                Ok(())
            }
            Self::NotArmed => write!(f, "the joint is not armed: arm it first"),
            Self::NeverLocks => {
                write!(
                    f,
                    "joint.lock_s = 0: must be above 0 and at most 600 for a joint that locks"
                )
            }
        }
    }
}

impl core::error::Error for JointError {}

impl JointSetPoint {
    /// The set point `age_s` after it came \[s\]: a motion has continued, up to the stops.
    #[must_use]
    pub fn after(&self, age_s: f32, mechanism: &Mechanism) -> Self {
        let Self::Angle(given) = *self else { return *self };
        let Motion { speed_rad_s, acceleration_rad_s2, stiffness_n_m_rad, .. } = given;
        let for_s = limit(age_s, 0.0, LONGEST_S);
        let gained_rad_s = acceleration_rad_s2 * for_s;
        let moved_rad = given.angle_rad + for_s * (speed_rad_s + 0.5 * gained_rad_s);
        let angle_rad = limit(moved_rad, mechanism.minimum_rad, mechanism.maximum_rad);
        Self::Angle(if age_s < LONGEST_S && angle_rad == moved_rad {
            Motion { angle_rad, speed_rad_s: speed_rad_s + gained_rad_s, ..given }
        } else {
            Motion::still(angle_rad, stiffness_n_m_rad)
        })
    }

    /// Checks every value.
    ///
    /// # Errors
    /// [`JointError::Range`] names the first value that is not permitted; [`JointError::NeverLocks`].
    pub fn check(&self, config: &JointConfig) -> Result<(), JointError> {
        let JointConfig { muscles, mechanism, .. } = config;
        match self {
            Self::Vent => Ok(()),
            Self::Lock if mechanism.lock_s > 0.0 => Ok(()),
            Self::Lock => Err(JointError::NeverLocks),
            Self::Duty { inlet, outlet } => {
                inlet.iter().try_for_each(|share| within(JointField::Inlet, *share, 0.0, 1.0))?;
                outlet.iter().try_for_each(|share| within(JointField::Outlet, *share, 0.0, 1.0))
            }
            Self::Pressures { pressure_pa } => {
                pressure_pa.iter().zip(muscles).try_for_each(|(pa, muscle)| {
                    within(JointField::Pressure, *pa, 0.0, muscle.pressure_limit_pa)
                })
            }
            Self::Torque { torque_n_m, stiffness_n_m_rad } => {
                within(JointField::Torque, *torque_n_m, -LARGEST, LARGEST)?;
                within(JointField::Stiffness, *stiffness_n_m_rad, 0.0, LARGEST)
            }
            Self::Angle(motion) => {
                let (least, most) = (mechanism.minimum_rad, mechanism.maximum_rad);
                within(JointField::Angle, motion.angle_rad, least, most)?;
                within(JointField::Speed, motion.speed_rad_s, -FASTEST_RAD_S, FASTEST_RAD_S)?;
                let acceleration = motion.acceleration_rad_s2;
                within(JointField::Acceleration, acceleration, -LARGEST_RAD_S2, LARGEST_RAD_S2)?;
                within(JointField::Stiffness, motion.stiffness_n_m_rad, 0.0, LARGEST)
            }
        }
    }
}

fn within(field: JointField, value: f32, minimum: f32, maximum: f32) -> Result<(), JointError> {
    // NaN fails both.
    if value >= minimum && value <= maximum {
        Ok(())
    } else {
        Err(JointError::Range { field, value, minimum, maximum })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_goes_on_until_the_next_set_point() {
        let mechanism = Mechanism::default();
        let given = Motion {
            angle_rad: 0.2,
            speed_rad_s: 2.0,
            acceleration_rad_s2: -4.0,
            stiffness_n_m_rad: 14.0,
        };
        let after = |age_s| match JointSetPoint::Angle(given).after(age_s, &mechanism) {
            JointSetPoint::Angle(motion) => motion,
            _ => panic!(),
        };
        assert_eq!(after(0.0), given);
        // 0.2 + 2 t - 2 t^2
        assert!((after(0.01).angle_rad - 0.2198).abs() < 1e-6);
        assert!((after(0.01).speed_rad_s - 1.96).abs() < 1e-6);
        let last = after(1.0);
        assert_eq!(last, after(LONGEST_S));
        assert!((last.angle_rad - 0.38).abs() < 1e-6 && last.speed_rad_s == 0.0, "{last:?}");
        let fast = JointSetPoint::Angle(Motion { speed_rad_s: 1.0e3, ..given });
        let stop = JointSetPoint::Angle(Motion::still(mechanism.maximum_rad, 14.0));
        assert_eq!(fast.after(0.01, &mechanism), stop);
        let torque = JointSetPoint::Torque { torque_n_m: 1.0, stiffness_n_m_rad: 14.0 };
        assert_eq!(torque.after(0.05, &mechanism), torque);
    }

    #[test]
    fn a_refusal_says_what_is_allowed() {
        let config = JointConfig::default();
        let refused = |set_point: JointSetPoint| set_point.check(&config).unwrap_err().to_string();
        let angle = JointSetPoint::Angle(Motion::still(0.9, 14.0));
        assert_eq!(refused(angle), "angle_rad = 0.9: must be from -0.8 to 0.8");
        let torque = JointSetPoint::Torque { torque_n_m: f32::NAN, stiffness_n_m_rad: 1.0 };
        assert!(refused(torque).starts_with("torque_n_m = NaN"));
        let pressures = JointSetPoint::Pressures { pressure_pa: [2.0e5, 7.0e5] };
        assert_eq!(refused(pressures), "pressure_pa = 700000: must be from 0 to 689500");
        let duty = JointSetPoint::Duty { inlet: [0.0, 1.1], outlet: [0.0; 2] };
        assert!(refused(duty).starts_with("inlet = 1.1"));
        assert_eq!(JointSetPoint::Angle(Motion::still(0.5, 14.0)).check(&config), Ok(()));
    }
}
