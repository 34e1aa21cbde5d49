use super::{Console, Failure, FormatArgs, joint_in, load, title_of};
use crate::fmu::archive::archive;
use crate::fmu::library;
use clap::Args;
use std::path::{Path, PathBuf};
use thermyo_cosimulation::Kind;
use thermyo_cosimulation::scenario::Scenario;
use thermyo_files::input::{InputError, is_new, write_new};
use thermyo_files::output::OutputDir;

#[derive(Debug, Args)]
pub(super) struct FmuArgs {
    /// Scenario file (TOML)
    scenario: PathBuf,
    /// New file: an existing one is not replaced
    #[arg(short, long, value_name = "FILE.fmu")]
    out: PathBuf,
    /// Include the core in the loop, as `thermyo run` does. Without it the importer drives the
    /// valves
    #[arg(long)]
    with_core: bool,
    #[command(flatten)]
    format: FormatArgs,
}

pub(super) fn run(args: &FmuArgs, to: &mut Console<'_>) -> Result<(), Failure> {
    if args.out.extension().is_none_or(|extension| extension != "fmu") {
        let [out, fmu] = [args.out.clone(), args.out.with_extension("fmu")];
        let [out, fmu] = [out.display(), fmu.display()];
        let usage = format!("{out}: must end in .fmu, by which importers know a unit: {fmu}");
        return Err(Failure::Usage(usage));
    }
    let to = to.as_asked(args.format);
    let scenario: Scenario = match joint_in(&args.scenario, to)? {
        Some(joint) => joint.into(),
        None => load(&args.scenario, to)?.into(),
    };
    // Checked first: in a checkout the library takes long to build.
    is_new(&args.out)?;
    let folder = args.out.parent().filter(|folder| !folder.as_os_str().is_empty());
    let opened = OutputDir::open(folder.unwrap_or_else(|| Path::new(".")));
    drop(opened.map_err(|error| match folder {
        Some(_) => error,
        None => InputError { file: args.out.clone(), ..error },
    })?);
    let kind = if args.with_core { Kind::WithCore } else { Kind::Plant };
    let library = library::library().map_err(|error| Failure::Usage(error.to_string()))?;
    let name = title_of(&args.scenario);
    let bytes = archive(&scenario, kind, &name, &library)
        .map_err(|error| Failure::Usage(format!("{}: {error}", args.scenario.display())))?;
    write_new(&args.out, &bytes)?;
    let variables = scenario.variables(kind);
    let (file, count, platform) = (args.out.display(), variables.len(), library::platform());
    let json = serde_json::json!({
            "file": file.to_string(),
            "fmi_version": "3.0",
            "platform": platform,
            "with_core": args.with_core,
            "step_s": scenario.run().step_s,
            "variables": variables.iter().map(|variable| variable.name).collect::<Vec<_>>(),
    });
    let parts = if args.with_core { "plant and core" } else { "plant" };
    to.done(
        &json,
        &format!("{parts}, {count} variables, FMI 3.0 co-simulation for {platform}: {file}\n"),
    )
}
