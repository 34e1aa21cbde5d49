//! `thermyo` as users run it, in its own process, and a folder for its files.

use serde_json::Value;
use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};
use tempfile::TempDir;

/// Exit code and output of a command.
pub struct Said {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
    /// The command and its messages, for failed assertions.
    whole: String,
}

/// A command that is not started yet.
pub fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_thermyo"));
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

pub fn thermyo(arguments: &[&str]) -> Said {
    Said::of(&arguments.join(" "), command(arguments).output().unwrap())
}

/// Output of a command without a process, for tests with hundreds of calls.
pub fn in_process(arguments: &[&str]) -> Said {
    let (mut out, mut err) = (Vec::new(), Vec::new());
    let code = host_sim::cli::run(["thermyo"].iter().chain(arguments), &mut out, &mut err);
    Said::new(&arguments.join(" "), Some(code.into()), [out, err])
}

/// Sends Ctrl-C to a command; returns its end.
pub fn interrupted(child: Child) -> Said {
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    Said::of("interrupted", child.wait_with_output().unwrap())
}

impl Said {
    pub fn of(command: &str, Output { status, stdout, stderr }: Output) -> Self {
        Self::new(command, status.code(), [stdout, stderr])
    }

    fn new(command: &str, code: Option<i32>, printed: [Vec<u8>; 2]) -> Self {
        let [out, err] = printed.map(|bytes| String::from_utf8(bytes).unwrap());
        let whole = format!("{command}: exit code {code:?}: {err}");
        Self { code, out, err, whole }
    }

    /// Asserts this exit code.
    #[track_caller]
    pub fn ends(self, code: i32) -> Self {
        assert_eq!(self.code, Some(code), "{}", self.whole);
        self
    }

    /// Asserts success.
    #[track_caller]
    pub fn ok(self) -> Self {
        self.ends(0)
    }

    /// Asserts that the messages contain this text.
    #[track_caller]
    pub fn says(self, expected: &str) -> Self {
        assert!(self.err.contains(expected), "{}", self.whole);
        self
    }

    /// Asserts that the messages are one line.
    #[track_caller]
    pub fn in_one_line(self) -> Self {
        assert_eq!(self.err.lines().count(), 1, "{}", self.whole);
        self
    }

    /// Asserts bad input or usage: exit code 2, this text in the messages, and no output.
    #[track_caller]
    pub fn refused(self, expected: &str) -> Self {
        let refused = self.ends(2).says(expected);
        assert_eq!(refused.out, "", "{}", refused.whole);
        refused
    }

    #[track_caller]
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.out).unwrap_or_else(|_| panic!("{}", self.whole))
    }
}

pub struct Folder(TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A path as an argument.
    pub fn name(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    pub fn has(&self, name: &str) -> bool {
        self.path(name).exists()
    }

    /// Writes a file; returns its path.
    pub fn file(&self, name: &str, text: &str) -> String {
        fs::write(self.path(name), text).unwrap();
        self.name(name)
    }

    /// Writes `scenario.toml`; returns its path.
    pub fn scenario(&self, text: &str) -> String {
        self.file("scenario.toml", text)
    }

    #[track_caller]
    pub fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    #[track_caller]
    pub fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).unwrap()
    }

    /// Runs a scenario, given as text, into a folder below this one.
    pub fn run(&self, scenario: &str, out: &str) -> Said {
        thermyo(&["run", &self.scenario(scenario), "--quiet", "--out", &self.name(out)])
    }
}
