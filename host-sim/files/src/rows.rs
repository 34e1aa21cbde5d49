//! Rows of text on their way to a file: handed over whole and soon, so that whoever is killed leaves
//! what he knew.

use std::io::{self, Write};
use std::time::{Duration, Instant};

/// Rows wait no longer than that.
const LONGEST_WAIT: Duration = Duration::from_millis(500);
/// Bytes that wait for each other: one call of the system for some two hundred rows of a trace.
const MOST_WAITING: usize = 1 << 16;

/// Gathers rows and hands them over. A file behind it never ends within a row, unless the disk is full
/// or the system stops in the middle of a write.
#[derive(Debug)]
pub struct Rows<W: Write> {
    out: W,
    waiting: Vec<u8>,
    handed_over: Instant,
}

impl<W: Write> Rows<W> {
    /// Begins with the names of the columns, and hands them over.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn new(out: W, header: &str) -> io::Result<Self> {
        let waiting = Vec::with_capacity(MOST_WAITING);
        let mut rows = Self { out, waiting, handed_over: Instant::now() };
        rows.push(header)?;
        rows.hand_over()?;
        Ok(rows)
    }

    /// Takes one row, without its line's end.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn push(&mut self, row: &str) -> io::Result<()> {
        if self.waiting.len() + row.len() >= MOST_WAITING {
            self.hand_over()?;
        }
        self.waiting.extend_from_slice(row.as_bytes());
        self.waiting.push(b'\n');
        self.hand_over_in_time()
    }

    /// Hands over what has waited long enough; for those who wait for the next row.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn hand_over_in_time(&mut self) -> io::Result<()> {
        if self.handed_over.elapsed() < LONGEST_WAIT {
            return Ok(());
        }
        self.hand_over()
    }

    /// Hands over everything.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn hand_over(&mut self) -> io::Result<()> {
        self.handed_over = Instant::now();
        let written = self.out.write_all(&self.waiting);
        // Where half of it was written, a second attempt would write that twice.
        self.waiting.clear();
        written?;
        self.out.flush()
    }

    /// Hands over everything, and gives back what it went to.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn finish(mut self) -> io::Result<W> {
        self.hand_over()?;
        Ok(self.out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Keeps every write apart.
    #[derive(Default)]
    struct Writes(Vec<Vec<u8>>);

    impl Write for Writes {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.push(bytes.to_vec());
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn every_write_ends_with_a_row() {
        let mut rows = Rows::new(Writes::default(), "a,b").unwrap();
        assert_eq!(rows.out.0, [b"a,b\n"], "the header is there from the beginning");
        for row in 0..20_000 {
            rows.push(&format!("{row},{}", row * row)).unwrap();
        }
        let writes = rows.finish().unwrap().0;
        assert!((4..20).contains(&writes.len()), "{} writes", writes.len());
        assert!(writes.iter().all(|write| write.ends_with(b"\n")));
        assert_eq!(writes.concat().split(|byte| *byte == b'\n').count(), 20_002);
    }

    #[test]
    fn no_row_waits_for_a_second() {
        let mut rows = Rows::new(Writes::default(), "a").unwrap();
        rows.push("1").unwrap();
        assert_eq!(rows.out.0.len(), 1, "at once would be a call of the system per row");
        std::thread::sleep(LONGEST_WAIT);
        rows.hand_over_in_time().unwrap();
        assert_eq!(rows.out.0[1], b"1\n");
        std::thread::sleep(LONGEST_WAIT);
        rows.push("2").unwrap();
        assert_eq!(rows.out.0[2], b"2\n");
    }
}
