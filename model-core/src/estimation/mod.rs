//! The gas temperature in real time: an extended Kalman filter whose state moves at every step and
//! whose covariance moves once per interval of 20 ms.
//!
//! Pressure P and length (hence volume V) are measured fast and well. With the energy balance they
//! give the enthalpy that came in or left, whatever valve it went through. Without flow, (3) predicts
//! the internal energy U:
//!
//! ```text
//! U        = P V/(k-1)                                    (4)
//! U_closed = U - P dV - h A (T - T_w) dt - cp T dm_leak   (3) without valves
//! H        = U_measured - U_closed                        what crossed the port
//! dm       = H/(cp T_in) while charging, H/(cp T) while discharging, less dm_leak always
//! T        = U/(m c_v)                                    (1)
//! ```
//!
//! No valve needs to be calibrated; that a valve is open is known from the duty. Noise is
//! averaged where that costs no delay (`trend.rs`, `energy.rs`).
//!
//! What drifts, the slow Pt sensor corrects: T_s' = (T_h - T_s)/tau, T_h' = (T - T_h)/tau_h.
//!
//! | state | error carried in the covariance |
//! |---|---|
//! | m | u = dT/T = -dm/m, relative error of the gas temperature |
//! | T_w | wall temperature \[K\] |
//! | T_s | temperature of the sensor's element \[K\] |
//! | s | logarithm of the scale of the heat transfer h A |
//! | tau | logarithm of the sensor's lag |
//!
//! Where gas does not mix at once (`estimator.port_cooling`), what leaves has the temperature of the gas near
//! the port, T + d, in the place of T, and the foil sees T - 0.08 d: `mix_port`, and docs/background/estimator.md.
//!
//! The housing's T_h follows T within a fraction of a second; it has no error of its own. s and tau
//! are first-order Gauss-Markov processes about what is configured: a model's error stays the same
//! cycle after cycle, and a filter that counted every cycle as new evidence would be sure of a
//! wrong value in the end.
//!
//! The matrix of the linearised error over one interval D (x = s h A D/(m cp), M_in the mass that
//! came in):
//!
//! ```text
//! u'   = (1 - x - M_in/m) u + x/T T_w - x (T - T_w)/T ln(s)     while gas flows, u otherwise
//! T_w' = s h A D/C_w (T u - T_w) + ... - h_o A D/C_w T_w + Q/C_w ln(s)
//! T_s' = D/tau (T u - T_s) - D (T_h - T_s)/tau ln(tau)
//! ```

mod agreement;
mod covariance;
mod energy;
mod trend;

use self::agreement::Agreement;
use self::covariance::{Covariance, LARGEST_GAS, Product, Transition};
use self::energy::{Averaging, Energy};
use self::trend::{FlowState, Trend, Uncertainty};
use crate::config::Config;
use crate::math::{CompensatedSum, absolute, exp, is_above, is_within, limit, sqrt};
use crate::physics::chamber::Chamber;
use crate::physics::gas::Reservoir;
use crate::sample::Estimate;
use crate::sensing::{GasReading, Reading};
use crate::step_counts::StepCounts;

/// How far the element must have moved, in differences that it shows, for a reading that has stood still
/// meanwhile to be a frozen one: three times what a code of erratum RP2040-E11 is wide, so that an element
/// three times as slow as believed has left it.
const FROZEN: f32 = 30.0;
/// Nearer than this, and twice the stated deviation, the gas need not move its element \[K\].
const UNMOVED_K: f32 = 0.3;
/// Pressures beyond which no gas in a muscle or vessel lies \[Pa\].
const LOWEST_PA: f32 = 5.0e3;
const HIGHEST_PA: f32 = 1.0e9;
/// Innovations that stay beyond so many deviations of the reading, averaged over half a second, say
/// that the state is wrong and not the reading.
const CONTRADICTION: f32 = 5.0;
/// Smallest deviation that is stated \[K\].
const LEAST_SD_K: f32 = 1.0e-3;
/// Gas mass that stands for none \[kg\].
const LEAST_KG: f32 = 1.0e-9;
/// Temperatures beyond which neither gas nor wall lies \[K\].
const COLDEST_K: f32 = 100.0;
const HOTTEST_K: f32 = 1000.0;
/// Errors of the pressure beyond so many deviations are no noise: the flow has changed.
const NOISE_DEVIATIONS: f32 = 4.0;
/// Parts of the work that an interval leaves, and the step of the next one in which it begins: the first is
/// the controller's.
const PARTS: u16 = 5;
const FIRST_PART: u16 = 2;
/// Gas near the port, share of the gas that an inflow has to replace before it is as cold as
/// [`EstimatorConfig::port_cooling`](crate::config::EstimatorConfig) says \[-\].
const PORT_SHARE: f32 = 0.5;
/// By how much of what has left, share of that, the rest behind it has taken its place \[-\].
const PORT_REPLACED: f32 = 0.4;
/// In which the rest mixes with the gas near the port \[s\].
const PORT_MIXING_S: f32 = 2.0;
/// By how much the gas around the foil is warmer than the mean, for each kelvin by which that near the port is
/// colder \[-\].
const FOIL_WARMER: f32 = 0.08;
/// Variance of the gas temperature for a lag and a heat transfer that both are not the configured ones, in the
/// product of the relative changes of their time constants and squares of the swing \[-\].
const LEARNT: f32 = 1.3;
/// Such a product that is learnt where all is configured right \[-\].
const LEARNT_FLOOR: f32 = 5.0e-6;
/// Change of the lag that zones alone make, with all of their gas at the port \[-\].
const ZONES_LAG: f32 = 0.025;
/// Variance for readings that disagree as far as can be, in squares of the swing \[-\].
const DISAGREED: f32 = 2.2e-3;
/// Over which the mean square of the swing is taken \[s\].
const SWING_S: f32 = 8.0;
/// `place_error_k` of a foil in the middle, which what is stated was found with \[K\].
const MIDDLE_PLACE_K: f32 = 0.87;
/// Largest factor for a foil off it: nearly all of the covariance, however little of it the agreement leaves \[-\].
const MOST_PLACE: f32 = 6.6;
/// Variance that zones leave, with all of their gas at the port: in squares of the swing \[-\] ...
const ZONES: f32 = 4.3e-4;
/// ... and where nothing swings \[K2\].
const ZONES_K2: f32 = 7.0e-3;
/// Variance that a leak adds per second, in squares of its rate: configured a tenth wrong, for five seconds \[s\].
const LEAK_UNCERTAINTY_S: f32 = 0.1;
/// What averaging does not take of the variance of one pressure: the lag of its sensor \[-\].
const NOT_AVERAGED: f32 = 0.1;

