//! Recording a streamed run in bounded memory, for drawing.

/// Largest number of rows: 100 s of a run at the default logging are kept entirely, on a page below 1 MB.
pub const CAPACITY: usize = 10_240;

/// Keeps named columns of an arbitrarily long run in at most [`CAPACITY`] rows, or in fewer.
///
/// Samples are gathered in stretches of equal length, two rows each: the smallest and the largest value of the stretch,
/// column by column, in the order of their arrival. When the rows are used up, neighbouring stretches are joined and
/// the stretches become twice as long. So no peak is lost, a rising column (time) stays sorted, and nothing is thinned
/// before the rows are used up.
///
/// Within a row the columns may stem from different samples of the stretch: figures (errors,
/// RMSE) have to be computed from the samples themselves, or recorded as a column of their own.
#[derive(Debug, Clone)]
pub struct Recorder {
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
    capacity: usize,
    /// Samples per stretch.
    stretch: usize,
    /// Samples in the last, still open stretch.
    open: usize,
}

impl Recorder {
    /// A recorder of columns with these names.
    pub fn new(names: &[&str]) -> Self {
        Self::with_capacity(names, CAPACITY)
    }

    /// A recorder of fewer rows, a multiple of four.
    pub fn with_capacity(names: &[&str], capacity: usize) -> Self {
        Self {
            capacity,
            names: names.iter().map(|name| (*name).to_owned()).collect(),
            columns: names.iter().map(|_| Vec::with_capacity(capacity)).collect(),
            stretch: 2,
            open: 2,
        }
    }

    /// Adds one sample. A value that is not finite is a gap.
    ///
    /// # Panics
    /// If `sample` does not have one value per column.
    pub fn push(&mut self, sample: &[f64]) {
        assert_eq!(sample.len(), self.columns.len(), "one value per column: {:?}", self.names);
        if self.open == self.stretch {
            if self.rows() == self.capacity {
                self.join_stretches();
            }
            self.open = 0;
        }
        for (column, value) in self.columns.iter_mut().zip(sample) {
            if self.open < 2 {
                column.push(*value);
            } else {
                let last = column.len() - 2;
                [column[last], column[last + 1]] =
                    widened([column[last], column[last + 1]], *value);
            }
        }
        self.open += 1;
    }

    /// The rows of a column; `None` if there is no such column.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let index = self.names.iter().position(|n| n == name)?;
        Some(&self.columns[index])
    }

    pub fn rows(&self) -> usize {
        self.columns.first().map_or(0, Vec::len)
    }

    fn join_stretches(&mut self) {
        for column in &mut self.columns {
            for joined in 0..self.capacity / 4 {
                let [a, b, c, d] = [0, 1, 2, 3].map(|i| column[4 * joined + i]);
                [column[2 * joined], column[2 * joined + 1]] = widened(widened([a, b], c), d);
            }
            column.truncate(self.capacity / 2);
        }
        self.stretch *= 2;
    }
}

/// The extremes, in order of time, of a stretch with the extremes `[a, b]` and a later `value`.
fn widened([a, b]: [f64; 2], value: f64) -> [f64; 2] {
    let (low, high) = (a.min(b), a.max(b));
    if !value.is_finite() {
        [a, b]
    } else if !a.is_finite() {
        [b, value]
    } else if !b.is_finite() {
        [a, value]
    } else if value < low {
        [high, value]
    } else if value > high {
        [low, value]
    } else {
        [a, b]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_short_run_is_kept_whole() {
        let mut recorder = Recorder::new(&["time_s", "pressure_pa"]);
        for i in 0..CAPACITY as i32 {
            recorder.push(&[f64::from(i), f64::from(i % 7)]);
        }
        let time: Vec<f64> = (0..CAPACITY as i32).map(f64::from).collect();
        assert_eq!(recorder.column("time_s"), Some(&time[..]));
        assert_eq!(recorder.column("length_m"), None);
    }

    #[test]
    fn an_hour_at_a_kilohertz_stays_bounded_and_keeps_its_peaks() {
        let mut recorder = Recorder::new(&["time_s", "value", "sparse"]);
        let n = 3_600_000;
        for i in 0..n {
            let value = match i {
                1_234_567 => 9.0,
                3_599_999 => -7.0,
                _ => (f64::from(i) * 1e-3).sin(),
            };
            let sparse = if i % 1000 == 0 { f64::from(i) } else { f64::NAN };
            recorder.push(&[f64::from(i) * 0.5, value, sparse]);
        }
        assert!((CAPACITY / 2..=CAPACITY).contains(&recorder.rows()), "{}", recorder.rows());
        let value = recorder.column("value").unwrap();
        assert_eq!(value.iter().copied().fold(f64::NEG_INFINITY, f64::max), 9.0);
        assert_eq!(value.iter().copied().fold(f64::INFINITY, f64::min), -7.0);
        let time = recorder.column("time_s").unwrap();
        assert!(time.is_sorted());
        assert_eq!((time[0], time[time.len() - 1]), (0.0, 1_799_999.5));
        let sparse = recorder.column("sparse").unwrap();
        assert!(sparse.iter().filter(|v| v.is_finite()).count() > 1000);
    }

    #[test]
    fn extremes_come_in_order_of_time() {
        assert_eq!(widened([1.0, 2.0], 0.0), [2.0, 0.0]);
        assert_eq!(widened([2.0, 1.0], 3.0), [1.0, 3.0]);
        assert_eq!(widened([2.0, 1.0], 1.5), [2.0, 1.0]);
        assert_eq!(widened([2.0, 1.0], f64::INFINITY), [2.0, 1.0]);
        let gap = widened([f64::NAN, f64::NAN], 4.0);
        assert!(gap[0].is_nan() && gap[1] == 4.0);
    }
}
