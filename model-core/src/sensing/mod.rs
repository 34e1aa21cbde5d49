//! From raw codes to readings in SI units. Only this module deals with converter and sensors.
//!
//! ```text
//! Sample --adc: linearised code--> sensor: value, calibrated --health: lost?--> Readings
//! ```
//!
//! Estimator, controller and supervisor use [`Reading`]s, whatever their origin. Pressure and length have one in every
//! step; the slow gas sensor has the mean over an interval. A digital part reads at its own rate: between readings, a
//! pressure keeps its last value.

pub mod adc;
pub mod calibration;
mod element;
pub mod gas;
mod health;
pub mod length;
pub mod max31865;
pub mod ntc;
pub mod part;
pub mod platinum;
pub mod pressure;
pub mod pt1000;

use self::adc::{Adc, CodeSum, Linearisation};
use self::calibration::Calibrated;
use self::gas::{GasElement, GasLine, GasSensor};
pub use self::health::FROZEN_CODES;
use self::health::{Health, Stillness};
use self::length::LengthSensor;
use self::part::Part;
use self::pressure::{PressurePart, PressureSensor};
use crate::parameter::ConfigError;
use crate::sample::{AdcCode, OVERSAMPLING, PartCode, RawCode, Sample};
use crate::step_counts::StepCounts;

/// The sensors and their converter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Sensors {
    /// The converter.
    pub adc: Adc,
    /// Muscle pressure.
    pub pressure: PressureSensor,
    /// Muscle length.
    pub length: LengthSensor,
    /// Gas temperature.
    pub gas: GasSensor,
    /// Element of the gas sensor.
    pub gas_element: GasElement,
    /// Type of the pressure sensor.
    pub pressure_part: PressurePart,
}

impl Sensors {
    /// Checks every value.
    ///
    /// # Errors
    /// The first value that is not a number or lies outside of its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        self.adc.check()?;
        self.pressure.check()?;
        self.length.check()?;
        self.gas.check()?;
        self.gas_element.check()?;
        self.pressure_part.check()
    }
}

/// How far a reading may be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Validity {
    /// Without reservation.
    Valid,
    /// Not now; it may be a disturbance.
    Suspect,
    /// Not at all: its channel is open, shorted, frozen or noisy.
    Lost,
}

/// One reading of a sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Value in SI units.
    pub value: f32,
    /// Half the width of the reading's code, if a healthy channel may stay in it; the true value lies anywhere within.
    /// 0: the code is no wider than the others.
    pub wide: f32,
    /// How far the reading may be used.
    pub validity: Validity,
}

impl Reading {
    /// A valid reading without a wide code.
    ///
    /// ```
    /// use model_core::sensing::Reading;
    ///
    /// assert_eq!(Reading::exact(0.28).wide, 0.0);
    /// ```
    pub const fn exact(value: f32) -> Self {
        Self { value, wide: 0.0, validity: Validity::Valid }
    }
}

/// Mean of the gas sensor's readings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GasReading {
    /// Temperature of the element \[K\].
    pub value_k: f32,
    /// Variance of its noise \[K2\].
    pub noise_k2: f32,
    /// Whether the code has changed since the reading before.
    pub moved: bool,
    /// Mean age of the readings \[steps\]; `None`: they are the mean over the whole interval.
    pub age_steps: Option<f32>,
}

/// The readings of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Readings {
    /// Absolute pressure \[Pa\].
    pub pressure: Reading,
    /// Length \[m\].
    pub length: Reading,
    /// How far the readings of the gas sensor may be used.
    pub gas: Validity,
}

/// A channel of the converter whose sensor has a reading in every step.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Channel {
    sensor: Calibrated,
    /// Half the width of the channel's widest codes.
    wide: f32,
    health: Health,
}

impl Channel {
    /// Not inlined: two calls.
    #[inline(never)]
    fn read(&mut self, linearisation: &Linearisation, code: AdcCode, usual: Stillness) -> Reading {
        let widened = linearisation.widens(code);
        Reading {
            value: self.sensor.at(linearisation.ideal(code)),
            wide: if widened { self.wide } else { 0.0 },
            validity: self.health.add(code.0, if widened { Stillness::Wide } else { usual }),
        }
    }

    /// Reads the channel from a digital part whose last value was `value`.
    fn read_part(
        &mut self,
        (part, value): &mut (Part, f32),
        code: RawCode,
        usual: Stillness,
    ) -> Reading {
        let validity = part.add(&mut self.health, code, usual);
        if let (RawCode::Fresh(PartCode(reading)), Validity::Valid) = (code, validity) {
            *value = self.sensor.at(f32::from(reading));
        }
        Reading { value: *value, wide: 0.0, validity }
    }
}

