//! What moves with the gas: volume, force, surface over length, one file per kind with its keys of the
//! scenario. A vessel, whose volume nothing but a profile changes, is a plant of its own.
//!
//! The signs are the core's: a force is positive where it pulls the ends together, a load where it pulls
//! them apart.

pub mod braid;
pub mod cylinder;
mod kinds;
pub mod table;

pub use kinds::of;
pub(super) use kinds::with_chamber;

use model_core::physics::chamber::ChamberConfig;
use std::fmt;

/// See [`Chamber::loads`].
const LARGEST_LOAD_N: f64 = 1.0e6;

/// Keys of the scenario that the balance of forces tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tunable {
    /// Those that the force area sets, and the power of it that each goes with; the first is reported.
    pub area: &'static [(&'static str, f64)],
    /// The stiffness over the way.
    pub stiffness: &'static str,
}

/// A gas volume between two ends that move.
pub trait Chamber: fmt::Debug {
    /// Length that contraction counts from \[m\].
    fn rest_length(&self) -> f64;

    /// Shortest and longest length that may be asked for \[m\].
    fn lengths(&self) -> [f64; 2];

    /// Lengths between which the equations hold \[m\].
    fn range(&self) -> [f64; 2];

    /// Lengths at which stops carry the load \[m\]; infinite where there is none.
    fn stops(&self) -> [f64; 2];

    /// Gas volume \[m3\].
    fn volume(&self, length: f64) -> f64;

    /// Force per gauge pressure, -dV/dL \[m2\]; positive: pressure pulls the ends together.
    fn force_area(&self, length: f64) -> f64;

    /// Slope of [`Self::force_area`] over length \[m\].
    fn force_area_slope(&self, length: f64) -> f64;

    /// Force without gauge pressure \[N\].
    fn elastic(&self, length: f64) -> f64;

    /// Slope of [`Self::elastic`] over length \[N/m\].
    fn elastic_slope(&self, length: f64) -> f64;

    /// Surface that the gas exchanges heat with \[m2\].
    fn surface(&self, length: f64) -> f64;

    /// Diameter of the gas \[m\].
    fn diameter(&self, length: f64) -> f64;

    /// Length of the gas from port to closed end \[m\].
    fn gas_length(&self, length: f64) -> f64 {
        length
    }

    /// Whether it can push its load; one that cannot is slack.
    fn pushes(&self) -> bool {
        true
    }

    /// Axial zones of gas and wall (`full`).
    fn zones(&self) -> usize;

    /// What the core is configured with of it; the tube's volume \[m3\] is filled and emptied along.
    fn configured(&self, tube_m3: f64) -> ChamberConfig;

    /// What `thermyo tune` can find of it; nothing of what has been measured.
    fn tunable(&self) -> Option<Tunable> {
        None
    }

    /// Smallest and largest force of a load \[N\]: against what pressure does.
    fn loads(&self) -> [f64; 2] {
        if self.direction() > 0.0 { [0.0, LARGEST_LOAD_N] } else { [-LARGEST_LOAD_N, 0.0] }
    }

    /// 1 where pressure pulls the ends together, -1 where it pushes them apart.
    fn direction(&self) -> f64 {
        self.force_area(self.rest_length()).signum()
    }
}
