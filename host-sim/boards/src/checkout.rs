//! Builds from the checkout that this program was built from: firmware, playground, shared library.
//!
//! Each build adds the compiler target that it needs, and prints progress if it takes minutes.

use std::ffi::{OsStr, OsString};
use std::fs::{self, DirEntry, File, TryLockError};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};
use std::{env, thread};
use thermyo_simulation::board::BoardError;

/// Interval of the progress messages.
const SIGN_OF_LIFE: Duration = Duration::from_secs(10);
/// Polling interval of a lock.
const LOOK: Duration = Duration::from_millis(20);

/// Folder of this crate; empty in a release build, whose bytes must not depend on where it was
/// built.
const CRATE: &str = if cfg!(feature = "release") { "" } else { env!("CARGO_MANIFEST_DIR") };

pub fn host_sim() -> &'static Path {
    let folder = Path::new(CRATE);
    folder.parent().unwrap_or(folder)
}

pub fn workspace() -> PathBuf {
    host_sim().parent().unwrap_or(host_sim()).to_path_buf()
}

pub fn target_folder() -> PathBuf {
    workspace().join(env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()))
}

#[derive(Debug, thiserror::Error)]
pub enum NotBuilt {
    #[error("the compiler's target {target} is missing, and {reason}")]
    NoTarget {
        target: String,
        /// Reason, with the remedy.
        reason: String,
    },
    /// Cargo failed, or cannot be run.
    #[error("{name} did not build:\n{message}")]
    Failed { name: String, message: String },
}

impl From<NotBuilt> for BoardError {
    fn from(error: NotBuilt) -> Self {
        Self::Build { message: error.to_string() }
    }
}

/// Flags with which panics name a dependency's source by its path below the downloaded sources: 2 KB less of a
/// firmware's image, which is then the same on every machine.
fn short_paths() -> OsString {
    let home = env::var_os("CARGO_HOME").filter(|home| !home.is_empty()).map(PathBuf::from);
    let home = home.or_else(|| Some(env::home_dir()?.join(".cargo"))).unwrap_or_default();
    let sources = fs::read_dir(home.join("registry/src")).into_iter().flatten().flatten();
    // The names of those that `cargo package` unpacks begin with a hyphen.
    let kept = |source: &DirEntry| !source.file_name().to_string_lossy().starts_with('-');
    let mut sources: Vec<_> = sources.filter(kept).map(|source| source.path()).collect();
    sources.sort();
    let mut flags = Vec::new();
    for source in sources {
        let mut flag = OsString::from("--remap-path-prefix=");
        flag.push(source);
        flag.push("/=");
        flags.push(flag);
    }
    flags.join(OsStr::new("\x1f"))
}

/// A call of cargo, which decides itself what is stale.
#[derive(Debug)]
pub struct Build<'a> {
    /// Name in messages.
    pub name: &'a str,
    /// Folder in which cargo runs, so that its `.cargo/config.toml` applies.
    pub folder: PathBuf,
    pub target_folder: &'a Path,
    /// Target; `None` builds for this machine.
    pub target: Option<&'a str>,
    pub command: &'a str,
    pub arguments: &'a [&'a str],
}

impl Build<'_> {
    /// Builds, after adding the compiler target if it is missing.
    pub fn run(&self) -> Result<(), NotBuilt> {
        let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        cargo.arg(self.command).arg("--target-dir").arg(self.target_folder);
        if let Some(target) = self.target {
            add_target(target, &self.folder)?;
            cargo.args(["--target", target]);
        }
        cargo.args(self.arguments).current_dir(&self.folder);
        // Cargo sets these for a test's own crate; in this build they would make everything stale.
        for (name, _) in env::vars_os() {
            let text = name.to_string_lossy();
            if text.starts_with("CARGO_PKG_") || text.starts_with("CARGO_PROFILE_") {
                cargo.env_remove(&name);
            }
        }
        if self.target.is_some() {
            // The user's flags are for this machine. These replace them.
            cargo.env_remove("RUSTFLAGS").env("CARGO_ENCODED_RUSTFLAGS", short_paths());
        }
        let doing = format!("building {}", self.name);
        let (status, message) = watched(&mut cargo, &doing, Begins::WhenStale)
            .map_err(|error| self.failed(&error.to_string()))?;
        if status.success() { Ok(()) } else { Err(self.failed(&message)) }
    }

    pub fn read(&self, file: &Path) -> Result<Vec<u8>, NotBuilt> {
        fs::read(file).map_err(|error| self.failed(&format!("{}: {error}", file.display())))
    }

    pub fn failed(&self, message: &str) -> NotBuilt {
        NotBuilt::Failed { name: self.name.to_owned(), message: message.to_owned() }
    }
}

