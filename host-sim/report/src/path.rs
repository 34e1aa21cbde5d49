//! SVG path data in few bytes: relative moves, one decimal.

use std::fmt::Write;

/// Path data under construction. Positions are kept in tenths, so rounding does not add up.
#[derive(Default)]
pub(super) struct Path {
    data: String,
    at: (i64, i64),
    /// Whether the last command was a line, so that its letter need not be repeated.
    in_line: bool,
}

impl Path {
    pub(super) fn through(points: impl IntoIterator<Item = (f64, f64)>) -> Self {
        let mut path = Self::default();
        path.polyline(points);
        path
    }

    /// Adds a line through `points`; a single point becomes a dot if line caps are round.
    pub(super) fn polyline(&mut self, points: impl IntoIterator<Item = (f64, f64)>) {
        let mut points = points.into_iter();
        let Some(first) = points.next() else { return };
        self.move_to(first);
        points.for_each(|point| self.line_to(point));
        if !self.in_line {
            self.data.push_str("h0");
        }
    }

    /// Adds a dot at each of `points`, for strokes with round caps.
    pub(super) fn dots(&mut self, points: impl IntoIterator<Item = (f64, f64)>) {
        for point in points {
            self.move_to(point);
            self.data.push_str("h0");
        }
    }

    fn line_to(&mut self, point: (f64, f64)) {
        let to = tenths(point);
        if to == self.at {
            return;
        }
        if !self.in_line {
            self.data.push('l');
        }
        self.number(to.0 - self.at.0, self.in_line);
        self.number(to.1 - self.at.1, true);
        self.at = to;
        self.in_line = true;
    }

    /// Adds the area that `outline` encloses.
    pub(super) fn area(&mut self, outline: impl IntoIterator<Item = (f64, f64)>) {
        let before = self.data.len();
        self.polyline(outline);
        if self.data.len() > before {
            self.data.push('z');
            self.in_line = false;
        }
    }

    pub(super) fn data(&self) -> &str {
        &self.data
    }

    fn move_to(&mut self, point: (f64, f64)) {
        self.at = tenths(point);
        self.data.push('M');
        self.number(self.at.0, false);
        self.number(self.at.1, true);
        self.in_line = false;
    }

    fn number(&mut self, tenths: i64, separate: bool) {
        if separate && tenths >= 0 {
            self.data.push(' ');
        }
        if tenths < 0 {
            self.data.push('-');
        }
        let (whole, rest) = (tenths.abs() / 10, tenths.abs() % 10);
        if whole > 0 || rest == 0 {
            write!(self.data, "{whole}").expect("writing to a String");
        }
        if rest > 0 {
            write!(self.data, ".{rest}").expect("writing to a String");
        }
    }
}

fn tenths((x, y): (f64, f64)) -> (i64, i64) {
    ((x * 10.0).round() as i64, (y * 10.0).round() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_is_relative_and_short() {
        let path = Path::through([(10.0, 20.04), (10.5, 19.0), (10.52, 19.01), (12.0, 19.0)]);
        assert_eq!(path.data(), "M10 20l.5-1 1.5 0");
    }

    #[test]
    fn a_single_point_is_a_dot() {
        assert_eq!(Path::through([(1.0, -2.0)]).data(), "M1-2h0");
    }
}
