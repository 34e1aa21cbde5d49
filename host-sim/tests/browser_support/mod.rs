//! Headless Chromium for tests of pages. Without it the tests are skipped with a message;
//! `THERMYO_CHROMIUM` gives its path if it is elsewhere.

use serde_json::Value;
use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use thermyo_boards::image::prepare_node;

const NAMES: [&str; 5] =
    ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"];

pub fn chromium() -> Option<PathBuf> {
    if let Some(path) = env::var_os("THERMYO_CHROMIUM") {
        return Some(PathBuf::from(path));
    }
    let folders: Vec<PathBuf> = env::split_paths(&env::var_os("PATH")?).collect();
    let found = folders
        .iter()
        .flat_map(|folder| NAMES.map(|name| folder.join(name)))
        .find(|path| path.is_file());
    if found.is_none() {
        eprintln!("no Chromium was found: pages are not tried in a browser");
    }
    found
}

/// Findings of a script in `tests/browser` on a page, a file or an address. Its screenshots stay in
/// the target folder's `tmp` under `name`. `more` contains further arguments.
pub fn look(script: &str, chromium: &Path, page: &OsStr, name: &str, more: &[&OsStr]) -> Value {
    let scripts = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/browser");
    prepare_node(&scripts).unwrap();
    let output = Command::new("node")
        .arg(scripts.join(script))
        .args([chromium.as_os_str(), page])
        .arg(Path::new(env!("CARGO_TARGET_TMPDIR")).join(name))
        .args(more)
        .stdin(Stdio::null())
        .output()
        .unwrap();
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}
