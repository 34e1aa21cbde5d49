//! Results of a sweep: table, figures and conclusions.

use super::reach::{Lines, Reach};
use super::ways::{BARE, ESTIMATE, WAYS, Way};
use super::{Figures, Point, Range, Study};
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use thermyo_files::number::significant;
use thermyo_files::units::Unit;
use thermyo_record::tracking::Controlled;

#[derive(Debug)]
pub struct Outcome<'a> {
    pub(super) study: &'a Study,
    /// Points that were run, in order.
    pub rows: Vec<Point>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    pub points: usize,
    pub shard: String,
    pub run: usize,
    /// Number of failed points among them.
    pub failed: usize,
    /// The varied keys and their values; in a grid the last key changes from point to point.
    pub varied: Vec<Range>,
    /// Seed of the Latin hypercube; none for a grid.
    pub lhs_seed: Option<u64>,
    /// Limit of the root-mean-square error \[K\].
    pub within_k: f64,
    /// By column of `sweep.csv`: smallest and largest error \[K\], points within `within_k`.
    pub errors: BTreeMap<&'static str, Extent>,
    /// Smallest and largest fraction of time within two stated standard deviations \[-\].
    pub estimate_within_2sd: [Option<f64>; 2],
    /// Smallest and largest root-mean-square error of the set point, in its unit; none if points control different
    /// quantities.
    pub control_rms_error: [Option<f64>; 2],
    pub conclusion: String,
    /// Keys without effect on any figure.
    pub without_effect: Vec<String>,
}

/// Errors over a grid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Extent {
    pub min_k: Option<f64>,
    pub max_k: Option<f64>,
    /// Number of points within the limit.
    pub within: usize,
}

impl<'a> Outcome<'a> {
    /// Outcome of a study; `rows` may be in any order.
    pub fn new(study: &'a Study, mut rows: Vec<Point>) -> Self {
        rows.sort_by_key(|row| row.point);
        Self { study, rows }
    }

    pub fn csv(&self) -> String {
        let mut text = self.study.csv_header() + "\n";
        for row in &self.rows {
            text += &self.study.csv_row(row);
            text.push('\n');
        }
        text
    }

    pub fn summary(&self, within_k: f64) -> Summary {
        let extent = |(_, column, error): &Way| {
            let errors: Vec<f64> = self.figures().map(|figures| error(&figures.rmse_k)).collect();
            let [min_k, max_k] = ends(errors.iter().copied());
            let within = errors.iter().filter(|error| **error <= within_k).count();
            (*column, Extent { min_k, max_k, within })
        };
        Summary {
            points: self.study.plan.points(),
            shard: self.study.shard.to_string(),
            run: self.rows.len(),
            failed: self.rows.len() - self.figures().count(),
            varied: self.study.plan.ranges.to_vec(),
            lhs_seed: self.study.plan.latin.map(|latin| latin.seed),
            within_k,
            errors: WAYS.iter().map(extent).collect(),
            estimate_within_2sd: ends(self.figures().map(|figures| figures.within_2sd)),
            control_rms_error: match self.control()[..] {
                [(_, ends)] => ends,
                _ => [None, None],
            },
            conclusion: self.conclusion(within_k),
            without_effect: self.without_effect(),
        }
    }

    /// Errors of the set point by controlled quantity, since their units differ.
    fn control(&self) -> Vec<(Option<Controlled>, [Option<f64>; 2])> {
        let errors: Vec<(Option<Controlled>, f64)> = self
            .rows
            .iter()
            .filter_map(|row| {
                let error = row.figures.as_ref().ok()?.control_rms_error?;
                Some((self.study.controlled(row.point), error))
            })
            .collect();
        let mut kinds: Vec<Option<Controlled>> = Vec::new();
        for (kind, _) in &errors {
            if !kinds.contains(kind) {
                kinds.push(*kind);
            }
        }
        let of_kind = |kind: Option<Controlled>| {
            let own = errors.iter().filter(move |(other, _)| *other == kind);
            (kind, ends(own.map(|(_, error)| *error)))
        };
        kinds.into_iter().map(of_kind).collect()
    }

