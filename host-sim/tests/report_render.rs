//! The report pages from synthetic data: well-formed, escaped, small, and complete with any data.
//!
//! The pages stay in the target folder's `tmp` for inspection.

use std::collections::HashSet;
use std::f64::consts::TAU;
use std::path::Path;

use quick_xml::Reader;
use quick_xml::events::Event;
use thermyo_record::tracking::Controlled;
use thermyo_report::Colour;
use thermyo_report::bars::Bars;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::figure::Figure;
use thermyo_report::heatmap::{Heatmap, Style};
use thermyo_report::muscle::Muscle;
use thermyo_report::page::{Page, Section, Table, Tile};
use thermyo_report::series::Recorder;
use thermyo_runs::run_report;
use thermyo_runs::run_report::{Measured, RunReport, SummaryRow};
use thermyo_scenario::PlantKind;

use crate::command_support::{Folder, thermyo};

const COLUMNS: [&str; 19] = [
    "time_s",
    "pressure_pa",
    "volume_m3",
    "length_m",
    "mass_kg",
    "flow_in_kg_s",
    "flow_out_kg_s",
    "gas_temperature_k",
    "wall_temperature_k",
    "sensor_gas_k",
    "sensor_wall_k",
    "estimate_k",
    "estimate_sd_k",
    "duty_in",
    "duty_out",
    "estimate_error_k",
    "sensor_gas_error_k",
    "set_point",
    "tracking_error",
];
const STEP_S: f64 = 0.001;
const PERIOD_S: f64 = 5.0;
const ZONES_K: [f64; 8] = [296.4, 298.3, 300.6, 302.7, 304.4, 305.9, 306.8, 307.3];

/// A muscle-like run of 100 s: plausible columns without physics.
fn recorded() -> (Recorder, Vec<(f64, f64)>) {
    let mut recorder = Recorder::new(&COLUMNS);
    let mut last_stroke = Vec::new();
    let (mut sensor, mut noise) = (298.0, 0.3_f64);
    for i in 0..100_000 {
        let t = f64::from(i) * STEP_S;
        let phase = (t / PERIOD_S).fract();
        let charging = phase < 0.5;
        let fill = if charging { 2.0 * phase } else { 2.0 - 2.0 * phase };
        let swing = if charging { (-phase * 6.0).exp() } else { -(-(phase - 0.5) * 6.0).exp() };
        let gas = 298.0 + 12.0 * swing + 2.0 * (1.0 - (-t / 40.0).exp());
        sensor += (gas - sensor) * STEP_S / 3.0;
        noise = (noise * 9301.7 + 0.1173).fract();
        let estimate = gas + 0.15 * (t * 1.7).sin() + 0.1 * (noise - 0.5);
        let pressure = 120e3 + 300e3 * fill.powf(0.8);
        let volume = 70e-6
            + 60e-6 * fill.powf(1.3)
            + if charging { 0.0 } else { 4e-6 * (fill * TAU / 2.0).sin() };
        let (flow_in, flow_out) = if charging { (3.6e-4, 0.0) } else { (0.0, 3.6e-4) };
        recorder.push(&[
            t,
            pressure,
            volume,
            0.3 - 0.06 * fill,
            2e-4 + 9e-4 * fill,
            flow_in,
            flow_out,
            gas,
            298.0 + 3.0 * (1.0 - (-t / 40.0).exp()),
            sensor,
            298.0 + 2.5 * (1.0 - (-t / 45.0).exp()),
            estimate,
            0.2 + 0.1 * phase,
            if charging { 0.45 + 0.2 * fill } else { 0.0 },
            if charging { 0.0 } else { 0.3 },
            estimate - gas,
            sensor - gas,
            0.2 * fill,
            0.01 * (t * 3.0).sin(),
        ]);
        if t >= 95.0 {
            last_stroke.push((volume, pressure));
        }
    }
    (recorder, last_stroke)
}

