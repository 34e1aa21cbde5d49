//! True characteristics of the sensors' elements and circuits: from an element's temperature to a
//! fraction of the reference. The core's `sensing` is the inverse, derived separately.

mod max31865;
mod ntc;
mod pt1000;

use thermyo_scenario::{GasElementKind, Sensors};

/// Gas sensor's fraction of the reference, or of a sensor chip's scale, at a temperature \[K\].
pub fn gas_share(sensors: &Sensors, temperature_k: f64) -> f64 {
    match sensors.gas.kind {
        GasElementKind::Pt1000 => pt1000::share(&sensors.gas, temperature_k),
        GasElementKind::Ntc => ntc::share(&sensors.ntc, temperature_k),
        GasElementKind::Max31865 => max31865::share(&sensors.max31865, temperature_k),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use thermyo_plant::Truth;

    use crate::adc::VirtualAdc;
    use thermyo_setup::core_config::core_config;

    /// Plant and core describe one circuit: the core inverts the plant's fraction, calibrated or
    /// not.
    #[test]
    fn the_core_reads_what_every_element_senses() {
        for kind in GasElementKind::WORDS {
            let text = format!(
                "[sensor.gas]\nkind = \"{kind}\"\nnoise_k = 0.0\ngain = 1.02\noffset_k = -5.0\n\
                 [adc]\nwide_code_lsb = 0.0\n"
            );
            let loaded = thermyo_setup::parse(&text, "elements".as_ref()).unwrap();
            let config = core_config(&loaded.believed);
            let (sensing, mut adc) = (config.sensing(), VirtualAdc::new(&loaded.plant));
            let step_k = f64::from(config.sensors.gas_element.resolution_k());
            for kelvin in 280..=320 {
                let sensor_gas_k = f64::from(kelvin) + 0.3;
                // Late enough for any sensor chip to have converted again.
                let time_s = f64::from(kelvin);
                let codes = adc.convert(&Truth { time_s, sensor_gas_k, ..Truth::default() });
                let error_k = f64::from(sensing.gas_k(codes.gas)) - sensor_gas_k;
                // The noise of the converter itself.
                assert!(error_k.abs() < 2.0 * step_k, "{kind}: {error_k} K at {kelvin} K");
            }
        }
    }
}
