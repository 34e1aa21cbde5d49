//! `thermyo compare`: differences of recorded runs from the first one.
//!
//! Rows may lie at different times: each run is interpolated linearly at the times of the first, but not over gaps.

mod page;
mod several;
mod subject;

pub use several::{Comparison, Recorded};
pub use subject::Subject;

use serde::Serialize;
use std::collections::BTreeMap;
use thermyo_compute::math::{gaps, median_distance};
use thermyo_files::input::InputError;
use thermyo_files::number::short;
use thermyo_files::table::Table;
use thermyo_files::units::UnitSystem;
use thermyo_record::measured::ordered;

/// Relative difference up to which two records count as equally long \[-\].
const SAME_LENGTH: f64 = 0.01;
/// Distance of rows, in usual distances, above which there is a gap \[-\].
const GAP_ROWS: f64 = 20.0;

#[derive(Debug, Clone)]
pub struct Run {
    pub name: String,
    pub subject: Subject,
    /// `plant.kind` of the run's scenario, if known: a vessel's trace has a length too.
    kind: Option<&'static str>,
    time_s: Vec<f64>,
    /// Distance of rows above which there is a gap \[s\].
    gap_s: f64,
    /// Columns that have a value in any row; NaN where a cell is empty.
    columns: BTreeMap<&'static str, Vec<f64>>,
}

/// Difference of a run from the first one, in one column.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Difference {
    /// Mean of this run minus the first \[SI\].
    pub mean: f64,
    /// Root mean square \[SI\].
    pub rms: f64,
    /// Largest absolute difference \[SI\].
    pub max: f64,
}

/// Entry of one run in `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Compared {
    pub run: String,
    /// Name of the first run.
    pub with: String,
    /// Rows of the first run at which both have a value of the same column.
    pub rows: usize,
    pub differences: BTreeMap<&'static str, Difference>,
    #[serde(skip)]
    pub subject: Subject,
}

impl Compared {
    /// Columns with a difference, in the order in which they are shown.
    fn shown(&self) -> impl Iterator<Item = (&'static str, &Difference)> {
        let columns = self.subject.columns().iter().copied();
        columns.filter_map(|name| Some((name, self.differences.get(name)?)))
    }
}

impl Run {
    /// Run of a plant of this `kind`, from its record.
    ///
    /// # Errors
    /// If `time_s` is missing in a row, or times fall.
    pub fn new(name: &str, kind: Option<&'static str>, table: &Table) -> Result<Self, InputError> {
        let time_s = ordered(table)?;
        let subject = Subject::of(table);
        let columns = subject
            .columns()
            .iter()
            .copied()
            .chain(["set_point"])
            .filter_map(|name| {
                let column = table.columns().iter().find(|column| column.name == name)?;
                let values = column.cells.iter().map(|cell| cell.unwrap_or(f64::NAN)).collect();
                column.cells.iter().any(Option::is_some).then_some((name, values))
            })
            .collect();
        let gap_s = GAP_ROWS * median_distance(&time_s);
        Ok(Self { name: name.to_owned(), subject, kind, time_s, gap_s, columns })
    }

    fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.get(name).map(Vec::as_slice)
    }

    /// Value of a column at a time, linear between rows; none outside the rows and in a gap.
    fn at(&self, values: &[f64], time_s: f64) -> Option<f64> {
        let after = self.time_s.partition_point(|time| *time < time_s);
        let (end_s, end) = (*self.time_s.get(after)?, values[after]);
        if end_s == time_s {
            return Some(end);
        }
        let before = after.checked_sub(1)?;
        let (start_s, start) = (self.time_s[before], values[before]);
        if end_s - start_s > self.gap_s {
            return None;
        }
        Some(start + (end - start) * (time_s - start_s) / (end_s - start_s))
    }

    /// Times and values of a curve that is broken at gaps.
    fn curve(&self, values: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let mut ends = gaps(&self.time_s, self.gap_s).map(|[_, end_s]| end_s).peekable();
        let with_breaks = |(&time_s, &value): (&f64, &f64)| {
            let broken = ends.next_if_eq(&time_s).map(|end_s| (end_s, f64::NAN));
            broken.into_iter().chain([(time_s, value)])
        };
        self.time_s.iter().zip(values).flat_map(with_breaks).unzip()
    }

    /// Reason why a comparison with `first` may mean little: another kind of plant, or another length.
    pub fn unlike(&self, first: &Self) -> Option<String> {
        let has_length = |run: &Self| run.columns.contains_key("length_m");
        let length_s = |run: &Self| run.time_s[run.time_s.len() - 1] - run.time_s[0];
        let (own, other) = (&self.name, &first.name);
        if let (Some(own_kind), Some(other_kind)) = (self.kind, first.kind)
            && own_kind != other_kind
        {
            return Some(format!(
                "{own} has plant.kind = \"{own_kind}\" and {other} \"{other_kind}\": another kind of plant"
            ));
        }
        if has_length(self) != has_length(first) {
            let [with, without] = if has_length(self) { [own, other] } else { [other, own] };
            return Some(format!(
                "{with} has a length and {without} has none: another kind of plant"
            ));
        }
        let [own_s, other_s] = [length_s(self), length_s(first)];
        ((own_s - other_s).abs() > SAME_LENGTH * own_s.max(other_s)).then(|| {
            let [own_s, other_s] = [own_s, other_s].map(short);
            format!(
                "{own} lasts {own_s} s and {other} {other_s} s: only the common time is compared"
            )
        })
    }

    /// Message that names the first gap.
    pub fn gap(&self) -> Option<String> {
        let [from_s, to_s] = gaps(&self.time_s, self.gap_s).next()?.map(short);
        Some(format!("{} has a gap from {from_s} to {to_s} s: it is not compared there", self.name))
    }

    pub fn compared(&self, first: &Self) -> Compared {
        let columns = self.subject.columns().iter().copied();
        let common: Vec<_> = columns
            .filter_map(|name| Some((name, self.column(name)?, first.column(name)?)))
            .collect();
        let difference = |own: &[f64], (time_s, value): (&f64, &f64)| {
            Some(self.at(own, *time_s)? - value).filter(|difference| difference.is_finite())
        };
        let is_compared = |(row, time_s): &(usize, &f64)| {
            common.iter().any(|(_, own, other)| difference(own, (time_s, &other[*row])).is_some())
        };
        let rows = first.time_s.iter().enumerate().filter(is_compared).count();
        let differences = common
            .iter()
            .filter_map(|(name, own, other)| {
                let cells = first.time_s.iter().zip(*other);
                let differences: Vec<f64> =
                    cells.filter_map(|cell| difference(own, cell)).collect();
                let count = differences.len() as f64;
                (!differences.is_empty()).then(|| {
                    let square: f64 = differences.iter().map(|d| d * d).sum();
                    let difference = Difference {
                        mean: differences.iter().sum::<f64>() / count,
                        rms: (square / count).sqrt(),
                        max: differences.iter().fold(0.0, |max, d| d.abs().max(max)),
                    };
                    (*name, difference)
                })
            })
            .collect();
        let (run, with) = (self.name.clone(), first.name.clone());
        Compared { run, with, rows, differences, subject: self.subject }
    }
}

