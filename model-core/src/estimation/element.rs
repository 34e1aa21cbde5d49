//! The gas sensor's element in its housing, and whether its readings can be believed.

use super::per_zone::{PerZone, ZONES, minus, plus, scaled, times, total};
use super::profile::{Conduction, Profile};
use super::zones::Exchange;
use super::{Coefficients, HOTTEST_K};
use crate::math::{absolute, limit, small_exp, sqrt};
use crate::sensing::GasReading;

/// Below this difference, beside twice the stated deviation, the gas need not move its element \[K\].
const UNMOVED_K: f32 = 0.3;
/// Averaged over half a second, innovations beyond this many deviations show that readings and state contradict each
/// other.
const CONTRADICTION: f32 = 5.0;
/// Largest distance from ambient temperature to which strokes take an element that follows the gas \[K\]: assumed.
const SWINGS_K: f32 = 30.0;
/// A bias of the readings beyond this many deviations is not an error of the filter. Measured: 24 h of healthy muscles
/// whose heat, lag, wall, friction and load are configured wrong by up to a factor of two never reach it, and 100
/// sensors that drift by 0.5 K/s or more do within 20 s; with 2.6 one of them takes 22 s.
const BIASED: f32 = 2.4;
/// A bias that has moved the housing by less \[K\] may come from the room or the sun. An assumption; sensors that drift
/// by 0.5 K/s or more move it by at least 8 K.
const LEAST_DRIFT_K: f32 = 5.0;
/// Updates of variance with which a bias starts, four seconds: a few innovations show none.
const UNBIASED_UPDATES: f32 = 100.0;
/// Range of the estimated lags and of the foil's place about the configured values: a factor, and a share of the
/// length.
const LAGS: f32 = 12.0;
const PLACES: f32 = 0.4;
/// Least distance of a foil's middle from the ends, share of the length: half a foil of 30 mm in a muscle of 250 mm
/// (assumption).
const FOIL_END: f32 = 0.06;

/// Bias of the innovations over some seconds. If the filter's model holds, the innovations are white: divided by their
/// deviations, their sum has the variance of their number.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Bias {
    sum: f32,
    variance: f32,
    /// Corrections of the housing \[K\].
    moved_k: f32,
}

impl Bias {
    const NONE: Self = Self { sum: 0.0, variance: UNBIASED_UPDATES, moved_k: 0.0 };

    /// Adds an innovation, in its deviations, that moved the housing by `moved_k` \[K\]; `kept`: share of the sums that
    /// an interval keeps.
    fn add(&mut self, kept: f32, deviations: f32, moved_k: f32) {
        self.sum = kept * self.sum + deviations;
        self.moved_k = kept * self.moved_k + moved_k;
        self.variance = kept * kept * self.variance + 1.0;
    }

    /// Returns whether the bias exceeds the filter's errors and leads away from ambient; `above_k`: the reading above
    /// ambient.
    fn is_drift(&self, above_k: f32) -> bool {
        self.sum * above_k > 0.0
            && absolute(self.moved_k) > LEAST_DRIFT_K
            && self.sum * self.sum > BIASED * BIASED * self.variance
    }
}

/// The element: T_s' = (T_h - T_s)/tau, T_h' = (T_f - T_h)/tau_h.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Element {
    pub housing_k: f32,
    pub sensor_k: f32,
    /// Difference of the gas at the foil from its zone \[K\].
    pub foil_k: f32,
    /// Profile of the gas around the foil, how much warmer the gas is there than in the mean of the section \[K\], and
    /// the gain on an error of that mean.
    pub profile: Profile,
    above_k: f32,
    gain: f32,
    /// Estimated lags of element and housing \[s\].
    pub lag_s: f32,
    pub housing_lag_s: f32,
    /// Offset of the foil's place from the configured one, share of the length \[-\].
    pub place: f32,
    /// Weights of the zones in what the foil sees, and their change with its place \[-\].
    weights: PerZone,
    slope: PerZone,
    /// Last reading \[K\].
    pub reading_k: f32,
    /// Distance that the element should have moved in the intervals since the reading last changed \[K\].
    unmoved_k: f32,
    frozen: bool,
    /// Updates for which a contradiction of readings and model is still reported.
    contradicted_updates: u16,
    /// Whether the sensor is the wrong one of the two; its readings then correct nothing.
    distrusted: bool,
    /// Innovations, averaged twice \[K\].
    smooth_k: f32,
    smoother_k: f32,
    bias: Bias,
}

