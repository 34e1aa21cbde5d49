//! The core on a Cortex-M33: carries out the test's requests, through a mailbox in memory.

#![no_std]
#![no_main]

mod mailbox;

use core::cell::UnsafeCell;
use core::ptr::{read_volatile, write_volatile};
use core::sync::atomic::{Ordering, compiler_fence};
use mailbox::{GUEST, Mailbox, PANICKED, TEST};
use model_core::Core;
use thermyo_protocol::{
    Answer, Decoder, HostCommand, MAX_FRAME, Message, Refusal, Reply, Request, encode,
};

core::arch::global_asm!(
    ".section .start, \"ax\"",
    ".global start",
    ".type start, %function",
    ".thumb_func",
    "start:",
    // Turns the FPU on (CPACR).
    "ldr r0, =0xe000ed88",
    "ldr r1, [r0]",
    "ldr r2, =0x00f00000",
    "orrs r1, r2",
    "str r1, [r0]",
    "dsb",
    "isb",
    // Lets the second core sleep (SIO CPUID).
    "ldr r0, =0xd0000000",
    "ldr r0, [r0]",
    "cmp r0, #0",
    "beq 1f",
    "0: wfe",
    "b 0b",
    "1: ldr r0, =stack_top",
    "mov sp, r0",
    "b run",
    ".size start, . - start",
);

/// Debug exception and monitor control: bit 24 enables the trace unit, which has the counter.
const DEMCR: *mut u32 = 0xe000_edfc as *mut u32;
/// Control of the cycle counter, enabled by bit 0, and its count.
const DWT_CTRL: *mut u32 = 0xe000_1000 as *mut u32;
const DWT_CYCCNT: *mut u32 = 0xe000_1004 as *mut u32;

struct Shared(UnsafeCell<Mailbox>);

// SAFETY: one core runs, and the test looks between two instructions.
unsafe impl Sync for Shared {}

#[unsafe(no_mangle)]
static MAILBOX: Shared =
    Shared(UnsafeCell::new(Mailbox { turn: 0, step_cycles: 0, length: 0, bytes: [0; MAX_FRAME] }));

#[unsafe(no_mangle)]
extern "C" fn run() -> ! {
    let mailbox = MAILBOX.0.get();
    // SAFETY: mailbox and counter exist, and no other code runs.
    unsafe {
        write_volatile(DEMCR, read_volatile(DEMCR) | 1 << 24);
        write_volatile(DWT_CTRL, read_volatile(DWT_CTRL) | 1);
        let mut decoder = Decoder::new();
        let mut core = None;
        loop {
            write_volatile(&raw mut (*mailbox).turn, TEST);
            while read_volatile(&raw const (*mailbox).turn) != GUEST {}
            compiler_fence(Ordering::SeqCst);
            let Mailbox { bytes, length, step_cycles, .. } = &mut *mailbox;
            let mut answer = None;
            for &byte in bytes.iter().take(*length as usize) {
                if let Some(Request { sequence, command }) = decoder.push(byte) {
                    answer = Some(carry_out(command, sequence, &mut core, step_cycles));
                }
            }
            let frame = answer.and_then(|answer| encode(&answer).ok()).unwrap_or_default();
            bytes.iter_mut().zip(&frame).for_each(|(to, &from)| *to = from);
            *length = frame.len() as u32;
            compiler_fence(Ordering::SeqCst);
        }
    }
}

/// # Safety
/// The cycle counter exists.
unsafe fn carry_out(
    command: HostCommand,
    sequence: u8,
    core: &mut Option<Core>,
    step_cycles: &mut u32,
) -> Message {
    let outcome = match (command, core) {
        (HostCommand::Configure(config), core) => {
            Core::new(&config).map(|new| *core = Some(new)).map_err(Refusal::from)
        }
        (HostCommand::Start(set_point) | HostCommand::Set(set_point), Some(core)) => {
            core.set(set_point).map_err(Refusal::from)
        }
        (HostCommand::Step(sample), Some(core)) => {
            // SAFETY: as above.
            let before = unsafe { read_volatile(DWT_CYCCNT) };
            let telemetry = core.step(&sample);
            // SAFETY: as above.
            *step_cycles = unsafe { read_volatile(DWT_CYCCNT) }.wrapping_sub(before);
            return Message::Telemetry(telemetry);
        }
        _ => Err(Refusal::NotConfigured),
    };
    let answer = match outcome {
        Ok(()) => Answer::Done { step: 0 },
        Err(refusal) => Answer::Refused(refusal),
    };
    Message::Reply(Reply { sequence, answer })
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // SAFETY: no other code runs.
    unsafe { write_volatile(&raw mut (*MAILBOX.0.get()).turn, PANICKED) };
    loop {
        core::hint::spin_loop();
    }
}
