//! Broken lines between sensors and ADC, as `[faults]` asks for them.

use crate::adc::Codes;
use crate::scenario::{ChannelFault, Faults, Scenario};
use model_core::sample::CODE_MAX;
use model_core::{AdcCode, Sample};
use rand_distr::{Distribution, Uniform};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;

/// Half of the noise band on a noisy line: 5 % of the range.
const NOISE: i32 = CODE_MAX as i32 / 20;

/// The three analog lines.
#[derive(Debug, Clone)]
pub struct FaultyLines {
    faults: Faults,
    /// Codes of the last healthy step.
    healthy: Codes,
    generator: Xoshiro256PlusPlus,
    noise: Uniform<i32>,
}

impl FaultyLines {
    /// Lines with the faults of a scenario.
    pub fn new(scenario: &Scenario) -> Self {
        Self {
            faults: scenario.faults.clone(),
            healthy: Codes::default(),
            // Another seed than the ADC's: a fault changes no noise but its own.
            generator: Xoshiro256PlusPlus::seed_from_u64(!scenario.run.seed),
            noise: Uniform::new_inclusive(-NOISE, NOISE).expect("the band is not empty"),
        }
    }

    /// What arrives at the core.
    pub fn apply(&mut self, time_s: f64, codes: Codes) -> Sample {
        let mut arriving = codes;
        if (self.faults.from_s..self.faults.until_s).contains(&time_s) {
            let faults = self.faults.clone();
            arriving.pressure = self.line(faults.pressure, codes.pressure, self.healthy.pressure);
            arriving.gas = self.line(faults.gas, codes.gas, self.healthy.gas);
            arriving.length = self.line(faults.length, codes.length, self.healthy.length);
        } else {
            self.healthy = codes;
        }
        Sample::new(AdcCode(arriving.pressure), AdcCode(arriving.gas), AdcCode(arriving.length))
    }

    fn line(&mut self, fault: ChannelFault, code: u16, healthy: u16) -> u16 {
        match fault {
            ChannelFault::None => code,
            ChannelFault::Open => CODE_MAX,
            ChannelFault::Shorted => 0,
            ChannelFault::Frozen => healthy,
            ChannelFault::Noisy => {
                let noisy = i32::from(code) + self.noise.sample(&mut self.generator);
                noisy.clamp(0, i32::from(CODE_MAX)) as u16
            }
        }
    }
}
