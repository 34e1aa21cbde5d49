//! `thermyo evaluate`: table of the project's targets and measured figures.

pub mod control;
pub mod control_hosts;
pub mod control_observed;
pub mod control_page;
pub mod control_proportional;
pub mod estimator;
pub mod faults;
pub mod joint;
mod pair;
pub mod pid;
pub mod plants;
pub mod recording;
pub mod smoother;
pub mod truth;
mod truth_motion;
pub mod tune;

use serde::Serialize;
use thermyo_files::input::InputError;
use thermyo_files::number::{COUNT, fixed, significant};
use thermyo_files::shipped;
use thermyo_report::page::{Page, Section, Table, Tile};
use thermyo_setup::Loaded;

pub fn nominal() -> Result<Loaded, InputError> {
    thermyo_setup::parse(shipped::text("nominal.toml"), "scenarios/nominal.toml".as_ref())
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CaseFigures {
    pub case: String,
    pub figures: Vec<Figure>,
}

/// A figure with its allowed range.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figure {
    pub name: &'static str,
    pub value: f64,
    /// Smallest value allowed.
    pub minimum: f64,
    /// Largest value allowed.
    pub maximum: f64,
}

impl Figure {
    pub fn within(name: &'static str, value: f64, (minimum, maximum): (f64, f64)) -> Self {
        Self { name, value, minimum, maximum }
    }

    pub fn at_most(name: &'static str, value: f64, maximum: f64) -> Self {
        Self::within(name, value, (f64::NEG_INFINITY, maximum))
    }

    pub fn at_least(name: &'static str, value: f64, minimum: f64) -> Self {
        Self::within(name, value, (minimum, f64::INFINITY))
    }

    /// A figure without a target, for comparison.
    pub fn shown(name: &'static str, value: f64) -> Self {
        Self::within(name, value, (f64::NEG_INFINITY, f64::INFINITY))
    }

    /// Whether the value lies within the allowed range.
    pub fn holds(&self) -> bool {
        (self.minimum..=self.maximum).contains(&self.value)
    }

    fn has_target(&self) -> bool {
        self.minimum.is_finite() || self.maximum.is_finite()
    }

    fn target(&self) -> String {
        match (self.minimum.is_finite(), self.maximum.is_finite()) {
            (true, true) => format!("{} to {}", self.minimum, self.maximum),
            (true, false) => format!("≥ {}", self.minimum),
            (false, true) => format!("≤ {}", self.maximum),
            (false, false) => String::new(),
        }
    }
}

pub fn table(lines: &[CaseFigures]) -> String {
    let width = lines.iter().map(|line| line.case.chars().count()).max().unwrap_or(0);
    lines
        .iter()
        .map(|line| {
            let figures: Vec<String> = line
                .figures
                .iter()
                .map(|figure| {
                    let mark = if figure.holds() { ' ' } else { '!' };
                    let Figure { name, value, .. } = figure;
                    let target = match figure.target() {
                        target if target.is_empty() => target,
                        target => format!(" ({target})"),
                    };
                    format!("{mark}{name} {}{target}", fixed(*value, 3))
                })
                .collect();
            format!("{:width$}  {}\n", line.case, figures.join("  "))
        })
        .collect()
}

pub fn figures(lines: &[CaseFigures]) -> Table {
    let rows = lines.iter().flat_map(|line| {
        line.figures.iter().map(|figure| {
            let mark = match figure.holds() {
                _ if !figure.has_target() => "",
                true => "✓",
                false => "✗ missed",
            };
            let value = significant(figure.value, 3);
            vec![line.case.clone(), figure.name.to_owned(), value, figure.target(), mark.to_owned()]
        })
    });
    Table::new("Targets and figures", &["Case", "Figure", "Value", "Target", ""], rows)
}

/// Start of a page, with number and names of the missed targets.
fn opened(page: Page, lines: &[CaseFigures]) -> Page {
    let (count, all) = missed(lines);
    let tile = Tile::new("Targets missed", count as f64, COUNT);
    let page = page.tile(tile.target(&format!("0 of {all}"), count == 0));
    let missing: Vec<CaseFigures> = lines
        .iter()
        .map(|line| {
            let figures = line.figures.iter().filter(|figure| !figure.holds());
            CaseFigures { case: line.case.clone(), figures: figures.cloned().collect() }
        })
        .collect();
    if count == 0 { page } else { page.section(Section::new("Missed").table(figures(&missing))) }
}

/// Number of missed figures, and number of all figures with a target.
pub fn missed(lines: &[CaseFigures]) -> (usize, usize) {
    let figures = lines.iter().flat_map(|line| &line.figures).filter(|f| f.has_target());
    (figures.clone().filter(|figure| !figure.holds()).count(), figures.count())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_without_a_target_has_no_mark() {
        let all = vec![Figure::at_most("error_k", 0.5, 1.0), Figure::shown("highest_kpa", 478.0)];
        let table = figures(&[CaseFigures { case: "a".to_owned(), figures: all }]);
        assert_eq!([&table.rows[0][4], &table.rows[1][4]], ["✓", ""]);
    }

    #[test]
    fn a_page_begins_with_what_is_missed() {
        let line = |case: &str, value| CaseFigures {
            case: case.to_owned(),
            figures: vec![Figure::at_most("error_k", value, 1.0), Figure::shown("other", value)],
        };
        let lines = [line("good", 0.5), line("bad", 1.5)];
        let page = opened(Page::new("", "", ""), &lines).render();
        assert!(
            page.contains("✗ missed: <span>target 0 of 2<") && page.contains(">Missed</h2>"),
            "{page}"
        );
        assert!(page.contains(">bad</td>") && !page.contains(">good</td>"), "{page}");
        let page = opened(Page::new("", "", ""), &lines[..1]).render();
        assert!(
            page.contains("✓ met: <span>target 0 of 1<") && !page.contains(">Missed</h2>"),
            "{page}"
        );
    }
}
