// An RP2040 that reads flash through its cache, started as by the boot ROM (datasheet 2.8.1): the
// second stage boot loader is copied into RAM, sets up the serial interface and enters the program.

import { RP2040 } from 'rp2040js';
import { FlashCache } from './flash_cache.mjs';
import { Regulator } from './regulator.mjs';
import { Thumb } from './thumb.mjs';

const FLASH = 0x10000000;
const FLASH_END = 0x11000000; // end of the cached flash
const FLASH_MIRRORS_END = 0x14000000;
const BOOT2_BYTES = 256;
const BOOT2 = 0x20041f00; // address at which the boot ROM runs it
const RAM = 0x20000000;
const RAM_BYTES = 0x42000;
const NO_MEMORY = 0x1c000000; // from here to RAM (datasheet 2.2)
const VECTORS = 0x10000100; // the first is the initial stack pointer
const UNUSED = 0xa5a5a5a5;

const quiet = { debug() {}, info() {}, warn() {}, error() {} };

export class Chip extends RP2040 {
  /** `flash`: its bytes, 16 MiB as in rp2040js. */
  constructor(flash) {
    super();
    this.logger = quiet;
    this.flash.set(flash);
    this.ramWords = new Uint32Array(this.sram.buffer);
    this.ramHalves = new Uint16Array(this.sram.buffer);
    this.thumb = new Thumb(this);
    this.cache = new FlashCache(this.peripherals[0x18000]);
    this.peripherals[0x40064] = new Regulator(this);
    this.updateClocks(); // to the ring oscillator's
    this.xip = true; // flash can be read
    this.violations = 0; // reads when flash could not be read
    this.lockedUp = false; // only a reset ends a lock-up
  }

  readFlash(address) {
    this.cache.read(address);
    if (!this.xip) {
      this.violations++;
    }
  }

  /** Starts the chip after a reset; `sram` is the content of memory. */
  boot(sram) {
    if (sram !== undefined) {
      this.sram.set(sram);
    }
    this.sram.set(this.flash.subarray(0, BOOT2_BYTES), BOOT2 - RAM);
    this.stackBytes = Math.max(0, super.readUint32(VECTORS) - RAM);
    new Uint32Array(this.sram.buffer, 0, this.stackBytes >> 2).fill(UNUSED);
    this.core.SP = BOOT2;
    this.core.LR = 0; // enters the program, rather than returning to a caller
    this.core.PC = BOOT2;
  }

  /** Bytes at the bottom of the stack that have not been written since the start. */
  stackUnused() {
    const words = this.stackBytes >> 2;
    let unused = 0;
    while (unused < words && this.ramWords[unused] === UNUSED) {
      unused++;
    }
    return 4 * unused;
  }

  /**
   * Pushes come here too. A write below RAM is a fault; the stack that has overflowed cannot take its frame either,
   * and the processor locks up (ARMv6-M, B1.5.14). Other writes of the firmware are never that near.
   */
  writeUint32(address, value) {
    const offset = (address >>> 0) - RAM;
    if (offset >= 0 && offset < RAM_BYTES) {
      this.ramWords[offset >> 2] = value;
      return;
    }
    if (address >= NO_MEMORY && address < RAM) {
      this.lockedUp = true;
      return;
    }
    super.writeUint32(address, value);
  }

  readUint8(address) {
    if (address >= FLASH && address < FLASH_END) {
      this.readFlash(address);
    }
    return super.readUint8(address);
  }

  readUint16(address) {
    const offset = (address >>> 0) - RAM;
    if (offset >= 0 && offset < RAM_BYTES) {
      return this.ramHalves[offset >> 1];
    }
    if (address >= FLASH && address < FLASH_END) {
      this.readFlash(address);
    }
    return super.readUint16(address);
  }

  readUint32(address) {
    const offset = (address >>> 0) - RAM;
    if (offset >= 0 && offset < RAM_BYTES && (offset & 3) === 0) {
      return this.ramWords[offset >> 2];
    }
    if (address >= FLASH && address < FLASH_MIRRORS_END) {
      this.readFlash(address);
    }
    return super.readUint32(address);
  }
}
