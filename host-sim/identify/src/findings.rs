//! Findings of an identification, and the parameters that it leaves open.

use super::data::{Data, Input, Observed, Quantity};
use super::fit::End;
use super::parameter::Parameter;
use super::uncertainty::Misfit;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use std::collections::BTreeMap;
use thermyo_files::number::{of_column, significant};
use thermyo_fit::Fitted;

/// Correlation above which two parameters cannot be distinguished.
const INSEPARABLE: f64 = 0.95;
/// Relative standard error above which a parameter is not determined.
const UNDETERMINED: f64 = 0.5;
/// Relative standard error above which the value might be zero: the data leave it open.
const OPEN: f64 = 1.0;
/// [`OPEN`] where only the gas sensor is compared: the fitted values become the core's configuration.
const OPEN_FOR_CORE: f64 = UNDETERMINED;
/// Correlation of the residuals, in rows, above which there is a remark.
const LASTING_ROWS: f64 = 5.0;
/// Root mean square of residuals, in standard deviations of one reading, above which there is a remark.
const LARGE: f64 = 5.0;
/// Largest number of holes that a remark lists.
const NAMED_HOLES: usize = 5;

/// Root-mean-square residuals, by measured quantity.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Rmse {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressure_pa: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature_k: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wall_temperature_k: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub length_m: Option<f64>,
}

impl Rmse {
    /// Of columns, and the residual of each.
    pub(super) fn new(observed: &[Observed], misfits: &[Misfit]) -> Self {
        let mut rmse = Self::default();
        for (observed, misfit) in observed.iter().zip(misfits) {
            let place = match observed.quantity {
                Quantity::Pressure => &mut rmse.pressure_pa,
                Quantity::Length => &mut rmse.length_m,
                Quantity::SensorGas => &mut rmse.temperature_k,
                Quantity::SensorWall => &mut rmse.wall_temperature_k,
            };
            *place = Some(misfit.rms);
        }
        rmse
    }

    /// Each quantity, its value, its SI unit and its column.
    pub(super) fn each(
        self,
    ) -> impl Iterator<Item = (&'static str, f64, &'static str, &'static str)> {
        let Self { pressure_pa, temperature_k, wall_temperature_k, length_m } = self;
        let all = [
            ("pressure", pressure_pa, "Pa", "pressure_pa"),
            ("temperature", temperature_k, "K", "sensor_gas_k"),
            ("wall temperature", wall_temperature_k, "K", "sensor_wall_k"),
            ("length", length_m, "m", "length_m"),
        ];
        all.into_iter().filter_map(|(name, value, unit, column)| Some((name, value?, unit, column)))
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Searches {
    pub starts: usize,
    pub converged: usize,
    /// Number of searches that ended where the best one did.
    pub agreeing: usize,
}

/// `summary.json` of an identification.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Findings {
    /// Whether the best search converged and the others agree with it.
    pub converged: bool,
    /// Fitted values by key, and `gas_mass_kg` if they determine it.
    pub parameters: BTreeMap<String, Fitted>,
    pub rmse: Rmse,
    /// Residuals of a record that the fit has not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub against: Option<Rmse>,
    /// Effective number of independent rows, by measured column.
    pub effective_rows: BTreeMap<&'static str, f64>,
    /// Correlation of each pair of parameters, `[a][b]`.
    pub correlations: BTreeMap<String, BTreeMap<String, f64>>,
    pub searches: Searches,
    /// Parameters that the data do not determine, in words.
    pub remarks: Vec<String>,
    /// Columns in which the model errs by more than they vary.
    #[serde(skip)]
    missed: Vec<&'static str>,
    #[serde(skip)]
    otherwise: Option<String>,
    #[serde(skip)]
    best_converged: bool,
    #[serde(skip)]
    determined: bool,
    /// Largest relative standard error of a value that the data do not leave open.
    #[serde(skip)]
    open_from: f64,
}

pub(super) struct Parts<'a> {
    pub parameters: &'a [Parameter],
    pub data: &'a Data,
    pub best: &'a End,
    pub ends: &'a [End],
    pub agreeing: usize,
    pub misfits: &'a [Misfit],
    pub covariance: Option<&'a DMatrix<f64>>,
    pub mass: Option<(f64, Option<f64>)>,
    /// The mistake of the record without which it is followed far better.
    pub otherwise: Option<String>,
}

