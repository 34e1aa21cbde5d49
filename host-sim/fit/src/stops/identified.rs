//! `thermyo identify` of a record with stops: heat transfer, and lags and location factor of the sensor.

use super::relaxation::{CHARGED, With};
use super::{Analysis, FEWEST, Known, Relaxation, Rows, analyse, find, page};
use crate::Fitted;
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::Path;
use thermyo_files::input::{InputError, Problem};
use thermyo_files::table::Table;
use thermyo_plant::chamber;
use thermyo_plant::heat::{InnerHeat, Stirred};
use thermyo_scenario::{HeatModel, Scenario, ZonesSource, number, with_numbers};
use thermyo_setup::Loaded;
use thermyo_setup::core_config::{Effective, WORKING_PRESSURE_PA, WORKING_SWING_K, core_config};

/// Relative standard error above which the stops do not determine a value.
const UNDETERMINED: f64 = 0.5;
/// Least standard deviation for the core: its model of one zone is no better than that. Assumption.
const LEAST_SD: f64 = 0.05;

/// Power of the stirring in the laws of forced convection (Woodfield et al. 2008).
const FORCED_POWER: f64 = 0.67;

const STILL: &str = "heat.inner_w_m2_k";
const SCALE: &str = "heat.scale";
const PER_FLOW: &str = "heat.inner_per_flow";
const DECAY: &str = "heat.stirring_decay_s";
const BUOYANCY: &str = "zones.buoyancy_w_m2_k";
const LAG: &str = "sensor.gas.time_constant_s";
const HOUSING: &str = "sensor.gas.housing_time_constant_s";
/// Name of the location factor, which is no key: swing of the gas at the sensor over that of the mean.
const PLACE: &str = "location_factor";
/// Keys whose values follow from stops.
const KEYS: [&str; 6] = [STILL, SCALE, PER_FLOW, DECAY, LAG, HOUSING];
const HEAT: [&str; 4] = [STILL, SCALE, PER_FLOW, DECAY];
/// Number of stops at random phases of which enough follow an inflow: in simulations 3 to 5 of eight, sometimes 2 of
/// seven.
const USUAL_STOPS: usize = 8;
/// Keys to find if the scenario names no parameters.
const USUAL: [&str; 3] = [STILL, LAG, HOUSING];

/// `summary.json` of an identification from stops.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Findings {
    /// Whether the stops determine every requested parameter.
    pub converged: bool,
    pub parameters: BTreeMap<String, Fitted>,
    pub remarks: Vec<String>,
    #[serde(flatten)]
    pub analysis: Analysis,
    #[serde(skip)]
    failed: Option<String>,
}

#[derive(Debug)]
pub struct Identified {
    pub findings: Findings,
    /// The scenario with the identified values, for the core.
    pub scenario: Loaded,
    rows: Rows,
}

/// Whether a scenario requests only parameters that stops show.
pub fn would_do(loaded: &Loaded) -> bool {
    loaded.plant.identify.parameters.iter().all(|path| KEYS.contains(&path.as_str()))
}

/// Whether a record has stops, and the scenario requests what they show.
pub fn are_asked_for(loaded: &Loaded, table: &Table) -> bool {
    would_do(loaded) && find::are_in(table, &core_config(&loaded.believed))
}

pub fn analyse_with(loaded: &Loaded, rows: &Rows) -> Analysis {
    let plant = &loaded.believed;
    let heat = match chamber::of(plant) {
        Some(chamber) => {
            let rest_m = chamber.rest_length();
            InnerHeat::of_chamber(plant, chamber.diameter(rest_m), chamber.gas_length(rest_m))
        }
        None => InnerHeat::of_vessel(plant),
    };
    let config = core_config(plant);
    let law = |pressure_pa: f64, gas_k: f64, wall_k: f64| {
        let forced = heat.forced(&Stirred::default(), gas_k);
        let film = heat.film(pressure_pa, gas_k, wall_k, &forced, heat.whole());
        match by_keys(plant) {
            true => with_buoyancy(plant, film.still_w_m2_k, pressure_pa, (gas_k - wall_k).abs()),
            false => film.still_w_m2_k,
        }
    };
    let hose_m3 = plant
        .tube
        .line()
        .filter(|_| plant.moves_in_full())
        .map_or(0.0, |[length_m, bore_m]| 0.25 * PI * bore_m * bore_m * length_m);
    let Effective { tube_m3, .. } = Effective::of(plant);
    analyse(rows, &Known { config: &config, law: &law, tube_m3, hose_m3 })
}

