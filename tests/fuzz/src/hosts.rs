//! Two hosts at one arbiter: whatever they send, and however late the board reads it, a stop
//! overtakes earlier orders, and one host does not keep another, silent one alive.

use crate::any::byte;
use arbitrary::Unstructured;
use std::collections::VecDeque;
use thermyo_protocol::arbiter::{Arbiter, SETTLING_STEPS, Ticket};

const LINES: usize = 2;
/// Steps of silence after which the board vents.
const TIMEOUT_STEPS: u64 = 5;
/// Largest number of steps for which the board may not see a frame that was sent.
const MOST_HIDDEN_STEPS: u8 = SETTLING_STEPS;
/// Steps after the last frame of an order's link, and after the other link's last stop, after which
/// the order is carried out if the board reads at once.
const SETTLED_STEPS: u64 = SETTLING_STEPS as u64 + MOST_HIDDEN_STEPS as u64 + 3;
/// Numbers of steps between two events.
const STEPS: [u8; 8] = [1, 1, 1, 2, 3, 5, 8, 40];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Request {
    Alive,
    Stop,
    /// An order that is carried out, unless it was overtaken.
    Order,
    /// An order that is refused in any case.
    Nonsense,
}

#[derive(Debug, Clone, Copy)]
struct Frame {
    request: Request,
    /// Time at which its first byte was sent: number of the event, and of the step.
    sent: u64,
    sent_step: u64,
    hidden_steps: u8,
    /// Whether its last byte was sent too.
    whole: bool,
    /// Step at which the frame before it on its link was sent.
    previous_step: u64,
}

/// A link, its host, and the task that reads it.
#[derive(Default)]
struct Line {
    sent: VecDeque<Frame>,
    /// Ticket of the first of these frames, once its first byte was read.
    begun: Option<Ticket>,
    /// The request to carry out next; meanwhile nothing is read.
    waits: Option<(Frame, Ticket)>,
    asked: bool,
    last_sent_step: u64,
    /// Events at which its last stop was sent and read, and the step of the reading.
    stop: Option<(u64, u64, u64)>,
    /// Step in which its host was last heard.
    heard_step: u64,
}

#[derive(Default)]
struct Hosts {
    arbiter: Arbiter<LINES>,
    lines: [Line; LINES],
    event: u64,
    step: u64,
    /// Link whose order holds, and the steps for which its host has been silent, as counted by the
    /// arbiter.
    driven: Option<(usize, u64)>,
    /// Whether the tasks never wait.
    prompt: bool,
}

/// Runs one life of both hosts; returns its steps.
pub fn run(bytes: &[u8]) -> u64 {
    let mut bytes = Unstructured::new(bytes);
    let mut hosts = Hosts { prompt: byte(&mut bytes).is_multiple_of(2), ..Hosts::default() };
    while !bytes.is_empty() {
        let choice = byte(&mut bytes);
        let line = usize::from(choice & 1);
        match choice >> 1 & 7 {
            0 => hosts.send(line, Request::Stop, choice),
            1 | 2 => hosts.send(line, Request::Order, choice),
            3 => hosts.send(line, Request::Nonsense, choice),
            4 => hosts.send(line, Request::Alive, choice),
            5 => hosts.look(line),
            6 => hosts.carry_out(line),
            _ => {
                for _ in 0..STEPS[usize::from(choice >> 4 & 7)] {
                    hosts.one_step();
                }
            }
        }
    }
    hosts.step
}

impl Hosts {
    /// Lets a host send a frame, or the rest of the frame that it has begun.
    fn send(&mut self, index: usize, request: Request, choice: u8) {
        self.event += 1;
        let line = &mut self.lines[index];
        match line.sent.back_mut() {
            Some(last) if !last.whole => last.whole = true,
            _ => {
                line.sent.push_back(Frame {
                    request,
                    sent: self.event,
                    sent_step: self.step,
                    hidden_steps: (choice >> 4 & 3).min(MOST_HIDDEN_STEPS),
                    whole: choice & 0xc0 != 0xc0,
                    previous_step: line.last_sent_step,
                });
            }
        }
        line.last_sent_step = self.step;
        self.hurry();
    }

