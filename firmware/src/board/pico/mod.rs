//! Raspberry Pi Pico, with the RP2040.

use super::rp::{CRYSTAL_HZ, Member, Rp};
use embassy_rp::clocks::{ClockConfig, CoreVoltage, PllConfig};
use embassy_rp::flash::Flash;
use embassy_rp::{Peri, peripherals::FLASH, rom_data};
use thermyo_protocol::Chip;
// The chip has no FPU.
use rp2040_float as _;

const FLASH_BYTES: usize = 2 * 1024 * 1024;

pub type Pico = Rp<Rp2040>;

pub enum Rp2040 {}

impl Member for Rp2040 {
    const CHIP: Chip = Chip::Rp2040;

    /// 200 MHz at 1.15 V, for which the chip is certified (release notes of the Pico SDK 2.1.1,
    /// February 2025), instead of 125 MHz at 1.1 V.
    fn clocks() -> ClockConfig {
        let mut clocks = ClockConfig::crystal(CRYSTAL_HZ);
        if let Some(crystal) = &mut clocks.xosc {
            let pll = PllConfig { refdiv: 1, fbdiv: 100, post_div1: 6, post_div2: 1 };
            crystal.sys_pll = Some(pll);
        }
        clocks.core_voltage = CoreVoltage::V1_15;
        clocks
    }

    /// The flash's number: the chip itself has none.
    fn unique_id(flash: Peri<'_, FLASH>) -> [u8; 8] {
        let mut id = [0; 8];
        match Flash::<_, _, FLASH_BYTES>::new_blocking(flash).blocking_unique_id(&mut id) {
            Ok(()) => id,
            Err(_) => [0; 8],
        }
    }

    fn boot_loader() -> ! {
        rom_data::reset_to_usb_boot(0, 0);
        unreachable!("the boot ROM restarts the chip")
    }
}
