//! Files: CSV in, traces and summaries out, and what is wrong with either in one line.

pub mod input;
pub mod number;
pub mod output;
pub mod rows;
pub mod shipped;
pub mod table;
