//! A chamber given by a measured table, such as a bellows: volume and elastic force over the length, with monotone
//! cubics between the rows (Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5, 1984), so that dV/dL, the effective
//! area, is continuous and never changes its sign.

use super::Chamber;
use crate::math::{limit, sqrt};
use crate::parameter::{ConfigError, within};
use core::f32::consts::PI;

/// Largest number of rows in a table.
pub const MOST_ROWS: usize = 12;
/// Steps of the search for a length between two rows: the force is nearly linear there.
const STEPS: u8 = 4;

/// One row.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Row {
    /// Length \[m\].
    pub length_m: f32,
    /// Gas volume there \[m3\].
    pub volume_m3: f32,
    /// Force there without gauge pressure, positive if it pulls the ends together \[N\].
    pub force_n: f32,
}

/// A measured table.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Table {
    /// The rows, by rising length; those after the first `count` are zeros.
    pub rows: [Row; MOST_ROWS],
    /// Number of rows, 3 to 12.
    pub count: u8,
    /// Length at which contraction is 0 \[m\].
    pub rest_length_m: f32,
}

impl Table {
    /// Checks every value: lengths and forces rise, volumes rise or fall.
    ///
    /// # Errors
    /// The first value that is not a number or lies outside of its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        within("table.rows", f32::from(self.count), 3.0, MOST_ROWS as f32)?;
        within("table.rest_length_m", self.rest_length_m, 0.001, 10.0)?;
        let [first, second, ..] = &self.rows;
        let falls = second.volume_m3 < first.volume_m3;
        let mut before = Row { length_m: 0.0, volume_m3: 0.0, force_n: -1.0e6 };
        let mut volumes_m3 = (1.0e-9, 1.0e3);
        for row in self.rows.iter().take(usize::from(self.count)) {
            within("table.length_m", row.length_m, before.length_m + 1.0e-5, 10.0)?;
            within("table.volume_m3", row.volume_m3, volumes_m3.0, volumes_m3.1)?;
            within("table.force_n", row.force_n, before.force_n, 1.0e6)?;
            // A part in a million, or rounding turns it into a step.
            volumes_m3 = if falls {
                (1.0e-9, row.volume_m3 * (1.0 - 1.0e-6))
            } else {
                (row.volume_m3 * (1.0 + 1.0e-6), 1.0e3)
            };
            before = *row;
        }
        for row in self.rows.iter().skip(usize::from(self.count)) {
            within("table.length_m", row.length_m, 0.0, 0.0)?;
            within("table.volume_m3", row.volume_m3, 0.0, 0.0)?;
            within("table.force_n", row.force_n, 0.0, 0.0)?;
        }
        Ok(())
    }
}

/// a + b t + c t^2 + d t^3, t being the way between two rows, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Cubic {
    a: f32,
    b: f32,
    c: f32,
    d: f32,
}

impl Cubic {
    /// Creates the cubic through two values; the slopes are given times the distance between them.
    fn through(from: f32, to: f32, from_slope: f32, to_slope: f32) -> Self {
        let change = to - from;
        Self {
            a: from,
            b: from_slope,
            c: 3.0 * change - 2.0 * from_slope - to_slope,
            d: from_slope + to_slope - 2.0 * change,
        }
    }

    fn at(&self, t: f32) -> f32 {
        self.a + t * (self.b + t * (self.c + t * self.d))
    }

    fn slope_at(&self, t: f32) -> f32 {
        self.b + t * (2.0 * self.c + 3.0 * t * self.d)
    }

    fn curvature_at(&self, t: f32) -> f32 {
        2.0 * self.c + 6.0 * t * self.d
    }
}

/// The interval between two rows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Segment {
    start_m: f32,
    end_m: f32,
    /// Reciprocal of the distance between them \[1/m\].
    per_m: f32,
    volume: Cubic,
    force: Cubic,
}

impl Segment {
    fn way(&self, length_m: f32) -> f32 {
        (length_m - self.start_m) * self.per_m
    }

    fn force_n(&self, gauge_pressure_pa: f32, t: f32) -> f32 {
        -gauge_pressure_pa * self.volume.slope_at(t) * self.per_m + self.force.at(t)
    }
}

