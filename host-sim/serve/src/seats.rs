//! Decides which page steers: the page that has been open longest, or took over last. The others watch.

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
            number = taken.iter().max().map_or(0, |last| last + 1);
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

    /// Makes a page the steering one.
    pub fn take_over(&self, number: u64) {
        self.taken.send_modify(|taken| {
            taken.retain(|other| *other != number);
            taken.insert(0, number);
        });
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
        seats.take_over(fourth);
        assert!(seats.steers(fourth) && !seats.steers(third));
        let fifth = seats.take();
        assert!(![third, fourth].contains(&fifth), "every page has a number of its own");
        assert!(seats.leave(fourth) && seats.steers(third));
    }
}
