// Calls functions of the firmware's image, one after the other, on an emulated RP2040 that has run
// only until its start code has copied them into RAM. All numbers u32, little-endian.
//
// request:  address of the function; its two arguments; number of instructions after which an
//           interrupt calls it too, 0 for none; the two arguments of that call
// response: the function's result; its cycles, without those of the interrupt
//
// Ends with exit code 1 as described in `calling.mjs`.

import { readSync, writeSync } from 'node:fs';
import { call } from './calling.mjs';
import { Chip } from './chip.mjs';
import { load } from './image.mjs';

const RAM = 0x20000000;
const RAM_END = 0x20040000;
const STACK = 0x20040000;
const REQUEST_BYTES = 24;
const REQUESTS = 4096;

const flash = new Uint8Array(16 * 1024 * 1024).fill(0xff);
load(process.argv[2], flash);
const chip = new Chip(flash);
chip.boot();
const { core } = chip;
// Once the first instruction in RAM is executed, all of it has been copied.
while (core.PC < RAM || core.PC >= RAM_END) {
  core.executeInstruction();
}
core.SP = STACK;

const input = Buffer.alloc(REQUESTS * REQUEST_BYTES);
const output = Buffer.alloc(REQUESTS * 8);
let filled = 0;
for (;;) {
  const count = readSync(0, input, filled, input.length - filled, null);
  if (count === 0) {
    break;
  }
  filled += count;
  const whole = Math.floor(filled / REQUEST_BYTES);
  for (let i = 0; i < whole; i++) {
    const word = (n) => input.readUInt32LE(i * REQUEST_BYTES + 4 * n);
    const interrupt = word(3) === 0 ? undefined : { after: word(3), arguments: [word(4), word(5)] };
    const { result, cycles } = call(chip, word(0), [word(1), word(2)], interrupt);
    output.writeUInt32LE(result, 8 * i);
    output.writeUInt32LE(cycles, 8 * i + 4);
  }
  let written = 0;
  while (written < 8 * whole) {
    written += writeSync(1, output, written, 8 * whole - written);
  }
  input.copy(input, 0, whole * REQUEST_BYTES, filled);
  filled -= whole * REQUEST_BYTES;
}
