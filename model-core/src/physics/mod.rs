//! What the gas, its chamber and the valves do: equations, without any thought of sensors or set points.

pub mod balance;
pub mod body;
pub mod gas;
pub mod geometry;
pub mod heat;
pub mod model;
pub mod valve;
