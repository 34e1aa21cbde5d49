//! Page of a run on a board.

use super::summary::{Driven, board_at, driven};
use model_core::SetPoint;
use thermyo_files::number::COUNT;
use thermyo_plant::chamber;
use thermyo_record::trace::{COLUMNS, Row};
use thermyo_record::tracking::Controlled;
use thermyo_report::page::Tile;
use thermyo_report::series::Recorder;
use thermyo_runs::Faulted;
use thermyo_runs::run_report;
use thermyo_runs::run_report::{RunReport, SummaryRow};
use thermyo_setup::Loaded;

/// Records the page's data, in bounded memory.
pub struct Drawn {
    series: Recorder,
    /// Indices of the columns that a board can fill.
    known: Vec<usize>,
    /// Controlled quantity of the set points, if it was the same in all steps.
    controlled: Option<Controlled>,
    mixed: bool,
}

impl Default for Drawn {
    fn default() -> Self {
        let unknown = [
            "volume_m3",
            "flow_in_kg_s",
            "flow_out_kg_s",
            "gas_temperature_k",
            "wall_temperature_k",
            "sensor_wall_k",
            "model_k",
            "model_sensor_k",
        ];
        let known: Vec<usize> =
            (0..COLUMNS.len()).filter(|&i| !unknown.contains(&COLUMNS[i])).collect();
        let names: Vec<&str> = known.iter().map(|&i| COLUMNS[i]).collect();
        Self { series: Recorder::new(&names), known, controlled: None, mixed: false }
    }
}

impl Drawn {
    pub fn add(&mut self, row: &Row) {
        let controlled = match row.telemetry.set_point {
            SetPoint::Pressure { .. } => Some(Controlled::Pressure),
            SetPoint::Contraction { .. } => Some(Controlled::Contraction),
            _ => None,
        };
        self.mixed |=
            controlled.is_some() && self.controlled.is_some_and(|of| Some(of) != controlled);
        self.controlled = self.controlled.or(controlled);
        // Only the set point of a closed loop is drawn.
        let set_point = if controlled.is_some() { row.set_point } else { f64::NAN };
        let cells = Row { set_point, ..*row }.cells();
        let known: Vec<f64> = self.known.iter().map(|&i| cells[i]).collect();
        self.series.push(&known);
    }
}

pub fn page(title: &str, scenario: &Loaded, drawn: &Drawn, summary: &Driven) -> String {
    let faulted = Faulted(&summary.core);
    let stopped = if summary.stopped_of_s.is_some() { "Stopped by Ctrl-C: " } else { "" };
    let mut lead = stopped.to_owned() + &faulted.lead();
    if let Some(control) = &summary.control {
        lead += &faulted.control(control);
    }
    lead += &format!(
        "{} on {}, configuration {} ({:08x}).",
        driven(summary.duration_s, summary.stopped_of_s),
        board_at(&summary.board),
        summary.config_name,
        summary.config_checksum
    );
    let control = summary.control.iter().map(|control| faulted.tracking(control));
    let own = [
        Tile::new("Largest pressure", summary.pressure_pa.max, "Pa"),
        Tile::new("Core step, mean", summary.timing.step_mean_us, "µs"),
        Tile::new("Core step, worst", summary.timing.step_worst_us, "µs"),
        Tile::new("Missed steps", f64::from(summary.timing.missed_steps), ""),
    ];
    let row = |label: &str, value: f64, unit: &str| SummaryRow {
        label: label.to_owned(),
        value,
        unit: unit.to_owned(),
    };
    let mut rows = vec![row("Time driven", summary.duration_s, "s")];
    rows.extend(faulted.rows());
    if summary.strokes > 0 {
        rows.push(row("Strokes", summary.strokes as f64, COUNT));
    }
    rows.extend([
        row("Pressure, lowest", summary.pressure_pa.min, "Pa"),
        row("Pressure, highest", summary.pressure_pa.max, "Pa"),
        row("Estimated gas temperature, lowest", summary.estimate_k.min, "K"),
        row("Estimated gas temperature, highest", summary.estimate_k.max, "K"),
        row("Steps of the core", summary.core.steps as f64, COUNT),
        row("Steps whose telemetry was lost", summary.lost_steps as f64, COUNT),
        row("Start jitter, worst", summary.timing.jitter_worst_us, "µs"),
    ]);
    run_report::render(&RunReport {
        title,
        lead: &lead,
        warnings: &[],
        controlled: drawn.controlled.filter(|_| !drawn.mixed),
        scenario_toml: &thermyo_setup::render(scenario),
        tiles: faulted.tiles().chain(control).chain(own).collect(),
        series: &drawn.series,
        // A board does not measure flows.
        drives_flow: false,
        measured: &[],
        summary: &rows,
        axial_wall_k: &[],
        rest_length_m: chamber::of(&scenario.plant).map(|chamber| chamber.rest_length()),
        kind: scenario.plant.plant.kind,
        last_stroke: &[],
        detail_s: None,
    })
}

#[cfg(test)]
mod tests {
    use crate::drive::{Gathered, Record};
    use thermyo_protocol::{Status, Timing};
    use thermyo_record::board_trace;
    use thermyo_setup::core_config::core_config;
    use thermyo_simulation::run;

    #[test]
    fn the_page_begins_with_the_tracking_error() {
        let text =
            "[run]\nduration_s = 1.0\n[plant]\nmodel = \"lumped\"\n[drive]\nkind = \"pressure\"\n";
        let loaded = thermyo_setup::parse(text, "test".as_ref()).unwrap();
        let config = core_config(&loaded.believed);
        let mut gathered = Gathered::new(loaded.clone(), None);
        run::on_core(&loaded, |row| {
            // A board sends only telemetry.
            let row = board_trace::row(row.truth.time_s, &config, &row.telemetry);
            gathered.add(&row);
        })
        .unwrap();
        let of = ("here", &Status::AT_START, &Timing::default());
        let (_, page) = gathered.finish("steps", of, None);
        let (_, lead) = page.split_once("class=\"lead\">").unwrap();
        assert!(lead.starts_with("The absolute pressure follows its set point with an error of "));
        let (_, tiles) = page.split_once("class=\"tiles\"").unwrap();
        let place = |label: &str| tiles.find(label).unwrap();
        assert!(place("Tracking error, RMS") < place("Largest pressure"));
        let (sections, _) = page.split_once("<footer").unwrap();
        assert!(sections.contains("The set point and the sensor's reading."));
        assert!(!sections.contains("in the plant") && !sections.contains("Mass flow"));
    }
}
