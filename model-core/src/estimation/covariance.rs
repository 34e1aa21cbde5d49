//! Covariance of the estimator's errors, and its propagation, a row at a time.

use super::per_zone::{PerZone, ZONES, times, total};
use crate::math::limit;

/// Number of errors: four zones, wall, housing, element, gas at the foil, and five parameters.
pub const ERRORS: usize = 13;
/// Errors that an interval moves; the parameters after them only fade.
const MOVED: usize = 7;
/// One row of the covariance, in the order of [`Errors`].
pub type Row = [f32; ERRORS];

/// Relative errors of the zones' masses, and errors of everything else.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Errors<T> {
    /// ln m of each zone.
    pub zones: [T; ZONES],
    /// Inner wall \[K\].
    pub wall: T,
    /// Housing \[K\].
    pub housing: T,
    /// Element \[K\].
    pub element: T,
    /// Difference of the gas at the foil from its zone \[K\].
    pub foil: T,
    /// ln of the heat transfer, of stirring, of the lag, of the housing's lag.
    pub scale: T,
    pub stirring: T,
    pub lag: T,
    pub housing_lag: T,
    /// Place of the foil, share of the length.
    pub place: T,
}

impl<T: Copy> From<[T; ERRORS]> for Errors<T> {
    fn from(row: [T; ERRORS]) -> Self {
        let [a, b, c, d, wall, housing, element, foil, scale, stirring, lag, housing_lag, place] =
            row;
        let zones = [a, b, c, d];
        Self { zones, wall, housing, element, foil, scale, stirring, lag, housing_lag, place }
    }
}

impl<T: Copy> From<Errors<T>> for [T; ERRORS] {
    fn from(errors: Errors<T>) -> Self {
        let Errors {
            zones: [a, b, c, d],
            wall,
            housing,
            element,
            foil,
            scale,
            stirring,
            lag,
            housing_lag,
            place,
        } = errors;
        [a, b, c, d, wall, housing, element, foil, scale, stirring, lag, housing_lag, place]
    }
}

/// Nonzero part of a zone's, or the wall's, row of the transition.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GasRow {
    pub zones: PerZone,
    pub wall: f32,
    pub scale: f32,
    pub stirring: f32,
}

/// The housing's row.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct HousingRow {
    pub zones: PerZone,
    pub wall: f32,
    pub housing: f32,
    pub foil: f32,
    pub housing_lag: f32,
    pub place: f32,
}

/// The element's row: the housing's row after the interval, and the element's own terms.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ElementRow {
    /// Share of the housing, half before and half after the interval.
    pub half: f32,
    pub lag: f32,
}

/// Linearised error dynamics over one interval.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Transition {
    pub zones: [GasRow; ZONES],
    pub wall: GasRow,
    pub housing: HousingRow,
    pub element: ElementRow,
}

fn add(out: &mut Row, row: &Row, by: f32) {
    for (out, x) in out.iter_mut().zip(row) {
        *out += by * x;
    }
}

/// Sum of the zones' rows, each times its factor.
fn of_zones([a, b, c, d]: [&Row; ZONES], by: &PerZone) -> Row {
    let [by_a, by_b, by_c, by_d] = *by;
    let mut out = a.map(|x| by_a * x);
    add(&mut out, b, by_b);
    add(&mut out, c, by_c);
    add(&mut out, d, by_d);
    out
}

impl GasRow {
    #[inline(never)] // For the image's size.
    fn of(&self, p: &[Row; ERRORS]) -> Row {
        let [a, b, c, d, wall, _, _, _, scale, stirring, _, _, _] = p;
        let mut out = of_zones([a, b, c, d], &self.zones);
        add(&mut out, wall, self.wall);
        add(&mut out, scale, self.scale);
        add(&mut out, stirring, self.stirring);
        out
    }

    fn dot(&self, m: &Errors<f32>) -> f32 {
        total(&times(&self.zones, &m.zones))
            + self.wall * m.wall
            + self.scale * m.scale
            + self.stirring * m.stirring
    }
}

impl HousingRow {
    fn of(&self, p: &[Row; ERRORS]) -> Row {
        let [a, b, c, d, wall, housing, _, foil, _, _, _, housing_lag, place] = p;
        let mut out = of_zones([a, b, c, d], &self.zones);
        add(&mut out, wall, self.wall);
        add(&mut out, housing, self.housing);
        add(&mut out, foil, self.foil);
        add(&mut out, housing_lag, self.housing_lag);
        add(&mut out, place, self.place);
        out
    }

    fn dot(&self, m: &Errors<f32>) -> f32 {
        total(&times(&self.zones, &m.zones))
            + self.wall * m.wall
            + self.housing * m.housing
            + self.foil * m.foil
            + self.housing_lag * m.housing_lag
            + self.place * m.place
    }
}

/// F P, the rows that F changes.
pub type Product = [Row; MOVED];

/// The covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Covariance(pub [Row; ERRORS]);

impl Covariance {
    /// Independent errors of these variances.
    pub fn of(variances: &Errors<f32>) -> Self {
        let mut rows = [[0.0; ERRORS]; ERRORS];
        let variances: Row = (*variances).into();
        for (i, (row, variance)) in rows.iter_mut().zip(variances).enumerate() {
            if let Some(entry) = row.get_mut(i) {
                *entry = variance;
            }
        }
        Self(rows)
    }

    /// Adds a variance that all zones have in common, beside their own.
    pub fn add_common(&mut self, variance: f32) {
        for row in self.0.iter_mut().take(ZONES) {
            for entry in row.iter_mut().take(ZONES) {
                *entry += variance;
            }
        }
    }

