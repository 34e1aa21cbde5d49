//! `trace.csv` of a real board: the columns of every trace, empty where only a plant would know, and
//! behind them what `thermyo replay` needs.

use crate::files::rows::Rows;
use model_core::sensing::Sensing;
use model_core::{Config, Telemetry};
use std::fs::File;
use std::io::{self, Write};

const HEADER: &str = "time_s,pressure_pa,volume_m3,length_m,mass_kg,flow_in_kg_s,flow_out_kg_s,\
gas_temperature_k,wall_temperature_k,sensor_gas_k,sensor_wall_k,estimate_k,estimate_sd_k,duty_in,\
duty_out,step,code_pressure,code_gas,code_length,emergency_stop,wall_estimate_k,\
sensor_estimate_k,heat_scale,sensor_lag_s,faults";

/// Most steps that can be missing where their count begins anew at 2^32: three days at 1 kHz.
const MOST_MISSING: u32 = 1 << 28;

/// Time over steps that begin anew when the board does.
#[derive(Debug, Default)]
struct Clock {
    /// The last step, and its length \[s\].
    last: Option<(u32, f64)>,
    /// When steps of that length began \[s\].
    since_s: f64,
    steps: u64,
}

impl Clock {
    /// Time since the first step \[s\]; each is later than the one before.
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

/// How far a board has come. Nobody knows how long one took that has started anew: that counts as one
/// step.
fn steps_between(last: u32, step: u32) -> u64 {
    let steps = step.wrapping_sub(last);
    let anew = step < last && steps > MOST_MISSING;
    if anew || steps == 0 { 1 } else { u64::from(steps) }
}

/// Writes telemetry as rows.
pub struct Recorder<W: Write = File> {
    out: Rows<W>,
    clock: Clock,
    rows: u64,
}

impl<W: Write> Recorder<W> {
    /// Into anything that takes bytes.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn new(out: W) -> io::Result<Self> {
        Ok(Self { out: Rows::new(out, HEADER)?, clock: Clock::default(), rows: 0 })
    }

    /// One row. `Display` of a float is the shortest text that reads back to the same bits.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write(&mut self, config: &Config, telemetry: &Telemetry) -> io::Result<()> {
        let Telemetry { step, sample, pressure_pa, length_m, estimate, command, faults, .. } =
            telemetry;
        let sensor_k = Sensing::new(config).gas_k(sample.gas);
        let time_s = self.clock.time_s(*step, f64::from(config.step_s));
        self.rows += 1;
        self.out.push(&format!(
            "{time_s},{pressure_pa},,{length_m},{},,,,,{sensor_k},,{},{},{},{},{step},{},{},{},{},{},{},{},{},{}",
            estimate.mass_kg,
            estimate.gas_k,
            estimate.gas_sd_k,
            command.inlet.share(),
            command.outlet.share(),
            sample.pressure.0,
            sample.gas.0,
            sample.length.0,
            u8::from(sample.emergency_stop),
            estimate.wall_k,
            estimate.sensor_k,
            estimate.heat_scale,
            estimate.sensor_lag_s,
            faults.0,
        ))
    }

    /// Rows so far.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Rows that have waited long enough are in the file.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn hand_over_in_time(&mut self) -> io::Result<()> {
        self.out.hand_over_in_time()
    }

    /// Everything is in the file.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn hand_over(&mut self) -> io::Result<()> {
        self.out.hand_over()
    }

    /// Everything is in `out`, and that is given back.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn finish(self) -> io::Result<W> {
        self.out.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::trace::COLUMNS;
    use model_core::{AdcCode, Core, Sample};

    #[test]
    fn a_row_has_every_column_and_its_numbers_read_back() {
        let config = Config::default();
        let sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));
        let telemetry = Core::new(&config).unwrap().step(&sample);
        let mut recorder = Recorder::new(Vec::new()).unwrap();
        recorder.write(&config, &telemetry).unwrap();
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
        assert_eq!(cell("gas_temperature_k"), "", "nobody knows it on a real board");
        for column in &lines[0] {
            assert!(
                ["time_s"].contains(column) || COLUMNS.contains(column),
                "as in a trace: {column}"
            );
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
            ("its count begins anew", &[u32::MAX - 5, 4, 14], &[0, 10, 20]),
            ("it restarts after a month", &[3_000_000_000, 3_000_000_010, 7], &[0, 10, 11]),
        ] {
            assert_eq!(times_ms(steps), expected, "{what}");
        }
        // Told how long a step is only after some rows.
        let mut clock = Clock::default();
        let times = [(0, 0.001), (10, 0.001), (20, 0.002), (30, 0.002)];
        let times = times.map(|(step, step_s)| (clock.time_s(step, step_s) * 1e3).round() as u64);
        assert_eq!(times, [0, 10, 30, 50]);
    }
}
