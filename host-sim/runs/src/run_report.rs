//! Page of a run without a page of its own: recorded quantities over time.

use thermyo_files::number::{quantity, significant};
use thermyo_files::units::Unit;
use thermyo_record::tracking::Controlled;
use thermyo_report::Colour;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::muscle::Muscle;
use thermyo_report::page::{Page, Section, Table, Tile};
use thermyo_report::series::Recorder;
use thermyo_scenario::PlantKind;

/// The plant's gas temperature, with which the others are compared.
const TRUTH: &str = "gas_temperature_k";
/// Most columns that are drawn against their measurement; the table contains all.
const MOST_COMPARED: usize = 6;

pub(crate) fn label(column: &str) -> &str {
    match column {
        TRUTH => "gas (plant)",
        "sensor_gas_k" | "sensor_gas_error_k" => "sensor in the gas",
        "sensor_wall_k" => "sensor in the wall",
        "wall_temperature_k" => "wall (plant)",
        "estimate_k" | "estimate_error_k" => "estimate",
        "pressure_pa" => "pressure",
        "volume_m3" => "volume",
        "length_m" => "length",
        "flow_in_kg_s" => "flow in",
        "flow_out_kg_s" => "flow out",
        "mass_kg" => "gas mass",
        "model_k" => "gas (forward model)",
        "model_sensor_k" => "sensor (forward model)",
        "wall_estimate_k" => "estimate of the wall",
        "sensor_estimate_k" => "estimate of the sensor",
        "mass_estimate_kg" => "estimate of the gas mass",
        "measured_pressure_pa" => "pressure, as read",
        "measured_length_m" => "length, as read",
        "duty_in" => "inlet duty",
        "duty_out" => "outlet duty",
        other => other,
    }
}

