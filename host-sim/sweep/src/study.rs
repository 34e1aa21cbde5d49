//! Study of a sweep: identifies it, and reads and writes its rows.

use super::measure::{JOINT_COLUMNS, LOOP_COLUMNS};
use super::plan::{Latin, Plan};
use super::range::allowed;
use super::scenario::Assembled;
use super::ways::WAYS;
use super::{Figures, Shard, SweepError};
use serde::{Deserialize, Serialize};
use std::fmt::{self, Write};
use thermyo_files::number::significant;
use thermyo_files::units::UnitSystem;
use thermyo_record::summary::Errors;
use thermyo_record::tracking::Controlled;
use thermyo_scenario::joint;
use thermyo_scenario::schema::Allowed;

/// Scenario, plan and shard of a sweep.
#[derive(Debug)]
pub struct Study {
    pub plan: Plan,
    pub(super) shard: Shard,
    pub name: String,
    /// The scenario without the varied keys' values, with all defaults.
    pub scenario: String,
    checksum: String,
}

/// Content of `study.json`: the label of a results folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Label {
    thermyo: String,
    scenario: String,
    /// Checksum of the scenario and of its tables.
    scenario_checksum: String,
    vary: Vec<String>,
    lhs_points: Option<usize>,
    lhs_seed: Option<u64>,
    pub(super) shard: String,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Point {
    /// Number of the point in the whole sweep, from 0.
    pub point: usize,
    /// `run.seed` of the point's run.
    pub seed: u64,
    /// Start of the errors' evaluation \[s\].
    pub settled_s: f64,
    /// Figures, or the reason for the failure.
    pub figures: Result<Figures, String>,
}

impl Study {
    pub(super) fn new(plan: Plan, shard: Shard, name: String, base: &Assembled) -> Self {
        let scenario = base.render();
        let mut checksum = Checksum::default();
        // Profiles and tables are not in the scenario's text.
        let written = match base {
            Assembled::Muscle(base) => write!(checksum, "{scenario}{base:?}"),
            Assembled::Joint(base) => write!(checksum, "{scenario}{base:?}"),
        };
        written.expect("a checksum takes everything");
        Self { plan, shard, name, scenario, checksum: format!("{:016x}", checksum.0) }
    }

    /// Restores the study from a label and its scenario's text.
    pub(super) fn of_label(label: &Label, scenario: String) -> Result<Self, SweepError> {
        let ranges = label.vary.iter().map(|text| text.parse());
        let ranges = ranges.collect::<Result<_, _>>().map_err(|_| SweepError::NoKey)?;
        let latin = label.lhs_points.zip(label.lhs_seed);
        let plan = Plan::new(ranges, latin.map(|(points, seed)| Latin { points, seed }))?;
        let checksum = label.scenario_checksum.clone();
        let name = label.scenario.clone();
        Ok(Self { plan, shard: Shard::WHOLE, name, scenario, checksum })
    }

    pub(super) fn label(&self) -> Label {
        Label {
            thermyo: env!("CARGO_PKG_VERSION").to_owned(),
            scenario: self.name.clone(),
            scenario_checksum: self.checksum.clone(),
            vary: self.plan.ranges.iter().map(|range| range.written().to_owned()).collect(),
            lhs_points: self.plan.latin.map(|latin| latin.points),
            lhs_seed: self.plan.latin.map(|latin| latin.seed),
            shard: self.shard.to_string(),
        }
    }

    pub fn label_text(&self) -> String {
        serde_json::to_string_pretty(&self.label()).expect("plain data") + "\n"
    }

    pub fn own(&self) -> Vec<usize> {
        (0..self.plan.points()).filter(|point| self.shard.has(*point)).collect()
    }

    /// The point's values: "sensor.gas.time_constant_s = 3, plant.model = full".
    pub fn values_text(&self, point: usize) -> String {
        let values = self.plan.ranges.iter().zip(self.plan.values(point));
        let each = values.map(|(range, value)| format!("{} = {}", range.key, range.text(value)));
        each.collect::<Vec<_>>().join(", ")
    }