fn full_report() -> String {
    let (series, last_stroke) = recorded();
    let points = |f: &dyn Fn(f64) -> f64| {
        (0..50).map(|i| (2.0 * f64::from(i), f(2.0 * f64::from(i)))).collect()
    };
    let measured = [
        Measured {
            column: "sensor_gas_k".into(),
            points: points(&|t| 298.2 + 1.8 * (1.0 - (-t / 40.0).exp()) + 0.4 * (t * 2.1).sin()),
            rmse: 0.412,
            max: 1.0,
        },
        Measured {
            column: "length_m".into(),
            points: points(&|t| 0.27 + 0.02 * (t * 2.1).sin()),
            rmse: 0.0031,
            max: 0.01,
        },
        Measured {
            column: "volume_m3".into(),
            points: points(&|t| 1e-4 + 2e-5 * (t * 2.1).sin()),
            rmse: 4.2e-6,
            max: 1e-5,
        },
    ];
    let summary = [
        ("Duration", 100.0, "s"),
        ("Gas temperature, mean", 299.1, "K"),
        ("Pressure, highest", 420e3, "Pa"),
    ]
    .map(|(label, value, unit)| SummaryRow { label: label.into(), value, unit: unit.into() });
    run_report::render(&RunReport {
        title: "Isotonic working cycle",
        lead: "Twenty strokes of 5 s at 0.36 g/s against 100 N. The gas swings by 24 K; the sensor inside the muscle \
               shows a tenth of it, and the estimate on the board follows.",
        warnings: &["The estimate is surer of itself than it may be.".to_owned()],
        controlled: Some(Controlled::Contraction),
        drives_flow: false,
        scenario_toml: "[run]\nduration_s = 100.0\nstep_s = 0.001\n\n[load]\nkind = \"isotonic\" # <100 N> & more\n",
        tiles: vec![
            Tile::new("Error of the estimate, RMS", 0.118, "K").target("≤ 0.15 K", true),
            Tile::new("Error of the bare sensor, RMS", 6.61, "K"),
            Tile::new("Highest pressure", 420e3, "Pa"),
            Tile::new("Steady-state error, fraction of stroke", 0.0123, "").target("≤ 0.01", false),
        ],
        series: &series,
        measured: &measured,
        summary: &summary,
        axial_wall_k: &ZONES_K,
        kind: PlantKind::Muscle,
        rest_length_m: Some(0.3),
        last_stroke: &last_stroke,
        detail_s: Some((85.0, 100.0)),
    })
}

fn bars() -> [Figure; 2] {
    let budget = Bars::linear("Energy over one stroke", "J")
        .bar("enthalpy in", 268.2, Colour::Blue)
        .bar("enthalpy out", -255.9, Colour::Vermillion)
        .bar("heat to the wall", -3.4, Colour::Orange)
        .bar("work on the muscle", -8.7, Colour::Green)
        .bar("change of internal energy", 0.2, Colour::Grey);
    let sensors = Bars::log("RMSE against the plant's gas temperature", "K")
        .bar("estimate on the board", 0.118, Colour::Blue)
        .bar("model alone", 0.92, Colour::Green)
        .bar("sensor in the gas", 6.6, Colour::Vermillion)
        .bar("sensor in the wall", 8.9, Colour::Orange);
    [
        budget.figure("Where the energy goes", "One stroke."),
        sensors.figure("Sensors compared", "Full plant."),
    ]
}