/// Response of housing and element in an interval.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Response {
    /// Shares of housing's and element's differences that remain \[-\].
    pub housing_left: f32,
    pub element_left: f32,
    /// Changes \[K\].
    pub housing_k: f32,
    pub element_k: f32,
    /// Mean of the element, times the steps \[K\].
    pub mean_k: f32,
    /// Mean zones around the foil, times the steps \[K\].
    pub zones_k: PerZone,
    /// Gain of what the foil sees on an error of the wall, times the steps \[-\].
    pub wall: f32,
}

impl Response {
    /// None yet.
    pub const NONE: Self = Self {
        housing_left: 1.0,
        element_left: 1.0,
        housing_k: 0.0,
        element_k: 0.0,
        mean_k: 0.0,
        zones_k: [0.0; ZONES],
        wall: 0.0,
    };
}

/// Weights of the zones at this place: of a straight line through the middles of the nearest two.
#[inline(never)] // Five times with each interval, and long.
fn interpolated(place: f32) -> PerZone {
    let at = ZONES as f32 * limit(place, FOIL_END, 1.0 - FOIL_END) - 0.5;
    if at < 0.0 {
        return [1.0 - at, at, 0.0, 0.0];
    }
    if at > 3.0 {
        return [0.0, 0.0, 3.0 - at, at - 2.0];
    }
    [0.0, 1.0, 2.0, 3.0].map(|zone| limit(1.0 - absolute(at - zone), 0.0, 1.0))
}

impl Element {
    /// Creates an element at this temperature \[K\], without a reading yet.
    pub fn new(temperature_k: f32, c: &Coefficients) -> Self {
        let mut element = Self {
            housing_k: temperature_k,
            sensor_k: temperature_k,
            foil_k: 0.0,
            profile: Profile::default(),
            above_k: 0.0,
            gain: 1.0,
            lag_s: c.lag_s,
            housing_lag_s: c.housing_s,
            place: 0.0,
            weights: [0.0; ZONES],
            slope: [0.0; ZONES],
            reading_k: temperature_k,
            unmoved_k: 0.0,
            frozen: false,
            contradicted_updates: 0,
            distrusted: false,
            smooth_k: 0.0,
            smoother_k: 0.0,
            bias: Bias::NONE,
        };
        element.set_weights(c);
        element
    }

    /// Sets housing and element to one temperature \[K\].
    pub fn set_temperature(&mut self, temperature_k: f32) {
        self.housing_k = temperature_k;
        self.sensor_k = temperature_k;
        self.foil_k = 0.0;
        self.profile = Profile::default();
    }

    /// Sets the learnt values back to the configured ones.
    pub fn forget(&mut self, c: &Coefficients) {
        (self.lag_s, self.housing_lag_s, self.place, self.foil_k) =
            (c.lag_s, c.housing_s, 0.0, 0.0);
        (self.smooth_k, self.smoother_k) = (0.0, 0.0);
        self.forget_bias();
        self.set_weights(c);
    }

    /// Restarts the watch for a frozen reading.
    pub fn forget_standstill(&mut self) {
        self.unmoved_k = 0.0;
    }

    fn set_weights(&mut self, c: &Coefficients) {
        const APART: f32 = 0.125;
        let place = c.place + self.place;
        let [before, at, after] =
            [-1.0, 0.0, 1.0].map(|way| interpolated(place + way * c.half_span));
        let ends = plus(&before, &after);
        // Simpson's rule over the foil.
        self.weights = plus(&scaled(&ends, 1.0 / 6.0), &scaled(&at, 4.0 / 6.0));
        let slope = minus(&interpolated(place + APART), &interpolated(place - APART));
        self.slope = scaled(&slope, 0.5 / APART);
    }

