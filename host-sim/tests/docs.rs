//! Every file that a document names exists, and tuning values, frames and configurations are the code's.

use model_core::SetPoint;
use model_core::config::{Config, ControllerConfig, EstimatorConfig};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use thermyo_protocol::{HostCommand, PROTOCOL, Request, checksum, encode};
use thermyo_setup::core_config::core_config;

use crate::command_support::{Folder, Said, command};

const FOLDERS: [&str; 6] = ["docs", "firmware", "host-sim", "model-core", "scenarios", "tests"];

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn documents() -> Vec<PathBuf> {
    let mut pages: Vec<PathBuf> = ["", "firmware/", "model-core/", "host-sim/python/"]
        .map(|folder| repository().join(folder).join("README.md"))
        .into_iter()
        .chain(
            ["CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md"].map(|name| repository().join(name)),
        )
        .collect();
    let mut folders = vec![repository().join("docs")];
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "md") {
                pages.push(path);
            }
        }
    }
    pages
}

/// Paths of all source files, each with a slash before it.
fn sources() -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let mut folders: Vec<PathBuf> = FOLDERS.iter().map(|name| repository().join(name)).collect();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
            let name = entry.file_name().into_string().unwrap();
            if name == "node_modules" || name == "target" {
                continue;
            }
            if entry.file_type().unwrap().is_dir() {
                folders.push(entry.path());
            } else if name.ends_with(".rs") {
                names.insert(format!("/{}", entry.path().display()));
            }
        }
    }
    names
}

/// Targets of Markdown links, without external ones and those within the page.
fn links(text: &str) -> impl Iterator<Item = &str> {
    text.split("](")
        .skip(1)
        .filter_map(|rest| rest.split([')', '#']).next())
        .filter(|target| !target.is_empty() && !target.contains("://"))
}

/// Words that can only be paths of the repository.
fn paths(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !(c.is_ascii_alphanumeric() || "_-./".contains(c)))
        .map(|word| word.trim_end_matches('.'))
        .filter(|word| match word.split_once('/') {
            // "src" belongs to a package; build outputs are not in the repository.
            Some((first, _)) if !word.ends_with(".rs") => {
                FOLDERS.contains(&first) || first == "src"
            }
            _ => word.ends_with(".rs"),
        })
}

/// Paths and links of a document in `folder` that do not exist.
fn missing(text: &str, folder: &Path, sources: &BTreeSet<String>) -> Vec<String> {
    let linked = links(text).filter(|target| !folder.join(target).exists());
    let named = paths(text).filter(|path| {
        let below = |place: &Path| path.contains('/') && place.join(path).exists();
        let source = || sources.iter().any(|source| source.ends_with(&format!("/{path}")));
        !(below(folder) || below(&repository()) || (path.ends_with(".rs") && source()))
    });
    linked.chain(named).map(str::to_owned).collect()
}

#[test]
fn files_named_in_documents_exist() {
    let sources = sources();
    let mut count = 0;
    for document in documents() {
        let text = fs::read_to_string(&document).unwrap();
        count += links(&text).count() + paths(&text).count();
        let missing = missing(&text, document.parent().unwrap(), &sources);
        assert!(missing.is_empty(), "{} names {missing:?}", document.display());
    }
    assert!(count > 50, "only {count} names were found");
}

#[test]
fn the_index_names_every_page() {
    let docs = repository().join("docs");
    let index = fs::read_to_string(docs.join("README.md")).unwrap();
    let decisions = fs::read_to_string(docs.join("decisions/README.md")).unwrap();
    let mut listed: BTreeSet<PathBuf> = links(&index).map(|link| docs.join(link)).collect();
    listed.extend(links(&decisions).map(|link| docs.join("decisions").join(link)));
    for page in documents().iter().filter(|page| page.starts_with(&docs)) {
        let found = *page == docs.join("README.md") || listed.contains(page);
        assert!(found, "{} is not in the index", page.display());
    }
}

#[test]
fn no_line_of_a_document_is_longer_than_100_characters() {
    for document in documents() {
        let text = fs::read_to_string(&document).unwrap();
        // A row of a table cannot be broken.
        for (number, line) in text.lines().enumerate().filter(|(_, line)| !line.starts_with('|')) {
            let length = line.chars().count();
            assert!(length <= 100, "{}:{}: {length} characters", document.display(), number + 1);
        }
    }
}

#[test]
fn missing_files_are_found() {
    let text = "See `docs/gone.md`, scenarios/nominal.toml, `step.rs`, `physics/gas.rs`, `gone.rs`, `physics/step.rs`, [a plot](gone.svg), \
                [another](docs/how-to/tune.md#by-hand), [far](https://example.org/gone), out/run/gone.csv, \
                `cargo run -- run scenarios/gone.toml`. It is in `model-core/src/`.";
    let expected =
        ["gone.svg", "docs/gone.md", "gone.rs", "physics/step.rs", "scenarios/gone.toml"];
    assert_eq!(missing(text, &repository(), &sources()), expected);
}

