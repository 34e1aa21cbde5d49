//! `thermyo measure stop`: the gas temperature of a muscle from stops, on any board.
//!
//! ```text
//! pressure /\/\/\----/\/\/\/\-----   both valves shut at random phases of the cycle, and a wait
//! record --stops--> T at each stop, heat transfer, lags --> trace, summary, page
//! ```
//!
//! The physics is in [`thermyo_fit::stops`].

mod plan;
mod record;

pub use plan::{Asked, Plan, Refusal};
pub use record::{LiveRows, Record, RowBench, SimulatedRows};

use serde::Serialize;
use thermyo_files::input::InputError;
use thermyo_files::number::{MISSING, fixed};
use thermyo_files::output::OutputDir;
use thermyo_files::units::UnitSystem;
use thermyo_fit::stops::{Analysis, FEWEST, Stop, analyse_with, page, refusals};
use thermyo_setup::Loaded;

/// Time after a stop for which the record contains the measured temperature as a reference \[s\]:
/// while the gas is far from its wall.
const REFERENCE_S: f64 = 2.0;

/// Content of `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Findings {
    pub duration_s: f64,
    /// Place of the measurement: a port, or "simulated".
    pub board: String,
    pub seed: u64,
    pub period_s: f64,
    /// Lowest and highest set point \[Pa\].
    pub pressures_pa: [f64; 2],
    /// Number of planned stops, and of those that count.
    pub planned: usize,
    pub usable: usize,
    /// Root mean square over the stops that count \[K\].
    pub rms_k: Differences,
    /// Fraction of these stops at which the estimate is within two standard deviations, its own and
    /// the measurement's combined \[-\].
    pub within_2sd: Option<f64>,
    pub remarks: Vec<String>,
    #[serde(flatten)]
    pub analysis: Analysis,
}

/// Root-mean-square differences to the measured gas temperature \[K\].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Differences {
    pub estimate: Option<f64>,
    pub sensor_gas: Option<f64>,
    /// The plant's own temperature, if it was simulated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plant: Option<f64>,
    /// Stated standard deviation of the measurement.
    pub stated: Option<f64>,
}

/// Analyses a record; `loaded` is the board's configuration.
pub fn measured(record: &Record, plan: &Plan, loaded: &Loaded, board: &str) -> Findings {
    let analysis = analyse_with(loaded, &record.rows);
    let counted: Vec<&Stop> = analysis.usable().collect();
    let inside = counted.iter().filter_map(|stop| {
        let sd_k = stop.estimate_sd_k?.hypot(stop.gas_sd_k);
        Some(stop.estimate_error_k()?.abs() <= 2.0 * sd_k)
    });
    let inside: Vec<bool> = inside.collect();
    let share = inside.iter().filter(|inside| **inside).count() as f64 / inside.len() as f64;
    Findings {
        duration_s: record.rows.rows.last().map_or(0.0, |row| row.time_s),
        board: board.to_owned(),
        seed: plan.seed,
        period_s: plan.period_s,
        pressures_pa: plan.pressures_pa,
        planned: plan.stops,
        usable: counted.len(),
        rms_k: Differences {
            estimate: analysis.rms_k(Stop::estimate_error_k),
            sensor_gas: analysis.rms_k(|stop| Some(stop.sensor_k - stop.gas_k)),
            plant: analysis.rms_k(|stop| Some(stop.truth_k? - stop.gas_k)),
            stated: analysis.rms_k(|stop| Some(stop.gas_sd_k)),
        },
        within_2sd: (!inside.is_empty()).then_some(share),
        remarks: refusals(&analysis).collect(),
        analysis,
    }
}

/// Writes the results into a folder; `title` is the page's.
pub fn write(
    files: &mut OutputDir,
    findings: &Findings,
    record: &Record,
    loaded: &Loaded,
    title: &str,
) -> Result<(), InputError> {
    let trace = files.file("trace.csv")?;
    record
        .write(trace, &findings.analysis.stops)
        .map_err(|error| files.unwritable("trace.csv", &error))?;
    files.scenario(&thermyo_setup::recorded(loaded))?;
    files.text("summary.json", &findings.json())?;
    files.text("report.html", &findings.page(title, record, loaded))
}

