//! The connection of one page.

use super::shared::Shared;
use super::state::Weight;
use super::word::Word;
use futures_util::{SinkExt, StreamExt};
use hyper::upgrade::Upgraded;
use hyper_util::rt::TokioIo;
use serde::Serialize;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::broadcast::error::RecvError;
use tokio::time::{self, MissedTickBehavior};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::{Message, Utf8Bytes};

type WebSocket = WebSocketStream<TokioIo<Upgraded>>;

/// Messages by which a page may lag behind. Beyond that it loses frames; its view is never older
/// than a second.
const WINDOW: u64 = 32;
/// A steering page that leaves messages unconfirmed for this long, and confirms none, counts as gone.
const LONGEST_SILENT: Duration = Duration::from_secs(2);
/// Interval at which the clock is checked.
const LOOK: Duration = Duration::from_millis(100);

/// State of this page alone.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
struct Own {
    kind: &'static str,
    /// Whether this page steers; others only watch.
    steers: bool,
    pages: usize,
    /// Frames dropped because the page was too slow.
    lost_frames: u64,
}

/// Messages sent and confirmed.
#[derive(Debug)]
struct Sent {
    messages: u64,
    seen: u64,
    /// When the page last confirmed messages, or had none to confirm.
    answered: Instant,
}

/// Refusals that a page has already caused: each kind is logged once per page.
#[derive(Debug, Default)]
struct Refused {
    not_understood: bool,
    watches: bool,
}

impl Refused {
    fn once(logged: &mut bool, shared: &Shared, text: &str) {
        if !std::mem::replace(logged, true) {
            shared.log(Weight::Refused, text);
        }
    }
}

impl Sent {
    fn new(now: Instant) -> Self {
        Self { messages: 0, seen: 0, answered: now }
    }

    fn behind(&self) -> bool {
        self.messages.saturating_sub(self.seen) >= WINDOW
    }

    fn send(&mut self, now: Instant) {
        if self.messages == self.seen {
            self.answered = now;
        }
        self.messages += 1;
    }

    /// A page cannot confirm more than was sent.
    fn confirm(&mut self, seen: u64, now: Instant) {
        let seen = seen.min(self.messages);
        if seen > self.seen {
            (self.seen, self.answered) = (seen, now);
        }
    }

    fn is_silent(&self, now: Instant) -> bool {
        self.messages > self.seen && now.duration_since(self.answered) > LONGEST_SILENT
    }
}

/// Serves a page until it closes. The muscle is vented when the steering page closes.
pub async fn run(mut socket: WebSocket, shared: Arc<Shared>) {
    let seat = shared.seats.take();
    let why = attend(&mut socket, &shared, seat).await;
    if shared.seats.leave(seat) && !shared.ended() {
        shared.vent(why);
    }
}

async fn attend(socket: &mut WebSocket, shared: &Shared, seat: u64) -> &'static str {
    const CLOSED: &str = "the page that steered was closed";
    let mut frames = shared.frames.subscribe();
    let mut state = shared.state.subscribe();
    let mut seats = shared.seats.changes();
    state.mark_changed();
    seats.mark_changed();
    let mut ticks = time::interval(LOOK);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut sent = Sent::new(Instant::now());
    let mut refused = Refused::default();
    let mut lost_frames = 0;
    loop {
        let free = !sent.behind();
        let message: Utf8Bytes = tokio::select! {
            biased;
            word = socket.next() => {
                match word {
                    Some(Ok(Message::Text(text))) => {
                        read(text.as_bytes(), shared, seat, &mut refused, &mut sent);
                    }
                    // A program of a lab may send its JSON in this form, including a vent.
                    Some(Ok(Message::Binary(bytes))) => {
                        read(&bytes, shared, seat, &mut refused, &mut sent);
                    }
                    Some(Ok(Message::Close(_)) | Err(_)) | None => return CLOSED,
                    Some(Ok(_)) => (),
                }
                continue;
            }
            _ = ticks.tick() => {
                if shared.seats.steers(seat) && sent.is_silent(Instant::now()) {
                    return "the page that steered does not answer";
                }
                continue;
            }
            Ok(()) = seats.changed(), if free => {
                seats.mark_unchanged();
                own(shared, seat, lost_frames)
            }
            Ok(()) = state.changed(), if free => state.borrow_and_update().clone(),
            frame = frames.recv(), if free => match frame {
                Ok(frame) => frame,
                Err(RecvError::Lagged(missed)) => {
                    lost_frames += missed;
                    own(shared, seat, lost_frames)
                }
                Err(RecvError::Closed) => return CLOSED,
            },
        };
        // This does not wait: the window fits the system's buffers.
        if socket.send(Message::Text(message)).await.is_err() {
            return CLOSED;
        }
        sent.send(Instant::now());
    }
}

fn own(shared: &Shared, seat: u64, lost_frames: u64) -> Utf8Bytes {
    let pages = shared.seats.changes().borrow().len();
    let own = Own { kind: "own", steers: shared.seats.steers(seat), pages, lost_frames };
    serde_json::to_string(&own).expect("plain data").into()
}

fn read(json: &[u8], shared: &Shared, seat: u64, refused: &mut Refused, sent: &mut Sent) {
    match serde_json::from_slice(json) {
        Ok(Word::Seen(seen)) => sent.confirm(seen, Instant::now()),
        Ok(word) => hear(word, shared, seat, refused),
        Err(error) => {
            let text = format!("not understood: {error}; further ones of this page are not listed");
            Refused::once(&mut refused.not_understood, shared, &text);
        }
    }
}

fn hear(word: Word, shared: &Shared, seat: u64, refused: &mut Refused) {
    let order = match word {
        Word::Vent => {
            return shared.vent("Vent was pressed on a page");
        }
        Word::Steer if shared.seats.steers(seat) => return,
        Word::Steer => {
            // The other user may have been watching the muscle: it does not continue by itself.
            shared.vent("another page took over");
            return shared.seats.take_over(seat);
        }
        Word::Order(order) => order,
        Word::Seen(_) => return,
    };
    if !shared.seats.steers(seat) {
        let text = "another page steers; this one watches, and may vent";
        return Refused::once(&mut refused.watches, shared, text);
    }
    shared.orders.put(order);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_counts_as_gone_two_seconds_after_its_last_answer() {
        let start = Instant::now();
        let at = |seconds: f64| start + Duration::from_secs_f64(seconds);
        let mut sent = Sent::new(start);
        assert!(!sent.is_silent(at(60.0)), "it has nothing to answer");
        // Frames go on, far fewer than the page may lag behind.
        (0..10).for_each(|i| sent.send(at(60.0 + f64::from(i))));
        assert!(!sent.behind() && !sent.is_silent(at(61.9)) && sent.is_silent(at(62.1)));
        sent.confirm(3, at(63.0));
        assert!(!sent.is_silent(at(64.9)), "a slow page answers");
        sent.confirm(3, at(64.9));
        assert!(sent.is_silent(at(65.1)), "the same once more is no answer");
        sent.confirm(99, at(66.0));
        assert!(!sent.is_silent(at(99.0)) && !sent.behind());
    }
}