/// Adds a target to the compiler used in a folder, if it is missing there.
pub fn add_target(target: &str, folder: &Path) -> Result<(), NotBuilt> {
    if has_target(target, folder) {
        return Ok(());
    }
    let missing = |reason: String| NotBuilt::NoTarget { target: target.to_owned(), reason };
    let Ok(home) = rustup(&["show", "home"], folder) else {
        return Err(missing(
            "there is no rustup to add it: install rustup (https://rustup.rs), or the standard library for \
             that target with the program that installed the compiler"
                .to_owned(),
        ));
    };
    let add = format!("rustup target add {target}");
    let not_added = |why: String| missing(format!("`{add}` failed: {}", why.trim()));
    // rustup does not lock against a second rustup, and tests call this in parallel.
    let lock = alone(&Path::new(home.trim()).join("thermyo.lock"), &add)
        .map_err(|error| not_added(format!("{}: {error}", home.trim())))?;
    if !has_target(target, folder) {
        say(&format!("adding the compiler's target {target}: {add}"));
        rustup(&["target", "add", target], folder).map_err(not_added)?;
    }
    drop(lock);
    if has_target(target, folder) {
        return Ok(());
    }
    Err(missing(format!(
        "`{add}` did not help: the compiler in use is not one of rustup's; put rustup's first on the PATH"
    )))
}

fn has_target(target: &str, folder: &Path) -> bool {
    let rustc = env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let printed = output(rustc, &["--print", "target-libdir", "--target", target], folder);
    let files = printed.ok().and_then(|libraries| fs::read_dir(libraries.trim()).ok());
    let mut names = files.into_iter().flatten().flatten().map(|file| file.file_name());
    names.any(|name| name.to_string_lossy().starts_with("libcore-"))
}

fn rustup(arguments: &[&str], folder: &Path) -> Result<String, String> {
    output("rustup".into(), arguments, folder)
}

/// Standard output of a program; on failure its standard error.
fn output(program: OsString, arguments: &[&str], folder: &Path) -> Result<String, String> {
    let output = Command::new(program)
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .map_err(|error| error.to_string())?;
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    if output.status.success() { Ok(text(&output.stdout)) } else { Err(text(&output.stderr)) }
}

/// Waits until no other process and no other thread holds this lock. A message reports a long wait.
pub fn alone(lock: &Path, doing: &str) -> io::Result<File> {
    alone_by(lock, doing, SIGN_OF_LIFE, &mut say)
}

fn alone_by(
    lock: &Path,
    doing: &str,
    interval: Duration,
    say: &mut dyn FnMut(&str),
) -> io::Result<File> {
    fs::create_dir_all(lock.parent().unwrap_or(lock))?;
    let file = File::create(lock)?;
    let (began, mut sign_due) = (Instant::now(), interval);
    loop {
        match file.try_lock() {
            Ok(()) => return Ok(file),
            Err(TryLockError::WouldBlock) => thread::sleep(LOOK),
            Err(TryLockError::Error(error)) => return Err(error),
        }
        if began.elapsed() >= sign_due {
            say(&format!("{doing}: {} s, waiting for another process", began.elapsed().as_secs()));
            sign_due += interval;
        }
    }
}

/// Condition at which a program's work begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Begins {
    /// As soon as the program runs.
    AtOnce,
    /// With cargo's first line about stale code; often there is none.
    WhenStale,
}

/// Runs a program that may take minutes. If it has work to do, messages report its start, progress and end. Returns its
/// standard error too.
pub fn watched(
    command: &mut Command,
    doing: &str,
    begins: Begins,
) -> io::Result<(ExitStatus, String)> {
    watched_by(command, doing, begins, SIGN_OF_LIFE, &mut say)
}

/// Whether messages about the progress of a build are printed.
static SILENT: AtomicBool = AtomicBool::new(false);

/// Turns off the messages about the progress of a build, in this process.
pub fn say_nothing() {
    SILENT.store(true, Ordering::Relaxed);
}

fn say(line: &str) {
    if SILENT.load(Ordering::Relaxed) {
        return;
    }
    // A closed standard error does not stop the work.
    let _ = writeln!(io::stderr(), "thermyo: {line}");
}

