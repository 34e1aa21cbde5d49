//! Axes: from values to positions, and ticks at round values.

use thermyo_files::number::{fixed, power_of_ten, significant};

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Spacing {
    /// Equal differences take equal lengths.
    #[default]
    Linear,
    /// Equal ratios take equal lengths; values have to be positive.
    Log,
}

/// A range of values over a range of positions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    range: (f64, f64),
    pixels: (f64, f64),
    spacing: Spacing,
}

impl Scale {
    /// `range` has to be finite and rising, and positive with [`Spacing::Log`]: see [`data_range`].
    pub fn new(range: (f64, f64), pixels: (f64, f64), spacing: Spacing) -> Self {
        Self { range, pixels, spacing }
    }

    /// The position of `value`, limited to the surroundings of the drawing.
    pub fn position(&self, value: f64) -> f64 {
        let along = match self.spacing {
            Spacing::Linear => (value - self.range.0) / (self.range.1 - self.range.0),
            Spacing::Log => (value / self.range.0).ln() / (self.range.1 / self.range.0).ln(),
        };
        let position = self.pixels.0 + along * (self.pixels.1 - self.pixels.0);
        position.clamp(-1e4, 1e4)
    }

    /// Whether `value` has a position: finite, and positive on a logarithmic axis.
    pub fn shows(&self, value: f64) -> bool {
        value.is_finite() && (self.spacing == Spacing::Linear || value > 0.0)
    }

    /// About `count` round values on the axis, with their labels.
    pub fn ticks(&self, count: f64) -> Vec<(f64, String)> {
        match self.spacing {
            Spacing::Linear => linear_ticks(self.range, count),
            Spacing::Log => log_ticks(self.range),
        }
    }
}

/// The range of an axis that shows all finite `values`.
///
/// A flat line gets room on both sides; without any value the range is 0 to 1 (log: 0.1 to 1).
pub fn data_range(values: impl Iterator<Item = f64>, spacing: Spacing) -> (f64, f64) {
    let shown = values.filter(|v| v.is_finite() && (spacing == Spacing::Linear || *v > 0.0));
    let (low, high) =
        shown.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    match spacing {
        Spacing::Linear if low > high => (0.0, 1.0),
        Spacing::Log if low > high => (0.1, 1.0),
        Spacing::Linear if high - low <= 1e-9 * high.abs() => {
            let room = if low == 0.0 { 1.0 } else { 0.005 * low.abs() };
            (low - room, high + room)
        }
        Spacing::Log if high <= low * (1.0 + 1e-9) => (low / 2.0, high * 2.0),
        _ => (low, high),
    }
}

/// Adds room beyond the extremes to `range`; a range that begins near zero begins at zero.
pub fn with_room((low, high): (f64, f64), spacing: Spacing) -> (f64, f64) {
    match spacing {
        Spacing::Log => {
            let room = (high / low).powf(0.06);
            (low / room, high * room)
        }
        Spacing::Linear => {
            let room = 0.06 * (high - low);
            let bottom = if low >= 0.0 && low < 0.2 * high { 0.0 } else { low - room };
            (bottom, high + room)
        }
    }
}

/// 1, 2 or 5 times a power of ten, the nearest to `step` by ratio.
fn round_step(step: f64) -> f64 {
    let decade = 10f64.powf(step.log10().floor());
    let multiple = [(2f64.sqrt(), 1.0), (10f64.sqrt(), 2.0), (50f64.sqrt(), 5.0)]
        .into_iter()
        .find(|(up_to, _)| step / decade <= *up_to)
        .map_or(10.0, |(_, multiple)| multiple);
    decade * multiple
}

/// Moves ends of `range` that almost reach a round value onto it: 0 to 99.999 becomes 0 to 100.
pub fn to_round_ends((low, high): (f64, f64)) -> (f64, f64) {
    let span = high - low;
    let step = round_step(span / 10.0);
    let near = |end: f64, round: f64| {
        if (end - round).abs() < 0.005 * span { round } else { end }
    };
    let below = (low / step).floor() * step;
    let above = (high / step).ceil() * step;
    (near(low, below), near(high, above))
}

fn linear_ticks((low, high): (f64, f64), count: f64) -> Vec<(f64, String)> {
    let step = round_step((high - low) / count.max(1.0));
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    let decade = (step.log10() + 1e-9).floor();
    let decimals = usize::try_from(-decade as i64).unwrap_or(0);
    let most = low.abs().max(high.abs());
    let readable = decimals <= 4 && most < 1e6;
    // As many as tell one from the next.
    let digits = (most.log10().floor() - decade).min(15.0) as usize + 1;
    (first..=last)
        .map(|i| {
            let value = i as f64 * step;
            let label =
                if readable { fixed(value, decimals) } else { significant(value, digits.max(3)) };
            (value, label)
        })
        .collect()
}

