//! `thermyo tune --plan motion`: slip and creep of the muscle on a board, from the experiment that
//! `thermyo identify --plan motion` prints.
//!
//! The record is the table that a user would have recorded, so that `thermyo identify` finds the same values in it.

use super::experiment::{Left, Record, configured, record, usable_pa};
use super::{Bench, Refusal, TuneError, reached};
use model_core::Faults;
use std::fmt::Write;
use std::path::Path;
use thermyo_compute::parallel::Watch;
use thermyo_files::input::InputError;
use thermyo_files::table::Table;
use thermyo_identify::motion::{self, Identified};
use thermyo_scenario::DriveKind;
use thermyo_setup::Loaded;
use thermyo_setup::core_config::core_config;
use thermyo_simulation::run::RunError;

/// Number of steps of the core whose mean is a row of the record: 100 rows a second at 1 kHz.
const STEPS_OF_A_ROW: u32 = 10;

/// Runs the experiment up to `highest_pa`; the board vents afterwards, with its former configuration.
/// Returns the record, `time_s,length_m,pressure_pa`. `file` names the scenario in messages.
///
/// # Errors
/// For an actuator other than a muscle, a load that fixes the length, a fault during the experiment, or a pressure that
/// is not reached.
pub fn motion_record(
    loaded: &Loaded,
    file: &Path,
    highest_pa: f64,
    bench: &mut dyn Bench,
) -> Result<String, TuneError> {
    let config = core_config(&loaded.believed);
    let highest_pa = usable_pa(&config, highest_pa);
    motion::check_plan(&loaded.believed, highest_pa, file)?;
    configured(&config)?;
    let (profile, _) = motion::profile(&loaded.believed, highest_pa);
    let most_pa = profile.iter().map(|point| point.1).fold(0.0, f64::max);
    let records = record(loaded, DriveKind::Pressure, profile, bench);
    // In any case the muscle is not left under pressure.
    let vented = bench.leave(Left::Former(&config));
    let records = records?;
    vented.map_err(RunError::Board)?;
    let faults = records.iter().fold(Faults::NONE, |all, record| all.with(record.faults));
    if faults != Faults::NONE {
        return Err(Refusal::Faulty(faults).into());
    }
    reached(&records, [f64::from(config.ambient.pressure_pa), most_pa])?;
    Ok(table(&records))
}

fn table(records: &[Record]) -> String {
    let mut text = "time_s,length_m,pressure_pa\n".to_owned();
    for row in records.chunk_by(|a, b| a.step / STEPS_OF_A_ROW == b.step / STEPS_OF_A_ROW) {
        let mean = |of: fn(&Record) -> f64| row.iter().map(of).sum::<f64>() / row.len() as f64;
        let (time_s, length_m, pressure_pa) =
            (mean(|r| r.time_s), mean(|r| r.length_m), mean(|r| r.pressure_pa));
        let _ = writeln!(text, "{time_s:.4},{length_m:.7},{pressure_pa:.1}");
    }
    text
}

/// Finds the values in a record, which messages call `record_file`. The resulting scenario has them in the core's
/// configuration only.
pub fn motion_values(
    loaded: &Loaded,
    file: &Path,
    (text, record_file): (&str, &Path),
    watch: &dyn Watch,
) -> Result<Identified, InputError> {
    let mut asked = loaded.clone();
    asked.plant = asked.believed.clone();
    if !motion::is_asked_for(&asked) {
        asked.plant.identify.parameters = motion::usual_keys(&asked.plant);
    }
    let table = Table::parse(text, record_file)?;
    let mut found = motion::identify(&asked, file, &table, None, watch)?;
    found.scenario.plant = loaded.plant.clone();
    Ok(found)
}
