//! Passes the linker scripts of the chosen board.

use std::env;
use std::fs;
use std::path::Path;

fn main() {
    let folder = env::var("CARGO_MANIFEST_DIR").expect("cargo sets it");
    let boards = Path::new(&folder).join("src/board");
    let mut names: Vec<_> = fs::read_dir(&boards)
        .expect("the boards' folder")
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| boards.join(name).join("board.x").is_file())
        .collect();
    names.sort();
    let chosen =
        |name: &&String| env::var_os(format!("CARGO_FEATURE_{}", name.to_uppercase())).is_some();
    let chosen: Vec<_> = names.iter().filter(chosen).collect();
    let [board] = chosen[..] else {
        let features: Vec<_> = names.iter().map(|name| name.replace('_', "-")).collect();
        panic!(
            "{} boards are chosen: give --no-default-features, and one of {features:?} to --features",
            chosen.len()
        );
    };
    let script = boards.join(board).join("board.x");
    for argument in [&format!("-T{}", script.display()), "-Tdefmt.x", "--nmagic"] {
        println!("cargo:rustc-link-arg-bins={argument}");
    }
    // Included scripts: those shared by a family of boards, and `memory.x`, for a linker that runs
    // in another folder.
    println!("cargo:rustc-link-search={folder}/..");
    println!("cargo:rustc-link-search={}", boards.display());
    println!("cargo:rerun-if-changed=../memory.x");
    println!("cargo:rerun-if-changed={}", boards.display());
    println!("cargo:rerun-if-changed={}", script.display());
}
