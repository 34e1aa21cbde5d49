// A program in the memory of an emulated RP2040, whose functions are called one after the other. All
// numbers u32, little-endian.
//
// request:  address of the function, 0 for none; address of its data; number of bytes to write there
//           before the call; number of bytes to read there after it; the bytes to write
// response: the function's result; its cycles; the bytes read
//
// Ends with exit code 1 as described in `calling.mjs`.

import { readSync, writeSync } from 'node:fs';
import { call } from './calling.mjs';
import { Chip } from './chip.mjs';

const RAM = 0x20000000;
const STACK = 0x20040000;
const FLASH_BYTES = 16 * 1024 * 1024;

const chip = new Chip(new Uint8Array(FLASH_BYTES));
chip.core.SP = STACK;

for (let header = take(16); header !== undefined; header = take(16)) {
  const [address, place, writes, reads] = [0, 4, 8, 12].map((at) => header.readUInt32LE(at));
  chip.sram.set(take(writes), place - RAM);
  const { result, cycles } = address === 0 ? { result: 0, cycles: 0 } : call(chip, address, [0, 0]);
  const response = Buffer.alloc(8 + reads);
  response.writeUInt32LE(result >>> 0, 0);
  response.writeUInt32LE(cycles, 4);
  response.set(chip.sram.subarray(place - RAM, place - RAM + reads), 8);
  for (let written = 0; written < response.length; ) {
    written += writeSync(1, response, written);
  }
}

/** That many bytes of the input; undefined at its end. */
function take(count) {
  const bytes = Buffer.alloc(count);
  for (let filled = 0; filled < count; ) {
    const more = readSync(0, bytes, filled, count - filled, null);
    if (more === 0) {
      return undefined;
    }
    filled += more;
  }
  return bytes;
}
