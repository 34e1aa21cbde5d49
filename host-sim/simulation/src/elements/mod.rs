//! The sensors' elements and their circuits, as they are: from what an element is exposed to, to its share of
//! the reference. The core's `sensing` is the way back, written on its own.

mod max31865;
mod ntc;
mod pt1000;

use thermyo_scenario::{GasElementKind, Sensors};

/// Share of the reference, or of a digital part's scale, that the gas sensor gives at a temperature \[K\].
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
    use model_core::AdcCode;
    use thermyo_setup::core_config::core_config;

    /// Two descriptions of one circuit: what the plant makes of a temperature, the core makes that
    /// temperature of, calibrated or not.
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
                // Late enough for any part to have converted again.
                let time_s = f64::from(kelvin);
                let codes = adc.convert(&Truth { time_s, sensor_gas_k, ..Truth::default() });
                let error_k = f64::from(sensing.gas_k(AdcCode(codes.gas))) - sensor_gas_k;
                // The converter's own noise.
                assert!(error_k.abs() < 2.0 * step_k, "{kind}: {error_k} K at {kelvin} K");
            }
        }
    }
}
