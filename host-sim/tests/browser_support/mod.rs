//! Headless Chromium for tests of pages. Without it the tests are skipped with a message;
//! `THERMYO_CHROMIUM` gives its path if it is elsewhere.

use serde_json::Value;
use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use thermyo_boards::image::prepare_node;

const NAMES: [&str; 5] =
    ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"];

/// Two tests at once starve each other's pages and boards, and take longer than one after the other.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

pub struct Chromium {
    path: PathBuf,
    _alone: MutexGuard<'static, ()>,
}

impl Chromium {
    /// Waits until no other test has the browser.
    pub fn find() -> Option<Self> {
        let Some(path) = path() else {
            eprintln!("no Chromium was found: pages are not tried in a browser");
            return None;
        };
        let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        Some(Self { path, _alone })
    }

    /// Findings of a script in `tests/browser` on a page, a file or an address. Its screenshots stay in
    /// the target folder's `tmp` under `name`. `more` contains further arguments.
    pub fn look(&self, script: &str, page: &OsStr, name: &str, more: &[&OsStr]) -> Value {
        let scripts = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/browser");
        prepare_node(&scripts).unwrap();
        let output = Command::new("node")
            .arg(scripts.join(script))
            .args([self.path.as_os_str(), page])
            .arg(Path::new(env!("CARGO_TARGET_TMPDIR")).join(name))
            .args(more)
            .stdin(Stdio::null())
            .output()
            .unwrap();
        assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).unwrap()
    }
}

fn path() -> Option<PathBuf> {
    if let Some(path) = env::var_os("THERMYO_CHROMIUM") {
        return Some(PathBuf::from(path));
    }
    let folders: Vec<PathBuf> = env::split_paths(&env::var_os("PATH")?).collect();
    let mut files = folders.iter().flat_map(|folder| NAMES.map(|name| folder.join(name)));
    files.find(|path| path.is_file())
}
