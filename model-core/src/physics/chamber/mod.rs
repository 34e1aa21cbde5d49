//! The volume that holds the gas: a muscle, a vessel, a cylinder, a measured table. Everything else in the core uses
//! the trait [`Chamber`], whichever of them it is.
//!
//! One sign convention covers chambers that shorten under pressure and chambers that lengthen:
//!
//! - the length L \[m\] is the distance between the two ends to which the load is fixed;
//! - a force is positive if it pulls the ends together; a load is the force that it balances, positive if it pulls them
//!   apart. Without friction F = -P_g dV/dL + the elastic force (Chou and Hannaford 1994);
//! - dV/dL is negative for a chamber that shortens under pressure, and positive for one that lengthens;
//! - contraction is (L_0 - L)/L_0, L_0 being the length at rest: negative beyond it.
//!
//! # How to add a chamber
//!
//! - Add a file here: its configuration with `check`, and a `From` for the type that implements [`Chamber`]. Add its
//!   `mod` and its line in `chambers!` below; raise `thermyo_protocol::PROTOCOL`, with its pinned bytes.
//! - In the simulator, add a file in `host-sim/plant/src/chamber/`: its `table!` of keys and its law in f64, derived
//!   independently of this one. Add its arm in `with_chamber!`, its word in `PlantKind`, its field and its line in
//!   `host-sim/scenario/src/tables/`.
//! - Add its row in `MOVING` of `tests/tests/chambers.rs`: estimate, pressure and position on every plant.
//! - Add its row in `docs/reference/chambers.md`.
//!
//! Nothing else depends on the set of chambers.

pub mod braid;
pub mod cylinder;
pub mod table;
pub mod vessel;

pub use self::braid::{Braid, BraidError, Muscle};
pub use self::cylinder::Cylinder;
pub use self::table::Table;
pub use self::vessel::Vessel;

use crate::math::{absolute, limit};
use crate::parameter::ConfigError;

/// Permitted error of a length sensor, share of the rest length \[-\].
const SENSOR_OFF: f32 = 0.05;
/// Smallest dV/dL that turns pressure into force \[m2\].
const LEAST_SLOPE_M2: f32 = 1.0e-9;

/// Gauge pressure over which the slope of the stiffness is taken; the stiffness is linear in it \[Pa\].
const SLOPE_OVER_PA: f32 = 1.0e5;

/// Force and stiffness at a length, as functions of the gauge pressure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Springs {
    /// Force without pressure \[N\].
    pub force_n: f32,
    /// Stiffness without pressure \[N/m\].
    pub stiffness_n_m: f32,
    /// Stiffness per gauge pressure \[m\].
    pub stiffness_m: f32,
}

impl Springs {
    fn of(chamber: &(impl Chamber + ?Sized), length_m: f32) -> Self {
        let stiffness_n_m = chamber.stiffness_n_m(0.0, length_m);
        let stiffer_n_m = chamber.stiffness_n_m(SLOPE_OVER_PA, length_m) - stiffness_n_m;
        Self {
            force_n: chamber.force_n(0.0, length_m),
            stiffness_n_m,
            stiffness_m: stiffer_n_m * (1.0 / SLOPE_OVER_PA),
        }
    }
}

/// A gas volume with two ends.
pub trait Chamber {
    /// Whether pressure and load move the chamber; if not, something else sets its length.
    fn moves(&self) -> bool {
        true
    }

    /// Length at which contraction is 0 \[m\].
    fn rest_length_m(&self) -> f32;

    /// Shortest length that the chamber can have, or that its equations cover \[m\].
    fn shortest_m(&self) -> f32;

    /// Longest length \[m\].
    fn longest_m(&self) -> f32;

    /// Gas volume \[m3\] at a length \[m\].
    fn volume_m3(&self, length_m: f32) -> f32;

    /// dV/dL \[m2\] at a length \[m\].
    fn volume_slope_m2(&self, length_m: f32) -> f32;

    /// Surface over which the gas exchanges heat \[m2\] at a length \[m\].
    fn surface_m2(&self, length_m: f32) -> f32;

    /// Force without friction \[N\] at a gauge pressure \[Pa\] and a length \[m\].
    fn force_n(&self, gauge_pressure_pa: f32, length_m: f32) -> f32;

