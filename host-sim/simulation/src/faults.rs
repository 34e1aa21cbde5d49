//! Faults of `[faults]` and `[faults.NAME]` over time, in sensors, their channels, the board's
//! inputs, and the plant.

use crate::adc::Codes;
use model_core::sample::CODE_MAX;
use model_core::{AdcCode, PartCode, RawCode, Sample};
use rand_distr::{Distribution, Uniform};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::SeedableRng;
use thermyo_plant::{Disturbance, Travel, Truth};
use thermyo_scenario::{ChannelFault, FaultWindow, LinkFault, Scenario, ValveFault};

/// Half of the noise band on a noisy channel: 5 % of the range.
const NOISE: i32 = CODE_MAX as i32 / 20;

/// The faults of a run.
#[derive(Debug, Clone)]
pub struct InjectedFaults {
    windows: Vec<FaultWindow>,
    step_s: f64,
    arrived: Codes,
    generator: Xoshiro256PlusPlus,
    noise: Uniform<i32>,
}

impl InjectedFaults {
    pub fn new(scenario: &Scenario) -> Self {
        let unbroken = FaultWindow::default();
        let windows = scenario.faults.windows().map(|(_, window)| window.clone());
        Self {
            windows: windows.filter(|window| *window != unbroken).collect(),
            arrived: Codes::default(),
            step_s: scenario.run.step_s,
            // A seed other than the ADC's, so that a fault changes no noise but its own.
            generator: Xoshiro256PlusPlus::seed_from_u64(!scenario.run.seed),
            noise: Uniform::new_inclusive(-NOISE, NOISE).expect("the band is not empty"),
        }
    }

    /// Input of the front end: the true values, with the drift of drifting sensors.
    pub fn sensed(&self, truth: &Truth) -> Truth {
        let mut sensed = *truth;
        for window in self.active(truth.time_s) {
            let elapsed_s = truth.time_s - window.from_s;
            for (fault, rate_per_s, reading) in [
                (window.pressure, window.pressure_drift_pa_s, &mut sensed.sensor_pressure_pa),
                (window.gas, window.gas_drift_k_s, &mut sensed.sensor_gas_k),
                (window.length, window.length_drift_m_s, &mut sensed.sensor_length_m),
            ] {
                if fault == ChannelFault::Drifting {
                    *reading += rate_per_s.unwrap_or_default() * elapsed_s;
                }
            }
        }
        sensed
    }

    pub fn apply(&mut self, time_s: f64, codes: Codes) -> Sample {
        let of = |line: fn(&FaultWindow) -> ChannelFault| {
            let mut faults = self.active(time_s).map(line);
            faults.find(|fault| *fault != ChannelFault::None).unwrap_or(ChannelFault::None)
        };
        let (pressure, gas, length) = (of(|w| w.pressure), of(|w| w.gas), of(|w| w.length));
        let emergency_stop = self.active(time_s).any(|window| window.emergency_stop);
        self.arrived = Codes {
            pressure: self.line(pressure, codes.pressure, self.arrived.pressure),
            gas: self.line(gas, codes.gas, self.arrived.gas),
            length: self.analog(length, codes.length, self.arrived.length),
        };
        let on_link = |fault| self.active(time_s).any(|window| window.link == fault);
        let missed = self.windows.iter().map(|w| w.missed_steps_at(time_s, self.step_s));
        Sample {
            emergency_stop,
            heard: !on_link(LinkFault::Lost),
            flooded: on_link(LinkFault::Flooded),
            missed_steps: missed.max().unwrap_or_default(),
            ..self.arrived.into()
        }
    }

    /// Faults of the plant during the step that starts at this time \[s\].
    pub fn disturbance(&self, time_s: f64) -> Disturbance {
        let mut disturbance = Disturbance::default();
        for window in self.active(time_s) {
            for (travel, fault, leak) in [
                (&mut disturbance.inlet, window.inlet, window.inlet_leak),
                (&mut disturbance.outlet, window.outlet, window.outlet_leak),
            ] {
                match fault {
                    ValveFault::None => {}
                    ValveFault::Open => *travel = Travel { shut: 1.0, open: 1.0 },
                    ValveFault::Shut => *travel = Travel { shut: 0.0, open: 0.0 },
                    ValveFault::Leaking => travel.shut = leak.unwrap_or_default(),
                }
            }
            disturbance.leak_m3_s_pa += window.leak_conductance_m3_s_pa;
            disturbance.supply_pa = window.supply_pressure_pa.or(disturbance.supply_pa);
        }
        disturbance
    }

    /// Whether the board restarts before the step at this time \[s\].
    pub fn board_restarts(&self, time_s: f64) -> bool {
        let mut restarting = self.windows.iter().filter(|window| window.board_restart);
        restarting.any(|window| window.starts_at(time_s, self.step_s))
    }

    fn active(&self, time_s: f64) -> impl Iterator<Item = &FaultWindow> {
        self.windows.iter().filter(move |window| window.contains(time_s))
    }

    /// Applies a fault to the code. An open or shorted sensor chip reports a fault, a frozen one is
    /// silent.
    fn line(&mut self, fault: ChannelFault, code: RawCode, arrived: RawCode) -> RawCode {
        let (PartCode(reading), fresh) = match code {
            RawCode::Adc(code) => return self.analog(fault, code, arrived.adc()).into(),
            RawCode::Fresh(reading) => (reading, true),
            RawCode::Stale(reading) => (reading, false),
        };
        match fault {
            // The drift is already in the code.
            ChannelFault::None | ChannelFault::Drifting => code,
            ChannelFault::Open | ChannelFault::Shorted => RawCode::of_part(0, fresh),
            ChannelFault::Frozen => arrived.stale(),
            ChannelFault::Noisy => RawCode::of_part(self.noisy(reading), fresh),
        }
    }

    fn analog(&mut self, fault: ChannelFault, code: AdcCode, arrived: AdcCode) -> AdcCode {
        match fault {
            // The drift is already in the code.
            ChannelFault::None | ChannelFault::Drifting => code,
            ChannelFault::Open => AdcCode(CODE_MAX),
            ChannelFault::Shorted => AdcCode(0),
            ChannelFault::Frozen => arrived,
            ChannelFault::Noisy => AdcCode(self.noisy(code.0)),
        }
    }

    fn noisy(&mut self, code: u16) -> u16 {
        let noisy = i32::from(code) + self.noise.sample(&mut self.generator);
        noisy.clamp(0, i32::from(CODE_MAX)) as u16
    }
}
