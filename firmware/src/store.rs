//! Nonvolatile store: the configuration and the last events.
//!
//! There are two copies in flash, each a map of `sequential-storage` in sectors of its own. A value
//! is written to one copy, read back, and only then written to the other, so that a power failure
//! leaves one copy whole, with the new value or the old one. A copy that an interrupted erase has
//! damaged is erased and written again from the other.

use crate::kind::{MAX_VALUE, SCHEMA};
use crate::shared::Shared;
use core::ops::Range;
use core::sync::atomic::Ordering;
use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use sequential_storage::cache::Cache;
use sequential_storage::cache::key_pointers::ArrayKeyPointers;
use sequential_storage::cache::page_pointers::ArrayPagePointers;
use sequential_storage::cache::page_states::ArrayPageStates;
use sequential_storage::map::{MapConfig, MapStorage};

const COPIES: usize = 2;
/// Sectors of a copy: one is free while the other is full.
const SECTORS: usize = 2;
/// Bytes of schema and number before a value.
pub const HEAD: usize = 6;

#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Key {
    Config,
    /// The last events.
    History,
}

const KEYS: [Key; 2] = [Key::Config, Key::History];

pub enum Loaded<'a> {
    Value(&'a [u8]),
    /// No value was saved, or it was forgotten.
    Absent,
    /// A value was saved, but neither copy can be read.
    Damaged,
    /// The value was saved by firmware with this other schema.
    OtherSchema(u16),
}

/// The flash cannot be written.
#[derive(Debug)]
pub struct Unwritable;

/// State of a value in one copy.
enum Entry {
    /// Number of the value, and its length with its head.
    Value(u32, usize),
    Absent,
    Damaged,
}

impl Entry {
    fn number(&self) -> u32 {
        match self {
            Self::Value(number, _) => *number,
            Self::Absent | Self::Damaged => 0,
        }
    }
}

pub type Buffer = [u8; MAX_VALUE];
type Map<'a, F> = MapStorage<
    u8,
    &'a mut F,
    Cache<ArrayPageStates<SECTORS>, ArrayPagePointers<SECTORS>, ArrayKeyPointers<u8, 2>, u8>,
>;

pub struct Store<F> {
    flash: F,
    /// Numbers of the values in each copy; the greater is newer, 0 means no value.
    numbers: [[u32; KEYS.len()]; COPIES],
}

impl<F: NorFlash> Store<F> {
    /// Opens the store and makes both copies the same. The thread's other tasks get their turns
    /// meanwhile.
    pub async fn open(flash: F) -> Self {
        let mut store = Self { flash, numbers: [[0; KEYS.len()]; COPIES] };
        let mut buffer = [0; MAX_VALUE];
        for key in KEYS {
            for copy in 0..COPIES {
                yield_now().await;
                let number = store.read(copy, key, &mut buffer).await.number();
                store.set_number(copy, key, number);
            }
            yield_now().await;
            let newest = store.newest(key);
            if store.number(0, key) != store.number(1, key)
                && let Entry::Value(_, length) = store.read(newest, key, &mut buffer).await
            {
                defmt::warn!("a copy of what is stored is old or damaged: written again");
                let value = buffer.get(..length).unwrap_or_default();
                if store.write(1 - newest, key, value).await.is_err() {
                    defmt::warn!("the flash cannot be written");
                }
            }
        }
        store
    }

