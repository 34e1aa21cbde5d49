//! Files: CSV input, output of traces and summaries, units, and errors in one line.

pub mod input;
pub mod number;
pub mod output;
pub mod rows;
pub mod shipped;
pub mod table;
pub mod units;
