// Digital sensors at the Pico's pins, according to their data sheets: two MAX31865 on SPI1, a Honeywell MPR and an ams
// AS5600 on I2C0. Their inputs are updated all the time; they convert at their own times.

import { GPIOPinState } from 'rp2040js';

/** Of muscle a, and of a joint's muscle b. */
export const MAX31865_PINS = [
  { select: 13, ready: 9 },
  { select: 7, ready: 8 },
];
const I2C_PINS = { data: 4, clock: 5 };
const BYTE_NANOS = 8000; // SPI at 1 MHz
const I2C_BYTE_NANOS = 22500; // nine bits at 400 kHz
const I2C_EDGE_NANOS = 2500;

/** Time between two conversions with the filter for 50 Hz, and before the first: the host sets when its mean is
 * complete; this is the upper limit. Where that has ended a conversion, the host's next mean ends the one after it, once
 * the reading could be read. */
const MAX31865_NANOS = 20.5e6;
const MAX31865_LEAST_NANOS = 15e6;
const MAX31865_READ_NANOS = 2e6;
const MAX31865_FIRST_NANOS = 62.5e6;
const MPR_NANOS = 5e6;

/** Analog's MAX31865 (19-6478): registers 0 to 7, written at 0x80 and above. */
export class Max31865 {
  constructor(chip, { select, ready }) {
    this.chip = chip;
    this.select = chip.gpio[select];
    this.ready = chip.gpio[ready];
    this.reading = 0;
    this.unplugged = false;
    this.stuck = false;
    this.readyStuck = false;
    this.registers = [0, 0, 0, 0xff, 0xff, 0, 0, 0];
    this.address = -1;
    this.select.addListener(() => (this.address = -1));
    this.ready.setInputValue(true);
    this.conversion = chip.clock.createAlarm(() => this.convert(MAX31865_READ_NANOS));
    this.earliest = Infinity; // earliest time at which the host's mean may end a conversion
  }

  /** Puts all of them on the chip's SPI1: the one that is selected answers. */
  static connect(chip, parts) {
    let answer = 0xff;
    const done = chip.clock.createAlarm(() => chip.spi[1].completeTransmit(answer));
    chip.spi[1].onTransmit = (byte) => {
      answer = parts.reduce((line, part) => line & part.exchange(byte), 0xff);
      done.schedule(BYTE_NANOS);
    };
  }

  exchange(byte) {
    // An image that does not drive the pin has no such sensor chip.
    const selected = this.select.value === GPIOPinState.Low;
    if (this.unplugged || !selected) {
      return 0xff;
    }
    if (this.address < 0) {
      this.address = byte;
      return 0;
    }
    const register = this.address & 7;
    let answer = 0;
    if (this.address & 0x80) {
      this.write(register, byte);
    } else {
      answer = this.registers[register];
      if (register === 1) {
        this.ready.setInputValue(!this.readyStuck);
      }
    }
    this.address = (this.address & 0x80) | ((register + 1) & 7);
    return answer;
  }

  write(register, byte) {
    if (register === 0) {
      const before = this.registers[0];
      if (byte & 2) {
        this.registers[7] = 0;
        this.registers[2] &= ~1;
      }
      this.registers[0] = byte & ~0x2e;
      const converts = (config) => (config & 0xc0) === 0xc0;
      if (converts(byte) && !converts(before)) {
        this.conversion.schedule(MAX31865_FIRST_NANOS);
      } else if (!converts(byte)) {
        this.conversion.cancel();
        this.earliest = Infinity;
      }
    } else if (register >= 3 && register <= 6) {
      this.registers[register] = byte;
    }
  }

  /** Ends a conversion; the next one may end with a mean of the host after `least` nanoseconds. */
  convert(least) {
    this.conversion.schedule(MAX31865_NANOS);
    this.earliest = this.chip.clock.nanosCounter + least;
    if (this.stuck) {
      return;
    }
    const threshold = (at) => ((this.registers[at] << 8) | this.registers[at + 1]) >> 1;
    const high = this.reading >= threshold(3);
    const low = this.reading <= threshold(5);
    this.registers[7] |= (high ? 0x80 : 0) | (low ? 0x40 : 0);
    const code = (this.reading << 1) | (this.registers[7] ? 1 : 0);
    [this.registers[1], this.registers[2]] = [code >> 8, code & 0xff];
    if (!this.unplugged) {
      this.ready.setInputValue(false);
    }
  }

  /** Whether the wires are connected; otherwise the line is pulled up. */
  set(reading, complete, unplugged, stuck, readyStuck) {
    this.reading = reading;
    this.stuck = stuck;
    this.readyStuck = readyStuck;
    if (readyStuck) {
      this.ready.setInputValue(false);
    }
    if (unplugged && !this.unplugged) {
      this.ready.setInputValue(true);
    }
    this.unplugged = unplugged;
    if (complete && this.chip.clock.nanosCounter > this.earliest) {
      this.convert(MAX31865_LEAST_NANOS);
    }
  }
}