/// Key, default and unit of each row of the table of tuning values.
fn tuning(document: &str) -> Vec<[String; 3]> {
    let text = fs::read_to_string(repository().join(document)).unwrap();
    let rows =
        text.lines().skip_while(|line| !line.starts_with("| key | default | unit |")).skip(2);
    rows.take_while(|line| line.starts_with('|'))
        .map(|row| {
            let mut cells = row.split('|').skip(1).map(str::trim);
            [(); 3].map(|()| cells.next().unwrap().replace('`', "").replace('²', "2"))
        })
        .collect()
}

#[test]
fn the_tables_of_tuning_values_are_those_of_the_core() {
    for (document, parameters) in [
        ("docs/reference/controller-keys.md", ControllerConfig::PARAMETERS),
        ("docs/reference/estimator-keys.md", EstimatorConfig::PARAMETERS),
    ] {
        let rows = tuning(document);
        let names: Vec<&str> = rows.iter().map(|[name, ..]| name.as_str()).collect();
        let declared: Vec<&str> = parameters.iter().map(|parameter| parameter.name).collect();
        assert_eq!(names, declared, "{document}");
        for ([name, default, unit], parameter) in rows.iter().zip(parameters) {
            assert_eq!(default.parse(), Ok(parameter.default), "{document}: {name}");
            let declared = if parameter.unit.is_empty() { "-" } else { parameter.unit };
            assert_eq!(unit, declared, "{document}: {name}");
        }
    }
}

#[test]
fn the_frame_of_the_document_is_the_links() {
    let command = HostCommand::Set(SetPoint::Pressure { pressure_pa: 2.5e5 });
    let frame = encode(&Request { sequence: 7, command }).unwrap();
    let bytes: Vec<String> = frame.iter().map(|byte| format!("{byte:02x}")).collect();
    let text = fs::read_to_string(repository().join("docs/reference/protocol.md")).unwrap();
    assert!(text.contains(&bytes.join(" ")), "{bytes:?}");
}

#[test]
fn the_board_of_the_tutorial_is_the_present_one() {
    let text = fs::read_to_string(repository().join("docs/tutorial/first-muscle.md")).unwrap();
    let loaded = thermyo_setup::load(&repository().join("scenarios/contraction.toml")).unwrap();
    let written = checksum(&core_config(&loaded.believed));
    for quoted in [
        format!("protocol {PROTOCOL}\n"),
        format!("no name, {:08x}, the core's defaults\n", checksum(&Config::default())),
        format!("contraction, {written:08x}, sent by the host"),
        format!("contraction, {written:08x}, from flash"),
        format!("contraction ({written:08x}); it vents"),
    ] {
        assert!(text.contains(&quoted), "{quoted}");
    }
}

/// The tutorial's output used to be that of an older estimate.
#[test]
fn the_first_scenario_prints_what_its_tutorial_shows() {
    const SHOWN: [&str; 4] = ["pressure ", "gas temperature, ", "set point: ", "valves: "];
    let page = fs::read_to_string(repository().join("docs/tutorial/first-scenario.md")).unwrap();
    let mut blocks: Vec<String> = vec![String::new()];
    for line in page.lines() {
        match line.strip_prefix("    ") {
            Some(code) => *blocks.last_mut().unwrap() += &format!("{code}\n"),
            None if line.is_empty() => *blocks.last_mut().unwrap() += "\n",
            None => blocks.push(String::new()),
        }
    }
    blocks.retain(|block| !block.trim().is_empty());
    let folder = Folder::new();
    let (mut scenario, mut runs) = (String::new(), 0);
    for block in blocks.iter().map(|block| block.trim_start()) {
        let (tables, output) = block.split_once("thermyo run ").unwrap_or((block, ""));
        if tables.starts_with("[drive]") {
            scenario.truncate(scenario.find("[drive]").unwrap());
        }
        if tables.starts_with('[') {
            scenario += tables;
        }
        if output.is_empty() {
            continue;
        }
        folder.file("mine.toml", &scenario);
        let mut run = command(&["run", "mine.toml", "--quiet"]);
        let said = Said::of("run", run.current_dir(folder.path("")).output().unwrap()).ok();
        for line in output.lines().filter(|line| SHOWN.iter().any(|start| line.starts_with(start)))
        {
            assert!(said.out.lines().any(|own| own == line), "{line}\n{}", said.out);
        }
        runs += 1;
    }
    assert_eq!(runs, 3);
}
