//! Page of `thermyo evaluate faults`: injected faults and their results.

use super::cases::{self, Fault};
use crate::{CaseFigures, figures, opened};
use thermyo_report::page::{Page, Section, Table};
use thermyo_setup::Loaded;

pub fn page(nominal: &Loaded, lines: &[CaseFigures]) -> String {
    let lead = "Injected faults: detection time and reaction, and false alarms of healthy muscles.";
    let columns = ["Fault", "Injected", "While", "Found as", "Within", "Then"];
    let rows = cases::all();
    let rows = rows.iter().map(row);
    let definitions = Table::new("Faults, 100 runs each with random muscles", &columns, rows);
    opened(Page::new("Faults, evaluated", lead, &thermyo_setup::render(nominal)), lines)
        .section(Section::new("Figures").table(figures(lines)))
        .section(Section::new("Definitions").table(definitions))
        .render()
}

fn row(fault: &Fault) -> Vec<String> {
    let tasks: Vec<String> = fault.tasks.iter().map(|task| task.name().to_owned()).collect();
    let within = if fault.within_s.is_finite() {
        format!("{} s {}", fault.within_s, fault.counted.name())
    } else {
        "not stated".to_owned()
    };
    vec![
        fault.name.to_owned(),
        fault.size.to_owned(),
        tasks.join(", "),
        fault.found.to_string(),
        within,
        fault.reaction.name().to_owned(),
    ]
}
