// Parts of the RP2040 that set the pace of a start and that rp2040js leaves out: the divider of the
// ring oscillator (datasheet 2.17), from which the chip runs after a reset, and the regulator of the
// core's voltage (2.10).

import { BasePeripheral } from 'rp2040js';

const DIV = 0x10;
const DIV_PASS = 0xaa0;
const DIV_AT_RESET = 16;
const STATUS = 0x18;
const STABLE = 1 << 31;
const OSCILLATOR_HERTZ = 16 * 6.5e6; // typical, before the divider

export class RingOscillator extends BasePeripheral {
  constructor(chip) {
    super(chip, 'ROSC');
    this.setDivider(DIV_AT_RESET);
  }

  setDivider(divider) {
    this.divider = divider;
    this.rp2040.roscFreq = OSCILLATOR_HERTZ / divider;
    this.rp2040.updateClocks();
  }

  readUint32(offset) {
    return offset === DIV ? DIV_PASS + this.divider : offset === STATUS ? STABLE : 0;
  }

  writeUint32(offset, value) {
    if (offset === DIV) {
      this.setDivider(value - DIV_PASS || 32);
    }
  }
}

const VREG = 0x00;
const VREG_AT_RESET = 0xb1; // 1.1 V, enabled
const IN_REGULATION = 1 << 12;
const VSEL_1_15_V = 0xc;
const HIGHEST_HERTZ = 133e6; // at 1.1 V

export class Regulator extends BasePeripheral {
  constructor(chip) {
    super(chip, 'VREG_AND_CHIP_RESET');
    this.vreg = VREG_AT_RESET;
    chip.addClockListener((hertz) => {
      if (hertz > HIGHEST_HERTZ && ((this.vreg >> 4) & 15) < VSEL_1_15_V) {
        throw new Error(`the core's voltage is too low for ${hertz / 1e6} MHz`);
      }
    });
  }

  readUint32(offset) {
    return offset === VREG ? this.vreg | IN_REGULATION : 0;
  }

  writeUint32(offset, value) {
    if (offset === VREG) {
      this.vreg = value;
    }
  }
}