/// A table with its cubics computed once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Curve {
    segments: [Segment; MOST_ROWS - 1],
    count: usize,
    rest_length_m: f32,
    shortest_m: f32,
    longest_m: f32,
}

/// Slope at a row between two segments of these widths and slopes: their harmonic mean, so that nothing overshoots.
fn between(width_0: f32, slope_0: f32, width_1: f32, slope_1: f32) -> f32 {
    if !(slope_0 * slope_1 > 0.0) {
        return 0.0;
    }
    let (weight_0, weight_1) = (width_0 + 2.0 * width_1, 2.0 * width_0 + width_1);
    (weight_0 + weight_1) * slope_0 * slope_1 / (weight_0 * slope_1 + weight_1 * slope_0)
}

/// Slope at the end of a segment: that of the parabola through it and its neighbour, limited to between none and three
/// times the segment's own.
fn at_end(width_0: f32, slope_0: f32, width_1: f32, slope_1: f32) -> f32 {
    let parabola = slope_0 + (slope_0 - slope_1) * width_0 / (width_0 + width_1);
    if slope_0 < 0.0 {
        limit(parabola, 3.0 * slope_0, 0.0)
    } else {
        limit(parabola, 0.0, 3.0 * slope_0)
    }
}

/// Slopes of `value` at both ends of the segment between `from` and `to`.
fn slopes(
    [before, from, to, after]: [Option<&Row>; 4],
    value: impl Fn(&Row) -> f32,
) -> Option<(f32, f32)> {
    let stretch = |from: Option<&Row>, to: Option<&Row>| {
        let width_m = to?.length_m - from?.length_m;
        Some((width_m, (value(to?) - value(from?)) / width_m))
    };
    let (width, slope) = stretch(from, to)?;
    Some(match (stretch(before, from), stretch(to, after)) {
        (Some((w0, s0)), Some((w1, s1))) => {
            (between(w0, s0, width, slope), between(width, slope, w1, s1))
        }
        (None, Some((w1, s1))) => (at_end(width, slope, w1, s1), between(width, slope, w1, s1)),
        (Some((w0, s0)), None) => (between(w0, s0, width, slope), at_end(width, slope, w0, s0)),
        (None, None) => (slope, slope),
    })
}

impl From<Table> for Curve {
    fn from(table: Table) -> Self {
        let mut segments = [Segment::default(); MOST_ROWS - 1];
        let count = usize::from(table.count).clamp(2, MOST_ROWS) - 1;
        let rows = table.rows.iter().take(count + 1);
        let shortest_m = rows.clone().next().map_or(0.0, |row| row.length_m);
        let longest_m = rows.clone().next_back().map_or(0.0, |row| row.length_m);
        for (i, segment) in segments.iter_mut().take(count).enumerate() {
            let mut near = rows.clone().skip(i);
            let before = if i > 0 { rows.clone().nth(i - 1) } else { None };
            let [from, to, after] = [near.next(), near.next(), near.next()];
            let stretch = [before, from, to, after];
            let (Some(from), Some(to)) = (from, to) else { break };
            let (Some(volume), Some(force)) =
                (slopes(stretch, |row| row.volume_m3), slopes(stretch, |row| row.force_n))
            else {
                break;
            };
            let width_m = to.length_m - from.length_m;
            let through = |from: f32, to: f32, (start, end): (f32, f32)| {
                Cubic::through(from, to, start * width_m, end * width_m)
            };
            *segment = Segment {
                start_m: from.length_m,
                end_m: to.length_m,
                per_m: 1.0 / width_m,
                volume: through(from.volume_m3, to.volume_m3, volume),
                force: through(from.force_n, to.force_n, force),
            };
        }
        Self { segments, count, rest_length_m: table.rest_length_m, shortest_m, longest_m }
    }
}

impl Curve {
    fn segments(&self) -> impl Iterator<Item = &Segment> {
        self.segments.iter().take(self.count)
    }

    /// The segment that contains a length, and the way into it; beyond the ends the last or first segment.
    fn at<T>(&self, length_m: f32, value: impl Fn(&Segment, f32) -> T) -> T {
        let [first, ..] = &self.segments;
        let mut found = first;
        for segment in self.segments() {
            found = segment;
            if length_m <= segment.end_m {
                break;
            }
        }
        value(found, found.way(length_m))
    }
}