    /// Columns of [`Figures::more`].
    fn more_columns(&self) -> Vec<&'static str> {
        let of_joint: &[&str] = if self.is_joint() { &JOINT_COLUMNS } else { &[] };
        [&LOOP_COLUMNS, of_joint].concat()
    }

    pub(super) fn is_joint(&self) -> bool {
        joint::is_joint(&self.scenario)
    }

    pub(super) fn tracking_text(&self, error: f64, controlled: Option<Controlled>) -> String {
        match controlled {
            Some(quantity) => quantity.text(error, UnitSystem::Practical),
            None if self.is_joint() => format!("{} deg", significant(error.to_degrees(), 3)),
            None => significant(error, 3),
        }
    }

    /// The quantity that a point's drive controls.
    pub(super) fn controlled(&self, point: usize) -> Option<Controlled> {
        let varied = self.plan.ranges.iter().position(|range| range.key == "drive.kind");
        let own = varied.map(|key| self.plan.ranges[key].text(self.plan.values(point)[key]));
        let kinds = [("pressure", Controlled::Pressure), ("contraction", Controlled::Contraction)];
        // No other table of the scenario has kinds of these names.
        let driven = |kind: &str| match &own {
            Some(own) => own == kind,
            None => {
                let line = format!("kind = \"{kind}\"");
                self.scenario.lines().any(|own| own.starts_with(&line))
            }
        };
        kinds.into_iter().find(|(kind, _)| driven(kind)).map(|(_, controlled)| controlled)
    }

    /// SI unit of a key's values; empty for a ratio or a count.
    pub(super) fn unit(&self, key: usize) -> &'static str {
        match allowed(&self.plan.ranges[key].key) {
            Some(Allowed::Real(limits)) => limits.unit,
            _ => "",
        }
    }

    /// Names of the columns of `sweep.csv`.
    pub fn csv_header(&self) -> String {
        let keys = self.plan.ranges.iter().map(|range| range.key.as_str());
        let errors = WAYS.iter().map(|(_, column, _)| *column);
        let all = ["point"].into_iter().chain(keys).chain(["seed", "settled_s"]).chain(errors);
        let all = all.chain(["estimate_within_2sd", "control_rms_error"]);
        let all = all.chain(self.more_columns());
        all.chain(["failure", "checksum"]).collect::<Vec<&str>>().join(",")
    }

    /// Number and values of a point, the first cells of its row.
    fn csv_start(&self, point: usize) -> String {
        let mut text = (point + 1).to_string();
        for (range, value) in self.plan.ranges.iter().zip(self.plan.values(point)) {
            text = text + "," + &range.text(value);
        }
        text
    }

    /// A point's row of `sweep.csv`. A number's text is the shortest that reads back to it.
    pub fn csv_row(&self, row: &Point) -> String {
        let mut text = self.csv_start(row.point);
        let put = |text: &mut String, number: f64| {
            text.push(',');
            if !number.is_nan() {
                text.push_str(&number.to_string());
            }
        };
        text += &format!(",{}", row.seed);
        put(&mut text, row.settled_s);
        match &row.figures {
            Ok(figures) => {
                WAYS.iter().for_each(|(.., error)| put(&mut text, error(&figures.rmse_k)));
                put(&mut text, figures.within_2sd);
                put(&mut text, figures.control_rms_error.unwrap_or(f64::NAN));
                figures.more.iter().for_each(|figure| put(&mut text, *figure));
                text.push(',');
            }
            Err(failure) => {
                text += &",".repeat(WAYS.len() + 3 + self.more_columns().len());
                text += &quoted(failure);
            }
        }
        let checksum = self.row_checksum(&text);
        text + "," + &checksum.to_string()
    }

    /// Checksum of a row with header and scenario.
    fn row_checksum(&self, row: &str) -> u64 {
        let mut checksum = Checksum::default();
        write!(checksum, "{}\n{}\n{row}", self.checksum, self.csv_header())
            .expect("a checksum takes everything");
        checksum.0
    }

    /// Parses such a row; none if it is damaged, or of another study.
    pub(super) fn read_row(&self, line: &str) -> Option<Point> {
        let point = line.split(',').next()?.parse::<usize>().ok()?.checked_sub(1)?;
        if point >= self.plan.points() {
            return None;
        }
        let (row, _) = line.rsplit_once(',')?;
        let rest = row.strip_prefix(&self.csv_start(point))?.strip_prefix(',')?;
        // The failure is the last cell, and may contain commas.
        let own = self.more_columns().len();
        let cells: Vec<&str> = rest.splitn(WAYS.len() + 5 + own, ',').collect();
        let [seed, settled_s, gas, wall, model, estimate, within, control, ref more @ ..] =
            cells[..]
        else {
            return None;
        };
        let (failure, more) = more.split_last().filter(|(_, figures)| figures.len() == own)?;
        let number = |cell: &str| match cell {
            "" => Some(f64::NAN),
            _ => cell.parse().ok(),
        };
        let figures = if failure.is_empty() {
            let rmse_k = Errors {
                sensor_gas: number(gas)?,
                sensor_wall: number(wall)?,
                model: number(model)?,
                estimate: number(estimate)?,
            };
            let control_rms_error = number(control)?;
            Ok(Figures {
                rmse_k,
                within_2sd: within.parse().ok()?,
                control_rms_error: Some(control_rms_error).filter(|error| !error.is_nan()),
                more: more.iter().map(|cell| number(cell)).collect::<Option<_>>()?,
            })
        } else {
            Err(unquoted(failure)?)
        };
        let row = Point { point, seed: seed.parse().ok()?, settled_s: number(settled_s)?, figures };
        // A truncated or altered row does not match its checksum.
        (self.csv_row(&row) == line).then_some(row)
    }
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

