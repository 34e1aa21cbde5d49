//! Several hosts on one board: whose silence makes it vent, and which orders a stop overtakes.
//!
//! - The host whose order was carried out last is obeyed: its set point holds as long as this host is heard. A refused
//!   order changes nothing, and neither does any other request.
//! - A line has one host at a time. A new host asks for the version first: the host before it is then gone, and is no
//!   longer heard, whatever the new one asks.
//! - A stop overtakes every order that was sent before it, on any line. Bytes wait in the receiver and in the host
//!   before the board reads them, so bytes from another line count as older until that line has been silent for a whole
//!   step, [`SETTLING_STEPS`] after the stop or later. Bytes that follow on the stop's own line are newer, unless that
//!   line is itself behind another line's stop.
//!
//! Orders are [`HostCommand::Arm`](super::HostCommand::Arm), [`Start`](super::HostCommand::Start) and
//! [`Set`](super::HostCommand::Set) of anything but venting: requests that may move a muscle.
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

/// Steps after a stop for which no other line counts as silent: the step that carries the stop out, and a whole one.
pub const SETTLING_STEPS: u8 = 2;

/// The state of all lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arbiter<const LINES: usize> {
    lines: [Line; LINES],
    obeyed: Option<usize>,
    /// Stops so far, wrapping.
    stops: u32,
    /// Whether a stop has come that is not carried out yet.
    stopping: bool,
    settling_steps: u8,
}

/// State of one line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Line {
    /// Whether a request has come since the last step.
    heard: bool,
    /// Stops that precede the bytes now read from it.
    stops: u32,
    /// Whether nothing waited to be read when a step last asked.
    silent: bool,
}

/// Line of an order, and the stops that precede it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ticket {
    line: usize,
    stops: u32,
}

/// Link inputs of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Turn {
    /// Whether the obeyed host has sent a request since the last step.
    pub heard: bool,
    /// Whether a stop has come since the last step.
    pub stop: bool,
    /// Whether [`Arbiter::silent`] must be called for each line that has nothing to read.
    pub ask: bool,
}

impl<const LINES: usize> Arbiter<LINES> {
    /// Creates the state before the first request: no host is obeyed.
    pub const fn new() -> Self {
        let line = Line { heard: false, stops: 0, silent: false };
        Self { lines: [line; LINES], obeyed: None, stops: 0, stopping: false, settling_steps: 0 }
    }

    /// Records that bytes are read from a line.
    pub fn read(&mut self, line: usize) {
        if let Some(line) = self.lines.get_mut(line) {
            line.silent = false;
        }
    }

    /// Returns the ticket of a frame that begins with bytes now read from a line.
    pub fn begin(&self, line: usize) -> Ticket {
        // A line that does not exist is behind every stop.
        let older = self.stops.wrapping_sub(1);
        Ticket { line, stops: self.lines.get(line).map_or(older, |line| line.stops) }
    }

    /// Records that a request has come on a line.
    pub fn hear(&mut self, line: usize) {
        if let Some(line) = self.lines.get_mut(line) {
            line.heard = true;
        }
    }

    /// Records that a host has connected on a line: it asks for the version.
    pub fn greet(&mut self, line: usize) {
        if self.obeyed == Some(line) {
            self.obeyed = None;
        }
    }

    /// Records that a stop has come on a line.
    pub fn stop(&mut self, line: usize) {
        let before = self.stops;
        self.stops = before.wrapping_add(1);
        self.stopping = true;
        self.settling_steps = SETTLING_STEPS;
        for line in &mut self.lines {
            line.silent = false;
        }
        // Behind another line's stop the line stays there: the bytes that follow may be older than that stop.
        if let Some(line) = self.lines.get_mut(line)
            && line.stops == before
        {
            line.stops = self.stops;
        }
    }

    /// Records that a line has nothing to read, at the request of a step.
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

    /// Records that an order was carried out: its host is obeyed.
    pub fn obey(&mut self, order: Ticket) {
        self.obeyed = Some(order.line);
        // The step that has seen the request may have obeyed another host.
        self.hear(order.line);
    }

    /// Whether a stop has come since the last step; cleared by the call. An order that follows the stop on its line is
    /// carried out after it.
    pub fn take_stop(&mut self) -> bool {
        core::mem::take(&mut self.stopping)
    }

    /// Whether the host of a line is obeyed.
    pub fn obeys(&self, line: usize) -> bool {
        self.obeyed == Some(line)
    }

    /// Returns the link inputs of a step; called before each step.
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
            // Whatever the other host requests, including refused orders.
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
