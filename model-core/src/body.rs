//! Volume and surface of whatever holds the gas.

use crate::config::Body;
use crate::geometry::Geometry;

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
            Self::Vessel { .. } => crate::math::limit(length_m, 1.0e-6, 1.0e6),
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
