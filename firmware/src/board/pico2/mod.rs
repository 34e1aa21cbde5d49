//! Raspberry Pi Pico 2: the Arm cores of the RP2350.

use super::rp::{CRYSTAL_HZ, Member, Rp};
use embassy_rp::clocks::ClockConfig;
use embassy_rp::{Peri, otp, peripherals::FLASH, rom_data};
use thermyo_protocol::Chip;

/// Flags of the boot ROM's `reboot` (RP2350 datasheet 5.4.8.24).
const REBOOT_TO_BOOTSEL: u32 = 2;
const NO_RETURN_ON_SUCCESS: u32 = 0x100;

pub type Pico2 = Rp<Rp2350>;

pub enum Rp2350 {}

impl Member for Rp2350 {
    const CHIP: Chip = Chip::Rp2350;

    /// 150 MHz.
    fn clocks() -> ClockConfig {
        ClockConfig::crystal(CRYSTAL_HZ)
    }

    fn unique_id(_flash: Peri<'_, FLASH>) -> [u8; 8] {
        otp::get_chipid().unwrap_or(0).to_be_bytes()
    }

    fn boot_loader() -> ! {
        rom_data::reboot(REBOOT_TO_BOOTSEL | NO_RETURN_ON_SUCCESS, 0, 0, 0);
        unreachable!("the boot ROM restarts the chip")
    }
}
