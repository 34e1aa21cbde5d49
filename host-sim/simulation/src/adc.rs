//! The virtual analog front end and the RP2040's ADC: from the sensing elements to raw codes.
//!
//! Every channel is ratiometric to the ADC's reference, which therefore cancels. A code is the sum
//! of [`OVERSAMPLING`] conversions of 12 bit, 0 to 32760.
//!
//! | channel | fraction of the reference |
//! |---|---|
//! | pressure | 0.1 + 0.8 P / range |
//! | length | 0.05 + 0.9 L / range |
//! | gas temperature | [`elements::gas_share`] |
//!
//! A sensor chip converts by itself every [`MAX31865_S`] or [`MPR_S`], averaging over that time.
//! Its code is its last reading, marked as new in the step in which it arrives.

use crate::elements;
use crate::noise::standard_normal;
use model_core::{AdcCode, RawCode, Sample};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use thermyo_plant::Truth;
use thermyo_scenario::{GasElementKind, PressureKind, Scenario, Sensors};

/// Conversions per code.
pub const OVERSAMPLING: u16 = 8;

/// Highest code of one conversion \[LSB\].
const FULL_SCALE: f64 = 4095.0;
/// Codes of the reference \[LSB\].
const STEPS: f64 = 4096.0;
/// Noise of the RP2040's converter itself, one conversion, standard deviation \[LSB\].
const CONVERTER_NOISE_LSB: f64 = 0.5;

/// Codes that erratum RP2040-E11 makes too wide (RP2040 datasheet, appendix B).
const WIDE_CODES: [f64; 4] = [512.0, 1536.0, 2560.0, 3584.0];

/// Conversion period of a MAX31865 with the filter for 50 Hz \[s\].
pub const MAX31865_S: f64 = 0.02;
/// Period of an MPR: 5 ms of conversion and the bus transfer \[s\].
pub const MPR_S: f64 = 0.006;
/// Codes of a sensor chip's scale.
const PART_CODES: f64 = 32_768.0;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Codes {
    pub pressure: RawCode,
    pub gas: RawCode,
    pub length: AdcCode,
}

impl From<Codes> for Sample {
    fn from(Codes { pressure, gas, length }: Codes) -> Self {
        Self { pressure, gas, ..Self::new(AdcCode(0), AdcCode(0), length) }
    }
}

/// Mean code of a conversion \[LSB\] for an ideal input \[LSB\], both 0 to 4095: the transfer
/// curve with erratum E11, offset and gain trimmed at the ends. Four codes are wider by
/// `excess_lsb` each, 8.9 on the RP2040 and 0 elsewhere; between them the curve is steeper to
/// compensate.
pub fn e11_transfer(input_lsb: f64, excess_lsb: f64) -> f64 {
    let slope = FULL_SCALE / (FULL_SCALE - WIDE_CODES.len() as f64 * excess_lsb);
    let mut swallowed = 0.0;
    for (i, code) in WIDE_CODES.iter().enumerate() {
        let start = code / slope + i as f64 * excess_lsb;
        swallowed += (input_lsb - start).clamp(0.0, excess_lsb);
    }
    (input_lsb - swallowed) * slope
}

#[derive(Debug, Clone)]
struct Noise(Xoshiro256PlusPlus);

impl Noise {
    fn sample(&mut self, deviation: f64) -> f64 {
        deviation * standard_normal(&mut self.0)
    }
}

/// One channel with a noise source of its own, so that adding a channel changes no other.
#[derive(Debug, Clone)]
struct Channel {
    noise: Noise,
    /// Deviation of the sensor's noise in a sum of conversions \[unit of the sensor\].
    sensor: f64,
    /// Deviation of the converter's noise in a sum of conversions, as a fraction of the reference.
    converter: f64,
    error: SensorError,
    part: Option<Part>,
}

#[derive(Debug, Clone)]
struct Part {
    period_s: f64,
    next_s: f64,
    reading: u16,
    /// Sum and number of its inputs since the conversion began.
    exposed: (f64, f64),
}

impl Part {
    fn every(period_s: f64) -> Self {
        Self { period_s, next_s: 0.0, reading: 0, exposed: (0.0, 0.0) }
    }

    /// Adds an input to the mean of the conversion.
    fn mean(&mut self, value: f64) -> f64 {
        self.exposed = (self.exposed.0 + value, self.exposed.1 + 1.0);
        self.exposed.0 / self.exposed.1
    }