/// Identifies from the stops of a record.
///
/// # Errors
/// For a record without the required columns, or with fewer than [`FEWEST`] stops.
pub fn identify(loaded: &Loaded, table: &Table, data: &Path) -> Result<Identified, InputError> {
    let rows = Rows::of(table)?;
    let analysis = analyse_with(loaded, &rows);
    if analysis.stops.len() < FEWEST {
        let problem = Problem::Unusable(format!(
            "{} stops of at least {} s with both valves shut: at least {FEWEST} are needed",
            analysis.stops.len(),
            find::SHORTEST_S
        ));
        return Err(InputError::file(data, problem));
    }
    let (parameters, failed) = asked(&analysis, &loaded.believed);
    let scenario = adopted(loaded, &parameters, &analysis);
    let mut remarks: Vec<String> = failed.iter().cloned().collect();
    if has_profile(&loaded.believed) && parameters.contains_key(HOUSING) {
        remarks.push(format!(
            "{HOUSING} stays as configured: in still gas the foil's surroundings are late too, and the core has that \
             apart from the housing."
        ));
    }
    if by_keys(&loaded.believed) && parameters.contains_key(STILL) {
        remarks.push(format!(
            "{STILL} is conduction alone; {BUOYANCY} of the core has the same factor."
        ));
    }
    remarks.extend(refusals(&analysis));
    let findings = Findings { converged: failed.is_none(), parameters, remarks, analysis, failed };
    Ok(Identified { findings, scenario, rows })
}

/// Messages about the stops that do not count.
pub fn refusals(analysis: &Analysis) -> impl Iterator<Item = String> {
    analysis.stops.iter().enumerate().filter_map(|(i, stop)| {
        let why = stop.refused.as_ref()?;
        Some(format!("stop {} at {:.2} s does not count: {why}.", i + 1, stop.time_s))
    })
}

/// The requested values, and the reason if they are not reliable.
fn asked(analysis: &Analysis, scenario: &Scenario) -> (BTreeMap<String, Fitted>, Option<String>) {
    let named = &scenario.identify.parameters;
    let law = scenario.heat.model == HeatModel::Correlation;
    let usual = USUAL.map(|path| if path == STILL && law { SCALE } else { path });
    let names: Vec<&str> =
        if named.is_empty() { usual.to_vec() } else { named.iter().map(String::as_str).collect() };
    let mut found: BTreeMap<String, Fitted> = BTreeMap::new();
    let mut open = Vec::new();
    for name in names.into_iter().chain([PLACE]) {
        let value = value_of(name, analysis, scenario);
        let determined = value.as_ref().is_some_and(|fitted| {
            fitted.standard_error.is_some_and(|error| error <= UNDETERMINED * fitted.value.abs())
        });
        let asked_for = match name {
            // Always shown, and requested if the scenario requests everything.
            PLACE => named.is_empty(),
            // More stops would not make it usable.
            HOUSING => !has_profile(scenario),
            _ => true,
        };
        if !determined && asked_for {
            open.push(name.to_owned());
        }
        if let Some(value) = value {
            found.insert(name.to_owned(), value);
        }
    }
    let usable = analysis.usable().count();
    let failed = if usable < FEWEST {
        Some(format!(
            "only {usable} of {} stops can be used: at least {FEWEST} are needed",
            analysis.stops.len()
        ))
    } else {
        (!open.is_empty()).then(|| left_open(&open, analysis.heat.as_ref()))
    };
    (found, failed)
}

/// Message about the keys that stay as configured, and what would show them.
fn left_open(open: &[String], heat: Option<&Relaxation>) -> String {
    let keys = open.join(" and ");
    let mixed = heat.filter(|heat| !heat.parted && open.iter().any(|key| HEAT.contains(&&**key)));
    match mixed {
        Some(Relaxation { stops, charged, .. }) => format!(
            "the stops leave {keys} open: {charged} of {stops} follow an inflow, and the heat that its jet takes cannot \
             be parted from that of still gas: take more stops, {USUAL_STOPS} at least, of which {CHARGED} or more do"
        ),
        None => format!(
            "the stops leave {keys} open: take more of them, at more phases, or with a larger swing"
        ),
    }
}

fn value_of(name: &str, analysis: &Analysis, scenario: &Scenario) -> Option<Fitted> {
    let with = |value: f64, error: f64, unit: &'static str| {
        let standard_error = Some(error).filter(|error| error.is_finite());
        Some(Fitted { value, standard_error, unit })
    };
    let logarithmic = |value: f64, sd: f64, unit| with(value, value * sd, unit);
    let heat = analysis.heat.as_ref().filter(|heat| heat.parted);
    let sensor = analysis.sensor.as_ref();
    match name {
        STILL if by_keys(scenario) => heat.and_then(|heat| {
            let still_w_m2_k = scenario.heat.inner_w_m2_k;
            let With { value, standard_error, .. } = heat.scale;
            with(value * still_w_m2_k, standard_error * still_w_m2_k, "W/(m2 K)")
        }),
        STILL => heat.and_then(|heat| {
            with(heat.still_w_m2_k.value, heat.still_w_m2_k.standard_error, "W/(m2 K)")
        }),
        SCALE => heat.and_then(|heat| {
            let scale = scenario.heat.scale;
            with(heat.scale.value * scale, heat.scale.standard_error * scale, "")
        }),
        PER_FLOW => heat
            .and_then(|heat| heat.stirred_per_flow)
            .and_then(|found| with(found.value, found.standard_error, "W/(m2 K) per kg/s")),
        DECAY => {
            // A coefficient that follows a power of the stirring decays faster or slower by that power.
            let power =
                if scenario.heat.model == HeatModel::Correlation { FORCED_POWER } else { 1.0 };
            let found = heat.and_then(|heat| heat.decay_s);
            found.and_then(|found| with(power * found.value, power * found.standard_error, "s"))
        }
        LAG => sensor.and_then(|sensor| logarithmic(sensor.lag_s, sensor.lag_sd, "s")),
        HOUSING => sensor.and_then(|sensor| logarithmic(sensor.housing_s, sensor.housing_sd, "s")),
        _ => sensor.and_then(|sensor| logarithmic(sensor.location_factor, sensor.location_sd, "")),
    }
}

