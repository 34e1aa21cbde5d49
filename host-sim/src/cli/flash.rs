//! `thermyo flash` and `thermyo ports`.

use super::{Failure, SaidArgs, print};
use crate::commands::flash;
use crate::commands::flash::{FlashError, Model, Request, mounts};
use crate::commands::ports;
use clap::Args;
use std::io::Write;

#[derive(Debug, Args)]
pub(super) struct PortsArgs {
    #[command(flatten)]
    said: SaidArgs,
}

#[derive(Debug, Args)]
pub(super) struct FlashArgs {
    /// Serial port of a board, or the drive that it is with BOOTSEL held [default: the only board found]
    #[arg(value_name = "PORT|DRIVE")]
    target: Option<String>,
    /// What the board must be
    #[arg(long, value_enum)]
    chip: Option<Model>,
    /// Prepares the firmware and finds the board, and writes nothing
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    said: SaidArgs,
}

pub(super) fn list(args: &PortsArgs, out: &mut dyn Write) -> Result<(), Failure> {
    let found = ports::list(&mounts());
    let json = serde_json::to_value(&found).expect("a list is plain data");
    if found.is_empty() {
        let advice =
            "no board was found: plug one in; a new one with BOOTSEL held, for `thermyo flash`\n";
        return args.said.done(out, &json, advice);
    }
    let lines: String = found.iter().map(|found| format!("{found}\n")).collect();
    args.said.answer(out, &json, &lines)
}

pub(super) fn run(args: FlashArgs, out: &mut dyn Write) -> Result<(), Failure> {
    let request = Request { target: args.target, model: args.chip, dry_run: args.dry_run };
    let mut broken = None;
    let mut say = |line: &str| {
        if !args.said.quiet && !args.said.json && broken.is_none() {
            broken = print(out, &format!("{line}\n")).err();
        }
    };
    let flashed = flash::run(&request, &mounts, &mut say)?;
    if args.said.json {
        let json = serde_json::to_value(&flashed).expect("plain data");
        return args.said.answer(out, &json, "");
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
