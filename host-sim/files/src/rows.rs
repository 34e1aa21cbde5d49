//! Rows of text on their way to a file. They are written whole and soon, so that a killed program
//! loses little.

use std::io::{self, Write};
use std::time::{Duration, Instant};

const LONGEST_WAIT: Duration = Duration::from_millis(500);
/// Bytes to gather: one system call for about 200 rows of a trace.
const MOST_WAITING: usize = 1 << 16;

/// Gathers rows. The file never ends within a row, unless the disk is full or the system stops in
/// the middle of a write.
#[derive(Debug)]
pub struct Rows<W: Write> {
    out: W,
    waiting: Vec<u8>,
    handed_over: Instant,
}

impl<W: Write> Rows<W> {
    /// Gathers rows for `out`, and writes the header at once.
    pub fn new(out: W, header: &str) -> io::Result<Self> {
        let waiting = Vec::with_capacity(MOST_WAITING);
        let mut rows = Self { out, waiting, handed_over: Instant::now() };
        rows.push(header)?;
        rows.hand_over()?;
        Ok(rows)
    }

    /// Takes one row, without its line end.
    pub fn push(&mut self, row: &str) -> io::Result<()> {
        if self.waiting.len() + row.len() >= MOST_WAITING {
            self.hand_over()?;
        }
        self.waiting.extend_from_slice(row.as_bytes());
        self.waiting.push(b'\n');
        self.hand_over_in_time()
    }

    /// Writes rows that have waited long enough; for callers that wait for the next row.
    pub fn hand_over_in_time(&mut self) -> io::Result<()> {
        if self.handed_over.elapsed() < LONGEST_WAIT {
            return Ok(());
        }
        self.hand_over()
    }

    pub fn hand_over(&mut self) -> io::Result<()> {
        self.handed_over = Instant::now();
        let written = self.out.write_all(&self.waiting);
        // If half of the bytes were written, a second attempt would write that half twice.
        self.waiting.clear();
        written?;
        self.out.flush()
    }

    /// Writes everything and returns the writer.
    pub fn finish(mut self) -> io::Result<W> {
        self.hand_over()?;
        Ok(self.out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