/// Every sensor of one muscle.
///
/// The small fields come first, within reach of a Cortex-M0+'s short load.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(C)]
pub struct Sensing {
    gas_codes: CodeSum,
    /// Last code, of the converter or of the part.
    gas_code: Option<u16>,
    /// Growth of the readings' ages since they arrived, summed \[steps\].
    gas_ages: u16,
    gas_moved: bool,
    gas_health: Health,
    gas_part: Option<Part>,
    linearisation: Linearisation,
    pressure: Channel,
    length: Channel,
    /// The pressure's digital part, and its last value.
    pressure_part: Option<(Part, f32)>,
    gas: GasLine,
    /// Variance of the noise of a code \[K2\], and the number of conversions summed in it.
    gas_noise_k2: f32,
    gas_conversions: f32,
    /// Age of a digital part's reading when it arrives \[steps\].
    gas_latency_steps: f32,
}

impl Sensing {
    /// Creates sensing without any reading; [`Config::sensing`](crate::Config::sensing) calls it. A digital pressure
    /// sensor reads `ambient_pa` until its first conversion arrives.
    ///
    /// ```
    /// use model_core::{AdcCode, Config, Sample};
    ///
    /// let mut sensing = Config::default().sensing();
    /// let readings = sensing.read(&Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757)), false);
    /// assert!((0.2..0.31).contains(&readings.length.value));
    /// ```
    #[cold] // Once at a start: as small as can be.
    pub fn new(sensors: &Sensors, step_s: f32, ambient_pa: f32) -> Self {
        let Sensors { adc, pressure, length, gas, gas_element, pressure_part } = sensors;
        let part = pressure_part.part();
        let patience_steps = StepCounts::new(step_s).patience_steps;
        // The model can continue without the gas temperature, so the part counts as healthy until it is known to be
        // lost.
        let limits = gas_element.part();
        let latency_s = limits.as_ref().map_or(0.0, |part| part.latency_s);
        let gas_part = limits.map(|part| Part::new(&part, step_s, Validity::Valid));
        // A digital converter adds quantization to its noise.
        let step_k = if gas_part.is_some() { gas_element.resolution_k() } else { 0.0 };
        Self {
            linearisation: Linearisation::new(adc),
            // One disturbed pressure is no fault, ten milliseconds of them are. Without length or gas temperature the
            // model can continue, so those channels need not wait.
            pressure: Channel {
                sensor: pressure_part.calibrated(pressure),
                wide: adc.half_width(pressure.resolution_pa()),
                health: Health::new(if part.is_some() { part::PATIENCE } else { patience_steps }),
            },
            length: Channel {
                sensor: length.calibrated(),
                wide: adc.half_width(length.resolution_m()),
                health: Health::new(1),
            },
            pressure_part: part
                .map(|part| (Part::new(&part, step_s, Validity::Suspect), ambient_pa)),
            gas: GasLine::new(gas, gas_element),
            gas_health: Health::new(if gas_part.is_some() { part::PATIENCE } else { 1 }),
            gas_part,
            gas_noise_k2: gas.noise_k * gas.noise_k + step_k * step_k / 12.0,
            gas_conversions: if gas_part.is_some() { 1.0 } else { f32::from(OVERSAMPLING) },
            gas_codes: CodeSum::default(),
            gas_latency_steps: latency_s / step_s,
            gas_ages: 0,
            gas_code: None,
            gas_moved: false,
        }
    }

    /// Returns the sensing of a core that restarts with `other`: it keeps the health of channels whose sensor type
    /// stays the same, and how long a digital gas sensor has been silent.
    pub fn after_restart(&self, other: &Self) -> Self {
        let mut next = *other;
        next.length.health = self.length.health;
        let pressure_health = self.pressure.health.with_patience_of(&other.pressure.health);
        match (&self.pressure_part, &mut next.pressure_part) {
            (None, None) => next.pressure.health = pressure_health,
            (Some((_, last_pa)), Some((_, pressure_pa))) => {
                next.pressure.health = pressure_health;
                *pressure_pa = *last_pa;
            }
            _ => {}
        }
        let gas_health = self.gas_health.with_patience_of(&other.gas_health);
        match (&self.gas_part, &mut next.gas_part) {
            (None, None) => next.gas_health = gas_health,
            (Some(before), Some(part)) => {
                next.gas_health = gas_health;
                part.goes_on_from(before);
            }
            _ => {}
        }
        next
    }

