//! Page of `thermyo run`: converts summary and recording of a run into a [`RunReport`].

use super::Faulted;
use super::run_report::{
    self, Measured as MeasuredColumn, RunReport, SummaryRow, capitalised, label,
};
use thermyo_files::number::{COUNT, of_column, speed};
use thermyo_files::units::Unit;
use thermyo_plant::chamber;
use thermyo_record::measured::Measured;
use thermyo_record::summary::{Summary, whole_strokes};
use thermyo_record::trace::{COLUMNS, Row};
use thermyo_report::page::Tile;
use thermyo_report::series::{CAPACITY, Recorder};
use thermyo_scenario::{DriveKind, PlantKind};
use thermyo_setup::Loaded;
use thermyo_simulation::run::SetPoints;

/// Strokes in the enlarged temperature chart.
const DETAIL_STROKES: f64 = 3.0;
/// Measured values on the page: all rows of two columns, or a tenth of the rows of twenty.
const MEASURED_CELLS: usize = 2 * CAPACITY;

/// Records the page's data in bounded memory during a run.
#[derive(Debug)]
pub struct RunRecorder {
    recorder: Recorder,
    is_vessel: bool,
    set_points: SetPoints,
    rest_length_m: Option<f64>,
    stroke_from_s: f64,
    last_stroke: Vec<(f64, f64)>,
}

impl RunRecorder {
    pub fn new(loaded: &Loaded) -> Self {
        let is_vessel = loaded.plant.plant.kind == PlantKind::Vessel;
        let mut names: Vec<&str> = COLUMNS.to_vec();
        names.extend(["estimate_error_k", "sensor_gas_error_k", "tracking_error"]);
        if is_vessel {
            // A vessel's length only repeats its volume.
            names.retain(|name| *name != "length_m");
        }
        let drive = &loaded.plant.drive;
        let end_s = loaded.plant.run.duration_s;
        // Only a cycle of mass flows has strokes.
        let cycle = drive.kind == DriveKind::MassFlow && loaded.drive_profile.is_none();
        let strokes = cycle && whole_strokes(end_s, drive.period_s) > 0;
        Self {
            recorder: Recorder::new(&names),
            is_vessel,
            set_points: SetPoints::new(loaded),
            rest_length_m: chamber::of(&loaded.plant).map(|chamber| chamber.rest_length()),
            stroke_from_s: if strokes { end_s - drive.period_s } else { f64::INFINITY },
            last_stroke: Vec::new(),
        }
    }

    pub fn add(&mut self, row: &Row) {
        let truth = &row.truth;
        let mut cells = row.cells().to_vec();
        let error = |value: f64| value - truth.gas_temperature_k;
        cells.extend([error(f64::from(row.telemetry.estimate.gas_k)), error(row.sensor_gas_k)]);
        let controlled = self.set_points.controlled(self.rest_length_m, row);
        cells.push(controlled.map_or(f64::NAN, |value| value - row.set_point));
        if self.is_vessel
            && let Some(length) = COLUMNS.iter().position(|name| *name == "length_m")
        {
            cells.remove(length);
        }
        self.recorder.push(&cells);
        if !self.is_vessel && truth.time_s >= self.stroke_from_s {
            self.last_stroke.push((truth.volume_m3, truth.pressure_pa));
        }
    }

    pub fn page(
        &self,
        title: &str,
        loaded: &Loaded,
        measured: Option<&Measured>,
        summary: &Summary,
    ) -> String {
        let rmse = |name: &str| summary.measured.as_ref().and_then(|all| all.get(name));
        let measured: Vec<MeasuredColumn> = measured
            .iter()
            .flat_map(|measured| &measured.columns)
            .zip(measured.map(thinned).unwrap_or_default())
            .filter_map(|(column, points)| {
                Some(MeasuredColumn {
                    column: column.name.clone(),
                    points,
                    rmse: rmse(&column.name)?.rmse,
                    max: rmse(&column.name)?.max,
                })
            })
            .collect();
        let period_s = loaded.plant.drive.period_s;
        let end_s = summary.duration_s;
        let detail_s = (summary.strokes as f64 > 2.0 * DETAIL_STROKES)
            .then_some((end_s - DETAIL_STROKES * period_s, end_s));
        run_report::render(&RunReport {
            title,
            lead: &lead(summary),
            warnings: &warnings(summary),
            scenario_toml: &thermyo_setup::render(loaded),
            tiles: tiles(summary),
            series: &self.recorder,
            controlled: summary.control.as_ref().map(|control| control.quantity),
            drives_flow: loaded.plant.drive.kind == DriveKind::MassFlow,
            measured: &measured,
            summary: &rows(summary),
            axial_wall_k: &summary.axial_temperature_k,
            rest_length_m: self.rest_length_m,
            kind: loaded.plant.plant.kind,
            last_stroke: &self.last_stroke,
            detail_s,
        })
    }
}

