// Loads an image, ELF or UF2, into the chip's flash.

import { readFileSync } from 'node:fs';

const FLASH = 0x10000000;
const FLASH_BYTES = 2 * 1024 * 1024; // of a Raspberry Pi Pico
const UF2_RP2040 = 0xe48bff56;

/** Fills `flash` from the file; throws an Error with advice if it is not an image for the RP2040. */
export function load(path, flash) {
  const file = readFileSync(path);
  if (file.length > 52 && file.readUInt32BE(0) === 0x7f454c46) {
    loadElf(path, file, flash);
  } else if (file.length >= 512 && file.readUInt32LE(0) === 0x0a324655) {
    loadUf2(path, file, flash);
  } else {
    throw new Error(`${path} is neither an ELF nor a UF2 file: give the firmware's image`);
  }
  // The check of the boot ROM (RP2040 datasheet 2.8.1.3.1).
  if (crc32Mpeg2(flash.subarray(0, 252)) !== new DataView(flash.buffer).getUint32(252, true)) {
    throw new Error(
      `${path} is an image for another chip (no RP2040 boot loader): build the firmware with the feature \`pico\``,
    );
  }
}

function put(path, flash, address, bytes) {
  const offset = address - FLASH;
  if (offset < 0 || offset + bytes.length > FLASH_BYTES) {
    throw new Error(`${path} does not lie in the RP2040's flash: build the firmware with the feature \`pico\``);
  }
  flash.set(bytes, offset);
}

function loadElf(path, file, flash) {
  if (file[4] !== 1 || file.readUInt16LE(18) !== 40) {
    throw new Error(`${path} is a program for another processor: give the firmware's image`);
  }
  const table = file.readUInt32LE(28);
  const size = file.readUInt16LE(42);
  for (let i = 0; i < file.readUInt16LE(44); i++) {
    const header = table + i * size;
    const [type, offset, , address, length] = [0, 4, 8, 12, 16].map((at) => file.readUInt32LE(header + at));
    if (type === 1 && length > 0) {
      put(path, flash, address, file.subarray(offset, offset + length));
    }
  }
}

function loadUf2(path, file, flash) {
  for (let block = 0; block + 512 <= file.length; block += 512) {
    const flags = file.readUInt32LE(block + 8);
    if (flags & 0x2000 && file.readUInt32LE(block + 28) !== UF2_RP2040) {
      throw new Error(`${path} is an image for another chip: build the firmware with the feature \`pico\``);
    }
    const start = block + 32;
    put(path, flash, file.readUInt32LE(block + 12), file.subarray(start, start + file.readUInt32LE(block + 16)));
  }
}

function crc32Mpeg2(bytes) {
  let crc = 0xffffffff;
  for (const byte of bytes) {
    crc ^= byte << 24;
    for (let bit = 0; bit < 8; bit++) {
      crc = crc & 0x80000000 ? (crc << 1) ^ 0x04c11db7 : crc << 1;
    }
  }
  return crc >>> 0;
}
