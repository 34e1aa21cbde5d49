//! Report of `thermyo reproduce`: the paper's figures beside the simulated ones, and their
//! differences.

use super::{Findings, SensorVerdict, Signals, Variant};
use thermyo_record::summary::Summary;
use thermyo_report::Colour;
use thermyo_report::bars::Bars;
use thermyo_report::chart::{Axis, Chart, Panel};
use thermyo_report::figure::Figure;
use thermyo_report::muscle::Muscle;
use thermyo_report::page::{Page, Section, Table, Tile};
use thermyo_setup::Loaded;

const PASCAL_PER_KPA: f64 = 1e3;
const ML_PER_M3: f64 = 1e6;
const DETAIL_STROKES: f64 = 2.0;

pub fn page(loaded: &Loaded, findings: &Findings, summary: &Summary) -> String {
    let lead = format!(
        "A pneumatic muscle lifts {:.0} N: {:.2} g/s of air in for {:.1} s, the same flow out for {:.1} s, \
         {} strokes in {:.0} s, from 298 K. The gas inside swings by {:.0} K with every stroke; the Pt foil \
         in its middle shows {:.1} K. This is the experiment of Kopecny and Zalud, “Sensors for \
         Evaluation of Thermodynamical Model of pMA” (2013), run on a simulated muscle that has what \
         their equations leave out, with the estimator that the paper's model makes possible.",
        loaded.plant.load.force_n,
        loaded.plant.drive.flow_kg_s * 1e3,
        0.5 * findings.period_s,
        0.5 * findings.period_s,
        summary.strokes,
        summary.duration_s,
        swing_k(findings, &findings.signals.gas_k),
        swing_k(findings, &findings.signals.sensor_gas_k),
    );
    Page::new(
        "Thermodynamics of a pneumatic muscle: the paper's working cycle",
        &lead,
        &thermyo_setup::render(loaded),
    )
    .tile(Tile::new(
        "Gas temperature, swing of a stroke",
        swing_k(findings, &findings.signals.gas_k),
        "K",
    ))
    .tile(Tile::new("Bare sensor, RMS error", summary.rmse_k.sensor_gas, "K"))
    .tile(Tile::new("Estimate, RMS error", summary.rmse_k.estimate, "K"))
    .tile(
        Tile::new("Energy balance", summary.energy_balance_error, "")
            .target("≤ 1e-6", summary.energy_balance_error <= 1e-6),
    )
    .section(figure_5(findings, summary))
    .section(figure_2(summary))
    .section(section_iv(findings, summary))
    .section(cycle(findings))
    .section(equations(findings))
    .section(energy(findings))
    .section(estimate(findings, summary))
    .section(not_in_the_paper())
    .section(checks(findings))
    .render()
}

/// Largest minus smallest value in the last stroke \[K\].
fn swing_k(findings: &Findings, values: &[f64]) -> f64 {
    findings.signals.stroke_swing(values, findings.period_s)
}

fn time_axis() -> Axis {
    Axis::new("Time", "s")
}

fn kelvin(label: &str) -> Axis {
    Axis::new(label, "K")
}

