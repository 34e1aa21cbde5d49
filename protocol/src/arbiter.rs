//! Several hosts at one board: whose silence vents, and which orders a stop overtakes.
//!
//! - The host whose order was carried out last is obeyed: its set point holds as long as this host is heard. An order
//!   that is refused changes nothing, and neither does any other request.
//! - A line has one host at a time. One that connects asks for the version first: the host before it is gone, and is
//!   not heard any more, whatever the new one asks.
//! - A stop overtakes every order that was sent before it, on any line. Bytes wait in the receiver and in the host
//!   before the board reads them, so that what another line brings counts as older until that line has been silent
//!   for a whole step, [`SETTLING_STEPS`] after the stop or later. What the stop's own line brings next is
//!   newer, unless that line is itself behind another one's stop.
//!
//! Orders are [`HostCommand::Arm`](super::HostCommand::Arm), [`Start`](super::HostCommand::Start) and
//! [`Set`](super::HostCommand::Set) of anything but to vent: what a muscle may move by.
//!
//! ```
//! use thermyo_protocol::arbiter::Arbiter;
//!
//! let mut arbiter = Arbiter::<2>::new();
//! let order = arbiter.begin(0);
//! arbiter.stop(1);
//! assert!(!arbiter.admits(order), "it began before the stop");
//! assert!(arbiter.admits(arbiter.begin(1)), "it follows the stop");
//! ```

/// Steps after a stop for which no other line is believed to be silent: the one that carries the stop out, and a
/// whole one.
pub const SETTLING_STEPS: u8 = 2;

/// The state of all lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arbiter<const LINES: usize> {
    lines: [Line; LINES],
    obeyed: Option<usize>,
    /// Stops so far, wrapping.
    stops: u32,
    /// A stop has come that is not carried out yet.
    stopping: bool,
    settling_steps: u8,
}

/// State of a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Line {
    /// A request has come since the last step.
    heard: bool,
    /// Stops that precede what is read from it now.
    stops: u32,
    /// Nothing waited to be read when a step asked last.
    silent: bool,
}

/// When an order began to arrive, and where.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ticket {
    line: usize,
    stops: u32,
}

/// Link inputs of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn {
    /// The host that is obeyed has asked something since the last step.
    pub heard: bool,
    /// A stop has come since the last step.
    pub stop: bool,
    /// [`Arbiter::silent`] is called for each link that has nothing to read.
    pub ask: bool,
}

impl<const LINES: usize> Arbiter<LINES> {
    /// Before the first request: no host is obeyed.
    pub const fn new() -> Self {
        let line = Line { heard: false, stops: 0, silent: false };
        Self { lines: [line; LINES], obeyed: None, stops: 0, stopping: false, settling_steps: 0 }
    }

    /// Bytes are read from a line.
    pub fn read(&mut self, line: usize) {
        if let Some(line) = self.lines.get_mut(line) {
            line.silent = false;
        }
    }

    /// A frame begins with bytes that are read from a line.
    pub fn begin(&self, line: usize) -> Ticket {
        // A line that does not exist is behind every stop.
        let older = self.stops.wrapping_sub(1);
        Ticket { line, stops: self.lines.get(line).map_or(older, |line| line.stops) }
    }

    /// A request has come on a line.
    pub fn hear(&mut self, line: usize) {
        if let Some(line) = self.lines.get_mut(line) {
            line.heard = true;
        }
    }

    /// A host has connected on a line: it asks for the version.
    pub fn greet(&mut self, line: usize) {
        if self.obeyed == Some(line) {
            self.obeyed = None;
        }
    }

    /// A stop has come on a line.
    pub fn stop(&mut self, line: usize) {
        let before = self.stops;
        self.stops = before.wrapping_add(1);
        self.stopping = true;
        self.settling_steps = SETTLING_STEPS;
        for line in &mut self.lines {
            line.silent = false;
        }
        // Behind another line's stop it stays: what follows may be older than that one.
        if let Some(line) = self.lines.get_mut(line)
            && line.stops == before
        {
            line.stops = self.stops;
        }
    }

    /// A line that a step has asked has nothing to read.
    pub fn silent(&mut self, line: usize) {
        if self.settling_steps == 0
            && let Some(line) = self.lines.get_mut(line)
            && core::mem::replace(&mut line.silent, true)
        {
            line.stops = self.stops;
        }
    }