    /// Returns the readings of one step; `flowing`: gas flows, so that healthy channels of pressure and length change.
    pub fn read(&mut self, sample: &Sample, flowing: bool) -> Readings {
        let usual = if flowing { Stillness::Suspicious } else { Stillness::Usual };
        Readings {
            pressure: match &mut self.pressure_part {
                Some(part) => self.pressure.read_part(part, sample.pressure, usual),
                None => self.pressure.read(&self.linearisation, sample.pressure.adc(), usual),
            },
            length: self.length.read(&self.linearisation, sample.length, usual),
            // The sensor's lag keeps its code the same for long; the estimator detects when it is frozen.
            gas: match &mut self.gas_part {
                Some(part) => part.add(&mut self.gas_health, sample.gas, Stillness::Usual),
                None => self.gas_health.add(sample.gas.adc().0, Stillness::Usual),
            },
        }
    }

    /// Absolute pressure \[Pa\] for one code.
    pub fn pressure_pa(&self, code: impl Into<RawCode>) -> f32 {
        self.pressure.sensor.at(self.ideal(code.into()))
    }

    /// Length \[m\] for one code.
    pub fn length_m(&self, code: AdcCode) -> f32 {
        self.length.sensor.at(self.linearisation.ideal(code))
    }

    /// The ideal code; a digital part has no converter of the board to correct.
    fn ideal(&self, code: RawCode) -> f32 {
        match code {
            RawCode::Adc(code) => self.linearisation.ideal(code),
            RawCode::Fresh(PartCode(reading)) | RawCode::Stale(PartCode(reading)) => reading.into(),
        }
    }

    /// Adds a code of the gas sensor to the next [mean](Self::take_gas); a digital part's code only if it is fresh.
    pub fn add_gas(&mut self, code: impl Into<RawCode>) {
        let code = match (&self.gas_part, code.into()) {
            (None, code) => code.adc().0,
            (Some(_), code) => {
                self.gas_ages = self.gas_ages.saturating_add(self.gas_codes.count());
                let RawCode::Fresh(PartCode(reading)) = code else { return };
                reading
            }
        };
        self.gas_moved |= self.gas_code != Some(code);
        self.gas_code = Some(code);
        self.gas_codes.add(code);
    }

    /// Temperature of the gas sensor \[K\] for one code.
    pub fn gas_k(&self, code: impl Into<RawCode>) -> f32 {
        self.gas.at(self.ideal(code.into()))
    }

    /// Last reading of the gas sensor; `None` before the first.
    pub fn last_gas(&self) -> Option<GasReading> {
        let code = self.gas_code.map(|code| match self.gas_part {
            None => RawCode::Adc(AdcCode(code)),
            Some(_) => RawCode::of_part(code, false),
        });
        code.map(|code| GasReading {
            value_k: self.gas_k(code),
            noise_k2: self.gas_noise_k2 / self.gas_conversions,
            moved: self.gas_moved,
            age_steps: None,
        })
    }

