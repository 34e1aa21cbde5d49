//! Fewer points, the same picture: keeps the extremes of every stretch.

use std::ops::Range;

/// Most points of one curve: about two per pixel of a full-width chart.
pub const POINTS: usize = 1500;
/// Most points of all curves of one drawing: enough for five; more curves get fewer points each.
pub const DRAWING: usize = 5 * POINTS;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Keep {
    /// Extremes of y: a series over a rising x.
    Y,
    /// Extremes of x and y: a curve in the plane.
    Both,
}

/// Gap-free index ranges of `0..len`; `present` returns whether a point exists.
///
/// More than `most` ranges cannot be distinguished in the drawing: then the existing points are
/// taken as one curve, and this returns `None`.
pub fn runs(len: usize, most: usize, present: impl Fn(usize) -> bool) -> Option<Vec<Range<usize>>> {
    let mut out: Vec<Range<usize>> = Vec::new();
    for i in (0..len).filter(|i| present(*i)) {
        match out.last_mut() {
            Some(run) if run.end == i => run.end = i + 1,
            _ => out.push(i..i + 1),
        }
    }
    (out.len() <= most).then_some(out)
}

/// A curve as unbroken stretches of finite points, with about `budget` points in all.
pub fn curve(x: &[f64], y: &[f64], keep: Keep, budget: usize) -> Vec<Vec<(f64, f64)>> {
    let points: Vec<(f64, f64)> = x.iter().copied().zip(y.iter().copied()).collect();
    let finite = |p: &(f64, f64)| p.0.is_finite() && p.1.is_finite();
    let Some(runs) = runs(points.len(), budget / 8, |i| finite(&points[i])) else {
        let there: Vec<_> = points.into_iter().filter(finite).collect();
        return vec![thin(&there, keep, budget)];
    };
    let total: usize = runs.iter().map(Range::len).sum();
    runs.into_iter()
        .map(|run| thin(&points[run.clone()], keep, budget * run.len() / total.max(1)))
        .collect()
}

/// `points` with the first, the last and the extremes of equal stretches between them.
pub fn thin(points: &[(f64, f64)], keep: Keep, budget: usize) -> Vec<(f64, f64)> {
    let kept_per_stretch = if keep == Keep::Both { 4 } else { 2 };
    let budget = budget.max(kept_per_stretch + 2);
    if points.len() <= budget {
        return points.to_vec();
    }
    let stretches = (budget - 2) / kept_per_stretch;
    let inner = 1..points.len() - 1;
    let mut out = vec![points[0]];
    for stretch in 0..stretches {
        let from = inner.start + stretch * inner.len() / stretches;
        let to = inner.start + (stretch + 1) * inner.len() / stretches;
        let mut indices = Vec::with_capacity(4);
        extremes(from..to, |i| points[i].1, &mut indices);
        if keep == Keep::Both {
            extremes(from..to, |i| points[i].0, &mut indices);
        }
        indices.sort_unstable();
        indices.dedup();
        out.extend(indices.into_iter().map(|i| points[i]));
    }
    out.push(points[points.len() - 1]);
    out
}

fn extremes(range: Range<usize>, value: impl Fn(usize) -> f64, out: &mut Vec<usize>) {
    out.extend(range.clone().min_by(|a, b| value(*a).total_cmp(&value(*b))));
    out.extend(range.max_by(|a, b| value(*a).total_cmp(&value(*b))));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extremes_stay() {
        let n = 100_000;
        let mut points: Vec<(f64, f64)> =
            (0..n).map(|i| (f64::from(i), (f64::from(i) * 0.01).sin())).collect();
        points[31_337].1 = 50.0;
        points[77_777].1 = -40.0;
        let thinned = thin(&points, Keep::Y, 1500);
        assert!((1400..=1500).contains(&thinned.len()), "{}", thinned.len());
        assert!(thinned.contains(&points[31_337]) && thinned.contains(&points[77_777]));
        assert_eq!((thinned[0], *thinned.last().unwrap()), (points[0], points[99_999]));
        assert!(thinned.is_sorted_by(|a, b| a.0 < b.0));
    }

    #[test]
    fn a_loop_keeps_its_sideways_extremes() {
        let points: Vec<(f64, f64)> = (0..50_000)
            .map(|i| f64::from(i) / 50_000.0 * std::f64::consts::TAU)
            .map(|a| (a.cos(), a.sin()))
            .collect();
        let thinned = thin(&points, Keep::Both, 1500);
        let left = thinned.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
        assert_eq!(left, points[25_000].0);
        assert!((700..=1500).contains(&thinned.len()));
    }

    #[test]
    fn gaps_break_the_curve() {
        let x: Vec<f64> = (0..10).map(f64::from).collect();
        let mut y = x.clone();
        y[0] = f64::NAN;
        y[5] = f64::INFINITY;
        let runs = curve(&x, &y, Keep::Y, 100);
        assert_eq!(runs.iter().map(Vec::len).collect::<Vec<_>>(), [4, 4]);
    }

    #[test]
    fn a_series_full_of_gaps_stays_small() {
        let x: Vec<f64> = (0..50_000).map(f64::from).collect();
        let y: Vec<f64> =
            (0..50_000).map(|i| if i % 2 == 0 { f64::NAN } else { f64::from(i) }).collect();
        let runs = curve(&x, &y, Keep::Y, 1500);
        assert_eq!(runs.len(), 1);
        assert!((1400..=1500).contains(&runs[0].len()));
        assert!(curve(&x, &[f64::NAN; 50_000], Keep::Y, 1500).is_empty());
    }
}