/// What the estimator needs to know of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// Measured absolute pressure \[Pa\]; `None` while the sensor is not to be trusted.
    pub pressure: Option<Reading>,
    /// Measured length \[m\], limited to what the chamber can have.
    pub length: Reading,
    /// What the gas sensor has said, where the estimator [starts](Estimator::starts) or an interval
    /// [ends](Estimator::ends_interval): the mean over it. `None`: nothing to be trusted.
    pub gas: Option<GasReading>,
    /// What the valves are driven to.
    pub openings: Openings,
    /// The controller works in this step: what can wait, waits.
    pub busy: bool,
}

/// Where gas may go, as the duties tell.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Openings {
    /// They have changed.
    pub turned: bool,
    /// A valve is driven now. If not, what flows is the end of a pulse.
    pub driven: bool,
    /// The inlet has been driven lately.
    pub charging: bool,
    /// The outlet has been driven lately.
    pub discharging: bool,
}

impl Openings {
    /// What they let expect of a step; `flowing`: gas flowed in the one before.
    fn flow_state(self, flowing: bool) -> FlowState {
        match (self.turned, flowing) {
            (true, _) => FlowState::Turned,
            (false, true) => FlowState::Open,
            (false, false) => FlowState::Shut,
        }
    }
}

/// Sums over one interval.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Interval {
    steps: u16,
    gas_k: f32,
    inflow_kg: f32,
    outflow_kg: f32,
    heat_j: f32,
    flowing_steps: u16,
    /// Work of the gas, and its measured internal energy at the start \[J\].
    work_j: f32,
    start_j: f32,
    /// What leaked \[J\].
    leaked_j: f32,
    /// A step of it had no pressure.
    void: bool,
}

/// What an interval's pressures and lengths say of the gas, whatever the valves were asked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Balance {
    /// Gas that came in over the interval, share of what is there, whatever heat transfer and leak were
    /// between none and the believed ones: the least \[-\] ...
    pub least_gained: f32,
    /// ... and the most of it \[-\].
    pub most_gained: f32,
    /// Absolute pressure at its end \[Pa\].
    pub pressure_pa: f32,
    /// Gas mass \[kg\].
    pub mass_kg: f32,
}

/// Work that the end of an interval leaves for the next steps, one part each. A part carries what the
/// part before it has found, so that none can run on what belongs to another covariance.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
enum Work {
    #[default]
    Done,
    /// M = F P.
    Rows(Transition),
    /// P' = M F^T.
    Columns(Transition, Product),
    Drift,
    Correction,
    Deviation,
}

/// What the end of an interval leaves.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Pending {
    work: Work,
    /// Mean gas temperature of the interval \[K\].
    gas_k: f32,
    innovation_k: Option<f32>,
    /// Gas flowed.
    moved: bool,
    /// Variance of the mean of the interval's readings of the gas sensor \[K2\].
    reading_k2: f32,
    /// What leaked in the interval, share of the gas \[-\].
    leaked: f32,
}

/// State of the estimator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimator {
    // Constants of the configuration, worked out once.
    config: Config,
    counts: StepCounts,
    /// Share of a step's inflow in the inflow that stirs the gas.
    stirring_share: f32,
    per_k_minus_1: f32,
    per_cp: f32,
    per_cp_supply: f32,
    per_cv: f32,
    interval_s: f32,
    /// What leaks in a step, over the absolute pressure \[kg/Pa\]; nothing else of it changes within an interval.
    leak_kg_pa: f32,
    /// Anything does: a comparison of numbers in every step is dear without an FPU.
    leaks: bool,
    /// One over the configured lag \[1/s\].
    per_lag_s: f32,
    /// How much more of the covariance is stated where the foil is off the middle \[-\].
    place: f32,
    /// Share of an interval in the mean square of the swing: eight seconds.
    swing_window: f32,
    /// Movement of the element at which a reading that stands still is a frozen one \[K\].
    frozen_k: f32,
    /// Largest error of a pressure that is still its noise \[Pa\].
    noise_pa: f32,
    /// The same of a length \[m\].
    length_noise_m: f32,
    /// Deviation of the temperature that the noise of one pressure leaves, times pressure over
    /// temperature \[Pa\].
    pressure_sd_pa: f32,
    /// Variance of what the gas around the foil differs from the mean, in one interval's reading \[K2\].
    bias_k2: f32,
    /// Variance of what averaging over a second leaves of them \[K2\].
    lasting_k2: f32,
    // State.
    mass_kg: CompensatedSum,
    gas_k: f32,
    wall_k: f32,
    /// Gas near the port, above the mean \[K\].
    port_k: f32,
    housing_k: f32,
    sensor_k: f32,
    scale: f32,
    lag_s: f32,
    covariance: Covariance,
    agreement: Agreement,
    /// Mean square of the gas temperature about the wall's, over some seconds \[K2\].
    swing_k2: f32,
    gas_sd_k: f32,
    // Since the last step.
    pressure_pa: f32,
    volume_m3: f32,
    /// Internal energy as pressure and volume of the last step say \[J\].
    measured_j: f32,
    energy: Energy,
    /// Length whose noise is averaged \[m\].
    followed_m: f32,
    motion: Trend,
    /// Mass that comes in with one step, averaged over some \[kg\].
    inflow_kg: f32,
    entering: bool,
    missing_steps: u16,
    /// What the last readings said \[K\].
    reading_k: f32,
    /// By how much the element must have moved in the intervals since the reading last changed \[K\].
    unmoved_k: f32,
    frozen: bool,
    contradicted_intervals: u16,
    /// It is the sensor that is wrong: its readings correct nothing.
    distrusted: bool,
    // Since the last interval.
    length_m: f32,
    still_j_k: f32,
    stirred_j_k_kg: f32,
    interval: Interval,
    balance: Option<Balance>,
    pending: Pending,
    started: bool,
}