    /// Lets the task of a link read the available bytes, up to an order.
    fn look(&mut self, index: usize) {
        self.event += 1;
        let line = &mut self.lines[index];
        if line.waits.is_some() {
            return;
        }
        let to_read = |line: &Line| {
            let first = line.sent.front().copied().filter(|first| first.hidden_steps == 0);
            first.filter(|first| first.whole || line.begun.is_none())
        };
        if to_read(line).is_none() && std::mem::take(&mut line.asked) {
            self.arbiter.silent(index);
        }
        while let Some(frame) = to_read(line) {
            self.arbiter.read(index);
            let ticket = *line.begun.get_or_insert_with(|| self.arbiter.begin(index));
            if !frame.whole {
                continue;
            }
            line.sent.pop_front();
            line.begun = None;
            self.arbiter.hear(index);
            line.heard_step = self.step;
            match frame.request {
                Request::Alive => (),
                Request::Stop => {
                    self.arbiter.stop(index);
                    line.stop = Some((frame.sent, self.event, self.step));
                }
                Request::Order | Request::Nonsense => {
                    line.waits = Some((frame, ticket));
                    return;
                }
            }
        }
    }

    /// Lets control carry out the order that a link waits for.
    fn carry_out(&mut self, index: usize) {
        self.event += 1;
        let Some((order, ticket)) = self.lines[index].waits.take() else { return };
        // Times of the stops before which it must not have been sent.
        let stops = |own: bool| {
            let lines = self.lines.iter().enumerate().filter(move |(i, _)| (*i == index) == own);
            lines.filter_map(|(_, line)| line.stop)
        };
        if self.arbiter.admits(ticket) {
            let overtaken = stops(true).any(|(sent, ..)| order.sent < sent)
                || stops(false).any(|(_, read, _)| order.sent < read);
            self.holds(!overtaken, "a stop overtakes what was sent before it", order);
            if order.request == Request::Order {
                self.arbiter.obey(ticket);
                self.driven = Some((index, 0));
                // The order itself shows that the host is there, however long it has waited.
                self.lines[index].heard_step = self.step;
            }
        } else {
            let stopped_step = stops(false).map(|(.., step)| step).max();
            let settled = stopped_step.is_some_and(|stopped_step| {
                order.sent_step > stopped_step.max(order.previous_step) + SETTLED_STEPS
            });
            let wrongly = stopped_step.is_none() || self.prompt && settled;
            self.holds(!wrongly, "only what may be older than a stop is refused for it", order);
        }
    }

    /// Runs a step of the control task, and the hardware meanwhile.
    fn one_step(&mut self) {
        self.event += 1;
        self.step += 1;
        let turn = self.arbiter.step();
        for line in &mut self.lines {
            line.asked |= turn.ask;
            for frame in &mut line.sent {
                frame.hidden_steps = frame.hidden_steps.saturating_sub(1);
            }
        }
        if turn.stop {
            self.driven = None;
        }
        if let Some((index, silent_steps)) = &mut self.driven {
            *silent_steps = if turn.heard { 0 } else { *silent_steps + 1 };
            let steps = self.step - self.lines[*index].heard_step;
            let (index, silent_steps) = (*index, *silent_steps);
            assert!(
                silent_steps >= TIMEOUT_STEPS || steps <= TIMEOUT_STEPS,
                "does not hold: silence vents\nline {index} drives, silent for {steps} steps"
            );
            assert!(
                silent_steps < TIMEOUT_STEPS || steps >= TIMEOUT_STEPS,
                "does not hold: only silence vents\nline {index}, heard {steps} steps ago"
            );
            if silent_steps >= TIMEOUT_STEPS {
                self.driven = None;
            }
        }
        self.hurry();
    }

    /// Reads and carries out everything at once, if the tasks never wait.
    fn hurry(&mut self) {
        for index in 0..if self.prompt { LINES } else { 0 } {
            self.look(index);
            while self.lines[index].waits.is_some() {
                self.carry_out(index);
                self.look(index);
            }
        }
    }

    #[track_caller]
    fn holds(&self, holds: bool, what: &str, order: Frame) {
        assert!(holds, "does not hold: {what}\nstep {}, {order:?}, {:?}", self.step, self.arbiter);
    }
}