fn odd_charts() -> Vec<Figure> {
    let t: Vec<f64> = (0..200).map(f64::from).collect();
    let decay: Vec<f64> = t.iter().map(|t| 1e3 * (-t / 12.0).exp()).collect();
    let flat = vec![298.0; 200];
    let gappy: Vec<f64> =
        t.iter().map(|t| if (t / 25.0).fract() < 0.2 { f64::NAN } else { t.sqrt() }).collect();
    let circle: Vec<(f64, f64)> =
        (0..=90).map(|i| f64::from(i) / 90.0 * TAU).map(|a| (a.cos(), a.sin())).collect();
    let (cos, sin): (Vec<f64>, Vec<f64>) = circle.into_iter().unzip();
    let log = Chart::new(Axis::new("Time", "s"))
        .panel(
            Panel::new(Axis::new("Residual", "Pa").log())
                .line("decay", Colour::Blue, &t, &decay)
                .dashed(
                    "same, dashed",
                    Colour::Purple,
                    &t,
                    &decay.iter().map(|v| v * 3.0).collect::<Vec<_>>(),
                )
                .reference(1.0, "tolerance")
                .reference(1.4, "limit of the sensor"),
        )
        .marker(50.0, "valve opens")
        .marker(56.0, "valve closes")
        .marker(150.0, "<stop> & vent");
    let flat = Chart::new(Axis::new("Time", "s")).panel(Panel::new(Axis::new("Flat", "K")).line(
        "",
        Colour::Ink,
        &t,
        &flat,
    ));
    let gaps = Chart::new(Axis::new("Time", "s")).half().panel(
        Panel::new(Axis::new("With gaps", "")).line("gaps", Colour::Green, &t, &gappy).dots(
            "dots",
            Colour::Sky,
            &t,
            &gappy,
        ),
    );
    let circle = Chart::new(Axis::new("Volume", "cm³"))
        .half()
        .panel(Panel::new(Axis::new("Pressure", "kPa")).plane("loop", Colour::Blue, &cos, &sin));
    let nothing = Chart::new(Axis::new("Time", "s")).panel(
        Panel::new(Axis::new("Nothing", "K"))
            .line("all NaN", Colour::Blue, &t, &[f64::NAN; 200])
            .line("empty", Colour::Green, &[], &[])
            .band("band", Colour::Blue, &t, &[f64::INFINITY; 200], &[f64::NAN; 200]),
    );
    let no_panel = Chart::new(Axis::new("Time", "s"));
    [log, flat, gaps, circle, nothing, no_panel]
        .iter()
        .map(|c| c.figure("A <chart> & \"more\"", "Caption."))
        .collect()
}

fn heatmap() -> Figure {
    let x: Vec<f64> = (0..9).map(|i| f64::from(i) / 8.0).collect();
    let y = [0.1, 0.3, 1.0, 3.0, 10.0];
    let mut cells: Vec<Vec<f64>> = y
        .iter()
        .map(|tau: &f64| x.iter().map(|p| 2.0 * tau.powf(0.4) + (p - 0.6).abs() * 3.0).collect())
        .collect();
    cells[1][2] = f64::NAN;
    cells[4].truncate(6);
    Heatmap {
        x_label: "Position of the sensor, port to closed end [–]".into(),
        y_label: "Time constant [s]".into(),
        value_label: "RMSE [K]".into(),
        x: x.iter().map(f64::to_string).collect(),
        y: y.iter().map(f64::to_string).collect(),
        cells,
        style: Style { limit: Some((2.0, "up to 2 K".into())), ..Style::default() },
    }
    .figure("Where to put a sensor", "Error of the bare sensor.")
}

fn muscles() -> [Figure; 4] {
    [&ZONES_K[..], &[299.0], &[f64::NAN, 350.0, 250.0], &[]]
        .map(|z| Muscle::new(z).figure("Muscle <1>", "Zones."))
}

fn all_figures() -> Vec<Figure> {
    let mut figures: Vec<Figure> = bars().into();
    figures.extend(muscles());
    figures.push(heatmap());
    figures.extend(odd_charts());
    figures
}

fn keep(name: &str, page: &str) {
    std::fs::write(Path::new(env!("CARGO_TARGET_TMPDIR")).join(name), page)
        .expect("the target folder is writable");
}

/// Number of elements, or the error of the XML.
fn elements(xml: &str) -> Result<usize, String> {
    let mut reader = Reader::from_str(xml);
    let mut count = 0;
    loop {
        match reader.read_event().map_err(|e| e.to_string())? {
            Event::Eof => return Ok(count),
            Event::Start(element) | Event::Empty(element) => {
                count += 1;
                for attribute in element.attributes() {
                    attribute.map_err(|e| e.to_string())?;
                }
            }
            _ => {}
        }
    }
}

