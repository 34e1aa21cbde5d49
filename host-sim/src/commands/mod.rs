//! What the larger commands do, each a folder that needs no terminal; `cli` has their arguments.

pub mod calibrate;
pub mod compare;
#[cfg(feature = "command")]
pub mod drive;
pub mod evaluate;
#[cfg(feature = "command")]
pub mod flash;
pub mod identify;
#[cfg(feature = "command")]
pub mod monitor;
pub mod parallel;
#[cfg(feature = "command")]
pub mod playground;
#[cfg(feature = "command")]
pub mod ports;
pub mod replay;
pub mod reproduce;
pub mod sweep;
pub mod tune;
#[cfg(feature = "command")]
mod usb;
