//! Range of a key in which an error stays within a limit: "below 0.21 s".

use thermyo_files::number::short;
use thermyo_report::scale::Spacing;

/// Largest number of lines that are named by their values.
const MOST_NAMED: usize = 3;

/// Range of one key in which an error is within its limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reach {
    Everywhere,
    Nowhere,
    /// Up to this value, interpolated.
    Below(f64),
    /// From this value on, interpolated.
    Above(f64),
    /// At some values, with gaps between.
    Some {
        reached: usize,
        of: usize,
    },
    Unknown,
}

impl Reach {
    /// Finds the range. `errors` belong to rising `values`; an error that is not finite stands for
    /// a missing run.
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

    /// Text for a cell of a table, with the key's unit.
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

/// Lines along one key, distinguished by another.
#[derive(Debug, Clone, PartialEq)]
pub struct Lines<'a> {
    /// The key along which the lines run, and its unit.
    pub key: (&'a str, &'a str),
    pub reaches: Vec<Reach>,
    /// The other key, and its value on each line; none if several others change.
    pub other: Option<(&'a str, Vec<f64>)>,
}

impl Lines<'_> {
    /// Summary of all lines as the end of a sentence: "with lag below 0.4 to 0.6 s".
    pub fn text(&self) -> String {
        let (key, unit) = self.key;
        let known = self.chosen(|reach| *reach != Reach::Unknown);
        let everywhere = self.chosen(|reach| *reach == Reach::Everywhere);
        let nowhere = self.chosen(|reach| *reach == Reach::Nowhere);
        if known.is_empty() {
            return "not run".to_owned();
        }
        if everywhere.len() == known.len() {
            return "at every point".to_owned();
        }
        if nowhere.len() == known.len() {
            return "nowhere".to_owned();
        }
        let below = self.chosen(|reach| matches!(reach, Reach::Below(_)));
        let above = self.chosen(|reach| matches!(reach, Reach::Above(_)));
        let gaps = self.chosen(|reach| matches!(reach, Reach::Some { .. }));
        let parts = [
            (everywhere, format!("with every {key}")),
            (below.clone(), format!("with {key} below {}", self.limits(&below, unit))),
            (above.clone(), format!("with {key} above {}", self.limits(&above, unit))),
            (gaps, format!("with some {key}")),
            (nowhere, "nowhere".to_owned()),
        ];
        let parts = parts.iter().filter(|(lines, _)| !lines.is_empty()).map(|(lines, what)| {
            let place = if lines.len() == known.len() {
                String::new()
            } else {
                self.place(lines, known.len())
            };
            format!("{what}{place}")
        });
        parts.collect::<Vec<_>>().join(", ")
    }

    fn chosen(&self, chosen: impl Fn(&Reach) -> bool) -> Vec<usize> {
        (0..self.reaches.len()).filter(|i| chosen(&self.reaches[*i])).collect()
    }

    /// "0.37 to 2.9 s".
    fn limits(&self, lines: &[usize], unit: &str) -> String {
        let limits = lines.iter().filter_map(|i| match self.reaches[*i] {
            Reach::Below(value) | Reach::Above(value) => Some(value),
            _ => None,
        });
        let low = limits.clone().fold(f64::INFINITY, f64::min);
        let high = limits.fold(f64::NEG_INFINITY, f64::max);
        if short(low) == short(high) {
            with_unit(low, unit)
        } else {
            format!("{} to {}", short(low), with_unit(high, unit))
        }
    }

    /// " at position 0.1 and 0.9"; `of` is the number of lines that have been run.
    fn place(&self, lines: &[usize], of: usize) -> String {
        match &self.other {
            Some((name, values)) if lines.len() <= MOST_NAMED => {
                let values: Vec<String> = lines.iter().map(|i| short(values[*i])).collect();
                match values.split_last() {
                    Some((last, before)) if !before.is_empty() => {
                        format!(" at {name} {} and {last}", before.join(", "))
                    }
                    _ => format!(" at {name} {}", values.concat()),
                }
            }
            Some((name, _)) => format!(" at {} of {of} values of {name}", lines.len()),
            None => format!(" in {} of {of} combinations", lines.len()),
        }
    }
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
        let sum_up = |reaches: &[Reach]| {
            let places = (1..=reaches.len()).map(|i| i as f64).collect();
            let other = Some(("place", places));
            Lines { key: ("lag", "s"), reaches: reaches.to_vec(), other }.text()
        };
        let (all, none) = (Reach::Everywhere, Reach::Nowhere);
        let (two, three) = (Reach::Below(2.0), Reach::Below(3.0));
        assert_eq!(sum_up(&[all, all]), "at every point");
        assert_eq!(sum_up(&[none, none]), "nowhere");
        assert_eq!(sum_up(&[Reach::Unknown]), "not run");
        assert_eq!(sum_up(&[two]), "with lag below 2 s");
        assert_eq!(sum_up(&[two, three, Reach::Unknown]), "with lag below 2 to 3 s");
        assert_eq!(
            sum_up(&[two, three, all, none]),
            "with every lag at place 3, with lag below 2 to 3 s at place 1 and 2, nowhere at place 4"
        );
        assert_eq!(
            sum_up(&[all, all, all, none, none, none, none]),
            "with every lag at place 1, 2 and 3, nowhere at 4 of 7 values of place"
        );
        let combined =
            Lines { key: ("lag", "s"), reaches: vec![Reach::Above(3.0), none], other: None };
        assert_eq!(
            combined.text(),
            "with lag above 3 s in 1 of 2 combinations, nowhere in 1 of 2 combinations"
        );
    }
}