/// The outermost `svg` elements of a page.
fn drawings(page: &str) -> Vec<&str> {
    let mut rest = page;
    let mut out = Vec::new();
    while let Some(start) = rest.find("<svg") {
        let mut end = start;
        let mut depth = 0;
        loop {
            let close = end + rest[end..].find("</svg>").expect("every svg is closed") + 6;
            depth += rest[end..close].matches("<svg").count();
            depth -= 1;
            end = close;
            if depth == 0 {
                break;
            }
        }
        out.push(&rest[start..end]);
        rest = &rest[end..];
    }
    out
}

#[test]
fn the_run_page_is_well_formed_whole_and_small() {
    let page = full_report();
    keep("run.html", &page);
    let drawings = drawings(&page);
    let charts = drawings.iter().filter(|svg| svg.contains("role=\"img\""));
    assert_eq!(charts.filter(|svg| !svg.contains("chart narrow")).count(), 8);
    for svg in drawings {
        assert!(elements(svg).unwrap_or_else(|e| panic!("{e}: {svg}")) >= 2);
    }
    for i in 1..=8 {
        assert!(page.contains(&format!("id=\"fig-{i}\"")), "figure {i}");
    }
    assert!((200_000..1_000_000).contains(&page.len()), "{} bytes", page.len());
    for (what, expected) in [
        ("Contraction [% of rest length]", 2),
        ("Tracking error [% of rest length]", 1),
        ("sensor in the gas</td><td data-column=\"RMS difference\">0.412<", 1),
        ("length</td><td data-column=\"RMS difference\">3.10<", 1),
        ("volume</td><td data-column=\"RMS difference\">4.20<", 1),
        ("class=\"warning\"", 1),
        ("✓ met", 1),
        ("✗ missed", 1),
    ] {
        assert_eq!(page.matches(what).count(), expected, "{what}");
    }
    for outside in ["http://", "https://", "<script src", "@import", "url(h"] {
        let namespaces = page.matches("http://www.w3.org/2000/svg").count();
        let expected = if outside == "http://" { namespaces } else { 0 };
        assert_eq!(page.matches(outside).count(), expected, "{outside}");
    }
    assert_eq!(page.matches("<script").count(), 2, "the points, and what draws them");
}

#[test]
fn a_wide_table_labels_each_cell() {
    let table = |columns: &[&str], row: &[&str]| {
        let row = row.iter().map(|text| (*text).to_owned()).collect();
        let table = Table::new("", columns, [row]);
        Page::new("", "", "").section(Section::new("").table(table)).render()
    };
    let few = table(&["Quantity", "Value", "Unit"], &["1", "2", "m"]);
    assert!(!few.contains("<table class=\"wide\""), "{few}");
    let long = table(&["Parameter", "friction.force_n", "heat.inner_w_m2_k"], &["a", "1", "0"]);
    assert!(long.contains("<table class=\"wide\""), "{long}");
    let many = table(&["sensor.gas.position", "a", "b", "c"], &["0.5", "1", "2", "3"]);
    let head =
        "<td class=\"number\" data-column=\"sensor.gas.position\">0.5</td><td data-column=\"a\">1<";
    assert!(many.contains(head), "{many}");
}

/// A map of this many columns, half a page wide.
fn narrow_map(columns: usize, value: f64) -> String {
    let x = (0..columns).map(|i| i.to_string()).collect();
    let style = Style { half: true, ..Style::default() };
    let (x_label, y_label, value_label) = ("x".into(), "y".into(), "K".into());
    let cells = vec![vec![value; columns]];
    let y = vec!["1".into()];
    Heatmap { x_label, y_label, value_label, x, y, cells, style }.figure("", "").svg().to_owned()
}

