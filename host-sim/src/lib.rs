//! The `thermyo` command: its arguments, what it prints, and the commands that need a terminal or a drive.

pub mod cli;
pub mod commands;
pub mod fmu;
