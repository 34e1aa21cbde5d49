//! Makes every call of the firmware into model-core, and those needed for a joint, on inputs unknown to the compiler.
//!
//! The panic handler calls a function that does not exist: if the optimiser leaves one way to a panic,
//! this does not link.

#![no_std]
#![no_main]

use core::ptr::{read_volatile, write_volatile};
use model_core::joint::{Joint, JointConfig, JointSample, JointSetPoint, JointTelemetry};
use model_core::{Config, Core, Sample, SetPoint, Telemetry};
use thermyo_protocol::{Decoder, HostCommand, Message, Request, encode};

unsafe extern "C" {
    fn model_core_can_panic() -> !;
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // SAFETY: never linked, never run.
    unsafe { model_core_can_panic() }
}

/// Address of inputs and outputs.
const MEMORY: usize = 0x2000_0000;

#[unsafe(no_mangle)]
extern "C" fn _start() -> ! {
    // SAFETY: linked, never run.
    let config = unsafe { read_volatile(MEMORY as *const Config) };
    let mut decoder = Decoder::new();
    if let Ok(mut core) = Core::new(&config) {
        loop {
            // SAFETY: as above.
            let (byte, sample, set_point) = unsafe {
                (
                    read_volatile((MEMORY + 0x1000) as *const u8),
                    read_volatile((MEMORY + 0x2000) as *const Sample),
                    read_volatile((MEMORY + 0x3000) as *const SetPoint),
                )
            };
            if let Some(Request { command: HostCommand::Configure(config), .. }) =
                decoder.push(byte)
                && let Ok(other) = Core::new(&config)
            {
                core = other;
            }
            let _ = core.set(set_point);
            core.clear_faults();
            let telemetry = core.step(&sample);
            // SAFETY: as above.
            unsafe { write_volatile((MEMORY + 0x4000) as *mut Telemetry, telemetry) };
            for &byte in encode(&Message::Telemetry(telemetry)).unwrap_or_default().iter() {
                // SAFETY: as above.
                unsafe { write_volatile((MEMORY + 0x5000) as *mut u8, byte) };
            }
        }
    }
    joint();
    loop {
        core::hint::spin_loop();
    }
}

/// Makes the same calls for a joint.
fn joint() {
    // SAFETY: linked, never run.
    let config = unsafe { read_volatile(MEMORY as *const JointConfig) };
    let Ok(mut joint) = Joint::new(&config) else { return };
    loop {
        // SAFETY: as above.
        let (sample, set_point) = unsafe {
            (
                read_volatile((MEMORY + 0x2000) as *const JointSample),
                read_volatile((MEMORY + 0x3000) as *const JointSetPoint),
            )
        };
        let _ = joint.set(set_point);
        let _ = joint.arm(Some(2.0e5));
        joint.clear_faults();
        joint.disarm();
        if joint.become_new(&config).is_err() {
            joint.restart_as(&Joint::unconfigured());
        }
        let telemetry = joint.step(&sample);
        // SAFETY: as above.
        unsafe { write_volatile((MEMORY + 0x4000) as *mut JointTelemetry, telemetry) };
    }
}
