//! The page of a run that has no page of its own: what was recorded, over time.

use super::Colour;
use super::chart::{Axis, Chart, Panel};
use super::muscle::Muscle;
use super::number::{Unit, quantity, significant};
use super::page::{Page, Section, Table, Tile};
use super::series::Recorder;
use crate::scenario::PlantKind;

/// The plant's gas temperature, which the others are compared with.
const TRUTH: &str = "gas_temperature_k";

/// The columns of each section.
const TEMPERATURES: [&str; 5] =
    [TRUTH, "wall_temperature_k", "sensor_gas_k", "sensor_wall_k", "estimate_k"];
const MOTION: [&str; 2] = ["pressure_pa", "length_m"];
const AIR: [&str; 5] = ["flow_in_kg_s", "flow_out_kg_s", "mass_kg", "duty_in", "duty_out"];

/// How a column is called in a legend.
fn label(column: &str) -> &str {
    match column {
        TRUTH => "gas (plant)",
        "sensor_gas_k" | "sensor_gas_error_k" => "sensor in the gas",
        "sensor_wall_k" => "sensor in the wall",
        "wall_temperature_k" => "wall (plant)",
        "estimate_k" | "estimate_error_k" => "estimate",
        "pressure_pa" => "pressure",
        "length_m" => "length",
        "flow_in_kg_s" => "flow in",
        "flow_out_kg_s" => "flow out",
        "mass_kg" => "gas mass",
        "duty_in" => "inlet duty",
        "duty_out" => "outlet duty",
        other => other,
    }
}

/// Measured points of one trace column.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Trace column that they are compared with.
    pub column: String,
    /// Time \[s\] and value \[SI\].
    pub points: Vec<(f64, f64)>,
    /// RMSE of the run against them, as in `summary.json` \[SI\].
    ///
    /// Computed from the run's own samples: recorded rows are thinned.
    pub rmse: f64,
}

/// A line of the summary.
#[derive(Debug, Clone, PartialEq)]
pub struct SummaryRow {
    /// What it is.
    pub label: String,
    /// Value \[SI\].
    pub value: f64,
    /// SI symbol of its unit; may be empty.
    pub unit: String,
}

/// What the page shows.
#[derive(Debug, Clone)]
pub struct RunReport<'a> {
    /// Title.
    pub title: &'a str,
    /// First paragraph: what was run, and what came out.
    pub lead: &'a str,
    /// The scenario with all defaults filled in.
    pub scenario_toml: &'a str,
    /// Key figures.
    pub tiles: Vec<Tile>,
    /// Columns named as in `trace.csv`, `time_s` among them; any other may be missing. Beyond the
    /// trace, `estimate_error_k` and `sensor_gas_error_k` (against the plant's gas temperature) are
    /// drawn where they were recorded.
    pub series: &'a Recorder,
    /// Measurements to draw over the run.
    pub measured: &'a [Measured],
    /// The summary.
    pub summary: &'a [SummaryRow],
    /// Wall temperature per zone at the end, port first \[K\]; drawn from two zones on.
    pub axial_wall_k: &'a [f64],
    /// Length at rest; with it, contraction is drawn below length \[m\].
    pub rest_length_m: Option<f64>,
    /// What holds the gas.
    pub kind: PlantKind,
    /// Volume \[m3\] and absolute pressure \[Pa\] through the last stroke, every sample; may be empty.
    pub last_stroke: &'a [(f64, f64)],
    /// A stretch of time to draw the temperatures of once more, enlarged \[s\].
    pub detail_s: Option<(f64, f64)>,
}

/// The page.
pub fn render(input: &RunReport) -> String {
    let page = Page::new(input.title, input.lead, input.scenario_toml);
    let page = input.tiles.iter().cloned().fold(page, Page::tile);
    input.sections().into_iter().fold(page, Page::section).render()
}