fn figure_5(findings: &Findings, summary: &Summary) -> Section {
    let signals = &findings.signals;
    let panel = Panel::new(kelvin("Temperature of the sensor"))
        .height(280.0)
        .line("sensor in the muscle (plant)", Colour::Blue, &signals.time_s, &signals.sensor_gas_k)
        .line(
            "sensor in the paper's model",
            Colour::Vermillion,
            &findings.model.time_s,
            &findings.model.sensor_gas_k,
        )
        .dashed(
            "muscle without air moving under its insulation",
            Colour::Sky,
            &findings.still_air.time_s,
            &findings.still_air.sensor_gas_k,
        );
    let caption = format!(
        "Temperature of the sensor over {:.0} s: in the muscle (blue) and in the model (red), the paper's \
         colours. Moved by {:+.2} s the two correlate with {:.3}.",
        summary.duration_s, findings.model_shift_s, findings.model_correlation
    );
    Section::new("Fig. 5: what the sensor shows")
        .figure(Chart::new(time_axis()).panel(panel).figure("Sensor, muscle and model", &caption))
        .paragraph(
            "What the paper shows: the sensor in the muscle starts at 298 K and rises to nearly 300 K in \
             100 s, with a ripple per stroke; the model does the same, only faster. “Rough shape match”, \
             after a time shift for the sensor's inertia and the rapid filling and venting.",
        )
        .paragraph(&format!(
            "What this shows: the sensor starts at {:.2} K, stays between {:.2} and {:.2} K, and its mean \
             over the last stroke lies {:.2} K above the start. The paper's model is one homogeneous gas \
             volume with the same friction, flow and wall, by the energy balance (3), without air moving \
             under the insulation: it has the same ripple (correlation {:.3}, shifted by {:+.2} s), and \
             rises by {:.2} K: the muscle warms {}.",
            summary.sensor_gas_k.first,
            summary.sensor_gas_k.min,
            summary.sensor_gas_k.max,
            findings.gas_sensor.rise_k,
            findings.model_correlation,
            findings.model_shift_s,
            findings.model_rise_k,
            if findings.gas_sensor.rise_k < findings.model_rise_k {
                "more slowly, as in the paper"
            } else {
                "faster, which the paper's does not"
            },
        ))
        .paragraph(&format!(
            "Where they differ: the paper names no flow, no muscle data and no sensor lag, so the height of the \
             curve is set by choice (see the scenario at the end of this page); only its shape is found. It \
             blames “ambient air flowing under the thermal insulation when muscle is moving” for the slower \
             muscle: the same simulated muscle without that air rises by {:.2} K instead of {:.2} K (dashed). \
             The correlation compares two simulations, not a measurement: the paper prints its curves as a \
             picture, without numbers.",
            findings.still_air_rise_k, findings.gas_sensor.rise_k
        ))
        .figure(gas_behind(findings))
}

fn gas_behind(findings: &Findings) -> Figure {
    let signals = &findings.signals;
    let gas = Panel::new(kelvin("Temperature of the gas"))
        .height(200.0)
        .wide("gas (plant, mean)", Colour::Truth, &signals.time_s, &signals.gas_k)
        .line(
            "gas (the paper's model)",
            Colour::Vermillion,
            &findings.model.time_s,
            &findings.model.gas_k,
        )
        .dashed("sensor in the muscle", Colour::Blue, &signals.time_s, &signals.sensor_gas_k);
    let detail_s = DETAIL_STROKES * findings.period_s;
    Chart::new(time_axis().range(0.0, detail_s)).panel(gas).figure(
        "The gas behind it",
        "The first strokes: what the gas does and the sensor does not show. The gas warms while \
         it is compressed by what flows in, and cools when the flow turns round.",
    )
}

fn figure_2(summary: &Summary) -> Section {
    let degc: Vec<f64> = summary.axial_temperature_k.iter().map(|k| k - 273.15).collect();
    let low = degc.iter().copied().fold(f64::INFINITY, f64::min);
    let high = degc.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let (port, end) =
        (degc.first().copied().unwrap_or(f64::NAN), degc.last().copied().unwrap_or(f64::NAN));
    Section::new("Fig. 2: the thermal image after 20 strokes")
        .figure(Muscle::new(&summary.axial_temperature_k).figure(
            "Surface of the muscle",
            "Surface temperature along the muscle at the end of the run, on the paper's scale of 20 to \
             40 degC. The port is on the left.",
        ))
        .paragraph(
            "What the paper shows: a thermal image on which the muscle is coolest at the air port and \
             warmest at the closed end, “caused by better gas exchange on the muscle air port side”.",
        )
        .paragraph(&format!(
            "What this shows: {port:.1} degC at the port, {end:.1} degC at the closed end, {low:.1} to \
             {high:.1} degC overall. It comes out of the balance of each zone: fresh air reaches the port end \
             with every stroke, while the gas at the closed end is the same that is compressed and \
             released, and it gives its heat to the wall there."
        ))
        .paragraph(
            "Where they differ: the paper's picture spans most of its scale of 20 K, this one a few kelvin: order \
             and place of the temperatures are reproduced, their span is not. Twenty \
             strokes of friction and compression do not hold the energy for more in a wall of this heat \
             capacity (see the balance below), and a wall that hot would not fit the 2 K of Fig. 5, \
             which the same muscle's sensor shows.",
        )
}

