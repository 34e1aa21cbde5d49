//! The shared library that goes into a unit: the C interface of `host-sim/fmu`.
//!
//! A program that is given away has it inside; one of a checkout has it built when it is stale, as the firmware is.

use std::process::{Command, Stdio};
use std::{env, fs};
use thermyo_boards::image::workspace;
use thermyo_boards::inside;
use thermyo_cosimulation::description::LIBRARY;

/// Why there is none.
#[derive(Debug, thiserror::Error)]
#[error("the shared library of the unit did not build:\n{message}")]
pub struct NoLibrary {
    /// What cargo said.
    pub message: String,
}

/// The platform, as FMI writes it.
pub fn platform() -> String {
    let os = match env::consts::OS {
        "macos" => "darwin",
        other => other,
    };
    format!("{}-{os}", env::consts::ARCH)
}

/// How the name of a shared library ends, as FMI has it.
pub fn suffix() -> &'static str {
    env::consts::DLL_SUFFIX
}

/// The library of this platform: this program's, or this checkout's, up to date.
///
/// # Errors
/// [`NoLibrary`]
pub fn library() -> Result<Vec<u8>, NoLibrary> {
    let name = format!("{}{LIBRARY}{}", env::consts::DLL_PREFIX, suffix());
    if let Some(library) = inside::file(&name) {
        return Ok(library);
    }
    let root = workspace();
    let target = env::var_os("CARGO_TARGET_DIR")
        .map_or_else(|| root.join("target"), |folder| root.join(folder));
    let no_library = |message: String| NoLibrary { message };
    let output = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args(["rustc", "--release", "--package", "thermyo-fmu", "--lib", "--target-dir"])
        .arg(&target)
        // A fifth of the size, and no other build of what it is made of.
        .args(["--", "-C", "strip=symbols"])
        .current_dir(&root)
        .stdin(Stdio::null())
        .output()
        .map_err(|error| no_library(format!("cargo in {}: {error}", root.display())))?;
    if !output.status.success() {
        return Err(no_library(String::from_utf8_lossy(&output.stderr).into_owned()));
    }
    let file = target.join("release").join(name);
    fs::read(&file).map_err(|error| no_library(format!("{}: {error}", file.display())))
}
