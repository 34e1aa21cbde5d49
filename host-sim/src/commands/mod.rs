//! Commands that use plugged-in devices or write a folder; `cli` has their arguments.

pub mod flash;
pub mod joint;
pub mod monitor;
pub mod playground;
pub mod ports;
mod usb;
