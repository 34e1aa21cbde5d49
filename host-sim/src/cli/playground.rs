use super::{Console, Failure, FormatArgs};
use crate::commands::playground;
use crate::commands::playground::PlaygroundError;
use clap::Args;
use std::path::PathBuf;
use thermyo_files::output::OutputDir;

#[derive(Debug, Args)]
pub(super) struct PlaygroundArgs {
    /// Folder for the page, which any web host can serve
    #[arg(long, value_name = "DIR", default_value = "out/playground")]
    out: PathBuf,
    #[command(flatten)]
    format: FormatArgs,
}

pub(super) fn run(args: &PlaygroundArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let folder = args.out.display();
    let bytes = playground::write(OutputDir::open(&args.out)?)?;
    let page = args.out.join("index.html");
    to.as_asked(args.format).done(
        &serde_json::json!({ "page": page.display().to_string(), "bytes": bytes }),
        &format!(
            "page: {}, {:.2} MB with what it needs\nServe the folder with a web server, such as \
             `python3 -m http.server --directory {folder}`\n",
            page.display(),
            bytes as f64 / 1e6,
        ),
    )
}

impl From<PlaygroundError> for Failure {
    fn from(error: PlaygroundError) -> Self {
        match error {
            PlaygroundError::Output(error) => Self::Input(error),
            other => Self::Usage(other.to_string()),
        }
    }
}
