//! Coefficients of the estimator: derived from a configuration once, and never changed by a step.

use super::covariance::{Covariance, Errors};
use super::energy::Averaging;
use super::per_zone::{PerZone, ZONES, scaled, total};
use super::profile::Coefficient;
use crate::config::{Config, EstimatorConfig, Zones};
use crate::math::{exp, inverse_cube_root, limit, ln, sqrt};
use crate::physics::chamber::{AnyChamber, Chamber};
use crate::physics::friction::Friction;
use crate::physics::gas::{Gas, Reservoir};
use crate::physics::heat::Heat;
use crate::physics::hysteresis::Law;
use crate::physics::leak::Leak;
use crate::step_counts::StepCounts;

/// Movement of the element, in multiples of the smallest difference that it shows, after which an unchanged reading
/// counts as frozen: three times the width of a code of erratum RP2040-E11, so an element three times as slow as
/// configured has left that code.
const FROZEN: f32 = 30.0;
/// Deviations of a pressure that are never reached: the greatest `zones.reversal_sd`.
const NEVER_SD: f32 = 1.0e6;
/// Lowest pressure of gas in a muscle or vessel \[Pa\].
pub const LOWEST_PA: f32 = 5.0e3;
/// Errors of the pressure beyond this many deviations are no noise: the flow has changed.
const NOISE_DEVIATIONS: f32 = 4.0;
/// Averaging time of the mean square of the swing \[s\].
const SWING_S: f32 = 8.0;
/// Time of each of the two averages of the innovations that show a contradiction \[s\].
const SMOOTHING_S: f32 = 0.5;
/// Time over which innovations are added up to see a bias \[s\].
const BIAS_S: f32 = 20.0;
/// Difference between gas and a wall at ambient temperature for which the coefficients of air are configured \[K\].
const WORKING_K: f32 = 20.0;
/// Housings faster than this count as none \[s\].
const LEAST_HOUSING_S: f32 = 1.0e-3;

/// How long a flow stirs, and how much.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stirring {
    /// Whether a jet stirs longer than it lasts.
    pub lasts: bool,
    /// Share of a movement's mean flow in the flow that still stirs \[-\].
    pub share: f32,
    /// Flow for which the configured gains hold \[kg/s\], and its cube root; 0: they hold for any flow.
    forced_kg_s: f32,
    forced_root: f32,
}

impl Stirring {
    fn new(zones: &Zones, move_s: f32) -> Self {
        let forced_kg_s = zones.forced_flow_kg_s;
        Self {
            lasts: zones.stirring_decay_s > 0.0 || forced_kg_s > 0.0,
            share: move_s / (zones.stirring_decay_s + move_s),
            forced_kg_s,
            forced_root: exp(ln(forced_kg_s) * (1.0 / 3.0)),
        }
    }

    /// Flow that stirs in proportion as much as this one does \[kg/s\]: f (s/f)^(2/3).
    pub fn forced(&self, flow_kg_s: f32) -> f32 {
        if self.forced_kg_s > 0.0 {
            flow_kg_s * self.forced_root * inverse_cube_root(flow_kg_s)
        } else {
            flow_kg_s
        }
    }
}

/// Gas outside of the muscle that has its pressure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tube {
    /// Volume of the chamber that is the tube \[m3\].
    pub volume_m3: f32,
    /// Gas that tube and hose take up with the pressure \[kg/Pa\], and the enthalpy that goes along \[J/Pa\].
    pub takes_kg_pa: f32,
    pub takes_j_pa: f32,
    /// Volume whose compression warms the gas that comes in \[m3\].
    pub warming_m3: f32,
}

impl Tube {
    fn new(config: &Config) -> Self {
        let (zones, gas) = (&config.zones, &config.gas);
        let (all_m3, k) = (zones.tube_m3 + zones.hose_m3, gas.heat_capacity_ratio);
        Self {
            volume_m3: zones.tube_m3,
            takes_kg_pa: all_m3 / (gas.gas_constant_j_kg_k * config.ambient.temperature_k),
            takes_j_pa: all_m3 * k / (k - 1.0),
            warming_m3: zones.warming_m3,
        }
    }
}

