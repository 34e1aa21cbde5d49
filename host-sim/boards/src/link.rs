//! The host's end of the wire, over any transport: bytes in, bytes out.

use model_core::Telemetry;
use model_core::link::{Answer, Decoder, HostCommand, Message, Reply, Request, Status, encode};
use std::collections::VecDeque;

/// What has come and what has been asked.
#[derive(Debug, Default)]
pub struct Link {
    decoder: Decoder,
    sequence: u8,
    replies: VecDeque<Reply>,
    telemetry: VecDeque<Telemetry>,
    status: Option<Status>,
    /// Request after whose answer the steps count anew.
    start: Option<u8>,
}

impl Link {
    /// The bytes of a request and its sequence number.
    pub fn request(&mut self, command: HostCommand) -> (u8, Vec<u8>) {
        self.sequence = self.sequence.wrapping_add(1);
        // A reply of 256 requests ago that nobody took is not this one's.
        let sequence = self.sequence;
        self.replies.retain(|reply| reply.sequence != sequence);
        if matches!(command, HostCommand::Start(_) | HostCommand::Configure(_)) {
            self.start = Some(self.sequence);
        }
        let request = Request { sequence: self.sequence, command };
        let frame = encode(&request).map(|frame| frame.to_vec()).unwrap_or_default();
        (self.sequence, frame)
    }

    /// Takes bytes from the board.
    pub fn feed(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            match self.decoder.push(byte) {
                Some(Message::Telemetry(telemetry)) => self.telemetry.push_back(telemetry),
                Some(Message::Reply(reply)) => {
                    // Once: its number comes again after 256 requests.
                    if self.start.take_if(|start| *start == reply.sequence).is_some() {
                        // What came before is the old core's.
                        self.telemetry.clear();
                    }
                    self.replies.push_back(reply);
                }
                Some(Message::Status(status)) => self.status = Some(status),
                None => (),
            }
        }
    }

    /// What the board has said last of what changes rarely.
    pub fn status(&self) -> Option<Status> {
        self.status
    }

    /// Whether telemetry has come that nobody has taken.
    pub fn is_behind(&self) -> bool {
        !self.telemetry.is_empty()
    }

    /// The next telemetry.
    pub fn take_telemetry(&mut self) -> Option<Telemetry> {
        self.telemetry.pop_front()
    }

    /// The answer to a request, if it has come. Older answers are dropped.
    pub fn take_answer(&mut self, sequence: u8) -> Option<Answer> {
        let position = self.replies.iter().position(|reply| reply.sequence == sequence)?;
        self.replies.drain(..=position).next_back().map(|reply| reply.answer)
    }

    /// Frames that were damaged.
    pub fn malformed(&self) -> u32 {
        self.decoder.malformed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::{AdcCode, Config, Core, Sample, SetPoint};

    /// Sequence numbers wrap: the answer to another request of the same number is no start.
    #[test]
    fn only_the_answer_to_a_start_forgets_what_came_before() {
        let sample = Sample::new(AdcCode(7770), AdcCode(15_950), AdcCode(23_757));
        let telemetry = Core::new(&Config::default()).unwrap().step(&sample);
        let telemetry = encode(&Message::Telemetry(telemetry)).unwrap();
        let mut link = Link::default();
        link.request(HostCommand::Start(SetPoint::Vent));
        for request in 0..600_u32 {
            link.feed(&telemetry);
            let sequence = link.sequence;
            let done = Message::Reply(Reply { sequence, answer: Answer::Done { step: 0 } });
            link.feed(&encode(&done).unwrap());
            assert_eq!(link.take_telemetry().is_none(), request == 0, "request {request}");
            link.request(HostCommand::Alive);
        }
    }
}