#[test]
fn a_cell_shows_its_value_where_there_is_room_for_it() {
    for (columns, value, shown) in [(4, 0.0123, "0.0123"), (8, 0.0123, "0.012"), (8, 12.34, "12.3")]
    {
        let map = narrow_map(columns, value);
        let cells = map.split("\"cell-value\"").skip(1);
        let texts: Vec<&str> =
            cells.map(|cell| &cell[cell.find('>').unwrap() + 1..cell.find('<').unwrap()]).collect();
        assert_eq!(texts, vec![shown; columns], "{map}");
    }
    // Figures of ten columns would overlap, so they are shown only under the pointer.
    let map = narrow_map(10, 0.0123);
    assert_eq!(map.matches("cell-value").count(), 0, "{map}");
    assert_eq!(map.matches("<title>0.0123</title>").count(), 10, "{map}");
}

#[test]
fn residuals_are_neutral_at_zero_and_their_label_is_whole() {
    let label = "Law less reading, N";
    let map = Heatmap {
        x_label: String::new(),
        y_label: String::new(),
        value_label: label.into(),
        x: ["1", "2", "3"].map(str::to_owned).to_vec(),
        y: vec!["1".into()],
        cells: vec![vec![-1.0, 0.0, 4.0]],
        style: Style { signed: true, ..Style::default() },
    };
    let svg = map.figure("", "").svg().to_owned();
    let fills = svg.split("<rect class=\"cell\"").skip(1);
    let channels: Vec<Vec<u8>> = fills
        .map(|cell| {
            let colour = cell.split("fill=\"#").nth(1).unwrap();
            (0..3).map(|i| u8::from_str_radix(&colour[2 * i..2 * i + 2], 16).unwrap()).collect()
        })
        .collect();
    let spread = |c: &[u8]| c.iter().max().unwrap() - c.iter().min().unwrap();
    assert!(spread(&channels[1]) < 16, "{channels:?}");
    // The colours' scale is the same on both sides: -1 is paler than 4.
    assert!((16..spread(&channels[2])).contains(&spread(&channels[0])), "{channels:?}");
    let before = svg.split(&format!(">{label}<")).next().unwrap();
    let middle: f64 =
        before.rsplit("x=\"").next().unwrap().split('"').next().unwrap().parse().unwrap();
    assert!(middle + 0.5 * 6.7 * label.len() as f64 <= 860.5, "{middle}");
}

#[test]
fn static_charts_have_a_narrow_version() {
    for figure in bars().iter().chain(&muscles()) {
        let narrow: Vec<&str> = figure.svg().split("<svg class=\"chart narrow\"").skip(1).collect();
        assert_eq!(narrow.len(), 1, "{}", figure.svg());
        assert!(narrow[0].contains("viewBox=\"0 0 358 "), "{}", narrow[0]);
    }
}

/// Reasons and units used to be aligned right, like numbers.
#[test]
fn a_column_of_words_is_aligned_like_words() {
    let row = |cells: [&str; 4]| cells.map(str::to_owned).to_vec();
    let rows = [
        row(["friction.force_n", "15.09", "N", "half of the hysteresis"]),
        row(["muscle.turns", "2.027", "", "20 times the loop's"]),
        row(["valve.dead_time_s", "–", "s", "kept"]),
    ];
    let table = Table::new("", &["Parameter", "After", "Unit", "From"], rows);
    let page = Page::new("t", "", "").section(Section::new("s").table(table)).render();
    assert!(page.contains("<td data-column=\"After\">15.09<"), "{page}");
    assert!(page.contains("<td class=\"words\" data-column=\"Unit\">N<"), "{page}");
    assert!(page.contains("<th class=\"words\" scope=\"col\">From<"), "{page}");
}

