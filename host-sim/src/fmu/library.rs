//! The shared library of a unit: the C interface of `host-sim/fmu`.
//!
//! A release build contains it; a checkout builds it when it is stale, like the firmware.

use std::env;
use thermyo_boards::checkout::{self, Build, NotBuilt, workspace};
use thermyo_boards::inside;
use thermyo_cosimulation::description::LIBRARY;

/// The platform, as FMI writes it.
pub fn platform() -> String {
    let os = match env::consts::OS {
        "macos" => "darwin",
        other => other,
    };
    format!("{}-{os}", env::consts::ARCH)
}

/// File name extension of a shared library in FMI.
pub fn suffix() -> &'static str {
    env::consts::DLL_SUFFIX
}

/// The library of this platform: built in, or the checkout's, up to date.
pub fn library() -> Result<Vec<u8>, NotBuilt> {
    let name = format!("{}{LIBRARY}{}", env::consts::DLL_PREFIX, suffix());
    if let Some(library) = inside::file(&name) {
        return Ok(library);
    }
    let target_folder = checkout::target_folder();
    let build = Build {
        name: "the unit's shared library",
        folder: workspace(),
        target_folder: &target_folder,
        target: None,
        command: "rustc",
        // Without symbols: a fifth of the size, and the dependencies are not rebuilt.
        arguments: &["--release", "--package", "thermyo-fmu", "--lib", "--", "-C", "strip=symbols"],
    };
    build.run()?;
    build.read(&target_folder.join("release").join(name))
}