    /// Smallest force that the chamber exerts on its load \[N\]: 0 if it cannot push.
    fn least_force_n(&self) -> f32 {
        f32::MIN
    }

    /// dF/dL \[N/m\] of [`Chamber::force_n`] at constant pressure.
    fn stiffness_n_m(&self, gauge_pressure_pa: f32, length_m: f32) -> f32;

    /// [`Chamber::force_n`] and [`Chamber::stiffness_n_m`] at a length \[m\], at every pressure.
    fn springs(&self, length_m: f32) -> Springs {
        Springs::of(self, length_m)
    }

    /// Length \[m\] at which the chamber holds a force \[N\] at a gauge pressure \[Pa\], within its range.
    fn length_for_force_m(&self, gauge_pressure_pa: f32, force_n: f32) -> f32;

    /// Gauge pressure \[Pa\] at which the chamber holds a force \[N\] at a length \[m\]; 0 if it cannot.
    fn gauge_pressure_for_force_pa(&self, force_n: f32, length_m: f32) -> f32 {
        let slope_m2 = self.volume_slope_m2(length_m);
        if !(absolute(slope_m2) > LEAST_SLOPE_M2) {
            return 0.0;
        }
        (self.force_n(0.0, length_m) - force_n) / slope_m2
    }

    /// `length_m` within the chamber's range \[m\].
    fn limit_length_m(&self, length_m: f32) -> f32 {
        limit(length_m, self.shortest_m(), self.longest_m())
    }

    /// Whether the chamber can have this length \[m\], allowing for a small error of the sensor.
    fn can_have_length_m(&self, length_m: f32) -> bool {
        let limited_m = self.limit_length_m(length_m);
        // Usually the length is in range, and nothing needs to be computed.
        limited_m.to_bits() == length_m.to_bits()
            || absolute(length_m - limited_m) <= SENSOR_OFF * self.rest_length_m()
    }
}

