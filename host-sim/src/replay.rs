//! Recorded samples through the core again, compared to the bit.

use model_core::{Config, ConfigError, Core, Estimate, Sample, SetPoint, Telemetry};

/// One step of a record.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// A set point that holds from this step on.
    pub set_point: Option<SetPoint>,
    /// What the board made of the sample that it names.
    pub telemetry: Telemetry,
}

/// The first step that differs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mismatch {
    /// What the record says.
    pub recorded: Telemetry,
    /// What the core says now.
    pub replayed: Telemetry,
}

/// Outcome of a replay.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Replay {
    /// Steps compared.
    pub steps: u64,
    /// Steps of which a number differs in at least one bit.
    pub mismatches: u64,
    /// The first of them.
    pub first: Option<Mismatch>,
}

/// Runs the samples of `rows`, which are consecutive steps from step 0 on, through a new core.
///
/// # Errors
/// [`ConfigError`]
pub fn replay(config: &Config, rows: &[Row]) -> Result<Replay, ConfigError> {
    let mut core = Core::new(config)?;
    let mut outcome = Replay::default();
    for row in rows {
        if let Some(set_point) = row.set_point {
            core.set(set_point);
        }
        let replayed = core.step(&row.telemetry.sample);
        outcome.steps += 1;
        if !identical(&row.telemetry, &replayed) {
            outcome.mismatches += 1;
            outcome.first.get_or_insert(Mismatch { recorded: row.telemetry, replayed });
        }
    }
    Ok(outcome)
}

/// Equal to the bit: a NaN is equal to itself, and the two zeros differ.
pub fn identical(a: &Telemetry, b: &Telemetry) -> bool {
    let integers = |t: &Telemetry| {
        let Sample { pressure, gas, length, emergency_stop } = t.sample;
        (t.step, pressure, gas, length, emergency_stop, t.command.inlet, t.command.outlet, t.faults)
    };
    let bits = |t: &Telemetry| {
        let Estimate { gas_k, gas_sd_k, wall_k, sensor_k, mass_kg, heat_scale, sensor_lag_s } =
            t.estimate;
        [
            t.pressure_pa,
            t.length_m,
            gas_k,
            gas_sd_k,
            wall_k,
            sensor_k,
            mass_kg,
            heat_scale,
            sensor_lag_s,
        ]
        .map(f32::to_bits)
    };
    integers(a) == integers(b) && bits(a) == bits(b)
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::AdcCode;

    fn record(config: &Config) -> Vec<Row> {
        let mut core = Core::new(config).unwrap();
        (0..500)
            .map(|step: u16| {
                let set_point = (step == 100).then_some(SetPoint::Pressure { pressure_pa: 3.0e5 });
                if let Some(set_point) = set_point {
                    core.set(set_point);
                }
                let telemetry = core.step(&Sample {
                    pressure: AdcCode(7000 + 3 * step),
                    gas: AdcCode(16_000 + step % 7),
                    length: AdcCode(23_000 - step),
                    emergency_stop: false,
                });
                Row { set_point, telemetry }
            })
            .collect()
    }

    #[test]
    fn a_record_of_the_same_core_has_no_mismatch() {
        let config = Config::default();
        let outcome = replay(&config, &record(&config)).unwrap();
        assert_eq!((outcome.steps, outcome.mismatches, outcome.first), (500, 0, None));
    }

    #[test]
    fn one_bit_is_a_mismatch() {
        let config = Config::default();
        let mut rows = record(&config);
        let estimate = &mut rows[77].telemetry.estimate;
        estimate.wall_k = f32::from_bits(estimate.wall_k.to_bits() ^ 1);
        let outcome = replay(&config, &rows).unwrap();
        assert_eq!(outcome.mismatches, 1);
        assert_eq!(outcome.first.unwrap().recorded.step, 77);
    }

    #[test]
    fn another_configuration_shows() {
        let config = Config::default();
        let mut other = config;
        other.heat.inner_w_m2_k *= 1.1;
        assert!(replay(&other, &record(&config)).unwrap().mismatches > 300);
    }
}
