//! The cycle, and its stops.

use model_core::Config;
use model_core::physics::chamber::{AnyChamber, Chamber, ChamberConfig};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use std::ops::Range;
use thermyo_scenario::DriveKind;
use thermyo_setup::Loaded;

const HIGHEST_PA: f64 = 4.0e5;
/// Used fraction of the supply, and of the pressure at which the supervisor vents \[-\].
const SUPPLY_SHARE: f64 = 0.85;
const LIMIT_SHARE: f64 = 0.9;
/// Lowest pressure above ambient, as a fraction of the highest: below it a valve passes little.
const LOW_SHARE: f64 = 0.1;
/// Least swing of the pressure that warms the gas enough to be measured \[Pa\].
const LEAST_SWING_PA: f64 = 0.4e5;
/// Cycling before the first stop \[s\], and between stops \[periods\], in which the estimate
/// settles.
const FIRST_S: f64 = 20.0;
const BETWEEN: f64 = 2.0;
/// Wait, in time constants of gas and sensor.
const SETTLED: f64 = 4.0;
/// Heat transfer of air at rest in a thin muscle, the smallest for which the wait allows \[W/(m2
/// K)\]: conduction in a cylinder of 20 mm, Nu = 5.8 k/D, gives 7.5.
const LEAST_W_M2_K: f64 = 6.0;
/// Shortest and longest default of the wait \[s\].
const WAITS_S: [f64; 2] = [10.0, 300.0];

/// Default period of the cycle \[s\], and number of stops.
const PERIOD_S: f64 = 5.0;
const STOPS: usize = 8;

/// The user's wishes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Asked {
    pub stops: usize,
    /// Wait; by default from the lags of gas and sensor \[s\].
    pub wait_s: Option<f64>,
    pub period_s: f64,
    /// Highest pressure; by default 4 bar, or less if supply or limit are lower \[Pa\].
    pub highest_pa: Option<f64>,
    pub seed: u64,
}

impl Asked {
    /// The usual stops, up to a pressure \[Pa\].
    pub fn usual(highest_pa: f64) -> Self {
        let highest_pa = Some(highest_pa);
        Self { stops: STOPS, wait_s: None, period_s: PERIOD_S, highest_pa, seed: 1 }
    }
}

/// Reason why no stop can be measured.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Refusal {
    #[error(
        "plant.kind = \"vessel\": a stop is measured on a chamber with a length sensor and two valves"
    )]
    Vessel,
    #[error(
        "a swing from {:.0} to {:.0} kPa warms the gas too little: at least {:.0} kPa are needed. The highest \
         pressure is what --max-pressure, the armed limit, 85 % of the supply and 90 % of the sensor's limit leave",
        low_pa / 1e3, high_pa / 1e3, LEAST_SWING_PA / 1e3
    )]
    NoSwing { low_pa: f64, high_pa: f64 },
}

#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    pub driven: Loaded,
    pub seed: u64,
    pub period_s: f64,
    pub wait_s: f64,
    /// Lowest and highest set point \[Pa\].
    pub pressures_pa: [f64; 2],
    pub stops: usize,
}

impl Plan {
    /// A plan for a board with this configuration, armed up to `armed_pa` if it is armed already.
    pub fn new(
        loaded: &Loaded,
        config: &Config,
        asked: &Asked,
        armed_pa: Option<f32>,
    ) -> Result<Self, Refusal> {
        if matches!(config.chamber, ChamberConfig::Vessel(_)) {
            return Err(Refusal::Vessel);
        }
        let pressures_pa = pressures_pa(config, asked.highest_pa, armed_pa)?;
        let wait_s = asked.wait_s.unwrap_or_else(|| wait_s(config, pressures_pa[1]));
        let mut cycle = Cycle::new(pressures_pa, asked.period_s);
        let mut shut_s: Vec<Range<f64>> = Vec::new();
        cycle.go((FIRST_S / asked.period_s).ceil() * asked.period_s);
        for phase in phases(asked.stops, asked.seed) {
            let whole = (cycle.moved_s / asked.period_s).ceil() + BETWEEN;
            cycle.go((whole + phase) * asked.period_s - cycle.moved_s);
            shut_s.push(cycle.end_s()..cycle.end_s() + wait_s);
            cycle.rest(wait_s);
        }
        let mut driven = loaded.driven(DriveKind::Pressure, cycle.points);
        driven.shut_s = shut_s;
        Ok(Self {
            driven,
            seed: asked.seed,
            period_s: asked.period_s,
            wait_s,
            pressures_pa,
            stops: asked.stops,
        })
    }
}

fn pressures_pa(
    config: &Config,
    asked_pa: Option<f64>,
    armed_pa: Option<f32>,
) -> Result<[f64; 2], Refusal> {
    let ambient_pa = f64::from(config.ambient.pressure_pa);
    let most_pa = (SUPPLY_SHARE * f64::from(config.supply.pressure_pa))
        .min(LIMIT_SHARE * f64::from(config.pressure_limit_pa))
        .min(armed_pa.map_or(f64::INFINITY, f64::from));
    let high_pa = asked_pa.unwrap_or(HIGHEST_PA).min(most_pa);
    let low_pa = ambient_pa + LOW_SHARE * (high_pa - ambient_pa);
    if high_pa - low_pa < LEAST_SWING_PA {
        return Err(Refusal::NoSwing { low_pa, high_pa });
    }
    Ok([low_pa, high_pa])
}

