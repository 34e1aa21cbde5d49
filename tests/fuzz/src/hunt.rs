//! Generates thousands of cases, tries them, and shortens those that violate a property.

use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind, set_hook};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::{cell::RefCell, fs, io, thread};

const MOST_BYTES: u32 = 600;
/// Number of attempts to shorten a case.
const SHORTENINGS: u32 = 20_000;

/// Code under test.
#[derive(Debug, Clone, Copy)]
pub struct Target {
    /// Name, also of its folder in `corpus/`.
    pub name: &'static str,
    /// Unit of its count.
    pub counts: &'static str,
    /// Takes a case and returns its count; panics if a property is violated.
    pub run: fn(&[u8]) -> u64,
}

pub const TARGETS: [Target; 5] = [
    Target { name: "core", counts: "steps of the core", run: crate::core::run },
    Target { name: "frames", counts: "frames", run: crate::frames::run },
    Target { name: "scenarios", counts: "scenarios", run: crate::scenarios::run },
    Target { name: "tables", counts: "tables", run: crate::tables::run },
    Target { name: "hosts", counts: "steps of two hosts", run: crate::hosts::run },
];

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Violation {
    /// Place in the source, one for each kind.
    pub place: String,
    /// The property that does not hold.
    pub what: String,
    /// The case, shortened.
    pub case: Vec<u8>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Hunted {
    pub cases: u64,
    /// Steps, frames, scenarios or tables in the cases.
    pub count: u64,
    /// One violation of each kind.
    pub violations: Vec<Violation>,
}

thread_local! {
    /// Place of this thread's last panic.
    static PLACE: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Catches panics from here on: they are recorded, not printed.
pub fn catch_panics() {
    set_hook(Box::new(|info: &PanicHookInfo| {
        let place = info.location().map(ToString::to_string).unwrap_or_default();
        PLACE.set(place);
    }));
}

impl Target {
    /// Tries one case; returns its count, or the violation.
    pub fn attempt(&self, case: &[u8]) -> Result<u64, Violation> {
        catch_unwind(AssertUnwindSafe(|| (self.run)(case))).map_err(|panic| {
            let message = panic.downcast_ref::<String>().cloned();
            let message = message.or_else(|| panic.downcast_ref::<&str>().map(ToString::to_string));
            let what = message.unwrap_or_default();
            let first = what.lines().next().unwrap_or_default();
            let place = PLACE.take();
            // Violations of one property have one place, whatever numbers they mention.
            let place = if first.starts_with("does not hold") { first.to_owned() } else { place };
            Violation { place, what, case: case.to_vec() }
        })
    }

    /// The cases in `corpus/`, by name.
    pub fn corpus(&self) -> io::Result<Vec<(PathBuf, Vec<u8>)>> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(self.name);
        let mut files = fs::read_dir(folder)?
            .map(|entry| {
                let path = entry?.path();
                let bytes = fs::read(&path)?;
                Ok((path, bytes))
            })
            .collect::<io::Result<Vec<_>>>()?;
        files.sort();
        Ok(files)
    }

    /// Tries cases on all cores until their counts reach `count`; the same `seed` tries the same
    /// cases.
    pub fn hunt(&self, count: u64, seed: u64) -> io::Result<Hunted> {
        let corpus: Vec<Vec<u8>> = self.corpus()?.into_iter().map(|(_, bytes)| bytes).collect();
        let (next, counted) = (AtomicU64::new(0), AtomicU64::new(0));
        let found = Mutex::new(BTreeMap::new());
        let work = || {
            while counted.load(Ordering::Relaxed) < count {
                let number = next.fetch_add(1, Ordering::Relaxed);
                let known = usize::try_from(number).ok().and_then(|number| corpus.get(number));
                let case = known.cloned().unwrap_or_else(|| made(&corpus, seed, number));
                match self.attempt(&case) {
                    Ok(count) => {
                        counted.fetch_add(count, Ordering::Relaxed);
                    }
                    Err(violation) => {
                        counted.fetch_add(1, Ordering::Relaxed);
                        let mut found = found.lock().expect("nothing panics while it is held");
                        found.entry(violation.place.clone()).or_insert(violation);
                    }
                }
            }
        };
        thread::scope(|scope| {
            for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
                scope.spawn(work);
            }
        });
        let found = found.into_inner().expect("nothing panics while it is held");
        Ok(Hunted {
            cases: next.into_inner(),
            count: counted.into_inner(),
            violations: found.into_values().map(|violation| self.shortened(violation)).collect(),
        })
    }

    /// Finds a shorter and simpler case with the same violation.
    fn shortened(&self, violation: Violation) -> Violation {
        let mut best = violation;
        let mut left = SHORTENINGS;
        let mut try_case = |best: &mut Violation, case: Vec<u8>| {
            if left == 0 || case == best.case {
                return false;
            }
            left -= 1;
            match self.attempt(&case) {
                Err(other) if other.place == best.place => {
                    *best = other;
                    true
                }
                _ => false,
            }
        };
        loop {
            let before = best.case.clone();
            let mut size = best.case.len();
            while size > 0 {
                let mut at = 0;
                while at < best.case.len() {
                    let end = (at + size).min(best.case.len());
                    let without = [&best.case[..at], &best.case[end..]].concat();
                    if try_case(&mut best, without) {
                        continue;
                    }
                    let mut zeroed = best.case.clone();
                    zeroed[at..end].fill(0);
                    try_case(&mut best, zeroed);
                    at += size;
                }
                size /= 2;
            }
            if best.case == before {
                return best;
            }
        }
    }
}

/// Case `number`: random bytes, or a case of the corpus changed in a few places.
fn made(corpus: &[Vec<u8>], seed: u64, number: u64) -> Vec<u8> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    // Streams as far apart as chance allows.
    let stream = number.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ random.next_u64();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(stream);
    let mut below = |limit: usize| (random.next_u64() % limit.max(1) as u64) as usize;
    if corpus.is_empty() || below(2) == 0 {
        let length = below(MOST_BYTES as usize);
        return (0..length).map(|_| below(256) as u8).collect();
    }
    let mut case = corpus[below(corpus.len())].clone();
    for _ in 0..=below(6) {
        let at = below(case.len() + 1);
        match below(5) {
            0 => case.insert(at, below(256) as u8),
            1 if at < case.len() => case[at] = below(256) as u8,
            2 if at < case.len() => case[at] ^= 1 << below(8),
            3 => {
                let end = (at + below(16)).min(case.len());
                case.drain(at..end);
            }
            _ => {
                let other = &corpus[below(corpus.len())];
                let from = below(other.len() + 1);
                case.truncate(at);
                case.extend_from_slice(&other[from..]);
            }
        }
    }
    case.truncate(MOST_BYTES as usize);
    case
}
