//! Preserves the phase of control and the first failure over a restart, in memory that a start does
//! not clear.

use crate::board::Reset;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use model_core::Faults;
use model_core::safety::supervisor::FirstFailure;
use thermyo_protocol::{LastReset, Phase};

/// First failure before the restart, and the faults latched then.
pub type Remembered = Option<(FirstFailure, Faults)>;

/// Reason why the firmware ended itself.
#[derive(Clone, Copy)]
#[repr(u32)]
pub enum End {
    Panic = 1,
    HardFault = 2,
}

/// The only instance is a static in the section `.uninit`. Each field is one word, so that a
/// restart during a write leaves no half-written field.
pub struct BlackBox {
    /// [`WRITTEN`]; otherwise the memory has been random since power came.
    written: Word,
    phase: Word,
    end: Word,
    /// Line of the panic, or address of the hard fault.
    detail: Word,
    latched: Word,
    /// Faults of the first failure, its pressure \[Pa\] as bits, and its step.
    failure: Word,
    failure_pressure: Word,
    failure_step: Word,
    /// Unrequested restarts since power came.
    restarts: Word,
}

const WRITTEN: u32 = 0x7468_7931;

const PHASES: [Phase; 5] =
    [Phase::Starting, Phase::Waiting, Phase::Sampling, Phase::Stepping, Phase::Driving];

impl BlackBox {
    /// Creates uninitialised words.
    pub const fn new() -> Self {
        Self {
            written: Word::new(),
            phase: Word::new(),
            end: Word::new(),
            detail: Word::new(),
            latched: Word::new(),
            failure: Word::new(),
            failure_pressure: Word::new(),
            failure_step: Word::new(),
            restarts: Word::new(),
        }
    }

    /// Returns why the board started and the first failure before, and prepares the next record.
    /// Must be called once, before all other functions.
    pub fn open(&self, reset: Reset) -> (LastReset, Remembered) {
        // Memory may outlive a short loss of power; only the chip's reset cause is certain.
        if reset == Reset::Power || self.written.get() != WRITTEN {
            let Self {
                written,
                phase,
                end,
                detail,
                latched,
                failure,
                failure_pressure,
                failure_step,
                restarts,
            } = self;
            for word in
                [phase, end, detail, latched, failure, failure_pressure, failure_step, restarts]
            {
                word.set(0);
            }
            written.set(WRITTEN);
        }
        let phase = *PHASES.get(self.phase.get() as usize).unwrap_or(&Phase::Starting);
        let (end, detail) = (self.end.get(), self.detail.get());
        let last_reset = match reset {
            Reset::Forced if end == End::Panic as u32 => LastReset::Panic { line: detail, phase },
            Reset::Forced if end == End::HardFault as u32 => {
                LastReset::HardFault { address: detail, phase }
            }
            Reset::TimedOut => LastReset::Watchdog { phase },
            Reset::Power | Reset::Forced => LastReset::Power,
        };
        if last_reset != LastReset::Power {
            self.restarts.set(self.restarts.get().wrapping_add(1));
            defmt::warn!("restarted in phase {=u32}, cause {=u32}", phase as u32, end);
        }
        self.note(Phase::Starting);
        self.end.set(0);
        let first = FirstFailure {
            faults: Faults(self.failure.get()),
            pressure_pa: f32::from_bits(self.failure_pressure.get()),
            step: self.failure_step.get(),
        };
        let latched = Faults(self.latched.get());
        (last_reset, (first.faults != Faults::NONE).then_some((first, latched)))
    }

    /// Unrequested restarts since power came.
    pub fn restarts(&self) -> u32 {
        self.restarts.get()
    }

    pub fn note(&self, phase: Phase) {
        self.phase.set(phase as u32);
    }

    pub fn record(&self, first: Option<FirstFailure>, latched: Faults) {
        if let Some(FirstFailure { faults, pressure_pa, step }) = first {
            self.failure.set(faults.0);
            self.failure_pressure.set(pressure_pa.to_bits());
            self.failure_step.set(step);
        }
        self.latched.set(latched.0);
    }

    /// Records why the firmware is about to restart. Returns `false` if a cause was already
    /// recorded, which then stays: a panic while logging is a consequence, not the cause.
    pub fn close(&self, end: End, detail: u32) -> bool {
        let first = self.end.get() == 0;
        if first {
            self.end.set(end as u32);
            self.detail.set(detail);
        }
        first
    }
}

/// A word about whose content the compiler makes no assumptions.
struct Word(UnsafeCell<MaybeUninit<u32>>);

// SAFETY: accesses are volatile and cover a whole word, which none of the chips splits.
unsafe impl Sync for Word {}

impl Word {
    const fn new() -> Self {
        Self(UnsafeCell::new(MaybeUninit::uninit()))
    }

    fn get(&self) -> u32 {
        // SAFETY: the pointer is valid, and every content is a valid u32.
        unsafe { self.0.get().cast::<u32>().read_volatile() }
    }

    fn set(&self, value: u32) {
        // SAFETY: the pointer is valid.
        unsafe { self.0.get().cast::<u32>().write_volatile(value) }
    }
}
