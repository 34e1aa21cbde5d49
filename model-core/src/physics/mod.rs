//! What the gas, its chamber and the valves do: equations, without any thought of sensors or set points.

pub mod balance;
pub mod chamber;
pub mod friction;
pub mod gas;
pub mod heat;
pub mod leak;
pub mod model;
pub mod valve;