    /// The code at this time for a fraction of the chip's scale: 0 at either end, where the chip
    /// reports a fault.
    fn code(&mut self, time_s: f64, share: f64) -> RawCode {
        // Times are sums of steps, hence the tolerance.
        let fresh = time_s > self.next_s - 1.0e-6;
        if fresh {
            let code = PART_CODES * share;
            self.exposed = (0.0, 0.0);
            self.reading =
                if (0.5..PART_CODES - 1.5).contains(&code) { code.round() as u16 } else { 0 };
            while self.next_s < time_s + 1.0e-6 {
                self.next_s += self.period_s;
            }
        }
        RawCode::of_part(self.reading, fresh)
    }
}

/// A sensor error that calibration removes: value = gain (reading + correction) + offset.
#[derive(Debug, Clone, Copy)]
struct SensorError {
    gain: f64,
    offset: f64,
    /// (reading, reading + correction) at the quarters of the range.
    quarters: [[f64; 2]; 5],
}

impl SensorError {
    fn new([gain, offset]: [f64; 2], range: f64, [quarter, half, three]: [f64; 3]) -> Self {
        let quarters = [(0.0, 0.0), (0.25, quarter), (0.5, half), (0.75, three), (1.0, 0.0)]
            .map(|(place, correction)| [range * place, range * (place + correction)]);
        Self { gain, offset, quarters }
    }

    /// The sensor's reading of a value.
    fn reading(&self, value: f64) -> f64 {
        let corrected = (value - self.offset) / self.gain;
        let between = self.quarters.windows(2).find(|pair| {
            let [_, low] = pair[0];
            let [_, high] = pair[1];
            (low..high).contains(&corrected)
        });
        match between {
            Some(&[[low, from], [high, to]]) => {
                low + (corrected - from) / (to - from) * (high - low)
            }
            // There is no correction outside the range.
            _ => corrected,
        }
    }
}

impl Channel {
    fn new(noise: Noise, per_conversion: f64, error: SensorError, part: Option<Part>) -> Self {
        let averaging = f64::from(OVERSAMPLING).sqrt();
        Self {
            noise,
            sensor: if part.is_some() { per_conversion } else { per_conversion / averaging },
            part,
            converter: CONVERTER_NOISE_LSB / FULL_SCALE / averaging,
            error,
        }
    }

    /// A value, or for a sensor chip its mean, with the sensor's noise.
    fn sense(&mut self, value: f64) -> f64 {
        let value = self.part.as_mut().map_or(value, |part| part.mean(value));
        value + self.noise.sample(self.sensor)
    }

    /// The code for a fraction of the reference, with wide codes of `excess_lsb`, or a sensor
    /// chip's code.
    fn convert(&mut self, time_s: f64, share: f64, excess_lsb: f64) -> RawCode {
        match &mut self.part {
            Some(part) => part.code(time_s, share),
            None => self.sum(share, excess_lsb).into(),
        }
    }

    /// The converter's code.
    fn sum(&mut self, share: f64, excess_lsb: f64) -> AdcCode {
        let noisy = share + self.noise.sample(self.converter);
        // A conversion truncates: averaged over the noise of eight, the mean lies half a code below
        // the input.
        let mean = e11_transfer(STEPS * noisy - 0.5, excess_lsb).clamp(0.0, FULL_SCALE);
        AdcCode((f64::from(OVERSAMPLING) * mean).round() as u16)
    }
}

/// The board's sensor electronics and ADC.
#[derive(Debug, Clone)]
pub struct VirtualAdc {
    pressure: Channel,
    gas: Channel,
    length: Channel,
    wall: Noise,
    wall_noise_k: f64,
    wide_code_lsb: f64,
    sensors: Sensors,
    gas_reading_k: f64,
    wall_reading_k: f64,
}

impl VirtualAdc {
    /// The front end of a scenario, seeded by `run.seed`.
    pub fn new(scenario: &Scenario) -> Self {
        let sensor = &scenario.sensor;
        let mut generator = Xoshiro256PlusPlus::seed_from_u64(scenario.run.seed);
        let mut stream = || {
            generator.jump();
            Noise(generator.clone())
        };
        let on_i2c = sensor.pressure.kind == PressureKind::Mpr;
        let on_spi = sensor.gas.kind == GasElementKind::Max31865;
        Self {
            pressure: Channel::new(
                stream(),
                sensor.pressure.noise_pa,
                SensorError::new(
                    [sensor.pressure.gain, sensor.pressure.offset_pa],
                    sensor.pressure.range_pa,
                    [
                        sensor.pressure.correction_25,
                        sensor.pressure.correction_50,
                        sensor.pressure.correction_75,
                    ],
                ),
                on_i2c.then(|| Part::every(MPR_S)),
            ),
            gas: Channel::new(
                stream(),
                sensor.gas.noise_k,
                SensorError::new([sensor.gas.gain, sensor.gas.offset_k], 1.0, [0.0; 3]),
                on_spi.then(|| Part::every(MAX31865_S)),
            ),
            length: Channel::new(
                stream(),
                sensor.length.noise_m,
                SensorError::new(
                    [sensor.length.gain, sensor.length.offset_m],
                    sensor.length.range_m,
                    [
                        sensor.length.correction_25,
                        sensor.length.correction_50,
                        sensor.length.correction_75,
                    ],
                ),
                None,
            ),
            wall: stream(),
            wall_noise_k: sensor.wall.noise_k,
            wide_code_lsb: scenario.adc.wide_code_lsb,
            sensors: sensor.clone(),
            gas_reading_k: scenario.plant.gas_k(),
            wall_reading_k: scenario.plant.initial_temperature_k,
        }
    }

