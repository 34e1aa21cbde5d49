use super::{Cli, Console, Failure};
use clap::{Command, CommandFactory};
use clap_complete::Shell;
use std::path::Path;
use thermyo_files::input::InputError;

pub(super) fn completions(shell: Shell, to: &mut Console<'_>) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut offered(), "thermyo", &mut script);
    let script = String::from_utf8_lossy(&script);
    let json = serde_json::json!({ "shell": shell.to_string(), "script": script });
    to.answer(&json, &script)
}

/// The command line without hidden commands, which the completion scripts would otherwise offer.
fn offered() -> Command {
    let whole = Cli::command();
    let tasks = whole.get_subcommands().filter(|task| !task.is_hide_set());
    Command::new("thermyo")
        .version(env!("CARGO_PKG_VERSION"))
        .args(whole.get_arguments())
        .subcommands(tasks)
}

pub(super) fn man(folder: &Path, to: &mut Console<'_>) -> Result<(), Failure> {
    std::fs::create_dir_all(folder).map_err(|error| InputError::folder(folder, &error))?;
    clap_mangen::generate_to(Cli::command().disable_help_subcommand(true), folder)
        .map_err(|error| InputError::output(folder, &error))?;
    let first = folder.join("thermyo.1").display().to_string();
    to.done(&serde_json::json!({ "page": first }), &format!("man pages: {first}\n"))
}
