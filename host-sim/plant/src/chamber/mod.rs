//! Moving chambers: volume, force and surface over the length, with one file per kind and its keys
//! of the scenario. A vessel, whose volume only a profile changes, is a plant of its own.
//!
//! Signs are the core's: a force is positive if it pulls the ends together, a load if it pulls
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

/// Keys of the scenario that the balance of forces determines.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tunable {
    /// Keys that set the force area, each with its power in it; the first is reported.
    pub area: &'static [(&'static str, f64)],
    /// The stiffness over the travel.
    pub stiffness: &'static str,
}

/// A gas volume between two moving ends.
pub trait Chamber: fmt::Debug {
    /// Length from which contraction counts \[m\].
    fn rest_length(&self) -> f64;

    /// Shortest and longest length allowed as a set point \[m\].
    fn lengths(&self) -> [f64; 2];

    /// Lengths between which the equations hold \[m\].
    fn range(&self) -> [f64; 2];

    /// Lengths at which stops carry the load \[m\]; infinite if there is none.
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

    /// Surface through which the gas exchanges heat \[m2\].
    fn surface(&self, length: f64) -> f64;

    /// Diameter of the gas \[m\].
    fn diameter(&self, length: f64) -> f64;

    /// Length of the gas from port to closed end \[m\].
    fn gas_length(&self, length: f64) -> f64 {
        length
    }

    /// Whether the chamber can push its load; otherwise it can be slack.
    fn pushes(&self) -> bool {
        true
    }

    /// Axial zones of gas and wall (`full`).
    fn zones(&self) -> usize;

    /// Configuration of the chamber in the core. `tube_m3` is the volume \[m3\] of the tube, which
    /// fills and empties with the chamber.
    fn configured(&self, tube_m3: f64) -> ChamberConfig;

    /// Parameters that `thermyo tune` can find; none for a measured chamber.
    fn tunable(&self) -> Option<Tunable> {
        None
    }

    /// Smallest and largest force of a load \[N\], which acts against the force of pressure.
    fn loads(&self) -> [f64; 2] {
        if self.direction() > 0.0 { [0.0, LARGEST_LOAD_N] } else { [-LARGEST_LOAD_N, 0.0] }
    }

    /// 1 where pressure pulls the ends together, -1 where it pushes them apart.
    fn direction(&self) -> f64 {
        self.force_area(self.rest_length()).signum()
    }
}
