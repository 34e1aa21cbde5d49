//! The muscle of a board, as commands print it.

use model_core::Telemetry;
use model_core::control::Mode;
use serde_json::{Value, json};

/// Result of a command that vented, as JSON.
pub(super) fn vents() -> Value {
    json!({ "mode": "vent" })
}

/// The muscle in a line.
pub(super) fn line(telemetry: &Telemetry) -> String {
    let Telemetry { pressure_pa, length_m, estimate, command, mode, limited, .. } = telemetry;
    let mode = Mode::NAMES.iter().find(|(known, _)| known == mode).map_or("", |(_, name)| name);
    format!(
        "{:7.2} kPa  {:6.1} mm  gas {:6.2} +- {:.2} K  in {:5.1} %  out {:5.1} %  {mode}{}",
        pressure_pa / 1e3,
        length_m * 1e3,
        estimate.gas_k,
        estimate.gas_sd_k,
        command.inlet.share() * 100.0,
        command.outlet.share() * 100.0,
        if *limited { ", limited by the highest pressure" } else { "" },
    )
}