impl Chamber for Curve {
    fn rest_length_m(&self) -> f32 {
        self.rest_length_m
    }

    fn shortest_m(&self) -> f32 {
        self.shortest_m
    }

    fn longest_m(&self) -> f32 {
        self.longest_m
    }

    fn volume_m3(&self, length_m: f32) -> f32 {
        self.at(length_m, |segment, t| segment.volume.at(t))
    }

    fn volume_slope_m2(&self, length_m: f32) -> f32 {
        self.at(length_m, |segment, t| segment.volume.slope_at(t) * segment.per_m)
    }

    /// Surface of a smooth tube of this volume and length, with its ends; folds are accounted for in `heat`.
    fn surface_m2(&self, length_m: f32) -> f32 {
        let volume_m3 = self.volume_m3(length_m);
        2.0 * (sqrt(PI * volume_m3 * length_m) + volume_m3 / length_m)
    }

    fn force_n(&self, gauge_pressure_pa: f32, length_m: f32) -> f32 {
        self.at(length_m, |segment, t| segment.force_n(gauge_pressure_pa, t))
    }

    fn stiffness_n_m(&self, gauge_pressure_pa: f32, length_m: f32) -> f32 {
        self.at(length_m, |segment, t| {
            let area_slope = segment.volume.curvature_at(t) * segment.per_m;
            (segment.force.slope_at(t) - gauge_pressure_pa * area_slope) * segment.per_m
        })
    }

