//! Keeper of the [store](crate::store): loads the configuration after the start, saves it at the
//! host's request, and records events. A board without a store remembers events until it loses
//! power.

use crate::kind::{Config, MAX_VALUE};
use crate::link::{Identity, configure, done};
use crate::shared::{Answer, Requester, Shared, StoreRequest};
use crate::store::{AnnouncedFlash, Buffer, HEAD, Key, Loaded, Store, Unwritable};
use core::future::pending;
use core::sync::atomic::Ordering;
use embassy_futures::select::{Either3, select3};
use embassy_time::{Duration, Instant, Timer, with_timeout};
use embedded_storage_async::nor_flash::NorFlash;
use serde::{Deserialize, Serialize};
use thermyo_protocol::{ConfigSource, Event, LastReset, Name, Refusal, Status};

const EVENTS: usize = 8;

/// Time between two writes of events: a sector of the flash endures 100 000 erases.
const PAUSE: Duration = Duration::from_secs(10);

/// Time between two checks of whether the muscle is vented.
const UNTIL_VENTED: Duration = Duration::from_millis(10);

/// Time for an answer to find room: five times the time to send a full outbox.
const ANSWERING: Duration = Duration::from_millis(100);

/// Events, the last one first.
type History = [Option<Event>; EVENTS];

#[derive(Serialize, Deserialize)]
struct Saved {
    config: Config,
    name: Name,
}

pub async fn run<F: NorFlash>(flash: Option<F>, identity: Identity, shared: &'static Shared) -> ! {
    let mut keeper =
        Keeper { store: None, buffer: [0; MAX_VALUE], history: [None; EVENTS], shared };
    if let Some(flash) = flash {
        keeper.store = Some(Store::open(AnnouncedFlash::new(flash, shared)).await);
        keeper.take_config(&identity).await;
        keeper.take_history().await;
    }
    shared.recalled.store(true, Ordering::Relaxed);
    let mut next_write = Instant::MIN;
    let mut unwritten = false;
    if identity.last_reset != LastReset::Power {
        keeper.happened(Event::Started(identity.last_reset));
        // Delayed, so that a board that restarts endlessly does not wear out its flash.
        (next_write, unwritten) = (Instant::now() + PAUSE, true);
    }
    loop {
        let write = async {
            if unwritten {
                Timer::at(next_write).await;
            } else {
                pending().await
            }
        };
        match select3(shared.store_requests.receive(), shared.failed.wait(), write).await {
            Either3::First((requester, request)) => keeper.answer(requester, request).await,
            Either3::Second(first) => {
                keeper.happened(Event::Vented(first));
                unwritten = true;
            }
            Either3::Third(()) => {
                unwritten = !keeper.write_history().await;
                next_write = Instant::now() + if unwritten { UNTIL_VENTED } else { PAUSE };
            }
        }
    }
}

struct Keeper<F> {
    store: Option<Store<F>>,
    /// A value, after the store's head.
    buffer: Buffer,
    history: History,
    shared: &'static Shared,
}

impl<F: NorFlash> Keeper<F> {
    fn happened(&mut self, event: Event) {
        self.history.rotate_right(1);
        if let Some(last) = self.history.first_mut() {
            *last = Some(event);
        }
    }

    /// Answers a request once there is room: the outbox may have filled while the flash was busy. A host that does
    /// not read loses the answer, and does not keep another one waiting.
    async fn answer(&mut self, Requester { line, sequence, .. }: Requester, request: StoreRequest) {
        let outcome = match request {
            StoreRequest::Event(number) => {
                Ok(Answer::Event(self.history.get(usize::from(number)).copied().flatten()))
            }
            StoreRequest::Save => self.save().await.map(|()| done(self.shared)),
            StoreRequest::Forget => self.forget().await.map(|()| done(self.shared)),
        };
        let answer = outcome.unwrap_or_else(Answer::Refused);
        let _ = with_timeout(ANSWERING, line.answer_later(sequence, answer)).await;
    }

