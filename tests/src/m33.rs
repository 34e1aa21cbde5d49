//! The core on an emulated Cortex-M33 (`tests/m33`), as a board.

use crate::guest;
use model_core::control::Mode;
use model_core::{Config, Sample, SetPoint};
use object::{Object, ObjectSection, ObjectSegment, ObjectSymbol, SectionKind};
use rp2350_emu::{Config as EmulatorConfig, Emulator, EmulatorBuilder};
use std::collections::BTreeMap;
use std::mem::offset_of;
use thermyo_boards::link::Link;
use thermyo_protocol::{Answer, HostCommand};
use thermyo_simulation::board::{Board, BoardError, BoardStep};

#[path = "../m33/src/mailbox.rs"]
mod mailbox;
use mailbox::{GUEST, Mailbox, PANICKED, TEST};

/// The boot ROM's size, and the stack until the guest has its own.
const BOOT_ROM: usize = 32 * 1024;
const STACK: u32 = 0x2008_0000;

/// Cycles between two updates of the emulated peripherals, of which the guest uses none.
const QUANTUM: u32 = 1024;

/// Number of looks at the mailbox after which the guest counts as hung.
const PATIENCE: u32 = 10_000;

/// A Cortex-M33 that steps the core.
pub struct EmulatedM33 {
    emulator: Emulator,
    /// Address of the guest's mailbox.
    mailbox: u32,
    link: Link,
    pending: Option<SetPoint>,
    step_cycles: Vec<u32>,
}

impl EmulatedM33 {
    /// Builds and starts the guest for a target.
    pub fn new(target: &str) -> Self {
        let image = guest("m33", target, "m33-guest");
        let file = object::File::parse(&*image).expect("an ELF file");
        let mut emulator = EmulatorBuilder::new(EmulatorConfig::default())
            .step_quantum(QUANTUM)
            .build()
            .expect("the emulator's configuration holds");
        let mut rom = vec![0; BOOT_ROM];
        rom[..4].copy_from_slice(&STACK.to_le_bytes());
        rom[4..8].copy_from_slice(&(file.entry() as u32 | 1).to_le_bytes());
        emulator.load_bootrom(&rom);
        let code = code(&file);
        for segment in file.segments() {
            let mut content = segment.data().expect("the file is whole").to_vec();
            adapt(&mut content, segment.address(), &code);
            emulator.load_image(segment.address() as u32, &content);
        }
        emulator.reset();
        let mailbox = file.symbols().find(|symbol| symbol.name() == Ok("MAILBOX"));
        let mailbox = mailbox.expect("the guest has a mailbox").address() as u32;
        let mut board = Self {
            emulator,
            mailbox,
            link: Link::default(),
            pending: None,
            step_cycles: Vec::new(),
        };
        board.wait();
        board
    }

    /// Cycles of every step so far, of the core alone.
    pub fn step_cycles(&self) -> &[u32] {
        &self.step_cycles
    }

    fn read(&self, offset: usize) -> u32 {
        self.emulator.peek(self.mailbox + offset as u32)
    }

    fn write(&mut self, offset: usize, word: u32) {
        self.emulator.poke(self.mailbox + offset as u32, word);
    }

    /// Runs until it is the test's turn.
    fn wait(&mut self) {
        for _ in 0..PATIENCE {
            self.emulator.step().expect("the guest stays within the emulator");
            match self.read(offset_of!(Mailbox, turn)) {
                TEST => return,
                PANICKED => panic!("the guest has panicked"),
                _ => (),
            }
        }
        panic!("the guest hangs at {:#x}", self.emulator.core(0).regs.r[15]);
    }

    /// Lets the guest carry out a request; returns its sequence number.
    fn exchange(&mut self, command: HostCommand) -> u8 {
        let (sequence, mut frame) = self.link.request(command);
        self.write(offset_of!(Mailbox, length), frame.len() as u32);
        frame.resize(frame.len().next_multiple_of(4), 0);
        for (i, word) in frame.as_chunks().0.iter().enumerate() {
            self.write(offset_of!(Mailbox, bytes) + 4 * i, u32::from_le_bytes(*word));
        }
        self.write(offset_of!(Mailbox, turn), GUEST);
        self.wait();
        let length = self.read(offset_of!(Mailbox, length)) as usize;
        let words = (0..length.div_ceil(4)).map(|i| self.read(offset_of!(Mailbox, bytes) + 4 * i));
        let answer: Vec<u8> = words.flat_map(u32::to_le_bytes).take(length).collect();
        self.link.feed(&answer);
        sequence
    }

