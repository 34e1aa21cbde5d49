//! Files: CSV in, traces and summaries out, and what is wrong with either in one line.

pub mod board_trace;
pub mod input;
pub mod measured;
pub mod output;
pub mod rows;
pub mod summary;
pub mod table;
pub mod trace;