    async fn save(&mut self) -> Result<(), Refusal> {
        let _written = self.shared.flash.lock().await;
        self.may_write()?;
        let Status { config_checksum, config_name: name, .. } = self.shared.status();
        // Another configuration may be staged, and wait for this one to be written.
        let active = self.shared.with_prepared(config_checksum, |core| Ok(*core.config()));
        let saved = Saved { config: active.map_err(|_| Refusal::NotConfigured)?, name };
        self.write(Key::Config, &saved).await?;
        self.shared.change_status(|status| status.config_source = ConfigSource::Flash);
        Ok(())
    }

    async fn forget(&mut self) -> Result<(), Refusal> {
        let _written = self.shared.flash.lock().await;
        self.may_write()?;
        self.put(Key::Config, 0).await?;
        self.shared.change_status(|status| {
            if status.config_source == ConfigSource::Flash {
                status.config_source = ConfigSource::Host;
            }
        });
        Ok(())
    }

    /// Whether the flash may be written, which is only while the muscle is vented: while the flash
    /// is busy the links to the host wait, and a hang is found late.
    fn may_write(&self) -> Result<(), Refusal> {
        if self.store.is_none() {
            Err(Refusal::NoStore)
        } else if !self.shared.vented() {
            Err(Refusal::NotVented)
        } else {
            Ok(())
        }
    }

    async fn write<T: Serialize>(&mut self, key: Key, value: &T) -> Result<(), Refusal> {
        let room = self.buffer.get_mut(HEAD..).ok_or(Refusal::Flash)?;
        let length = postcard::to_slice(value, room).map_err(|_| Refusal::Flash)?.len();
        self.put(key, length).await
    }

    /// Writes the value of `length` bytes in the buffer, or an empty one to forget it; digital
    /// sensors count as paused meanwhile.
    async fn put(&mut self, key: Key, length: usize) -> Result<(), Refusal> {
        let store = self.store.as_mut().ok_or(Refusal::NoStore)?;
        self.shared.storing.store(true, Ordering::Relaxed);
        let outcome = store.save(key, &mut self.buffer, length).await;
        self.shared.storing.store(false, Ordering::Relaxed);
        outcome.map_err(|Unwritable| Refusal::Flash)
    }

    /// Writes the history. Returns whether nothing is left to write: it was written, or the flash
    /// cannot be written.
    async fn write_history(&mut self) -> bool {
        let _written = self.shared.flash.lock().await;
        match self.may_write() {
            Ok(()) => (),
            Err(refusal) => return refusal != Refusal::NotVented,
        }
        let history = self.history;
        if self.write(Key::History, &history).await == Err(Refusal::Flash) {
            defmt::warn!("the history is not stored: the flash cannot be written");
        }
        true
    }

    /// Restarts the core with the saved configuration, if there is one that this board can run.
    async fn take_config(&mut self, identity: &Identity) {
        let Some(store) = &mut self.store else { return };
        match store.load(Key::Config, &mut self.buffer).await {
            Loaded::Value(value) => {
                let order = postcard::from_bytes::<Saved>(value).ok().and_then(|saved| {
                    let Saved { config, name } = &saved;
                    configure(config, identity, self.shared, ConfigSource::Flash, *name).ok()
                });
                match order {
                    Some(order) => self.shared.restart(None, order).await,
                    None => defmt::warn!("the saved configuration is none that this board can run"),
                }
            }
            Loaded::Absent => (),
            Loaded::Damaged => defmt::warn!("the saved configuration is damaged"),
            Loaded::OtherSchema(schema) => {
                defmt::warn!(
                    "the saved configuration has schema {=u16}, not this firmware's",
                    schema
                );
            }
        }
    }

    /// Loads the history. The last venting before the loss of power is the first failure until
    /// there is another one.
    async fn take_history(&mut self) {
        let Some(store) = &mut self.store else { return };
        if let Loaded::Value(value) = store.load(Key::History, &mut self.buffer).await {
            self.history = postcard::from_bytes(value).unwrap_or_default();
        }
        let vented = self.history.iter().flatten().find_map(|event| match event {
            Event::Vented(first) => Some(*first),
            Event::Started(_) => None,
        });
        if self.shared.first_failure().is_none() {
            self.shared.set_first_failure(vented);
        }
    }
}
