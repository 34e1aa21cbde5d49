// The flash of a Raspberry Pi Pico (W25Q16JV), and the boot ROM functions that write it (RP2040
// datasheet 2.8.3). A ROM function is a breakpoint and a return: rp2040js calls `onBreak` with the
// breakpoint's number. Erasing and programming take time: a second breakpoint repeats itself until
// the flash is done, and interrupts are taken meanwhile, unless the firmware masks them.
//
// Programming only clears bits, erasing only sets them. A power failure leaves every byte of the
// operation either old or new, at random: harsher than the chip.

const BX_LR = 0x4770;
const bkpt = (number) => 0xbe00 | number;
const [LOOKUP, CONNECT, EXIT_XIP, ERASE, PROGRAM, FLUSH, ENTER_XIP, BUSY] = [1, 2, 3, 4, 5, 6, 7, 8];
const [COPY, COPY_WORDS, BOOT_LOADER] = [9, 10, 11];
const TABLE = {
  IF: CONNECT,
  EX: EXIT_XIP,
  RE: ERASE,
  RP: PROGRAM,
  FC: FLUSH,
  CX: ENTER_XIP,
  MC: COPY,
  C4: COPY_WORDS,
  UB: BOOT_LOADER,
};
const FUNCTIONS = 0x100; // 16 bytes for each
const FUNCTION_TABLE = 0x200;
const AT_ONCE = 0xffffffff;
const SECTOR = 4096;
const PAGE = 256;
/** W25Q16JV, 9.6: typical times; at most 400 ms and 3 ms. */
const ERASE_NANOS = 45e6;
const PROGRAM_NANOS = 0.4e6;
const UNIQUE_ID = [0xe6, 0x60, 0x58, 0x38, 0x83, 0x5b, 0x2a, 0x31];
const READ_UNIQUE_ID = 0x4b; // W25Q16JV, 8.2.32
const DUMMY_BYTES = 4;
/** The serial interface: while enabled, flash is read as memory (RP2040 datasheet 4.10.13). */
const SSI = 0x18000;
const SSI_ENABLE = 0x08;
const SSI_DATA = 0x60;
const XIP_CTRL = 0x14000;
const XIP_CTRL_STAT = 8;
const FIFO_EMPTY = 2;

export class FlashChip {
  /** `content`: its bytes, which survive a power failure. */
  constructor(content) {
    this.content = content;
    this.operations = 0;
    this.violations = 0; // operations with a wrong argument, or out of turn
    this.cutIn = 0; // operations until power fails; 0 if it does not
    this.cutDone = 0;
    this.random = 1;
  }

  /** Lets power fail in an operation, after this fraction of its time, or at once. */
  armCut(operation, done) {
    if (operation === AT_ONCE) {
      this.cutAt = this.chip.clock.nanosCounter;
      return;
    }
    this.cutIn = operation;
    this.cutDone = done;
  }

  /** Attaches a chip that has just started; `enterBootLoader` replaces the restart into the boot loader. */
  attach(chip, enterBootLoader) {
    this.chip = chip;
    this.enterBootLoader = enterBootLoader;
    this.busyUntil = 0;
    this.cutAt = Infinity;
    const put = (address, value) => {
      const shift = (address & 2) * 8;
      const word = chip.bootrom[address >> 2];
      chip.bootrom[address >> 2] = (word & ~(0xffff << shift)) | (value << shift);
    };
    const entry = (number) => (FUNCTIONS + 16 * number) | 1;
    put(0x10, 0x754d); // 'M', 'u'
    put(0x12, 0x0201);
    put(0x14, FUNCTION_TABLE);
    put(0x18, entry(LOOKUP));
    for (const number of [LOOKUP, ...Object.values(TABLE)]) {
      const address = entry(number) - 1;
      const slow = number === ERASE || number === PROGRAM;
      put(address, bkpt(number));
      put(address + 2, slow ? bkpt(BUSY) : BX_LR);
      put(address + 4, BX_LR);
    }
    Object.entries(TABLE).forEach(([code, number], i) => {
      put(FUNCTION_TABLE + 4 * i, code.charCodeAt(0) | (code.charCodeAt(1) << 8));
      put(FUNCTION_TABLE + 4 * i + 2, entry(number));
    });
    chip.onBreak = (number) => this.call(number);
    // rp2040js has no such peripheral.
    chip.peripherals[XIP_CTRL] = {
      readUint32: (offset) => (offset === XIP_CTRL_STAT ? FIFO_EMPTY : 0),
      writeUint32Atomic() {},
    };
    this.answerOver(chip.peripherals[SSI]);
  }

