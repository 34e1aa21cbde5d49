// A file that keeps the content of the flash without power: the part of a Raspberry Pi Pico's flash
// that the firmware writes, its last four sectors (`memory.x`).

import { existsSync, readFileSync, renameSync, writeFileSync } from 'node:fs';

const START = 2 * 1024 * 1024 - 16 * 1024;
const END = 2 * 1024 * 1024;

export class Kept {
  /** `path`: the file; without one nothing is kept. */
  constructor(path) {
    this.path = path;
    this.operations = 0;
  }

  /** Fills `flash` from the file. */
  load(flash) {
    if (this.path !== undefined && existsSync(this.path)) {
      flash.set(readFileSync(this.path).subarray(0, END - START), START);
    }
  }

  /** Saves changes since the last call; the file is replaced by a complete one. */
  save(store) {
    if (this.path === undefined || store.operations === this.operations) {
      return;
    }
    this.operations = store.operations;
    const part = `${this.path}.part`;
    writeFileSync(part, store.content.subarray(START, END));
    renameSync(part, this.path);
  }
}
