//! Tries random cases and changed cases of the corpus, up to a requested count.

use clap::Parser;
use fuzz::hunt::{TARGETS, Target, Violation, catch_panics};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use std::{fs, io};

#[derive(Parser)]
struct Arguments {
    /// Steps of the core
    #[arg(long, default_value_t = 5_000_000)]
    core: u64,
    /// Frames on the wire
    #[arg(long, default_value_t = 2_000_000)]
    frames: u64,
    /// Scenario files
    #[arg(long, default_value_t = 10_000)]
    scenarios: u64,
    /// Tables
    #[arg(long, default_value_t = 20_000)]
    tables: u64,
    /// Steps of two hosts at one board
    #[arg(long, default_value_t = 10_000_000)]
    hosts: u64,
    /// Other cases for another number
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Where cases that fail are written to
    #[arg(long, default_value = "target/fuzz")]
    out: PathBuf,
    /// Only these cases, of the target whose name their folder has
    cases: Vec<PathBuf>,
}

fn main() -> io::Result<ExitCode> {
    let arguments = Arguments::parse();
    catch_panics();
    let held =
        if arguments.cases.is_empty() { hunt(&arguments)? } else { again(&arguments.cases)? };
    Ok(if held { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn hunt(arguments: &Arguments) -> io::Result<bool> {
    let Arguments { core, frames, scenarios, tables, hosts, .. } = *arguments;
    let counts = [core, frames, scenarios, tables, hosts];
    let mut held = true;
    for (target, count) in TARGETS.iter().zip(counts) {
        let started = Instant::now();
        let hunted = target.hunt(count, arguments.seed)?;
        let took_s = started.elapsed().as_secs_f64();
        println!(
            "{}: {} {} in {} cases, {took_s:.1} s, {:.3e} per second, {} violations",
            target.name,
            hunted.count,
            target.counts,
            hunted.cases,
            hunted.count as f64 / took_s,
            hunted.violations.len(),
        );
        for (number, violation) in hunted.violations.iter().enumerate() {
            held = false;
            let folder = arguments.out.join(target.name);
            fs::create_dir_all(&folder)?;
            let file = folder.join(format!("{}-{number}", arguments.seed));
            fs::write(&file, &violation.case)?;
            tell(&file, violation);
        }
    }
    Ok(held)
}

fn again(cases: &[PathBuf]) -> io::Result<bool> {
    let mut held = true;
    for file in cases {
        let folder = file.parent().and_then(Path::file_name);
        let named = |target: &&Target| folder.is_some_and(|name| name == target.name);
        let Some(target) = TARGETS.iter().find(named) else {
            let message = format!("{}: its folder is no target's", file.display());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
        };
        match target.attempt(&fs::read(file)?) {
            Ok(count) => println!("{}: {count} {}, holds", file.display(), target.counts),
            Err(violation) => {
                held = false;
                tell(file, &violation);
            }
        }
    }
    Ok(held)
}

fn tell(file: &Path, Violation { place, what, case }: &Violation) {
    println!("{}, {} bytes: {place}\n{what}\n", file.display(), case.len());
}
