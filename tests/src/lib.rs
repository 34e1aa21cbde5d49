//! Common code of the system tests: running `thermyo` in this process and reading its files.

pub mod float_pairs;
pub mod joint_guest;
pub mod log;
pub mod m33;
pub mod parity;
pub mod rig;

use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;
use thermyo_boards::checkout::{Build, target_folder};

#[derive(Debug)]
pub struct Outcome {
    pub code: u8,
    pub out: String,
    pub err: String,
}

pub fn thermyo(arguments: &[&str]) -> Outcome {
    let (mut out, mut err) = (Vec::new(), Vec::new());
    let all = ["thermyo"].iter().chain(arguments);
    let code = host_sim::cli::run(all, &mut out, &mut err);
    let text = |bytes| String::from_utf8(bytes).expect("the command prints UTF-8");
    Outcome { code, out: text(out), err: text(err) }
}

/// A finished run: its folder and contents.
#[derive(Debug)]
pub struct Finished {
    /// Deleted when dropped.
    pub folder: TempDir,
    pub summary: serde_json::Value,
}

/// Runs a scenario given as text; `more` are further arguments of `thermyo run`.
pub fn run_text(scenario: &str, more: &[&str]) -> Finished {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("scenario.toml");
    fs::write(&file, scenario).expect("the scenario is written");
    run_file(&file, more)
}

/// Runs a scenario file; see [`run_text`].
pub fn run_file(scenario: &Path, more: &[&str]) -> Finished {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (scenario, out) = (scenario.display().to_string(), folder.path().display().to_string());
    let mut arguments = vec!["run", &scenario, "--out", &out, "--quiet", "--json"];
    arguments.extend(more);
    let outcome = thermyo(&arguments);
    assert_eq!(outcome.code, 0, "{}", outcome.err);
    let summary = serde_json::from_str(&outcome.out).expect("--json prints JSON");
    Finished { folder, summary }
}

impl Finished {
    /// Path of one of the run's files.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// One of the run's files, as text.
    pub fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).expect("the run wrote it")
    }

    pub fn column(&self, name: &str) -> Vec<f64> {
        let text = self.text("trace.csv");
        let mut lines = text.lines();
        let header = lines.next().expect("a header");
        let index = header.split(',').position(|cell| cell == name).expect("the column is there");
        lines
            .map(|line| line.split(',').nth(index).expect("a cell").parse().expect("a number"))
            .collect()
    }

    /// A figure of the summary by its path, such as `rmse_k.estimate`.
    pub fn figure(&self, path: &str) -> f64 {
        let value = path.split('.').fold(&self.summary, |value, key| &value[key]);
        value.as_f64().unwrap_or_else(|| panic!("{path} is not a number in {}", self.summary))
    }
}

#[track_caller]
pub fn assert_within(what: &str, value: f64, (low, high): (f64, f64)) {
    assert!((low..=high).contains(&value), "{what}: {value}, allowed {low} to {high}");
}

/// A file of the repository.
pub fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// The ELF file of a guest. It is built in the firmware's folder, whose configuration sets how its
/// images are optimised.
fn guest(folder: &str, target: &str, package: &str) -> Vec<u8> {
    let folder = target_folder().join(folder);
    let build = Build {
        name: package,
        folder: repository("firmware"),
        target_folder: &folder,
        target: Some(target),
        command: "build",
        arguments: &["--release", "--package", package],
    };
    let image = folder.join(target).join("release").join(package);
    build.run().and_then(|()| build.read(&image)).unwrap_or_else(|error| panic!("{error}"))
}