fn section_iv(findings: &Findings, summary: &Summary) -> Section {
    let signals = &findings.signals;
    let (foil, wall) = (&findings.gas_sensor, &findings.wall_sensor);
    let chart = Chart::new(time_axis())
        .panel(
            Panel::new(kelvin("Reading"))
                .height(240.0)
                .line("foil in the gas", Colour::Sensor, &signals.time_s, &signals.sensor_gas_k)
                .line(
                    "sensor in the wall",
                    Colour::WallSensor,
                    &signals.time_s,
                    &signals.sensor_wall_k,
                ),
        )
        .figure(
            "The same sensor in both places",
            "One foil in the middle of the gas (the paper's Fig. 4), one in the braided sleeving \
             (its Fig. 3).",
        );
    let verdict = if foil.gain > wall.gain && foil.correlation > wall.correlation {
        "the foil in the gas"
    } else {
        "the sensor in the wall"
    };
    Section::new("Section IV: which sensor")
        .paragraph(
            "What the paper shows: a sensor in the braided wall “gives data more about a rubber muscle \
             wall temperature (heated by material friction) instead of inside gas temperature changes”. \
             It was given up for a foil in the gas.",
        )
        .figure(chart)
        .table(which_sensor(findings, summary))
        .paragraph(&format!(
            "What this shows: the figures choose {verdict}. The foil passes {:.1} % of the gas \
             temperature's swing, the wall {:.1} %, {:.0} times less. The same muscle run without friction \
             heat shows what friction adds: to the wall sensor {:.1} times what the gas does in a stroke, to \
             the foil {:.1} times. The paper asks for “spatial temperature averaging”: a foil along the whole \
             muscle passes {:.1} %.",
            foil.gain * 100.0,
            wall.gain * 100.0,
            foil.gain / wall.gain,
            wall.friction_to_gas,
            foil.friction_to_gas,
            findings.averaging_sensor.gain * 100.0,
        ))
        .paragraph(&format!(
            "Where they differ: the paper stops at the foil. Here its slow rise is friction heat too, \
             because the wall warms the gas; and even the foil, read bare, is wrong \
             by {:.1} K, no better than the wall sensor: most of the swing is missing in both. Chosen well it \
             is still no thermometer of the gas; the estimator below makes it one.",
            summary.rmse_k.sensor_gas
        ))
}

/// Figures for the choice of the sensor.
fn which_sensor(findings: &Findings, summary: &Summary) -> Table {
    let (foil, wall) = (&findings.gas_sensor, &findings.wall_sensor);
    let averaging = &findings.averaging_sensor;
    let row = |what: &str, of: &dyn Fn(&SensorVerdict) -> String| {
        vec![what.to_owned(), of(foil), of(averaging), of(wall)]
    };
    Table::new(
        "Figures that decide between them",
        &["", "in the gas, in the middle", "in the gas, averaging over the length", "in the wall"],
        [
            row("swing shown, relative to the gas", &|v| format!("{:.1} %", v.gain * 100.0)),
            row("delay at the stroke's frequency", &|v| format!("{:.2} s", v.delay_s)),
            row("best correlation with the gas", &|v| format!("{:.2}", v.correlation)),
            row("friction heat in the reading, over the gas in it", &|v| {
                format!("{:.1}", v.friction_to_gas)
            }),
            row("rise over the run", &|v| format!("{:.2} K", v.rise_k)),
            vec![
                "RMS error as a gas temperature".to_owned(),
                format!("{:.2} K", summary.rmse_k.sensor_gas),
                format!("{:.2} K", findings.averaging_rmse_k[0]),
                format!("{:.2} K", summary.rmse_k.sensor_wall),
            ],
            vec![
                "the estimate that reads it".to_owned(),
                format!("{:.2} K", summary.rmse_k.estimate),
                format!("{:.2} K", findings.averaging_rmse_k[1]),
                "takes none".to_owned(),
            ],
        ],
    )
}

