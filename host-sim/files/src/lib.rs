//! Files: CSV input, output of traces and summaries, and their errors in one line.

pub mod input;
pub mod number;
pub mod output;
pub mod rows;
pub mod shipped;
pub mod table;