    pub async fn load<'a>(&mut self, key: Key, buffer: &'a mut Buffer) -> Loaded<'a> {
        let newest = self.newest(key);
        yield_now().await;
        let length = match self.read(newest, key, buffer).await {
            Entry::Value(_, length) => length,
            Entry::Damaged => return Loaded::Damaged,
            Entry::Absent => {
                yield_now().await;
                return match self.read(1 - newest, key, buffer).await {
                    Entry::Damaged => Loaded::Damaged,
                    _ => Loaded::Absent,
                };
            }
        };
        let headed = buffer.get(..length).and_then(|headed| headed.split_first_chunk());
        let Some((schema, rest)) = headed else { return Loaded::Damaged };
        match (u16::from_le_bytes(*schema), rest.get(HEAD - schema.len()..)) {
            (SCHEMA, Some([])) => Loaded::Absent,
            (SCHEMA, Some(value)) => Loaded::Value(value),
            (SCHEMA, None) => Loaded::Damaged,
            (other, _) => Loaded::OtherSchema(other),
        }
    }

    /// Saves the value of `length` bytes after [`HEAD`] in `buffer` in place of the previous one;
    /// an empty one counts as absent. If it fails, the previous one may be lost.
    pub async fn save(
        &mut self,
        key: Key,
        buffer: &mut Buffer,
        length: usize,
    ) -> Result<(), Unwritable> {
        let newest = self.newest(key);
        let number = self.number(newest, key).checked_add(1).ok_or(Unwritable)?;
        let (schema, rest) = buffer.split_first_chunk_mut().ok_or(Unwritable)?;
        *schema = SCHEMA.to_le_bytes();
        let (place, _) = rest.split_first_chunk_mut().ok_or(Unwritable)?;
        *place = number.to_le_bytes();
        let headed = buffer.get(..HEAD + length).ok_or(Unwritable)?;
        // An unchanged value is not written again, to spare the flash.
        if self.number(0, key) == self.number(1, key) && self.holds(newest, key, headed).await {
            return Ok(());
        }
        self.write(1 - newest, key, headed).await?;
        self.write(newest, key, headed).await
    }

    /// Whether the copy already has this value.
    async fn holds(&mut self, copy: usize, key: Key, headed: &[u8]) -> bool {
        let mut buffer = [0; MAX_VALUE];
        matches!(
            self.read(copy, key, &mut buffer).await,
            Entry::Value(_, length) if buffer.get(HEAD..length) == headed.get(HEAD..)
        )
    }

    fn number(&self, copy: usize, key: Key) -> u32 {
        let number = self.numbers.get(copy).and_then(|numbers| numbers.get(key as usize));
        number.copied().unwrap_or(0)
    }

    fn set_number(&mut self, copy: usize, key: Key, number: u32) {
        let place = self.numbers.get_mut(copy).and_then(|numbers| numbers.get_mut(key as usize));
        if let Some(place) = place {
            *place = number;
        }
    }

    /// Index of the copy with the newest value.
    fn newest(&self, key: Key) -> usize {
        usize::from(self.number(1, key) > self.number(0, key))
    }

    fn map(&mut self, copy: usize) -> Map<'_, F> {
        let bytes = (SECTORS * F::ERASE_SIZE) as u32;
        let range: Range<u32> = copy as u32 * bytes..(copy as u32 + 1) * bytes;
        let cache =
            Cache::new(ArrayPageStates::new(), ArrayPagePointers::new(), ArrayKeyPointers::new());
        MapStorage::new(&mut self.flash, MapConfig::new(range), cache)
    }

    async fn read(&mut self, copy: usize, key: Key, buffer: &mut Buffer) -> Entry {
        let found = self.map(copy).fetch_item::<&[u8]>(buffer, &(key as u8)).await;
        let (start, length, number) = match found {
            Ok(None) => return Entry::Absent,
            Err(_) => return Entry::Damaged,
            Ok(Some(value)) => match value {
                [_, _, a, b, c, d, ..] => {
                    (value.as_ptr(), value.len(), u32::from_le_bytes([*a, *b, *c, *d]))
                }
                _ => return Entry::Damaged,
            },
        };
        let start = start.addr() - buffer.as_ptr().addr();
        if start + length > buffer.len() {
            return Entry::Damaged;
        }
        buffer.copy_within(start..start + length, 0);
        Entry::Value(number, length)
    }

    async fn write(&mut self, copy: usize, key: Key, headed: &[u8]) -> Result<(), Unwritable> {
        if self.try_write(copy, key, headed).await.is_ok() {
            return Ok(());
        }
        // The copy is damaged: it is erased, and its other values are copied from the other copy.
        defmt::warn!("a damaged copy of what is stored is erased");
        self.map(copy).erase_all().await.map_err(|_| Unwritable)?;
        for other in KEYS.into_iter().filter(|other| *other != key) {
            let mut buffer = [0; MAX_VALUE];
            if let Entry::Value(_, length) = self.read(1 - copy, other, &mut buffer).await {
                let value = buffer.get(..length).unwrap_or_default();
                self.try_write(copy, other, value).await?;
            }
        }
        self.try_write(copy, key, headed).await
    }

    async fn try_write(&mut self, copy: usize, key: Key, headed: &[u8]) -> Result<(), Unwritable> {
        let mut buffer = [0; MAX_VALUE];
        let stored = self.map(copy).store_item(&mut buffer, &(key as u8), &headed).await;
        stored.map_err(|_| Unwritable)?;
        match self.read(copy, key, &mut buffer).await {
            Entry::Value(number, length) if buffer.get(..length) == Some(headed) => {
                self.set_number(copy, key, number);
                Ok(())
            }
            _ => Err(Unwritable),
        }
    }
}

/// A flash that announces to control when it is busy: it then blocks the thread, and control feeds
/// the watchdog. The thread's other tasks get their turns between two operations.
pub struct AnnouncedFlash<F> {
    flash: F,
    shared: &'static Shared,
}

/// Steps that an operation of the flash may take: an erase takes at most 400 ms (W25Q16JV, 9.6).
const BUSY_STEPS: u32 = 450;

impl<F> AnnouncedFlash<F> {
    pub fn new(flash: F, shared: &'static Shared) -> Self {
        Self { flash, shared }
    }
}

impl<F: ErrorType> ErrorType for AnnouncedFlash<F> {
    type Error = F::Error;
}

impl<F: ReadNorFlash> ReadNorFlash for AnnouncedFlash<F> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), F::Error> {
        self.flash.read(offset, bytes).await
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl<F: NorFlash> NorFlash for AnnouncedFlash<F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), F::Error> {
        // Each sector has its own time.
        for sector in (from..to).step_by(F::ERASE_SIZE) {
            yield_now().await;
            self.shared.flash_busy_steps.store(BUSY_STEPS, Ordering::Relaxed);
            let outcome = self.flash.erase(sector, sector + F::ERASE_SIZE as u32).await;
            self.shared.flash_busy_steps.store(0, Ordering::Relaxed);
            outcome?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), F::Error> {
        yield_now().await;
        self.shared.flash_busy_steps.store(BUSY_STEPS, Ordering::Relaxed);
        let outcome = self.flash.write(offset, bytes).await;
        self.shared.flash_busy_steps.store(0, Ordering::Relaxed);
        outcome
    }
}
