// Every instruction of 16 bits, and BL, in random states: the emulator's own loop against rp2040js, step by step.
// Where rp2040js has faults, the manual's result is computed here. Prints the number of instructions compared;
// exit code 1 with the first difference.

import { Chip } from '../../host-sim/emulator/chip.mjs';

const RAM = 0x20000000;
const CODE = 0x20010000;
const DATA = 0x20020000;
const STATES = 24;
const BLX_LR = 0x47f0; // rp2040js overwrites its target first
const [SHIFTS, ADCS, SBCS] = [[0b0100000010, 0b0100000011, 0b0100000100, 0b0100000111], 0b0100000101, 0b0100000110];

let seed = 0x2545f491;
/** Reproducible random numbers of 32 bits: xorshift32 (Marsaglia 2003). */
function random() {
  seed ^= seed << 13;
  seed ^= seed >>> 17;
  seed ^= seed << 5;
  return seed >>> 0;
}

const erased = () => new Chip(new Uint8Array(16 * 1024 * 1024).fill(0xff));
const [own, other] = [erased(), erased()];
let written = []; // places to which rp2040js wrote
for (const bits of [8, 16, 32]) {
  const write = other[`writeUint${bits}`].bind(other);
  other[`writeUint${bits}`] = (address, value) => {
    written.push((address >>> 0) - RAM);
    write(address, value);
  };
}
for (let i = 0; i < own.ramWords.length; i++) {
  own.ramWords[i] = other.ramWords[i] = random();
}

/** A value for a register: an address in RAM, a small number, an edge, or any. */
function value() {
  switch (random() & 7) {
    case 0:
    case 1:
      return DATA + (random() & 0xffc);
    case 2:
      return random() & 0x3f;
    case 3:
      return [0, 1, 0x7fffffff, 0x80000000, 0xffffffff][random() % 5];
    case 4:
      return DATA + (random() & 0xfff);
    default:
      return random();
  }
}

function prepare() {
  const registers = Array.from({ length: 13 }, value);
  registers.push(DATA + 0x800 + (random() & 0x7c), value(), CODE);
  const flags = random();
  for (const { core } of [own, other]) {
    core.registers.set(registers);
    core.APSR = flags & 0xf0000000;
    core.interruptsUpdated = false;
  }
  return registers;
}

/** Carry after a shift by a register, or overflow after an addition, by the manual; else what rp2040js has. */
function flags(opcode, registers, before) {
  let { C, V } = other.core;
  const [a, b] = [registers[opcode & 7], registers[(opcode >> 3) & 7]];
  const kind = opcode >> 6;
  const shift = b & 0xff;
  if (SHIFTS.includes(kind) && shift === 0) {
    C = before;
  } else if (kind === SHIFTS[0] && shift > 32) {
    C = false;
  } else if (kind === ADCS || kind === SBCS) {
    const exact = kind === ADCS ? (a | 0) + (b | 0) + before : (a | 0) - (b | 0) - 1 + before;
    V = exact !== (exact | 0);
  }
  return { C, V };
}

const state = ({ core }) => [...core.registers, core.N, core.Z];
let compared = 0;
for (let opcode = 0; opcode < 0x10000; opcode++) {
  for (let n = 0; n < STATES; n++) {
    const registers = prepare();
    const before = own.core.C ? 1 : 0;
    const second = random() & 0xffff;
    for (const chip of [own, other]) {
      chip.ramHalves[(CODE - RAM) >> 1] = opcode;
      chip.ramHalves[((CODE - RAM) >> 1) + 1] = second;
    }
    const cycles = own.thumb.run(own.clock.nanosCounter + 1, 1);
    if (cycles === 0) {
      // Left to rp2040js: untouched.
      same([...registers], [...own.core.registers], opcode);
      continue;
    }
    written = [];
    const wanted = other.core.executeInstruction();
    if (opcode === BLX_LR) {
      other.core.PC = registers[14] & ~1;
    }
    const { C, V } = flags(opcode, registers, before === 1);
    const places = [...new Set(written)];
    const words = (chip) => places.map((place) => chip.ramWords[place >> 2]);
    same([wanted, ...state(other), C, V, ...words(other)], [cycles, ...state(own), own.core.C, own.core.V, ...words(own)], opcode);
    compared++;
  }
}
same([...other.ramWords], [...own.ramWords], 'all of RAM');
console.log(compared);

function same(wanted, found, what) {
  const at = wanted.findIndex((one, i) => one !== found[i]);
  if (at >= 0) {
    console.log(`${what.toString(16)}: value ${at} is ${found[at]} and not ${wanted[at]}`);
    process.exit(1);
  }
}
