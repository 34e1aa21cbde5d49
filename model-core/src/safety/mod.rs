//! Faults, and venting because of them.

pub mod plausibility;
pub mod supervisor;
