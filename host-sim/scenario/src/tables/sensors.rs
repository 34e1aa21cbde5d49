//! The four sensors and their ranges.

use crate::declare::{choice, table};
use crate::preset::PressurePreset;
use model_core::sensing::gas::{GasElement, Max31865, Ntc, Pt1000};
use model_core::sensing::pressure::{Mpr, PressurePart};
use model_core::sensing::{adc, gas, length, pressure};
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Default)]
#[serde(default, deny_unknown_fields)]
pub struct Sensors {
    pub gas: GasSensor,
    pub wall: WallSensor,
    pub pressure: PressureSensor,
    pub length: LengthSensor,
    /// The thermistor, where the gas sensor is one.
    pub ntc: Ntc,
    /// The MAX31865, where the gas sensor is on one.
    pub max31865: Max31865,
    /// The MPR, where the pressure sensor is one.
    pub mpr: Mpr,
}

table! {
    "adc", "the board's converter", believed;
    Adc as adc::Adc {
        // DNL peaks of 8 to 9 LSB on Pico boards (raspberrypi/pico-feedback issue 91), jumps of 9 to 10 LSB
        // in the mean error of five boards (kitanokitsune/rp2040adc_correction).
        core wide_code_lsb;
    }
}

impl Sensors {
    /// The core's type of the gas element.
    pub fn gas_element(&self) -> GasElement {
        match self.gas.kind {
            GasElementKind::Pt1000 => GasElement::Pt1000(Pt1000 {
                range_min_k: self.gas.range_min_k as f32,
                range_max_k: self.gas.range_max_k as f32,
            }),
            GasElementKind::Ntc => GasElement::Ntc(self.ntc),
            GasElementKind::Max31865 => GasElement::Max31865(self.max31865),
        }
    }

    /// The core's type of the pressure sensor.
    pub fn pressure_part(&self) -> PressurePart {
        match self.pressure.kind {
            PressureKind::Ratiometric => PressurePart::Ratiometric,
            PressureKind::Mpr => PressurePart::Mpr(self.mpr),
        }
    }
}

choice! {
    GasElementKind {
        /// Pt1000 in a half bridge.
        Pt1000 = "pt1000",
        /// NTC thermistor in a divider.
        Ntc = "ntc",
        /// Platinum resistor on a MAX31865.
        Max31865 = "max31865",
    }
}

choice! {
    PressureKind {
        /// A ratiometric sensor on the converter.
        Ratiometric = "ratiometric",
        /// Honeywell MPR on I2C.
        Mpr = "mpr",
    }
}

table! {
    "sensor.gas", "element in the gas; its housing is in the plant full only", believed, physical;
    GasSensor as gas::GasSensor {
        kind: choice GasElementKind::Pt1000, "what senses";
        // Only the plant can have a sensor without lag: the core's filter needs one.
        core time_constant_s: real 3.0, "s", 0.0 to 1000.0, "lag";
        core noise_k;
        position: real 0.5, "", 0.0 to 1.0, "its middle, from port 0 to closed end 1 (full)";
        span: real 0.25, "", 0.0 to 1.0, "part of the length that it averages over (full)";
        // The paper's foil hangs "in the centre inside of pneumatic muscle".
        radius: real 0.0, "", 0.0 to 1.0, "from the axis 0 to the wall 1: where the gas is still it has a profile (full, heat.model = \"correlation\")";
        range_min_k: real 270.0, "K", 73.0 to 800.0, "lowest temperature resolved (pt1000)";
        range_max_k: real 330.0, "K", 74.0 to 1100.0, "highest temperature resolved (pt1000)";
        // The lag of a sensor that the surrounding gas film slows: 0.5 for free convection and for laminar flow across
        // it.
        density_exponent: real 0.0, "", 0.0 to 1.0, "n in lag ~ density^-n, time_constant_s at the start; 0.5 in free convection";
        core housing_time_constant_s;
        core gain;
        core offset_k;
    }
}

table! {
    "sensor.wall", "sensor in the braided wall", believed, physical;
    WallSensor {
        time_constant_s: real 3.0, "s", 0.0 to 1000.0, "lag";
        noise_k: real 0.05, "K", 0.0 to 100.0, "noise of one reading, standard deviation";
        position: real 0.5, "", 0.0 to 1.0, "from port 0 to closed end 1 (full)";
    }
}

table! {
    "sensor.pressure", "absolute pressure sensor, 10 to 90 % of the reference over its range", believed, physical;
    PressureSensor as pressure::PressureSensor {
        preset: choice PressurePreset::None, "a sensor by its data sheet; a key in the file stands above its value";
        kind: choice PressureKind::Ratiometric, "what senses";
        time_constant_s: real 0.0005, "s", 0.0 to 1000.0, "lag";
        core noise_pa;
        core range_pa;
        core gain;
        core offset_pa;
        core correction_25;
        core correction_50;
        core correction_75;
    }
}

table! {
    "sensor.length", "length potentiometer", believed, physical;
    LengthSensor as length::LengthSensor {
        time_constant_s: real 0.0005, "s", 0.0 to 1000.0, "lag";
        noise_m: real 2.0e-5, "m", 0.0 to 10.0, "noise of one conversion, standard deviation";
        core range_m;
        core gain;
        core offset_m;
        core correction_25;
        core correction_50;
        core correction_75;
    }
}
