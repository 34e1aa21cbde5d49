//! The core's model of gas, wall and sensor in f64, one step and one interval at a time.
//!
//! Pressure and length are inputs, smoothed; the state moves by the energy balance (3), (4):
//!
//! ```text
//! dm_l  = leaked mass by ISO 6358 at P, T
//! H     = (V dP + k P dV)/(k-1) + s h A (T - T_w) dt + cp T dm_l      enthalpy through the valves
//! dm    = H/(cp T_in) inwards, H/(cp T) outwards, 0 while both valves are shut; less dm_l
//! T     = P V/(m R)                                       (1)
//! T_w'  = (s h A (T - T_w) + friction - h_o A (T_w - T_ambient))/C_w
//! T_h'  = (T - T_h)/tau_h,  T_s' = (T_h - T_s)/tau
//! ```

use model_core::Config;
use model_core::physics::chamber::{AnyChamber, Chamber};
use model_core::physics::heat::Heat;
use model_core::physics::hysteresis::{Held, Law};
use nalgebra::{SMatrix, SVector};
use thermyo_plant::flow::Iso6358;
use thermyo_plant::gas::IdealGas;
use thermyo_scenario::Gas;

/// ln m, T_w, T_h, T_s, ln s, ln(tau/configured).
pub const STATES: usize = 6;
pub const MASS: usize = 0;
/// Wall temperature \[K\].
pub const WALL: usize = 1;
/// Temperature of the sensor's housing \[K\].
pub const HOUSING: usize = 2;
/// Temperature of the sensor's element \[K\].
pub const SENSOR: usize = 3;
/// Logarithm of the scale of the heat transfer gas to wall.
pub const SCALE: usize = 4;
/// Logarithm of the sensor's lag over the configured one.
pub const LAG: usize = 5;

pub type State = SVector<f64, STATES>;
pub type Matrix = SMatrix<f64, STATES, STATES>;

/// Time constant with which the inflow's stirring follows the inflow \[s\].
const STIRRING_S: f64 = 0.005;
/// Steps of the differences that linearise the model, per state.
const DIFFERENCES: [f64; STATES] = [1e-5, 1e-2, 1e-2, 1e-2, 1e-3, 1e-3];

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Known {
    /// Smoothed absolute pressure \[Pa\].
    pub pressure_pa: f64,
    pub length_m: f64,
    pub volume_m3: f64,
    /// Gas may have come in since the step before.
    pub charging: bool,
    /// Gas may have left since the step before.
    pub discharging: bool,
    /// Heat of slip and creep since the step before, by [`hold_back`] \[J\].
    pub hysteresis_j: f64,
}

/// Follows slip and creep along the steps, from rest, with the wall at its reference temperature.
pub fn hold_back(config: &Config, known: &mut [Known]) {
    let law = Law::new(&config.hysteresis, config.step_s);
    let mut held = Held::default();
    let mut before_m = known.first().map_or(0.0, |first| first.length_m);
    for step in known {
        let way_m = (std::mem::replace(&mut before_m, step.length_m) - step.length_m) as f32;
        let gauge_pa = step.pressure_pa as f32 - config.ambient.pressure_pa;
        let after = law.after(&held, way_m, gauge_pa, 1.0);
        step.hysteresis_j = f64::from(law.heat_j(&held, &after, way_m));
        held = after;
    }
}

#[derive(Debug, Clone)]
pub struct Model {
    config: Config,
    chamber: AnyChamber,
    step_s: f64,
    leak: Option<Iso6358>,
    /// How much the gas at the sensor swings about the wall, compared with the mean.
    location_factor: f64,
}

impl Model {
    pub fn new(config: &Config) -> Self {
        let leak = &config.leak;
        let gas = IdealGas::new(&Gas {
            gas_constant_j_kg_k: config.gas.gas_constant_j_kg_k.into(),
            heat_capacity_ratio: config.gas.heat_capacity_ratio.into(),
        });
        Self {
            leak: Iso6358::leak(leak.conductance_m3_s_pa.into(), leak.critical_ratio.into(), &gas),
            config: *config,
            chamber: AnyChamber::new(&config.chamber),
            step_s: f64::from(config.step_s),
            location_factor: 1.0,
        }
    }

