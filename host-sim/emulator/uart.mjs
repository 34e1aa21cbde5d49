// A PL011 UART whose bytes take time (Arm DDI 0183, RP2040 datasheet 4.2). rp2040js has one
// whose transmitter is infinitely fast and whose transmit interrupt never ends.

import { BasePeripheral } from 'rp2040js';

const DR = 0x00;
const RSR = 0x04;
const FR = 0x18;
const IBRD = 0x24;
const FBRD = 0x28;
const LCR_H = 0x2c;
const CR = 0x30;
const IFLS = 0x34;
const IMSC = 0x38;
const RIS = 0x3c;
const MIS = 0x40;
const ICR = 0x44;
const DMACR = 0x48;

const FLAG_TX_EMPTY = 1 << 7;
const FLAG_RX_FULL = 1 << 6;
const FLAG_TX_FULL = 1 << 5;
const FLAG_RX_EMPTY = 1 << 4;
const FLAG_BUSY = 1 << 3;

const INTERRUPT_OVERRUN = 1 << 10;
const INTERRUPT_TIMEOUT = 1 << 6;
const INTERRUPT_TX = 1 << 5;
const INTERRUPT_RX = 1 << 4;

const FIFO_BYTES = 32;
const LEVELS = [4, 8, 16, 24, 28];

export class PacedUart extends BasePeripheral {
  /** `sent` is called with every byte when its stop bit has been sent. */
  constructor(rp2040, name, irq, sent) {
    super(rp2040, name);
    this.irq = irq;
    this.sent = sent;
    this.tx = [];
    this.shifting = -1;
    this.rx = [];
    this.line = []; // bytes that the host has sent and the receiver has not received
    this.registers = { [IBRD]: 0, [FBRD]: 0, [LCR_H]: 0, [CR]: 0x300, [IFLS]: 0x12, [IMSC]: 0 };
    this.raised = 0;
    this.txAlarm = rp2040.clock.createAlarm(() => this.byteSent());
    this.rxAlarm = rp2040.clock.createAlarm(() => this.byteReceived());
    this.rxBusy = false;
    this.timeout = rp2040.clock.createAlarm(() => {
      if (this.rx.length > 0) {
        this.raised |= INTERRUPT_TIMEOUT;
        this.update();
      }
    });
  }

  /** The divider is read when a byte starts. */
  clkPeriChanged() {}

  /** One start, eight data, one stop bit. */
  get byteNanos() {
    const divider = this.registers[IBRD] + this.registers[FBRD] / 64;
    return (10e9 * 16 * divider) / this.rp2040.clkPeri;
  }

  /** Bytes from the host, which arrive one after the other at the line's speed. */
  feed(bytes) {
    if (!(this.registers[CR] & 1)) {
      return; // no receiver
    }
    for (const byte of bytes) {
      this.line.push(byte);
    }
    if (!this.rxBusy && this.line.length > 0) {
      this.rxBusy = true;
      this.rxAlarm.schedule(this.byteNanos);
    }
  }

  byteReceived() {
    const byte = this.line.shift();
    if (this.rx.length < FIFO_BYTES) {
      this.rx.push(byte);
    } else {
      this.raised |= INTERRUPT_OVERRUN;
    }
    this.rxBusy = this.line.length > 0;
    if (this.rxBusy) {
      this.rxAlarm.schedule(this.byteNanos);
    }
    this.timeout.schedule(3.2 * this.byteNanos); // 32 bits
    this.update();
  }

  byteSent() {
    this.sent(this.shifting);
    const level = LEVELS[this.registers[IFLS] & 7];
    const above = this.tx.length > level;
    this.shifting = this.tx.length > 0 ? this.tx.shift() : -1;
    if (this.shifting >= 0) {
      this.txAlarm.schedule(this.byteNanos);
    }
    if (above && this.tx.length <= level) {
      this.raised |= INTERRUPT_TX;
    }
    this.update();
  }

  update() {
    if (this.rx.length >= LEVELS[(this.registers[IFLS] >> 3) & 7]) {
      this.raised |= INTERRUPT_RX;
    } else {
      this.raised &= ~INTERRUPT_RX;
    }
    this.rp2040.setInterrupt(this.irq, !!(this.raised & this.registers[IMSC]));
  }

  get flags() {
    return (
      (this.tx.length === 0 ? FLAG_TX_EMPTY : 0) |
      (this.tx.length >= FIFO_BYTES ? FLAG_TX_FULL : 0) |
      (this.rx.length === 0 ? FLAG_RX_EMPTY : 0) |
      (this.rx.length >= FIFO_BYTES ? FLAG_RX_FULL : 0) |
      (this.shifting >= 0 ? FLAG_BUSY : 0)
    );
  }

  readUint32(offset) {
    switch (offset) {
      case DR: {
        const byte = this.rx.length > 0 ? this.rx.shift() : 0;
        if (this.rx.length === 0) {
          this.raised &= ~INTERRUPT_TIMEOUT;
        }
        this.update();
        return byte;
      }
      case FR:
        return this.flags;
      case RIS:
        return this.raised;
      case MIS:
        return this.raised & this.registers[IMSC];
      case RSR:
      case ICR:
      case DMACR:
        return 0;
    }
    return this.registers[offset] ?? super.readUint32(offset);
  }

  writeUint32(offset, value) {
    if (offset === DR) {
      if (this.shifting < 0) {
        this.shifting = value & 0xff;
        this.txAlarm.schedule(this.byteNanos);
      } else if (this.tx.length < FIFO_BYTES) {
        this.tx.push(value & 0xff);
      }
    } else if (offset === ICR) {
      this.raised &= ~this.rawWriteValue;
      this.update();
    } else if (offset in this.registers) {
      this.registers[offset] = value;
      this.update();
    } else if (offset !== RSR && offset !== DMACR) {
      super.writeUint32(offset, value);
    }
  }
}