/// Coefficients of the estimator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coefficients {
    pub counts: StepCounts,
    pub averaging: Averaging,
    pub tuning: EstimatorConfig,
    pub gas: Gas,
    pub ambient: Reservoir,
    pub supply_k: f32,
    pub heat: Heat,
    pub friction: Friction,
    pub hysteresis: Law,
    pub leak: Leak,
    /// Whether a leak is configured. A field of its own: comparing floats in every step is expensive without an FPU.
    pub leaks: bool,
    /// Still gas: whether buoyancy matters, the fourth powers of conduction, and of buoyancy over P^2 and difference.
    pub conduction4: f32,
    pub buoyancy4: f32,
    /// Coefficient of stirred gas in each zone, per flow in and out \[W/(m2 K) per kg/s\].
    pub jet: PerZone,
    pub column: PerZone,
    pub stirring: Stirring,
    /// Volume that the jet exchanges at each face, per volume that comes in \[-\].
    pub recirculation: [f32; 3],
    pub diffusivity_m2_s: f32,
    /// Length of the gas at rest \[m\].
    pub length_m: f32,
    /// Wall that follows a stroke, the layer behind it, and the conductance between them.
    pub wall_j_k: f32,
    pub outer_j_k: f32,
    pub layers_w_k: f32,
    pub tube: Tube,
    pub step_s: f32,
    pub interval_s: f32,
    pub per_k_minus_1: f32,
    pub per_cp: f32,
    pub per_cp_supply: f32,
    pub per_cv: f32,
    /// R T of the supply \[J/kg\].
    pub supply_r_j_kg: f32,
    /// Lag of the element, as configured \[s\].
    pub lag_s: f32,
    /// Lag of the housing around the element \[s\].
    pub housing_s: f32,
    /// Middle of the foil, and half of what it spans, in shares of the length \[-\].
    pub place: f32,
    pub half_span: f32,
    pub profile: Coefficient,
    /// Half of one over the film temperature for which the coefficients of air hold \[1/K\].
    pub per_film_k: f32,
    pub foil_settled: f32,
    /// Share of one step and one zone in a movement of the zones \[-\].
    pub per_move: f32,
    /// Share of an interval in the mean square of the swing.
    pub swing_window: f32,
    /// Share of an innovation in each of two averages in series.
    pub smoothing: f32,
    /// Share of the innovations' sum that an interval keeps.
    pub bias_kept: f32,
    /// Share of the learnt values that an interval forgets, and share of each error that it keeps.
    pub forget: f32,
    pub keep: Errors<f32>,
    /// Movement of the element at which an unchanged reading counts as frozen \[K\].
    pub frozen_k: f32,
    /// Pressure beyond which gas flows against the open valve, if it ever does \[Pa\].
    pub reversal_pa: Option<f32>,
    /// Largest error of a pressure that is still its noise \[Pa\].
    pub noise_pa: f32,
    /// Largest error of a length that is still its noise \[m\].
    pub length_noise_m: f32,
    /// Deviation of the temperature that the noise of one pressure leaves, times pressure over
    /// temperature \[Pa\].
    pub pressure_sd_pa: f32,
}

impl Coefficients {
    #[cold] // Once at a start: as small as can be.
    pub fn new(config: &Config) -> Self {
        let (zones, sensors, k) = (&config.zones, &config.sensors, config.gas.heat_capacity_ratio);
        let counts = StepCounts::new(config.step_s);
        let [interval_s, move_s] =
            [counts.update_steps, counts.move_steps].map(|steps| f32::from(steps) * config.step_s);
        let Noises { reversal_pa, noise_pa, pressure_sd_pa } = Noises::new(config);
        let length_m = AnyChamber::new(&config.chamber).rest_length_m();
        let (jet, recirculation) = jets(zones, length_m);
        let profile = Coefficient::new(zones.bore_m, zones.foil_radius, &config.gas);
        Self {
            counts,
            averaging: Averaging::new(&counts, config.pwm_period_steps),
            tuning: config.estimator,
            gas: config.gas,
            ambient: config.ambient.into(),
            supply_k: config.supply.temperature_k,
            heat: config.heat,
            friction: config.friction,
            hysteresis: Law::new(&config.hysteresis, move_s),
            leak: config.leak,
            leaks: config.leak.leaks(),
            conduction4: fourth(config.heat.inner_w_m2_k),
            buoyancy4: buoyancy4(zones),
            jet: scaled(&jet, config.heat.inner_per_flow * ZONES as f32 / total(&jet)),
            column: scaled(&[1.75, 1.25, 0.75, 0.25], zones.per_outflow),
            stirring: Stirring::new(zones, move_s),
            recirculation,
            diffusivity_m2_s: zones.diffusivity_m2_s,
            length_m,
            wall_j_k: config.wall.heat_capacity_j_k,
            outer_j_k: zones.outer_wall_j_k,
            layers_w_k: zones.layers_w_k,
            tube: Tube::new(config),
            step_s: config.step_s,
            interval_s,
            per_k_minus_1: 1.0 / (k - 1.0),
            per_cp: 1.0 / config.gas.cp_j_kg_k(),
            per_cp_supply: 1.0 / (config.gas.cp_j_kg_k() * config.supply.temperature_k),
            per_cv: (k - 1.0) / config.gas.gas_constant_j_kg_k,
            supply_r_j_kg: config.gas.gas_constant_j_kg_k * config.supply.temperature_k,
            lag_s: sensors.gas.time_constant_s,
            housing_s: limit(sensors.gas.housing_time_constant_s, LEAST_HOUSING_S, f32::MAX),
            place: zones.foil_position,
            half_span: 0.5 * zones.foil_span,
            profile,
            per_film_k: 0.5 / (config.ambient.temperature_k + 0.5 * WORKING_K),
            foil_settled: profile.foil_settled(),
            per_move: 1.0 / (ZONES as f32 * f32::from(counts.move_steps)),
            swing_window: interval_s * (1.0 / SWING_S),
            smoothing: limit(interval_s * (1.0 / SMOOTHING_S), 0.0, 1.0),
            bias_kept: 1.0 - limit(interval_s * (1.0 / BIAS_S), 0.0, 1.0),
            forget: interval_s / config.estimator.memory_s,
            keep: kept(&config.estimator, interval_s),
            frozen_k: FROZEN * sensors.gas_element.resolution_k(),
            reversal_pa,
            noise_pa,
            length_noise_m: sensors.length.resolution_m(),
            pressure_sd_pa,
        }
    }

