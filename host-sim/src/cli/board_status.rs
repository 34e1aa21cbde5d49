//! Status of a board in words.

use serde_json::{Value, json};
use thermyo_protocol::{ConfigSource, LastReset, Status, Timing};

pub(super) fn started_by(last_reset: LastReset) -> String {
    match last_reset {
        LastReset::Power => "power or its reset pin".to_owned(),
        other => format!("{other:?}"),
    }
}

pub(super) fn configuration_json(status: &Status) -> Value {
    json!({
        "config_name": status.config_name.as_str(),
        "config_checksum": status.config_checksum,
        "config_source": status.config_source,
    })
}

pub(super) fn configuration(status: &Status) -> String {
    let name = match status.config_name.as_str() {
        "" => "no name",
        name => name,
    };
    let from = match status.config_source {
        ConfigSource::Defaults => "the core's defaults",
        ConfigSource::Host => "sent by the host, not saved",
        ConfigSource::Flash => "from flash",
    };
    format!("{name}, {:08x}, {from}", status.config_checksum)
}

pub(super) fn timed(timing: &Timing) -> String {
    format!(
        "step {:.0} us mean, {} us worst; start {:.0} us late in the mean, {} us at worst; {} missed of {}",
        f64::from(timing.step_mean_ns) / 1e3,
        timing.step_worst_us,
        f64::from(timing.jitter_mean_ns) / 1e3,
        timing.jitter_worst_us,
        timing.missed_steps,
        timing.steps,
    )
}