fn cycle(findings: &Findings) -> Section {
    let signals = &findings.signals;
    let stroke = signals.last_stroke(findings.period_s);
    let (volume, pressure) = plane(signals, &stroke);
    let mut loops = Panel::new(Axis::new("Pressure", "kPa")).height(300.0).plane(
        "plant",
        Colour::Ink,
        &volume,
        &pressure,
    );
    let colours = [Colour::Vermillion, Colour::Green, Colour::Blue];
    let time: Vec<f64> = signals.time_s[stroke.clone()].to_vec();
    let mut bounds = Panel::new(kelvin("Gas temperature")).height(300.0).wide(
        "plant",
        Colour::Ink,
        &time,
        &signals.gas_k[stroke.clone()],
    );
    for (variant, colour) in findings.bounds.iter().zip(colours) {
        let (volume, pressure) = plane(&variant.signals, &stroke);
        loops = loops.plane(variant.name, colour, &volume, &pressure);
        bounds = bounds.line(variant.name, colour, &time, &variant.signals.gas_k[stroke.clone()]);
    }
    let between = share_between(findings, &stroke);
    Section::new("The cycle between its bounds")
        .figures(vec![
            Chart::new(Axis::new("Volume", "ml")).half().panel(loops).figure(
                "P-V loop",
                "The last stroke: absolute pressure over gas volume. The loop runs clockwise; its area is the \
                 work that a stroke leaves in friction and load.",
            ),
            Chart::new(time_axis()).half().panel(bounds).figure(
                "Gas temperature",
                "The last stroke, and the same muscle with an adiabatic wall, with the scenario's \
                 coefficient (both one zone) and with gas that keeps its temperature.",
            ),
        ])
        .paragraph(&format!(
            "What the paper shows: it assumes, after Al-Ibrahim and Otis, that the gas lies “between the \
             theoretical adiabatic and isothermal curves”, close to the adiabatic one only while charging. \
             What this shows: the plant's gas lies between the two for {:.0} % of the stroke. Where they differ: \
             the bounds are no hard ones for a cycle, because the adiabatic muscle remembers: it has no \
             wall to forget the strokes before.",
            between * 100.0
        ))
}

fn equations(findings: &Findings) -> Section {
    let signals = &findings.signals;
    let stroke = signals.last_stroke(findings.period_s);
    let time: Vec<f64> = signals.time_s[stroke.clone()].to_vec();
    let kpa = |signals: &Signals| -> Vec<f64> {
        signals.pressure_pa[stroke.clone()].iter().map(|p| p / PASCAL_PER_KPA).collect()
    };
    let mut pressure = Panel::new(Axis::new("Pressure", "kPa")).height(220.0).wide(
        "plant",
        Colour::Ink,
        &time,
        &kpa(signals),
    );
    let mut temperature = Panel::new(kelvin("Gas temperature")).height(240.0).wide(
        "plant",
        Colour::Ink,
        &time,
        &signals.gas_k[stroke.clone()],
    );
    let full_balance = findings.bounds.iter().find(|v| v.name == "constant coefficient");
    let colours = [Colour::Vermillion, Colour::Green, Colour::Blue, Colour::Purple];
    let mut rows = Vec::new();
    for (variant, colour) in findings.reduced.iter().chain(full_balance).zip(colours) {
        let name =
            if variant.name == "constant coefficient" { "full balance (3)" } else { variant.name };
        pressure = pressure.line(name, colour, &time, &kpa(&variant.signals));
        temperature = temperature.line(name, colour, &time, &variant.signals.gas_k[stroke.clone()]);
        rows.push(distance_row(findings, name, variant));
    }
    let section = Section::new("The paper's equations (6), (8), (9) and the full balance (3)");
    coefficients(findings, section)
        .figure(Chart::new(time_axis()).panel(pressure).panel(temperature).figure(
            "The reduced equations side by side",
            "The last stroke of the plant, of the paper's reduced equations with eq. (12) for the volume, and of the \
             full energy balance with heat to the wall and the inflow's own temperature. All are driven by \
             the same core.",
        ))
        .table(Table::new(
            "Distance from the plant over the last stroke",
            &["", "gas temperature, RMS", "gas temperature, swing", "largest pressure"],
            rows,
        ))
        .paragraph(
            "What the paper shows: eq. (9) bridges the adiabatic (6) and the isothermal form (8) with three \
             coefficients. What this shows: eq. (8) cannot move the temperature at all, and (6) moves it far too \
             much, because no heat leaves and the inflow is taken to arrive as hot as the gas is (eq. 5): its \
             temperature follows (m/V)^(k-1). The real heat of charging, cp T_in against cv T, is in neither. Where they differ: the blend (9) can be \
             made to fit a pressure trace, but not the temperature; with different coefficients for charging and \
             discharging a closed cycle drifts. The full balance (3) needs no such coefficients, and it is what the \
             core runs on.",
        )
}