/// What is known before the first reading.
fn initial_covariance(config: &Config) -> Covariance {
    let sd = &config.estimator;
    let variance_k2 = sd.initial_sd_k * sd.initial_sd_k;
    Covariance {
        gas_gas: variance_k2 / (config.ambient.temperature_k * config.ambient.temperature_k),
        wall_wall: variance_k2,
        sensor_sensor: variance_k2,
        scale_scale: sd.heat_scale_sd * sd.heat_scale_sd,
        lag_lag: sd.lag_sd * sd.lag_sd,
        ..Covariance::default()
    }
}

/// Within a wide code, or by noise.
fn uncertainty(wide: f32, noise: f32) -> Uncertainty {
    if is_above(wide, 0.0) { Uncertainty::WideCode(wide) } else { Uncertainty::Noise(noise) }
}

impl Estimator {
    /// An estimator that starts with the first measurement.
    ///
    /// ```
    /// use model_core::Config;
    /// use model_core::estimation::{Estimator, Measurement, Openings};
    /// use model_core::physics::chamber::AnyChamber;
    /// use model_core::sensing::{GasReading, Reading};
    ///
    /// let config = Config::default();
    /// let muscle = AnyChamber::new(&config.chamber);
    /// let mut estimator = Estimator::new(&config);
    /// let gas = GasReading { value_k: 300.0, noise_k2: 1.0e-4, moved: true, age_steps: None };
    /// estimator.step(&muscle, &Measurement {
    ///     pressure: Some(Reading::exact(2.0e5)),
    ///     length: Reading::exact(0.28),
    ///     gas: Some(gas),
    ///     openings: Openings::default(),
    ///     busy: false,
    /// });
    /// assert!((estimator.estimate().gas_k - 300.0).abs() < 0.1);
    /// ```
    #[cold] // Once at a start: as small as can be.
    pub fn new(config: &Config) -> Self {
        let k = config.gas.heat_capacity_ratio;
        let sd = &config.estimator;
        let counts = StepCounts::new(config);
        let interval_s = f32::from(counts.interval_steps) * config.step_s;
        let sensors = &config.sensors;
        let pressure_sd_pa = sqrt(sensors.pressure_part.noise_pa2(&sensors.pressure));
        let gas_noise_k2 = sensors.gas.noise_k * sensors.gas.noise_k;
        let bias_k = sd.reading_bias_k(sensors.gas.time_constant_s);
        let energy = Energy::new(0.0, Averaging::new(&counts, config.pwm_period_steps));
        Self {
            config: *config,
            counts,
            stirring_share: 1.0 / f32::from(counts.stirring_steps),
            per_k_minus_1: 1.0 / (k - 1.0),
            per_cp: 1.0 / config.gas.cp_j_kg_k(),
            per_cp_supply: 1.0 / (config.gas.cp_j_kg_k() * config.supply.temperature_k),
            per_cv: (k - 1.0) / config.gas.gas_constant_j_kg_k,
            interval_s,
            leak_kg_pa: 0.0,
            leaks: config.leak.leaks(),
            per_lag_s: 1.0 / sensors.gas.time_constant_s,
            place: limit(sd.place_error_k / MIDDLE_PLACE_K, 1.0, MOST_PLACE),
            swing_window: interval_s * (1.0 / SWING_S),
            frozen_k: FROZEN * sensors.gas_element.resolution_k(),
            // A pressure read too high counts as gas that came in: dT/T = (k-1)/k dP/P is left.
            pressure_sd_pa: (k - 1.0) / k * pressure_sd_pa,
            // Well below any pressure, so that an energy within the noise is none below 0.
            noise_pa: limit(NOISE_DEVIATIONS * pressure_sd_pa, 0.0, 0.5 * LOWEST_PA),
            length_noise_m: sensors.length.resolution_m(),
            // Averaging leaves little of the noise. The bias is the same in every reading of a second.
            bias_k2: bias_k * bias_k / interval_s,
            lasting_k2: gas_noise_k2 + bias_k * bias_k,
            mass_kg: CompensatedSum::new(1.0),
            gas_k: config.ambient.temperature_k,
            wall_k: config.ambient.temperature_k,
            port_k: 0.0,
            housing_k: config.ambient.temperature_k,
            sensor_k: config.ambient.temperature_k,
            scale: 1.0,
            lag_s: sensors.gas.time_constant_s,
            covariance: initial_covariance(config),
            agreement: Agreement::new(sensors.gas.time_constant_s, &counts),
            swing_k2: 0.0,
            gas_sd_k: limit(sd.initial_sd_k, LEAST_SD_K, HOTTEST_K),
            pressure_pa: 0.0,
            volume_m3: 0.0,
            measured_j: 0.0,
            energy,
            followed_m: 0.0,
            motion: Trend::REST,
            inflow_kg: 0.0,
            entering: false,
            missing_steps: 0,
            frozen: false,
            reading_k: config.ambient.temperature_k,
            unmoved_k: 0.0,
            contradicted_intervals: 0,
            distrusted: false,
            length_m: 0.0,
            still_j_k: 0.0,
            stirred_j_k_kg: 0.0,
            interval: Interval::default(),
            balance: None,
            pending: Pending { gas_k: config.ambient.temperature_k, ..Pending::default() },
            started: false,
        }
    }

    /// The estimate after the last step.
    pub fn estimate(&self) -> Estimate {
        Estimate {
            gas_k: self.gas_k,
            gas_sd_k: self.gas_sd_k,
            valid: self.gas_sd_k <= self.config.estimator.valid_sd_k,
            wall_k: self.wall_k,
            sensor_k: self.sensor_k,
            mass_kg: self.mass_kg.value(),
            heat_scale: self.scale,
            sensor_lag_s: self.lag_s,
        }
    }