#[test]
fn words_stand_at_their_places_on_an_axis() {
    let words = ["lumped", "paper"].map(str::to_owned);
    let panel = Panel::new(Axis::new("y", "")).dots("", Colour::Blue, &[0.0, 1.0], &[1.0, 2.0]);
    let chart = Chart::new(Axis::new("plant.model", "").words(&words)).panel(panel);
    let figure = chart.figure("", "");
    let ticks = figure.svg().split("text-anchor=\"middle\">").skip(1);
    let ticks: Vec<&str> = ticks.map(|text| text.split('<').next().unwrap()).collect();
    assert_eq!(ticks, ["lumped", "paper", "plant.model"]);
}

#[test]
fn nan_meets_no_target() {
    let tile = Tile::new("Balance", f64::NAN, "").target("any", true);
    let page = Page::new("", "", "").tile(tile).render();
    assert!(page.contains("✗ missed") && !page.contains('✓'), "{page}");
}

#[test]
fn a_page_with_every_column_measured_stays_below_1_mb() {
    let folder = Folder::new();
    let text = include_str!("../../scenarios/nominal.toml");
    let other = text.replace("seed = 1\n", "seed = 2\n");
    assert_ne!(text, other);
    folder.run(text, "one").ok();
    let (two, out) = (folder.scenario(&other), folder.name("two"));
    let measured = folder.name("one/trace.csv");
    thermyo(&["run", &two, "--quiet", "--out", &out, "--measured", &measured]).ok();
    let page = folder.read("two/report.html");
    keep("measured.html", &page);
    assert!((500_000..1_000_000).contains(&page.len()), "{} bytes", page.len());
    let (_, compared) = page.split_once("Against the measurement</h2>").unwrap();
    let (compared, _) = compared.split_once("</table>").unwrap();
    assert_eq!(compared.matches("class=\"axis\" x=\"0\"").count(), 6, "panels");
    assert_eq!(compared.matches("<tr>").count(), 21, "a row for each column");
}

#[test]
fn an_hour_at_a_kilohertz_makes_a_page_below_3_mb() {
    let mut series = Recorder::new(&COLUMNS);
    let mut noise = 0.3_f64;
    for i in 0..3_600_000 {
        let t = f64::from(i) * STEP_S;
        noise = (noise * 9301.7 + 0.1173).fract();
        let mut row = [noise; COLUMNS.len()];
        row[0] = t;
        series.push(&row);
    }
    let page = run_report::render(&RunReport {
        controlled: Some(Controlled::Pressure),
        rest_length_m: Some(0.3),
        detail_s: Some((3585.0, 3600.0)),
        ..hardly_anything(&series)
    });
    keep("hour.html", &page);
    assert!((300_000..3_000_000).contains(&page.len()), "{} bytes", page.len());
}

fn hardly_anything(series: &Recorder) -> RunReport<'_> {
    RunReport {
        title: "Vessel",
        lead: "",
        warnings: &[],
        controlled: None,
        drives_flow: false,
        scenario_toml: "",
        tiles: vec![],
        series,
        measured: &[],
        summary: &[],
        axial_wall_k: &[298.0],
        kind: PlantKind::Muscle,
        rest_length_m: None,
        last_stroke: &[],
        detail_s: None,
    }
}

#[test]
fn a_run_with_hardly_any_columns_has_a_page() {
    let mut series = Recorder::new(&["time_s", "pressure_pa"]);
    // Only the chart, without a legend.
    assert_eq!(drawings(&run_report::render(&hardly_anything(&series))).len(), 1);
    series.push(&[0.0, f64::NAN]);
    let page = run_report::render(&hardly_anything(&series));
    assert!(page.contains("Absolute pressure [kPa]") && !page.contains("Gas temperature"));
    let (still, _) = page.split_once("<script").unwrap();
    assert!(!still.contains("NaN"));
}

#[test]
fn every_drawing_is_well_formed_whatever_the_data() {
    let figures = all_figures();
    for figure in &figures {
        let svg = figure.svg();
        assert!(elements(svg).unwrap_or_else(|e| panic!("{e}: {svg}")) >= 1);
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert!(svg.len() < 60_000, "{} bytes", svg.len());
    }
    let section = figures.into_iter().fold(Section::new("All drawings"), Section::figure);
    keep(
        "gallery.html",
        &Page::new("Gallery", "Every kind of drawing.", "").section(section).render(),
    );
}