impl Findings {
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).expect("plain data") + "\n"
    }

    /// Reason why nothing was measured, if there is one.
    pub fn failed(&self) -> Option<String> {
        (self.usable < FEWEST).then(|| {
            let reason = self.remarks.first().map_or_else(String::new, |why| format!(": {why}"));
            format!(
                "only {} of {} stops can be used, at least {FEWEST} are needed{reason}",
                self.usable, self.planned
            )
        })
    }

    /// Head of the table of the stops.
    pub const HEAD: [&str; 4] = ["Stop", "Gas", "Estimate", "Sensor"];

    /// The stops that count, in the rows of a table. Temperatures are in K, as on the page.
    pub fn rows(&self) -> Vec<Vec<String>> {
        rows(&self.analysis.stops)
    }

    /// Stops and figures as lines for a terminal.
    pub fn text(&self, units: UnitSystem) -> String {
        lines(&self.analysis.stops, units) + &self.figures()
    }

    /// The figures of all stops together, as lines.
    pub fn figures(&self) -> String {
        let rms = |name: &str, value: Option<f64>| {
            value.map_or_else(String::new, |k| format!("{name}: {} K RMS\n", fixed(k, 2)))
        };
        let mut text = rms("estimate less measured", self.rms_k.estimate);
        text += &rms("bare sensor less measured", self.rms_k.sensor_gas);
        text += &rms("simulated plant less measured", self.rms_k.plant);
        text += &rms("stated deviation of the measurement", self.rms_k.stated);
        text += &self.heat_and_sensor();
        self.remarks.iter().fold(text, |text, remark| text + remark + "\n")
    }

    fn heat_and_sensor(&self) -> String {
        let mut text = String::new();
        if let Some(heat) = &self.analysis.heat {
            let still = heat.still_w_m2_k;
            text += &format!(
                "heat transfer: {:.1} ± {:.1} W/(m2 K) in still gas",
                still.value, still.standard_error
            );
            if let (Some(stirred), Some(decay_s)) = (heat.stirred_w_m2_k, heat.decay_s) {
                text += &format!(
                    ", {:.0} ± {:.0} more when a jet ends, which decays within {:.2} s",
                    stirred.value, stirred.standard_error, decay_s.value
                );
            }
            text += "\n";
        }
        if let Some(sensor) = &self.analysis.sensor {
            text += &format!(
                "sensor: lag {:.2} s ± {:.0} %, housing and still gas around it {:.2} s ± {:.0} %, sees {:.2} ± {:.2} \
                 of the mean's swing\n",
                sensor.lag_s,
                100.0 * sensor.lag_sd,
                sensor.housing_s,
                100.0 * sensor.housing_sd,
                sensor.location_factor,
                sensor.location_factor * sensor.location_sd
            );
        }
        text
    }

    /// Content of `report.html`.
    pub fn page(&self, title: &str, record: &Record, loaded: &Loaded) -> String {
        let lead = self.failed().unwrap_or_else(|| {
            format!(
                "{} stops with both valves shut, board: {}. The gas temperature without a wire in the gas.",
                self.usable, self.board
            )
        });
        let page = page::begun(title, &lead, loaded, &self.analysis);
        page::with_stops(page, &self.analysis, &record.rows, &self.remarks).render()
    }
}

fn rows(stops: &[Stop]) -> Vec<Vec<String>> {
    let row = |(number, stop): (usize, &Stop)| {
        let name = format!("{number}, {:.1} s", stop.time_s);
        [name].into_iter().chain(temperatures(stop, UnitSystem::Si)).collect()
    };
    counted(stops).map(row).collect()
}

fn lines(stops: &[Stop], units: UnitSystem) -> String {
    let line = |(number, stop): (usize, &Stop)| {
        let [gas, estimate, sensor] = temperatures(stop, units);
        let plant = stop.truth_k.map(|k| format!("  plant {}", units.text(k, "K", 2)));
        format!(
            "stop {number:2} at {:7.2} s: gas {gas}  estimate {estimate}  sensor {sensor}{}\n",
            stop.time_s,
            plant.unwrap_or_default(),
        )
    };
    counted(stops).map(line).collect()
}

/// The stops that count, with their numbers among all from 1.
fn counted(stops: &[Stop]) -> impl Iterator<Item = (usize, &Stop)> {
    (1..).zip(stops).filter(|(_, stop)| stop.usable())
}

/// Gas, estimate and sensor at a stop, with the deviations that they state.
fn temperatures(stop: &Stop, units: UnitSystem) -> [String; 3] {
    let with_sd = |k: f64, sd_k: f64| format!("{} ± {sd_k:.2} K", units.text(k, "K", 2));
    let estimate = stop.estimate_k.zip(stop.estimate_sd_k);
    [
        with_sd(stop.gas_k, stop.gas_sd_k),
        estimate.map_or_else(|| MISSING.to_owned(), |(k, sd_k)| with_sd(k, sd_k)),
        units.text(stop.sensor_k, "K", 2),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stop(time_s: f64, estimate_k: Option<f64>, refused: Option<String>) -> Stop {
        Stop {
            time_s,
            wait_s: 30.0,
            gas_k: 312.27,
            gas_sd_k: 0.34,
            causes: Default::default(),
            estimate_k,
            estimate_sd_k: Some(1.3),
            sensor_k: 300.43,
            truth_k: None,
            end_k: 298.0,
            pressure_pa: 4e5,
            mass_kg: 1e-3,
            leak_1_s: 0.0,
            refused,
            rows: 0..0,
            curve_k: Vec::new(),
        }
    }

    /// The live page had a line of text for each stop, of which most were out of sight.
    #[test]
    fn a_stop_that_counts_is_a_row() {
        let stops = [
            stop(31.26, Some(312.56), None),
            stop(78.4, None, Some("it moves".to_owned())),
            stop(124.6, None, None),
        ];
        assert_eq!(
            rows(&stops),
            [
                ["1, 31.3 s", "312.27 K ± 0.34 K", "312.56 K ± 1.30 K", "300.43 K"],
                ["3, 124.6 s", "312.27 K ± 0.34 K", MISSING, "300.43 K"],
            ]
        );
        // The terminal used to leave out a stop without an estimate.
        assert_eq!(
            lines(&stops, UnitSystem::Practical),
            "stop  1 at   31.26 s: gas 39.12 degC ± 0.34 K  estimate 39.41 degC ± 1.30 K  sensor 27.28 degC\n\
             stop  3 at  124.60 s: gas 39.12 degC ± 0.34 K  estimate –  sensor 27.28 degC\n"
        );
    }
}