impl Findings {
    pub(super) fn new(parts: Parts) -> Self {
        let Parts { parameters, data, best, ends, agreeing, misfits, covariance, mass, otherwise } =
            parts;
        let inside = |i: usize| !parameters[i].at_limit(best.place[i]);
        let correlations = covariance
            .map_or_else(BTreeMap::new, |covariance| correlations(covariance, parameters, inside));
        let error =
            |i: usize| covariance.filter(|_| inside(i)).map(|covariance| covariance[(i, i)].sqrt());
        let values = parameters.iter().zip(best.place.iter()).enumerate();
        let mut fitted: BTreeMap<String, Fitted> = values
            .map(|(i, (parameter, u))| {
                let value = parameter.value(*u);
                let standard_error = error(i).map(|relative| relative * value);
                (parameter.path.clone(), Fitted { value, standard_error, unit: parameter.unit })
            })
            .collect();
        if let Some((value, standard_error)) = mass {
            fitted.insert("gas_mass_kg".to_owned(), Fitted { value, standard_error, unit: "kg" });
        }

        let mut effective_rows = BTreeMap::new();
        for (observed, misfit) in data.observed.iter().zip(misfits) {
            let rows = observed.points.len() as f64 / misfit.correlation_rows;
            effective_rows.insert(observed.quantity.column(), rows);
        }

        let searches = Searches {
            starts: ends.len(),
            converged: ends.iter().filter(|end| end.converged).count(),
            agreeing,
        };
        let mut findings = Self {
            converged: false,
            parameters: fitted,
            rmse: Rmse::new(&data.observed, misfits),
            against: None,
            effective_rows,
            correlations,
            searches,
            remarks: Vec::new(),
            missed: missed(&data.observed, misfits),
            otherwise,
            best_converged: best.converged,
            determined: covariance.is_some(),
            open_from: if matches!(data.input, Input::Given(_)) { OPEN_FOR_CORE } else { OPEN },
        };
        findings.converged = findings.failed().is_none();
        findings.remarks = findings.remarks(parameters, best, data, misfits);
        findings
    }

    /// Reason why the values are not reliable, if there is one.
    pub fn failed(&self) -> Option<String> {
        let Searches { starts, agreeing, .. } = self.searches;
        if !self.best_converged {
            Some("the search did not converge; the values are where it stopped".to_owned())
        } else if !self.determined {
            Some(
                "the data leave the parameters open: some of them, or a combination, change \
                 nothing that was measured"
                    .to_owned(),
            )
        } else if !self.missed.is_empty() {
            Some(format!(
                "the fit misses {} by more than it varies: another start than the scenario's, gauge pressure, \
                 another unit, or another muscle",
                self.missed.join(" and ")
            ))
        } else if let Some(mistake) = &self.otherwise {
            Some(mistake.clone())
        } else if 2 * agreeing <= starts && starts > 1 {
            Some(format!(
                "the starts disagree: only {agreeing} of {starts} searches ended at the best fit; \
                 start closer, or fit fewer parameters"
            ))
        } else {
            let open = self.parameters.iter().filter(|(_, fitted)| fitted.is_open(self.open_from));
            let open: Vec<&str> = open.map(|(path, _)| path.as_str()).collect();
            (!open.is_empty()).then(|| {
                format!(
                    "the data leave {} open: at a limit, or with a standard error beyond {} the value itself",
                    open.join(" and "),
                    if self.open_from < OPEN { "half of" } else { "" }
                )
                .replace("  ", " ")
            })
        }
    }