    /// Adds to the variances.
    pub fn add_variances(&mut self, variances: &Errors<f32>) {
        let variances: Row = (*variances).into();
        for (i, (row, variance)) in self.0.iter_mut().zip(variances).enumerate() {
            if let Some(entry) = row.get_mut(i) {
                *entry += variance;
            }
        }
    }

    /// Computes one row of F P.
    pub fn row(&self, f: &Transition, which: usize, product: &mut Product) {
        let p = &self.0;
        let [a, b, c, d, wall, housing, element] = product;
        let [za, zb, zc, zd] = &f.zones;
        match which {
            0 => *a = za.of(p),
            1 => *b = zb.of(p),
            2 => *c = zc.of(p),
            3 => *d = zd.of(p),
            4 => *wall = f.wall.of(p),
            5 => *housing = f.housing.of(p),
            _ => {
                let [_, _, _, _, _, before, own, _, _, _, lag, _, _] = p;
                let half = f.element.half;
                *element = own.map(|x| (1.0 - 2.0 * half) * x);
                add(element, before, half);
                add(element, housing, half);
                add(element, lag, f.element.lag);
            }
        }
    }

    /// Computes one row of F P F^T from that row of F P, from the diagonal on. Parameters keep `keep` of their errors.
    pub fn column(&mut self, f: &Transition, which: usize, product: &Product, keep: &Errors<f32>) {
        let Some((row, m)) = self.0.get_mut(which).zip(product.get(which)) else { return };
        let m = Errors::from(*m);
        let housing = f.housing.dot(&m);
        let half = f.element.half;
        let element =
            (1.0 - 2.0 * half) * m.element + half * (m.housing + housing) + f.element.lag * m.lag;
        let mut zones = m.zones;
        for (entry, zone) in zones.iter_mut().zip(&f.zones).skip(which) {
            *entry = zone.dot(&m);
        }
        let wall = if which <= ZONES { f.wall.dot(&m) } else { m.wall };
        *row = Errors {
            zones,
            wall,
            housing,
            element,
            foil: keep.foil * m.foil,
            scale: keep.scale * m.scale,
            stirring: keep.stirring * m.stirring,
            lag: keep.lag * m.lag,
            housing_lag: keep.housing_lag * m.housing_lag,
            place: keep.place * m.place,
        }
        .into();
    }

    /// Fades the parameters' own rows, from the diagonal on: they keep `keep` of their errors.
    pub fn fade(&mut self, keep: &Errors<f32>) {
        let keep: Row = (*keep).into();
        for (i, row) in self.0.iter_mut().enumerate().skip(MOVED) {
            let (Some(row), Some(keep)) = (row.get_mut(i..), keep.get(i..)) else { return };
            let [kept, ..] = keep else { return };
            for (entry, other) in row.iter_mut().zip(keep) {
                *entry *= kept * other;
            }
        }
    }

    /// The element's row.
    fn element(&self) -> &Row {
        let [_, _, _, _, _, _, element, ..] = &self.0;
        element
    }

    /// Returns the gains for a reading of the element with this variance \[K2\], and the share of the element's
    /// variance that remains.
    pub fn gains(&self, reading_k2: f32) -> (Errors<f32>, f32) {
        let element = self.element();
        let per_s = 1.0 / (self.element_k2() + reading_k2);
        let gains: Row = element.map(|covariance| covariance * per_s);
        (gains.into(), reading_k2 * per_s)
    }

    /// Computes P' = (I - K H) P, from the diagonal on.
    pub fn reduce(&mut self, gains: &Errors<f32>, left: f32) {
        let element = *self.element();
        let gains: Row = (*gains).into();
        for (i, (row, gain)) in self.0.iter_mut().zip(gains).enumerate() {
            let (Some(row), Some(element)) = (row.get_mut(i..), element.get(i..)) else { return };
            if i + 1 == MOVED {
                // As a product, never as a difference.
                row.iter_mut().for_each(|entry| *entry *= left);
            } else {
                for (entry, covariance) in row.iter_mut().zip(element) {
                    *entry -= gain * covariance;
                }
            }
        }
    }

    /// Copies the part above the diagonal below it.
    pub fn mirror(&mut self) {
        for i in 0..ERRORS {
            let Some((head, tail)) = self.0.split_at_mut_checked(i + 1) else { return };
            let Some(row) = head.last().and_then(|row| row.get(i + 1..)) else { return };
            for (other, value) in tail.iter_mut().zip(row) {
                if let Some(entry) = other.get_mut(i) {
                    *entry = *value;
                }
            }
        }
    }

    /// Limits the variances to between `least` and the most that anything can have; returns whether all were below
    /// that.
    pub fn limit(&mut self, least: &Errors<f32>) -> bool {
        const MOST: f32 = 1.0e4;
        let least: Row = (*least).into();
        let mut sound = true;
        for (i, (row, least)) in self.0.iter_mut().zip(least).enumerate() {
            if let Some(entry) = row.get_mut(i) {
                sound &= *entry < MOST;
                *entry = limit(*entry, least, MOST);
            }
        }
        sound
    }

    /// Variance of the relative error of the mean gas temperature, for zones with these shares of the mass.
    pub fn gas(&self, shares: &PerZone) -> f32 {
        let [a, b, c, d, ..] = &self.0;
        let row = |[a, b, c, d, ..]: &Row| total(&times(&[*a, *b, *c, *d], shares));
        total(&times(&[row(a), row(b), row(c), row(d)], shares))
    }

    /// Variance of the inner wall \[K2\].
    pub fn wall_k2(&self) -> f32 {
        let [_, _, _, _, [_, _, _, _, wall_k2, ..], ..] = self.0;
        wall_k2
    }

    /// Variance of the element \[K2\].
    pub fn element_k2(&self) -> f32 {
        let [_, _, _, _, _, _, element_k2, ..] = *self.element();
        element_k2
    }
}