/** Puts chips on the Pico's I2C0: the one whose address is called answers. */
export function connectI2c(chip, parts) {
  const i2c = chip.i2c[0];
  let called;
  let finish = () => {};
  const done = chip.clock.createAlarm(() => finish());
  const after = (nanos, what) => {
    finish = what;
    done.schedule(nanos);
  };
  // A start waits while SDA is low: the bus is busy.
  i2c.onStart = () =>
    after(I2C_EDGE_NANOS, () =>
      parts.some((part) => part.holds > 0) ? i2c.onStart() : i2c.completeStart(),
    );
  i2c.onConnect = (address) => {
    called = parts.find((part) => part.address === address && !part.unplugged);
    called?.begin();
    after(I2C_BYTE_NANOS, () => i2c.completeConnect(called !== undefined));
  };
  i2c.onWriteByte = (byte) => {
    called?.write(byte);
    after(I2C_BYTE_NANOS, () => i2c.completeWrite(true));
  };
  i2c.onReadByte = () => {
    const byte = called?.read() ?? 0xff;
    after(I2C_BYTE_NANOS, () => i2c.completeRead(byte));
  };
  i2c.onStop = () => after(I2C_EDGE_NANOS, () => i2c.completeStop());
}

/** Honeywell MPR (32332628): 0xaa 0 0 starts a measurement; a read returns status and 24 bits. */
export class Mpr {
  constructor(chip) {
    this.address = 0x18;
    this.reading = 0;
    this.unplugged = false;
    this.stuck = false;
    this.busy = false;
    this.output = 0;
    this.conversion = chip.clock.createAlarm(() => this.convert());
  }

  /** Begins a message. */
  begin() {
    this.written = [];
    this.readAt = 0;
  }

  write(byte) {
    this.written.push(byte);
    if (this.written.length === 3 && this.written[0] === 0xaa) {
      this.busy = true;
      this.conversion.schedule(MPR_NANOS);
    }
  }

  read() {
    const status = this.busy ? 0x60 : 0x40;
    const bytes = [status, this.output >> 16, (this.output >> 8) & 0xff, this.output & 0xff];
    return bytes[this.readAt++ % 4];
  }

  convert() {
    if (this.stuck) {
      return;
    }
    this.busy = false;
    this.output = this.reading << 9;
  }

  set(reading, unplugged, stuck) {
    this.reading = reading;
    this.unplugged = unplugged;
    this.stuck = stuck;
  }
}

const AS5600_CONF = 0x07;
const AS5600_STATUS = 0x0b;
const AS5600_RAW_ANGLE = 0x0c;

/** ams AS5600 (DS000365): the first byte written is the address of a register. */
export class As5600 {
  constructor(chip) {
    this.address = 0x36;
    this.unplugged = false;
    this.interrupted = false;
    // Clocks for which it holds SDA: the rest of a byte.
    this.holds = 0;
    this.data = chip.gpio[I2C_PINS.data];
    this.data.setInputValue(true);
    let low = false;
    chip.gpio[I2C_PINS.clock].addListener((state) => {
      if (low && state !== GPIOPinState.Low && this.holds > 0) {
        this.holds--;
        this.data.setInputValue(this.holds === 0);
      }
      low = state === GPIOPinState.Low;
    });
    this.registers = new Uint8Array(0x20);
    this.pointer = 0;
  }

  /** Begins a message. The pointer stays: it is written in another message than the one that reads. */
  begin() {
    this.pointed = false;
  }

  write(byte) {
    if (!this.pointed) {
      this.pointer = byte;
      this.pointed = true;
    } else if (this.pointer === AS5600_CONF || this.pointer === AS5600_CONF + 1) {
      this.registers[this.pointer++] = byte;
    }
  }

  read() {
    const byte = this.registers[this.pointer] ?? 0;
    // The angle may be read again without setting the address.
    this.pointer = this.pointer === AS5600_RAW_ANGLE + 1 ? AS5600_RAW_ANGLE : this.pointer + 1;
    return byte;
  }

  /** Sets the angle, in parts of 4096 of a turn; any other number is that of no magnet. */
  set(reading, unplugged, interrupted) {
    if (unplugged && !this.unplugged) {
      this.registers.fill(0);
    }
    if (interrupted && !this.interrupted) {
      this.holds = 8;
      this.data.setInputValue(false);
    }
    this.interrupted = interrupted;
    this.unplugged = unplugged;
    this.registers[AS5600_STATUS] = reading < 4096 ? 0x20 : 0x10;
    this.registers[AS5600_RAW_ANGLE] = (reading >> 8) & 0x0f;
    this.registers[AS5600_RAW_ANGLE + 1] = reading & 0xff;
  }
}
