//! A part of a grid, so that several machines can share it: `--shard I/N`.

use std::fmt;
use std::str::FromStr;

/// Every N-th point of a grid, the I-th first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// Index from 0.
    index: usize,
    of: usize,
}

impl Shard {
    pub const WHOLE: Self = Self { index: 0, of: 1 };

    /// Whether the shard has this point of the grid, counted from 0. Neighbouring points take about
    /// equally long, so all shards do too.
    pub fn has(self, point: usize) -> bool {
        point % self.of == self.index
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index + 1, self.of)
    }
}

/// A text that is no shard.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("must be I/N, whole numbers with I from 1 to N, such as 2/3")]
pub struct ShardError;

impl FromStr for Shard {
    type Err = ShardError;

    fn from_str(text: &str) -> Result<Self, ShardError> {
        let (index, of) = text.split_once('/').ok_or(ShardError)?;
        match (index.parse::<usize>(), of.parse::<usize>()) {
            (Ok(index), Ok(of)) if (1..=of).contains(&index) => Ok(Self { index: index - 1, of }),
            _ => Err(ShardError),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_divide_the_grid() {
        let shards = ["1/3", "2/3", "3/3"].map(|text| text.parse::<Shard>().unwrap());
        for point in 0..8 {
            assert_eq!(shards.iter().filter(|shard| shard.has(point)).count(), 1);
            assert!(Shard::WHOLE.has(point));
        }
        assert!(shards[1].has(1) && shards[1].has(4));
        for text in ["", "1", "0/3", "4/3", "1/0", "-1/3", "1/3/3", "a/b"] {
            assert_eq!(text.parse::<Shard>(), Err(ShardError), "{text}");
        }
    }
}