/// Points of every measured column, thinned for the page; columns with the same times keep them.
fn thinned(measured: &Measured) -> Vec<Vec<(f64, f64)>> {
    let columns = &measured.columns;
    let most = (MEASURED_CELLS / columns.len().max(1)).min(CAPACITY) / 4 * 4;
    let names: Vec<&str> =
        ["time_s"].into_iter().chain(columns.iter().map(|column| column.name.as_str())).collect();
    let mut recorder = Recorder::with_capacity(&names, most.max(4));
    let mut next = vec![0; columns.len()];
    loop {
        let heads = columns.iter().zip(&next).map(|(column, at)| column.points.get(*at));
        let Some(time_s) = heads.flatten().map(|point| point.0).reduce(f64::min) else { break };
        let values = columns.iter().zip(&mut next).map(|(column, at)| {
            let point = column.points.get(*at).filter(|point| point.0 == time_s);
            *at += usize::from(point.is_some());
            point.map_or(f64::NAN, |point| point.1)
        });
        let row: Vec<f64> = [time_s].into_iter().chain(values).collect();
        recorder.push(&row);
    }
    let time = recorder.column("time_s").unwrap_or_default();
    let points = |name: &&str| {
        let values = recorder.column(name).unwrap_or_default();
        time.iter().copied().zip(values.iter().copied()).filter(|(_, v)| v.is_finite()).collect()
    };
    names[1..].iter().map(points).collect()
}

/// The first paragraph; the purpose of the run comes first.
fn lead(summary: &Summary) -> String {
    let faulted = Faulted(&summary.core);
    let mut text = faulted.lead();
    if let Some(control) = &summary.control {
        text += &faulted.control(control);
    }
    let measured = summary.measured.iter().flatten();
    let differences: Vec<String> = measured
        .map(|(column, difference)| {
            format!("{} by {} (RMS)", label(column), of_column(difference.rmse, column))
        })
        .collect();
    if !differences.is_empty() {
        text += &format!("The run misses the measurement: {}. ", differences.join(", "));
    }
    text + &format!(
        "{} s simulated at {} times real time, with the core on board \"{}\". Read bare, the sensor in \
         the gas is wrong by {:.2} K (RMS); the core's estimate by {:.2} K.",
        summary.duration_s,
        speed(summary.real_time_factor),
        summary.board,
        summary.rmse_k.sensor_gas,
        summary.rmse_k.estimate
    )
}

fn warnings(summary: &Summary) -> Vec<String> {
    let all = [summary.overconfidence(), summary.unrest()];
    all.into_iter().flatten().map(|text| capitalised(&text) + ".").collect()
}

fn tiles(summary: &Summary) -> Vec<Tile> {
    let faulted = Faulted(&summary.core);
    let control = summary.control.iter().map(|control| faulted.tracking(control));
    let measured = summary.measured.iter().flatten().map(|(column, difference)| {
        let unit = Unit::of_column(column);
        let name = format!("Against the measurement, {}, RMS", label(column));
        Tile::new(&name, difference.rmse * unit.factor, unit.symbol)
    });
    let within = summary.estimate_within_2sd;
    let own = [
        Tile::new("Estimate, RMS error", summary.rmse_k.estimate, "K"),
        Tile::new("Bare sensor, RMS error", summary.rmse_k.sensor_gas, "K"),
        Tile::new("Truth within two stated deviations", 100.0 * within, "%")
            .target("≥ 80 %", within >= Summary::LEAST_WITHIN_2SD),
        Tile::new("Largest pressure", summary.pressure_pa.max, "Pa"),
        Tile::new("Mass balance", summary.mass_balance_error, "")
            .target("≤ 1e-9", summary.mass_balance_error <= 1e-9),
        Tile::new("Energy balance", summary.energy_balance_error, "")
            .target("≤ 1e-6", summary.energy_balance_error <= 1e-6),
    ];
    faulted.tiles().chain(control).chain(measured).chain(own).collect()
}

fn rows(summary: &Summary) -> Vec<SummaryRow> {
    let row = |label: &str, value: f64, unit: &str| SummaryRow {
        label: label.to_owned(),
        value,
        unit: unit.to_owned(),
    };
    let mut rows = vec![row("Simulated time", summary.duration_s, "s")];
    rows.extend(Faulted(&summary.core).rows());
    if summary.strokes > 0 {
        rows.push(row("Strokes", summary.strokes as f64, COUNT));
    }
    rows.extend([
        row("Gas temperature, lowest", summary.gas_temperature_k.min, "K"),
        row("Gas temperature, highest", summary.gas_temperature_k.max, "K"),
        row("Gas temperature, mean", summary.gas_temperature_k.mean, "K"),
        row("RMS error, sensor in the gas", summary.rmse_k.sensor_gas, "K"),
        row("RMS error, sensor in the wall", summary.rmse_k.sensor_wall, "K"),
        row("RMS error, forward model", summary.rmse_k.model, "K"),
        row("RMS error, estimate", summary.rmse_k.estimate, "K"),
        row("Truth within two stated deviations", 100.0 * summary.estimate_within_2sd, "%"),
        row("Mass balance error", summary.mass_balance_error, ""),
        row("Energy balance error", summary.energy_balance_error, ""),
        row("Steps of the core", summary.core.steps as f64, COUNT),
        row("Steps with a sensor at a rail", summary.core.saturations as f64, COUNT),
        row("Steps limited below the pressure limit", summary.core.limited as f64, COUNT),
    ]);
    if let Some(control) = &summary.control {
        let Unit { symbol, factor } = control.quantity.unit();
        let followed = &control.followed;
        rows.push(row("Set point, RMS error", followed.rms_error * factor, symbol));
        let steady = followed.steady_error.map(|error| error * factor);
        rows.extend(steady.map(|error| row("Set point, error at the end", error, symbol)));
        let of_shape = followed.shape_figures().into_iter();
        rows.extend(of_shape.map(|(name, value, unit)| row(name, value, unit)));
        rows.extend(control.pulses_per_s.map(|rate| row("Pulses of both valves", rate, "1/s")));
        rows.push(row("Inlet fully open", 100.0 * control.inlet_open, "%"));
        rows.push(row("Outlet fully open", 100.0 * control.outlet_open, "%"));
    }
    rows
}
