//! What a scenario may say though it makes no sense: it is valid and runs, and is hardly what was meant.

use super::document::Document;
use super::load::Loaded;
use super::tables::{DriveKind, PlantKind, PlantModel, Scenario};
use crate::files::input::{InputError, Problem};

/// The tables that this kind of plant does not look at, each with the value that decides so.
pub(super) fn unused_tables(scenario: &Scenario) -> Vec<(&'static str, &'static str)> {
    let kind = scenario.plant.kind;
    let vessel = kind == PlantKind::Vessel;
    let own = |owner, table| (table, owner == kind, "plant.kind is another one");
    let moving = |table| (table, !vessel, "plant.kind = \"vessel\"");
    let mut tables: Vec<(&str, &str)> = [
        own(PlantKind::Muscle, "muscle"),
        own(PlantKind::Vessel, "vessel"),
        own(PlantKind::Vessel, "orifice"),
        own(PlantKind::Cylinder, "cylinder"),
        own(PlantKind::Table, "table"),
        moving("friction"),
        moving("load"),
        moving("tube"),
    ]
    .into_iter()
    .filter(|(_, used, _)| !used)
    .map(|(table, _, why)| (table, why))
    .collect();
    if !vessel && scenario.plant.model != PlantModel::Full {
        tables.push(("tube", "plant.model is not \"full\""));
    }
    if scenario.plant.model != PlantModel::Paper {
        tables.push(("paper", "plant.model is not \"paper\""));
    }
    tables
}

/// Whether `plant.model` makes no difference: a vessel has one zone.
pub(super) fn model_is_unused(scenario: &Scenario) -> bool {
    scenario.plant.kind == PlantKind::Vessel && scenario.plant.model == PlantModel::Full
}

/// What a user should be told of a scenario that can be run, in order of the file where it has lines.
pub fn warnings(document: &Document, loaded: &Loaded) -> Vec<InputError> {
    let scenario = &loaded.plant;
    let mut all: Vec<InputError> = unused_tables(scenario)
        .into_iter()
        .flat_map(|(table, why)| {
            [&document.plant, &document.believed].map(|entries| {
                let entry = entries.iter().find(|entry| entry.table == table)?;
                let problem = Problem::UnusedTable { table: entries.full_path(table), why };
                Some(problem_at(document, entry.line, problem))
            })
        })
        .flatten()
        .collect();
    let model = document.plant.get("plant.model").filter(|_| model_is_unused(scenario));
    all.extend(model.map(|entry| {
        let problem = Problem::NoSense {
            key: entry.path(),
            value: entry.written.clone(),
            why: "a vessel has one zone in every model".to_owned(),
        };
        problem_at(document, entry.line, problem)
    }));
    all.extend(no_supply(scenario).map(|why| {
        let path = "supply.pressure_pa";
        let line = document.plant.get(path).and_then(|entry| entry.line);
        let value = format!("{:?}", scenario.supply.pressure_pa);
        problem_at(document, line, Problem::NoSense { key: path.to_owned(), value, why })
    }));
    all.sort_by_key(|warning| warning.line);
    all
}

/// Why nothing comes in, where something should.
fn no_supply(scenario: &Scenario) -> Option<String> {
    let ambient_pa = scenario.ambient.pressure_pa;
    let fills = !matches!(scenario.drive.kind, DriveKind::Discharge | DriveKind::Closed);
    (fills && scenario.supply.pressure_pa <= ambient_pa).then(|| {
        format!(
            "not above ambient.pressure_pa = {ambient_pa:?}, so that nothing is filled; pressures are \
             absolute, in Pa"
        )
    })
}

fn problem_at(document: &Document, line: Option<u64>, problem: Problem) -> InputError {
    InputError { file: document.origin.clone(), line, problem: Box::new(problem) }
}
