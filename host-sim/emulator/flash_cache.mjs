// The RP2040's execution in place: flash behind a cache of 16 KiB, two ways, lines of 8 bytes
// (datasheet 2.6.3.1, 2.6.3.2: a flush takes 16 KiB / 8 / 2 = 1024 cycles). A line is filled by
// halves, 4 bytes at a time, each on its first read; there are no bursts
// (raspberrypi/pico-feedback, issue 307).
//
// The time for a half follows from the serial interface's setting by the second stage boot loader.
// W25Q080: BAUDR = 2, 8 clocks for the address and mode bits, 4 of waiting and 8 for 32 bits by
// four lines, 20 clocks of 2 cycles: 40 cycles, at 125 MHz at least 320 ns according to Klipper's
// PR 6464. In addition the chip is selected and the bus waits: 400 ns were measured for a load that
// misses the cache (oberon-rtk.org/description/flash-memory), 50 cycles with the 2 of the load
// itself.

const SETS = 1024;
const WAYS = 2;
const SELECT_CYCLES = 8;
const CACHED = 0x10; // upper byte of the addresses that the cache serves; 0x11 to 0x13 bypass it

export class FlashCache {
  /** `ssi`: the serial interface to the flash (datasheet 4.10.13). */
  constructor(ssi) {
    this.ssi = ssi;
    this.tags = new Int32Array(SETS * WAYS);
    this.halves = new Uint8Array(SETS * WAYS); // which halves of a line are valid
    this.oldest = new Uint8Array(SETS); // way to replace next
    this.reads = 0;
    this.misses = 0;
    this.stalled = 0; // cycles not yet spent
    this.flush();
  }

  flush() {
    this.tags.fill(-1);
    this.halves.fill(0);
  }

  /** Cycles for 32 bits from the flash. */
  get missCycles() {
    const { baudr, crtlr0, spictlr0 } = this.ssi;
    const lines = 1 << ((crtlr0 >> 21) & 3);
    const bits = ((crtlr0 >> 16) & 31) + 1;
    const address = (((spictlr0 >> 2) & 15) * 4) / lines; // and mode bits
    const wait = (spictlr0 >> 11) & 31;
    return baudr * (address + wait + bits / lines) + SELECT_CYCLES;
  }

  /** Reads an address, within a word. */
  read(address) {
    this.reads++;
    if (address >>> 24 === CACHED && this.hits(address & 0xffffff)) {
      return;
    }
    this.misses++;
    this.stalled += this.missCycles;
  }

  /** Whether the half is in the cache; loads it. */
  hits(offset) {
    const set = (offset >> 3) % SETS;
    const tag = Math.floor((offset >> 3) / SETS);
    const half = 1 << ((offset >> 2) & 1);
    let line = WAYS * set;
    if (this.tags[line] !== tag) {
      line++;
      if (this.tags[line] !== tag) {
        line = WAYS * set + this.oldest[set];
        this.tags[line] = tag;
        this.halves[line] = 0;
      }
    }
    this.oldest[set] = 1 - (line & 1);
    const valid = (this.halves[line] & half) !== 0;
    this.halves[line] |= half;
    return valid;
  }

  /** Cycles that the core has waited since the last call. */
  takeStalled() {
    const { stalled } = this;
    this.stalled = 0;
    return stalled;
  }

  /** Reads and misses since the last call. */
  takeReads() {
    const { reads, misses } = this;
    this.reads = 0;
    this.misses = 0;
    return { reads, misses };
  }
}