    /// The same, with this location factor of the sensor.
    #[must_use]
    pub fn with_location_factor(self, location_factor: f64) -> Self {
        Self { location_factor, ..self }
    }

    /// T = P V/(m R), eq. (1) \[K\].
    pub fn gas_k(&self, known: &Known, state: &State) -> f64 {
        let gas_constant = f64::from(self.config.gas.gas_constant_j_kg_k);
        known.pressure_pa * known.volume_m3 / (state[MASS].exp() * gas_constant)
    }

    /// Leak flow by the plant's own law \[kg/s\].
    fn leak_kg_s(&self, pressure_pa: f64, gas_k: f64) -> f64 {
        let ambient_pa = f64::from(self.config.ambient.pressure_pa);
        self.leak
            .filter(|_| pressure_pa > ambient_pa)
            .map_or(0.0, |leak| leak.mass_flow(pressure_pa, gas_k, ambient_pa))
    }

    pub fn mass(&self, known: &Known, gas_k: f64) -> f64 {
        let gas_constant = f64::from(self.config.gas.gas_constant_j_kg_k);
        (known.pressure_pa * known.volume_m3 / (gas_k * gas_constant)).ln()
    }

    pub fn lag_s(&self, state: &State) -> f64 {
        f64::from(self.config.sensors.gas.time_constant_s) * state[LAG].exp()
    }

    /// Advances from the first of `steps` to the last and calls `each` with the gas temperature
    /// after every step. Updates `inflow_kg_s`, the inflow that stirs the gas.
    pub fn advance(
        &self,
        mut state: State,
        inflow_kg_s: &mut f64,
        steps: &[Known],
        mut each: impl FnMut(f64),
    ) -> State {
        let Some((first, last)) = steps.first().zip(steps.last()) else { return state };
        let duration_s = (steps.len() - 1) as f64 * self.step_s;
        let speed_m_s = (last.length_m - first.length_m) / duration_s;
        let surface_m2 = f64::from(self.chamber.surface_m2(last.length_m as f32));
        let Heat { inner_w_m2_k, inner_per_flow, outer_w_m2_k, outer_per_speed } = self.config.heat;
        let outer_w_k =
            surface_m2 * (f64::from(outer_w_m2_k) + f64::from(outer_per_speed) * speed_m_s.abs());
        let wall_j_k = f64::from(self.config.wall.heat_capacity_j_k);
        let k = f64::from(self.config.gas.heat_capacity_ratio);
        let cp = f64::from(self.config.gas.cp_j_kg_k());
        let housing_s = f64::from(self.config.sensors.gas.housing_time_constant_s);
        let friction = &self.config.friction;
        let lag_s = self.lag_s(&state);
        let share = |time_s: f64| (self.step_s / (time_s + 0.5 * self.step_s)).min(1.0);
        let mut gas_k = self.gas_k(first, &state);
        for pair in steps.windows(2) {
            let (before, now) = (&pair[0], &pair[1]);
            let inner_w_k = state[SCALE].exp()
                * surface_m2
                * (f64::from(inner_w_m2_k) + f64::from(inner_per_flow) * inflow_kg_s.max(0.0));
            let heat_j = inner_w_k * (gas_k - state[WALL]) * self.step_s;
            let leaked_kg = self.leak_kg_s(before.pressure_pa, gas_k) * self.step_s;
            let enthalpy_j = compression_j(before, now, k) + heat_j + cp * gas_k * leaked_kg;
            // One-sided duties give the direction; otherwise noise would be rectified.
            let entering = now.charging && (!now.discharging || enthalpy_j > 0.0);
            let port_k = if entering { f64::from(self.config.supply.temperature_k) } else { gas_k };
            let change_kg =
                if now.charging || now.discharging { enthalpy_j / (cp * port_k) } else { 0.0 };
            let stirring_kg_s = if entering { change_kg / self.step_s } else { 0.0 };
            *inflow_kg_s += share(STIRRING_S) * (stirring_kg_s - *inflow_kg_s);
            state[MASS] = (state[MASS].exp() + change_kg - leaked_kg).ln();
            let gas_before_k = gas_k;
            gas_k = self.gas_k(now, &state);
            each(gas_k);
            let friction_w = f64::from(friction.wall_heat_w(state[WALL] as f32, speed_m_s as f32));
            let ambient_k = f64::from(self.config.ambient.temperature_k);
            let outer_w = outer_w_k * (state[WALL] - ambient_k);
            let hysteresis_j = f64::from(friction.heat_fraction) * now.hysteresis_j;
            state[WALL] +=
                (heat_j + hysteresis_j + (friction_w - outer_w) * self.step_s) / wall_j_k;
            let housing_before_k = state[HOUSING];
            let above_k = 0.5 * (gas_before_k + gas_k) - state[WALL];
            let seen_k = state[WALL] + self.location_factor * above_k;
            state[HOUSING] += share(housing_s) * (seen_k - state[HOUSING]);
            let housing_k = 0.5 * (housing_before_k + state[HOUSING]);
            state[SENSOR] += share(lag_s) * (housing_k - state[SENSOR]);
        }
        // First-order Gauss-Markov process about the configured values.
        let keep = 1.0 - duration_s / f64::from(self.config.estimator.memory_s);
        state[SCALE] *= keep;
        state[LAG] *= keep;
        state
    }

