//! The muscle of a board, as commands print it.

use super::Console;
use model_core::Telemetry;
use serde_json::{Value, json};
use std::path::Path;
use thermyo_boards::live::LiveBoard;
use thermyo_boards::subject::Subject;
use thermyo_boards::{port, service};
use thermyo_files::units::UnitSystem;
use thermyo_protocol::ConfigSource;
use thermyo_setup::{Loaded, calibrated_otherwise, differences, from_config};
use thermyo_simulation::board::BoardError;

/// Result of a command that vented, as JSON.
pub(super) fn vents() -> Value {
    json!({ "mode": "vent" })
}

/// The muscle in a line.
pub(super) fn line(telemetry: &Telemetry, units: UnitSystem) -> String {
    let Telemetry { pressure_pa, length_m, estimate, command, mode, limited, .. } = telemetry;
    let mode = mode.name();
    let share = |share: f32| units.text(share.into(), "", 1);
    format!(
        "{:>11}  {:>9}  gas {} +- {:.2} K  in {:>7}  out {:>7}  {mode}{}",
        units.text((*pressure_pa).into(), "Pa", 2),
        units.text((*length_m).into(), "m", 1),
        units.text(estimate.gas_k.into(), "K", 2),
        estimate.gas_sd_k,
        share(command.inlet.share()),
        share(command.outlet.share()),
        if *limited { ", limited by the highest pressure" } else { "" },
    )
}

/// Warns if a configured board has another calibration than the scenario that replaces it.
pub(super) fn warn_of_another_calibration(
    board: &mut LiveBoard,
    file: &Path,
    loaded: &Loaded,
    to: &mut Console<'_>,
) -> Result<(), BoardError> {
    if board.status()?.config_source == ConfigSource::Defaults {
        return Ok(());
    }
    let Ok(there) = from_config::to_scenario(&board.config()?) else { return Ok(()) };
    let all = calibrated_otherwise(&loaded.believed, &there.scenario.believed);
    if !all.is_empty() {
        let (file, all) = (file.display(), all.join("; "));
        to.say(format_args!(
            "warning: {file}: the board loses its calibration: {all}; `thermyo board PORT config read FILE` before \
             keeps it"
        ));
    }
    Ok(())
}

/// Warns if the emulated board has another muscle at its pins than the scenario it is given.
pub(super) fn warn_of_another_muscle(
    port: &str,
    file: &Path,
    loaded: &Loaded,
    to: &mut Console<'_>,
) {
    let there = service::at_pins().filter(|_| port == port::EMULATED).unwrap_or_default();
    let all = differences(loaded, &there);
    if !all.is_empty() {
        let (file, all) = (file.display(), all.join("; "));
        to.say(format_args!(
            "warning: {file}: another muscle is at the emulated board's pins: {all}; `thermyo board emulated plug \
             {file}` plugs in this one"
        ));
    }
}
