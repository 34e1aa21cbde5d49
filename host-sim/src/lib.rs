//! The `thermyo` command: arguments, output, and the commands that need a terminal or a drive.

pub mod cli;
pub mod commands;
pub mod fmu;