pub fn text(all: &[Compared], units: UnitSystem) -> String {
    let mut text = String::new();
    for compared in all {
        text += &format!("{} less {}:\n", compared.run, compared.with);
        for (name, difference) in compared.shown() {
            let [rms, mean, max] = [difference.rms, difference.mean, difference.max]
                .map(|value| subject::text(value, name, units));
            text += &format!("  {name:22} RMS {rms}, mean {mean}, largest {max}\n");
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(name: &str, text: &str) -> Run {
        Run::new(name, None, &Table::parse(text, "t.csv".as_ref()).unwrap()).unwrap()
    }

    #[test]
    fn runs_are_compared_where_both_are() {
        let first = run("a", "time_s,pressure_pa,step\n0,100,0\n1,200,1\n2,300,2\n3,,3\n");
        let second = run("b", "time_s,pressure_pa,length_m\n0.5,153,1\n2.5,353,1\n");
        let compared = second.compared(&first);
        assert_eq!((compared.run.as_str(), compared.with.as_str(), compared.rows), ("b", "a", 2));
        assert_eq!(compared.differences.keys().collect::<Vec<_>>(), [&"pressure_pa"]);
        let difference = compared.differences["pressure_pa"];
        assert_eq!(difference, Difference { mean: 3.0, rms: 3.0, max: 3.0 });
        assert!(
            text(std::slice::from_ref(&compared), UnitSystem::Practical)
                .contains("pressure_pa            RMS 0.00300 kPa")
        );
        assert!(text(&[compared], UnitSystem::Si).contains("pressure_pa            RMS 3.00 Pa"));
    }

    /// Rows whose cells are empty used to count.
    #[test]
    fn rows_are_those_with_a_value_in_both() {
        let first = run("a", "time_s,pressure_pa,length_m\n0,1,\n1,,\n2,1,1\n3,1,1\n4,,1\n");
        let second = run("b", "time_s,pressure_pa\n0,1\n1,1\n2,1\n3,\n4,1\n");
        assert_eq!(second.compared(&first).rows, 2);
    }

    #[test]
    fn a_gap_is_reported_and_not_compared() {
        let rows = |from: u32, to: u32| (from..to).map(|row| format!("{row},{row}\n"));
        let text = |rows: Vec<String>| format!("time_s,pressure_pa\n{}", rows.concat());
        let whole = run("a", &text(rows(0, 60).collect()));
        let torn =
            run("b", &text(rows(0, 5).chain(["26,0\n".to_owned()]).chain(rows(27, 60)).collect()));
        assert_eq!(whole.gap(), None);
        assert_eq!(torn.gap().unwrap(), "b has a gap from 4 to 26 s: it is not compared there");
        assert_eq!(torn.compared(&whole).differences["pressure_pa"].mean, -26.0 / 39.0);
        assert_eq!(whole.compared(&torn).differences["pressure_pa"].max, 26.0);
        assert_eq!(torn.compared(&whole).rows, 39);
        let (times_s, values) = torn.curve(torn.column("pressure_pa").unwrap());
        assert_eq!(times_s[4..7], [4.0, 26.0, 26.0]);
        assert!(values[5].is_nan() && values[4] == 4.0 && values[6] == 0.0, "{values:?}");
    }

    #[test]
    fn the_page_has_the_warnings() {
        let recorded = |name: &str, text: &str| {
            Recorded::alone(name, &Table::parse(text, "t.csv".as_ref()).unwrap()).unwrap()
        };
        let long = recorded("a", "time_s,pressure_pa\n0,1\n5,1\n");
        let short = recorded("b", "time_s,pressure_pa\n0,1\n2,1\n");
        let said = "b lasts 2 s and a 5 s: only the common time is compared.";
        assert!(Comparison::of(vec![long, short]).page().contains(said));
    }

    #[test]
    fn runs_of_another_kind_or_length_are_reported() {
        let muscle = run("m", "time_s,pressure_pa,length_m\n0,1,1\n5,1,1\n");
        let vessel = run("v", "time_s,pressure_pa,length_m\n0,1,\n5,1,\n");
        let short = run("s", "time_s,pressure_pa,length_m\n0,1,1\n2,1,1\n");
        let note = vessel.unlike(&muscle).unwrap();
        assert_eq!(note, "m has a length and v has none: another kind of plant");
        let note = short.unlike(&muscle).unwrap();
        assert_eq!(note, "s lasts 2 s and m 5 s: only the common time is compared");
        assert_eq!(muscle.unlike(&muscle), None);
    }

    #[test]
    fn runs_at_different_times_have_nothing_in_common() {
        let [first, second] =
            ["0", "9"].map(|time| run(time, &format!("time_s,pressure_pa\n{time},1\n")));
        assert_eq!(second.compared(&first).rows, 0);
        assert!(second.compared(&first).differences.is_empty());
    }
}
