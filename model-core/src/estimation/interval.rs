//! The end of an interval: slow states move, and the covariance's work is left for the steps that follow.

use super::covariance::{Product, Transition};
use super::deviation::Inputs;
use super::{Balance, COLDEST_K, Coefficients, Estimator, HOTTEST_K, Measurement};
use crate::math::{CompensatedSum, absolute, exp, limit};
use crate::physics::chamber::Chamber;

/// Innovations that stay beyond so many deviations of the reading, averaged over half a second, show
/// that the state is wrong and not the reading.
const CONTRADICTION: f32 = 5.0;
/// Parts of the work that an interval leaves, and the step of the next one in which it begins: the first is
/// the controller's.
const PARTS: u16 = 5;
const FIRST_PART: u16 = 2;
/// Gas near the port, share of the gas that an inflow has to replace before it is as cold as
/// [`EstimatorConfig::port_cooling`](crate::config::EstimatorConfig) gives \[-\].
const PORT_SHARE: f32 = 0.5;
/// Share of the outflow, relative to that, by which the gas behind it has taken its place \[-\].
const PORT_REPLACED: f32 = 0.4;
/// Time in which the rest mixes with the gas near the port \[s\].
const PORT_MIXING_S: f32 = 2.0;
/// Excess of the gas around the foil over the mean, for each kelvin by which that near the port is
/// colder \[-\].
const FOIL_WARMER: f32 = 0.08;
/// Variance that a leak adds per second, in squares of its rate: configured a tenth wrong, for five seconds \[s\].
const LEAK_UNCERTAINTY_S: f32 = 0.1;

/// Sums over one interval.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Interval {
    pub steps: u16,
    pub gas_k: f32,
    pub inflow_kg: f32,
    pub outflow_kg: f32,
    pub heat_j: f32,
    pub flowing_steps: u16,
    /// Work of the gas, and its measured internal energy at the start \[J\].
    pub work_j: f32,
    pub start_j: f32,
    /// Enthalpy that leaked \[J\].
    pub leaked_j: f32,
    /// A step of it had no pressure.
    pub void: bool,
}

/// Work that the end of an interval leaves for the next steps, one part each. A part carries the result of
/// the part before it, so that none can run on another covariance's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) enum Work {
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

/// Inputs of the work that is left.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Pending {
    pub work: Work,
    /// Mean gas temperature of the interval \[K\].
    pub gas_k: f32,
    pub innovation_k: Option<f32>,
    /// Gas flowed.
    pub moved: bool,
    /// Variance of the mean of the interval's readings of the gas sensor \[K2\].
    pub reading_k2: f32,
    /// Share of the gas that leaked in the interval \[-\].
    pub leaked: f32,
}

/// Exchange of heat over one interval, linearised.
struct Exchange {
    /// Share of the difference between wall and ambient that the wall loses \[-\].
    outer_share: f32,
    /// Heat from the gas to the wall \[J/K\].
    inner_j_k: f32,
    /// Relative change of the gas per relative difference of its temperature, while gas flows \[-\].
    gas: f32,
}

