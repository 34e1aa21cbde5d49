//! Replay of one muscle's record.

use super::{Mismatch, Part, Replay, are_digital, most_code, part_of};
use thermyo_files::input::InputError;
use thermyo_files::table::Table;
use thermyo_record::board_trace;
use thermyo_scenario::profile::Profile;
use thermyo_simulation::board::{Board, BoardError};

use model_core::control::Mode;
use model_core::safety::supervisor::VENTING;
use model_core::sensing::Sensors;
use model_core::{
    AdcCode, Command, Config, Duty, Estimate, Faults, RawCode, Sample, SetPoint, Telemetry,
};
use std::path::Path;
use thermyo_protocol::checksum;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::run::{MOST_LATE_STEPS, SetPoints};

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    pub set_point: Option<SetPoint>,
    pub telemetry: Telemetry,
}

/// Runs the samples of `rows`, consecutive steps from step 0 on, through a board. Calls `each` with
/// every step, as recorded and as replayed, until it returns that this is enough.
pub fn replay(
    board: &mut dyn Board,
    config: &Config,
    rows: &[Row],
    each: &mut dyn FnMut(&Telemetry, &Telemetry) -> bool,
) -> Result<Replay, BoardError> {
    let mut outcome = Replay::default();
    let first = rows.first().and_then(|row| row.set_point);
    board.start(config, first.unwrap_or_default())?;
    let mut sample = Sample::default();
    for step in 0..rows.len() + MOST_LATE_STEPS as usize {
        // A set point acts from the step after the next on.
        if let Some(set_point) = rows.get(step + 1).and_then(|row| row.set_point) {
            board.set(set_point)?;
        }
        if let Some(row) = rows.get(step) {
            sample = row.telemetry.sample;
        }
        let Some(replayed) = board.step(&sample)?.telemetry else { continue };
        let Some(row) = rows.get(replayed.step as usize) else { continue };
        outcome.steps += 1;
        if let Some((name, recorded, replayed_as)) = difference(&row.telemetry, &replayed) {
            outcome.mismatches += 1;
            outcome.first.get_or_insert_with(|| Mismatch {
                step: replayed.step,
                recorded: format!("{name} = {recorded}"),
                replayed: replayed_as,
            });
        }
        let go_on = each(&row.telemetry, &replayed);
        if !go_on || outcome.steps == rows.len() as u64 {
            break;
        }
    }
    Ok(outcome)
}

#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    pub config: Config,
    pub part: Part,
    pub rows: Vec<Row>,
}

/// Reads a run's record: the `table` of its `trace.csv`, and the `scenario.toml` beside it.
///
/// # Errors
/// If the scenario cannot be read, or the trace lacks a step.
pub fn read_record(trace: &Path, table: &Table) -> Result<Record, InputError> {
    let mut loaded = thermyo_setup::load_recorded(&trace.with_file_name("scenario.toml"))?;
    let config = core_config(&loaded.believed);
    let part = part_of(table, checksum(&config))?;
    let recorded = Recorded::new(table, &config.sensors)?;
    let logged = logged_set_points(table)?;
    if loaded.plant.drive.profile_csv.is_some() && logged.is_none() {
        let values = table.filled("set_point")?.into_iter().skip(part.before).enumerate();
        let step_s = loaded.plant.run.step_s;
        let points = values.map(|(i, value)| (i as f64 * step_s, value)).collect();
        loaded.drive_profile = Profile::new(points).ok();
    }
    let drive = SetPoints::new(&loaded);
    let mut held = SetPoint::Vent;
    let rows = (part.before..part.before + part.rows)
        .map(|row| {
            let i = row - part.before;
            let set_point = match &logged {
                // The core vents by itself on a fault.
                Some(logged) if recorded.faults(row).intersects(VENTING) => {
                    held = logged[row];
                    None
                }
                Some(logged) => (i == 0 || logged[row] != held).then_some(logged[row]),
                None if i == 0 => Some(drive.at(0.0)),
                None => drive.acting_from(i as u64, &loaded),
            };
            held = set_point.unwrap_or(held);
            let telemetry = Telemetry { step: i as u32, ..recorded.telemetry(row, held) };
            Row { set_point, telemetry }
        })
        .collect();
    Ok(Record { config, part, rows })
}

struct Recorded {
    readings: [Vec<f64>; 2],
    codes: [Vec<u32>; 3],
    /// Whether pressure and gas are read from a digital part.
    digital: [bool; 2],
    /// Flags: emergency stop, heard, flooded.
    flags: [Vec<u32>; 3],
    missed_steps: Vec<u32>,
    estimate: [Vec<f64>; 7],
    duties: [Vec<f64>; 2],
    faults: Vec<u32>,
    valid: Vec<u32>,
    mode: Vec<u32>,
    limited: Vec<u32>,
}