impl RunReport<'_> {
    /// The sections of the page, for a page that adds its own.
    pub fn sections(&self) -> Vec<Section> {
        [
            self.temperature(),
            self.motion(),
            self.supply(),
            self.further_measurements(),
            self.axial(),
            self.numbers(),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    fn temperature(&self) -> Option<Section> {
        self.column(TRUTH).or(self.column("sensor_gas_k"))?;
        let mut chart = Chart::new(self.time_axis()).panel(self.temperature_panel());
        if self.column("estimate_error_k").is_some() {
            chart = chart.panel(self.error_panel());
        }
        let caption = format!(
            "The temperatures of gas (mass-weighted mean) and wall in the plant, what the sensors read, and what the core \
             estimates from pressure, length and the gas sensor; shaded: estimate ± 2 standard deviations.{}",
            self.rmse_text(&TEMPERATURES)
        );
        let mut section =
            Section::new("Temperature").figure(chart.figure("Gas temperature", &caption));
        if let Some((from, to)) = self.detail_s.filter(|(from, to)| from < to) {
            let axis = self.time_axis().range(from, to);
            let chart = Chart::new(axis).panel(self.temperature_panel());
            let caption = format!("The same from {from} s to {to} s.");
            section = section.figure(chart.figure("Gas temperature, enlarged", &caption));
        }
        Some(section)
    }

    fn temperature_panel(&self) -> Panel {
        let panel = Panel::new(Axis::new("Temperature", "K")).height(260.0);
        let panel = match (self.column("time_s"), self.column(TRUTH)) {
            (Some(time), Some(truth)) => panel.wide(label(TRUTH), Colour::Ink, time, truth),
            _ => panel,
        };
        let panel = self.plot_measured(panel, TRUTH, Colour::Ink);
        let panel = self.plot(panel, "wall_temperature_k", Colour::Green);
        let panel = self.plot(panel, "sensor_wall_k", Colour::Orange);
        let panel = self.plot(panel, "sensor_gas_k", Colour::Vermillion);
        let panel = self.plot(panel, "estimate_k", Colour::Blue);
        self.estimate_band(panel)
    }

    fn error_panel(&self) -> Panel {
        let panel =
            Panel::new(Axis::new("Error against the plant's gas temperature", "K")).height(120.0);
        let panel = self.plot(panel, "sensor_gas_error_k", Colour::Vermillion);
        self.plot(panel, "estimate_error_k", Colour::Blue).reference(0.0, "")
    }

    fn estimate_band(&self, panel: Panel) -> Panel {
        let (Some(time), Some(estimate), Some(sd)) =
            (self.column("time_s"), self.column("estimate_k"), self.column("estimate_sd_k"))
        else {
            return panel;
        };
        let edge = |side: f64| -> Vec<f64> {
            estimate.iter().zip(sd).map(|(e, sd)| e + side * 2.0 * sd).collect()
        };
        panel.band("estimate ± 2 sd", Colour::Blue, time, &edge(-1.0), &edge(1.0))
    }

    fn motion(&self) -> Option<Section> {
        let mut chart = Chart::new(self.time_axis());
        let pressure = self.column("pressure_pa").map(|_| {
            let panel = Panel::new(Axis::new("Absolute pressure", "kPa"));
            self.plot(panel, "pressure_pa", Colour::Blue)
        });
        let length = self.column("length_m").map(|_| {
            let panel = Panel::new(Axis::new("Length", "mm")).height(150.0);
            self.plot(panel, "length_m", Colour::Green)
        });
        pressure.as_ref().or(length.as_ref())?;
        chart = [pressure, length, self.contraction_panel()]
            .into_iter()
            .flatten()
            .fold(chart, Chart::panel);
        let caption = format!(
            "Absolute pressure in the gas, and how the muscle answers.{}",
            self.rmse_text(&MOTION)
        );
        let mut section = Section::new("Pressure and motion")
            .figure(chart.figure("Pressure and length", &caption));
        if !self.last_stroke.is_empty() {
            let volume: Vec<f64> = self.last_stroke.iter().map(|p| p.0 * 1e6).collect();
            let pressure: Vec<f64> = self.last_stroke.iter().map(|p| p.1 * 1e-3).collect();
            let panel = Panel::new(Axis::new("Absolute pressure", "kPa")).height(280.0);
            let panel = panel.plane("", Colour::Blue, &volume, &pressure);
            let chart = Chart::new(Axis::new("Volume", "cm³")).half().panel(panel);
            section =
                section.figures(vec![chart.figure("Pressure and volume", "The last stroke.")]);
        }
        Some(section)
    }

    fn contraction_panel(&self) -> Option<Panel> {
        let rest = self.rest_length_m?;
        let time = self.column("time_s")?;
        let contraction: Vec<f64> =
            self.column("length_m")?.iter().map(|l| 100.0 * (1.0 - l / rest)).collect();
        let panel = Panel::new(Axis::new("Contraction", "% of rest length")).height(150.0);
        Some(panel.line("contraction", Colour::Purple, time, &contraction))
    }

    fn supply(&self) -> Option<Section> {
        let flows = self.column("flow_in_kg_s").map(|_| {
            let panel = Panel::new(Axis::new("Mass flow", "g/s")).height(150.0);
            let panel = self.plot(panel, "flow_in_kg_s", Colour::Blue);
            self.plot(panel, "flow_out_kg_s", Colour::Vermillion)
        });
        let duties = self.column("duty_in").map(|_| {
            let panel = Panel::new(Axis::new("Valve duty", "").range(0.0, 1.0)).height(110.0);
            let panel = self.plot(panel, "duty_in", Colour::Blue);
            self.plot(panel, "duty_out", Colour::Vermillion)
        });
        let mass = self.column("mass_kg").map(|_| {
            let panel = Panel::new(Axis::new("Gas mass", "g")).height(130.0);
            self.plot(panel, "mass_kg", Colour::Ink)
        });
        flows.as_ref().or(duties.as_ref())?;
        let chart = [flows, mass, duties]
            .into_iter()
            .flatten()
            .fold(Chart::new(self.time_axis()), Chart::panel);
        let caption = format!(
            "Mass flow through the valves, the gas in the muscle, and the duties that the core commands.{}",
            self.rmse_text(&AIR)
        );
        Some(Section::new("Air").figure(chart.figure("Flow, mass and valves", &caption)))
    }

    /// Measurements of columns that no other section draws.
    fn further_measurements(&self) -> Option<Section> {
        let elsewhere = [&TEMPERATURES[..], &MOTION, &AIR].concat();
        let columns: Vec<&str> = self
            .measured
            .iter()
            .map(|m| m.column.as_str())
            .filter(|column| !elsewhere.contains(column))
            .collect();
        (!columns.is_empty()).then(|| {
            let chart = columns.iter().fold(Chart::new(self.time_axis()), |chart, column| {
                let axis = Axis::new(column, Unit::of_column(column).symbol);
                chart.panel(self.plot(Panel::new(axis).height(150.0), column, Colour::Blue))
            });
            let caption = format!("Run and measurement.{}", self.rmse_text(&columns));
            Section::new("Further measurements").figure(chart.figure("Other columns", &caption))
        })
    }

    fn axial(&self) -> Option<Section> {
        (self.axial_wall_k.len() > 1).then(|| {
            if self.kind != PlantKind::Muscle {
                return self.wall_profile();
            }
            let figure = Muscle::new(self.axial_wall_k).figure(
                "The muscle at the end of the run",
                "Surface temperature from the port to the closed end, on the scale of the paper's Fig. 2: 20 to 40 °C.",
            );
            Section::new("Along the muscle").figure(figure)
        })
    }

    /// What is no muscle has a curve in place of the picture.
    fn wall_profile(&self) -> Section {
        let zones = self.axial_wall_k.len() as f64;
        let places: Vec<f64> =
            (0..self.axial_wall_k.len()).map(|i| (i as f64 + 0.5) / zones).collect();
        let unit = Unit::of_column("wall_temperature_k");
        let chart = Chart::new(Axis::new("From port to closed end", "")).panel(
            Panel::new(Axis::new("Wall", unit.symbol)).height(150.0).line(
                "Wall",
                Colour::Orange,
                &places,
                &unit.convert(self.axial_wall_k),
            ),
        );
        Section::new("Along the wall")
            .figure(chart.figure("The wall at the end of the run", "Surface temperature."))
    }

    fn numbers(&self) -> Option<Section> {
        (!self.summary.is_empty()).then(|| {
            let row = |row: &SummaryRow| {
                let (value, unit) = quantity(row.value, &row.unit);
                vec![row.label.clone(), value, unit]
            };
            Section::new("Summary").table(Table {
                caption: String::new(),
                columns: ["Quantity", "Value", "Unit"].map(String::from).to_vec(),
                rows: self.summary.iter().map(row).collect(),
            })
        })
    }

    /// Adds a column as a line, with the points measured of it.
    fn plot(&self, panel: Panel, column: &str, colour: Colour) -> Panel {
        let values = self.column(column).map(|values| Unit::of_column(column).convert(values));
        let panel = match (self.column("time_s"), values) {
            (Some(time), Some(values)) => panel.line(label(column), colour, time, &values),
            _ => panel,
        };
        self.plot_measured(panel, column, colour)
    }

    fn plot_measured(&self, panel: Panel, column: &str, colour: Colour) -> Panel {
        self.measured.iter().filter(|m| m.column == column).fold(panel, |panel, measured| {
            let (time, values): (Vec<f64>, Vec<f64>) = measured.points.iter().copied().unzip();
            let name = format!("{}, measured", label(column));
            panel.dots(&name, colour, &time, &Unit::of_column(column).convert(&values))
        })
    }

    /// What the captions say about measurements of `columns`.
    fn rmse_text(&self, columns: &[&str]) -> String {
        self.measured
            .iter()
            .filter(|m| columns.contains(&m.column.as_str()))
            .map(|m| {
                let unit = Unit::of_column(&m.column);
                let rmse = significant(m.rmse * unit.factor, 3);
                format!(
                    " Against the measurement of “{}”: {rmse} {} RMS.",
                    label(&m.column),
                    unit.symbol
                )
            })
            .collect()
    }

    fn column(&self, name: &str) -> Option<&[f64]> {
        self.series.column(name)
    }

    fn time_axis(&self) -> Axis {
        Axis::new("Time", "s")
    }
}
