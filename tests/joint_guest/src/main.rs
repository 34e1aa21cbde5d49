//! The core of a joint on the RP2040: functions that a test calls. Their inputs and outputs are in
//! [`BUFFER`], in postcard's encoding.

#![no_std]
#![no_main]

use core::cell::UnsafeCell;
use model_core::joint::{Joint, JointConfig, JointSample, JointSetPoint, JointTelemetry};
// The chip has no FPU.
use rp2040_float as _;

const BUFFER_BYTES: usize = 2048;

#[repr(transparent)]
struct Static<T>(UnsafeCell<T>);

// SAFETY: one core runs, without interrupts.
unsafe impl<T> Sync for Static<T> {}

#[unsafe(no_mangle)]
static BUFFER: Static<[u8; BUFFER_BYTES]> = Static(UnsafeCell::new([0; BUFFER_BYTES]));
#[unsafe(no_mangle)]
static JOINT: Static<Option<Joint>> = Static(UnsafeCell::new(None));
static SAMPLE: Static<Option<JointSample>> = Static(UnsafeCell::new(None));
static TELEMETRY: Static<Option<JointTelemetry>> = Static(UnsafeCell::new(None));

fn taken<T: for<'de> serde::Deserialize<'de>>() -> T {
    // SAFETY: no reference to it outlives a call.
    let buffer = unsafe { &*BUFFER.0.get() };
    postcard::from_bytes(buffer).expect("the test writes it")
}

/// Restarts with the configuration in the buffer.
#[unsafe(no_mangle)]
extern "C" fn configure() {
    // SAFETY: as above.
    unsafe { *JOINT.0.get() = Joint::new(&taken::<JointConfig>()).ok() }
}

/// Takes the set point in the buffer, unless the joint refuses it.
#[unsafe(no_mangle)]
extern "C" fn set() {
    // SAFETY: as above.
    if let Some(joint) = unsafe { &mut *JOINT.0.get() } {
        let _ = joint.set(taken::<JointSetPoint>());
    }
}

/// Takes the sample of the next step from the buffer.
#[unsafe(no_mangle)]
extern "C" fn sample() {
    // SAFETY: as above.
    unsafe { *SAMPLE.0.get() = Some(taken()) }
}

/// Runs one step, and nothing else.
#[unsafe(no_mangle)]
extern "C" fn step() {
    // SAFETY: as above.
    let (joint, sample) = unsafe { (&mut *JOINT.0.get(), &*SAMPLE.0.get()) };
    if let (Some(joint), Some(sample)) = (joint, sample) {
        // SAFETY: as above.
        unsafe { *TELEMETRY.0.get() = Some(joint.step(sample)) }
    }
}

/// Writes the telemetry of the last step to the buffer, and returns its length.
#[unsafe(no_mangle)]
extern "C" fn telemetry() -> usize {
    // SAFETY: as above.
    let (telemetry, buffer) = unsafe { (&*TELEMETRY.0.get(), &mut *BUFFER.0.get()) };
    let telemetry = telemetry.as_ref().expect("a step was before");
    postcard::to_slice(telemetry, buffer).expect("it fits").len()
}

/// Never returns, which the emulator reports.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    loop {
        core::hint::spin_loop();
    }
}
