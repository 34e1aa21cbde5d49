//! Equations of the gas, its chamber and the valves, without sensors or set points.

pub mod balance;
pub mod chamber;
pub mod friction;
pub mod gas;
pub mod heat;
pub mod hysteresis;
pub mod leak;
pub mod valve;