/// "a", "a and b", "a, b and c".
fn listed(parts: &[&str]) -> String {
    match parts {
        [] => String::new(),
        [only] => (*only).to_owned(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

pub(super) fn capitalised(text: &str) -> String {
    text[..1].to_uppercase() + &text[1..]
}

/// Measured points of one trace column.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// Trace column with which the points are compared.
    pub column: String,
    /// Time \[s\] and value \[SI\].
    pub points: Vec<(f64, f64)>,
    /// RMSE of the run against the points, as in `summary.json` \[SI\].
    ///
    /// Computed from the run's own samples, since recorded rows are thinned.
    pub rmse: f64,
    /// Largest difference between the run and the points, computed likewise \[SI\].
    pub max: f64,
}

impl Measured {
    /// RMSE as a fraction of the span of the measured values.
    fn share(&self) -> f64 {
        let values = || self.points.iter().map(|point| point.1);
        let span =
            values().fold(f64::NEG_INFINITY, f64::max) - values().fold(f64::INFINITY, f64::min);
        if span > 0.0 { self.rmse / span } else { 0.0 }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct SummaryRow {
    pub label: String,
    /// Value \[SI\].
    pub value: f64,
    /// SI symbol of its unit; may be empty.
    pub unit: String,
}

#[derive(Debug, Clone)]
pub struct RunReport<'a> {
    pub title: &'a str,
    /// First paragraph: the run and its result.
    pub lead: &'a str,
    /// Warnings that limit the validity of the results.
    pub warnings: &'a [String],
    /// The scenario with all defaults filled in.
    pub scenario_toml: &'a str,
    pub tiles: Vec<Tile>,
    /// Columns named as in `trace.csv`, `time_s` among them; any other may be missing. Beyond the trace,
    /// `estimate_error_k` and `sensor_gas_error_k` (against the plant's gas temperature) and `tracking_error` (the
    /// controlled value minus its set point) are drawn if they were recorded.
    pub series: &'a Recorder,
    /// The quantity that the set point controls, if a loop is closed.
    pub controlled: Option<Controlled>,
    /// Whether the set point is a mass flow, drawn beside the flows: inflow positive, outflow negative.
    pub drives_flow: bool,
    /// Measurements to draw over the run.
    pub measured: &'a [Measured],
    pub summary: &'a [SummaryRow],
    /// Wall temperature per zone at the end, port first \[K\]; drawn from two zones on.
    pub axial_wall_k: &'a [f64],
    /// Length at rest \[m\]; if it is present, contraction is drawn below length.
    pub rest_length_m: Option<f64>,
    pub kind: PlantKind,
    /// Volume \[m3\] and absolute pressure \[Pa\] through the last stroke, every sample; may be empty.
    pub last_stroke: &'a [(f64, f64)],
    /// Interval in which the temperatures are drawn again, enlarged \[s\].
    pub detail_s: Option<(f64, f64)>,
}

pub fn render(input: &RunReport) -> String {
    let page = Page::new(input.title, input.lead, input.scenario_toml);
    let page = input.warnings.iter().fold(page, |page, text| page.warning(text));
    let page = input.tiles.iter().cloned().fold(page, Page::tile);
    input.sections().into_iter().fold(page, Page::section).render()
}

impl RunReport<'_> {
    /// The sections of the page, for pages that add their own.
    pub fn sections(&self) -> Vec<Section> {
        [
            self.control(),
            self.comparison(),
            self.temperature(),
            self.motion(),
            self.supply(),
            self.axial(),
            self.numbers(),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    /// Set point and tracking.
    fn control(&self) -> Option<Section> {
        let controlled = self.controlled?;
        let time = self.column("time_s")?;
        let unit = controlled.unit();
        let (name, value) = match controlled {
            Controlled::Pressure => (label("pressure_pa"), self.column("pressure_pa")?.to_vec()),
            Controlled::Contraction => ("contraction", self.contraction()?),
        };
        let set_point = unit.convert(self.column("set_point")?);
        let panel = Panel::new(Axis::new(controlled.name(), unit.symbol))
            .height(240.0)
            .dashed("set point", Colour::SetPoint, time, &set_point)
            .line(name, Colour::Measured, time, &unit.convert(&value));
        let mut chart = Chart::new(self.time_axis()).panel(panel);
        if let Some(error) = self.column("tracking_error") {
            let axis = Axis::new("Tracking error", unit.symbol);
            let panel = Panel::new(axis).height(120.0).reference(0.0, "");
            chart = chart.panel(panel.line("", Colour::Blue, time, &unit.convert(error)));
        }
        let follows = if self.has_plant() { "the plant's value" } else { "the sensor's reading" };
        let mut parts = vec!["The set point", follows];
        parts.extend(self.column("tracking_error").map(|_| "their difference"));
        let caption = format!("{}.", listed(&parts));
        Some(
            Section::new("Control").figure(chart.figure("Set point and what follows it", &caption)),
        )
    }

    fn comparison(&self) -> Option<Section> {
        let rows: Vec<Vec<String>> = self
            .measured
            .iter()
            .map(|measured| {
                let unit = Unit::of_column(&measured.column);
                let [rmse, max] =
                    [measured.rmse, measured.max].map(|v| significant(v * unit.factor, 3));
                vec![label(&measured.column).to_owned(), rmse, max, unit.symbol.to_owned()]
            })
            .collect();
        if rows.is_empty() {
            return None;
        }
        let colours = [Colour::Blue, Colour::Vermillion, Colour::Green, Colour::Purple];
        let mut drawn: Vec<&Measured> = self.measured.iter().collect();
        drawn.sort_by(|a, b| b.share().total_cmp(&a.share()));
        drawn.truncate(MOST_COMPARED);
        let panels = drawn.into_iter().zip(colours.into_iter().cycle());
        let chart = panels.fold(Chart::new(self.time_axis()), |chart, (measured, colour)| {
            let unit = Unit::of_column(&measured.column).symbol;
            let name = label(&measured.column);
            let axis = Axis::new(&capitalised(name), unit);
            chart.panel(self.plot(Panel::new(axis).height(180.0), &measured.column, colour))
        });
        let mut caption = "Points: measured. Lines: the run.".to_owned();
        if self.measured.len() > MOST_COMPARED {
            let of = self.measured.len();
            caption += &format!(
                " The {MOST_COMPARED} of {of} columns that differ most, for what they span."
            );
        }
        let columns = ["Quantity", "RMS difference", "Largest", "Unit"];
        Some(
            Section::new("Against the measurement")
                .figure(chart.figure("Run and measurement", &caption))
                .table(Table::new("Difference of the run to the measurement", &columns, rows)),
        )
    }

    fn temperature(&self) -> Option<Section> {
        self.column(TRUTH).or(self.column("sensor_gas_k"))?;
        let mut chart = Chart::new(self.time_axis()).panel(self.temperature_panel());
        if self.column("estimate_error_k").is_some() {
            chart = chart.panel(self.error_panel());
        }
        let estimate = format!("the core's estimate from {}", listed(&self.estimated_from()));
        let parts = if self.has_plant() {
            let plant = "The temperatures of gas (mass-weighted mean) and wall in the plant";
            vec![plant, "the sensors' readings", &estimate]
        } else {
            vec!["The reading of the sensor in the gas", &estimate]
        };
        let caption = format!("{}; shaded: estimate ± 2 standard deviations.", listed(&parts));
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
            (Some(time), Some(truth)) => panel.wide(label(TRUTH), Colour::Truth, time, truth),
            _ => panel,
        };
        let panel = self.plot_measured(panel, TRUTH, Colour::Truth);
        let panel = self.plot(panel, "wall_temperature_k", Colour::Wall);
        let panel = self.plot(panel, "sensor_wall_k", Colour::WallSensor);
        let panel = self.plot(panel, "sensor_gas_k", Colour::Sensor);
        let panel = self.plot(panel, "estimate_k", Colour::Estimate);
        self.estimate_band(panel)
    }

    fn error_panel(&self) -> Panel {
        let panel =
            Panel::new(Axis::new("Error against the plant's gas temperature", "K")).height(120.0);
        let panel = self.plot(panel, "sensor_gas_error_k", Colour::Sensor);
        self.plot(panel, "estimate_error_k", Colour::Estimate).reference(0.0, "")
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
        panel.band("estimate ± 2 sd", Colour::Estimate, time, &edge(-1.0), &edge(1.0))
    }

    fn motion(&self) -> Option<Section> {
        let mut chart = Chart::new(self.time_axis());
        let pressure = self.column("pressure_pa").map(|_| {
            let panel = Panel::new(Axis::new("Absolute pressure", "kPa"));
            self.plot(panel, "pressure_pa", Colour::Measured)
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
        let plant = self.plant();
        let (heading, title, caption) = if self.kind == PlantKind::Vessel {
            ("Pressure", "Pressure", format!("Absolute pressure in the {plant}."))
        } else {
            let caption = format!("Absolute pressure in the gas, and how the {plant} answers.");
            ("Pressure and motion", "Pressure and length", caption)
        };
        let mut section = Section::new(heading).figure(chart.figure(title, &caption));
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
        let time = self.column("time_s")?;
        let unit = Controlled::Contraction.unit();
        let panel = Panel::new(Axis::new("Contraction", unit.symbol)).height(150.0);
        let contraction = unit.convert(&self.contraction()?);
        Some(panel.line("contraction", Colour::Purple, time, &contraction))
    }

    /// Fraction of the rest length \[-\].
    fn contraction(&self) -> Option<Vec<f64>> {
        let rest = self.rest_length_m?;
        Some(self.column("length_m")?.iter().map(|length| 1.0 - length / rest).collect())
    }

    /// Whether the plant's true values were recorded; a record of a board has none.
    fn has_plant(&self) -> bool {
        self.column(TRUTH).is_some()
    }

    /// Inputs of the core's estimate. A vessel has no length sensor; its volume follows from the
    /// piston's drive.
    fn estimated_from(&self) -> Vec<&'static str> {
        let volumes = self.column("volume_m3").unwrap_or_default();
        let moved = volumes.windows(2).any(|pair| pair[0] != pair[1]);
        match self.kind {
            PlantKind::Vessel if moved => vec!["pressure", "volume", "the gas sensor"],
            PlantKind::Vessel => vec!["pressure", "the gas sensor"],
            _ => vec!["pressure", "length", "the gas sensor"],
        }
    }

    fn plant(&self) -> &'static str {
        match self.kind {
            PlantKind::Muscle => "muscle",
            PlantKind::Vessel => "vessel",
            PlantKind::Cylinder => "cylinder",
            PlantKind::Table => "chamber",
        }
    }

    fn supply(&self) -> Option<Section> {
        let flows = self.column("flow_in_kg_s").map(|_| {
            let panel = Panel::new(Axis::new("Mass flow", "g/s")).height(150.0);
            let panel = self.plot(panel, "flow_in_kg_s", Colour::Inlet);
            let panel = self.plot(panel, "flow_out_kg_s", Colour::Outlet);
            self.flow_set_points().into_iter().fold(panel, |panel, (name, colour, flow)| {
                panel.dashed(name, colour, self.column("time_s").unwrap_or_default(), &flow)
            })
        });
        let duties = self.column("duty_in").map(|_| {
            let panel = Panel::new(Axis::new("Valve duty", "").range(0.0, 1.0)).height(110.0);
            let panel = self.plot(panel, "duty_in", Colour::Inlet);
            self.plot(panel, "duty_out", Colour::Outlet)
        });
        let mass = self.column("mass_kg").map(|_| {
            let panel = Panel::new(Axis::new("Gas mass", "g")).height(130.0);
            self.plot(panel, "mass_kg", Colour::Ink)
        });
        flows.as_ref().or(duties.as_ref())?;
        let plant = self.plant();
        let gas = if self.has_plant() {
            format!("the gas in the {plant}")
        } else {
            format!("the core's estimate of the gas in the {plant}")
        };
        let flow = if self.drives_flow {
            "mass flow in and out, set and real"
        } else {
            "mass flow in and out"
        };
        let parts = [
            (flows, "flow", flow),
            (mass, "mass", gas.as_str()),
            (duties, "valves", "the duties that the core commands"),
        ];
        let (mut chart, mut titles, mut captions) = (Chart::new(self.time_axis()), vec![], vec![]);
        for (panel, title, caption) in parts {
            if let Some(panel) = panel {
                chart = chart.panel(panel);
                titles.push(title);
                captions.push(caption);
            }
        }
        let (title, caption) = (capitalised(&listed(&titles)), capitalised(&listed(&captions)));
        Some(Section::new("Air").figure(chart.figure(&title, &format!("{caption}."))))
    }

    /// Set points of inflow and outflow, each with its legend and in the panel's unit.
    fn flow_set_points(&self) -> Vec<(&'static str, Colour, Vec<f64>)> {
        let Some(set) = self.column("set_point").filter(|_| self.drives_flow) else {
            return vec![];
        };
        let unit = Unit::of_column("flow_in_kg_s");
        // Undefined values stay undefined: `f64::max` would make them 0.
        let side = |sign: f64| -> Vec<f64> {
            set.iter().map(|v| if v * sign < 0.0 { 0.0 } else { v * sign * unit.factor }).collect()
        };
        vec![
            ("set point, in", Colour::Inlet, side(1.0)),
            ("set point, out", Colour::Outlet, side(-1.0)),
        ]
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

    /// Chambers other than muscles get a curve instead of the picture.
    fn wall_profile(&self) -> Section {
        let zones = self.axial_wall_k.len() as f64;
        let places: Vec<f64> =
            (0..self.axial_wall_k.len()).map(|i| (i as f64 + 0.5) / zones).collect();
        let unit = Unit::of_column("wall_temperature_k");
        let chart = Chart::new(Axis::new("From port to closed end", "")).panel(
            Panel::new(Axis::new("Wall", unit.symbol)).height(150.0).line(
                "Wall",
                Colour::Wall,
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
            let rows = self.summary.iter().map(row);
            Section::new("Summary").table(Table::new("", &["Quantity", "Value", "Unit"], rows))
        })
    }

    /// Adds a column as a line, with its measured points.
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

    fn column(&self, name: &str) -> Option<&[f64]> {
        self.series.column(name)
    }

    fn time_axis(&self) -> Axis {
        Axis::new("Time", "s")
    }
}