/// The paper's only parameters, apart from those of the plant.
fn coefficients(findings: &Findings, section: Section) -> Section {
    let Some(alphas) = &findings.alphas else {
        return section.paragraph("The coefficients of eq. (9) do not follow from this run.");
    };
    let paper = [
        ("charging, α_in", "1 to k; its reference [1]: close to k = 1.4"),
        ("discharging, α_out", "1 to k; its reference [1]: close to 1"),
        ("change of volume, α", "1 to k; its reference [1]: 1.2"),
    ];
    let rows = paper.iter().zip(alphas).map(|((name, paper), found)| {
        let (value, error) = (found.value, found.standard_error);
        vec![(*name).to_owned(), (*paper).to_owned(), format!("{value:.3} ± {error:.3}")]
    });
    section.table(Table::new(
        "Coefficients of eq. (9), fitted to this plant's pressure, stroke by stroke",
        &["", "the paper", "fitted to the plant"],
        rows,
    ))
}

/// Quantities that the paper's text lacks.
fn not_in_the_paper() -> Section {
    Section::new("Not to be had from the paper").paragraph(
        "Its text prints no length, diameter, thread or number of turns of the muscle (b and n of eq. (10)), no load, \
         no mass flow, no insulation, no lag of the foil and no coefficients α of eq. (9) beyond their \
         range; Fig. 2 and 5 are pictures without numbers, but for their scales and what the text says of them. \
         They are chosen here and stated in the scenario below. What is checked is therefore order, sign \
         and shape, not height.",
    )
}

fn energy(findings: &Findings) -> Section {
    let books = &findings.stroke;
    let stored = books.energy_j - books.energy_initial_j;
    let heat_j = books.heat_to_wall_j;
    // Named by its direction, which depends on the muscle's friction.
    let [of_gas, of_wall] = if heat_j > 0.0 {
        ["heat to the wall", "heat from the gas"]
    } else {
        ["heat from the wall", "heat to the gas"]
    };
    let bars = Bars::linear("Energy over the last stroke", "J")
        .bar("enthalpy, in less out", books.enthalpy_in_j - books.enthalpy_out_j, Colour::Blue)
        .bar("work on the muscle", -books.work_j, Colour::Green)
        .bar(of_gas, -heat_j, Colour::Vermillion)
        .bar("stored in the gas", -stored, Colour::Grey);
    let wall = Bars::linear("The wall's balance over the last stroke", "J")
        .bar(of_wall, heat_j, Colour::Vermillion)
        .bar("friction heat into the wall", books.friction_to_wall_j, Colour::Orange)
        .bar("heat to ambient", -books.heat_to_ambient_j, Colour::Sky)
        .bar("stored in the wall", -books.wall_energy_j, Colour::Grey);
    let gas_rest =
        books.enthalpy_in_j - books.enthalpy_out_j - books.work_j - books.heat_to_wall_j - stored;
    Section::new("Where the heat goes")
        .figure(bars.figure(
            "The gas over one stroke",
            &format!(
                "Energy that enters the gas is positive. {:.1} J of enthalpy came in with the air and {:.1} J left with it. The \
                 rows add up to {:.0e} J: nothing is lost.",
                books.enthalpy_in_j, books.enthalpy_out_j, gas_rest.abs()
            ),
        ))
        .figure(wall.figure(
            "The wall over one stroke",
            "Energy that enters the wall is positive.",
        ))
        .paragraph(&format!(
            "What the paper shows: no balance, but it states that friction heats the rubber and that moving air \
             cools it. What this shows: of {:.2} J of friction heat per stroke {:.2} J go into the wall, the gas \
             {} {:.2} J, {:.2} J leave to ambient and {:.2} J stay and warm it.",
            books.friction_heat_j,
            books.friction_to_wall_j,
            if books.heat_to_wall_j > 0.0 { "adds" } else { "takes" },
            books.heat_to_wall_j.abs(),
            books.heat_to_ambient_j,
            books.wall_energy_j
        ))
}