impl Recorded {
    fn new(table: &Table, sensors: &Sensors) -> Result<Self, InputError> {
        let column = |name: &str| table.filled(name);
        let flag = |name: &str| table.whole(name, 1);
        let digital = are_digital(sensors);
        let [of_pressure, of_gas] = digital.map(most_code);
        Ok(Self {
            readings: [column("measured_pressure_pa")?, column("measured_length_m")?],
            codes: [
                table.whole("code_pressure", of_pressure)?,
                table.whole("code_gas", of_gas)?,
                table.whole("code_length", most_code(false))?,
            ],
            digital,
            flags: [flag("emergency_stop")?, flag("heard")?, flag("flooded")?],
            missed_steps: table.whole("missed_steps", u8::MAX.into())?,
            estimate: [
                column("estimate_k")?,
                column("estimate_sd_k")?,
                column("wall_estimate_k")?,
                column("sensor_estimate_k")?,
                column("mass_estimate_kg")?,
                column("heat_scale")?,
                column("sensor_lag_s")?,
            ],
            duties: [column("duty_in")?, column("duty_out")?],
            faults: table.whole("faults", u32::MAX)?,
            valid: flag("estimate_valid")?,
            mode: table.whole("mode", Mode::NAMES.len() as u32 - 1)?,
            limited: flag("limited")?,
        })
    }

    fn faults(&self, i: usize) -> Faults {
        Faults(self.faults[i])
    }

    /// Telemetry of a row, without its step.
    fn telemetry(&self, i: usize, set_point: SetPoint) -> Telemetry {
        let [pressure, gas, length] = self.codes.each_ref().map(|codes| codes[i] as u16);
        let [pressure, gas] = [(pressure, self.digital[0]), (gas, self.digital[1])]
            .map(|(bits, digital)| RawCode::from_bits(bits, digital));
        let length = AdcCode(length);
        let [emergency_stop, heard, flooded] = self.flags.each_ref().map(|flags| flags[i] != 0);
        let [pressure_pa, length_m] = self.readings.each_ref().map(|values| values[i] as f32);
        let [gas_k, gas_sd_k, wall_k, sensor_k, mass_kg, heat_scale, sensor_lag_s] =
            self.estimate.each_ref().map(|values| values[i] as f32);
        let valid = self.valid[i] != 0;
        let [inlet, outlet] =
            self.duties.each_ref().map(|duties| Duty::from_share(duties[i] as f32));
        Telemetry {
            step: 0,
            sample: Sample {
                pressure,
                gas,
                length,
                emergency_stop,
                heard,
                flooded,
                missed_steps: self.missed_steps[i] as u8,
            },
            pressure_pa,
            length_m,
            estimate: Estimate {
                gas_k,
                gas_sd_k,
                valid,
                wall_k,
                sensor_k,
                mass_kg,
                heat_scale,
                sensor_lag_s,
            },
            command: Command { inlet, outlet },
            mode: Mode::NAMES
                .get(self.mode[i] as usize)
                .map_or(Mode::StartupCheck, |(mode, _)| *mode),
            limited: self.limited[i] != 0,
            set_point,
            faults: self.faults(i),
        }
    }
}

/// Set points that a board has recorded, row by row; those of a simulated run follow from its
/// scenario, and from the values of its profile in the record.
fn logged_set_points(table: &Table) -> Result<Option<Vec<SetPoint>>, InputError> {
    if !table.columns().iter().any(|column| column.name == "set_point_kind") {
        return Ok(None);
    }
    let kinds = table.whole("set_point_kind", board_trace::LAST_KIND.into())?;
    let [values, seconds] = ["set_point_value", "set_point_second"].map(|name| table.filled(name));
    let values = values?.into_iter().zip(seconds?);
    let logged = kinds.into_iter().zip(values).map(|(kind, (value, second))| {
        board_trace::set_point(kind as u8, value as f32, second as f32)
    });
    Ok(Some(logged.collect()))
}

/// Whether both are bitwise equal: a NaN equals itself, and the two zeros differ.
pub fn identical(a: &Telemetry, b: &Telemetry) -> bool {
    difference(a, b).is_none()
}

