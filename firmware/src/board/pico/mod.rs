//! Raspberry Pi Pico: the RP2040. It has no FPU; its arithmetic is here.

mod float;
mod float_calls;

use super::rp::{Member, Rp};
use model_core::link::Chip;

/// Raspberry Pi Pico.
pub type Pico = Rp<Rp2040>;

/// Its chip.
pub enum Rp2040 {}

impl Member for Rp2040 {
    const CHIP: Chip = Chip::Rp2040;
}
