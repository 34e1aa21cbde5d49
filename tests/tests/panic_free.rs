//! model-core linked alone has no panic path.

use thermyo_boards::checkout::{Build, target_folder, workspace};

#[test]
fn the_core_and_its_wire_link_without_a_panic() {
    let build = Build {
        name: "the core alone",
        folder: workspace(),
        target_folder: &target_folder().join("panic-free"),
        target: Some("thumbv6m-none-eabi"),
        command: "build",
        arguments: &[
            "--release",
            "--package",
            "panic-free",
            "--config",
            "profile.release.lto = 'fat'",
            "--config",
            "profile.release.codegen-units = 1",
        ],
    };
    if let Err(error) = build.run() {
        let message = error.to_string();
        assert!(!message.contains("model_core_can_panic"), "model-core can panic:\n{message}");
        panic!("{message}");
    }
}
