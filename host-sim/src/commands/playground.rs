//! `thermyo playground`: core and plant in a page, as a folder for any web host.

use serde_json::json;
use std::io::Write;
use std::path::PathBuf;
use thermyo_boards::checkout::{self, Build, NotBuilt, workspace};
use thermyo_boards::inside;
use thermyo_files::input::InputError;
use thermyo_files::output::OutputDir;
use thermyo_files::shipped;
use thermyo_serve::page;

/// Compiled to be small and fast: see `Cargo.toml`.
const TARGET: &str = "wasm32-unknown-unknown";
const PROFILE: &str = "playground";
const MODULE: &str = "thermyo.wasm";

/// Scenarios that the page offers.
fn scenarios() -> [(&'static str, &'static str); 5] {
    let pressure =
        "[plant]\nmodel = \"lumped\"\n\n[drive]\nkind = \"pressure\"\npressure_pa = 250_000.0\n";
    [
        ("a working cycle", shipped::text("nominal.toml")),
        ("pressure control", pressure),
        ("contraction control, the full muscle", shipped::text("contraction.toml")),
        (
            "a working cycle, the full muscle, heat transfer configured wrong",
            shipped::text("sensor.toml"),
        ),
        ("a joint of two muscles", shipped::text("joint.toml")),
    ]
}

#[derive(Debug, thiserror::Error)]
pub enum PlaygroundError {
    /// The folder of the sources is missing.
    #[error(
        "{}: the playground is built from the checkout that this program was built from, and that is not there \
         any more: run `cargo run --release -- playground` in a checkout",
        .0.display()
    )]
    NoCheckout(PathBuf),
    #[error(transparent)]
    Build(#[from] NotBuilt),
    /// The folder holds a page that is not a playground.
    #[error("{}: not of a playground, and would be replaced: name another folder", .0.display())]
    Foreign(PathBuf),
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] InputError),
}

/// Writes the page and an up-to-date module into a folder, replacing an earlier playground: any web
/// server can serve the folder. Returns the total size of the files in bytes.
pub fn write(mut out: OutputDir) -> Result<u64, PlaygroundError> {
    let scenarios: Vec<_> =
        scenarios().map(|(name, text)| json!({ "name": name, "text": text })).to_vec();
    let texts = [
        ("index.html", include_str!("../../playground/page/index.html").to_owned()),
        ("playground.js", include_str!("../../playground/page/playground.js").to_owned()),
        ("views.js", include_str!("../../playground/page/views.js").to_owned()),
        ("joint.js", include_str!("../../playground/page/joint.js").to_owned()),
        ("simulation.js", include_str!("../../playground/page/simulation.js").to_owned()),
        ("playground.css", include_str!("../../playground/page/playground.css").to_owned()),
        ("scenarios.js", format!("export default {};\n", json!(scenarios))),
        ("palette.js", page::colours()),
    ];
    let shared = page::FILES.map(|(name, text)| (name, text.to_owned()));
    let texts: Vec<_> = texts.into_iter().chain(shared).collect();
    let own = out.path().join(MODULE).is_file();
    let foreign = texts.iter().map(|(name, _)| out.path().join(name)).find(|file| file.exists());
    if let Some(file) = foreign.filter(|_| !own) {
        return Err(PlaygroundError::Foreign(file));
    }
    // Comes last: in a checkout the build takes minutes.
    let module = module()?;
    let mut bytes = module.len();
    for (name, text) in &texts {
        bytes += text.len();
        out.text(name, text)?;
    }
    let mut file = out.file(MODULE)?;
    file.write_all(&module).map_err(|error| out.unwritable(MODULE, &error))?;
    drop(file);
    out.replace()?;
    Ok(bytes as u64)
}

/// The module of this program, or of this checkout; cargo decides whether that is stale.
fn module() -> Result<Vec<u8>, PlaygroundError> {
    if let Some(module) = inside::file(MODULE) {
        return Ok(module);
    }
    let root = workspace();
    if !root.join("Cargo.toml").is_file() {
        return Err(PlaygroundError::NoCheckout(root));
    }
    let target_folder = checkout::target_folder().join("firmware");
    let build = Build {
        name: "the playground",
        folder: root,
        target_folder: &target_folder,
        target: Some(TARGET),
        command: "build",
        arguments: &["--package", "thermyo-playground", "--profile", PROFILE],
    };
    build.run()?;
    let file = target_folder.join(TARGET).join(PROFILE).join("thermyo_playground.wasm");
    Ok(build.read(&file)?)
}
