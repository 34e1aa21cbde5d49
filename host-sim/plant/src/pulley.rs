//! Radii of a joint's pulley over the angle, and their exact integrals.

use std::sync::Arc;

/// Angles between the stops at which the largest radius is sought.
const SOUGHT: u32 = 64;

#[derive(Debug, Clone, PartialEq)]
enum Course {
    /// Radii of muscles a and b over the pulley's radius: coefficients of the angle's powers.
    Powers([[f64; 4]; 2]),
    /// Angle \[rad\], and the radii of muscles a and b \[m\], by rising angle; linear between the rows.
    Rows(Arc<[[f64; 3]]>),
}

#[derive(Debug, Clone, PartialEq)]
pub struct Pulley {
    /// Radius that the muscles' shares refer to \[m\].
    pub radius_m: f64,
    course: Course,
}

impl Pulley {
    /// The same radius for both muscles at every angle \[m\].
    pub const fn constant(radius_m: f64) -> Self {
        Self::powers(radius_m, [[1.0, 0.0, 0.0, 0.0]; 2])
    }

    /// Radii of muscles a and b as shares of `radius_m`: coefficients of the angle's powers.
    pub const fn powers(radius_m: f64, shares: [[f64; 4]; 2]) -> Self {
        Self { radius_m, course: Course::Powers(shares) }
    }

    /// Pulley from rows of angle \[rad\] and radii of muscles a and b \[m\], by rising angle; at least two.
    pub fn rows(radius_m: f64, rows: Arc<[[f64; 3]]>) -> Self {
        Self { radius_m, course: Course::Rows(rows) }
    }

    /// Radii of muscles a and b over `radius_m`, at an angle \[rad\].
    pub fn shares(&self, angle_rad: f64) -> [f64; 2] {
        self.mean_shares(angle_rad, angle_rad)
    }

    /// Mean shares over the way between two angles \[rad\].
    pub fn mean_shares(&self, from_rad: f64, to_rad: f64) -> [f64; 2] {
        match &self.course {
            Course::Powers(shares) => shares.map(|[share, one, two, three]| {
                let (f, t) = (from_rad, to_rad);
                let square = (f * f + f * t + t * t) / 3.0;
                share
                    + 0.5 * one * (f + t)
                    + two * square
                    + 0.25 * three * (f + t) * (f * f + t * t)
            }),
            Course::Rows(rows) => {
                [1, 2].map(|column| mean_m(rows, column, from_rad, to_rad) / self.radius_m)
            }
        }
    }

    /// Changes of the radii of muscles a and b over `radius_m` \[1/rad\].
    pub fn slopes_per_rad(&self, angle_rad: f64) -> [f64; 2] {
        match &self.course {
            Course::Powers(shares) => shares.map(|[_, one, two, three]| {
                one + angle_rad * (2.0 * two + 3.0 * three * angle_rad)
            }),
            Course::Rows(rows) => {
                let after = rows.partition_point(|row| row[0] <= angle_rad);
                let after = after.clamp(1, rows.len() - 1);
                let (from, to) = (rows[after - 1], rows[after]);
                [1, 2].map(|i| (to[i] - from[i]) / (to[0] - from[0]) / self.radius_m)
            }
        }
    }

    /// Lengths of muscles a and b that are wound up from angle 0 to this one \[m\].
    pub fn ways_m(&self, angle_rad: f64) -> [f64; 2] {
        self.mean_shares(0.0, angle_rad).map(|share| self.radius_m * angle_rad * share)
    }

    /// Largest radii of muscles a and b between two angles \[m\], and their steepest changes \[m/rad\].
    pub(crate) fn largest(&self, [least_rad, most_rad]: [f64; 2]) -> [[f64; 2]; 2] {
        let mut largest = [[0.0_f64; 2]; 2];
        for i in 0..=SOUGHT {
            let angle_rad = least_rad + f64::from(i) / f64::from(SOUGHT) * (most_rad - least_rad);
            let found = [self.shares(angle_rad), self.slopes_per_rad(angle_rad)];
            for (largest, found) in largest.iter_mut().flatten().zip(found.into_iter().flatten()) {
                *largest = largest.max(self.radius_m * found.abs());
            }
        }
        largest
    }
}

