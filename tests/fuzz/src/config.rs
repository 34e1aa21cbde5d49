//! Configurations over the whole range that `Config::check` allows.

use crate::any::{self, Choices, byte};
use arbitrary::Unstructured;
use model_core::Config;
use model_core::ConfigError;
use model_core::config::Load;
use model_core::physics::chamber::table::{MOST_ROWS, Row};
use model_core::physics::chamber::{ChamberConfig, Cylinder, Table, Vessel};
use model_core::physics::valve::{Spool, ValveKind};
use model_core::sensing::Sensors;
use model_core::sensing::gas::GasElement;
use model_core::sensing::pressure::{Mpr, PressurePart};
use std::sync::OnceLock;
use thermyo_protocol::MAX_FRAME;
use thermyo_scenario::{GasElementKind, PressureKind};

/// A kind of chamber, load, gas and pressure sensor, with the number of each field.
struct Kind {
    base: Config,
    /// The variants of its enums, in serde's order.
    variants: Vec<u32>,
    numbers: Vec<f32>,
    /// Name of each number.
    names: Vec<&'static str>,
}

/// Distance from a usual configuration.
#[derive(Clone, Copy, PartialEq)]
enum Spread {
    Usual,
    /// Only these numbers are anywhere in their range.
    Some([usize; 3]),
    /// Every number is within a factor of two.
    Near,
    /// A quarter of the numbers are anywhere in their range.
    Quarter,
    /// Every number is anywhere in its range.
    All,
}

/// Makes a configuration; without bytes the default one.
pub fn from_bytes(bytes: &mut Unstructured) -> Config {
    let kinds = kinds();
    let kind = any::one_of(bytes, kinds);
    let spread = match byte(bytes) % 8 {
        0 => Spread::Usual,
        1..=3 => Spread::Some([(); 3].map(|()| bytes.one_of(kind.names.len() as u32) as usize)),
        4 => Spread::Near,
        5 | 6 => Spread::Quarter,
        _ => Spread::All,
    };
    if spread == Spread::Usual {
        return kind.base;
    }
    let drawn = filled(kind, |slot, error| {
        let usual = kind.numbers[slot];
        let drawn = match spread {
            Spread::Usual => usual,
            Spread::Some(slots) if !slots.contains(&slot) => usual,
            Spread::Quarter if byte(bytes) % 4 != 3 => usual,
            Spread::Near => usual * 2.0_f32.powf(share(bytes) * 2.0 - 1.0),
            Spread::Some(_) | Spread::Quarter | Spread::All => anywhere(bytes, usual, error),
        };
        drawn.clamp(error.minimum, error.maximum)
    });
    drawn.unwrap_or(kind.base)
}

/// A fraction of 1, in 2^16 parts.
pub fn share(bytes: &mut Unstructured) -> f32 {
    bytes.whole(16) as f32 / 65_535.0
}

fn anywhere(bytes: &mut Unstructured, usual: f32, allowed: &ConfigError) -> f32 {
    let ConfigError { minimum, maximum, .. } = *allowed;
    match byte(bytes) % 7 {
        0 => usual,
        1 => minimum,
        2 => maximum,
        3 => minimum + (maximum - minimum) * share(bytes),
        // As often between 1e-7 and 1e-6 as between 0.1 and 1.
        _ => {
            let least = minimum.max(maximum * 1.0e-12);
            least * (maximum / least).powf(share(bytes))
        }
    }
}

/// The configuration with the numbers that `number` returns, called in the order of their checks;
/// none if the rows of a table leave no room for the next one.
fn filled(kind: &Kind, mut number: impl FnMut(usize, &ConfigError) -> f32) -> Option<Config> {
    let mut numbers = vec![f32::NAN; kind.numbers.len()];
    loop {
        let config = config_of(&kind.variants, &numbers);
        let Err(error) = config.check() else { return Some(config) };
        if error.minimum > error.maximum {
            return None;
        }
        // The rows of a table have the same names, and are checked in turn.
        let mut slots = kind.names.iter().zip(&numbers);
        let slot = slots.position(|(name, number)| *name == error.field && number.is_nan());
        let slot = slot.unwrap_or_else(|| panic!("{error}: of no number, or was to be allowed"));
        numbers[slot] = number(slot, &error);
    }
}

