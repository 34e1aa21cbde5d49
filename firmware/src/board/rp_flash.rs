//! The end of the flash of a Raspberry Pi Pico or Pico 2, erased and programmed by the boot ROM.
//!
//! Interrupts stay on: the program and its vector table are in RAM, so that control continues while
//! the flash is busy and cannot be read.

use embassy_rp::Peri;
use embassy_rp::flash::FLASH_BASE;
use embassy_rp::peripherals::FLASH;
use embassy_rp::rom_data;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};

unsafe extern "C" {
    /// End of the image's flash (`memory.x`).
    static __store: u8;
}

/// Bytes that are erased and programmed at once (W25Q16JV).
const SECTOR: usize = 4096;
const PAGE: usize = 256;
/// Command that erases a larger block, which the ROM does not use for a single sector.
const BLOCK: u32 = 1 << 16;
const ERASE_BLOCK: u8 = 0xd8;

/// [`STORE_BYTES`](super::STORE_BYTES) of flash after the image.
pub struct StoreFlash(());

impl StoreFlash {
    pub fn new(_flash: Peri<'static, FLASH>) -> Self {
        Self(())
    }

    /// Converts an offset in the store to an offset in the flash.
    fn place(offset: u32, bytes: usize) -> Result<usize, NorFlashErrorKind> {
        let store = (&raw const __store).addr() - FLASH_BASE.addr();
        let offset = offset as usize;
        if offset.saturating_add(bytes) > super::STORE_BYTES {
            return Err(NorFlashErrorKind::OutOfBounds);
        }
        Ok(store + offset)
    }

    /// Runs a function of the ROM while the flash cannot be read.
    ///
    /// # Safety
    /// The operation must stay within the store.
    unsafe fn write_with(operation: impl FnOnce()) {
        // SAFETY: only this module reads flash, and not while this function runs.
        unsafe {
            rom_data::connect_internal_flash();
            rom_data::flash_exit_xip();
            operation();
            rom_data::flash_flush_cache();
            // Slower than the mode of the boot loader, which only a start needs and sets up again.
            rom_data::flash_enter_cmd_xip();
        }
    }
}

impl ErrorType for StoreFlash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for StoreFlash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let from = FLASH_BASE.addr() + Self::place(offset, bytes.len())?;
        // SAFETY: the range is flash, which only this module writes, and it is not being written
        // now.
        bytes.copy_from_slice(unsafe {
            core::slice::from_raw_parts(from as *const u8, bytes.len())
        });
        Ok(())
    }

    fn capacity(&self) -> usize {
        super::STORE_BYTES
    }
}

impl NorFlash for StoreFlash {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = SECTOR;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        for sector in (from..to).step_by(SECTOR) {
            let place = Self::place(sector, SECTOR)? as u32;
            // SAFETY: within the store.
            unsafe {
                Self::write_with(|| {
                    rom_data::flash_range_erase(place, SECTOR, BLOCK, ERASE_BLOCK);
                });
            }
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let mut place = Self::place(offset, bytes.len())?;
        let mut rest = bytes;
        while !rest.is_empty() {
            // One page at a time. Programming ones changes nothing.
            let mut page = [0xff; PAGE];
            let room = page.split_at_mut(place % PAGE).1;
            let count = room.len().min(rest.len());
            let (now, later) = rest.split_at(count);
            for (byte, value) in room.iter_mut().zip(now) {
                *byte = *value;
            }
            let start = (place - place % PAGE) as u32;
            // SAFETY: within the store.
            unsafe {
                Self::write_with(|| rom_data::flash_range_program(start, page.as_ptr(), PAGE));
            }
            place += count;
            rest = later;
        }
        Ok(())
    }
}