    /// Variances of the parameters, as configured; all others are zero.
    pub fn parameters(&self) -> Errors<f32> {
        let sd = &self.tuning;
        let square = |sd: f32| sd * sd;
        Errors {
            scale: square(sd.heat_scale_sd),
            stirring: square(sd.stirring_sd),
            lag: square(sd.lag_sd),
            housing_lag: square(sd.housing_sd),
            place: square(sd.place_sd),
            ..Errors::default()
        }
    }

    /// Covariance before the first reading.
    pub fn initial_covariance(&self) -> Covariance {
        /// Share of the variance in which the zones differ.
        const DIFFERENT: f32 = 0.1;
        let sd = &self.tuning;
        let initial_k2 = sd.initial_sd_k * sd.initial_sd_k;
        let gas = initial_k2 / (self.ambient.temperature_k * self.ambient.temperature_k);
        let mut covariance = Covariance::of(&Errors {
            zones: [DIFFERENT * gas; ZONES],
            wall: initial_k2,
            housing: initial_k2,
            element: initial_k2,
            foil: sd.foil_sd_k * sd.foil_sd_k,
            ..self.parameters()
        });
        covariance.add_common((1.0 - DIFFERENT) * gas);
        covariance
    }
}

/// Returns a jet's share in each zone, and the exchange across each border; a jet decays along the muscle.
fn jets(zones: &Zones, length_m: f32) -> ([f32; ZONES], [f32; ZONES - 1]) {
    let reached = |way: f32| exp(-way * length_m / zones.jet_reach_m);
    let recirculation = [0.25, 0.5, 0.75].map(|way| zones.recirculation * reached(way));
    // Counted from the middle of the first zone, so that the sum is at least 1 however short the reach.
    ([0.0, 0.25, 0.5, 0.75].map(reached), recirculation)
}

/// Fourth power of buoyancy's coefficient, over pressure squared and temperature difference.
fn buoyancy4(zones: &Zones) -> f32 {
    /// Pressure at which `buoyancy_w_m2_k` holds.
    const WORKING_PA: f32 = 2.0e5;
    let buoyancy2 = zones.buoyancy_w_m2_k * zones.buoyancy_w_m2_k / WORKING_PA;
    buoyancy2 * buoyancy2 / WORKING_K
}

/// Share of each error that an interval keeps: the learnt values and the foil's place fade.
fn kept(tuning: &EstimatorConfig, interval_s: f32) -> Errors<f32> {
    let kept = |memory_s: f32| 1.0 - limit(interval_s / memory_s, 0.0, 1.0);
    let learnt = kept(tuning.memory_s);
    Errors {
        zones: [1.0; ZONES],
        wall: 1.0,
        housing: 1.0,
        element: 1.0,
        foil: kept(tuning.foil_memory_s),
        scale: learnt,
        stirring: learnt,
        lag: learnt,
        housing_lag: learnt,
        place: learnt,
    }
}

/// Noise of one pressure, in the form that [`Coefficients`] holds.
struct Noises {
    reversal_pa: Option<f32>,
    noise_pa: f32,
    pressure_sd_pa: f32,
}

impl Noises {
    fn new(config: &Config) -> Self {
        let (sensors, reversal_sd) = (&config.sensors, config.zones.reversal_sd);
        let k = config.gas.heat_capacity_ratio;
        let sd_pa = sqrt(sensors.pressure_part.noise_pa2(&sensors.pressure));
        Self {
            reversal_pa: (reversal_sd < NEVER_SD).then_some(reversal_sd * sd_pa),
            // Well below any pressure, so that an energy within the noise never falls below 0.
            noise_pa: limit(NOISE_DEVIATIONS * sd_pa, 0.0, 0.5 * LOWEST_PA),
            // A pressure read too high counts as gas that came in: an error dT/T = (k-1)/k dP/P remains.
            pressure_sd_pa: (k - 1.0) / k * sd_pa,
        }
    }
}

fn fourth(value: f32) -> f32 {
    value * value * value * value
}