/// Names and values that differ from a usual configuration.
pub fn differences(config: &Config) -> String {
    let variants = variants(config);
    let kinds = kinds();
    let kind = kinds.iter().find(|kind| kind.variants == variants).expect("all kinds are there");
    let differing = numbers(config).into_iter().enumerate().filter_map(|(slot, number)| {
        let usual = kind.numbers[slot];
        (number != usual).then(|| format!("{} = {number:e}, not {usual:e}", kind.names[slot]))
    });
    let differing: Vec<String> = differing.collect();
    let names = [
        &["muscle", "vessel", "cylinder", "table"][..],
        &["isotonic", "isometric"][..],
        &["switching", "proportional"][..],
        GasElementKind::WORDS,
        PressureKind::WORDS,
    ];
    let named: Vec<&str> = names.iter().zip(&variants).map(|(n, i)| n[*i as usize]).collect();
    format!("{}: {}", named.join(", "), differing.join("; "))
}

fn kinds() -> &'static [Kind] {
    static KINDS: OnceLock<Vec<Kind>> = OnceLock::new();
    KINDS.get_or_init(|| {
        let muscle = Config::default();
        let chamber = ChamberConfig::Vessel(Vessel { section_m2: 0.0314, surface_m2: 0.386 });
        let vessel = Config { chamber, ..muscle };
        let chamber = ChamberConfig::Cylinder(Cylinder::default());
        let cylinder = Config { chamber, load: Load::Isotonic { force_n: -50.0 }, ..muscle };
        let load = Load::Isometric { length_m: 0.28 };
        let held = |free: Config| Config { load, ..free };
        let bellows =
            Config { chamber: bellows(), load: Load::Isotonic { force_n: -40.0 }, ..muscle };
        let bases = [muscle, held(muscle), vessel, held(vessel), cylinder, held(cylinder)];
        // Last, so that the cases of the corpus keep their kinds.
        let valve_kind = ValveKind::Proportional(Spool::default());
        let metered = Config { valve_kind, ..muscle };
        let bases: [&[Config]; 3] = [&bases, &[bellows, held(bellows)], &[metered, held(metered)]];
        let parts = [PressurePart::Ratiometric, PressurePart::Mpr(Mpr::default())];
        let mut kinds = Vec::new();
        for bases in bases {
            for gas_element in GasElement::all() {
                for pressure_part in parts {
                    kinds.extend(bases.iter().map(|base| {
                        let sensors = Sensors { gas_element, pressure_part, ..base.sensors };
                        kind(Config { sensors, ..*base })
                    }));
                }
            }
        }
        kinds
    })
}

/// A table with every row in use, so that each of its numbers is checked.
fn bellows() -> ChamberConfig {
    let mut rows = [Row::default(); MOST_ROWS];
    for (i, row) in rows.iter_mut().enumerate() {
        let way = i as f32 / (MOST_ROWS - 1) as f32;
        *row = Row {
            length_m: 0.08 + 0.05 * way,
            volume_m3: 1.0e-4 + 9.5e-5 * way,
            force_n: 400.0 * way - 80.0,
        };
    }
    ChamberConfig::Table(Table { rows, count: MOST_ROWS as u8, rest_length_m: 0.09 })
}

/// Finds the name of each number, from the refusal of `check`.
fn kind(base: Config) -> Kind {
    let variants = variants(&base);
    let usual = numbers(&base);
    let mut names = vec![""; usual.len()];
    let mut tried = vec![f32::NAN; usual.len()];
    while let Err(error) = config_of(&variants, &tried).check() {
        let mut untried = (0..usual.len()).filter(|slot| tried[*slot].is_nan());
        let slot = untried.find(|slot| {
            let mut other = tried.clone();
            other[*slot] = f32::MAX;
            let changed = config_of(&variants, &other).check();
            changed.is_err_and(|changed| {
                changed.field == error.field && changed.value.to_bits() != error.value.to_bits()
            })
        });
        let slot = slot.unwrap_or_else(|| panic!("{error}: of no number"));
        names[slot] = error.field;
        tried[slot] = usual[slot];
    }
    assert!(names.iter().all(|name| !name.is_empty()), "a number that is not checked: {names:?}");
    Kind { base, variants, numbers: usual, names }
}

/// The numbers of a configuration, in sequence.
struct Numbers<'a> {
    variants: std::slice::Iter<'a, u32>,
    numbers: std::slice::Iter<'a, f32>,
}