impl Estimator {
    /// The work of an interval, one part a step, kept clear of the steps in which the controller has its own
    /// to do, as long as there are others left.
    pub(super) fn advance_covariance(&mut self, chamber: &impl Chamber, measurement: &Measurement) {
        let left = self.coefficients.counts.interval_steps.saturating_sub(self.interval.steps);
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
                self.take_innovation();
            }
            Work::Deviation => self.update_deviation(),
        }
    }

    fn take_innovation(&mut self) {
        let innovation_k = self.pending.innovation_k.take();
        if let (Some(innovation_k), false) = (innovation_k, self.element.distrusted()) {
            self.correct(innovation_k);
        }
        self.agreement.add(innovation_k, self.element.lag_s, self.pending.moved);
        let expected_k2 = self.coefficients.lasting_k2 + self.covariance.sensor_sensor;
        if self.agreement.smooth_k2() > CONTRADICTION * CONTRADICTION * expected_k2
            && self.element.contradict(&self.coefficients)
        {
            self.give_up();
        }
    }

    fn end_interval(&mut self, chamber: &impl Chamber, measurement: &Measurement) {
        let length_m = measurement.length.value;
        let interval = core::mem::take(&mut self.interval);
        if interval.void {
            self.pending.work = Work::Drift;
            return;
        }
        let Coefficients { counts, interval_s, lag_s, wall_j_k, .. } = self.coefficients;
        let gas_k = interval.gas_k / f32::from(counts.interval_steps);
        let way_m = self.length_m - length_m;
        let speed_m_s = -way_m / interval_s;
        self.length_m = length_m;
        let friction_j = self.rub(way_m);
        let surface_m2 = chamber.surface_m2(length_m);

        self.element.follow(&self.coefficients, gas_k - FOIL_WARMER * self.port_k);
        let lag_share = self.element.lag_share(interval_s);
        let per_mass = 1.0 / self.mass_kg.value();
        self.mix_port(&interval, gas_k, per_mass);
        self.balance(&interval, gas_k, per_mass);
        let exchange = self.exchange(&interval, surface_m2, speed_m_s, per_mass);
        self.pending.gas_k = gas_k;
        self.pending.moved = interval.flowing_steps > 0;
        self.pending.work =
            Work::Rows(self.transition(&interval, &exchange, gas_k, per_mass, lag_share));

        let forget = interval_s / self.coefficients.tuning.memory_s;
        self.scale += forget * (1.0 - self.scale);
        self.element.lag_s += forget * (lag_s - self.element.lag_s);
        let warming_k = (interval.heat_j + friction_j) * (1.0 / wall_j_k)
            - exchange.outer_share * (self.wall_k - self.coefficients.ambient.temperature_k);
        self.wall_k = limit(self.wall_k + warming_k, COLDEST_K, HOTTEST_K);
        self.set_conductance(surface_m2);
        self.set_leak(self.pressure_pa);
        self.read_element(measurement, lag_share);
    }

    /// Moves slip and creep by an interval's contraction; returns the heat that the wall gets of them and
    /// of friction \[J\].
    fn rub(&mut self, way_m: f32) -> f32 {
        let Coefficients { hysteresis, friction, ambient, .. } = &self.coefficients;
        let softening = friction.softening(self.wall_k);
        let gauge_pa = self.pressure_pa - ambient.pressure_pa;
        let held = hysteresis.after(&self.held, way_m, gauge_pa, softening);
        let heat_j = hysteresis.heat_j(&self.held, &held, way_m)
            + softening * friction.force_n * friction.at_pressure(gauge_pa) * absolute(way_m);
        self.held = held;
        friction.heat_fraction * heat_j
    }

    /// Moves the element by an interval, and compares it with its reading.
    fn read_element(&mut self, measurement: &Measurement, lag_share: f32) {
        let c = &self.coefficients;
        let change_k = self.element.warm(lag_share);
        let reading = self.element.judge(c, measurement.gas, lag_share, self.deviation.gas_sd_k);
        // The mean of the readings belongs to the middle of the interval. Ten milliseconds seem little
        // beside a lag of seconds, but at a stroke's frequency a delay so small looks like a tenth of
        // a second more of lag. A digital part's readings carry their own age.
        let age_steps = measurement.gas.and_then(|gas| gas.age_steps);
        let age = age_steps.map_or(0.5, |age_steps| age_steps / f32::from(c.counts.interval_steps));
        let middle_k = self.element.sensor_k - age * change_k;
        if let Some(gas) = reading {
            self.element.reading_k = gas.value_k;
            self.pending.reading_k2 = gas.noise_k2 + c.bias_k2;
        }
        self.pending.innovation_k = reading.map(|gas| gas.value_k - middle_k);
    }

    /// Records the balance of an interval, whatever heat transfer and leak were between none and the configured ones.
    fn balance(&mut self, interval: &Interval, gas_k: f32, per_mass: f32) {
        let adiabatic_j = self.measured_j - interval.start_j + interval.work_j;
        let per_cp = self.coefficients.per_cp;
        let share = |enthalpy_j: f32| enthalpy_j * per_cp * per_mass / gas_k;
        let mut most_j = adiabatic_j + limit(interval.heat_j, 0.0, f32::MAX);
        if self.coefficients.leaks {
            most_j += interval.leaked_j;
            // No number where next to no gas is left.
            self.pending.leaked = limit(share(interval.leaked_j), 0.0, 1.0);
        }
        self.balance = Some(Balance {
            least_gained: share(adiabatic_j + limit(interval.heat_j, f32::MIN, 0.0)),
            most_gained: share(most_j),
            pressure_pa: self.pressure_pa,
            mass_kg: self.mass_kg.value(),
            held_n: self.held.force_n(),
        });
    }

    fn exchange(
        &self,
        interval: &Interval,
        surface_m2: f32,
        speed_m_s: f32,
        per_mass: f32,
    ) -> Exchange {
        let c = &self.coefficients;
        let duration_s = c.interval_s;
        let per_wall = 1.0 / c.wall_j_k;
        let outer_w_k = c.heat.outer_w_k(surface_m2, speed_m_s);
        let inner_w_k = c.heat.inner_w_k(surface_m2, interval.inflow_kg / duration_s);
        let inner_j_k = self.scale * inner_w_k * duration_s;
        let flowing = f32::from(interval.flowing_steps) / f32::from(c.counts.interval_steps);
        Exchange {
            // A wall does not overshoot its surroundings.
            outer_share: limit(outer_w_k * duration_s * per_wall, 0.0, 1.0),
            inner_j_k,
            // Limited where there is next to no gas: its temperature is the wall's.
            gas: limit(inner_j_k * per_mass * c.per_cp * flowing, 0.0, 0.5),
        }
    }

    /// The linearised error dynamics of an interval: the table at the head of this module.
    fn transition(
        &self,
        interval: &Interval,
        exchange: &Exchange,
        gas_k: f32,
        per_mass: f32,
        lag_share: f32,
    ) -> Transition {
        let per_wall = 1.0 / self.coefficients.wall_j_k;
        let Exchange { outer_share, inner_j_k, gas, .. } = *exchange;
        Transition {
            gas_gas: -limit(gas + interval.inflow_kg * per_mass, 0.0, 0.9),
            gas_wall: gas / gas_k,
            gas_scale: -gas * (gas_k - self.wall_k) / gas_k,
            wall_gas: inner_j_k * per_wall * gas_k,
            wall_wall: -limit(inner_j_k * per_wall + outer_share, 0.0, 1.0),
            wall_scale: interval.heat_j * per_wall,
            sensor_gas: lag_share * gas_k,
            sensor_sensor: -lag_share,
            sensor_lag: -lag_share * (self.element.housing_k - self.element.sensor_k),
        }
    }

    /// Moves the temperature of the gas near the port by an interval's flow.
    fn mix_port(&mut self, interval: &Interval, gas_k: f32, per_mass: f32) {
        let c = &self.coefficients;
        let replaced = |flow_kg: f32, share: f32| limit(flow_kg * per_mass * share, 0.0, 1.0);
        let inflow_k = c.tuning.port_cooling * (c.supply_k - gas_k) - self.port_k;
        self.port_k += replaced(interval.inflow_kg, 1.0 / PORT_SHARE) * inflow_k;
        let left = replaced(interval.outflow_kg, PORT_REPLACED / PORT_SHARE);
        let mixed = limit(c.interval_s * (1.0 / PORT_MIXING_S), 0.0, 1.0);
        self.port_k -= limit(left + mixed, 0.0, 1.0) * self.port_k;
    }

    fn add_drift(&mut self) {
        let c = &self.coefficients;
        let drift = &c.tuning;
        let duration_s = c.interval_s;
        let relative = drift.gas_drift_k / self.pending.gas_k;
        let p = &mut self.covariance;
        p.gas_gas += relative * relative * duration_s;
        if c.leaks {
            let leaked = self.pending.leaked;
            p.gas_gas += LEAK_UNCERTAINTY_S * leaked * leaked / duration_s;
        }
        p.wall_wall += drift.wall_drift_k * drift.wall_drift_k * duration_s;
        // Rounding must not starve the sensor's own variance.
        p.sensor_sensor += 1.0e-6;
        // First-order Gauss-Markov: an error that is not seen again returns to the configured value.
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
        self.element.sensor_k += sensor * innovation;
        if self.element.stands_still() {
            return;
        }
        self.scale = limit(self.scale * exp(limit(scale * innovation, -0.1, 0.1)), 0.2, 5.0);
        self.element.correct_lag(&self.coefficients, lag * innovation);
    }

    fn update_deviation(&mut self) {
        self.deviation.update(
            &self.coefficients,
            &Inputs {
                gas_k: self.gas_k,
                wall_k: self.wall_k,
                pressure_pa: self.pressure_pa,
                noise_left: self.energy.noise_left(),
                disagreement: self.agreement.share(self.element.lag_s),
                lag_s: self.element.lag_s,
                scale: self.scale,
                gas_gas: self.covariance.gas_gas,
            },
        );
    }
}
