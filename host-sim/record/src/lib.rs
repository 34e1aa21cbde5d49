//! Results of a run: trace, summary, and comparison with measurements.

mod bandwidth;
pub mod board_trace;
pub mod following;
pub mod limit_cycle;
pub mod measured;
pub mod sinks;
pub mod summary;
pub mod trace;
pub mod tracking;
pub mod units;
