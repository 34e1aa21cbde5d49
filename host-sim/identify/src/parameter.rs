//! The parameters: keys of the scenario, and the scale that they are searched on.
//!
//! A value x between limits lo and hi is searched as u, ln x = ln lo + (ln hi - ln lo) s(u), with the
//! logistic function s: every u is allowed, and x never leaves its limits or changes sign.

use thermyo_scenario::schema::{fittable, limits};
use thermyo_scenario::{Scenario, number};

/// Where zero is the lowest allowed value, the search stays between the start divided by this
/// factor and the start times it.
const WIDEST: f64 = 1e4;
/// A value this close to a limit, as a fraction of the logarithmic range, counts as at the limit.
const AT_LIMIT: f64 = 1e-3;
/// Closest to a limit that a search starts: nearer, the logistic function is too flat to leave it.
const START_MARGIN: f64 = 0.05;

#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    pub path: String,
    /// Unit, as the SI writes it.
    pub unit: &'static str,
    pub given: f64,
    low: f64,
    high: f64,
}

impl Parameter {
    /// The parameters named in a checked scenario.
    pub fn all(scenario: &Scenario) -> Vec<Self> {
        let named = scenario.identify.parameters.iter();
        named.filter_map(|path| Self::new(scenario, path)).collect()
    }

    fn new(scenario: &Scenario, path: &str) -> Option<Self> {
        let allowed = fittable(path)?;
        let given = number(scenario, path)?;
        let high = if path.starts_with("paper.") {
            scenario.gas.heat_capacity_ratio
        } else {
            limits(path).max
        };
        Some(Self {
            path: path.to_owned(),
            unit: allowed.unit,
            given,
            low: allowed.min.max(given / WIDEST),
            high: high.min(given * WIDEST),
        })
    }

    pub fn value(&self, u: f64) -> f64 {
        let value = self.low * (self.span() / (1.0 + (-u).exp())).exp();
        // At a limit rounding may lead past it, and the scenario would refuse the value.
        value.clamp(self.low, self.high)
    }

    /// Coordinate at which a search for this value starts; near a limit, one at some distance from it.
    pub fn place(&self, value: f64) -> f64 {
        let share = ((value / self.low).ln() / self.span()).clamp(START_MARGIN, 1.0 - START_MARGIN);
        (share / (1.0 - share)).ln()
    }

    /// d(ln x)/du.
    pub fn slope(&self, u: f64) -> f64 {
        let share = 1.0 / (1.0 + (-u).exp());
        self.span() * share * (1.0 - share)
    }

    pub fn at_limit(&self, u: f64) -> bool {
        let share = 1.0 / (1.0 + (-u).exp());
        !(AT_LIMIT..=1.0 - AT_LIMIT).contains(&share)
    }

    fn span(&self) -> f64 {
        (self.high / self.low).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_and_places_belong_together() {
        let mut scenario = Scenario::default();
        let paths = ["heat.inner_w_m2_k", "sensor.gas.time_constant_s", "paper.alpha"];
        scenario.identify.parameters = paths.map(str::to_owned).to_vec();
        for parameter in Parameter::all(&scenario) {
            let u = parameter.place(parameter.given);
            assert!((parameter.value(u) / parameter.given - 1.0).abs() < 1e-12, "{parameter:?}");
            let h = 1e-5;
            let slope = (parameter.value(u + h) / parameter.value(u - h)).ln() / (2.0 * h);
            assert!((slope / parameter.slope(u) - 1.0).abs() < 1e-6, "{parameter:?}");
            assert!(!parameter.at_limit(u) && parameter.at_limit(9.0) && parameter.at_limit(-9.0));
            let within = |u: f64| (parameter.low..=parameter.high).contains(&parameter.value(u));
            assert!([-800.0, -40.0, 40.0, 800.0].into_iter().all(within), "{parameter:?}");
        }
    }
}
