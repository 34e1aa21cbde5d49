//! The page: text, key figures, numbered figures and tables, in one file that opens offline.
//!
//! All text is escaped by `maud`; the style sheet is inlined, fonts are the reader's own.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::figure::{Figure, figure_id};
use super::plot::Store;
use super::style::{CHART_SCRIPT, CHART_STYLE, DRAWING_STYLE};
use serde_json::{Map, Value, json};
use thermyo_files::number::{MISSING, quantity};

const STYLE: &str = include_str!("style.css");
/// Makes the charts interactive; without it the page shows the static drawings.
const SCRIPT: &str = include_str!("report.js");

/// A key figure at the head of the page.
#[derive(Debug, Clone, PartialEq)]
pub struct Tile {
    label: String,
    value: String,
    unit: String,
    target: Option<(String, bool)>,
}

impl Tile {
    /// A value in SI with its SI unit's symbol, shown in a convenient unit: see [`quantity`].
    pub fn new(label: &str, value: f64, si_unit: &str) -> Self {
        let (value, unit) = quantity(value, si_unit);
        Self { label: label.to_owned(), value, unit, target: None }
    }

    /// States a target, such as `≤ 0.4 K`, and whether it is met; NaN never meets a target.
    pub fn target(mut self, text: &str, met: bool) -> Self {
        self.target = Some((text.to_owned(), met && self.value != MISSING));
        self
    }

    fn render(&self) -> Markup {
        html! {
            div.tile {
                div.tile-label { (self.label) }
                div.tile-value { (self.value) @if !self.unit.is_empty() { span.unit { " " (self.unit) } } }
                @if let Some((text, met)) = &self.target {
                    div class={ "tile-target " @if *met { "met" } @else { "missed" } } {
                        @if *met { "✓ met" } @else { "✗ missed" } ": " span { "target " (text) }
                    }
                }
            }
        }
    }
}

/// A table; every row has one cell per column.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    /// Text above the table; may be empty.
    pub caption: String,
    /// Column heads. The first column and those of words are aligned left, the others right.
    pub columns: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

/// Largest number of letters in the heads of a table that remains a table on a phone.
const NARROW_HEADS: usize = 34;

impl Table {
    pub fn new(
        caption: &str,
        columns: &[&str],
        rows: impl IntoIterator<Item = Vec<String>>,
    ) -> Self {
        Self {
            caption: caption.to_owned(),
            columns: columns.iter().map(|column| (*column).to_owned()).collect(),
            rows: rows.into_iter().collect(),
        }
    }

    fn is_wide(&self) -> bool {
        let letters: usize = self.columns.iter().map(|column| column.chars().count()).sum();
        self.columns.len() > 3 || letters > NARROW_HEADS
    }

    /// Whether most cells of a column, those with anything, begin with a letter.
    fn has_words(&self, column: usize) -> bool {
        let cells = self.rows.iter().filter_map(|row| row.get(column)?.chars().next());
        let letters = cells.clone().filter(|first| first.is_alphabetic()).count();
        2 * letters > cells.count()
    }

    fn render(&self) -> Markup {
        let class = |i| (i > 0 && self.has_words(i)).then_some("words");
        let words: Vec<Option<&str>> = (0..self.columns.len()).map(class).collect();
        html! {
            div.table {
                table.wide[self.is_wide()] {
                    @if !self.caption.is_empty() { caption { (self.caption) } }
                    thead { tr { @for (column, words) in self.columns.iter().zip(&words) {
                        th class=[*words] scope="col" { (column) }
                    } } }
                    tbody {
                        @for row in &self.rows {
                            // On a phone a wide table shows each row as a list: each cell carries
                            // its column's head.
                            tr { @for (i, (cell, column)) in row.iter().zip(&self.columns).enumerate() {
                                // A number alone would not do as a heading of the list.
                                @if i == 0 && cell.parse::<f64>().is_ok() {
                                    td.number data-column=(column) { (cell) }
                                } @else {
                                    td class=[words[i]] data-column=(column) { (cell) }
                                }
                            } }
                        }
                    }
                }
            }
        }
    }
}

#[derive(Debug, Clone)]
enum Block {
    Paragraph(String),
    Figures(Vec<Figure>),
    Table(Table),
}

#[derive(Debug, Clone)]
pub struct Section {
    heading: String,
    blocks: Vec<Block>,
}

impl Section {
    pub fn new(heading: &str) -> Self {
        Self { heading: heading.to_owned(), blocks: Vec::new() }
    }

    pub fn paragraph(mut self, text: &str) -> Self {
        self.blocks.push(Block::Paragraph(text.to_owned()));
        self
    }

