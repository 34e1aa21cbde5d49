//! `thermyo identify` of a joint's record.

use super::{Failure, IdentifyArgs, print_warnings, publish_and_print, say_damage, title_of};
use std::io::Write;
use std::path::PathBuf;
use thermyo_files::output::OutputDir;
use thermyo_files::table;
use thermyo_joint::JointLoaded;
use thermyo_studies::joint_tune::{RecordError, identify, record_page, record_plot};

pub(super) fn run(
    loaded: &JointLoaded,
    args: &IdentifyArgs,
    stdout: &mut dyn Write,
    stderr: &mut dyn Write,
) -> Result<(), Failure> {
    let (None, Some(data)) = (&args.against, &args.data) else {
        let message = "--plan and --against are for one muscle: give a record of a joint alone, or `thermyo tune`, \
                       which runs an experiment";
        return Err(Failure::Usage(message.to_owned()));
    };
    let table = table::read_record(data)?;
    say_damage(&table, stderr);
    let folder = args.output.out.clone().unwrap_or_else(|| PathBuf::from("out/identify"));
    let mut out = OutputDir::create(&folder)?;
    let found = identify(loaded, &table).map_err(|error| match error {
        RecordError::Input(error) => Failure::Input(error),
        RecordError::Refused(refusal) => Failure::Check(format!("nothing was found: {refusal}")),
    })?;
    print_warnings(&found.warnings, stderr);
    let title = title_of(data);
    let json = serde_json::to_string_pretty(&found.values).expect("plain data") + "\n";
    out.text("summary.json", &json)?;
    out.text("identified.toml", &thermyo_joint::render(&found.scenario))?;
    out.text("report.html", &record_page(&found, &title))?;
    out.text("fit.svg", &record_plot(&found, &title))?;
    publish_and_print(out, args.output.format, (&json, &found.text()), stdout, stderr)?;
    found.values.failed().map_or(Ok(()), |message| Err(Failure::Check(message)))
}
