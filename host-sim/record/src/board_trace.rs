//! `trace.csv` of a real board: the columns of every trace, empty if only a plant has a value, followed by the core's
//! configuration.

use crate::sinks::Sinks;
use crate::trace::{COLUMNS, Row, cells_text};
use model_core::{Config, SetPoint, Telemetry};
use std::fs::File;
use std::io::{self, Write};
use thermyo_files::rows::Rows;
use thermyo_plant::Truth;
use thermyo_protocol::Status;
use thermyo_scenario::short;

/// Columns after those of every trace. The set point's kind is its index in [`kind_and_values`].
pub const MORE_COLUMNS: [&str; 7] = [
    "set_point_kind",
    "set_point_value",
    "set_point_second",
    "armed_pa",
    "restarts",
    "starts",
    "config_checksum",
];

/// All columns of a run's or a board's record.
pub fn every_column() -> Vec<&'static str> {
    [&COLUMNS[..], &MORE_COLUMNS].concat()
}

pub fn kind_and_values(set_point: SetPoint) -> (u8, f32, f32) {
    match set_point {
        SetPoint::Vent => (0, 0.0, 0.0),
        SetPoint::Duty { inlet, outlet } => (1, inlet, outlet),
        SetPoint::MassFlow { flow_kg_s } => (2, flow_kg_s, 0.0),
        SetPoint::MassFlowCycle { flow_kg_s, period_s } => (3, flow_kg_s, period_s),
        SetPoint::Pressure { pressure_pa } => (4, pressure_pa, 0.0),
        SetPoint::Contraction { contraction } => (5, contraction, 0.0),
    }
}

/// The last kind of [`kind_and_values`].
pub const LAST_KIND: u8 = 5;

pub fn set_point(kind: u8, value: f32, second: f32) -> SetPoint {
    match kind {
        1 => SetPoint::Duty { inlet: value, outlet: second },
        2 => SetPoint::MassFlow { flow_kg_s: value },
        3 => SetPoint::MassFlowCycle { flow_kg_s: value, period_s: second },
        4 => SetPoint::Pressure { pressure_pa: value },
        5 => SetPoint::Contraction { contraction: value },
        _ => SetPoint::Vent,
    }
}

/// The row of a board's telemetry; unknown cells are NaN.
pub fn row(time_s: f64, config: &Config, telemetry: &Telemetry) -> Row {
    let unknown = f64::NAN;
    Row {
        truth: Truth {
            time_s,
            pressure_pa: f64::from(telemetry.pressure_pa),
            length_m: f64::from(telemetry.length_m),
            mass_kg: f64::from(telemetry.estimate.mass_kg),
            volume_m3: unknown,
            flow_in_kg_s: unknown,
            flow_out_kg_s: unknown,
            gas_temperature_k: unknown,
            wall_temperature_k: unknown,
            ..Truth::default()
        },
        sensor_gas_k: f64::from(config.sensing().gas_k(telemetry.sample.gas)),
        sensor_wall_k: unknown,
        model_k: unknown,
        model_sensor_k: unknown,
        set_point: f64::from(kind_and_values(telemetry.set_point).1),
        telemetry: *telemetry,
    }
}

/// Cells of [`MORE_COLUMNS`]; an empty `status` leaves its columns empty.
pub fn more_cells(status: Option<&Status>, telemetry: &Telemetry) -> [f64; MORE_COLUMNS.len()] {
    let (kind, value, second) = kind_and_values(telemetry.set_point);
    let [armed_pa, restarts, starts, config_checksum] = status_cells(status);
    let [kind, value, second] = [f64::from(kind), f64::from(value), f64::from(second)];
    [kind, value, second, armed_pa, restarts, starts, config_checksum]
}

/// Highest armed pressure, restarts, starts and the configuration's checksum; unknown without a status.
pub fn status_cells(status: Option<&Status>) -> [f64; 4] {
    let stated = |value: fn(&Status) -> f64| status.map_or(f64::NAN, value);
    [
        stated(|status| f64::from(status.armed_pa.unwrap_or_default())),
        stated(|status| f64::from(status.restarts)),
        stated(|status| f64::from(status.starts)),
        stated(|status| f64::from(status.config_checksum)),
    ]
}

