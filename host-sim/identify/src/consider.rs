//! Two properties that a fit to the gas sensor alone takes as known although they are not: the lag of the sensor's
//! housing, and the location factor.
//!
//! Neither shows in the residuals: lag and heat transfer shift until the residuals are as small as before. With the
//! sensitivities J of the weighted residuals to the fitted logarithms, and J_c to one that is only considered, of
//! standard deviation s, the fit is off by -(J'J)^-1 J' J_c s: its square is added to the covariance (consider
//! covariance, Schmidt 1966).

use super::data::Input;
use super::fit::Problem;
use nalgebra::{DMatrix, DVector};
use thermyo_fit::search::LeastSquares;
use thermyo_scenario::{PlantModel, number, with_numbers};

const HOUSING: &str = "sensor.gas.housing_time_constant_s";
/// Standard deviation of the logarithm of the housing's lag: a factor of two. Assumption.
const HOUSING_SD: f64 = 0.7;
/// Lag that a housing without configured lag may have \[s\].
const LEAST_HOUSING_S: f64 = 0.1;
/// Standard deviation of the logarithm of the location factor: 0.83 to 1.16 along a muscle, up to
/// 1.7 on the axis of gas at rest. Assumption.
const LOCATION_SD: f64 = 0.15;
/// Step of the differences in the logarithms.
const DIFFERENCE: f64 = 0.05;

/// Adds the considered properties to a covariance of the parameters `inside`; `sensitivities` belong to these.
pub fn widened(
    problem: &Problem,
    place: &DVector<f64>,
    sensitivities: &DMatrix<f64>,
    mut covariance: DMatrix<f64>,
) -> DMatrix<f64> {
    // In one zone the sensor has no housing, and senses the mean.
    let known = problem.scenario.plant.model != PlantModel::Full;
    // Where every parameter is at a limit, none has an error.
    let held = sensitivities.ncols() == 0;
    if known || held || !matches!(problem.data.input, Input::Given(_)) {
        return covariance;
    }
    let own = problem.weighted(place);
    let mut add = |changed: DVector<f64>, sd: f64| {
        let off = (changed - &own) / DIFFERENCE * sd;
        let decomposed = sensitivities.clone().svd(true, true);
        if let Ok(off) = decomposed.solve(&off, f64::EPSILON) {
            covariance += &off * off.transpose();
        }
    };
    if problem.parameters.iter().all(|parameter| parameter.path != HOUSING) {
        let housing_s = number(problem.scenario, HOUSING).unwrap_or(0.0).max(LEAST_HOUSING_S);
        let slower = [(HOUSING, housing_s * DIFFERENCE.exp())];
        let at = [(HOUSING, housing_s)];
        let with = |numbers: [(&str, f64); 1]| {
            let scenario = with_numbers(problem.scenario, numbers);
            Problem { scenario: &scenario, ..problem.clone() }.weighted(place)
        };
        add(with(slower) - with(at) + &own, HOUSING_SD);
    }
    let experiment = problem.experiment.clone().with_location_factor(DIFFERENCE.exp());
    add(Problem { experiment, ..problem.clone() }.weighted(place), LOCATION_SD);
    covariance
}

#[cfg(test)]
mod tests {
    use crate::otherwise::tests::identified;

    /// A record in minutes takes every parameter to a limit; the search for the errors of no parameter used to panic.
    #[test]
    fn a_fit_with_every_parameter_at_a_limit_has_an_end() {
        let text = "[run]\nduration_s = 20\n[heat]\nmodel = \"constant\"\n[identify]\nparameters = \
                    [\"heat.inner_w_m2_k\", \"sensor.gas.time_constant_s\"]\ncolumns = [\"sensor_gas_k\"]\nstarts = 1\n";
        let loaded = thermyo_setup::parse(text, "c.toml".as_ref()).unwrap();
        let found = identified(&loaded, &loaded, |[time_s, rest @ ..]| {
            let [pressure, length, gas, inlet, outlet] = rest;
            [time_s / 60.0, pressure, length, gas, inlet, outlet]
        });
        assert!(found.failed().is_some());
    }
}
