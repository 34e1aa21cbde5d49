//! `thermyo flash` and `thermyo ports`.

use super::{Console, Failure, FormatArgs};
use crate::commands::flash;
use crate::commands::flash::{FlashError, Model, Request, mounts};
use crate::commands::ports;
use clap::Args;

#[derive(Debug, Args)]
pub(super) struct PortsArgs {
    #[command(flatten)]
    format: FormatArgs,
}

#[derive(Debug, Args)]
pub(super) struct FlashArgs {
    /// Serial port of a board, or its drive with BOOTSEL held [default: the only board found]
    #[arg(value_name = "PORT|DRIVE")]
    target: Option<String>,
    /// Required board model
    #[arg(long, value_enum)]
    chip: Option<Model>,
    /// The firmware for a joint of two muscles, in place of one muscle
    #[arg(long)]
    joint: bool,
    /// Prepare the firmware and find the board, but write nothing
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    format: FormatArgs,
}

pub(super) fn list(args: &PortsArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let to = to.as_asked(args.format);
    let found = ports::list(&mounts());
    let json = serde_json::to_value(&found).expect("a list is plain data");
    if found.is_empty() {
        let advice =
            "no board was found: plug one in; a new one with BOOTSEL held, for `thermyo flash`\n";
        return to.done(&json, advice);
    }
    let lines: String = found.iter().map(|found| format!("{found}\n")).collect();
    to.answer(&json, &lines)
}

pub(super) fn run(args: FlashArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    let FlashArgs { target, chip: model, joint, dry_run, .. } = args;
    let request = Request { target, model, joint, dry_run };
    let to = to.as_asked(args.format);
    let mut broken = None;
    let mut say = |line: &str| {
        if to.is_read() && broken.is_none() {
            broken = to.print(&format!("{line}\n")).err();
        }
    };
    let flashed = flash::run(&request, &mounts, &mut say)?;
    if to.format.json {
        let json = serde_json::to_value(&flashed).expect("plain data");
        return to.answer(&json, "");
    }
    broken.map_or(Ok(()), Err)
}

impl From<FlashError> for Failure {
    fn from(error: FlashError) -> Self {
        match error {
            FlashError::NotBack | FlashError::OtherFirmware { .. } => {
                Self::Check(error.to_string())
            }
            other => Self::Flash(other),
        }
    }
}