    /// RMS errors of the set point over the whole grid, and their unit; none if no point has one, or
    /// if they are of several quantities.
    pub(super) fn tracking_errors(&self) -> Option<(Vec<f64>, &'static str)> {
        let control = self.control();
        let [(kind, _)] = control[..] else { return None };
        let unit = match kind {
            Some(controlled) => controlled.unit(),
            None if self.study.is_joint() => Unit { symbol: "deg", factor: 180.0 / PI },
            None => return None,
        };
        let error = |figures: Option<&Figures>| figures?.control_rms_error;
        let errors: Vec<f64> =
            self.grid().into_iter().map(|figures| error(figures).unwrap_or(f64::NAN)).collect();
        Some((unit.convert(&errors), unit.symbol))
    }

    /// The methods that the runs have; a joint has no sensor in the wall.
    pub(super) fn ways(&self) -> Vec<(usize, &'static Way)> {
        let is_had = |(way, _): &(usize, &Way)| self.errors_k(*way).iter().any(|k| k.is_finite());
        WAYS.iter().enumerate().filter(is_had).collect()
    }

    /// Tracking of the set point, in a sentence for each quantity, and the number of limit cycles; empty if no point has
    /// one.
    fn tracking(&self) -> String {
        let control = self.control();
        let sentence = |(kind, ends): &(Option<Controlled>, [Option<f64>; 2])| {
            let [Some(least), Some(most)] = *ends else { return String::new() };
            let text = |value| self.study.tracking_text(value, *kind);
            let what = match kind.filter(|_| control.len() > 1) {
                Some(Controlled::Pressure) => "A pressure",
                Some(Controlled::Contraction) => "A contraction",
                None => "The set point",
            };
            format!(" {what} is followed to {} RMS at best, {} at worst.", text(least), text(most))
        };
        let text: String = control.iter().map(sentence).collect();
        match self.figures().filter(|figures| figures.has_limit_cycle()).count() {
            0 => text,
            swinging => {
                text + &format!(" {swinging} of {} points have a limit cycle.", self.rows.len())
            }
        }
    }

    /// Number of failed points, and the reason of the first failure.
    pub fn failed(&self) -> Option<String> {
        let failed = || self.rows.iter().filter_map(|row| Some((row, row.figures.as_ref().err()?)));
        let (row, failure) = failed().next()?;
        let (count, all) = (failed().count(), self.rows.len());
        let (point, values) = (row.point + 1, self.study.values_text(row.point));
        Some(format!(
            "{count} of {all} points failed, the first is point {point} ({values}): {failure}"
        ))
    }

    pub(super) fn figures(&self) -> impl Iterator<Item = &Figures> + Clone {
        self.rows.iter().filter_map(|row| row.figures.as_ref().ok())
    }

    /// Figures of each point of the whole grid; none if it was not run, or diverged.
    fn grid(&self) -> Vec<Option<&Figures>> {
        let mut grid = vec![None; self.study.plan.points()];
        for row in &self.rows {
            grid[row.point] = row.figures.as_ref().ok();
        }
        grid
    }

    /// Errors over the whole grid \[K\]; NaN if there are none.
    pub(super) fn errors_k(&self, way: usize) -> Vec<f64> {
        let error = |figures: Option<&Figures>| figures.map(|figures| WAYS[way].2(&figures.rmse_k));
        self.grid().into_iter().map(|figures| error(figures).unwrap_or(f64::NAN)).collect()
    }

    /// The key along which a limit is searched: the first one with several values.
    pub(super) fn main_key(&self) -> usize {
        let several = |range: &Range| range.values.len() > 1;
        self.study.plan.ranges.iter().position(several).unwrap_or(0)
    }