    /// Derivative of the error at the end of `steps` with respect to the error at their start, by
    /// differences.
    pub fn transition(&self, state: &State, inflow_kg_s: f64, steps: &[Known]) -> Matrix {
        let mut transition = Matrix::zeros();
        for (i, difference) in DIFFERENCES.into_iter().enumerate() {
            let end = |by: f64| {
                let mut moved = *state;
                moved[i] += by;
                self.advance(moved, &mut inflow_kg_s.clone(), steps, |_| {})
            };
            let column = (end(difference) - end(-difference)) / (2.0 * difference);
            transition.set_column(i, &column);
        }
        transition
    }

    /// Sensor temperature in the middle of an interval, to which the mean of its readings belongs,
    /// computed from the state at its end; and its derivative with respect to that state.
    pub fn reading(&self, state: &State, steps: usize) -> (f64, State) {
        let lag_s = self.lag_s(state);
        let earlier = 0.5 * (steps as f64 - 1.0) * self.step_s / lag_s;
        let ahead_k = state[HOUSING] - state[SENSOR];
        let mut row = State::zeros();
        row[SENSOR] = 1.0 + earlier;
        row[HOUSING] = -earlier;
        row[LAG] = earlier * ahead_k;
        (state[SENSOR] - earlier * ahead_k, row)
    }

    /// Variance that the errors gain in one interval.
    pub fn drift(&self, gas_k: f64, duration_s: f64) -> State {
        let tuning = &self.config.estimator;
        let relative = f64::from(tuning.gas_drift_k) / gas_k;
        let forget = 2.0 * duration_s / f64::from(tuning.memory_s);
        let mut drift = State::zeros();
        drift[MASS] = relative.powi(2) * duration_s;
        drift[WALL] = f64::from(tuning.wall_drift_k).powi(2) * duration_s;
        drift[HOUSING] = DRIFT_K2;
        drift[SENSOR] = DRIFT_K2;
        drift[SCALE] = forget * f64::from(tuning.heat_scale_sd).powi(2);
        drift[LAG] = forget * f64::from(tuning.lag_sd).powi(2);
        drift
    }
}

/// Enthalpy that the gas takes up in addition to its heat, by the change of pressure and volume
/// \[J\].
fn compression_j(before: &Known, now: &Known, k: f64) -> f64 {
    let mean_volume_m3 = 0.5 * (before.volume_m3 + now.volume_m3);
    let mean_pa = 0.5 * (before.pressure_pa + now.pressure_pa);
    (mean_volume_m3 * (now.pressure_pa - before.pressure_pa)
        + k * mean_pa * (now.volume_m3 - before.volume_m3))
        / (k - 1.0)
}

/// Drift of housing and element per interval, as in the core: just enough to keep the covariance
/// nonsingular \[K2\].
const DRIFT_K2: f64 = 1e-6;