    /// By false position in the first segment at whose end the force is reached.
    fn length_for_force_m(&self, gauge_pressure_pa: f32, force_n: f32) -> f32 {
        let Some(segment) =
            self.segments().find(|segment| segment.force_n(gauge_pressure_pa, 1.0) >= force_n)
        else {
            return self.longest_m;
        };
        let lacks_n = |t: f32| force_n - segment.force_n(gauge_pressure_pa, t);
        let (mut low, mut high) = ((0.0, lacks_n(0.0)), (1.0, lacks_n(1.0)));
        if !(low.1 > 0.0) {
            return segment.start_m;
        }
        for _ in 0..STEPS {
            let t = low.0 + (high.0 - low.0) * low.1 / (low.1 - high.1);
            let here = (t, lacks_n(t));
            if here.1 > 0.0 {
                low = here;
            } else {
                high = here;
            }
            if low.1 - high.1 <= 0.0 {
                break;
            }
        }
        let t = low.0 + (high.0 - low.0) * limit(low.1 / (low.1 - high.1), 0.0, 1.0);
        self.limit_length_m(segment.start_m + t * (segment.end_m - segment.start_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A bellows of 20 cm2 that narrows by 10 % as it lengthens from 80 to 130 mm; 8 N/mm, stiffer outwards, free at 90
    /// mm.
    fn bellows(rows: u8) -> Table {
        let mut table =
            Table { rows: [Row::default(); MOST_ROWS], count: rows, rest_length_m: 0.09 };
        for (i, row) in (0_u8..rows).zip(&mut table.rows) {
            let x = 0.05 * f32::from(i) / f32::from(rows - 1);
            let from_free_m = x - 0.01;
            *row = Row {
                length_m: 0.08 + x,
                volume_m3: 1.0e-4 + 2.0e-3 * x * (1.0 - x),
                force_n: 8.0e3 * from_free_m * (1.0 + 5.0 * from_free_m),
            };
        }
        table
    }

    fn curve() -> Curve {
        bellows(12).into()
    }

    #[test]
    fn a_table_that_is_none_is_named() {
        assert_eq!(bellows(12).check(), Ok(()));
        assert_eq!(bellows(3).check(), Ok(()));
        let field = |change: fn(&mut Table)| {
            let mut table = bellows(6);
            change(&mut table);
            table.check().unwrap_err().field
        };
        assert_eq!(field(|table| table.count = 5), "table.length_m", "a row more than it counts");
        assert_eq!(field(|table| table.rows[6].length_m = f32::NAN), "table.length_m");
        assert_eq!(field(|table| table.rows[9].volume_m3 = f32::NAN), "table.volume_m3");
        assert_eq!(field(|table| table.rows[11].force_n = f32::INFINITY), "table.force_n");
        assert_eq!(field(|table| table.count = 2), "table.rows");
        assert_eq!(field(|table| table.count = 13), "table.rows");
        assert_eq!(field(|table| table.rows[2].length_m = 0.08), "table.length_m");
        assert_eq!(field(|table| table.rows[2].volume_m3 = 1.0e-4), "table.volume_m3");
        assert_eq!(field(|table| table.rows[2].force_n = -1.0e3), "table.force_n");
        assert_eq!(field(|table| table.rows[5].force_n = f32::NAN), "table.force_n");
    }

    proptest! {
        /// Twelve rows of a smooth bellows reproduce it to a part in a thousand; its area is the slope.
        #[test]
        fn between_the_rows_it_is_what_was_measured(length_m in 0.08_f32..0.13) {
            let curve = curve();
            let x = f64::from(length_m) - 0.08;
            let volume_m3 = 1.0e-4 + 2.0e-3 * x * (1.0 - x);
            prop_assert!((f64::from(curve.volume_m3(length_m)) / volume_m3 - 1.0).abs() < 1e-5);
            let area_m2 = 2.0e-3 * (1.0 - 2.0 * x);
            prop_assert!((f64::from(curve.volume_slope_m2(length_m)) / area_m2 - 1.0).abs() < 2e-3);
            let from_free_m = x - 0.01;
            let force_n = 8.0e3 * from_free_m * (1.0 + 5.0 * from_free_m) - 2.0e5 * area_m2;
            prop_assert!((f64::from(curve.force_n(2.0e5, length_m)) - force_n).abs() < 1.0);
        }

        #[test]
        fn length_and_pressure_invert_the_force(
            gauge_pa in 0.0_f32..4.0e5, length_m in 0.0801_f32..0.1299
        ) {
            let curve = curve();
            let force_n = curve.force_n(gauge_pa, length_m);
            let back_m = curve.length_for_force_m(gauge_pa, force_n);
            prop_assert!((back_m - length_m).abs() < 5e-6, "{back_m} for {length_m}");
            let back_pa = curve.gauge_pressure_for_force_pa(force_n, length_m);
            prop_assert!((back_pa - gauge_pa).abs() < 10.0, "{back_pa} for {gauge_pa}");
        }

        /// The slope neither jumps at a row nor changes its sign, however uneven the table.
        #[test]
        fn it_is_monotone_and_smooth(
            steps in proptest::array::uniform5((1.0e-3_f32..0.05, 1.0e-6_f32..1.0e-3, 0.0_f32..500.0)),
            falls in any::<bool>()
        ) {
            let mut table = Table { rows: [Row::default(); MOST_ROWS], count: 6, rest_length_m: 0.1 };
            let mut row = Row { length_m: 0.1, volume_m3: 0.01, force_n: -200.0 };
            for (i, place) in table.rows.iter_mut().enumerate().take(6) {
                *place = row;
                let (length_m, volume_m3, force_n) = steps[i.min(4)];
                row.length_m += length_m;
                row.volume_m3 += if falls { -volume_m3 } else { volume_m3 };
                row.force_n += force_n;
            }
            prop_assert_eq!(table.check(), Ok(()));
            let curve = Curve::from(table);
            let steepest_m2 = steps.iter().map(|step| step.1 / step.0).fold(0.0, f32::max);
            let sign = if falls { -1.0 } else { 1.0 };
            for i in 0..=1000_u16 {
                let way_m = curve.longest_m() - curve.shortest_m();
                let length_m = curve.shortest_m() + way_m * f32::from(i) / 1000.0;
                let slope_m2 = sign * curve.volume_slope_m2(length_m);
                prop_assert!(slope_m2 >= -1e-5 * steepest_m2 - 4e-6, "{slope_m2} at {length_m} m");
            }
            for row in &table.rows[1..5] {
                let [below, above] =
                    [-2.0e-7, 2.0e-7].map(|by| curve.volume_slope_m2(row.length_m + by));
                prop_assert!((below - above).abs() <= 1e-2 * steepest_m2, "{below} {above}");
            }
        }
    }
}