#[test]
fn a_chart_alone_is_a_whole_document() {
    let time: Vec<f64> = (0..50).map(f64::from).collect();
    let chart = Chart::new(Axis::new("Time", "s")).panel(
        Panel::new(Axis::new("Pressure", "bar"))
            .line("measured", Colour::Blue, &time, &time)
            .dashed("set point & limit", Colour::Grey, &time, &time),
    );
    let svg = chart.document("A step <up>");
    assert!(svg.starts_with("<svg class=\"chart\" xmlns=\"http://www.w3.org/2000/svg\""), "{svg}");
    assert!(elements(&svg).unwrap() > 20);
    for text in ["A step &lt;up&gt;", "measured", "set point &amp; limit", "--blue:"] {
        assert!(svg.contains(text), "{text}: {svg}");
    }
    assert!(svg.len() < 20_000, "{} bytes", svg.len());
}

/// The seventh line of a kind used to look like the first, and a long legend ran out of the drawing.
#[test]
fn many_lines_differ_and_their_legend_fits() {
    let panel = (0..14).fold(Panel::new(Axis::new("Gas", "K")), |panel, n| {
        panel.nth_line(n, &format!("stop number {}", n + 1), &[0.0, 1.0], &[0.0, 1.0])
    });
    let chart = Chart::new(Axis::new("Time", "s")).panel(panel);
    let svg = chart.document("Stops");
    let samples = svg.split("<svg class=\"").skip(2).take(14);
    let looks: HashSet<_> = samples.map(|text| text.split(" d=").next().unwrap()).collect();
    assert_eq!(looks.len(), 14, "{svg}");
    let number = |text: &str| text.split([' ', '"']).next().unwrap().parse::<f64>().unwrap();
    let after = |mark| svg.split(mark).skip(1).map(number);
    let width_px = after(" width=\"").next().unwrap();
    assert!(after("translate(").all(|left_px| left_px + 100.0 < width_px), "{svg}");
}

#[test]
fn a_series_without_a_point_is_in_no_legend_and_no_panel() {
    let time = [0.0, 1.0];
    let panel = |label: &str| Panel::new(Axis::new(label, "N"));
    let chart = Chart::new(Axis::new("Time", "s"))
        .panel(panel("Pull").line("there", Colour::Blue, &time, &time).line(
            "unknown",
            Colour::Green,
            &time,
            &[f64::NAN; 2],
        ))
        .panel(panel("Empty").reference(0.0, "").line("none", Colour::Blue, &time, &[f64::NAN; 2]));
    let document = chart.document("Two");
    assert!(document.contains("Pull") && document.contains("there"), "{document}");
    for absent in ["unknown", "Empty", "none<"] {
        assert!(!document.contains(absent), "{absent}: {document}");
    }
}

#[test]
fn text_is_escaped_everywhere() {
    let nasty = "<b>&\"'</b>";
    let table = Table::new(nasty, &[nasty], [vec![nasty.to_owned()]]);
    let chart = Chart::new(Axis::new(nasty, nasty))
        .panel(
            Panel::new(Axis::new(nasty, nasty))
                .line(nasty, Colour::Blue, &[0.0, 1.0], &[0.0, 1.0])
                .reference(0.5, nasty),
        )
        .marker(0.5, nasty);
    let bars = Bars::linear(nasty, nasty).bar(nasty, 1.0, Colour::Blue);
    let section = Section::new(nasty)
        .paragraph(nasty)
        .table(table)
        .figure(chart.figure(nasty, nasty))
        .figure(bars.figure(nasty, nasty));
    let page = Page::new(nasty, nasty, nasty)
        .tile(Tile::new(nasty, 1.0, nasty).target(nasty, true))
        .section(section.clone())
        .section(section)
        .render();
    assert!(!page.contains("<b>&"), "unescaped");
    // Twice as an attribute (aria-label), where quotes have to be escaped too.
    assert!(page.contains("aria-label=\"&lt;b&gt;&amp;&quot;"));
    for svg in drawings(&page) {
        elements(svg).unwrap_or_else(|e| panic!("{e}: {svg}"));
    }
}

