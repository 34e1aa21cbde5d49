//! The emulated board as users have it, with a separate folder for each test.

#![allow(dead_code)] // Every test uses some of this.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::thread;
use std::time::{Duration, Instant};
use tempfile::TempDir;
use thermyo_boards::image::{self, Variant};

use crate::command_support::{Said, command};

pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Waits for a condition, with a limit.
pub fn until(what: &str, mut holds: impl FnMut() -> bool) {
    let began = Instant::now();
    while !holds() {
        assert!(began.elapsed() < Duration::from_secs(180), "{what}: not within three minutes");
        thread::sleep(Duration::from_millis(20));
    }
}

/// Folder of the emulated board, which is unplugged at the end.
pub struct Bench(TempDir);

impl Bench {
    pub fn new() -> Self {
        // Built here, so that the progress is no part of the output that a test compares.
        image::firmware(Variant::Standard).unwrap();
        image::prepare_emulator().unwrap();
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs a line such as `thermyo board emulated info`, from the repository.
    pub fn run(&self, line: &str) -> Said {
        Said::of(line, self.command(line).output().unwrap())
    }

    pub fn start(&self, line: &str) -> Child {
        self.command(line).spawn().unwrap()
    }

    /// The same command, not yet started.
    pub fn command(&self, line: &str) -> Command {
        let mut words = line.split_whitespace();
        assert_eq!(words.next(), Some("thermyo"), "{line}");
        let out = self.path("out");
        let words = words.map(|word| word.replace("out/", &format!("{}/", out.display())));
        let mut command = command(&[]);
        command.args(words).current_dir(repository()).env("TMPDIR", self.0.path());
        command
    }

    /// Output of a command that has to succeed.
    #[track_caller]
    pub fn ok(&self, line: &str) -> String {
        self.run(line).ok().out
    }

    /// JSON output of a command that has to succeed.
    #[track_caller]
    pub fn json(&self, line: &str) -> Value {
        self.run(&format!("{line} --json")).ok().json()
    }

    /// Info of the board once its mode is vent. The startup check, which vents as well, comes
    /// first, and a command may have ended during it.
    pub fn vented(&self) -> String {
        let mut info = String::new();
        until("it vents", || {
            info = self.ok("thermyo board emulated info");
            info.contains(" vent\n")
        });
        info
    }

    #[track_caller]
    pub fn refused(&self, line: &str) -> String {
        self.run(line).ends(2).in_one_line().err
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        self.run("thermyo board emulated unplug");
    }
}