    fn remarks(
        &self,
        parameters: &[Parameter],
        best: &End,
        data: &Data,
        misfits: &[Misfit],
    ) -> Vec<String> {
        let mut remarks: Vec<String> = self.failed().into_iter().collect();
        for (i, parameter) in parameters.iter().enumerate() {
            if parameter.at_limit(best.place[i]) {
                remarks.push(format!(
                    "{} went to a limit of the allowed range: the data ask for more than the \
                     model can give, or do not determine it.",
                    parameter.path
                ));
            }
            remarks.extend(self.remarks_on(parameter, &parameters[i + 1..]));
        }
        remarks.extend(on_holes(&data.holes));
        remarks.extend(data.observed.iter().zip(misfits).flat_map(on_misfit));
        remarks
    }

    fn remarks_on(&self, parameter: &Parameter, others: &[Parameter]) -> Vec<String> {
        let path = &parameter.path;
        let mut remarks = Vec::new();
        let fitted = &self.parameters[path];
        if let Some(error) = fitted.standard_error
            && error > UNDETERMINED * fitted.value
        {
            remarks.push(format!(
                "{path} is not determined: its standard error is {:.0} % of its value.",
                100.0 * error / fitted.value
            ));
        }
        for other in others {
            let pair = self.correlations.get(path).and_then(|row| row.get(&other.path));
            if let Some(correlation) = pair.filter(|c| c.abs() > INSEPARABLE) {
                remarks.push(format!(
                    "{path} and {} cannot be distinguished (correlation {correlation:.3}): the \
                     data determine a combination of them. Measure one of them otherwise, or fix \
                     it.",
                    other.path
                ));
            }
        }
        remarks
    }

    /// Figures as lines for a terminal.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (path, fitted) in &self.parameters {
            text += &fitted.line(path);
        }
        for (name, value, _, column) in self.rmse.each() {
            text += &format!("{name}: RMS residual {}\n", of_column(value, column));
        }
        for (name, value, _, column) in self.against.into_iter().flat_map(Rmse::each) {
            text += &format!("against: {name}: RMS residual {}\n", of_column(value, column));
        }
        let Searches { starts, converged, agreeing } = self.searches;
        text += &format!(
            "searches: {starts} begun, {converged} converged, {agreeing} ended at the best fit\n"
        );
        self.remarks.iter().fold(text, |text, remark| text + remark + "\n")
    }
}

/// Correlations of the parameters that are not at a limit, by their paths.
fn correlations(
    covariance: &DMatrix<f64>,
    parameters: &[Parameter],
    inside: impl Fn(usize) -> bool,
) -> BTreeMap<String, BTreeMap<String, f64>> {
    let correlation =
        |i: usize, j: usize| covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt();
    let known = || parameters.iter().enumerate().filter(|(i, _)| inside(*i));
    let row = |i| known().map(|(j, other)| (other.path.clone(), correlation(i, j))).collect();
    known().map(|(i, parameter)| (parameter.path.clone(), row(i))).collect()
}

fn on_holes(holes: &[[f64; 2]]) -> Option<String> {
    let named = holes.iter().take(NAMED_HOLES);
    let named: Vec<String> = named
        .map(|[from_s, to_s]| format!("{} to {} s", significant(*from_s, 4), significant(*to_s, 4)))
        .collect();
    let more = match holes.len() - named.len() {
        0 => String::new(),
        more => format!(", and {more} more"),
    };
    (!holes.is_empty()).then(|| {
        format!(
            "The record has holes, from {}{more}: what drove the plant there is not known, and what is fitted may \
             be wrong by it.",
            named.join(", ")
        )
    })
}

fn is_large(observed: &Observed, misfit: &Misfit) -> bool {
    misfit.rms > LARGE * observed.deviation
}

/// Pressure and length, if their mean is nearer than the model: a sensor in the gas may have an offset.
fn missed(observed: &[Observed], misfits: &[Misfit]) -> Vec<&'static str> {
    let is_missed = |(observed, misfit): &(&Observed, &Misfit)| {
        let values = observed.points.iter().map(|point| point.1);
        let varies = DVector::from_iterator(observed.points.len(), values).variance().sqrt();
        matches!(observed.quantity, Quantity::Pressure | Quantity::Length)
            && is_large(observed, misfit)
            && misfit.rms > varies
    };
    let missed = observed.iter().zip(misfits).filter(is_missed);
    missed.map(|(observed, _)| observed.quantity.column()).collect()
}