    /// Mean of the gas sensor's readings since the last mean; `None` without a reading.
    pub fn take_gas(&mut self) -> Option<GasReading> {
        let codes = core::mem::take(&mut self.gas_codes);
        let moved = core::mem::take(&mut self.gas_moved);
        let conversions = self.gas_conversions * f32::from(codes.count());
        let ages = f32::from(core::mem::take(&mut self.gas_ages));
        let (mean, age_steps) = match self.gas_part {
            None => (self.linearisation.mean(&codes), None),
            Some(_) => {
                let age_steps = self.gas_latency_steps + ages / f32::from(codes.count().max(1));
                (codes.mean(), Some(age_steps))
            }
        };
        mean.map(|code| GasReading {
            value_k: self.gas.at(code),
            noise_k2: self.gas_noise_k2 / conversions,
            moved,
            age_steps,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::gas::Max31865;
    use super::pressure::Mpr;
    use super::*;
    use proptest::prelude::*;

    fn sensing(sensors: Sensors) -> Sensing {
        Sensing::new(&sensors, 0.001, 101_325.0)
    }

    fn straight() -> Sensors {
        Sensors { adc: Adc { wide_code_lsb: 0.0 }, ..Sensors::default() }
    }

    /// Pressure, length and gas temperature at one code.
    fn values(sensing: &Sensing, code: AdcCode) -> [f32; 3] {
        [sensing.pressure_pa(code), sensing.length_m(code), sensing.gas_k(code)]
    }

    #[test]
    fn range_ends() {
        let sensing = sensing(straight());
        let code = |fraction: f32| AdcCode((fraction * 32768.0) as u16);
        assert!(values(&sensing, code(0.1))[0].abs() < 150.0);
        assert!((values(&sensing, code(0.9))[0] - 700_000.0).abs() < 150.0);
        // A sum of eight truncated codes: its middle lies four above it.
        let middle_pa = 700_000.0 * (f32::from(code(0.5).0 + 4) / 32768.0 - 0.1) / 0.8;
        assert!((values(&sensing, code(0.5))[0] - middle_pa).abs() < 1.0);
        assert!((values(&sensing, code(0.95))[1] - 0.4).abs() < 1e-4);
        assert!((values(&sensing, code(0.05))[2] - 270.0).abs() < 0.02);
        assert!((values(&sensing, code(0.95))[2] - 330.0).abs() < 0.02);
    }

    #[test]
    fn the_resolution_is_what_one_code_makes() {
        let sensors = straight();
        let sensing = sensing(sensors);
        let [low, high] = [0.05_f32, 0.95].map(|share| AdcCode((share * 32_768.0) as u16));
        let codes = f32::from(high.0 - low.0) / 8.0;
        let stated = [
            sensors.pressure.resolution_pa(),
            sensors.length.resolution_m(),
            sensors.gas_element.resolution_k(),
        ];
        for (i, stated) in stated.iter().enumerate() {
            let made = (values(&sensing, high)[i] - values(&sensing, low)[i]) / codes;
            assert!((stated / made - 1.0).abs() < 1e-3, "{stated} for {made}");
        }
    }

    /// Gain and offset turn a sensor's value into the true value.
    #[test]
    fn a_calibration_puts_a_sensor_right() {
        let mut sensors = straight();
        let code = AdcCode(16_000);
        let [raw_pa, raw_m, raw_k] = values(&sensing(sensors), code);
        sensors.pressure = PressureSensor { gain: 1.02, offset_pa: -900.0, ..sensors.pressure };
        sensors.length = LengthSensor { gain: 0.98, offset_m: 0.003, ..sensors.length };
        sensors.gas = GasSensor { gain: 1.01, offset_k: -2.5, ..sensors.gas };
        let [pressure_pa, length_m, gas_k] = values(&sensing(sensors), code);
        assert!((pressure_pa - (1.02 * raw_pa - 900.0)).abs() < 0.1, "{pressure_pa} of {raw_pa}");
        assert!((length_m - (0.98 * raw_m + 0.003)).abs() < 1e-6, "{length_m} of {raw_m}");
        assert!((gas_k - (1.01 * raw_k - 2.5)).abs() < 1e-3, "{gas_k} of {raw_k}");
    }

    /// The mean covers the codes since the last mean, and shows whether any of them changed.
    #[test]
    fn the_gas_is_read_as_a_mean() {
        let mut sensing = sensing(Sensors::default());
        assert_eq!(sensing.take_gas(), None);
        assert_eq!(sensing.last_gas(), None);
        for (codes, moved) in
            [(&[15_000_u16; 20][..], true), (&[15_000; 5], false), (&[15_000, 15_008], true)]
        {
            for code in codes {
                sensing.add_gas(AdcCode(*code));
            }
            let last_k = sensing.last_gas().unwrap().value_k;
            let gas = sensing.take_gas().unwrap();
            assert_eq!(gas.moved, moved, "{codes:?}");
            let variance_k2 = 0.05 * 0.05 / (8.0 * codes.len() as f32);
            assert!((gas.noise_k2 / variance_k2 - 1.0).abs() < 1e-5, "{codes:?}");
            let middle_k = 0.5 * (sensing.gas_k(AdcCode(15_000)) + last_k);
            assert!((gas.value_k - middle_k).abs() < 1e-4, "{codes:?}");
        }
    }

    fn on_parts() -> Sensors {
        Sensors {
            gas_element: GasElement::Max31865(Max31865::default()),
            pressure_part: PressurePart::Mpr(Mpr::default()),
            pressure: PressureSensor { range_pa: 250_000.0, ..PressureSensor::default() },
            ..Sensors::default()
        }
    }

    /// 120 kPa, and 8457 of 32768 parts of 430 ohm: 28.2 degC.
    fn sample_of_parts(fresh: bool) -> Sample {
        let [pressure, gas] = [15_860, 8457].map(|reading| RawCode::of_part(reading, fresh));
        Sample { pressure, gas, ..Sample::new(AdcCode(0), AdcCode(0), AdcCode(20_000)) }
    }

    #[test]
    fn a_part_is_read_by_its_data_sheet() {
        let mut sensing = sensing(on_parts());
        let sample = sample_of_parts(true);
        let pressure = sensing.read(&sample, false).pressure;
        let expected_pa = 250_000.0 * (15_860.0 / 32_768.0 - 0.1) / 0.8;
        assert!((pressure.value - expected_pa).abs() < 0.1, "{pressure:?}");
        let ohm = 430.0 * 8457.0 / 32_768.0;
        let expected_k = platinum::platinum_temperature_k(100.0, ohm);
        assert!((sensing.gas_k(sample.gas) - expected_k).abs() < 1e-3);
        assert_eq!(sensing.gas_k(sample.gas), sensing.gas_k(sample.gas.stale()));
    }

    /// A reading counts once, in the step in which it came.
    #[test]
    fn a_part_is_read_at_its_own_rate() {
        let mut sensing = sensing(on_parts());
        for step in 0..60 {
            let sample = sample_of_parts(step % 20 == 7);
            let readings = sensing.read(&sample, true);
            let pressure = if step < 7 { Validity::Suspect } else { Validity::Valid };
            assert_eq!((readings.gas, readings.pressure.validity), (Validity::Valid, pressure));
            sensing.add_gas(sample.gas);
            if step == 25 {
                let gas = sensing.take_gas().unwrap();
                // 18 steps ago, plus half of the 20 ms that the chip took, plus half a step.
                assert!(gas.moved && (gas.age_steps.unwrap() - 28.5).abs() < 1e-3, "{gas:?}");
                assert_eq!(sensing.take_gas(), None);
            }
        }
        let (mean, one) = (sensing.take_gas().unwrap(), sensing.last_gas().unwrap());
        assert!(!mean.moved && mean.value_k == one.value_k);
        assert!((one.noise_k2 / mean.noise_k2 - 2.0).abs() < 1e-5, "two of them");
        // Its step of 0.034 K hides 0.01 K.
        assert!((one.noise_k2.sqrt() - 0.051).abs() < 0.001, "{}", one.noise_k2.sqrt());
    }

    /// Steps until pressure and gas are lost when every sample is changed like this.
    fn lost_after(change: impl Fn(u32, Sample) -> Sample) -> [Option<u32>; 2] {
        let mut sensing = sensing(on_parts());
        for step in 0..100 {
            sensing.read(&sample_of_parts(step % 20 == 0), false);
        }
        let mut lost = [None; 2];
        for step in 1..=500 {
            let readings = sensing.read(&change(step, sample_of_parts(step % 20 == 1)), false);
            for (lost, validity) in lost.iter_mut().zip([readings.pressure.validity, readings.gas])
            {
                if validity == Validity::Lost {
                    lost.get_or_insert(step);
                }
            }
        }
        lost
    }

    #[test]
    fn a_part_that_is_silent_broken_or_nonsense_is_lost() {
        assert_eq!(lost_after(|_, sample| sample), [None; 2]);
        // 19 steps of silence came before the first of these.
        let silent = lost_after(|_, _| sample_of_parts(false));
        assert_eq!(silent, [Some(50 - 19), Some(100 - 19)]);
        // A broken part reads 0; the others are about 2 % from either end of the scale, 158 K and 1700 K or beyond.
        for reading in [0, 600, 32_000] {
            let nonsense = lost_after(|_, sample| Sample {
                pressure: RawCode::of_part(reading, sample.pressure.is_fresh()),
                gas: RawCode::of_part(reading, sample.gas.is_fresh()),
                ..sample
            });
            // The second in a row.
            assert_eq!(nonsense[1], Some(21), "{reading}");
            let rail = !(656..=32_111).contains(&reading);
            assert_eq!(nonsense[0], rail.then_some(21), "{reading}");
        }
        // A single one is left out.
        let once = lost_after(|step, sample| match step {
            1..=19 => Sample { gas: RawCode::of_part(0, sample.gas.is_fresh()), ..sample },
            _ => sample,
        });
        assert_eq!(once, [None; 2]);
    }

    proptest! {
        #[test]
        fn every_code_gives_a_finite_value(code in any::<u16>()) {
            for gas_element in GasElement::all() {
                let sensing = sensing(Sensors { gas_element, ..Sensors::default() });
                let values = values(&sensing, AdcCode(code));
                prop_assert!(values.iter().all(|value| value.is_finite()), "{values:?}");
            }
        }
    }
}
