//! Where along a key an error stays within a limit: "below 0.21 s".

use crate::report::number::short;
use crate::report::scale::Spacing;

/// Where along one key's values an error is within its limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reach {
    /// At every value.
    Everywhere,
    /// At none.
    Nowhere,
    /// Up to this value, interpolated.
    Below(f64),
    /// From this value on, interpolated.
    Above(f64),
    /// At some, with gaps between.
    Some {
        /// At how many.
        reached: usize,
        /// Of how many.
        of: usize,
    },
    /// No value has been run.
    Unknown,
}

impl Reach {
    /// Of errors at rising values; errors that are not finite have not been run.
    pub fn new(values: &[f64], errors: &[f64], limit: f64, spacing: Spacing) -> Self {
        let run: Vec<(f64, f64)> = values
            .iter()
            .zip(errors)
            .filter(|(_, error)| error.is_finite())
            .map(|(value, error)| (*value, *error))
            .collect();
        let within = |point: &(f64, f64)| point.1 <= limit;
        let reached = run.iter().filter(|point| within(point)).count();
        let turns: Vec<usize> =
            (1..run.len()).filter(|i| within(&run[i - 1]) != within(&run[*i])).collect();
        match (&run[..], &turns[..]) {
            ([], _) => Self::Unknown,
            (_, []) if reached == 0 => Self::Nowhere,
            (_, []) => Self::Everywhere,
            (_, [turn]) => {
                let (before, after) = (run[turn - 1], run[*turn]);
                let along = (limit - before.1) / (after.1 - before.1);
                let value = match spacing {
                    Spacing::Linear => before.0 + along * (after.0 - before.0),
                    Spacing::Log => before.0 * (after.0 / before.0).powf(along),
                };
                if within(&before) { Self::Below(value) } else { Self::Above(value) }
            }
            (all, _) => Self::Some { reached, of: all.len() },
        }
    }

    /// For a cell of a table, with the key's unit.
    pub fn text(&self, unit: &str) -> String {
        match self {
            Self::Everywhere => "everywhere".to_owned(),
            Self::Nowhere => "nowhere".to_owned(),
            Self::Below(value) => format!("below {}", with_unit(*value, unit)),
            Self::Above(value) => format!("above {}", with_unit(*value, unit)),
            Self::Some { reached, of } => format!("at {reached} of {of} values"),
            Self::Unknown => "not run".to_owned(),
        }
    }
}

/// What lines along one key have in common, as the end of a sentence: "with a sensor.gas.position
/// below 0.4 to 0.6".
pub fn common(lines: &[Reach], key: &str, unit: &str) -> String {
    let lines: Vec<Reach> = lines.iter().filter(|line| **line != Reach::Unknown).copied().collect();
    let count = |kind: Reach| lines.iter().filter(|line| **line == kind).count();
    let (everywhere, nowhere) = (count(Reach::Everywhere), count(Reach::Nowhere));
    if lines.is_empty() {
        return "not run".to_owned();
    }
    if everywhere == lines.len() {
        return "at every point of the grid".to_owned();
    }
    if nowhere == lines.len() {
        return "nowhere in the grid".to_owned();
    }
    let below = |line: &Reach| if let Reach::Below(value) = line { Some(*value) } else { None };
    let above = |line: &Reach| if let Reach::Above(value) = line { Some(*value) } else { None };
    let rest = lines.len() - everywhere - nowhere;
    let (side, limits): (&str, Vec<f64>) = if lines.iter().filter_map(below).count() == rest {
        ("below", lines.iter().filter_map(below).collect())
    } else {
        ("above", lines.iter().filter_map(above).collect())
    };
    if limits.len() != rest {
        return "at some points only, with gaps between".to_owned();
    }
    let of = |count: usize| {
        if lines.len() > 1 { format!(" in {count} of {} rows", lines.len()) } else { String::new() }
    };
    let mut parts = Vec::new();
    if rest > 0 {
        let low = limits.iter().copied().fold(f64::INFINITY, f64::min);
        let high = limits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let range = if short(low) == short(high) {
            with_unit(low, unit)
        } else {
            format!("{} to {}", short(low), with_unit(high, unit))
        };
        let rows = if rest == lines.len() { String::new() } else { of(rest) };
        parts.push(format!("with {key} {side} {range}{rows}"));
    }
    if everywhere > 0 {
        parts.push(format!("with every {key}{}", of(everywhere)));
    }
    if nowhere > 0 {
        parts.push(format!("with none{}", of(nowhere)));
    }
    parts.join(", ")
}

/// "0.21 s".
pub fn with_unit(value: f64, unit: &str) -> String {
    if unit.is_empty() { short(value) } else { format!("{} {unit}", short(value)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LAGS: [f64; 4] = [0.1, 1.0, 10.0, 100.0];

    fn reach(errors: [f64; 4]) -> Reach {
        Reach::new(&LAGS, &errors, 1.0, Spacing::Log)
    }

    #[test]
    fn the_limit_is_interpolated_where_it_is_crossed_once() {
        let Reach::Below(lag) = reach([0.2, 0.5, 1.5, 3.0]) else { panic!() };
        assert!((lag - 10.0_f64.sqrt()).abs() < 1e-9, "{lag}");
        let Reach::Above(lag) = reach([3.0, 1.5, 0.5, 0.2]) else { panic!() };
        assert!((lag - 10.0_f64.sqrt()).abs() < 1e-9, "{lag}");
        let linear = Reach::new(&[0.0, 2.0], &[0.5, 1.5], 1.0, Spacing::Linear);
        assert_eq!(linear, Reach::Below(1.0));
        assert_eq!(reach([1.0; 4]), Reach::Everywhere);
        assert_eq!(reach([1.1; 4]), Reach::Nowhere);
        assert_eq!(reach([0.5, 2.0, 0.5, 2.0]), Reach::Some { reached: 2, of: 4 });
        assert_eq!(reach([f64::NAN; 4]), Reach::Unknown);
        assert_eq!(reach([f64::NAN, 0.5, f64::NAN, 0.2]), Reach::Everywhere);
    }

    #[test]
    fn lines_are_summed_up_in_words() {
        let sum_up = |lines: &[Reach]| common(lines, "lag", "s");
        let (all, none) = (Reach::Everywhere, Reach::Nowhere);
        let (two, three) = (Reach::Below(2.0), Reach::Below(3.0));
        assert_eq!(sum_up(&[all, all]), "at every point of the grid");
        assert_eq!(sum_up(&[none, none]), "nowhere in the grid");
        assert_eq!(sum_up(&[two]), "with lag below 2 s");
        assert_eq!(sum_up(&[two, three, Reach::Unknown]), "with lag below 2 to 3 s");
        assert_eq!(
            sum_up(&[two, three, all, none]),
            "with lag below 2 to 3 s in 2 of 4 rows, with every lag in 1 of 4 rows, with none in 1 of 4 rows"
        );
        assert_eq!(sum_up(&[all, none]), "with every lag in 1 of 2 rows, with none in 1 of 2 rows");
        assert_eq!(sum_up(&[two, Reach::Above(3.0)]), "at some points only, with gaps between");
    }
}
