//! Compares the law with simpler ones, on the same split record.

use super::plan::check_muscle;
use super::record::{LENGTH, MOVES, Record};
use super::{Left, MOST_ROWS, Searched, compared, is_asked_for, parameters, search, usual_keys};
use std::path::Path;
use thermyo_files::input::{InputError, Problem};
use thermyo_files::table::Table;
use thermyo_scenario::Scenario;
use thermyo_setup::Loaded;

/// Share of a record that is fitted; the rest is held out \[-\].
const FITTED: f64 = 0.6;
/// Stiffness of Coulomb friction with presliding, as in machines \[N/m\].
const PRESLIDING_N_M: f64 = 1.0e5;

/// A law, and its residuals in both parts of a record.
#[derive(Debug, Clone, PartialEq)]
pub struct LawLeft {
    pub name: &'static str,
    pub fitted: Left,
    pub held: Left,
}

const STATIC: [&str; 4] = [
    "muscle.bladder_saturation_n",
    "muscle.bladder_strain",
    "muscle.bladder_stiffness_n_m",
    "muscle.slack_m",
];

fn without_motion(scenario: &mut Scenario) {
    let muscle = &mut scenario.muscle;
    (muscle.slip_force_n, muscle.creep_fast_n_m, muscle.creep_slow_n_m) = (0.0, 0.0, 0.0);
}

fn ideal(scenario: &mut Scenario) {
    without_motion(scenario);
    let muscle = &mut scenario.muscle;
    (muscle.bladder_saturation_n, muscle.bladder_stiffness_n_m, muscle.slack_m) = (0.0, 0.0, 0.0);
}

fn coulomb(scenario: &mut Scenario) {
    let muscle = &mut scenario.muscle;
    (muscle.slip_stiffness_n_m, muscle.creep_fast_n_m, muscle.creep_slow_n_m) =
        (PRESLIDING_N_M, 0.0, 0.0);
}

type Change = fn(&mut Scenario);

fn of(keys: &[&str]) -> Vec<String> {
    keys.iter().map(|key| (*key).to_owned()).collect()
}

/// Keys of the whole law: those in the scenario, else all that a record determines.
pub fn keys(loaded: &Loaded) -> Vec<String> {
    if is_asked_for(loaded) {
        return loaded.plant.identify.parameters.clone();
    }
    [of(&STATIC), usual_keys(&loaded.plant)].concat()
}

/// Refuses a part at rest: its lengths show no law.
fn check_moves(
    table: &Table,
    scenario: &Scenario,
    part: &Record,
    which: &str,
) -> Result<(), InputError> {
    if part.has_force || part.moves(scenario.muscle.rest_length_m) {
        return Ok(());
    }
    let why = format!(
        "in the {which} it moves by less than {} % of muscle.rest_length_m, and force_n is missing: must move in both",
        100.0 * MOVES
    );
    Err(table.header_error(Problem::UnusableColumn { column: LENGTH.to_owned(), why }))
}

/// Fits each law to the first part of a record, and compares it with the rest.
///
/// # Errors
/// As [`super::identify`].
pub fn laws(loaded: &Loaded, config: &Path, table: &Table) -> Result<Vec<LawLeft>, InputError> {
    check_muscle(&loaded.plant, config)?;
    let whole = Record::of(table, &loaded.plant)?;
    let cut = (FITTED * whole.rows.len() as f64) as usize;
    let [fitted, held] = [&whole.rows[..cut], &whole.rows[cut..]]
        .map(|rows| Record { rows: rows.to_vec(), has_force: whole.has_force });
    check_moves(table, &loaded.plant, &fitted, "first six tenths, which are fitted,")?;
    check_moves(table, &loaded.plant, &held, "last four tenths, which are held out,")?;
    let thin = fitted.thinned(MOST_ROWS);
    let braid = of(&["muscle.diameter_m", "muscle.braid_angle_deg"]);
    let all = keys(loaded);
    let with_coulomb = [of(&["muscle.slip_force_n"]), of(&STATIC)].concat();
    let cases: [(&'static str, Change, &[String]); 4] = [
        ("ideal braid", ideal, &braid),
        ("static law", without_motion, &of(&STATIC)),
        ("static law and Coulomb friction", coulomb, &with_coulomb),
        ("slip and creep", |_| {}, &all),
    ];
    let one = |(name, change, keys): &(&'static str, Change, &[String])| {
        let mut scenario = loaded.plant.clone();
        change(&mut scenario);
        scenario.identify.parameters = keys.to_vec();
        let mut searched = parameters(&scenario, config)?;
        let Searched { values, start, .. } = search(&scenario, &mut searched, &thin, &());
        let found = searched.iter().zip(&values).map(|(p, value)| (p.key, value.value));
        let scenario = super::fit::adopt(&scenario, found);
        let left = Left::of(&scenario, &fitted, &start, 0);
        Ok(LawLeft { name, fitted: left, held: compared(&scenario, &held) })
    };
    cases.iter().map(one).collect()
}