    fn ask(&mut self, command: HostCommand) -> Result<(), BoardError> {
        let sequence = self.exchange(command);
        match self.link.take_answer(sequence) {
            Some(Answer::Done { .. }) => Ok(()),
            Some(Answer::Refused(refusal)) => Err(BoardError::Refused(refusal)),
            other => panic!("{other:?}"),
        }
    }
}

impl Board for EmulatedM33 {
    fn name(&self) -> &'static str {
        "m33"
    }

    fn start(&mut self, config: &Config, set_point: SetPoint) -> Result<(), BoardError> {
        self.ask(HostCommand::Configure(*config))?;
        self.ask(HostCommand::Start(set_point))
    }

    fn set(&mut self, set_point: SetPoint) -> Result<(), BoardError> {
        self.pending = Some(set_point);
        Ok(())
    }

    fn step(&mut self, sample: &Sample) -> Result<BoardStep, BoardError> {
        let telemetry = loop {
            self.exchange(HostCommand::Step(*sample));
            self.step_cycles.push(self.read(offset_of!(Mailbox, step_cycles)));
            let telemetry = self.link.take_telemetry().expect("a step is answered by telemetry");
            if telemetry.mode != Mode::StartupCheck {
                break telemetry;
            }
        };
        if let Some(set_point) = self.pending.take() {
            self.ask(HostCommand::Set(set_point))?;
        }
        Ok(BoardStep { telemetry: Some(telemetry), actuation: telemetry.command.into() })
    }
}

/// Addresses at which instructions begin or end: the mapping symbols `$t` and `$d` (ELF for the Arm architecture,
/// 5.5.5), and the sections' ends.
fn code(file: &object::File) -> BTreeMap<u64, bool> {
    let text = file.sections().filter(|section| section.kind() == SectionKind::Text);
    let ends = text.map(|section| (section.address() + section.size(), false));
    let marks = file.symbols().filter_map(|symbol| {
        let code = match symbol.name().ok()?.get(..2)? {
            "$t" => true,
            "$d" => false,
            _ => return None,
        };
        Some((symbol.address(), code))
    });
    // A mark at the end of another section takes precedence.
    ends.chain(marks).collect()
}

/// Re-encodes three kinds of instructions for the emulator. The compiler could avoid them, but then this would not be
/// the code that the boards run.
///
/// - VSEL, VMAXNM, VMINNM: rp2350-emu 0.2.6 takes the lowest bit of the destination from bit 4 of the first
///   halfword and the condition from bits 6:5; they are in bit 6 and bits 5:4 (Armv8-M Architecture
///   Reference Manual, C2.4).
/// - VPUSH, VPOP of double registers: it only supports those of the single registers that they consist of.
/// - PKHBT Rd, Rd, Rm, LSL #16, which it does not support, is BFI Rd, Rm, #16, #16.
fn adapt(content: &mut [u8], address: u64, code: &BTreeMap<u64, bool>) {
    let halfword = |content: &[u8], at: usize| u16::from_le_bytes([content[at], content[at + 1]]);
    let end = address + content.len() as u64;
    for (&start, _) in code.range(address..end).filter(|(_, code)| **code) {
        let next = code.range(start + 1..).next().map_or(end, |(&next, _)| next.min(end));
        let (mut at, stop) = ((start - address) as usize, (next - address) as usize);
        while at + 4 <= stop {
            let (first, second) = (halfword(content, at), halfword(content, at + 2));
            let (as_first, as_second) = match (first, second) {
                (0xfe00..=0xfeff, _) if second & 0x0f10 == 0x0a00 => {
                    (first & !0x70 | (first & 0x30) << 1 | (first & 0x40) >> 2, second)
                }
                (0xed2d | 0xecbd, _) if second & 0x0f00 == 0x0b00 => (first, second & !0x0100),
                (0xeac0..=0xeacf, _)
                    if second & 0xf0f0 == 0x4000 && first & 0xf == second >> 8 & 0xf =>
                {
                    (0xf360 | second & 0xf, second & 0xff00 | 0x1f)
                }
                same => same,
            };
            content[at..at + 2].copy_from_slice(&as_first.to_le_bytes());
            content[at + 2..at + 4].copy_from_slice(&as_second.to_le_bytes());
            // Instructions of four bytes begin with 0b11101, 0b11110 or 0b11111.
            at += if first >> 11 < 0b11101 { 2 } else { 4 };
        }
    }
}