fn unquoted(cell: &str) -> Option<String> {
    Some(cell.strip_prefix('"')?.strip_suffix('"')?.replace("\"\"", "\""))
}

/// FNV-1a of 64 bits: it distinguishes scenarios, and is no secret.
struct Checksum(u64);

impl Default for Checksum {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl fmt::Write for Checksum {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Outcome;

    fn study() -> Study {
        let ranges =
            ["run.seed=1:3:3", "plant.model=full,lumped"].map(|text| text.parse().unwrap());
        let plan = Plan::new(ranges.to_vec(), None).unwrap();
        let name = String::new();
        Study { plan, shard: Shard::WHOLE, name, scenario: String::new(), checksum: String::new() }
    }

    /// A joint has no wall sensor, no forward model, and none of its runs vents.
    #[test]
    fn a_key_without_effect_is_named_where_figures_are_missing() {
        let study = study();
        let point = |point: usize| {
            let rmse_k = Errors {
                sensor_gas: 0.1,
                sensor_wall: f64::NAN,
                model: f64::NAN,
                estimate: if study.plan.places(point)[1] == 0 { 0.2 } else { 0.3 },
            };
            let more = vec![0.5, f64::NAN];
            let figures =
                Ok(Figures { rmse_k, within_2sd: 1.0, control_rms_error: Some(0.5), more });
            Point { point, seed: 7, settled_s: 10.0, figures }
        };
        let rows = (0..study.plan.points()).map(point).collect();
        assert_eq!(Outcome::new(&study, rows).without_effect(), ["run.seed"]);
    }

    #[test]
    fn errors_of_different_quantities_are_not_compared() {
        let range = "drive.kind=pressure,contraction".parse().unwrap();
        let study = Study { plan: Plan::new(vec![range], None).unwrap(), ..study() };
        let point = |point, error| {
            let rmse_k = Errors { sensor_gas: 0.1, sensor_wall: 0.1, model: 0.1, estimate: 0.1 };
            let control_rms_error = Some(error);
            let more = Vec::new();
            let figures = Ok(Figures { rmse_k, within_2sd: 1.0, control_rms_error, more });
            Point { point, seed: 1, settled_s: 0.0, figures }
        };
        let outcome = Outcome { study: &study, rows: vec![point(0, 1200.0), point(1, 0.01)] };
        let summary = outcome.summary(1.0);
        assert_eq!(summary.control_rms_error, [None, None]);
        let sentences = " A pressure is followed to 1.20 kPa RMS at best, 1.20 kPa at worst. A contraction is \
                         followed to 1.00 % of rest length RMS at best, 1.00 % of rest length at worst.";
        assert!(summary.conclusion.contains(sentences), "{}", summary.conclusion);
        let alone = Outcome { study: &study, rows: vec![point(0, 1200.0)] };
        assert_eq!(alone.summary(1.0).control_rms_error, [Some(1200.0); 2]);
    }

    #[test]
    fn a_row_reads_back_and_a_cut_one_does_not() {
        let study = study();
        let rmse_k =
            Errors { sensor_gas: 0.1, sensor_wall: 1.0 / 3.0, model: f64::NAN, estimate: 3e-7 };
        let more = vec![0.25, f64::NAN, 0.0, f64::NAN, f64::NAN, f64::NAN, 12.5];
        let figures = Ok(Figures { rmse_k, within_2sd: 1.0, control_rms_error: Some(0.5), more });
        let whole = Point { point: 4, seed: 7, settled_s: 10.0, figures };
        let text = study.csv_row(&whole);
        assert_eq!(
            text,
            "5,3,full,7,10,0.1,0.3333333333333333,,0.0000003,1,0.5,0.25,,0,,,,12.5,,1993181460235888023"
        );
        // NaN is not equal to itself.
        assert_eq!(study.read_row(&text).map(|row| study.csv_row(&row)), Some(text.clone()));
        let failure = "the plant diverged: p = 1 Pa, \"V\" = 0".to_owned();
        let failed = Point { figures: Err(failure), ..whole };
        let row = study.csv_row(&failed);
        assert_eq!(study.read_row(&row), Some(failed));
        // A number without its last digits is still a number; its row then lacks the last comma.
        assert!((0..text.len()).all(|end| study.read_row(&text[..end]).is_none()));
        assert!(study.read_row(&text.replace("full", "lumped")).is_none());
        for place in 0..text.len() {
            let mut altered = text.clone().into_bytes();
            altered[place] ^= 1;
            let altered = String::from_utf8(altered).unwrap();
            assert!(study.read_row(&altered).is_none(), "{altered}");
        }
        let other = Study { checksum: "1".to_owned(), ..super::tests::study() };
        assert!(other.read_row(&text).is_none(), "the row of another scenario");
        assert!(study.read_row("99,3,full,7,10,0.1,0.1,0.1,0.1,1,,,1").is_none());
    }
}