  /** Answers commands that are sent to the flash over the serial interface. */
  answerOver(ssi) {
    const read = ssi.readUint32.bind(ssi);
    const write = ssi.writeUint32.bind(ssi);
    let answer = [];
    ssi.writeUint32 = (offset, value) => {
      if (offset === SSI_DATA) {
        answer = (value & 0xff) === READ_UNIQUE_ID ? [...Array(DUMMY_BYTES).fill(0), ...UNIQUE_ID] : [];
      } else if (offset === SSI_ENABLE && value === 1) {
        this.chip.xip = true;
      }
      write(offset, value);
    };
    ssi.readUint32 = (offset) => (offset === SSI_DATA && answer.length > 0 ? answer.shift() : read(offset));
  }

  call(number) {
    const { core, cache } = this.chip;
    const [first, second, third] = core.registers;
    switch (number) {
      case LOOKUP: {
        const code = String.fromCharCode(second & 0xff, (second >> 8) & 0xff);
        core.registers[0] = code in TABLE ? (FUNCTIONS + 16 * TABLE[code]) | 1 : 0;
        return;
      }
      case EXIT_XIP:
        this.chip.xip = false;
        return;
      case FLUSH:
        cache.flush();
        return;
      case ENTER_XIP:
        this.chip.xip = true;
        return;
      case ERASE:
        this.must(first % SECTOR === 0 && second === SECTOR);
        this.begin(first, second, ERASE_NANOS, () => 0xff);
        return;
      case PROGRAM:
        this.must(first % PAGE === 0 && third === PAGE);
        this.begin(first, third, PROGRAM_NANOS, (i) => this.content[first + i] & this.chip.readUint8(second + i));
        return;
      case BUSY:
        this.wait();
        return;
      case COPY:
      case COPY_WORDS:
        for (let i = 0; i < third; i++) {
          this.chip.writeUint8(first + i, this.chip.readUint8(second + i));
        }
        return;
      case BOOT_LOADER:
        this.enterBootLoader();
    }
  }

  must(holds) {
    if (!holds) {
      this.violations++;
    }
  }

  /** Begins to change bytes; `becomes` returns the new value of each. */
  begin(offset, bytes, nanos, becomes) {
    const now = this.chip.clock.nanosCounter;
    this.must(!this.chip.xip && offset + bytes <= this.content.length);
    this.operations++;
    this.busyUntil = now + nanos;
    this.operation = { offset, before: this.content.slice(offset, offset + bytes) };
    for (let i = 0; i < bytes; i++) {
      this.content[offset + i] = becomes(i);
    }
    this.chip.flash.set(this.content.subarray(offset, offset + bytes), offset);
    if (this.cutIn > 0 && --this.cutIn === 0) {
      this.cutAt = now + this.cutDone * nanos;
    }
  }

  /** Returns from the ROM's function when the flash is done; until then the core waits, or is interrupted. */
  wait() {
    const { clock, core } = this.chip;
    if (clock.nanosCounter >= this.busyUntil) {
      return;
    }
    core.PC -= 2;
    if (!core.interruptsUpdated || core.PM) {
      const alarm = clock.nextAlarm === null ? Infinity : clock.nextAlarm.nanos;
      const next = Math.min(alarm, this.busyUntil, this.cutAt, this.chip.until);
      clock.tick(Math.max(0, next - clock.nanosCounter));
    }
  }

  /** Whether power fails now; if so, the unfinished rest of the operation is undone. */
  takeCut() {
    if (this.chip.clock.nanosCounter < this.cutAt) {
      return false;
    }
    this.cutIn = 0;
    if (this.chip.clock.nanosCounter >= this.busyUntil) {
      return true;
    }
    const { offset, before } = this.operation;
    for (let i = 0; i < before.length; i++) {
      if (this.share() >= this.cutDone) {
        this.content[offset + i] = before[i];
      }
    }
    return true;
  }

  /** Reproducible random numbers from 0 to 1: xorshift32 (Marsaglia 2003). */
  share() {
    this.random ^= this.random << 13;
    this.random ^= this.random >>> 17;
    this.random ^= this.random << 5;
    return (this.random >>> 0) / 2 ** 32;
  }
}
