//! Output of a command, and its form.

use super::Failure;
use clap::Args;
use serde_json::Value;
use std::fmt::Display;
use std::io::{self, Write};
use std::path::Path;
use thermyo_files::input::InputError;
use thermyo_files::output::OutputDir;
use thermyo_files::units::UnitSystem;

/// Options of every command. With both, only the JSON is printed.
#[derive(Debug, Clone, Copy, Default, Args)]
pub(super) struct FormatArgs {
    /// Print the result as JSON on standard output
    #[arg(long)]
    pub(super) json: bool,
    /// Print only requested results, warnings and errors
    #[arg(long)]
    pub(super) quiet: bool,
}

impl FormatArgs {
    /// Prints a confirmation: as text, as JSON, or not at all.
    pub(super) fn done(
        self,
        out: &mut dyn Write,
        json: &Value,
        words: &str,
    ) -> Result<(), Failure> {
        match self {
            Self { json: true, .. } => print(out, &format!("{json:#}\n")),
            Self { quiet: true, .. } => Ok(()),
            _ => print(out, words),
        }
    }
}

/// Units of the printed figures; JSON is SI.
#[derive(Debug, Clone, Copy, Args)]
pub(super) struct UnitArgs {
    /// Print figures in SI: Pa, m, K and ratios instead of kPa, mm, degC and %
    #[arg(long)]
    pub(super) si: bool,
}

impl UnitArgs {
    pub(super) fn system(self) -> UnitSystem {
        if self.si { UnitSystem::Si } else { UnitSystem::Practical }
    }
}

pub(super) struct Console<'a> {
    pub(super) out: &'a mut dyn Write,
    pub(super) err: &'a mut dyn Write,
    pub(super) format: FormatArgs,
    pub(super) units: UnitSystem,
}

impl<'a> Console<'a> {
    pub(super) fn new(out: &'a mut dyn Write, err: &'a mut dyn Write) -> Self {
        Self { out, err, format: FormatArgs::default(), units: UnitSystem::Practical }
    }
}

impl Console<'_> {
    pub(super) fn as_asked(&mut self, format: FormatArgs) -> &mut Self {
        self.format = format;
        self
    }

    pub(super) fn in_units(&mut self, units: UnitArgs) -> &mut Self {
        self.units = units.system();
        self
    }

    /// Whether lines for a person are printed beside the result.
    pub(super) fn is_read(&self) -> bool {
        !self.format.quiet && !self.format.json
    }

    pub(super) fn print(&mut self, text: &str) -> Result<(), Failure> {
        print(self.out, text)
    }

    /// Prints a confirmation: as text, as JSON, or not at all.
    pub(super) fn done(&mut self, json: &Value, words: &str) -> Result<(), Failure> {
        self.format.done(self.out, json, words)
    }

    /// Prints a requested result: as text or as JSON.
    pub(super) fn answer(&mut self, json: &Value, words: &str) -> Result<(), Failure> {
        if self.format.json { self.done(json, words) } else { self.print(words) }
    }

    /// Prints a note, which is neither result, warning nor error.
    pub(super) fn note(&mut self, note: &str) {
        if !self.format.quiet {
            let _ = writeln!(self.err, "{note}");
        }
    }

    /// Prints a message about the command's progress or end.
    pub(super) fn say(&mut self, message: impl Display) {
        let _ = writeln!(self.err, "thermyo: {message}");
    }

    pub(super) fn warn(&mut self, warnings: &[InputError]) {
        for warning in warnings {
            self.say(format_args!("warning: {warning}"));
        }
    }

    /// Publishes results, and prints where earlier results were moved to.
    pub(super) fn publish(&mut self, out: OutputDir) -> Result<(), Failure> {
        let folder = out.path().to_path_buf();
        if let Some(earlier) = out.publish()? {
            let (folder, earlier) = (folder.display(), earlier.display());
            self.note(&format!("thermyo: the earlier result in {folder} is now in {earlier}"));
        }
        Ok(())
    }

    /// Publishes results, and prints them: JSON, or text with the location of the report.
    pub(super) fn results(
        &mut self,
        out: OutputDir,
        (json, text): (&str, &str),
    ) -> Result<(), Failure> {
        let report = out.path().join("report.html");
        self.publish(out)?;
        if self.format.json {
            return self.print(json);
        }
        self.print(&format!("{text}report: {}\n", report.display()))
    }
}

pub(super) fn print(out: &mut dyn Write, text: &str) -> Result<(), Failure> {
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        // A reader that closes early, such as `head`, is no error.
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(InputError::output(Path::new("standard output"), &error).into())
        }
        _ => Ok(()),
    }
}
