//! The firmware's images and the emulator's files: built in, or from the checkout, built when
//! stale.

use crate::checkout::{self, Begins, Build, alone, watched, workspace};
use crate::inside;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use thermyo_simulation::board::BoardError;

const RP2040: &str = "thumbv6m-none-eabi";
const RP2350: &str = "thumbv8m.main-none-eabihf";

/// Oldest Node.js that runs the emulator.
const NODE_MAJOR: u32 = 18;

const FETCHING: &str = "fetching Node.js packages";

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variant {
    /// The firmware that users flash.
    Standard,
    /// The firmware that users flash, for the Pico 2.
    Pico2,
    /// Firmware that gets its samples from the host.
    Hil,
    /// The firmware for a joint.
    Joint,
    /// The firmware for a joint, on the Pico 2.
    JointPico2,
}

impl Variant {
    fn target(self) -> &'static str {
        match self {
            Self::Standard | Self::Hil | Self::Joint => RP2040,
            Self::Pico2 | Self::JointPico2 => RP2350,
        }
    }

    fn arguments(self) -> &'static [&'static str] {
        match self {
            Self::Standard => &[],
            Self::Hil => &["--features", "hil"],
            Self::Pico2 => &["--no-default-features", "--features", "pico2"],
            Self::Joint => &["--features", "joint"],
            Self::JointPico2 => &["--no-default-features", "--features", "pico2,joint"],
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Standard => "the firmware",
            Self::Hil => "the firmware for samples of the host",
            Self::Pico2 => "the firmware for the Pico 2",
            Self::Joint => "the firmware for a joint",
            Self::JointPico2 => "the firmware for a joint on the Pico 2",
        }
    }

    fn file(self) -> &'static str {
        match self {
            Self::Standard => "firmware.elf",
            Self::Hil => "firmware-hil.elf",
            Self::Pico2 => "firmware-pico2.elf",
            Self::Joint => "firmware-joint.elf",
            Self::JointPico2 => "firmware-joint-pico2.elf",
        }
    }
}

/// Image of the firmware: built in, or the checkout's, up to date.
pub fn firmware(variant: Variant) -> Result<PathBuf, BoardError> {
    if let Some(folder) = inside::emulator()? {
        return Ok(folder.join(variant.file()));
    }
    // A separate folder, since the cargo of a test holds the lock of the usual one.
    let target_folder = checkout::target_folder().join("firmware");
    let mut arguments = vec!["--release"];
    arguments.extend(variant.arguments());
    let build = Build {
        name: variant.name(),
        folder: workspace().join("firmware"),
        target_folder: &target_folder,
        target: Some(variant.target()),
        command: "build",
        arguments: &arguments,
    };
    // The variants share a target folder, and so their dependencies, and the name of the image. Each image is copied to
    // a name of its own, and appears there complete; only then is another one built.
    let lock = alone(&target_folder.join("images.lock"), &format!("building {}", variant.name()))
        .map_err(|error| build.failed(&format!("{}: {error}", target_folder.display())))?;
    build.run()?;
    let image = target_folder.join(variant.file());
    let copy = image.with_extension(format!("{}.part", std::process::id()));
    fs::copy(target_folder.join(variant.target()).join("release").join("firmware"), &copy)
        .and_then(|_| fs::rename(&copy, &image))
        .map_err(|error| build.failed(&error.to_string()))?;
    drop(lock);
    Ok(image)
}

/// Prepares the emulator; returns the folder of its scripts.
pub fn prepare_emulator() -> Result<PathBuf, BoardError> {
    if let Some(folder) = inside::emulator()? {
        check_node()?;
        return Ok(folder);
    }
    let folder = checkout::host_sim().join("emulator");
    prepare_node(&folder)?;
    Ok(folder)
}

/// Checks that Node.js is installed and new enough.
fn check_node() -> Result<(), BoardError> {
    let output = Command::new("node").arg("--version").output().map_err(|_| BoardError::NoNode)?;
    let version = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    let major =
        version.trim_start_matches('v').split('.').next().and_then(|text| text.parse().ok());
    if major.is_none_or(|major: u32| major < NODE_MAJOR) {
        return Err(BoardError::OldNode { version });
    }
    Ok(())
}

/// Prepares a folder's scripts: checks Node.js and installs the packages of the lock file.
pub fn prepare_node(folder: &Path) -> Result<(), BoardError> {
    check_node()?;
    let npm_error = |message: String| BoardError::Npm { message };
    let _one_at_a_time = alone(&checkout::target_folder().join("node.lock"), FETCHING)
        .map_err(|error| npm_error(error.to_string()))?;
    let lock = fs::read(folder.join("package-lock.json")).map_err(|e| npm_error(e.to_string()))?;
    // npm keeps no copy of the lock file from which it installed; this is one.
    let installed = folder.join("node_modules").join(".installed-lock.json");
    if fs::read(&installed).is_ok_and(|content| content == lock) {
        return Ok(());
    }
    let npm = if cfg!(windows) { "npm.cmd" } else { "npm" };
    let mut npm = Command::new(npm);
    npm.args(["ci", "--no-audit", "--no-fund"]).current_dir(folder);
    let (status, message) = watched(&mut npm, FETCHING, Begins::AtOnce)
        .map_err(|error| npm_error(error.to_string()))?;
    if !status.success() {
        return Err(npm_error(message));
    }
    fs::write(&installed, lock).map_err(|error| npm_error(error.to_string()))
}