/// The first column that is not bitwise equal, with both values.
fn difference(a: &Telemetry, b: &Telemetry) -> Option<(&'static str, String, String)> {
    let numbers = numbers(a).into_iter().zip(numbers(b));
    let different = |((_, a), (_, b)): &((_, f32), (_, f32))| a.to_bits() != b.to_bits();
    if let Some(((name, a), (_, b))) = numbers.into_iter().find(different) {
        return Some((name, a.to_string(), b.to_string()));
    }
    let whole = |t: &Telemetry| (t.step, t.sample, t.mode, t.limited, t.faults, t.estimate.valid);
    if whole(a) == whole(b) {
        return None;
    }
    let columns = [
        ("mode", [a, b].map(|t| format!("{:?}", t.mode))),
        ("faults", [a, b].map(|t| t.faults.0.to_string())),
        ("limited", [a, b].map(|t| t.limited.to_string())),
        ("estimate_valid", [a, b].map(|t| t.estimate.valid.to_string())),
        ("step", [a, b].map(|t| t.step.to_string())),
        ("the sample", [a, b].map(|t| format!("{:?}", t.sample))),
    ];
    columns.into_iter().find(|(_, [a, b])| a != b).map(|(name, [a, b])| (name, a, b))
}

/// Outputs of a step that are numbers, under the names of their columns.
fn numbers(t: &Telemetry) -> [(&'static str, f32); 11] {
    let Estimate { gas_k, gas_sd_k, valid: _, wall_k, sensor_k, mass_kg, heat_scale, sensor_lag_s } =
        t.estimate;
    [
        ("measured_pressure_pa", t.pressure_pa),
        ("measured_length_m", t.length_m),
        ("estimate_k", gas_k),
        ("estimate_sd_k", gas_sd_k),
        ("wall_estimate_k", wall_k),
        ("sensor_estimate_k", sensor_k),
        ("mass_estimate_kg", mass_kg),
        ("heat_scale", heat_scale),
        ("sensor_lag_s", sensor_lag_s),
        ("duty_in", t.command.inlet.share()),
        ("duty_out", t.command.outlet.share()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use thermyo_simulation::board::CoreBoard;

    fn again(config: &Config, rows: &[Row]) -> Replay {
        replay(&mut CoreBoard::default(), config, rows, &mut |_, _| true).unwrap()
    }

    fn record(config: &Config) -> Vec<Row> {
        let mut board = CoreBoard::default();
        board.start(config, SetPoint::Vent).unwrap();
        (0..500)
            .map(|step: u16| {
                let set_point = (step == 100).then_some(SetPoint::Pressure { pressure_pa: 3.0e5 });
                if step == 99 {
                    // The set point acts from the step after the next on.
                    board.set(SetPoint::Pressure { pressure_pa: 3.0e5 }).unwrap();
                }
                let sample = Sample::new(
                    AdcCode(7000 + 3 * step),
                    AdcCode(16_000 + step % 7),
                    AdcCode(23_000 - step),
                );
                Row { set_point, telemetry: board.step(&sample).unwrap().telemetry.unwrap() }
            })
            .collect()
    }

    #[test]
    fn a_record_of_the_same_core_has_no_mismatch() {
        let config = Config::default();
        let outcome = again(&config, &record(&config));
        assert_eq!((outcome.steps, outcome.mismatches, outcome.first), (500, 0, None));
    }

    #[test]
    fn one_bit_is_a_mismatch() {
        let config = Config::default();
        let mut rows = record(&config);
        let estimate = &mut rows[77].telemetry.estimate;
        estimate.wall_k = f32::from_bits(estimate.wall_k.to_bits() ^ 1);
        let outcome = again(&config, &rows);
        assert_eq!(outcome.mismatches, 1);
        let first = outcome.first.unwrap();
        assert_eq!(first.step, 77);
        assert!(first.recorded.starts_with("wall_estimate_k = "), "{first:?}");
        assert_ne!(first.recorded, format!("wall_estimate_k = {}", first.replayed));
    }

    /// Both estimates used to be printed whatever differed, even if they were equal.
    #[test]
    fn what_differs_is_named() {
        let config = Config::default();
        let mut rows = record(&config);
        rows[200].telemetry.mode = Mode::StartupCheck;
        let first = again(&config, &rows).first.unwrap();
        assert_eq!((first.step, first.recorded.as_str()), (200, "mode = StartupCheck"));
        let mut rows = record(&config);
        rows[300].telemetry.command.inlet = Duty::from_share(0.123);
        let first = again(&config, &rows).first.unwrap();
        assert!(first.step == 300 && first.recorded.starts_with("duty_in = 0.123"), "{first:?}");
    }

    #[test]
    fn another_configuration_shows() {
        let config = Config::default();
        let mut other = config;
        other.heat.inner_w_m2_k *= 1.1;
        assert!(again(&other, &record(&config)).mismatches > 300);
    }
}
