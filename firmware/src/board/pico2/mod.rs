//! Raspberry Pi Pico 2: the RP2350, its Arm cores.

use super::rp::{Member, Rp};
use model_core::link::Chip;

/// Raspberry Pi Pico 2.
pub type Pico2 = Rp<Rp2350>;

/// Its chip.
pub enum Rp2350 {}

impl Member for Rp2350 {
    const CHIP: Chip = Chip::Rp2350;
}