/// Whether the core models the profile of still gas, which looks like a longer housing on the axis: an identified
/// housing would count twice.
fn has_profile(believed: &Scenario) -> bool {
    believed.heat.model == HeatModel::Correlation || by_keys(believed)
}

/// Whether the core has the laws of still air from `[zones]`, as in the scenario of a board's configuration: there
/// `heat.inner_w_m2_k` is conduction alone.
fn by_keys(believed: &Scenario) -> bool {
    believed.heat.model == HeatModel::Constant
        && believed.zones.source == ZonesSource::Keys
        && believed.zones.buoyancy_w_m2_k > 0.0
}

/// Coefficient of conduction and of the core's buoyancy \[W/(m2 K)\].
fn with_buoyancy(believed: &Scenario, conduction: f64, pressure_pa: f64, apart_k: f64) -> f64 {
    let buoyancy4 = believed.zones.buoyancy_w_m2_k.powi(4)
        * (pressure_pa / WORKING_PRESSURE_PA).powi(2)
        * (apart_k / WORKING_SWING_K);
    (conduction.powi(4) + buoyancy4).powf(0.25)
}

/// The scenario with the values for the core, and the core's initial uncertainty.
fn adopted(loaded: &Loaded, parameters: &BTreeMap<String, Fitted>, analysis: &Analysis) -> Loaded {
    let mut adopted = loaded.clone();
    let determined = |fitted: &Fitted| {
        fitted.value > 0.0
            && fitted.standard_error.is_some_and(|error| error <= UNDETERMINED * fitted.value)
    };
    let profiled = has_profile(&loaded.believed);
    let kept = |path: &str| path == PLACE || (path == HOUSING && profiled);
    let values = parameters
        .iter()
        .filter(|(path, fitted)| !kept(path) && determined(fitted))
        .map(|(path, fitted)| (path.as_str(), fitted.value));
    let values: Vec<(&str, f64)> = values.collect();
    let still = values.iter().any(|(path, _)| [STILL, SCALE].contains(path));
    adopted.believed = with_numbers(&adopted.believed, values);
    let heat = analysis.heat.as_ref().filter(|heat| heat.parted);
    if let Some(heat) = heat.filter(|_| still && by_keys(&loaded.believed)) {
        adopted.believed.zones.buoyancy_w_m2_k *= heat.scale.value;
    }
    let sensor = analysis.sensor.as_ref();
    let relative = |found: &With| found.relative();
    let uncertainties = [
        (
            "estimator.heat_scale_sd",
            heat.map(|heat| if profiled { heat.scale } else { heat.still_w_m2_k }.relative()),
        ),
        (
            "estimator.stirring_sd",
            heat.and_then(|heat| heat.stirred_per_flow.as_ref()).map(relative),
        ),
        ("estimator.lag_sd", sensor.map(|sensor| sensor.lag_sd)),
        ("estimator.housing_sd", sensor.filter(|_| !profiled).map(|sensor| sensor.housing_sd)),
    ];
    // A core without one of these states has no key for it.
    let known = uncertainties.into_iter().filter_map(|(path, sd)| {
        let sd = sd.filter(|sd| *sd <= UNDETERMINED)?.max(LEAST_SD);
        number(&adopted.believed, path).map(|_| (path, sd))
    });
    let known: Vec<(&str, f64)> = known.collect();
    adopted.believed = with_numbers(&adopted.believed, known);
    adopted
}

impl Findings {
    /// Reason why the values are not reliable, if there is one.
    pub fn failed(&self) -> Option<String> {
        self.failed.clone()
    }

    /// Figures as lines for a terminal.
    pub fn text(&self) -> String {
        let values = self.parameters.iter().map(|(path, fitted)| fitted.line(path));
        let text: String = values.collect();
        let count =
            format!("{} of {} stops\n", self.analysis.usable().count(), self.analysis.stops.len());
        self.remarks.iter().fold(text + &count, |text, remark| text + remark + "\n")
    }
}

impl Identified {
    pub fn page(&self, title: &str) -> String {
        let findings = &self.findings;
        let lead = findings.failed().map_or_else(
            || format!("Found from {} stops.", findings.analysis.usable().count()),
            |why| format!("Not to be relied on: {why}."),
        );
        let page = page::begun(title, &lead, &self.scenario, &findings.analysis);
        page::with_stops(page, &findings.analysis, &self.rows, &findings.remarks).render()
    }

    pub fn plot(&self, title: &str) -> String {
        page::relaxations(&self.findings.analysis, &self.rows).document(title)
    }
}
