//! Volume and surface of whatever holds the gas.

use crate::config::Body;
use crate::math::{absolute, limit};
use crate::physics::geometry::Geometry;

/// How far off a length sensor may be, share of the rest length \[-\].
const SENSOR_OFF: f32 = 0.05;

/// A [`Body`] with the constants of its geometry worked out once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A McKibben muscle.
    Muscle(Geometry),
    /// A vessel of constant section.
    Vessel {
        /// Section \[m2\].
        section_m2: f32,
        /// Inner surface \[m2\].
        surface_m2: f32,
    },
}

impl Shape {
    /// Works the constants out.
    pub fn new(body: &Body) -> Self {
        match *body {
            Body::Muscle(muscle) => Self::Muscle(Geometry::new(muscle)),
            Body::Vessel { section_m2, surface_m2 } => Self::Vessel { section_m2, surface_m2 },
        }
    }

    /// `length_m` limited to what the body can have \[m\].
    pub fn limit_length_m(&self, length_m: f32) -> f32 {
        match self {
            Self::Muscle(geometry) => geometry.limit_length_m(length_m),
            Self::Vessel { .. } => limit(length_m, 1.0e-6, 1.0e6),
        }
    }

    /// Whether it can have that length \[m\], by a sensor that is a little off.
    pub fn can_have_length_m(&self, length_m: f32) -> bool {
        let beyond_m = absolute(length_m - self.limit_length_m(length_m));
        match self {
            Self::Muscle(geometry) => beyond_m <= SENSOR_OFF * geometry.muscle().rest_length_m,
            Self::Vessel { .. } => true,
        }
    }

    /// Gas volume \[m3\] at a length \[m\].
    pub fn volume_m3(&self, length_m: f32) -> f32 {
        match self {
            Self::Muscle(geometry) => geometry.volume_m3(length_m),
            Self::Vessel { section_m2, .. } => section_m2 * length_m,
        }
    }

    /// Surface that the gas exchanges heat with \[m2\].
    pub fn surface_m2(&self, length_m: f32) -> f32 {
        match self {
            Self::Muscle(geometry) => geometry.surface_m2(length_m),
            Self::Vessel { surface_m2, .. } => *surface_m2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    #[test]
    fn a_length_is_impossible_beyond_what_a_sensor_is_off() {
        let muscle = Shape::new(&Config::default().body);
        let shortest_m = muscle.limit_length_m(0.0);
        for (length_m, possible) in [
            (0.3 * 1.049, true),
            (0.3 * 1.051, false),
            (shortest_m - 0.3 * 0.049, true),
            (shortest_m - 0.3 * 0.051, false),
        ] {
            assert_eq!(muscle.can_have_length_m(length_m), possible, "{length_m} m");
        }
        let vessel = Shape::new(&Body::Vessel { section_m2: 0.01, surface_m2: 0.1 });
        assert!([-1.0, 0.0, 1.0e9].into_iter().all(|length_m| vessel.can_have_length_m(length_m)));
    }
}
