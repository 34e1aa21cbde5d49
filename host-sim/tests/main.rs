//! Tests of the `thermyo` command, and of several crates together.

#[cfg(emulator)]
mod board_command;
#[cfg(emulator)]
mod board_guided;
mod board_support;
mod browser_support;
mod command;
mod command_support;
mod docs;
mod init;
mod leak;
mod line;
mod logs;
mod measure;
#[path = "../plant/tests/plant_support/mod.rs"]
mod plant_support;
mod plants;
mod playground;
mod records;
mod report_browser;
mod report_render;
#[path = "../simulation/tests/run_support/mod.rs"]
mod run_support;
mod scenario_files;
#[cfg(emulator)]
mod serve;
#[cfg(emulator)]
mod serve_joint;
#[cfg(emulator)]
mod serve_records;
mod static_map;
mod sweep;
mod targets;