    /// The points of each line along a key, ordered by the other keys.
    pub(super) fn lines(&self, key: usize) -> Vec<Vec<usize>> {
        let counts: Vec<usize> =
            self.study.plan.ranges.iter().map(|range| range.values.len()).collect();
        let stride: usize = counts[key + 1..].iter().product();
        (0..counts.iter().product())
            .filter(|point| self.study.plan.places(*point)[key] == 0)
            .map(|first| (0..counts[key]).map(|i| first + i * stride).collect())
            .collect()
    }

    /// Range of the main key in which the errors are within a limit, line by line.
    pub(super) fn reaches(&self, way: usize, within_k: f64) -> Vec<Reach> {
        let key = self.main_key();
        let range = &self.study.plan.ranges[key];
        let errors = self.errors_k(way);
        let along = |line: &Vec<usize>| -> Vec<f64> { line.iter().map(|i| errors[*i]).collect() };
        self.lines(key)
            .iter()
            .map(|line| Reach::new(&range.values, &along(line), within_k, range.spacing()))
            .collect()
    }

    pub(super) fn conclusion(&self, within_k: f64) -> String {
        if !self.study.plan.is_map() {
            return self.shares(within_k);
        }
        let ranges = &self.study.plan.ranges;
        let key = self.main_key();
        let changing = (0..ranges.len()).filter(|i| *i != key && ranges[*i].values.len() > 1);
        let others: Vec<usize> = changing.collect();
        let who = |way: usize| {
            let other = match others[..] {
                [other] => Some((ranges[other].key.as_str(), ranges[other].values.clone())),
                _ => None,
            };
            let key = (ranges[key].key.as_str(), self.study.unit(key));
            let [least, _] = ends(self.errors_k(way).into_iter().filter(|error| error.is_finite()));
            let text = Lines { key, reaches: self.reaches(way, within_k), other }.text();
            match least {
                Some(least) => format!("{text} ({} K at best)", significant(least, 2)),
                None => text,
            }
        };
        format!(
            "Within {within_k} K RMS of the gas temperature: the bare sensor {}; the estimate {}.{}",
            who(BARE),
            who(ESTIMATE),
            self.tracking()
        )
    }

    /// Number of points in which bare sensor and estimate are within the limit.
    fn shares(&self, within_k: f64) -> String {
        let of = |way: usize| {
            let errors = self.figures().map(|figures| WAYS[way].2(&figures.rmse_k));
            let within = errors.clone().filter(|error| *error <= within_k).count();
            let best = match ends(errors) {
                [Some(least), _] => format!(" ({} K at best)", significant(least, 2)),
                _ => String::new(),
            };
            format!("at {within} of {} points{best}", self.rows.len())
        };
        format!(
            "Within {within_k} K RMS of the gas temperature: the bare sensor {}; the estimate {}.{}",
            of(BARE),
            of(ESTIMATE),
            self.tracking()
        )
    }

    /// Keys of a grid along which every figure stays the same, to the bit.
    pub(super) fn without_effect(&self) -> Vec<String> {
        if self.study.plan.latin.is_some() {
            return Vec::new();
        }
        let grid = self.grid();
        let flat = |key: &usize| {
            let lines = self.lines(*key);
            let mut runs = lines.iter().map(|line| line.iter().filter_map(|i| grid[*i]));
            let several =
                lines.iter().any(|l| l.iter().filter(|i| grid[**i].is_some()).count() > 1);
            several
                && runs.all(|mut line| line.next().is_none_or(|first| line.all(|f| f.is(first))))
        };
        let ranges = &self.study.plan.ranges;
        (0..ranges.len()).filter(flat).map(|key| ranges[key].key.clone()).collect()
    }
}

pub(super) fn ends(values: impl Iterator<Item = f64> + Clone) -> [Option<f64>; 2] {
    [values.clone().reduce(f64::min), values.reduce(f64::max)]
}
