//! The whole system: the same core on every board, conservation, closed forms, the paper.

mod chambers;
mod closed_forms;
mod control;
#[cfg(emulator)]
mod emulated_control;
mod emulated_cycle;
#[cfg(emulator)]
mod emulated_endurance;
mod emulated_flash;
#[cfg(emulator)]
mod emulated_float;
#[cfg(emulator)]
mod emulated_hosts;
#[cfg(emulator)]
mod emulated_image;
#[cfg(emulator)]
mod emulated_instructions;
#[cfg(emulator)]
mod emulated_joint;
#[cfg(emulator)]
mod emulated_joint_image;
#[cfg(emulator)]
mod emulated_monitor;
#[cfg(emulator)]
mod emulated_parity;
#[cfg(emulator)]
mod emulated_safety;
#[cfg(emulator)]
mod emulated_sensors;
mod emulated_serial;
#[cfg(emulator)]
mod emulated_still;
#[cfg(emulator)]
mod emulated_store;
#[cfg(emulator)]
mod emulated_tune;
#[cfg(emulator)]
mod emulated_usb;
mod estimator;
mod faults;
mod firmware_float;
mod identify;
#[cfg(emulator)]
mod m33_parity;
#[cfg(emulator)]
mod panic_free;
mod reproduction;
mod runs;
mod soak;
mod tune;
