//! The firmware's images and the emulator's files: the ones inside this program, or the checkout's, built when stale.

use crate::checkout::{self, Begins, Build, watched, workspace};
use crate::inside;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use thermyo_simulation::board::BoardError;

/// Targets of the RP2040 and the RP2350.
const RP2040: &str = "thumbv6m-none-eabi";
const RP2350: &str = "thumbv8m.main-none-eabihf";

/// Oldest Node.js that the emulator runs on.
const NODE_MAJOR: u32 = 18;

/// Builds of the firmware, one at a time.
static BUILD: Mutex<()> = Mutex::new(());

/// A build of the firmware.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Variant {
    /// What a user flashes.
    Standard,
    /// The same for the Pico 2.
    Pico2,
    /// Samples come from the host.
    Hil,
}

impl Variant {
    fn target(self) -> &'static str {
        match self {
            Self::Standard | Self::Hil => RP2040,
            Self::Pico2 => RP2350,
        }
    }

    /// Further arguments of cargo.
    fn arguments(self) -> &'static [&'static str] {
        match self {
            Self::Standard => &[],
            Self::Hil => &["--features", "hil"],
            Self::Pico2 => &["--no-default-features", "--features", "pico2"],
        }
    }

    /// In messages.
    fn name(self) -> &'static str {
        match self {
            Self::Standard => "the firmware",
            Self::Hil => "the firmware for samples of the host",
            Self::Pico2 => "the firmware for the Pico 2",
        }
    }

    /// Name of the image.
    fn file(self) -> &'static str {
        match self {
            Self::Standard => "firmware.elf",
            Self::Hil => "firmware-hil.elf",
            Self::Pico2 => "firmware-pico2.elf",
        }
    }
}

/// The image of the firmware: this program's, or this checkout's, up to date.
///
/// # Errors
/// [`BoardError::NotUnpacked`], [`BoardError::Build`]
pub fn firmware(variant: Variant) -> Result<PathBuf, BoardError> {
    if let Some(folder) = inside::emulator()? {
        return Ok(folder.join(variant.file()));
    }
    let _one_at_a_time = BUILD.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    // A folder of its own: the cargo of a test holds the lock of the usual one.
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
    build.run()?;
    // The variants share the folder, and with it what they are built of; each image gets a place of its own, at once
    // whole.
    let image = target_folder.join(variant.file());
    let copy = image.with_extension(format!("{}.part", std::process::id()));
    fs::copy(target_folder.join(variant.target()).join("release").join("firmware"), &copy)
        .and_then(|_| fs::rename(&copy, &image))
        .map_err(|error| build.failed(&error.to_string()))?;
    Ok(image)
}

/// Sees to it that the emulator can start; the folder of its scripts.
///
/// # Errors
/// [`BoardError::NotUnpacked`], or as [`prepare_node`].
pub fn prepare_emulator() -> Result<PathBuf, BoardError> {
    if let Some(folder) = inside::emulator()? {
        check_node()?;
        return Ok(folder);
    }
    let folder = checkout::host_sim().join("emulator");
    prepare_node(&folder)?;
    Ok(folder)
}

/// Whether Node.js is there, and new enough.
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

/// Sees to it that a folder's scripts can start: Node.js is there, and the packages of its lock file.
///
/// # Errors
/// [`BoardError::NoNode`], [`BoardError::OldNode`], [`BoardError::Npm`]
pub fn prepare_node(folder: &Path) -> Result<(), BoardError> {
    let _one_at_a_time = BUILD.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    check_node()?;
    let npm_error = |message: String| BoardError::Npm { message };
    let lock = fs::read(folder.join("package-lock.json")).map_err(|e| npm_error(e.to_string()))?;
    // npm leaves no copy of the lock file that it worked by; this is one.
    let installed = folder.join("node_modules").join(".installed-lock.json");
    if fs::read(&installed).is_ok_and(|content| content == lock) {
        return Ok(());
    }
    let npm = if cfg!(windows) { "npm.cmd" } else { "npm" };
    let mut npm = Command::new(npm);
    npm.args(["ci", "--no-audit", "--no-fund"]).current_dir(folder);
    let (status, message) = watched(&mut npm, "fetching Node.js packages", Begins::AtOnce)
        .map_err(|error| npm_error(error.to_string()))?;
    if !status.success() {
        return Err(npm_error(message));
    }
    fs::write(&installed, lock).map_err(|error| npm_error(error.to_string()))
}
