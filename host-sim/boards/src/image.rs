//! The firmware and what the emulator needs: those inside this program, or those of its checkout, built when stale.

use crate::inside;
use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::Mutex;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;
use std::{env, fs, thread};
use thermyo_simulation::board::BoardError;

/// Targets of the RP2040 and the RP2350.
const RP2040: &str = "thumbv6m-none-eabi";
const RP2350: &str = "thumbv8m.main-none-eabihf";

/// Oldest Node.js that the emulator runs on.
const NODE_MAJOR: u32 = 18;

/// Whoever waits longer than that wants to know what for.
const PATIENCE: Duration = Duration::from_secs(2);

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

    /// Name of the image.
    fn file(self) -> &'static str {
        match self {
            Self::Standard => "firmware.elf",
            Self::Hil => "firmware-hil.elf",
            Self::Pico2 => "firmware-pico2.elf",
        }
    }
}

/// The folder `host-sim`. A program that is given away knows of none, and so is the same wherever it was built.
fn host_sim() -> &'static Path {
    let crate_folder =
        Path::new(if cfg!(feature = "release") { "" } else { env!("CARGO_MANIFEST_DIR") });
    crate_folder.parent().unwrap_or(crate_folder)
}

/// Folder of the workspace that this program was built from.
pub fn workspace() -> PathBuf {
    let host_sim = host_sim();
    host_sim.parent().unwrap_or(host_sim).to_path_buf()
}

/// Why cargo has built nothing.
pub enum NotBuilt {
    /// The compiler's target is not installed.
    NoTarget,
    /// What cargo said.
    Failed(String),
}

/// Builds what a folder of this checkout has for another machine, where it is stale, which cargo decides; gives cargo's
/// target folder. That is one of its own, since a test's cargo holds the lock of the usual one.
///
/// # Errors
/// [`NotBuilt`]
pub fn build(folder: &Path, arguments: &[&str]) -> Result<PathBuf, NotBuilt> {
    let target_folder = env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| workspace().join("target"), PathBuf::from)
        .join("firmware");
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo
        .args(["build", "--target-dir"])
        .arg(&target_folder)
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null());
    // What cargo tells a test about the test itself would make the firmware stale.
    for (name, _) in env::vars_os() {
        let text = name.to_string_lossy();
        if text.starts_with("CARGO_PKG_") || text.starts_with("CARGO_PROFILE_") {
            cargo.env_remove(&name);
        }
    }
    cargo.env_remove("RUSTFLAGS").env_remove("CARGO_ENCODED_RUSTFLAGS");
    let what = format!("builds {}, once: a minute or two", folder.display());
    let output = output(&mut cargo, &what).map_err(|error| NotBuilt::Failed(error.to_string()))?;
    if output.status.success() {
        return Ok(target_folder);
    }
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    let no_target = ["can't find crate for `core`", "target may not be installed"];
    if no_target.iter().any(|text| message.contains(text)) {
        return Err(NotBuilt::NoTarget);
    }
    Err(NotBuilt::Failed(message))
}

/// What a program says that may take minutes the first time; at a terminal it is said what is waited for.
fn output(command: &mut Command, what: &str) -> io::Result<Output> {
    if !io::stderr().is_terminal() {
        return command.output();
    }
    waited_for(&mut io::stderr(), what, PATIENCE, || command.output())
}

fn waited_for<T>(
    said: &mut (dyn Write + Send),
    what: &str,
    patience: Duration,
    work: impl FnOnce() -> T,
) -> T {
    let (working, ended) = mpsc::channel::<()>();
    thread::scope(|scope| {
        scope.spawn(move || {
            if ended.recv_timeout(patience) == Err(RecvTimeoutError::Timeout) {
                let _ = writeln!(said, "thermyo: {what}");
            }
        });
        let done = work();
        drop(working);
        done
    })
}

/// The image of the firmware: this program's, or this checkout's, up to date.
///
/// # Errors
/// [`BoardError::NotUnpacked`], [`BoardError::NoTarget`], [`BoardError::Build`]
pub fn firmware(variant: Variant) -> Result<PathBuf, BoardError> {
    if let Some(folder) = inside::emulator()? {
        return Ok(folder.join(variant.file()));
    }
    let _one_at_a_time = BUILD.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let mut arguments = vec!["--release", "--target", variant.target()];
    arguments.extend(variant.arguments());
    let target_folder =
        build(&workspace().join("firmware"), &arguments).map_err(|error| match error {
            NotBuilt::NoTarget => BoardError::NoTarget { target: variant.target() },
            NotBuilt::Failed(message) => BoardError::Build { message },
        })?;
    // The variants share the folder, and with it what they are built of; each image gets a place of its own, at once
    // whole.
    let image = target_folder.join(variant.file());
    let copy = image.with_extension(format!("{}.part", std::process::id()));
    fs::copy(target_folder.join(variant.target()).join("release").join("firmware"), &copy)
        .and_then(|_| fs::rename(&copy, &image))
        .map_err(|error: io::Error| BoardError::Build { message: error.to_string() })?;
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
    let folder = host_sim().join("emulator");
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
    npm.args(["ci", "--no-audit", "--no-fund"]).current_dir(folder).stdin(Stdio::null());
    let output = output(&mut npm, "fetches the emulator's packages, once")
        .map_err(|error| npm_error(error.to_string()))?;
    if !output.status.success() {
        return Err(npm_error(String::from_utf8_lossy(&output.stderr).into_owned()));
    }
    fs::write(&installed, lock).map_err(|error| npm_error(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_waited_for_is_said_and_what_is_quick_is_not() {
        let mut said = Vec::new();
        let long = || thread::sleep(Duration::from_millis(200));
        waited_for(&mut said, "builds it, once", Duration::from_millis(1), long);
        assert_eq!(said, b"thermyo: builds it, once\n");
        said.clear();
        assert_eq!(waited_for(&mut said, "builds it, once", PATIENCE, || 7), 7);
        assert!(said.is_empty());
    }
}