fn watched_by(
    command: &mut Command,
    doing: &str,
    begins: Begins,
    interval: Duration,
    say: &mut dyn FnMut(&str),
) -> io::Result<(ExitStatus, String)> {
    let mut child =
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn()?;
    let (sender, lines) = mpsc::channel();
    let stderr = child.stderr.take();
    let reader =
        thread::spawn(move || stderr.map(|stderr| read_lines(stderr, |line| sender.send(line))));
    let (began, mut sign_due, mut message) = (Instant::now(), interval, String::new());
    // The latest line about work, if any.
    let mut working: Option<String> = None;
    // Another build holds the lock, often only for a moment.
    let mut blocked = false;
    let begin = format!("{doing}; this can take minutes");
    if begins == Begins::AtOnce {
        say(&begin);
        working = Some(String::new());
    }
    loop {
        match lines.recv_timeout(sign_due.saturating_sub(began.elapsed())) {
            Ok(line) => {
                if is_work(&line) {
                    if working.is_none() {
                        say(&begin);
                    }
                    working = Some(format!(", {}", line.trim()));
                }
                blocked |= line.trim_start().starts_with("Blocking");
                message += &line;
            }
            Err(RecvTimeoutError::Timeout) => {
                if blocked && working.is_none() {
                    say(&begin);
                    working = Some(", waiting for another build".to_owned());
                }
                if let Some(line) = &working {
                    say(&format!("{doing}: {} s{line}", began.elapsed().as_secs()));
                }
                sign_due += interval;
            }
            Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    let status = child.wait()?;
    // The reader ended with its pipe.
    let _ = reader.join();
    if working.is_some() && status.success() {
        say(&format!("{doing}: done, {} s", began.elapsed().as_secs()));
    }
    Ok((status, message))
}

/// Whether cargo prints this line when it has work to do.
fn is_work(line: &str) -> bool {
    let work = ["Compiling", "Downloading", "Updating"];
    work.iter().any(|word| line.trim_start().starts_with(word))
}

fn read_lines<E>(from: impl Read, mut take: impl FnMut(String) -> Result<(), E>) {
    let mut from = BufReader::new(from);
    let mut line = Vec::new();
    while from.read_until(b'\n', &mut line).is_ok_and(|count| count > 0) {
        if take(String::from_utf8_lossy(&line).into_owned()).is_err() {
            return;
        }
        line.clear();
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// All messages while a shell runs a script, without the seconds.
    fn messages(script: &str, begins: Begins) -> (Vec<String>, String) {
        let mut messages = Vec::new();
        let mut keep = |line: &str| messages.push(line.replace(char::is_numeric, ""));
        let mut shell = Command::new("sh");
        let shell = shell.args(["-c", script]);
        // The script takes many of these intervals: several messages appear on any machine.
        let interval = Duration::from_millis(20);
        let (_, message) = watched_by(shell, "building it", begins, interval, &mut keep).unwrap();
        messages.dedup();
        (messages, message)
    }

    #[test]
    fn a_wait_for_another_build_is_said_if_it_lasts() {
        let folder = tempfile::tempdir().unwrap();
        let lock = folder.path().join("target/images.lock");
        let silent = &mut |line: &str| panic!("{line}");
        let held = alone_by(&lock, "building it", Duration::MAX, silent).unwrap();
        let (sender, lines) = mpsc::channel();
        let waits = thread::spawn({
            let lock = lock.clone();
            move || {
                let say = &mut |line: &str| sender.send(line.to_owned()).unwrap();
                alone_by(&lock, "building it", Duration::ZERO, say).map(drop)
            }
        });
        assert_eq!(lines.recv().unwrap(), "building it: 0 s, waiting for another process");
        drop(held);
        waits.join().unwrap().unwrap();
        alone_by(&lock, "building it", Duration::MAX, silent).unwrap();
    }

    #[test]
    fn a_build_says_that_it_begins_lives_and_is_done_and_is_silent_with_nothing_to_do() {
        let script = "echo '   Compiling one v' >&2; sleep 0.5; echo 'warning: two' >&2";
        let (lines, message) = messages(script, Begins::WhenStale);
        let expected = [
            "building it; this can take minutes",
            "building it:  s, Compiling one v",
            "building it: done,  s",
        ];
        assert_eq!(lines, expected);
        assert_eq!(message, "   Compiling one v\nwarning: two\n");
        let (lines, message) = messages("sleep 0.2; echo '    Finished' >&2", Begins::WhenStale);
        assert_eq!((lines, message.as_str()), (Vec::new(), "    Finished\n"));
        // A lock is reported only if it lasts.
        let (lines, _) = messages("echo '    Blocking waiting' >&2", Begins::WhenStale);
        assert_eq!(lines, Vec::<String>::new());
        let (lines, _) = messages("echo '    Blocking waiting' >&2; sleep 0.5", Begins::WhenStale);
        assert_eq!(lines.first().unwrap(), "building it; this can take minutes");
        let (lines, _) = messages("exit 1", Begins::AtOnce);
        assert_eq!(lines, ["building it; this can take minutes"]);
    }
}
