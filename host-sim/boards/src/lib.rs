//! Boards with a firmware: on an emulated chip, or on a real one behind a serial port.

mod armed;
pub mod checkout;
pub mod emulated;
pub mod emulated_joint;
pub mod image;
pub mod inside;
pub mod line;
pub mod link;
pub mod live;
pub mod live_joint;
pub mod plug;
pub mod port;
#[cfg(unix)]
pub mod pty;
pub mod serial;
pub mod serial_port;
pub mod service;
pub mod subject;