fn estimate(findings: &Findings, summary: &Summary) -> Section {
    let signals = &findings.signals;
    let end_s = signals.time_s.last().copied().unwrap_or(0.0);
    let from_s = end_s - DETAIL_STROKES * findings.period_s;
    let estimates = signals.estimate_k.iter().zip(&signals.estimate_sd_k);
    let (low, high): (Vec<f64>, Vec<f64>) =
        estimates.map(|(t, sd)| (t - 2.0 * sd, t + 2.0 * sd)).unzip();
    let panel = Panel::new(kelvin("Gas temperature"))
        .height(280.0)
        .band("± 2 standard deviations", Colour::Estimate, &signals.time_s, &low, &high)
        .wide("gas (plant, mean)", Colour::Truth, &signals.time_s, &signals.gas_k)
        .line("estimate (core)", Colour::Estimate, &signals.time_s, &signals.estimate_k)
        .dashed("foil, read bare", Colour::Sensor, &signals.time_s, &signals.sensor_gas_k);
    Section::new("Beyond the paper: the estimate")
        .figure(Chart::new(time_axis().range(from_s, end_s)).panel(panel).figure(
            "The gas temperature, in real time",
            "The last strokes. The core sees raw codes of pressure, length and the foil, and the duties that it \
             commanded; nothing else.",
        ))
        .figure(
            Bars::log("RMS error of the gas temperature", "K")
                .bar("sensor in the wall", summary.rmse_k.sensor_wall, Colour::WallSensor)
                .bar("foil, read bare", summary.rmse_k.sensor_gas, Colour::Sensor)
                .bar("forward model", summary.rmse_k.model, Colour::Green)
                .bar("estimate", summary.rmse_k.estimate, Colour::Estimate)
                .figure("Four ways to know it", "Over the whole run, against the plant's mean."),
        )
        .paragraph(&format!(
            "The estimate is wrong by {:.2} K where the foil is wrong by {:.2} K. Pressure and length drive the \
             energy balance, fast; the foil corrects what drifts, slowly. Both are the paper's own \
             measurements.",
            summary.rmse_k.estimate, summary.rmse_k.sensor_gas
        ))
}

fn checks(findings: &Findings) -> Section {
    let rows = findings.checks.iter().map(|check| {
        vec![
            check.what.to_owned(),
            check.figure.clone(),
            check.target.to_owned(),
            if check.holds { "✓" } else { "✗" }.to_owned(),
        ]
    });
    let columns = ["statement", "figure", "target", ""];
    Section::new("Every statement, checked").table(Table::new("", &columns, rows))
}

/// Volume \[ml\] and pressure \[kPa\] over some rows.
fn plane(signals: &Signals, rows: &std::ops::Range<usize>) -> (Vec<f64>, Vec<f64>) {
    (
        signals.volume_m3[rows.clone()].iter().map(|v| v * ML_PER_M3).collect(),
        signals.pressure_pa[rows.clone()].iter().map(|p| p / PASCAL_PER_KPA).collect(),
    )
}

/// Fraction of some rows in which the plant's gas temperature lies between isothermal and
/// adiabatic.
fn share_between(findings: &Findings, rows: &std::ops::Range<usize>) -> f64 {
    let find = |name: &str| findings.bounds.iter().find(|variant| variant.name == name);
    let (Some(adiabatic), Some(isothermal)) = (find("adiabatic wall"), find("isothermal gas"))
    else {
        return f64::NAN;
    };
    let inside = rows
        .clone()
        .filter(|row| {
            let (a, b) = (adiabatic.signals.gas_k[*row], isothermal.signals.gas_k[*row]);
            let gas = findings.signals.gas_k[*row];
            gas >= a.min(b) && gas <= a.max(b)
        })
        .count();
    inside as f64 / rows.len() as f64
}

fn distance_row(findings: &Findings, name: &str, variant: &Variant) -> Vec<String> {
    let gas = &variant.summary.gas_temperature_k;
    vec![
        name.to_owned(),
        format!("{:.2} K", findings.distance_k(variant)),
        format!("{:.1} K", gas.max - gas.min),
        format!("{:.0} kPa", variant.summary.pressure_pa.max / PASCAL_PER_KPA),
    ]
}