    /// One step of the gas in `chamber`.
    pub fn step(&mut self, chamber: &impl Chamber, measurement: &Measurement) {
        let Some(pressure) = measurement.pressure else {
            self.wait();
            return;
        };
        self.missing_steps = 0;
        let pressure_pa = limit(pressure.value, LOWEST_PA, HIGHEST_PA);
        let length = &measurement.length;
        if !self.started {
            self.start(chamber, pressure_pa, measurement);
        }
        let uncertainty = uncertainty(length.wide, self.length_noise_m);
        let flow_state = measurement.openings.flow_state(self.energy.flowing());
        let change_m = length.value - self.followed_m;
        self.followed_m += self.motion.step(change_m, uncertainty, flow_state);
        let volume_m3 = chamber.volume_m3(self.followed_m);
        let wide_pa = limit(pressure.wide, 0.0, 0.5 * LOWEST_PA);
        self.propagate(pressure_pa, wide_pa, volume_m3, measurement.openings);
        self.advance_covariance(chamber, measurement);
        if !self.is_sound() {
            self.heal();
        }
    }

    /// Whether it starts with the next step, at the temperature that the gas sensor then has.
    pub fn starts(&self) -> bool {
        !self.started
    }

    /// Whether the next step ends an interval: it is to be given the mean of what the gas sensor has said.
    pub fn ends_interval(&self) -> bool {
        self.interval.steps + 1 == self.counts.interval_steps
    }

    /// Whether every figure is one that gas, wall and sensor can have.
    fn is_sound(&self) -> bool {
        let temperatures_k =
            [self.gas_k, self.wall_k, self.housing_k, self.sensor_k, self.gas_k + self.port_k];
        let positive = [self.mass_kg.value(), self.scale, self.lag_s];
        temperatures_k.iter().all(|t| is_within(*t, COLDEST_K, HOTTEST_K))
            && positive.iter().all(|x| is_within(*x, f32::MIN_POSITIVE, f32::MAX))
    }

    /// Starts anew from nothing: whatever made the state what nothing can be is forgotten.
    fn heal(&mut self) {
        let ambient_k = self.config.ambient.temperature_k;
        self.gas_k = ambient_k;
        self.wall_k = ambient_k;
        self.port_k = 0.0;
        self.swing_k2 = 0.0;
        self.housing_k = ambient_k;
        self.sensor_k = ambient_k;
        self.mass_kg = CompensatedSum::new(LEAST_KG);
        self.interval = Interval { steps: self.interval.steps, void: true, ..Interval::default() };
        self.give_up();
    }

    /// Without pressure there is nothing to go by. A few disturbed steps are left out; after ten
    /// milliseconds the estimate is unknown, and starts anew when the pressure is back.
    fn wait(&mut self) {
        // The interval goes on, in phase with the valves' period, and counts for nothing.
        self.interval.void = true;
        self.interval.steps += 1;
        if self.interval.steps == self.counts.interval_steps {
            self.interval = Interval::default();
            self.pending.work = Work::Drift;
        }
        self.missing_steps = self.missing_steps.saturating_add(1);
        if self.missing_steps == self.counts.patience_steps {
            self.give_up();
        }
    }

    /// Forgets everything: the next step with a pressure starts anew.
    fn give_up(&mut self) {
        self.started = false;
        self.covariance = initial_covariance(&self.config);
        let lag_s = self.config.sensors.gas.time_constant_s;
        self.agreement = Agreement::new(lag_s, &self.counts);
        self.pending.innovation_k = None;
        self.pending.work = Work::Deviation;
        self.inflow_kg = 0.0;
        self.scale = 1.0;
        self.lag_s = lag_s;
        self.gas_sd_k = self.gas_k * sqrt(LARGEST_GAS);
    }

    /// The balance of an interval that has just ended.
    pub fn take_balance(&mut self) -> Option<Balance> {
        self.balance.take()
    }

    /// Whether the gas sensor's reading stands still while its element must have moved, so that the readings
    /// are left out until it changes, or has contradicted the model within the last ten seconds.
    pub fn sensor_implausible(&self) -> bool {
        self.frozen || self.contradicted_intervals > 0
    }

    /// The work of an interval, one part a step, kept clear of the steps in which the controller has its own
    /// to do, as long as there are others left.
    fn advance_covariance(&mut self, chamber: &impl Chamber, measurement: &Measurement) {
        let left = self.counts.interval_steps.saturating_sub(self.interval.steps);
        if left == 0 {
            self.end_interval(chamber, measurement);
        } else if self.interval.steps >= FIRST_PART && (!measurement.busy || left <= PARTS) {
            self.work();
        }
    }

    /// The next part of the work that is left.
    fn work(&mut self) {
        match core::mem::take(&mut self.pending.work) {
            Work::Done => {}
            Work::Rows(transition) => {
                let product = self.covariance.rows(&transition);
                self.pending.work = Work::Columns(transition, product);
            }
            Work::Columns(transition, product) => {
                self.covariance.columns(&product, &transition);
                self.pending.work = Work::Drift;
            }
            Work::Drift => {
                self.add_drift();
                self.pending.work = Work::Correction;
            }
            Work::Correction => {
                self.pending.work = Work::Deviation;
                let innovation_k = self.pending.innovation_k.take();
                if let (Some(innovation_k), false) = (innovation_k, self.distrusted) {
                    self.correct(innovation_k);
                }
                self.agreement.add(innovation_k, self.lag_s, self.pending.moved);
                let expected_k2 = self.lasting_k2 + self.covariance.sensor_sensor;
                if self.agreement.smooth_k2() > CONTRADICTION * CONTRADICTION * expected_k2 {
                    self.contradicted_intervals = self.counts.ten_seconds_intervals;
                    self.judge_contradiction();
                }
            }
            Work::Deviation => self.update_deviation(),
        }
    }

    /// Sensor and state cannot both be right. What is in a muscle goes back to its surroundings within
    /// seconds, and so does the element: the one that is further from them is wrong.
    fn judge_contradiction(&mut self) {
        let ambient_k = self.config.ambient.temperature_k;
        self.distrusted =
            absolute(self.reading_k - ambient_k) > absolute(self.sensor_k - ambient_k);
        if !self.distrusted {
            self.give_up();
        }
    }

