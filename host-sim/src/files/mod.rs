//! Files: CSV in, traces and summaries out, and what is wrong with either in one line.

pub mod board_trace;
pub mod input;
#[cfg(feature = "command")]
pub mod logs;
#[cfg(feature = "command")]
pub mod mcap;
pub mod measured;
pub mod output;
pub mod rows;
pub mod shipped;
pub mod sinks;
#[cfg(feature = "command")]
pub mod stream;
pub mod summary;
pub mod table;
pub mod topics;
pub mod trace;
pub mod units;
