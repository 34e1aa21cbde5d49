// The regulator of the RP2040's core voltage (datasheet 2.10), which rp2040js leaves out.

import { BasePeripheral } from 'rp2040js';

const VREG = 0x00;
const VREG_AT_RESET = 0xb1; // 1.1 V, enabled
const IN_REGULATION = 1 << 12;
const VSEL_SHIFT = 4;
/** Voltage selections, and the highest clock from each on (datasheet 2.10; Pico SDK 2.1.1). */
const HIGHEST_HERTZ = [
  [0xc, 200e6], // 1.15 V
  [0xb, 133e6], // 1.1 V
];

export class Regulator extends BasePeripheral {
  constructor(chip) {
    super(chip, 'VREG_AND_CHIP_RESET');
    this.vreg = VREG_AT_RESET;
    chip.addClockListener(() => this.check());
  }

  check() {
    const selected = (this.vreg >> VSEL_SHIFT) & 15;
    const [, highest] = HIGHEST_HERTZ.find(([least]) => selected >= least) ?? [0, 0];
    if (this.rp2040.clkSys > highest) {
      throw new Error(`${this.rp2040.clkSys / 1e6} MHz are too fast for the core's voltage`);
    }
  }

  readUint32(offset) {
    return offset === VREG ? this.vreg | IN_REGULATION : 0;
  }

  writeUint32(offset, value) {
    if (offset === VREG) {
      this.vreg = value;
      this.check();
    }
  }
}