    /// Everything has the sensor's temperature, until something better is known.
    fn start(&mut self, chamber: &impl Chamber, pressure_pa: f32, measurement: &Measurement) {
        let length_m = measurement.length.value;
        let volume_m3 = chamber.volume_m3(length_m);
        self.followed_m = length_m;
        self.motion = Trend::REST;
        if let Some(gas) = measurement.gas {
            let reading_k = limit(gas.value_k, COLDEST_K, HOTTEST_K);
            self.gas_k = reading_k;
            self.wall_k = reading_k;
            self.housing_k = reading_k;
            self.sensor_k = reading_k;
        }
        self.port_k = 0.0;
        self.unmoved_k = 0.0;
        let energy_j = pressure_pa * volume_m3 * self.per_k_minus_1;
        self.energy.restart(energy_j);
        self.measured_j = energy_j;
        self.mass_kg = CompensatedSum::new(energy_j * self.per_cv / self.gas_k);
        self.pressure_pa = pressure_pa;
        self.volume_m3 = volume_m3;
        self.length_m = length_m;
        self.started = true;
        self.set_conductance(chamber.surface_m2(length_m));
        self.set_leak(pressure_pa);
    }

    /// Mass and temperature over one step, from what pressure and volume did.
    fn propagate(&mut self, pressure_pa: f32, wide_pa: f32, volume_m3: f32, openings: Openings) {
        let conductance = if is_above(self.inflow_kg, 0.0) {
            self.still_j_k + self.stirred_j_k_kg * self.inflow_kg
        } else {
            self.still_j_k
        };
        let heat_j = conductance * (self.gas_k - self.wall_k);
        let work_j = 0.5 * (pressure_pa + self.pressure_pa) * (volume_m3 - self.volume_m3);
        let mut closed_j = self.energy.energy_j() - work_j - heat_j;
        if self.leaks {
            closed_j -= self.leak_j(pressure_pa);
        }
        let per_pa = volume_m3 * self.per_k_minus_1;
        let uncertainty = uncertainty(wide_pa, self.noise_pa).times(per_pa);
        let measured_j = pressure_pa * per_pa;
        let enthalpy_j = self.energy.step(closed_j, measured_j, uncertainty, openings);
        if self.interval.steps == 0 {
            self.interval.start_j = self.measured_j;
        }
        self.measured_j = measured_j;
        self.interval.work_j += work_j;
        self.pressure_pa = pressure_pa;
        self.volume_m3 = volume_m3;
        self.interval.steps += 1;
        self.interval.heat_j += heat_j;

        if openings.charging || openings.discharging {
            // The direction comes from the duties where they are one-sided: the noise of a
            // difference of pressures would be rectified.
            self.entering = if openings.charging && openings.discharging {
                enthalpy_j > 0.0
            } else {
                openings.charging
            };
        }
        if self.energy.flowing() {
            let mut inflow_kg = 0.0;
            let change_kg = if self.entering {
                inflow_kg = enthalpy_j * self.per_cp_supply;
                self.interval.inflow_kg += inflow_kg;
                inflow_kg
            } else {
                let left_kg = enthalpy_j * self.per_cp / (self.gas_k + self.port_k);
                self.interval.outflow_kg -= left_kg;
                left_kg
            };
            self.mass_kg.add(change_kg);
            self.inflow_kg += self.stirring_share * (inflow_kg - self.inflow_kg);
            self.interval.flowing_steps += 1;
        } else {
            self.inflow_kg = 0.0;
        }
        self.update_temperature();
        self.interval.gas_k += self.gas_k;
    }

    /// Takes out what leaks in a step, of the gas near the port; the enthalpy that leaves with it \[J\].
    fn leak_j(&mut self, pressure_pa: f32) -> f32 {
        // Of a leak that is configured far too large, as much as keeps the figures sound.
        const MOST: f32 = 0.1;
        let leaked_kg = limit(self.leak_kg_pa * pressure_pa, 0.0, MOST * self.mass_kg.value());
        self.mass_kg.add(-leaked_kg);
        self.interval.outflow_kg += leaked_kg;
        let leaked_j = leaked_kg * (self.gas_k + self.port_k) / self.per_cp;
        self.interval.leaked_j += leaked_j;
        leaked_j
    }

    /// What leaks in a step at that pressure \[Pa\].
    fn set_leak(&mut self, pressure_pa: f32) {
        if !self.leaks {
            return;
        }
        let config = &self.config;
        let muscle = Reservoir { pressure_pa, temperature_k: self.gas_k };
        let flow_kg_s = config.leak.mass_flow_kg_s(&config.gas, muscle, config.ambient.pressure_pa);
        self.leak_kg_pa = flow_kg_s * config.step_s / pressure_pa;
    }

    /// T = U/(m c_v), limited to where air is a gas and the wall is not ash. A mass that says
    /// otherwise, whatever made it so, is put right.
    fn update_temperature(&mut self) {
        let product = self.energy.energy_j() * self.per_cv;
        let told_k = product / self.mass_kg.value();
        self.gas_k = limit(told_k, COLDEST_K, HOTTEST_K);
        if self.gas_k.to_bits() != told_k.to_bits() {
            self.mass_kg = CompensatedSum::new(product / self.gas_k);
        }
    }

    /// Heat to the wall in one step, per kelvin, at that surface \[m2\]: of still gas, and per mass
    /// that comes in with each step.
    fn set_conductance(&mut self, surface_m2: f32) {
        let heat = &self.config.heat;
        let scaled_m2 = self.scale * surface_m2;
        self.still_j_k = heat.inner_w_m2_k * scaled_m2 * self.config.step_s;
        // A mass per step is a flow times the step.
        self.stirred_j_k_kg = heat.inner_per_flow * scaled_m2;
    }