/// The default of the wait: gas and sensor settle one after the other \[s\].
fn wait_s(config: &Config, pressure_pa: f64) -> f64 {
    let chamber = AnyChamber::new(&config.chamber);
    let rest_m = chamber.rest_length_m();
    let depth_m = f64::from(chamber.volume_m3(rest_m)) / f64::from(chamber.surface_m2(rest_m));
    let gas = &config.gas;
    let density = pressure_pa
        / (f64::from(gas.gas_constant_j_kg_k) * f64::from(config.ambient.temperature_k));
    let gas_s = density * f64::from(gas.cp_j_kg_k()) * depth_m / LEAST_W_M2_K;
    let sensor = &config.sensors.gas;
    let sensor_s = f64::from(sensor.time_constant_s) + f64::from(sensor.housing_time_constant_s);
    (SETTLED * (gas_s + sensor_s)).ceil().clamp(WAITS_S[0], WAITS_S[1])
}

/// Random phases of the cycle, one in each of `count` equal parts of it, in random order.
fn phases(count: usize, seed: u64) -> Vec<f64> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    // 53 bits, the precision of an f64.
    let mut uniform = move || (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
    let mut phases: Vec<f64> =
        (0..count).map(|part| (part as f64 + uniform()) / count as f64).collect();
    for last in (1..count).rev() {
        phases.swap(last, (uniform() * (last + 1) as f64) as usize);
    }
    phases
}

/// A triangle of the pressure, which pauses at stops.
struct Cycle {
    pressures_pa: [f64; 2],
    period_s: f64,
    moved_s: f64,
    points: Vec<(f64, f64)>,
}

impl Cycle {
    fn new(pressures_pa: [f64; 2], period_s: f64) -> Self {
        Self { pressures_pa, period_s, moved_s: 0.0, points: vec![(0.0, pressures_pa[0])] }
    }

    fn end_s(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.0)
    }

    fn value_pa(&self, moved_s: f64) -> f64 {
        let phase = (moved_s / self.period_s + 1e-9).fract();
        let [low_pa, high_pa] = self.pressures_pa;
        low_pa + (high_pa - low_pa) * (1.0 - (2.0 * phase - 1.0).abs())
    }

    /// Moves on for a time, adding a point at each turn.
    fn go(&mut self, duration_s: f64) {
        let begin_s = self.end_s();
        let (from_s, to_s) = (self.moved_s, self.moved_s + duration_s);
        let half_s = 0.5 * self.period_s;
        let first = (from_s / half_s + 1e-9).floor() as u64 + 1;
        let turns = (first..).map(|turn| turn as f64 * half_s);
        let turns = turns.take_while(|turn_s| *turn_s < to_s - 1e-6 * half_s);
        let times: Vec<f64> = turns.chain([to_s]).collect();
        for time_s in times {
            self.points.push((begin_s + time_s - from_s, self.value_pa(time_s)));
        }
        self.moved_s = to_s;
    }

    fn rest(&mut self, duration_s: f64) {
        self.points.push((self.end_s() + duration_s, self.value_pa(self.moved_s)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use thermyo_setup::core_config::core_config;

    fn planned(text: &str, asked: &Asked, armed_pa: Option<f32>) -> Result<Plan, Refusal> {
        let loaded = thermyo_setup::parse(text, "test".as_ref()).unwrap();
        Plan::new(&loaded, &core_config(&loaded.believed), asked, armed_pa)
    }

    fn usual() -> Asked {
        Asked { highest_pa: None, ..Asked::usual(0.0) }
    }

    #[test]
    fn the_stops_are_at_phases_all_over_the_cycle_and_never_above_what_is_armed() {
        let plan = planned("", &usual(), Some(2.5e5)).unwrap();
        let profile = plan.driven.drive_profile.as_ref().unwrap();
        assert!(profile.points().iter().all(|(_, pa)| (1.1e5..=2.5e5).contains(pa)));
        assert_eq!(plan.driven.shut_s.len(), 8);
        let mut stopped: Vec<f64> =
            plan.driven.shut_s.iter().map(|shut_s| profile.value(shut_s.start)).collect();
        for (shut_s, pa) in plan.driven.shut_s.iter().zip(&stopped) {
            assert!((profile.value(shut_s.end) - pa).abs() < 1.0, "the cycle pauses");
            assert!((20.0..60.0).contains(&(shut_s.end - shut_s.start)), "{shut_s:?}");
        }
        stopped.sort_by(f64::total_cmp);
        assert!(stopped[7] - stopped[0] > 0.6e5, "{stopped:?}");
        let other = planned("", &Asked { seed: 2, ..usual() }, Some(2.5e5)).unwrap();
        assert_ne!(plan.driven.shut_s, other.driven.shut_s);
    }

    #[test]
    fn what_cannot_be_measured_is_refused() {
        let low = planned("[supply]\npressure_pa = 1.4e5\n", &usual(), None).unwrap_err();
        assert!(low.to_string().contains("warms the gas too little"), "{low}");
        let vessel = "[plant]\nkind = \"vessel\"\n[drive]\nkind = \"closed\"\n";
        assert_eq!(planned(vessel, &usual(), None).unwrap_err(), Refusal::Vessel);
    }
}
