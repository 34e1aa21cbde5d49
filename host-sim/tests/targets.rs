//! The compiler's targets are added if they are missing, once, or the message describes how.
#![cfg(unix)]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

/// Puts a script on the PATH of [`playground`].
fn program(folder: &Path, name: &str, script: &str) {
    let file = folder.join(name);
    let at = folder.display();
    // The scripts need their own tools: the command under test does not find them.
    let text = format!("#!/bin/sh\nPATH=/usr/bin:/bin\ncd '{at}'\n{script}\n");
    fs::write(&file, text).unwrap();
    fs::set_permissions(&file, fs::Permissions::from_mode(0o755)).unwrap();
}

/// A machine whose compiler lacks the target for browsers. It has no rustup, and its cargo fails.
fn machine() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    program(folder.path(), "rustc", "echo \"$PWD/lib\"");
    program(folder.path(), "cargo", "echo 'cargo was called' >&2; exit 101");
    folder
}

fn playground(machine: &TempDir) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_thermyo"));
    command
        .arg("playground")
        .arg("--out")
        .arg(machine.path().join("out"))
        .env("PATH", machine.path())
        .env("CARGO", machine.path().join("cargo"))
        .env_remove("RUSTC")
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn without_rustup_one_line_names_the_missing_target() {
    let machine = machine();
    let output = playground(&machine).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert_eq!(
        said(&output),
        "thermyo: the compiler's target wasm32-unknown-unknown is missing, and there is no rustup to add \
         it: install rustup (https://rustup.rs), or the standard library for that target with the \
         program that installed the compiler\n"
    );
    assert!(!machine.path().join("out").exists(), "half a result is left");
}

#[test]
fn a_rustup_that_fails_is_quoted() {
    let machine = machine();
    let script = "[ \"$1\" = show ] && pwd && exit; echo 'error: no route to host' >&2; exit 1";
    program(machine.path(), "rustup", script);
    let output = playground(&machine).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let add = "rustup target add wasm32-unknown-unknown";
    assert_eq!(
        said(&output),
        format!(
            "thermyo: adding the compiler's target wasm32-unknown-unknown: {add}\nthermyo: the \
             compiler's target wasm32-unknown-unknown is missing, and `{add}` failed: error: no route \
             to host\n"
        )
    );
}

#[test]
fn a_target_that_rustup_gives_to_another_compiler_does_not_help() {
    let machine = machine();
    program(machine.path(), "rustup", "pwd");
    let output = playground(&machine).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("did not help: the compiler in use"), "{}", said(&output));
}

#[test]
fn programs_that_miss_a_target_at_once_add_it_once_and_go_on() {
    let machine = machine();
    let add = "mkdir busy || exit 1; sleep 0.3; echo \"$@\" >>calls; mkdir -p lib; \
               touch lib/libcore-1.rlib; rmdir busy";
    program(machine.path(), "rustup", &format!("[ \"$1\" = show ] && pwd && exit\n{add}"));
    let running: Vec<_> = (0..4).map(|_| playground(&machine).spawn().unwrap()).collect();
    let outputs = running.into_iter().map(|child| child.wait_with_output().unwrap());
    let said: Vec<String> = outputs.map(|output| said(&output)).collect();
    let calls = fs::read_to_string(machine.path().join("calls")).unwrap();
    assert_eq!(calls, "target add wasm32-unknown-unknown\n", "{said:?}");
    // All attempts continue, up to a cargo that fails.
    assert!(said.iter().all(|said| said.contains("cargo was called")), "{said:?}");
    let adding = said.iter().filter(|said| said.contains("adding the compiler's target")).count();
    assert_eq!(adding, 1, "{said:?}");
}