    fn end_interval(&mut self, chamber: &impl Chamber, measurement: &Measurement) {
        let length_m = measurement.length.value;
        let interval = self.interval;
        self.interval = Interval::default();
        if interval.void {
            self.pending.work = Work::Drift;
            return;
        }
        let steps = f32::from(self.counts.interval_steps);
        let duration_s = self.interval_s;
        let gas_k = interval.gas_k / steps;
        let speed_m_s = (length_m - self.length_m) / duration_s;
        self.length_m = length_m;

        let heat = &self.config.heat;
        let surface_m2 = chamber.surface_m2(length_m);
        let per_wall = 1.0 / self.config.wall.heat_capacity_j_k;
        // A wall does not overshoot its surroundings.
        let outer_w_k = heat.outer_w_k(surface_m2, speed_m_s);
        let outer_share = limit(outer_w_k * duration_s * per_wall, 0.0, 1.0);
        let friction_j = self.config.friction.wall_heat_w(self.wall_k, speed_m_s) * duration_s;
        let housing_s = self.config.sensors.gas.housing_time_constant_s;
        let foil_k = gas_k - FOIL_WARMER * self.port_k;
        // Means over the interval on both sides: implicit Euler then delays by just the lag.
        self.housing_k += duration_s / (housing_s + duration_s) * (foil_k - self.housing_k);
        let lag_share = duration_s / (self.lag_s + 0.5 * duration_s);
        let inner_w_k = heat.inner_w_k(surface_m2, interval.inflow_kg / duration_s);
        let inner_j_k = self.scale * inner_w_k * duration_s;
        let flowing = f32::from(interval.flowing_steps) / steps;
        let per_mass = 1.0 / self.mass_kg.value();
        self.mix_port(&interval, gas_k, per_mass);
        let adiabatic_j = self.measured_j - interval.start_j + interval.work_j;
        let share = |enthalpy_j: f32| enthalpy_j * self.per_cp * per_mass / gas_k;
        let mut most_j = adiabatic_j + limit(interval.heat_j, 0.0, f32::MAX);
        if self.leaks {
            most_j += interval.leaked_j;
            self.pending.leaked = share(interval.leaked_j);
        }
        self.balance = Some(Balance {
            least_gained: share(adiabatic_j + limit(interval.heat_j, f32::MIN, 0.0)),
            most_gained: share(most_j),
            pressure_pa: self.pressure_pa,
            mass_kg: self.mass_kg.value(),
        });
        // Limited where there is next to no gas: its temperature is the wall's.
        let exchange = limit(inner_j_k * per_mass * self.per_cp * flowing, 0.0, 0.5);
        self.pending.gas_k = gas_k;
        self.pending.moved = interval.flowing_steps > 0;
        self.pending.work = Work::Rows(Transition {
            gas_gas: -limit(exchange + interval.inflow_kg * per_mass, 0.0, 0.9),
            gas_wall: exchange / gas_k,
            gas_scale: -exchange * (gas_k - self.wall_k) / gas_k,
            wall_gas: inner_j_k * per_wall * gas_k,
            wall_wall: -limit(inner_j_k * per_wall + outer_share, 0.0, 1.0),
            wall_scale: interval.heat_j * per_wall,
            sensor_gas: lag_share * gas_k,
            sensor_sensor: -lag_share,
            sensor_lag: -lag_share * (self.housing_k - self.sensor_k),
        });
        let forget = duration_s / self.config.estimator.memory_s;
        self.scale += forget * (1.0 - self.scale);
        self.lag_s += forget * (self.config.sensors.gas.time_constant_s - self.lag_s);
        let warming_k = (interval.heat_j + friction_j) * per_wall
            - outer_share * (self.wall_k - self.config.ambient.temperature_k);
        self.wall_k = limit(self.wall_k + warming_k, COLDEST_K, HOTTEST_K);
        let sensor_change_k = lag_share * (self.housing_k - self.sensor_k);
        self.sensor_k += sensor_change_k;
        let away_k = absolute(self.housing_k - self.reading_k) - UNMOVED_K - 2.0 * self.gas_sd_k;
        if measurement.gas.is_some_and(|gas| gas.moved) {
            self.unmoved_k = 0.0;
            self.frozen = false;
        } else {
            self.unmoved_k += lag_share * limit(away_k, 0.0, HOTTEST_K);
        }
        let reading = measurement.gas.filter(|_| !self.frozen);
        self.frozen |= self.unmoved_k > self.frozen_k;
        self.contradicted_intervals = self.contradicted_intervals.saturating_sub(1);
        self.distrusted &= self.contradicted_intervals > 0;
        self.set_conductance(surface_m2);
        self.set_leak(self.pressure_pa);
        // The mean of the readings belongs to the middle of the interval. Ten milliseconds seem little
        // beside a lag of seconds, but at a stroke's frequency a delay so small looks like a tenth of
        // a second more of lag. A digital part's readings say themselves how old they are.
        let age_steps = measurement.gas.and_then(|gas| gas.age_steps);
        let age = age_steps.map_or(0.5, |age_steps| age_steps / steps);
        let middle_k = self.sensor_k - age * sensor_change_k;
        if let Some(gas) = reading {
            self.reading_k = gas.value_k;
            self.pending.reading_k2 = gas.noise_k2 + self.bias_k2;
        }
        self.pending.innovation_k = reading.map(|gas| gas.value_k - middle_k);
    }

    /// What an interval's flow makes of the gas near the port.
    fn mix_port(&mut self, interval: &Interval, gas_k: f32, per_mass: f32) {
        let replaced = |flow_kg: f32, share: f32| limit(flow_kg * per_mass * share, 0.0, 1.0);
        let colder_k = self.config.supply.temperature_k - gas_k;
        let inflow_k = self.config.estimator.port_cooling * colder_k - self.port_k;
        self.port_k += replaced(interval.inflow_kg, 1.0 / PORT_SHARE) * inflow_k;
        let left = replaced(interval.outflow_kg, PORT_REPLACED / PORT_SHARE);
        let mixed = limit(self.interval_s * (1.0 / PORT_MIXING_S), 0.0, 1.0);
        self.port_k -= limit(left + mixed, 0.0, 1.0) * self.port_k;
    }

    fn add_drift(&mut self) {
        let drift = &self.config.estimator;
        let duration_s = self.interval_s;
        let relative = drift.gas_drift_k / self.pending.gas_k;
        let p = &mut self.covariance;
        p.gas_gas += relative * relative * duration_s;
        if self.leaks {
            let leaked = self.pending.leaked;
            p.gas_gas += LEAK_UNCERTAINTY_S * leaked * leaked / duration_s;
        }
        p.wall_wall += drift.wall_drift_k * drift.wall_drift_k * duration_s;
        // Rounding must not starve the sensor's own variance.
        p.sensor_sensor += 1.0e-6;
        // First-order Gauss-Markov: what is not seen again returns to the configured value.
        let forget = duration_s / drift.memory_s;
        p.forget(1.0 - forget);
        p.scale_scale += 2.0 * forget * drift.heat_scale_sd * drift.heat_scale_sd;
        p.lag_lag += 2.0 * forget * drift.lag_sd * drift.lag_sd;
        p.limit();
    }