fn log_ticks((low, high): (f64, f64)) -> Vec<(f64, String)> {
    let decades = (high / low).log10();
    let multiples: &[f64] = if decades < 2.5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
    let exponents = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let within = (low * (1.0 - 1e-9))..=(high * (1.0 + 1e-9));
    exponents
        .flat_map(|exponent| multiples.iter().map(move |m| (*m, exponent)))
        .map(|(m, exponent)| (m * 10f64.powi(exponent), m, exponent))
        .filter(|(value, ..)| within.contains(value))
        .map(|(value, m, exponent)| {
            let label = match exponent {
                -3..=4 => fixed(value, usize::try_from(-exponent).unwrap_or(0)),
                _ if m == 1.0 => power_of_ten(exponent),
                _ => format!("{m}×{}", power_of_ten(exponent)),
            };
            (value, label)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(scale: &Scale, count: f64) -> Vec<String> {
        scale.ticks(count).into_iter().map(|(_, label)| label).collect()
    }

    #[test]
    fn ticks_are_round() {
        let scale = Scale::new((297.93, 300.2), (0.0, 100.0), Spacing::Linear);
        assert_eq!(labels(&scale, 5.0), ["298.0", "298.5", "299.0", "299.5", "300.0"]);
        let signed = Scale::new((-0.2, 0.2), (0.0, 100.0), Spacing::Linear);
        assert_eq!(labels(&signed, 4.0), ["−0.2", "−0.1", "0.0", "0.1", "0.2"]);
        let wide = Scale::new((0.008, 12.0), (0.0, 100.0), Spacing::Log);
        assert_eq!(labels(&wide, 5.0), ["0.01", "0.1", "1", "10"]);
        let narrow = Scale::new((0.09, 2.1), (0.0, 100.0), Spacing::Log);
        assert_eq!(labels(&narrow, 5.0), ["0.1", "0.2", "0.5", "1", "2"]);
    }

    #[test]
    fn ends_move_to_a_close_round_value_only() {
        assert_eq!(to_round_ends((0.0, 99.999)), (0.0, 100.0));
        assert_eq!(to_round_ends((0.001, 97.0)), (0.0, 97.0));
        assert_eq!(to_round_ends((85.0, 100.0)), (85.0, 100.0));
    }

    #[test]
    fn positions_run_with_the_values() {
        let scale = Scale::new((10.0, 20.0), (200.0, 100.0), Spacing::Linear);
        assert_eq!(scale.position(10.0), 200.0);
        assert_eq!(scale.position(15.0), 150.0);
        let log = Scale::new((0.01, 100.0), (0.0, 400.0), Spacing::Log);
        assert!((log.position(1.0) - 200.0).abs() < 1e-9);
    }

    #[test]
    fn ranges_of_odd_data() {
        let linear = |values: &[f64]| data_range(values.iter().copied(), Spacing::Linear);
        assert_eq!(linear(&[]), (0.0, 1.0));
        assert_eq!(linear(&[f64::NAN, f64::INFINITY]), (0.0, 1.0));
        assert_eq!(linear(&[f64::NAN, 2.0, 5.0]), (2.0, 5.0));
        let (low, high) = linear(&[298.0, 298.0]);
        assert!(low < 297.0 && high > 299.0 && high < 300.0);
        assert_eq!(data_range([-1.0, 0.0, 3.0, 30.0].into_iter(), Spacing::Log), (3.0, 30.0));
    }

    #[test]
    fn hardly_varying_data_still_gets_ticks() {
        let range = data_range([1e5, 1e5 * (1.0 + 1e-8)].into_iter(), Spacing::Linear);
        let ticks = Scale::new(range, (0.0, 100.0), Spacing::Linear).ticks(5.0);
        assert!((3..=11).contains(&ticks.len()), "{ticks:?}");
        for range in [(5.0, 5.000_002), (1_000_000.1, 1_000_000.4)] {
            let scale = Scale::new(range, (0.0, 100.0), Spacing::Linear);
            let mut labels = labels(&scale, 5.0);
            let all = labels.len();
            labels.dedup();
            assert!(all >= 3 && labels.len() == all, "{labels:?}");
        }
    }
}
