//! `thermyo identify` of a joint's record.

use super::progress::Bar;
use super::{Console, Failure, IdentifyArgs, pretty, say_damage, title_of};
use thermyo_files::table;
use thermyo_joint::JointLoaded;
use thermyo_studies::joint_tune::{RecordError, identify, record_page, record_plot};

pub(super) fn run(
    loaded: &JointLoaded,
    args: &IdentifyArgs,
    to: &mut Console<'_>,
) -> Result<(), Failure> {
    let (None, Some(data)) = (&args.against, &args.data) else {
        let message = "--plan and --against are for one muscle: give a record of a joint alone, or `thermyo tune`, \
                       which runs an experiment";
        return Err(Failure::Usage(message.to_owned()));
    };
    let table = table::read_record(data)?;
    say_damage(&table, to);
    let mut out = args.output.create_beside("identify", &[data])?;
    let bar = Bar::new(0, args.output.format.quiet);
    let found = identify(loaded, &table);
    bar.clear();
    let found = found.map_err(|error| match error {
        RecordError::Input(error) => Failure::Input(error),
        RecordError::Refused(refusal) => Failure::Check(format!("nothing was found: {refusal}")),
    })?;
    to.warn(&found.warnings);
    let title = title_of(data);
    let json = pretty(&found.findings());
    out.text("summary.json", &json)?;
    out.text("identified.toml", &thermyo_joint::render(&found.scenario))?;
    out.text("report.html", &record_page(&found, &title))?;
    out.text("fit.svg", &record_plot(&found, &title))?;
    to.results(out, (&json, &found.text()))?;
    found.failed().map_or(Ok(()), |message| Err(Failure::Check(message)))
}
