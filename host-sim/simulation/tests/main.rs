//! Whole runs, with the core in this process.

mod digital_sensors;
mod fault_windows;
mod run_support;
mod summary;
mod thermistor;