    /// Returns the change of what the foil sees with its place \[K\].
    pub fn slope_k(&self, zones_k: &PerZone) -> f32 {
        total(&times(&self.slope, zones_k))
    }

    /// Moves the profile around the foil, in zones that are `excess_k` warmer than their wall \[K\].
    pub fn conduct(&mut self, c: &Coefficients, exchange: &Exchange, excess_k: &PerZone) {
        let conduction = Conduction::seen(&exchange.still.conduction, &self.weights);
        self.profile.advance(&conduction, total(&times(&self.weights, excess_k)));
        // Stirring flattens it.
        let share = exchange.still_share(&self.weights);
        self.above_k = share * self.profile.foil_k(&c.profile);
        self.gain = 1.0 + share * c.foil_settled;
    }

    /// Moves housing and element by some steps with zones of these mean temperatures \[K\].
    pub fn follow(
        &mut self,
        zones_k: &PerZone,
        (steps, step_s): (f32, f32),
        response: &mut Response,
    ) {
        let duration_s = steps * step_s;
        let seen_k = times(&self.weights, zones_k);
        let foil_k = total(&seen_k) + self.above_k + self.foil_k;
        // Means on both sides: implicit Euler then delays by exactly the lag.
        let housing_share = duration_s / (self.housing_lag_s + duration_s);
        let housing_k = housing_share * (foil_k - self.housing_k);
        self.housing_k += housing_k;
        let element_share = duration_s / (self.lag_s + 0.5 * duration_s);
        let element_k = limit(element_share, 0.0, 1.0) * (self.housing_k - self.sensor_k);
        self.sensor_k += element_k;
        response.housing_left *= 1.0 - housing_share;
        response.element_left *= 1.0 - limit(element_share, 0.0, 1.0);
        response.housing_k += housing_k;
        response.element_k += element_k;
        response.mean_k += steps * (self.sensor_k - 0.5 * element_k);
        response.zones_k = plus(&response.zones_k, &scaled(&seen_k, self.gain * steps));
        // The profile is relative to the wall.
        response.wall += (1.0 - self.gain) * steps;
    }

    /// Returns the interval's reading, unless it is frozen.
    pub fn judge(
        &mut self,
        coefficients: &Coefficients,
        gas: Option<GasReading>,
        lag_share: f32,
        gas_sd_k: f32,
    ) -> Option<GasReading> {
        let away_k = absolute(self.housing_k - self.reading_k) - UNMOVED_K - 2.0 * gas_sd_k;
        if gas.is_some_and(|gas| gas.moved) {
            self.unmoved_k = 0.0;
            self.frozen = false;
        } else {
            self.unmoved_k += lag_share * limit(away_k, 0.0, HOTTEST_K);
        }
        let reading = gas.filter(|_| !self.frozen);
        self.frozen |= self.unmoved_k > coefficients.frozen_k;
        self.contradicted_updates = self.contradicted_updates.saturating_sub(1);
        self.distrusted &= self.contradicted_updates > 0;
        reading
    }

    /// Takes an innovation \[K\] of this variance \[K2\]. Returns whether readings and model contradict each other and
    /// the model is wrong.
    pub fn compare(&mut self, c: &Coefficients, innovation_k: f32, variance_k2: f32) -> bool {
        self.smooth_k += c.smoothing * (innovation_k - self.smooth_k);
        self.smoother_k += c.smoothing * (self.smooth_k - self.smoother_k);
        self.smoother_k * self.smoother_k > CONTRADICTION * CONTRADICTION * variance_k2
            && self.contradict(c)
    }

