//! Files that pages have sent: tables to identify from, or to compare.

use hyper::body::Bytes;
use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Largest file \[bytes\]: four minutes of every step.
pub const LARGEST: usize = 64 << 20;
/// Number of files that are kept; a further one replaces the oldest.
const MOST_FILES: usize = 4;

/// The last files, in memory: none is written to a path from a page.
#[derive(Debug, Default)]
pub struct Uploads(Mutex<Kept>);

#[derive(Debug, Default)]
struct Kept {
    next: u64,
    files: VecDeque<(u64, Bytes)>,
}

impl Uploads {
    /// A lock poisoned by a panic is still usable: every change is one call.
    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Keeps a file; returns its number.
    pub fn put(&self, bytes: Bytes) -> u64 {
        let mut kept = self.kept();
        let number = kept.next;
        kept.next += 1;
        kept.files.push_back((number, bytes));
        if kept.files.len() > MOST_FILES {
            kept.files.pop_front();
        }
        number
    }

    /// The file with this number, while it is kept.
    pub fn get(&self, number: u64) -> Option<Bytes> {
        let kept = self.kept();
        kept.files.iter().find(|(known, _)| *known == number).map(|(_, bytes)| bytes.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_four_files_are_kept() {
        let uploads = Uploads::default();
        for number in 0..6 {
            assert_eq!(uploads.put(Bytes::from(number.to_string())), number);
        }
        let kept: Vec<u64> = (0..9).filter(|number| uploads.get(*number).is_some()).collect();
        assert_eq!(kept, [2, 3, 4, 5]);
        assert_eq!(uploads.get(3).unwrap(), "3");
    }
}
