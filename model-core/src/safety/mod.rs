//! Faults, and venting because of them.

pub mod supervisor;
pub mod watch;