    /// Kalman update with the innovation of one interval's readings of the gas sensor.
    fn correct(&mut self, innovation: f32) {
        let p = self.covariance;
        let reading_k2 = self.pending.reading_k2;
        let per_s = 1.0 / (p.sensor_sensor + reading_k2);
        let [gas, wall, sensor, scale, lag] = [
            p.gas_sensor * per_s,
            p.wall_sensor * per_s,
            p.sensor_sensor * per_s,
            p.sensor_scale * per_s,
            p.sensor_lag * per_s,
        ];
        self.covariance.reduce(gas, wall, scale, lag, reading_k2 * per_s);

        // u = dT/T = -dm/m
        let relative = limit(gas * innovation, -0.05, 0.05);
        self.mass_kg = CompensatedSum::new(self.mass_kg.value() / (1.0 + relative));
        self.update_temperature();
        self.wall_k = limit(self.wall_k + wall * innovation, COLDEST_K, HOTTEST_K);
        self.sensor_k += sensor * innovation;
        if self.unmoved_k > 0.0 {
            // It may be frozen: a lag learnt from that would say that nothing had to move.
            return;
        }
        self.scale = limit(self.scale * exp(limit(scale * innovation, -0.1, 0.1)), 0.2, 5.0);
        self.lag_s = limit(
            self.lag_s * exp(limit(lag * innovation, -0.1, 0.1)),
            0.2 * self.config.sensors.gas.time_constant_s,
            5.0 * self.config.sensors.gas.time_constant_s,
        );
    }