/// Largest number of missing steps while their count wraps at 2^32: three days at 1 kHz.
const MOST_MISSING: u32 = 1 << 28;

/// Computes time from step counts that start over when the board restarts.
#[derive(Debug, Default)]
struct Clock {
    /// The last step, and its length \[s\].
    last: Option<(u32, f64)>,
    /// Time at which steps of this length began \[s\].
    since_s: f64,
    steps: u64,
}

impl Clock {
    /// Time since the first step \[s\], strictly increasing.
    fn time_s(&mut self, step: u32, step_s: f64) -> f64 {
        if let Some((last, last_s)) = self.last {
            if last_s != step_s {
                self.since_s += self.steps as f64 * last_s;
                self.steps = 0;
            }
            self.steps += steps_between(last, step);
        }
        self.last = Some((step, step_s));
        self.since_s + self.steps as f64 * step_s
    }
}

/// Progress of a board. The duration of a restart is unknown and counts as one step.
fn steps_between(last: u32, step: u32) -> u64 {
    let steps = step.wrapping_sub(last);
    let restarted = step < last && steps > MOST_MISSING;
    if restarted || steps == 0 { 1 } else { u64::from(steps) }
}

/// Writes telemetry as rows.
pub struct Recorder<W: Write = File> {
    out: Rows<W>,
    beside: Sinks,
    clock: Clock,
    rows: u64,
}

impl<W: Write> Recorder<W> {
    /// Writes a muscle's record to `out`.
    pub fn new(out: W) -> io::Result<Self> {
        Self::with_columns(out, &every_column())
    }

    /// Writes rows of these columns to `out`.
    pub fn with_columns(out: W, columns: &[&str]) -> io::Result<Self> {
        let out = Rows::new(out, &columns.join(","))?;
        Ok(Self { out, beside: Sinks::default(), clock: Clock::default(), rows: 0 })
    }

    #[must_use]
    pub fn beside(self, beside: Sinks) -> Self {
        Self { beside, ..self }
    }

    /// Time since the first step \[s\], strictly increasing, of a step with its number and length \[s\].
    pub fn time_s(&mut self, step: u32, step_s: f64) -> f64 {
        self.clock.time_s(step, step_s)
    }

    pub fn push(&mut self, cells: &[f64]) -> io::Result<()> {
        self.rows += 1;
        self.out.push(&cells_text(cells.iter().copied()))?;
        self.beside.row(cells)
    }

    /// Writes one row of a muscle; an empty `status` leaves its columns empty.
    pub fn write(
        &mut self,
        config: &Config,
        status: Option<&Status>,
        telemetry: &Telemetry,
    ) -> io::Result<Row> {
        let time_s = self.time_s(telemetry.step, short(config.step_s));
        let row = row(time_s, config, telemetry);
        let more = more_cells(status, telemetry);
        let cells: Vec<f64> = row.cells().into_iter().chain(more).collect();
        self.push(&cells)?;
        Ok(row)
    }

    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Writes rows that have waited long enough.
    pub fn hand_over_in_time(&mut self) -> io::Result<()> {
        self.out.hand_over_in_time()?;
        self.beside.hand_over_in_time()
    }

    /// Flushes all rows.
    pub fn hand_over(&mut self) -> io::Result<()> {
        self.out.hand_over()?;
        self.beside.hand_over()
    }

