//! `trace.csv` of a real board: the columns of every trace, empty where only a plant would know, and
//! behind them what `thermyo replay` needs.

use crate::rows::Rows;
use model_core::front_end::Converter;
use model_core::{Config, Telemetry};
use std::fs::File;
use std::io::{self, Write};

const HEADER: &str = "time_s,pressure_pa,volume_m3,length_m,mass_kg,flow_in_kg_s,flow_out_kg_s,\
gas_temperature_k,wall_temperature_k,sensor_gas_k,sensor_wall_k,estimate_k,estimate_sd_k,duty_in,\
duty_out,step,code_pressure,code_gas,code_length,emergency_stop,wall_estimate_k,\
sensor_estimate_k,heat_scale,sensor_lag_s,faults";

/// Writes telemetry as rows.
pub struct Recorder<W: Write = File> {
    out: Rows<W>,
    rows: u64,
}

impl<W: Write> Recorder<W> {
    /// Into anything that takes bytes.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn new(out: W) -> io::Result<Self> {
        Ok(Self { out: Rows::new(out, HEADER)?, rows: 0 })
    }

    /// One row. `Display` of a float is the shortest text that reads back to the same bits.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write(&mut self, config: &Config, telemetry: &Telemetry) -> io::Result<()> {
        let Telemetry { step, sample, pressure_pa, length_m, estimate, command, faults } =
            telemetry;
        let sensor_k = Converter::new(&config.front_end).gas_k(sample.gas);
        let time_s = f64::from(*step) * f64::from(config.step_s);
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
    use crate::trace::COLUMNS;
    use model_core::{AdcCode, Core, Sample};

    #[test]
    fn a_row_has_every_column_and_its_numbers_read_back() {
        let config = Config::default();
        let sample = Sample {
            pressure: AdcCode(7770),
            gas: AdcCode(15_950),
            length: AdcCode(23_757),
            emergency_stop: false,
        };
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
}