    /// What is stated: the covariance, as far as readings and model disagree, the noise of one pressure, and
    /// what cannot be seen.
    ///
    /// A foil slower than a stroke sees the product of lag and scale, not each of them. Where one alone was configured
    /// wrong, one alone is learnt; that both change says that neither is sure, and readings that agree prove nothing.
    ///
    /// The swing is the mean one and not that of this instant: errors return with the stroke, but not in its phase.
    fn update_deviation(&mut self) {
        let noise = self.pressure_sd_pa / self.pressure_pa;
        let left = self.energy.noise_left() + NOT_AVERAGED;
        let share = limit(self.place * self.agreement.share(self.lag_s), 0.0, 1.0);
        let swing_k = self.gas_k - self.wall_k;
        self.swing_k2 += self.swing_window * (swing_k * swing_k - self.swing_k2);
        let port = self.config.estimator.port_cooling;
        let lag = absolute(self.lag_s * self.per_lag_s - 1.0) - ZONES_LAG * port;
        let wall = absolute(1.0 / self.scale - 1.0);
        let both = limit(lag, 0.0, 1.0) * limit(wall, 0.0, 1.0);
        let learnt = LEARNT * limit(both - LEARNT_FLOOR, 0.0, 1.0);
        let swings = learnt + ZONES * port + DISAGREED * share;
        let unseen_k2 = swings * self.swing_k2 + ZONES_K2 * port;
        let per_gas = 1.0 / self.gas_k;
        let variance = share * share * self.covariance.gas_gas
            + left * noise * noise
            + unseen_k2 * per_gas * per_gas;
        self.gas_sd_k = self.gas_k * limit(sqrt(variance), 1.0e-6, 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::chamber::AnyChamber;
    use crate::sensing::Validity;
    use proptest::prelude::*;

    fn reading(value: f32) -> Reading {
        Reading { value, wide: 0.0, validity: Validity::Valid }
    }

    /// Valves and sensors of a step; `flow`: 1 in, 2 out.
    fn muscle() -> AnyChamber {
        AnyChamber::new(&Config::default().chamber)
    }

    fn measurement(pressure_pa: f32, length_m: f32, gas_k: f32, flow: u8) -> Measurement {
        Measurement {
            pressure: (pressure_pa > 0.0).then_some(reading(pressure_pa)),
            length: reading(length_m),
            gas: (gas_k > 0.0).then_some(GasReading {
                value_k: gas_k,
                noise_k2: 1.0e-4,
                moved: true,
                age_steps: None,
            }),
            openings: Openings {
                turned: false,
                driven: flow != 0,
                charging: flow & 1 != 0,
                discharging: flow & 2 != 0,
            },
            busy: false,
        }
    }

    #[test]
    fn a_turn_is_one_where_nothing_flowed_before_too() {
        let still = Openings::default();
        let turned = Openings { turned: true, ..still };
        assert_eq!([false, true].map(|flowing| turned.flow_state(flowing)), [FlowState::Turned; 2]);
        assert_eq!(
            [still.flow_state(false), still.flow_state(true)],
            [FlowState::Shut, FlowState::Open]
        );
    }

    /// A fast fill moves the element further in one interval than a frozen reading is allowed, and the
    /// reading with it.
    #[test]
    fn a_reading_that_moves_is_not_frozen_however_fast_its_element() {
        let mut config = Config::default();
        config.sensors.gas.time_constant_s = 0.3;
        config.sensors.gas.housing_time_constant_s = 0.001;
        for (moved, implausible) in [(true, false), (false, true)] {
            let mut estimator = Estimator::new(&config);
            let shown = (0..140_u16).any(|step| {
                let after = f32::from(step.saturating_sub(40));
                let gas_k = 298.0 + if moved { 0.05 * after } else { 0.0 };
                let measurement =
                    measurement(1.2e5 + 3.0e3 * after, 0.28, gas_k, u8::from(step >= 40));
                let gas = measurement.gas.map(|gas| GasReading { moved, ..gas });
                estimator.step(&muscle(), &Measurement { gas, ..measurement });
                estimator.sensor_implausible()
            });
            assert_eq!(shown, implausible, "moved: {moved}");
        }
    }

    /// Ten seconds at rest at 25 degC with a gas sensor that says 25 degC and then `reads_k`; the last
    /// estimate.
    fn contradicted(ambient_k: f32, reads_k: f32) -> (Estimator, Estimate) {
        let mut config = Config::default();
        config.ambient.temperature_k = ambient_k;
        let mut estimator = Estimator::new(&config);
        for step in 0..30_000_u16 {
            let gas_k = if step < 20_000 { 298.0 } else { reads_k };
            estimator.step(&muscle(), &measurement(2.0e5, 0.28, gas_k, 0));
        }
        let estimate = estimator.estimate();
        (estimator, estimate)
    }

    #[test]
    fn of_two_that_contradict_the_one_further_from_ambient_is_wrong() {
        let (estimator, estimate) = contradicted(298.0, 318.0);
        assert!(estimator.sensor_implausible());
        assert!((297.0..300.0).contains(&estimate.gas_k), "the sensor: {estimate:?}");
        let (estimator, estimate) = contradicted(318.0, 318.0);
        assert!(estimator.sensor_implausible());
        assert!((315.0..320.0).contains(&estimate.gas_k), "the state: {estimate:?}");
    }

    /// A shut muscle whose pressure falls by 2 % a second, slowly enough that the gas keeps the temperature of its
    /// wall, with a leak configured that is so many times what it has: the largest error in half a minute \[K\], and
    /// the smallest share of the gas that an interval gained, at the least and at the most.
    fn leaking(configured: f32) -> (f32, f32, f32) {
        let mut config = Config::default();
        let volume_m3 = muscle().volume_m3(0.28);
        let per_s = 0.02;
        let root = sqrt(293.15 * 298.0);
        // Choked: C rho0 R sqrt(T0 T)/V of the gas leave in a second, and rho0 R T0 is 100 kPa.
        let true_m3_s_pa = per_s * volume_m3 / (1.0e5 * root / 293.15);
        config.leak.conductance_m3_s_pa = configured * true_m3_s_pa;
        let mut estimator = Estimator::new(&config);
        let (mut worst_k, mut least, mut most) = (0.0_f32, f32::MAX, f32::MAX);
        for step in 0..30_000_u16 {
            let pressure_pa = 6.5e5 * exp(-per_s * 1.0e-3 * f32::from(step));
            estimator.step(&muscle(), &measurement(pressure_pa, 0.28, 298.0, 0));
            worst_k = worst_k.max((estimator.estimate().gas_k - 298.0).abs());
            if let Some(balance) = estimator.take_balance() {
                least = least.min(balance.least_gained);
                most = most.min(balance.most_gained);
            }
        }
        (worst_k, least, most)
    }

    #[test]
    fn a_leak_that_is_told_is_no_change_of_temperature() {
        let (worst_k, least, most) = leaking(1.0);
        // Not none: the heat of the wall, R T dm/dt, needs a wall that is a kelvin warmer.
        assert!(worst_k < 0.3, "{worst_k} K");
        // 4e-4 have left in 20 ms. Without heat a pressure says cv/cp of that; at the most, all is explained.
        assert!((-4.0e-4..-2.7e-4).contains(&least), "{least}");
        assert!((0.0..2.0e-4).contains(&most), "{most}");
        let (untold_k, _, most) = leaking(0.0);
        assert!((20.0..60.0).contains(&untold_k), "{untold_k} K");
        assert!((-4.0e-4..-2.7e-4).contains(&most), "{most}");
        for configured in [0.8, 1.2] {
            let (wrong_k, ..) = leaking(configured);
            assert!((0.5..2.0).contains(&wrong_k), "configured {configured} times: {wrong_k} K");
        }
    }

    /// A loss of the pressure, whenever it comes and however long it is, leaves either the covariance
    /// of before or a fresh one: nothing that is sure of what it cannot know.
    #[test]
    fn a_lost_pressure_leaves_nothing_stale() {
        let config = Config::default();
        let healthy = measurement(2.0e5, 0.28, 298.0, 0);
        let lost = measurement(0.0, 0.28, 298.0, 0);
        for before in (0..3).chain(2000..2020) {
            for missing in [10, 11, 12, 15, 20, 27, 40] {
                let mut estimator = Estimator::new(&config);
                for _ in 0..before {
                    estimator.step(&muscle(), &healthy);
                }
                for _ in 0..missing {
                    estimator.step(&muscle(), &lost);
                }
                for step in 0..200 {
                    estimator.step(&muscle(), &healthy);
                    let Estimate { gas_sd_k, valid, .. } = estimator.estimate();
                    assert!(gas_sd_k > 2.0 && !valid, "{gas_sd_k} K, {before}, {missing}, {step}");
                }
            }
        }
    }

    #[test]
    fn a_sensor_beyond_what_gas_can_be_starts_within_it() {
        let mut config = Config::default();
        config.estimator.initial_sd_k = 0.0;
        let mut estimator = Estimator::new(&config);
        assert!(estimator.estimate().gas_sd_k > 0.0);
        estimator.step(&muscle(), &measurement(2.0e5, 0.28, 73.5, 0));
        let Estimate { gas_k, wall_k, .. } = estimator.estimate();
        assert!([gas_k, wall_k].iter().all(|t| (COLDEST_K..100.1).contains(t)), "{gas_k} {wall_k}");
    }

    proptest! {
        /// Whatever the lines say, every figure stays finite, and a minute of sense later the
        /// estimate is right again.
        #[test]
        fn it_finds_back_from_nonsense(
            nonsense in proptest::collection::vec(
                (-1.0e5_f32..1.0e6, 0.2_f32..0.3, -10.0_f32..340.0, 0_u8..4, 1_usize..80),
                1..40,
            ),
        ) {
            let config = Config::default();
            let mut estimator = Estimator::new(&config);
            for (pressure_pa, length_m, reads_k, flow, steps) in nonsense {
                for _ in 0..steps {
                    estimator.step(&muscle(), &measurement(pressure_pa, length_m, reads_k, flow));
                    let Estimate { gas_k, gas_sd_k, wall_k, mass_kg, .. } = estimator.estimate();
                    prop_assert!([gas_k, wall_k].iter().all(|t| (100.0..=1000.0).contains(t)));
                    prop_assert!(gas_sd_k.is_finite() && gas_sd_k > 0.0 && mass_kg > 0.0);
                }
            }
            // Closed, at rest, 25 degC.
            for _ in 0..60_000 {
                estimator.step(&muscle(), &measurement(2.0e5, 0.28, 298.0, 0));
            }
            let Estimate { gas_k, gas_sd_k, .. } = estimator.estimate();
            prop_assert!((gas_k - 298.0).abs() < 3.0 + 3.0 * gas_sd_k, "{gas_k} +- {gas_sd_k}");
            prop_assert!(gas_sd_k < 10.0, "{gas_sd_k}");
        }
    }
}