impl Choices for Numbers<'_> {
    fn real(&mut self) -> f32 {
        self.numbers.next().copied().unwrap_or_default()
    }

    fn whole(&mut self, _: u32) -> u64 {
        self.real() as u64
    }

    fn one_of(&mut self, _: u32) -> u32 {
        self.variants.next().copied().unwrap_or_default()
    }
}

fn config_of(variants: &[u32], numbers: &[f32]) -> Config {
    let mut choices = Numbers { variants: variants.iter(), numbers: numbers.iter() };
    any::value(&mut choices).expect("numbers make a configuration")
}

fn variants(config: &Config) -> Vec<u32> {
    read(config).0
}

fn numbers(config: &Config) -> Vec<f32> {
    read(config).1
}

/// The variants and the numbers of `config`, from its bytes on the wire.
fn read(config: &Config) -> (Vec<u32>, Vec<f32>) {
    let mut buffer = [0; MAX_FRAME];
    let bytes = postcard::to_slice(config, &mut buffer).expect("it fits a frame");
    let mut read = Read { bytes, variants: Vec::new(), numbers: Vec::new() };
    any::value::<Config>(&mut read).expect("it is one");
    (read.variants, read.numbers)
}

struct Read<'a> {
    bytes: &'a [u8],
    variants: Vec<u32>,
    numbers: Vec<f32>,
}

impl Read<'_> {
    fn next<T: for<'de> serde::Deserialize<'de>>(&mut self) -> T {
        let (value, rest) = postcard::take_from_bytes(self.bytes).expect("it was sent");
        self.bytes = rest;
        value
    }
}

impl Choices for Read<'_> {
    fn real(&mut self) -> f32 {
        let number = self.next();
        self.numbers.push(number);
        number
    }

    fn whole(&mut self, _: u32) -> u64 {
        let number = self.next();
        self.numbers.push(number as f32);
        number
    }

    fn one_of(&mut self, _: u32) -> u32 {
        let variant = self.next();
        self.variants.push(variant);
        variant
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::{Rng, SeedableRng};

    #[test]
    fn no_bytes_are_the_default() {
        assert_eq!(from_bytes(&mut Unstructured::new(&[])), Config::default());
        assert_eq!(
            differences(&Config::default()),
            "muscle, isotonic, switching, pt1000, ratiometric: "
        );
    }

    /// In the scenario the rows are in a file.
    fn is_of_a_row(name: &str) -> bool {
        ["table.rows", "table.length_m", "table.volume_m3", "table.force_n"].contains(&name)
    }

    /// A user can look up every number that the core refuses.
    #[test]
    fn every_number_is_named_by_a_key_of_the_scenario() {
        for name in kinds().iter().flat_map(|kind| &kind.names) {
            let key = name.split(' ').next().unwrap_or_default();
            let known = thermyo_scenario::schema::key(key).is_some();
            assert!(known || *name == "vessel.section_m2" || is_of_a_row(name), "{name}");
        }
    }

    #[test]
    fn every_number_reaches_both_ends_of_its_range() {
        let kinds = kinds();
        let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
        let nothing = [f32::INFINITY, f32::NEG_INFINITY];
        let mut seen: Vec<_> = kinds.iter().map(|kind| vec![nothing; kind.names.len()]).collect();
        for _ in 0..150_000 {
            let mut bytes = [0; 512];
            random.fill_bytes(&mut bytes);
            let config = from_bytes(&mut Unstructured::new(&bytes));
            config.check().unwrap();
            let kind = kinds.iter().position(|kind| kind.variants == variants(&config)).unwrap();
            for (seen, number) in seen[kind].iter_mut().zip(numbers(&config)) {
                *seen = [seen[0].min(number), seen[1].max(number)];
            }
        }
        for (kind, seen) in kinds.iter().zip(seen) {
            for (slot, name) in kind.names.iter().enumerate() {
                // Numbers whose range another number sets.
                if [
                    "muscle.rest_length_m",
                    "muscle.slack_m",
                    "valve.switch_time_s",
                    "controller.minimum_pulse_s",
                    "sensor.gas.range_max_k",
                    "sensor.max31865.highest_k",
                ]
                .contains(name)
                    || is_of_a_row(name)
                {
                    continue;
                }
                let mut numbers = kind.numbers.clone();
                numbers[slot] = f32::MAX;
                let allowed = config_of(&kind.variants, &numbers).check().unwrap_err();
                assert_eq!(seen[slot], [allowed.minimum, allowed.maximum], "{name}");
            }
        }
    }
}
