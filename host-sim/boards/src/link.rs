//! The host's end of the protocol, over any transport: bytes in, bytes out.

use model_core::Telemetry;
use model_core::joint::JointTelemetry;
use std::collections::VecDeque;
use thermyo_protocol::{Answer, Decoder, HostCommand, Message, Reply, Request, Status, encode};

/// Received frames and the state of requests.
#[derive(Debug, Default)]
pub struct Link {
    decoder: Decoder,
    sequence: u8,
    replies: VecDeque<Reply>,
    telemetry: VecDeque<Telemetry>,
    joint_telemetry: VecDeque<JointTelemetry>,
    status: Option<Status>,
    /// Request after whose answer the step count starts again.
    start: Option<u8>,
}

impl Link {
    /// The bytes of a request and its sequence number.
    pub fn request(&mut self, command: HostCommand) -> (u8, Vec<u8>) {
        self.sequence = self.sequence.wrapping_add(1);
        // Sequence numbers repeat after 256 requests: an old answer must not be taken for the new
        // one.
        let sequence = self.sequence;
        self.replies.retain(|reply| reply.sequence != sequence);
        let starts = matches!(
            command,
            HostCommand::Start(_)
                | HostCommand::Configure(_)
                | HostCommand::StartJoint(_)
                | HostCommand::ConfigureJoint(_)
        );
        if starts {
            self.start = Some(self.sequence);
        }
        let request = Request { sequence: self.sequence, command };
        let frame = encode(&request).map(|frame| frame.to_vec()).unwrap_or_default();
        (self.sequence, frame)
    }

    pub fn feed(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            match self.decoder.push(byte) {
                Some(Message::Telemetry(telemetry)) => self.telemetry.push_back(telemetry),
                Some(Message::Reply(reply)) => {
                    // Taken once, since the number repeats after 256 requests.
                    if self.start.take_if(|start| *start == reply.sequence).is_some() {
                        // Earlier telemetry is from the old core.
                        self.telemetry.clear();
                        self.joint_telemetry.clear();
                    }
                    self.replies.push_back(reply);
                }
                Some(Message::JointTelemetry(telemetry)) => {
                    self.joint_telemetry.push_back(telemetry);
                }
                Some(Message::Status(status)) => self.status = Some(status),
                None => (),
            }
        }
    }

    /// Latest status that the board sent.
    pub fn status(&self) -> Option<Status> {
        self.status
    }

    /// Whether unread telemetry has arrived.
    pub fn is_behind(&self) -> bool {
        !self.telemetry.is_empty() || !self.joint_telemetry.is_empty()
    }

    pub fn take_telemetry(&mut self) -> Option<Telemetry> {
        self.telemetry.pop_front()
    }

    pub fn take_joint_telemetry(&mut self) -> Option<JointTelemetry> {
        self.joint_telemetry.pop_front()
    }

    /// The answer to a request, if it has arrived. Older answers are dropped.
    pub fn take_answer(&mut self, sequence: u8) -> Option<Answer> {
        let position = self.replies.iter().position(|reply| reply.sequence == sequence)?;
        self.replies.drain(..=position).next_back().map(|reply| reply.answer)
    }

    pub fn malformed(&self) -> u32 {
        self.decoder.malformed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::{AdcCode, Config, Core, Sample, SetPoint};

    /// Sequence numbers wrap: a later answer with the same number is not the start's.
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