    /// Whether an order may be carried out: no stop has overtaken it.
    pub fn admits(&self, order: Ticket) -> bool {
        order.stops == self.stops
    }

    /// An order was carried out: its host is obeyed.
    pub fn obey(&mut self, order: Ticket) {
        self.obeyed = Some(order.line);
        // The step that has seen the request may have been one that obeyed another host.
        self.hear(order.line);
    }

    /// Whether a stop has come since the last step, once: an order that follows it on its line is carried out after it.
    pub fn take_stop(&mut self) -> bool {
        core::mem::take(&mut self.stopping)
    }

    /// Whether the host of a line is obeyed.
    pub fn obeys(&self, line: usize) -> bool {
        self.obeyed == Some(line)
    }

    /// Before each step.
    pub fn step(&mut self) -> Turn {
        let obeyed = self.obeyed.and_then(|line| self.lines.get(line));
        let heard = obeyed.is_some_and(|line| line.heard);
        for line in &mut self.lines {
            line.heard = false;
        }
        let stop = self.take_stop();
        self.settling_steps = self.settling_steps.saturating_sub(1);
        let behind = self.lines.iter().any(|line| line.stops != self.stops);
        Turn { heard, stop, ask: behind && self.settling_steps == 0 }
    }
}

impl<const LINES: usize> Default for Arbiter<LINES> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_host_whose_order_was_carried_out_is_heard() {
        let mut arbiter = Arbiter::<2>::new();
        arbiter.hear(0);
        assert!(!arbiter.step().heard, "it has ordered nothing");
        arbiter.obey(arbiter.begin(0));
        assert!(arbiter.step().heard, "its order counts");
        assert!(!arbiter.step().heard);
        for _ in 0..3 {
            // Whatever the other one asks, refused orders included.
            arbiter.hear(1);
            assert!(!arbiter.step().heard);
        }
        arbiter.hear(0);
        arbiter.hear(1);
        assert!(arbiter.step().heard);
        arbiter.hear(1);
        assert!(!arbiter.step().heard);
        arbiter.obey(arbiter.begin(1));
        assert!(arbiter.step().heard, "although a step was between its request and its order");
        arbiter.hear(0);
        assert!(!arbiter.step().heard);
    }

    #[test]
    fn a_host_that_connects_does_not_stand_for_the_one_before() {
        let mut arbiter = Arbiter::<2>::new();
        arbiter.obey(arbiter.begin(0));
        arbiter.greet(1);
        arbiter.hear(0);
        assert!(arbiter.step().heard, "the other line has a host of its own");
        arbiter.greet(0);
        arbiter.hear(0);
        assert!(!arbiter.step().heard);
        arbiter.obey(arbiter.begin(0));
        assert!(arbiter.step().heard, "it orders on its own");
    }

    #[test]
    fn a_stop_overtakes_what_was_sent_before_it() {
        let mut arbiter = Arbiter::<2>::new();
        let before = [arbiter.begin(0), arbiter.begin(1)];
        arbiter.stop(1);
        assert!(before.iter().all(|&order| !arbiter.admits(order)));
        assert!(arbiter.admits(arbiter.begin(1)), "it follows the stop on its line");
        assert!(!arbiter.admits(arbiter.begin(0)), "its bytes may have waited");
        let mut followed = arbiter;
        assert!(followed.take_stop(), "before an order that follows it");
        assert!(!followed.step().stop, "and not again after it");
        for turn in [
            Turn { heard: false, stop: true, ask: false },
            Turn { heard: false, stop: false, ask: true },
            Turn { heard: false, stop: false, ask: true },
        ] {
            arbiter.silent(0);
            assert!(!arbiter.admits(arbiter.begin(0)), "or be on their way still");
            assert_eq!(arbiter.step(), turn);
        }
        arbiter.read(0);
        arbiter.silent(0);
        assert!(!arbiter.admits(arbiter.begin(0)), "it was not silent for a whole step");
        arbiter.silent(0);
        let after = arbiter.begin(0);
        assert!(arbiter.admits(after));
        assert!(!arbiter.step().ask, "no line is behind");
        assert!(before.iter().all(|&order| !arbiter.admits(order)), "for ever");
        arbiter.stop(1);
        assert!(!arbiter.admits(after));
        arbiter.stop(0);
        assert!(!arbiter.admits(arbiter.begin(0)), "its stop may be older than that of line 1");
    }
}
