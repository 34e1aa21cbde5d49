//! A value over time, piecewise linear: a piston's volume, a set point.

use thermyo_compute::math::usual_distance;
use thermyo_files::number::significant;

/// Least distance of the rows of a motion; closer rows are those of a record in minutes: 50 rows a second are then 0.33
/// ms apart \[s\].
pub const LEAST_DISTANCE_S: f64 = 4.0e-4;

/// A piecewise-linear function of time; before its first and after its last point it is constant.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    points: Vec<(f64, f64)>,
}

/// Reason why a table of (time, value) is not a profile. Rows count from zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ProfileError {
    #[error("a profile needs at least one row")]
    Empty,
    #[error("row {row} of the profile is not finite")]
    NotFinite { row: usize },
    #[error("row {row} of the profile is not later than the row before it")]
    NotIncreasing { row: usize },
}

impl Profile {
    /// A profile through (time \[s\], value), times strictly increasing.
    ///
    /// # Errors
    /// [`ProfileError`] for an empty table, a cell that is not finite, or times out of order.
    pub fn new(points: Vec<(f64, f64)>) -> Result<Self, ProfileError> {
        if points.is_empty() {
            return Err(ProfileError::Empty);
        }
        for (row, (time, value)) in points.iter().enumerate() {
            if !(time.is_finite() && value.is_finite()) {
                return Err(ProfileError::NotFinite { row });
            }
            if row > 0 && *time <= points[row - 1].0 {
                return Err(ProfileError::NotIncreasing { row });
            }
        }
        Ok(Self { points })
    }

    pub fn constant(value: f64) -> Self {
        Self { points: vec![(0.0, value)] }
    }

    /// The profile with `offset` added to every value.
    pub fn raised(mut self, offset: f64) -> Self {
        for (_, value) in &mut self.points {
            *value += offset;
        }
        self
    }

    pub fn points(&self) -> &[(f64, f64)] {
        &self.points
    }

    pub fn value(&self, time_s: f64) -> f64 {
        let next = self.points.partition_point(|point| point.0 <= time_s);
        let (Some(before), Some(after)) =
            (next.checked_sub(1).map(|i| self.points[i]), self.points.get(next))
        else {
            let edge = next.min(self.points.len() - 1);
            return self.points[edge].1;
        };
        before.1 + (after.1 - before.1) * (time_s - before.0) / (after.0 - before.0)
    }

    /// Asks about the unit of the times, if the rows are usually minutes or less than a step apart. A profile of few
    /// rows may be anything.
    pub fn doubt(&self) -> Option<String> {
        const FEWEST_ROWS: usize = 3;
        const LONGEST_S: f64 = 100.0;
        if self.points.len() < FEWEST_ROWS {
            return None;
        }
        let times_s: Vec<f64> = self.points.iter().map(|(time_s, _)| *time_s).collect();
        let usual_s = usual_distance(&times_s);
        let unit = match usual_s {
            LONGEST_S.. => "ms",
            ..LEAST_DISTANCE_S => "min or h",
            _ => return None,
        };
        let usual = significant(usual_s, 3);
        Some(format!("its rows are {usual} s apart: is its time_s in {unit}?"))
    }

    /// The slope just after `time_s` \[value per s\].
    pub fn slope_after(&self, time_s: f64) -> f64 {
        let next = self.points.partition_point(|point| point.0 <= time_s);
        if next == 0 || next == self.points.len() {
            return 0.0;
        }
        let (before, after) = (self.points[next - 1], self.points[next]);
        (after.1 - before.1) / (after.0 - before.0)
    }

    /// The first point later than `time_s`: an integrator stops there, because the slope jumps.
    pub fn knot_after(&self, time_s: f64) -> Option<f64> {
        let next = self.points.partition_point(|point| point.0 <= time_s);
        self.points.get(next).map(|point| point.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_in_another_unit_are_doubted() {
        let of = |scale: f64, rows: u32| {
            let points = (0..rows).map(|i| (f64::from(i) * scale, 1.0)).collect();
            Profile::new(points).unwrap().doubt().unwrap_or_default()
        };
        assert_eq!(of(1000.0, 11), "its rows are 1000 s apart: is its time_s in ms?");
        assert_eq!(
            of(1.0 / 3600.0, 11),
            "its rows are 2.78×10⁻⁴ s apart: is its time_s in min or h?"
        );
        for (scale, rows) in [(99.0, 11), (0.001, 11), (1000.0, 2), (1e-4, 1)] {
            assert_eq!(of(scale, rows), "", "{scale} {rows}");
        }
    }

    #[test]
    fn interpolates_and_holds_its_ends() {
        let profile = Profile::new(vec![(1.0, 10.0), (2.0, 20.0), (4.0, 0.0)]).unwrap();
        for (time, value) in
            [(0.0, 10.0), (1.0, 10.0), (1.5, 15.0), (2.0, 20.0), (3.0, 10.0), (9.0, 0.0)]
        {
            assert_eq!(profile.value(time), value, "at {time} s");
        }
        assert_eq!(profile.slope_after(2.0), -10.0);
        assert_eq!(profile.slope_after(4.0), 0.0);
        assert_eq!(profile.knot_after(1.0), Some(2.0));
        assert_eq!(profile.knot_after(4.0), None);
    }

    #[test]
    fn refuses_what_is_no_function_of_time() {
        assert_eq!(Profile::new(vec![]), Err(ProfileError::Empty));
        assert_eq!(
            Profile::new(vec![(0.0, 1.0), (0.0, 2.0)]),
            Err(ProfileError::NotIncreasing { row: 1 })
        );
        assert_eq!(Profile::new(vec![(0.0, f64::NAN)]), Err(ProfileError::NotFinite { row: 0 }));
    }
}
