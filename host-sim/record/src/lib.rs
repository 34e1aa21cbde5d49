//! What a run leaves: its trace, its summary, and the measurements that it is held against.

pub mod board_trace;
pub mod limit_cycle;
pub mod measured;
pub mod sinks;
pub mod summary;
pub mod trace;
pub mod units;
