//! Points of a sweep: the product of all values, or a Latin hypercube.

use super::SweepError;
use super::range::{MOST_POINTS, Range, allowed};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use thermyo_scenario::schema::Allowed;

/// Latin hypercube: each key's range is divided into as many equally probable parts as there are
/// points, with a point in each (McKay, Beckman, Conover, Technometrics 21, 1979).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Latin {
    pub points: usize,
    /// Seed of the generator that pairs the parts of the keys.
    pub seed: u64,
}

/// The points of a sweep.
#[derive(Debug)]
pub struct Plan {
    pub ranges: Vec<Range>,
    pub latin: Option<Latin>,
    /// Values of a hypercube: by key, then by point.
    drawn: Vec<Vec<f64>>,
}

impl Plan {
    pub(super) fn new(ranges: Vec<Range>, latin: Option<Latin>) -> Result<Self, SweepError> {
        if ranges.is_empty() {
            return Err(SweepError::NoKey);
        }
        for (i, range) in ranges.iter().enumerate() {
            if ranges[..i].iter().any(|other| other.key == range.key) {
                return Err(SweepError::Twice(range.to_string(), range.key.clone()));
            }
            let listed = !range.interval && !range.written().contains(':');
            match latin {
                None if range.interval => return Err(SweepError::NoCount(range.to_string())),
                Some(_) if !range.interval && !listed => {
                    return Err(SweepError::Count(range.to_string()));
                }
                _ => (),
            }
        }
        let product = || ranges.iter().try_fold(1, |all: usize, r| all.checked_mul(r.values.len()));
        let points = latin.map_or_else(product, |latin| Some(latin.points));
        if !points.is_some_and(|points| (1..=MOST_POINTS).contains(&points)) {
            return Err(SweepError::TooLarge);
        }
        let drawn = match latin {
            Some(latin) => {
                ranges.iter().enumerate().map(|(i, range)| draw(range, i, latin)).collect()
            }
            None => Vec::new(),
        };
        Ok(Self { ranges, latin, drawn })
    }

    pub fn points(&self) -> usize {
        match self.latin {
            Some(latin) => latin.points,
            None => self.ranges.iter().map(|range| range.values.len()).product(),
        }
    }

    /// Index of a grid's point in each range; the last key changes from point to point.
    pub fn places(&self, mut point: usize) -> Vec<usize> {
        let mut places = vec![0; self.ranges.len()];
        for (place, range) in places.iter_mut().zip(&self.ranges).rev() {
            *place = point % range.values.len();
            point /= range.values.len();
        }
        places
    }

    /// Values of a point, by key.
    pub fn values(&self, point: usize) -> Vec<f64> {
        if self.latin.is_some() {
            return self.drawn.iter().map(|values| values[point]).collect();
        }
        self.ranges.iter().zip(self.places(point)).map(|(range, i)| range.values[i]).collect()
    }

    /// Whether the plan can be drawn as lines or maps: a grid with at most three varying keys, all
    /// of them numbers.
    pub fn is_map(&self) -> bool {
        let mut changing = self.ranges.iter().filter(|range| range.values.len() > 1);
        let numbers = changing.clone().all(|range| range.words.is_empty());
        self.latin.is_none() && numbers && changing.by_ref().count() <= 3
    }
}

fn draw(range: &Range, key: usize, Latin { points, seed }: Latin) -> Vec<f64> {
    let whole = matches!(allowed(&range.key), Some(Allowed::Whole { .. }));
    // A separate stream, so that an additional key does not change the others.
    let mut generator = Xoshiro256PlusPlus::seed_from_u64(seed);
    (0..key).for_each(|_| generator.jump());
    let mut unit = || (generator.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
    let mut parts: Vec<usize> = (0..points).collect();
    // Fisher and Yates.
    for last in (1..points).rev() {
        parts.swap(last, (unit() * (last + 1) as f64) as usize);
    }
    let within = |part: usize| (part as f64 + unit()) / points as f64;
    // A value that was rounded up to 1 belongs to the last part.
    parts
        .into_iter()
        .map(within)
        .map(|along| range.along(along.min(1.0 - f64::EPSILON), whole))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(texts: &[&str], points: usize, seed: u64) -> Plan {
        let ranges = texts.iter().map(|text| text.parse().unwrap()).collect();
        Plan::new(ranges, Some(Latin { points, seed })).unwrap()
    }

    #[test]
    fn every_part_of_every_key_has_one_point() {
        let plan = plan(&["a.b=0:1", "c.d=1:10000:log", "muscle.zones=1:8", "e.f=x,y,z"], 96, 5);
        for (key, part) in [
            (0, &(|value| value * 96.0) as &dyn Fn(f64) -> f64),
            (1, &|value| value.log10() * 24.0),
        ] {
            let mut parts: Vec<usize> =
                (0..96).map(|point| part(plan.values(point)[key]) as usize).collect();
            assert!(parts.windows(2).any(|pair| pair[0] > pair[1]), "nothing was shuffled");
            parts.sort_unstable();
            assert_eq!(parts, (0..96).collect::<Vec<_>>(), "key {key}");
        }
        for (key, values, times) in [(2, 1..9, 12), (3, 0..3, 32)] {
            for value in values {
                let is = |point: &usize| plan.values(*point)[key] == f64::from(value);
                assert_eq!((0..96).filter(is).count(), times, "key {key}, {value}");
            }
        }
    }

    #[test]
    fn a_seed_determines_all_values() {
        let values = |texts: &[&str], seed| {
            let plan = plan(texts, 10, seed);
            (0..10).map(|point| plan.values(point)[0]).collect::<Vec<f64>>()
        };
        assert_eq!(values(&["a.b=0:1"], 1), values(&["a.b=0:1", "c.d=0:1"], 1));
        assert_ne!(values(&["a.b=0:1"], 1), values(&["a.b=0:1"], 2));
        // The value is the same on every machine and in every version.
        assert_eq!(values(&["a.b=0:1"], 1)[0], 0.413_429_378_204);
    }
}
