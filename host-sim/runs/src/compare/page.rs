//! `report.html` of a comparison: every quantity of all runs in one chart, and the differences.

use super::subject::{Subject, label, text, unit};
use super::{Compared, Run};
use crate::run_report::capitalised;
use thermyo_files::number::MISSING;
use thermyo_files::units::UnitSystem;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::page::{Page, Section, Table};

/// Builds the page. `compared` contains all runs except the first.
pub fn page(runs: &[Run], compared: &[Compared], warnings: &[String]) -> String {
    let names: Vec<&str> = runs.iter().map(|run| run.name.as_str()).collect();
    let lead = format!("{}: each over the others, the differences to the first.", names.join(", "));
    let page = Page::new("Runs compared", &lead, "").section(differences(compared));
    let page = warnings.iter().fold(page, |page, text| page.warning(&format!("{text}.")));
    subject(runs)
        .sections()
        .iter()
        .filter_map(|(name, columns)| section(runs, name, columns))
        .fold(page, Page::section)
        .render()
}

fn subject(runs: &[Run]) -> Subject {
    runs.first().map_or(Subject::Muscle, |run| run.subject)
}

fn section(runs: &[Run], name: &str, columns: &[&str]) -> Option<Section> {
    let panels: Vec<Panel> = columns.iter().filter_map(|column| panel(runs, column)).collect();
    if panels.is_empty() {
        return None;
    }
    let chart = panels.into_iter().fold(Chart::new(Axis::new("Time", "s")), Chart::panel);
    Some(Section::new(name).figure(chart.figure(name, "Every run, as it was recorded.")))
}

fn panel(runs: &[Run], column: &str) -> Option<Panel> {
    let unit = unit(column, UnitSystem::Practical);
    let drawn = |run: &&Run| run.column(column).is_some();
    runs.iter().find(drawn)?;
    let title = capitalised(&label(column));
    let panel = Panel::new(Axis::new(&title, unit.symbol)).height(160.0);
    Some(runs.iter().enumerate().fold(panel, |panel, (n, run)| match run.column(column) {
        Some(values) => {
            let (times_s, values) = run.curve(values);
            panel.nth_line(n, &run.name, &times_s, &unit.convert(&values))
        }
        None => panel,
    }))
}

fn differences(compared: &[Compared]) -> Section {
    let columns = ["Quantity", "RMS", "Mean", "Largest"];
    compared.iter().fold(Section::new("Differences"), |section, compared| {
        let caption =
            format!("{} less {}, at {} rows of both", compared.run, compared.with, compared.rows);
        section.table(Table::new(&caption, &columns, rows(compared).into_iter().map(Vec::from)))
    })
}

/// Quantity, RMS, mean and largest difference; a single explanatory row if there is none.
pub fn rows(compared: &Compared) -> Vec<[String; 4]> {
    let rows = compared.shown().map(|(name, difference)| {
        let shown = |value| text(value, name, UnitSystem::Practical);
        [label(name), shown(difference.rms), shown(difference.mean), shown(difference.max)]
    });
    let rows: Vec<[String; 4]> = rows.collect();
    if rows.is_empty() {
        let missing = || MISSING.to_owned();
        return vec![["nothing in common".to_owned(), missing(), missing(), missing()]];
    }
    rows
}

/// The main quantities of all runs as a separate drawing.
pub fn plot(runs: &[Run]) -> String {
    let panels = subject(runs).drawn().iter().filter_map(|column| panel(runs, column));
    let chart = panels.fold(Chart::new(Axis::new("Time", "s")).half(), Chart::panel);
    chart.document("Runs compared")
}