    /// Flushes all rows and returns `out`.
    pub fn finish(self) -> io::Result<W> {
        let out = self.out.finish()?;
        self.beside.finish()?;
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sinks::Sink;
    use model_core::{AdcCode, Core, Sample};
    use std::sync::{Arc, Mutex};

    #[test]
    fn a_row_has_every_column_and_its_numbers_read_back() {
        let config = Config::default();
        let sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));
        let telemetry = Core::new(&config).unwrap().step(&sample);
        let mut recorder = Recorder::new(Vec::new()).unwrap();
        recorder.write(&config, None, &telemetry).unwrap();
        let text = String::from_utf8(recorder.finish().unwrap()).unwrap();
        let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!(lines.len(), 2);
        assert_eq!(lines[0].len(), lines[1].len());
        let cell = |name| lines[1][lines[0].iter().position(|&column| column == name).unwrap()];
        let value = |name| cell(name).parse::<f32>().unwrap().to_bits();
        assert_eq!(value("estimate_k"), telemetry.estimate.gas_k.to_bits());
        assert_eq!(value("mass_kg"), telemetry.estimate.mass_kg.to_bits());
        assert_eq!(value("sensor_lag_s"), telemetry.estimate.sensor_lag_s.to_bits());
        assert_eq!(cell("code_length"), "23757");
        assert_eq!(cell("gas_temperature_k"), "", "it is unknown on a real board");
        let restarts = lines[0].iter().position(|&column| column == "restarts").unwrap();
        assert_eq!(lines[1][restarts], "", "the board has not reported it");
    }

    #[derive(Clone, Default)]
    struct Beside(Arc<Mutex<Vec<Vec<f64>>>>);

    impl Sink for Beside {
        fn row(&mut self, cells: &[f64]) -> io::Result<()> {
            self.0.lock().unwrap().push(cells.to_vec());
            Ok(())
        }
    }

    #[test]
    fn the_row_of_a_board_goes_beside_the_file_too() {
        let config = Config::default();
        let sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));
        let telemetry = Core::new(&config).unwrap().step(&sample);
        let (beside, mut sinks) = (Beside::default(), Sinks::default());
        sinks.add(beside.clone());
        let mut recorder = Recorder::new(Vec::new()).unwrap().beside(sinks);
        recorder.write(&config, None, &telemetry).unwrap();
        let text = String::from_utf8(recorder.finish().unwrap()).unwrap();
        let rows = beside.0.lock().unwrap();
        assert_eq!(rows.len(), 1);
        assert_eq!(rows[0].len(), every_column().len());
        assert_eq!(text.lines().nth(1), Some(cells_text(rows[0].iter().copied()).as_str()));
    }

    #[test]
    fn a_set_point_reads_back() {
        for asked in [
            SetPoint::Vent,
            SetPoint::Duty { inlet: 0.25, outlet: 0.5 },
            SetPoint::MassFlow { flow_kg_s: -1.0e-4 },
            SetPoint::MassFlowCycle { flow_kg_s: 1.0e-4, period_s: 5.0 },
            SetPoint::Pressure { pressure_pa: 1.3e5 },
            SetPoint::Contraction { contraction: 0.1 },
        ] {
            let (kind, value, second) = kind_and_values(asked);
            assert_eq!(set_point(kind, value, second), asked);
        }
    }

    /// Times of these steps, in milliseconds.
    fn times_ms(steps: &[u32]) -> Vec<u64> {
        let mut clock = Clock::default();
        steps.iter().map(|step| (clock.time_s(*step, 0.001) * 1e3).round() as u64).collect()
    }

    #[test]
    fn time_rises_whatever_the_board_does() {
        for (what, steps, expected) in [
            ("it runs already", &[5000, 5010, 5020][..], &[0, 10, 20][..]),
            ("telemetry is lost", &[0, 10, 3_600_010], &[0, 10, 3_600_010]),
            ("it restarts", &[5000, 5010, 3, 13], &[0, 10, 11, 21]),
            ("it restarts at the same step", &[10, 10, 20], &[0, 1, 11]),
            ("its count overflows", &[u32::MAX - 5, 4, 14], &[0, 10, 20]),
            ("it restarts after a month", &[3_000_000_000, 3_000_000_010, 7], &[0, 10, 11]),
        ] {
            assert_eq!(times_ms(steps), expected, "{what}");
        }
        // The length of a step is known only after some rows.
        let mut clock = Clock::default();
        let times = [(0, 0.001), (10, 0.001), (20, 0.002), (30, 0.002)];
        let times = times.map(|(step, step_s)| (clock.time_s(step, step_s) * 1e3).round() as u64);
        assert_eq!(times, [0, 10, 30, 50]);
    }
}