/// Radius of the rows at an angle \[m\]; beyond them the last row's.
fn at_m(rows: &[[f64; 3]], column: usize, angle_rad: f64) -> f64 {
    let after = rows.partition_point(|row| row[0] <= angle_rad);
    if after == 0 || after == rows.len() {
        return rows[after.saturating_sub(1)][column];
    }
    let (from, to) = (rows[after - 1], rows[after]);
    let share = (angle_rad - from[0]) / (to[0] - from[0]);
    from[column] + share * (to[column] - from[column])
}

/// Mean of a radius over the way between two angles \[m\].
fn mean_m(rows: &[[f64; 3]], column: usize, from_rad: f64, to_rad: f64) -> f64 {
    let (low, high) = (from_rad.min(to_rad), from_rad.max(to_rad));
    if low == high {
        return at_m(rows, column, low);
    }
    let between =
        rows.partition_point(|row| row[0] <= low)..rows.partition_point(|row| row[0] < high);
    let knots = rows[between].iter().map(|row| (row[0], row[column]));
    let mut sum = 0.0;
    let mut start = (low, at_m(rows, column, low));
    for end in knots.chain([(high, at_m(rows, column, high))]) {
        sum += 0.5 * (start.1 + end.1) * (end.0 - start.0);
        start = end;
    }
    sum / (high - low)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinked() -> Pulley {
        let rows =
            [[-1.0, 0.016, 0.024], [-0.2, 0.019, 0.02], [0.5, 0.023, 0.02], [1.0, 0.02, 0.014]];
        Pulley::rows(0.02, Arc::from(rows))
    }

    /// Compares with sums over small ways, of rows and of powers.
    #[test]
    fn ways_are_integrals_of_the_radii() {
        let powers = Pulley::powers(0.02, [[1.0, 0.2, -0.1, 0.05], [1.1, -0.2, 0.0, 0.1]]);
        for pulley in [kinked(), powers] {
            for (from, to) in [(0.0, 0.9), (-0.7, 0.8), (0.3, -0.9), (0.6, 0.61), (-0.2, 0.5)] {
                let steps = 20_000;
                let width = (to - from) / f64::from(steps);
                let mut sums = [0.0; 2];
                for i in 0..steps {
                    let shares = pulley.shares(from + (f64::from(i) + 0.5) * width);
                    sums.iter_mut().zip(shares).for_each(|(sum, share)| *sum += share);
                }
                let means = pulley.mean_shares(from, to);
                for (mean, sum) in means.into_iter().zip(sums) {
                    assert!((mean - sum / f64::from(steps)).abs() < 1e-8, "{mean} {from} {to}");
                }
            }
            let h = 1e-6;
            for angle in [-0.9, -0.5, 0.1, 0.7, 0.95] {
                let (after, before) = (pulley.shares(angle + h), pulley.shares(angle - h));
                let ways = [pulley.ways_m(angle + h), pulley.ways_m(angle - h)];
                for i in 0..2 {
                    let slope = (after[i] - before[i]) / (2.0 * h);
                    assert!((pulley.slopes_per_rad(angle)[i] - slope).abs() < 1e-8);
                    let radius_m = (ways[0][i] - ways[1][i]) / (2.0 * h);
                    assert!((radius_m - 0.02 * pulley.shares(angle)[i]).abs() < 1e-10);
                }
            }
        }
    }

    #[test]
    fn a_constant_pulley_is_exact() {
        let pulley = Pulley::constant(0.021);
        assert_eq!(pulley.mean_shares(-0.3, 0.7), [1.0; 2]);
        assert_eq!(pulley.ways_m(0.7), [0.021 * 0.7; 2]);
        assert_eq!(pulley.largest([-0.8, 0.8]), [[0.021; 2], [0.0; 2]]);
        let [radii, slopes] = kinked().largest([-0.8, 0.8]);
        assert!((radii[0] - 0.023).abs() < 1e-4 && radii[1] < 0.024 && slopes[1] > 0.0119);
    }
}
