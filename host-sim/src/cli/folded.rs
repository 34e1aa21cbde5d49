//! Folds lines that are wider than the terminal.

use std::io::{self, Write};

/// Indentation of the rest of a folded line.
const INDENT: &str = "    ";

/// Writer that folds lines between columns or words; words are not broken.
#[derive(Debug)]
pub(super) struct Folded<W> {
    inner: W,
    width: usize,
    /// Bytes after the last line end.
    line: Vec<u8>,
}

impl<W: Write> Folded<W> {
    pub(super) fn new(inner: W, width: usize) -> Self {
        Self { inner, width, line: Vec::new() }
    }
}

impl<W: Write> Write for Folded<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        for part in bytes.split_inclusive(|byte| *byte == b'\n') {
            self.line.extend_from_slice(part);
            if part.ends_with(b"\n") {
                let line = std::mem::take(&mut self.line);
                self.inner
                    .write_all(fold(&String::from_utf8_lossy(&line), self.width).as_bytes())?;
            }
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.write_all(&std::mem::take(&mut self.line))?;
        self.inner.flush()
    }
}

/// Width at which lines are folded. A serial console that does not know its width reports 0.
pub(super) fn columns(terminal: u16) -> Option<usize> {
    const NARROWEST: u16 = 20;
    (terminal >= NARROWEST).then_some(usize::from(terminal))
}

/// Folds a line into lines of at most `width` characters, as far as its words allow.
fn fold(line: &str, width: usize) -> String {
    let (mut folded, mut rest, mut indent) = (String::new(), line, "");
    while let Some(at) = place(rest, width.saturating_sub(indent.len())) {
        folded += indent;
        folded += rest[..at].trim_end();
        folded.push('\n');
        rest = rest[at..].trim_start();
        indent = INDENT;
    }
    folded + indent + rest
}

/// Position of the fold: the last gap between two columns that fits, else between two words.
fn place(text: &str, width: usize) -> Option<usize> {
    let text = text.trim_end();
    let beyond = text.char_indices().nth(width)?.0;
    if text[beyond..].starts_with("  ") {
        return Some(beyond);
    }
    let begin = text.len() - text.trim_start().len();
    let fitting = text.get(begin..beyond).unwrap_or_default();
    // A mark before a sentence does not count as a column.
    let columns = fitting.rfind("  ").filter(|at| 3 * (begin + at) > width);
    let gap = columns.or_else(|| fitting.rfind(' '));
    gap.map(|at| begin + at).or_else(|| text[beyond..].find(' ').map(|at| beyond + at))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_terminal_without_a_width_folds_nothing() {
        assert_eq!([0, 1, 19, 20, 80].map(columns), [None, None, None, Some(20), Some(80)]);
    }

    #[test]
    fn a_mark_before_a_sentence_is_no_column() {
        assert_eq!(fold("ok   two words more\n", 12), "ok   two\n    words\n    more\n");
    }

    #[test]
    fn a_table_is_folded_between_its_columns() {
        let mut folded = Folded::new(Vec::new(), 40);
        write!(folded, "hold, 20 N, cold    error_percent 0.454 (≤ 1)   rip").unwrap();
        write!(folded, "ple_percent 0.000\nshort\nno end").unwrap();
        folded.flush().unwrap();
        let text = String::from_utf8(folded.inner).unwrap();
        assert_eq!(
            text,
            "hold, 20 N, cold\n    error_percent 0.454 (≤ 1)\n    ripple_percent 0.000\nshort\nno end"
        );
        assert_eq!(
            fold("a sentence without columns\n", 12),
            "a sentence\n    without\n    columns\n"
        );
        assert_eq!(
            fold("http://127.0.0.1:1/0123456789 page\n", 12),
            "http://127.0.0.1:1/0123456789\n    page\n"
        );
    }

    proptest! {
        #[test]
        fn no_word_is_lost_and_what_can_fit_fits(
            words in prop::collection::vec("[a-z≤°]{1,9}", 0..30),
            gaps in prop::collection::vec(1_usize..4, 30),
            width in 0_usize..60,
        ) {
            let line = words.iter().zip(gaps).fold(String::new(), |line, (word, gap)| {
                line + word + &" ".repeat(gap)
            });
            let folded = fold(&line, width);
            let rejoined: Vec<&str> = folded.split_whitespace().collect();
            prop_assert_eq!(rejoined, words);
            for line in folded.lines().filter(|line| line.trim().contains(' ')) {
                prop_assert!(line.trim_end().chars().count() <= width, "{:?}", line);
            }
        }
    }
}
