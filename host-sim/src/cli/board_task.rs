//! Tasks of `thermyo board PORT`, of one muscle or of a joint.

use super::calibrate::CalibrateArgs;
use super::drive::DriveArgs;
use super::set::SetArgs;
use super::tune;
use clap::{Args, Subcommand};
use std::path::PathBuf;

#[derive(Debug, Subcommand)]
pub(super) enum BoardTask {
    /// Print identity, configuration, faults and state of the board
    Info,
    /// Arm the board: set points are accepted until something vents it
    Arm(ArmArgs),
    /// Send a set point, show the muscle, and vent in the end
    Set(SetArgs),
    /// Vent
    Stop,
    /// Clear latched faults whose cause is gone
    Clear,
    /// Read, write, save or delete the configuration
    #[command(subcommand)]
    Config(ConfigTask),
    /// Print restarts and venting faults, the latest first
    History,
    /// Calibrate a sensor at two points with a reference instrument
    Calibrate(CalibrateArgs),
    /// Drive a profile and record it like a simulated run: trace.csv, summary.json, report.html
    Drive(DriveArgs),
    /// Plug in the emulated board again, with the muscle of a scenario, or with the joint of one and its image
    Plug {
        /// Scenario file (TOML) [default: the muscle of the default keys]
        scenario: Option<PathBuf>,
    },
    /// Unplug the emulated board
    Unplug,
}

#[derive(Debug, Args)]
pub(super) struct ArmArgs {
    /// Highest absolute pressure of a set point, such as 2bar or 200000 (Pa) [default: the limit in
    /// the configuration]
    #[arg(long, value_name = "PRESSURE", allow_hyphen_values = true, value_parser = tune::pressure)]
    pub(super) max_pressure: Option<f64>,
}

#[derive(Debug, Subcommand)]
pub(super) enum ConfigTask {
    /// Write the configuration to a scenario file
    Read {
        /// Scenario file that does not exist yet
        file: PathBuf,
    },
    /// Send the core's part of a scenario; the board vents and is not armed
    Write {
        /// Scenario file (TOML)
        file: PathBuf,
    },
    /// Save the configuration in flash
    Save,
    /// Delete the saved configuration
    Forget,
}