#[test]
fn a_long_series_is_thinned_but_keeps_its_peak() {
    let t: Vec<f64> = (0..200_000).map(f64::from).collect();
    let mut y: Vec<f64> = t.iter().map(|t| (t * 0.37).sin()).collect();
    y[123_456] = 10.0;
    let chart = |y: &[f64]| {
        let panel = Panel::new(Axis::new("y", "").range(-2.0, 12.0)).height(140.0).line(
            "y",
            Colour::Blue,
            &t,
            y,
        );
        Chart::new(Axis::new("t", "s")).panel(panel).figure("t", "c").svg().to_owned()
    };
    let with_peak = chart(&y);
    assert!((5_000..25_000).contains(&with_peak.len()), "{} bytes", with_peak.len());
    y[123_456] = 0.0;
    assert_ne!(with_peak, chart(&y), "the peak is in the drawing");
}

#[test]
fn captions_say_what_is_drawn() {
    let caption = |columns: &[&str], kind: PlantKind, controlled: Option<Controlled>| {
        let mut series = Recorder::new(columns);
        (0..2).for_each(|_| series.push(&vec![1.0; columns.len()]));
        let input = RunReport { kind, controlled, ..hardly_anything(&series) };
        run_report::render(&input)
    };
    let board = [
        "time_s",
        "pressure_pa",
        "length_m",
        "mass_kg",
        "sensor_gas_k",
        "estimate_k",
        "estimate_sd_k",
        "duty_in",
        "duty_out",
        "set_point",
    ];
    let page = caption(&board, PlantKind::Muscle, Some(Controlled::Pressure));
    for expected in [
        "The set point and the sensor's reading.",
        "The reading of the sensor in the gas and the core's estimate from pressure, length and the gas sensor; shaded",
        "The core's estimate of the gas in the muscle and the duties that the core commands.",
        "Mass and valves",
    ] {
        assert!(page.contains(expected), "{expected}");
    }
    assert!(
        !page.contains("in the plant")
            && !page.contains("Mass flow")
            && !page.contains("difference")
    );

    let page = caption(&COLUMNS, PlantKind::Vessel, Some(Controlled::Pressure));
    for expected in [
        "The set point, the plant's value and their difference.",
        "the sensors' readings and the core's estimate from pressure and the gas sensor; shaded",
        "Mass flow in and out, the gas in the vessel and the duties that the core commands.",
        "Flow, mass and valves",
    ] {
        assert!(page.contains(expected), "{expected}");
    }
    assert!(full_report().contains("estimate from pressure, length and the gas sensor; shaded"));
}

#[test]
fn a_mass_flow_is_drawn_with_its_set_point() {
    let mut series = Recorder::new(&["time_s", "flow_in_kg_s", "flow_out_kg_s", "set_point"]);
    for (time_s, set_point) in [(0.0, 3e-4), (1.0, 3e-4), (1.0, -2e-4), (2.0, -2e-4)] {
        series.push(&[time_s, 1e-4, 1e-4, set_point]);
    }
    let page =
        |drives_flow| run_report::render(&RunReport { drives_flow, ..hardly_anything(&series) });
    let (set, not) = (page(true), page(false));
    assert!(set.contains("Mass flow in and out, set and real."));
    assert!(not.contains("Mass flow in and out.") && !not.contains("set point"));
    let dashed = |page: &str| {
        let svg =
            drawings(page).into_iter().find(|svg| svg.contains("Mass flow")).unwrap().to_owned();
        svg.matches("dashed").count()
    };
    assert_eq!(dashed(&set) - dashed(&not), 2);
    for name in ["set point, in", "set point, out"] {
        assert!(set.contains(name), "{name}");
    }
}