    /// Adds a figure across the page.
    pub fn figure(self, figure: Figure) -> Self {
        self.figures(vec![figure])
    }

    /// Adds figures side by side, two to a row; for charts of half width.
    pub fn figures(mut self, figures: Vec<Figure>) -> Self {
        self.blocks.push(Block::Figures(figures));
        self
    }

    pub fn table(mut self, table: Table) -> Self {
        self.blocks.push(Block::Table(table));
        self
    }

    fn render(&self, number: usize, figures_before: &mut usize) -> Markup {
        html! {
            section id={ "section-" (number) } {
                h2 { (self.heading) }
                @for block in &self.blocks {
                    @match block {
                        Block::Paragraph(text) => p { (text) },
                        Block::Table(table) => (table.render()),
                        Block::Figures(figures) => div.figures {
                            @for figure in figures { ({
                                *figures_before += 1;
                                figure.render(*figures_before)
                            }) }
                        },
                    }
                }
            }
        }
    }
}

#[derive(Debug, Clone)]
pub struct Page {
    title: String,
    lead: String,
    warnings: Vec<String>,
    scenario_toml: String,
    tiles: Vec<Tile>,
    sections: Vec<Section>,
}

impl Page {
    /// A page with a title, a first paragraph about its content, and the scenario that reproduces
    /// it (may be empty).
    pub fn new(title: &str, lead: &str, scenario_toml: &str) -> Self {
        Self {
            title: title.to_owned(),
            lead: lead.to_owned(),
            warnings: Vec::new(),
            scenario_toml: scenario_toml.to_owned(),
            tiles: Vec::new(),
            sections: Vec::new(),
        }
    }

    /// Adds a caveat that readers need before they use the results.
    pub fn warning(mut self, text: &str) -> Self {
        self.warnings.push(text.to_owned());
        self
    }

    /// Adds a key figure.
    pub fn tile(mut self, tile: Tile) -> Self {
        self.tiles.push(tile);
        self
    }

    pub fn section(mut self, section: Section) -> Self {
        self.sections.push(section);
        self
    }

    pub fn render(&self) -> String {
        let mut figures = 0;
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    title { (self.title) }
                    style { (PreEscaped(DRAWING_STYLE)) (PreEscaped(STYLE)) (PreEscaped(CHART_STYLE)) }
                }
                body {
                    div.layout {
                        @if self.sections.len() > 1 {
                            nav aria-label="Contents" {
                                ol {
                                    @for (i, section) in self.sections.iter().enumerate() {
                                        li { a href={ "#section-" (i + 1) } { (section.heading) } }
                                    }
                                }
                            }
                        }
                        main {
                            header {
                                h1 { (self.title) }
                                p.lead { (self.lead) }
                                @for text in &self.warnings { p.warning { (text) } }
                            }
                            @if !self.tiles.is_empty() {
                                div.tiles { @for tile in &self.tiles { (tile.render()) } }
                            }
                            @for (i, section) in self.sections.iter().enumerate() {
                                (section.render(i + 1, &mut figures))
                            }
                            footer {
                                @if !self.scenario_toml.is_empty() {
                                    details {
                                        summary { "Scenario" }
                                        pre { code { (self.scenario_toml) } }
                                    }
                                }
                                p { "thermyo " (env!("CARGO_PKG_VERSION")) }
                            }
                        }
                    }
                    (self.closer_look())
                }
            }
        };
        page.into_string()
    }

    /// The points of all charts, and the script that draws them.
    fn closer_look(&self) -> Markup {
        let figures = self
            .sections
            .iter()
            .flat_map(|section| &section.blocks)
            .filter_map(|block| match block {
                Block::Figures(figures) => Some(figures),
                Block::Paragraph(_) | Block::Table(_) => None,
            })
            .flatten();
        let mut store = Store::default();
        let plots: Map<String, Value> = figures
            .enumerate()
            .filter_map(|(i, figure)| {
                let chart = figure.drawing.chart.as_ref()?;
                Some((figure_id(i + 1), chart.plot(&mut store)))
            })
            .collect();
        if plots.is_empty() {
            return html! {};
        }
        let data = json!({ "arrays": store.into_arrays(), "figures": plots });
        // Within a script element only "<" could end it.
        let data = data.to_string().replace('<', "\\u003c");
        html! {
            script type="application/json" id="plots" { (PreEscaped(data)) }
            script type="module" { (PreEscaped(CHART_SCRIPT)) (PreEscaped(SCRIPT)) }
        }
    }
}
