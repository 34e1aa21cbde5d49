//! What is broken, and what must vent because of it.

pub mod supervisor;
pub mod watch;