fn on_misfit((observed, misfit): (&Observed, &Misfit)) -> Vec<String> {
    let column = observed.quantity.column();
    let mut remarks = Vec::new();
    if is_large(observed, misfit) {
        remarks.push(format!(
            "{column} is missed by {} RMS, {:.0} times what its sensor's noise and code make: model or record \
             is wrong by that.",
            of_column(misfit.rms, column),
            misfit.rms / observed.deviation
        ));
    }
    if misfit.correlation_rows > LASTING_ROWS && misfit.inflation > 1.0 {
        remarks.push(format!(
            "The residuals of {} go on over {:.0} rows: the model is wrong there by more \
             than the sensor's noise. The standard errors count {:.0} independent rows of \
             {}.",
            column,
            misfit.correlation_rows,
            observed.points.len() as f64 / misfit.correlation_rows,
            observed.points.len()
        ));
    }
    remarks
}

#[cfg(test)]
mod tests {
    use crate::{Found, identify_table};
    use std::path::Path;
    use thermyo_files::table::Table;

    const CONFIG: &str = "hold.toml";
    const HOLD: &str = "[plant]\nmodel = \"lumped\"\ninitial_pressure_pa = 400000\n[load]\nkind = \"isometric\"\n\
                        length_m = 0.28\n[drive]\nkind = \"closed\"\n[leak]\nconductance_m3_s_pa = 1e-12\n\
                        [identify]\nparameters = [\"leak.conductance_m3_s_pa\"]\n";

    /// A hold of 30 s whose pressure falls from this one \[Pa\].
    fn hold(first_pa: f64) -> Table {
        let row = |i| format!("{i},{}\n", first_pa - 60.0 * f64::from(i));
        let text: String = (0..30).map(row).collect();
        Table::parse(&format!("time_s,pressure_pa\n{text}"), "hold.csv".as_ref()).unwrap()
    }

    fn identified(table: &Table, against: Option<&Table>) -> Result<Found, String> {
        let loaded = thermyo_setup::parse(HOLD, CONFIG.as_ref()).unwrap();
        let data = Path::new("hold.csv");
        identify_table(&loaded, CONFIG.as_ref(), table, data, against, &())
            .map_err(|error| error.to_string())
    }

    /// A leak used to be found from gauge pressures with exit code 0: 19 times the true one.
    #[test]
    fn a_record_that_is_missed_by_more_than_it_varies_gives_no_values() {
        assert_eq!(identified(&hold(400_000.0), None).unwrap().failed(), None);
        let gauge = identified(&hold(298_675.0), None).unwrap().failed().unwrap();
        assert!(gauge.contains("the fit misses pressure_pa by more than it varies"), "{gauge}");
    }

    /// It was refused by a list of a muscle's fifty columns.
    #[test]
    fn a_record_of_a_joint_is_named_as_such() {
        let joint = Table::parse("time_s,angle_rad\n0,0\n1,0\n", "arm.csv".as_ref()).unwrap();
        let refused = identified(&joint, None).err().unwrap();
        assert!(refused.starts_with("arm.csv: is the record of a joint"), "{refused}");
    }

    /// `--against` used to be refused for every record over time that [identify] fits.
    #[test]
    fn a_record_is_compared_with_one_that_was_not_fitted() {
        let fitted = hold(400_000.0);
        let compared = |other: &Table| match identified(&fitted, Some(other)).unwrap() {
            Found::Record(found) => found.findings,
            other => panic!("{other:?}"),
        };
        let same = compared(&fitted);
        assert_eq!(same.against, Some(same.rmse));
        let off_pa = compared(&hold(401_000.0)).against.unwrap().pressure_pa.unwrap();
        assert!((900.0..1100.0).contains(&off_pa), "{off_pa}");
        assert!(same.text().contains("\nagainst: pressure: RMS residual "), "{}", same.text());

        let stranger = Table::parse("time_s,duty_in\n0,0\n1,0\n", "other.csv".as_ref()).unwrap();
        let refused = identified(&fitted, Some(&stranger)).unwrap_err();
        assert!(refused.starts_with("other.csv: "), "{refused}");
    }
}