/// The list of chambers, each with its configuration type and its working type. Calls are dispatched statically; the
/// order is that of the bytes on the link.
macro_rules! chambers {
    ($($(#[$meaning:meta])* $name:ident: $configured:ty => $chamber:ty,)*) => {
        /// Configuration of the chamber.
        #[derive(Debug, Clone, Copy, PartialEq)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        pub enum ChamberConfig {
            $($(#[$meaning])* $name($configured),)*
        }

        impl ChamberConfig {
            /// Checks every value.
            ///
            /// # Errors
            /// The first value that is not a number or lies outside of its range.
            pub fn check(&self) -> Result<(), ConfigError> {
                match self {
                    $(Self::$name(configured) => configured.check(),)*
                }
            }
        }

        /// Any of the chambers, with its constants computed once.
        #[allow(clippy::large_enum_variant)] // There is no heap, and a core has one.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub enum AnyChamber {
            $($(#[$meaning])* $name($chamber),)*
        }

        impl AnyChamber {
            /// Computes the constants.
            ///
            /// ```
            /// use model_core::Config;
            /// use model_core::physics::chamber::{AnyChamber, Chamber};
            ///
            /// let muscle = AnyChamber::new(&Config::default().chamber);
            /// assert!(muscle.force_n(1.0e5, 0.28) > muscle.force_n(0.0, 0.28));
            /// ```
            #[cold] // Once at a start: as small as can be.
            pub fn new(configured: &ChamberConfig) -> Self {
                match *configured {
                    $(ChamberConfig::$name(configured) => Self::$name(configured.into()),)*
                }
            }
        }

        macro_rules! ask {
            ($any:expr, $one:ident => $answer:expr) => {
                match $any {
                    $(AnyChamber::$name($one) => $answer,)*
                }
            };
        }
    };
}

chambers! {
    /// A McKibben muscle.
    Muscle: Muscle => braid::Geometry,
    /// A vessel.
    Vessel: Vessel => Vessel,
    /// A single-acting cylinder.
    Cylinder: Cylinder => cylinder::Piston,
    /// A measured chamber, such as a bellows.
    Table: Table => table::Curve,
}

impl Chamber for AnyChamber {
    fn moves(&self) -> bool {
        ask!(self, chamber => chamber.moves())
    }

    fn rest_length_m(&self) -> f32 {
        ask!(self, chamber => chamber.rest_length_m())
    }

    fn shortest_m(&self) -> f32 {
        ask!(self, chamber => chamber.shortest_m())
    }

    fn longest_m(&self) -> f32 {
        ask!(self, chamber => chamber.longest_m())
    }

    fn volume_m3(&self, length_m: f32) -> f32 {
        ask!(self, chamber => chamber.volume_m3(length_m))
    }

    fn volume_slope_m2(&self, length_m: f32) -> f32 {
        ask!(self, chamber => chamber.volume_slope_m2(length_m))
    }

    fn surface_m2(&self, length_m: f32) -> f32 {
        ask!(self, chamber => chamber.surface_m2(length_m))
    }

    fn force_n(&self, gauge_pressure_pa: f32, length_m: f32) -> f32 {
        ask!(self, chamber => chamber.force_n(gauge_pressure_pa, length_m))
    }

    fn least_force_n(&self) -> f32 {
        ask!(self, chamber => chamber.least_force_n())
    }

    fn stiffness_n_m(&self, gauge_pressure_pa: f32, length_m: f32) -> f32 {
        ask!(self, chamber => chamber.stiffness_n_m(gauge_pressure_pa, length_m))
    }

    fn springs(&self, length_m: f32) -> Springs {
        match self {
            Self::Muscle(muscle) => muscle.springs(length_m),
            // One call for each value: as small as can be.
            other => Springs::of(other, length_m),
        }
    }

    fn length_for_force_m(&self, gauge_pressure_pa: f32, force_n: f32) -> f32 {
        ask!(self, chamber => chamber.length_for_force_m(gauge_pressure_pa, force_n))
    }

    fn gauge_pressure_for_force_pa(&self, force_n: f32, length_m: f32) -> f32 {
        ask!(self, chamber => chamber.gauge_pressure_for_force_pa(force_n, length_m))
    }

    fn limit_length_m(&self, length_m: f32) -> f32 {
        ask!(self, chamber => chamber.limit_length_m(length_m))
    }

    fn can_have_length_m(&self, length_m: f32) -> bool {
        ask!(self, chamber => chamber.can_have_length_m(length_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    #[test]
    fn a_length_is_impossible_beyond_what_a_sensor_is_off() {
        let muscle = AnyChamber::new(&Config::default().chamber);
        let shortest_m = muscle.shortest_m();
        for (length_m, possible) in [
            (0.3 * 1.049, true),
            (0.3 * 1.051, false),
            (shortest_m - 0.3 * 0.049, true),
            (shortest_m - 0.3 * 0.051, false),
        ] {
            assert_eq!(muscle.can_have_length_m(length_m), possible, "{length_m} m");
        }
    }

    #[test]
    fn springs_are_force_and_stiffness_at_every_pressure() {
        let mut saturating = Config::default().chamber;
        if let ChamberConfig::Muscle(muscle) = &mut saturating {
            muscle.bladder_saturation_n = 20.0;
        }
        let cylinder = ChamberConfig::Cylinder(Cylinder::default());
        for configured in [Config::default().chamber, saturating, cylinder] {
            let chamber = AnyChamber::new(&configured);
            let span_m = chamber.longest_m() - chamber.shortest_m();
            for length_m in [0.1, 0.5, 0.9].map(|share| chamber.shortest_m() + share * span_m) {
                let Springs { force_n, stiffness_n_m, stiffness_m } = chamber.springs(length_m);
                for gauge_pa in [0.0, 3.0e5] {
                    let pull_n = force_n - gauge_pa * chamber.volume_slope_m2(length_m);
                    let off_n = pull_n - chamber.force_n(gauge_pa, length_m);
                    assert!(off_n.abs() < 1e-3, "{off_n} N, {configured:?}");
                    let spring_n_m = stiffness_n_m + gauge_pa * stiffness_m;
                    let off_n_m = spring_n_m - chamber.stiffness_n_m(gauge_pa, length_m);
                    assert!(off_n_m.abs() < 1e-2, "{off_n_m} N/m, {configured:?}");
                }
            }
        }
    }
}
