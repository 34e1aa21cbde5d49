//! Decides which page steers: the one that has been open longest. The others watch.

use tokio::sync::watch;

/// The open pages, the steering one first.
#[derive(Debug)]
pub struct Seats {
    taken: watch::Sender<Vec<u64>>,
}

impl Default for Seats {
    fn default() -> Self {
        Self { taken: watch::Sender::new(Vec::new()) }
    }
}

impl Seats {
    /// Adds a page; returns its number.
    pub fn take(&self) -> u64 {
        let mut number = 0;
        self.taken.send_modify(|taken| {
            number = taken.last().map_or(0, |last| last + 1);
            taken.push(number);
        });
        number
    }

    /// Removes a page; returns whether it was the steering one.
    pub fn leave(&self, number: u64) -> bool {
        let mut steered = false;
        self.taken.send_modify(|taken| {
            steered = taken.first() == Some(&number);
            taken.retain(|other| *other != number);
        });
        steered
    }

    pub fn steers(&self, number: u64) -> bool {
        self.taken.borrow().first() == Some(&number)
    }

    pub fn changes(&self) -> watch::Receiver<Vec<u64>> {
        self.taken.subscribe()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_steers_until_it_leaves() {
        let seats = Seats::default();
        let [first, second, third] = [(); 3].map(|()| seats.take());
        assert!(seats.steers(first) && !seats.steers(second));
        assert!(!seats.leave(second));
        assert!(seats.leave(first) && seats.steers(third));
        let fourth = seats.take();
        assert!(fourth != third && !seats.steers(fourth));
    }
}