    pub fn convert(&mut self, truth: &Truth) -> Codes {
        let pressure = self.pressure.sense(truth.sensor_pressure_pa);
        let length = self.length.sense(truth.sensor_length_m);
        self.gas_reading_k = self.gas.sense(truth.sensor_gas_k);
        self.wall_reading_k = truth.sensor_wall_k + self.wall.sample(self.wall_noise_k);
        let gas_k = self.gas.error.reading(self.gas_reading_k);
        let gas_share = elements::gas_share(&self.sensors, gas_k);
        let pressure_share = self.pressure.error.reading(pressure) / self.sensors.pressure.range_pa;
        let length_share = self.length.error.reading(length) / self.sensors.length.range_m;
        let (time_s, wide) = (truth.time_s, self.wide_code_lsb);
        Codes {
            pressure: self.pressure.convert(time_s, 0.1 + 0.8 * pressure_share, wide),
            gas: self.gas.convert(time_s, gas_share, wide),
            length: self.length.sum(0.05 + 0.9 * length_share, wide),
        }
    }

    /// The gas sensor's reading at the last conversion, noise included \[K\].
    pub fn gas_reading_k(&self) -> f64 {
        self.gas_reading_k
    }

    /// The wall sensor's reading at the last conversion, noise included \[K\].
    pub fn wall_reading_k(&self) -> f64 {
        self.wall_reading_k
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use thermyo_compute::math;
    use thermyo_setup::core_config::core_config;

    const RP2040_LSB: f64 = 8.9;

    fn truth() -> Truth {
        Truth {
            sensor_pressure_pa: 350_000.0,
            sensor_length_m: 0.2,
            sensor_gas_k: 300.0,
            sensor_wall_k: 305.0,
            ..Truth::default()
        }
    }

    #[test]
    fn e11_widens_four_codes_only() {
        // Code densities of a fine ramp.
        const PER_LSB: u32 = 100;
        let mut hits = vec![0u32; 4096];
        for i in 0..=4095 * PER_LSB {
            hits[e11_transfer(f64::from(i) / f64::from(PER_LSB), RP2040_LSB).round() as usize] += 1;
        }
        for (code, &count) in hits.iter().enumerate().take(4095).skip(1) {
            let dnl = f64::from(count) / f64::from(PER_LSB) - 1.0;
            if WIDE_CODES.contains(&(code as f64)) {
                assert!((8.0..10.0).contains(&dnl), "code {code}: DNL {dnl}");
            } else {
                assert!(dnl.abs() < 0.05, "code {code}: DNL {dnl}");
            }
        }
        assert_eq!(e11_transfer(0.0, RP2040_LSB), 0.0);
        assert!((e11_transfer(4095.0, RP2040_LSB) - 4095.0).abs() < 1e-9);
        assert_eq!(e11_transfer(1234.5, 0.0), 1234.5, "a converter without it");
        let worst = (0..=4095)
            .map(|x| (e11_transfer(f64::from(x), RP2040_LSB) - f64::from(x)).abs())
            .fold(0.0, f64::max);
        assert!((3.0..7.0).contains(&worst), "INL {worst} LSB");
    }

    #[test]
    fn quiet_codes_are_the_ratiometric_ones() {
        let mut scenario = Scenario::default();
        scenario.sensor.pressure.noise_pa = 0.0;
        scenario.sensor.length.noise_m = 0.0;
        scenario.sensor.gas.noise_k = 0.0;
        let codes = VirtualAdc::new(&scenario).convert(&truth());
        // Half of the pressure range and half of the travel each give half of the reference.
        for (code, share) in [(codes.pressure.to_bits(), 0.5), (codes.length.0, 0.5)] {
            let expected = 8.0 * e11_transfer(share * 4096.0 - 0.5, RP2040_LSB);
            assert!((f64::from(code) - expected).abs() < 8.0, "{code} for {expected}");
        }
        // 300 K is in the middle of 270 to 330 K; the bridge bends by less than 2 %.
        assert!((f64::from(codes.gas.adc().0) / 32760.0 - 0.5).abs() < 0.02);
    }

    /// The core corrects the sensor's errors at any pressure and length.
    #[test]
    fn the_core_corrects_what_the_sensor_bends() {
        let mut scenario = Scenario::default();
        let sensor = &mut scenario.sensor;
        (sensor.pressure.gain, sensor.pressure.offset_pa) = (1.03, -2000.0);
        (sensor.pressure.correction_25, sensor.pressure.correction_75) = (0.03, -0.02);
        (sensor.length.correction_50, sensor.length.offset_m) = (-0.04, 0.002);
        (sensor.pressure.noise_pa, sensor.length.noise_m) = (0.0, 0.0);
        scenario.adc.wide_code_lsb = 0.0;
        let mut adc = VirtualAdc::new(&scenario);
        let sensing = core_config(&scenario).sensing();
        let straight = core_config(&Scenario::default()).sensing();
        let mut bent_pa: f64 = 0.0;
        for i in 1..50 {
            let share = f64::from(i) / 50.0;
            let (pressure_pa, length_m) = (690_000.0 * share, 0.39 * share);
            let codes = adc.convert(&Truth {
                sensor_pressure_pa: pressure_pa,
                sensor_length_m: length_m,
                ..truth()
            });
            let read_pa = f64::from(sensing.pressure_pa(codes.pressure));
            let read_m = f64::from(sensing.length_m(codes.length));
            // A code of 12 bit is 214 Pa and 0.11 mm; the converter has its noise.
            assert!((read_pa - pressure_pa).abs() < 214.0, "{read_pa} for {pressure_pa}");
            assert!((read_m - length_m).abs() < 1.1e-4, "{read_m} for {length_m}");
            let off_pa = f64::from(straight.pressure_pa(codes.pressure)) - pressure_pa;
            bent_pa = bent_pa.max(off_pa.abs());
        }
        assert!((15_000.0..40_000.0).contains(&bent_pa), "{bent_pa}");
    }

    #[test]
    fn clamps_at_the_rails() {
        let mut adc = VirtualAdc::new(&Scenario::default());
        let far = Truth {
            sensor_pressure_pa: 2e6,
            sensor_length_m: -1.0,
            sensor_gas_k: 500.0,
            ..truth()
        };
        let top = AdcCode(32_760).into();
        assert_eq!(adc.convert(&far), Codes { pressure: top, gas: top, length: AdcCode(0) });
        for (kelvin, rail) in [(-1000.0, 0), (1.0e5, 32760)] {
            assert_eq!(adc.convert(&Truth { sensor_gas_k: kelvin, ..truth() }).gas.adc().0, rail);
        }
    }

    #[test]
    fn noise_has_the_stated_deviation_and_repeats() {
        let scenario = Scenario::default();
        let mut adc = VirtualAdc::new(&scenario);
        let mut again = VirtualAdc::new(&scenario);
        let (mut sum, mut square, mut wall) = (0.0, 0.0, 0.0);
        let n = 20_000;
        for _ in 0..n {
            let codes = adc.convert(&truth());
            assert_eq!(codes, again.convert(&truth()));
            let code = f64::from(codes.pressure.to_bits());
            sum += code;
            square += code * code;
            let off = adc.wall_reading_k() - 305.0;
            wall += off * off;
        }
        let mean = sum / f64::from(n);
        let deviation = (square / f64::from(n) - mean * mean).sqrt();
        let averaging = 8.0f64.sqrt();
        let sensor = 150.0 * 0.8 / 700_000.0 * 32768.0 / averaging;
        let converter = 0.5 * 8.0 / averaging;
        let expected = 1.0091 * math::hypot(sensor, converter);
        assert!((deviation / expected - 1.0).abs() < 0.03, "{deviation} for {expected}");
        assert!(((wall / f64::from(n)).sqrt() / 0.05 - 1.0).abs() < 0.03);
    }

    #[test]
    fn channels_do_not_share_their_noise() {
        let mut scenario = Scenario::default();
        let mut adc = VirtualAdc::new(&scenario);
        scenario.sensor.gas.noise_k = 1.0;
        let mut other = VirtualAdc::new(&scenario);
        for _ in 0..100 {
            let (a, b) = (adc.convert(&truth()), other.convert(&truth()));
            assert_eq!((a.pressure, a.length), (b.pressure, b.length));
        }
    }
}