    /// Watches for a bias of the innovations that corrected something. A drifting reading takes the estimates of gas,
    /// wall and foil along: no innovation is large, but all have one sign. If they lead back to ambient, the model
    /// errs.
    pub fn watch(
        &mut self,
        c: &Coefficients,
        (innovation_k, variance_k2): (f32, f32),
        housing_gain: f32,
    ) {
        if self.contradicted_updates > 0 {
            self.forget_bias();
            return;
        }
        let deviations = innovation_k / sqrt(variance_k2);
        self.bias.add(c.bias_kept, deviations, housing_gain * innovation_k);
        if self.bias.is_drift(self.reading_k - c.ambient.temperature_k) {
            self.contradicted_updates = c.counts.ten_seconds_updates;
            self.distrusted = true;
        }
    }

    /// Restarts the watch for a bias.
    pub fn forget_bias(&mut self) {
        self.bias = Bias::NONE;
    }

    /// Decides which is wrong, since readings and model cannot both be right; returns whether it is the model. Gas in a
    /// muscle returns to its surroundings within seconds, and so does the element: the one further from ambient is
    /// wrong. Distrusted readings stay distrusted until they have agreed with the model for ten seconds, unless the
    /// model is far outside the range in which an element swings.
    fn contradict(&mut self, coefficients: &Coefficients) -> bool {
        self.contradicted_updates = coefficients.counts.ten_seconds_updates;
        let ambient_k = coefficients.ambient.temperature_k;
        let swings_k = if self.distrusted { SWINGS_K } else { 0.0 };
        self.distrusted =
            absolute(self.reading_k - ambient_k) > absolute(self.sensor_k - ambient_k) - swings_k;
        !self.distrusted
    }

    pub fn distrusted(&self) -> bool {
        self.distrusted
    }

    /// Whether the reading may be frozen: a lag learnt from it would mean that nothing had to move, and the wall would
    /// follow it and stay there.
    pub fn stands_still(&self) -> bool {
        self.unmoved_k > 0.0
    }

    pub fn implausible(&self) -> bool {
        self.frozen || self.contradicted_updates > 0
    }

    /// Corrects the lags by factors, given as logarithms, and the place.
    pub fn correct(&mut self, c: &Coefficients, lag: f32, housing_lag: f32, place: f32) {
        let by = |lag_s: f32, logarithm: f32, configured_s: f32| {
            limit(lag_s * small_exp(logarithm), configured_s / LAGS, configured_s * LAGS)
        };
        self.lag_s = by(self.lag_s, lag, c.lag_s);
        self.housing_lag_s = by(self.housing_lag_s, housing_lag, c.housing_s);
        self.place = limit(self.place + place, -PLACES, PLACES);
        self.set_weights(c);
    }

    /// Fades the learnt values by one share per interval, and the difference at the foil by another.
    pub fn fade(&mut self, c: &Coefficients) {
        let share = c.forget;
        self.lag_s += share * (c.lag_s - self.lag_s);
        self.housing_lag_s += share * (c.housing_s - self.housing_lag_s);
        self.place -= share * self.place;
        self.foil_k *= c.keep.foil;
    }
}

#[cfg(test)]
mod tests {
    use super::super::zones::Still;
    use super::*;
    use crate::config::Config;

    /// Still gas that a source keeps 1 K above its wall has no profile if the wall is taken to be 1 K warmer.
    #[test]
    fn an_error_of_the_wall_is_seen_by_the_foil() {
        let mut config = Config::default();
        (config.zones.bore_m, config.zones.foil_radius) = (0.02, 0.0);
        let c = Coefficients::new(&config);
        let mut element = Element::new(300.0, &c);
        let conduction = [Conduction::new(&c.profile, 0.001, 2.3, 0.02); ZONES];
        let still = Still { conduction, formed_j_k: [1.0; ZONES], ..Still::default() };
        let exchange = Exchange { still, ..Exchange::default() };
        for _ in 0..100_000 {
            element.conduct(&c, &exchange, &[1.0; ZONES]);
        }
        let mut response = Response::NONE;
        element.follow(&[301.0; ZONES], (10.0, 0.001), &mut response);
        assert!((0.9..1.1).contains(&element.above_k), "{}", element.above_k);
        let by_wall = response.wall / 10.0;
        assert!((by_wall + element.above_k).abs() < 0.03, "{by_wall}");
    }
}
