// Instructions in RAM that touch registers and RAM alone, as most do, in a loop of their own. rp2040js
// executes all others: of flash, peripherals and special registers, and those that sleep or return from
// an exception. Cycles are those of rp2040js; results and flags are those of the ARMv6-M manual, from
// which rp2040js differs in BLX LR, in the carry of shifts by 0 or by more than 32 in a register, and
// in the overflow of ADCS and SBCS where the carry changes an operand's sign.

const RAM = 0x20000000;
const RAM_BYTES = 0x42000;
const [SP, LR, PC] = [13, 14, 15];

export class Thumb {
  constructor(chip) {
    this.chip = chip;
    this.registers = new Int32Array(chip.core.registers.buffer);
    this.words = new Int32Array(chip.sram.buffer);
    this.halves = new Uint16Array(chip.sram.buffer);
  }

  /**
   * Runs until the clock reaches this time [ns], or until an instruction that rp2040js has to execute. Returns the
   * cycles; none if the first instruction is one for rp2040js, or if an interrupt may be pending.
   */
  run(limit, nanosPerCycle) {
    const { chip, registers: r, words, halves } = this;
    const { clock, core, sram: bytes } = chip;
    if (core.interruptsUpdated) {
      return 0;
    }
    let nanos = clock.nanosCounter;
    let pc = r[PC] & ~1;
    // N is the sign of `negative`, Z whether `zero` is 0.
    let negative = core.N ? -1 : 0;
    let zero = core.Z ? 0 : 1;
    let { C: carry, V: overflow } = core;
    let total = 0;

    run: while (nanos < limit) {
      const at = (pc - RAM) | 0;
      if (at < 0 || at >= RAM_BYTES) {
        break;
      }
      const opcode = halves[at >> 1];
      const low = opcode & 7;
      const middle = (opcode >> 3) & 7;
      let next = pc + 2;
      let cycles = 1;
      switch (opcode >> 11) {
        // LSLS, LSRS, ASRS (immediate)
        case 0b00000: {
          const shift = (opcode >> 6) & 31;
          const input = r[middle];
          if (shift > 0) {
            carry = ((input >>> (32 - shift)) & 1) === 1;
          }
          negative = zero = r[low] = input << shift;
          break;
        }
        case 0b00001: {
          const shift = (opcode >> 6) & 31;
          const input = r[middle];
          carry = ((input >>> (shift - 1)) & 1) === 1; // shift 0 means 32: -1 is 31
          negative = zero = r[low] = shift === 0 ? 0 : input >>> shift;
          break;
        }
        case 0b00010: {
          const shift = (opcode >> 6) & 31;
          const input = r[middle];
          carry = ((input >>> (shift - 1)) & 1) === 1;
          negative = zero = r[low] = input >> (shift === 0 ? 31 : shift);
          break;
        }
        // ADDS, SUBS (register, 3-bit immediate)
        case 0b00011: {
          const a = r[middle];
          const third = (opcode >> 6) & 7;
          const b = opcode & 0x400 ? third : r[third];
          if (opcode & 0x200) {
            const result = (a - b) | 0;
            carry = a >>> 0 >= b >>> 0;
            overflow = ((a ^ b) & (a ^ result)) < 0;
            negative = zero = r[low] = result;
          } else {
            const result = (a + b) | 0;
            carry = result >>> 0 < a >>> 0;
            overflow = ((a ^ result) & (b ^ result)) < 0;
            negative = zero = r[low] = result;
          }
          break;
        }
        // MOVS, CMP, ADDS, SUBS (8-bit immediate)
        case 0b00100:
          negative = zero = r[(opcode >> 8) & 7] = opcode & 0xff;
          break;
        case 0b00101: {
          const a = r[(opcode >> 8) & 7];
          const b = opcode & 0xff;
          const result = (a - b) | 0;
          carry = a >>> 0 >= b;
          overflow = ((a ^ b) & (a ^ result)) < 0;
          negative = zero = result;
          break;
        }
        case 0b00110: {
          const a = r[(opcode >> 8) & 7];
          const result = (a + (opcode & 0xff)) | 0;
          carry = result >>> 0 < a >>> 0;
          overflow = (~a & result) < 0;
          negative = zero = r[(opcode >> 8) & 7] = result;
          break;
        }
        case 0b00111: {
          const a = r[(opcode >> 8) & 7];
          const b = opcode & 0xff;
          const result = (a - b) | 0;
          carry = a >>> 0 >= b;
          overflow = ((a ^ b) & (a ^ result)) < 0;
          negative = zero = r[(opcode >> 8) & 7] = result;
          break;
        }
        case 0b01000: {
          const a = r[low];
          const b = r[middle];
          switch ((opcode >> 6) & 31) {
            case 0b00000: // ANDS
              negative = zero = r[low] = a & b;
              break;
            case 0b00001: // EORS
              negative = zero = r[low] = a ^ b;
              break;
            case 0b00010: { // LSLS
              const shift = b & 0xff;
              if (shift > 0) {
                carry = shift <= 32 && ((a >>> (32 - shift)) & 1) === 1;
              }
              negative = zero = r[low] = shift < 32 ? a << shift : 0;
              break;
            }
            case 0b00011: { // LSRS
              const shift = b & 0xff;
              if (shift > 0) {
                carry = shift <= 32 && ((a >>> (shift - 1)) & 1) === 1;
              }
              negative = zero = r[low] = shift < 32 ? (a >>> shift) | 0 : 0;
              break;
            }
            case 0b00100: { // ASRS
              const shift = Math.min(b & 0xff, 32);
              if (shift > 0) {
                carry = ((a >>> (shift - 1)) & 1) === 1;
              }
              negative = zero = r[low] = a >> Math.min(shift, 31);
              break;
            }
            case 0b00101: { // ADCS
              const result = (a + b + (carry ? 1 : 0)) | 0;
              carry = carry ? result >>> 0 <= a >>> 0 : result >>> 0 < a >>> 0;
              overflow = ((a ^ result) & (b ^ result)) < 0;
              negative = zero = r[low] = result;
              break;
            }
            case 0b00110: { // SBCS
              const result = (a - b - (carry ? 0 : 1)) | 0;
              carry = carry ? a >>> 0 >= b >>> 0 : a >>> 0 > b >>> 0;
              overflow = ((a ^ b) & (a ^ result)) < 0;
              negative = zero = r[low] = result;
              break;
            }
            case 0b00111: { // RORS
              const shift = b & 0xff;
              const result = (a >>> (shift & 31)) | (a << (-shift & 31));
              if (shift > 0) {
                carry = result < 0;
              }
              negative = zero = r[low] = result;
              break;
            }
            case 0b01000: // TST
              negative = zero = a & b;
              break;
            case 0b01001: { // RSBS
              const result = -b | 0;
              carry = b === 0;
              overflow = (b & result) < 0;
              negative = zero = r[low] = result;
              break;
            }
            case 0b01010: { // CMP
              const result = (a - b) | 0;
              carry = a >>> 0 >= b >>> 0;
              overflow = ((a ^ b) & (a ^ result)) < 0;
              negative = zero = result;
              break;
            }
            case 0b01011: { // CMN
              const result = (a + b) | 0;
              carry = result >>> 0 < a >>> 0;
              overflow = ((a ^ result) & (b ^ result)) < 0;
              negative = zero = result;
              break;
            }
            case 0b01100: // ORRS
              negative = zero = r[low] = a | b;
              break;
            case 0b01101: // MULS
              negative = zero = r[low] = Math.imul(a, b);
              break;
            case 0b01110: // BICS
              negative = zero = r[low] = a & ~b;
              break;
            case 0b01111: // MVNS
              negative = zero = r[low] = ~b;
              break;
            // ADD, CMP, MOV (all registers)
            case 0b10000:
            case 0b10001:
            case 0b10010:
            case 0b10011: {
              const d = ((opcode >> 4) & 8) | low;
              const m = (opcode >> 3) & 15;
              const sum = ((d === PC ? pc + 4 : r[d]) + (m === PC ? pc + 4 : r[m])) | 0;
              if (d === PC) {
                next = sum & ~1;
                cycles = 2;
              } else {
                r[d] = d === SP ? sum & ~3 : sum;
              }
              break;
            }
            case 0b10100:
            case 0b10101:
            case 0b10110:
            case 0b10111: {
              const d = ((opcode >> 4) & 8) | low;
              const m = (opcode >> 3) & 15;
              if (d === PC || m === PC) {
                break run;
              }
              const [x, y] = [r[d], r[m]];
              const result = (x - y) | 0;
              carry = x >>> 0 >= y >>> 0;
              overflow = ((x ^ y) & (x ^ result)) < 0;
              negative = zero = result;
              break;
            }
            case 0b11000:
            case 0b11001:
            case 0b11010:
            case 0b11011: {
              const d = ((opcode >> 4) & 8) | low;
              const m = (opcode >> 3) & 15;
              const value = m === PC ? pc + 4 : r[m];
              if (d === PC) {
                next = value & ~1;
                cycles = 2;
              } else {
                r[d] = d === SP ? value & ~3 : value;
              }
              break;
            }
            default: { // BX, BLX
              const m = (opcode >> 3) & 15;
              const target = r[m];
              if (low !== 0 || m === PC || target >>> 28 === 15) {
                break run;
              }
              if (opcode & 0x80) {
                r[LR] = next | 1;
              }
              next = target & ~1;
              cycles = 2;
            }
          }
          break;
        }
        // LDR (literal)
        case 0b01001: {
          const from = ((next + 2) & ~3) + ((opcode & 0xff) << 2) - RAM;
          if (from < 0 || from >= RAM_BYTES) {
            break run;
          }
          r[(opcode >> 8) & 7] = words[from >> 2];
          cycles = 2;
          break;
        }
        // loads and stores (register)
        case 0b01010:
        case 0b01011: {
          const place = (r[middle] + r[(opcode >> 6) & 7] - RAM) | 0;
          if (place < 0 || place >= RAM_BYTES) {
            break run;
          }
          cycles = 2;
          switch ((opcode >> 9) & 7) {
            case 0b000:
              if (place & 3) {
                break run;
              }
              words[place >> 2] = r[low];
              break;
            case 0b001:
              if (place & 1) {
                break run;
              }
              halves[place >> 1] = r[low];
              break;
            case 0b010:
              bytes[place] = r[low];
              break;
            case 0b011:
              r[low] = (bytes[place] << 24) >> 24;
              break;
            case 0b100:
              if (place & 3) {
                break run;
              }
              r[low] = words[place >> 2];
              break;
            case 0b101:
              if (place & 1) {
                break run;
              }
              r[low] = halves[place >> 1];
              break;
            case 0b110:
              r[low] = bytes[place];
              break;
            case 0b111:
              if (place & 1) {
                break run;
              }
              r[low] = (halves[place >> 1] << 16) >> 16;
              break;
          }
          break;
        }
        // STR, LDR, STRB, LDRB, STRH, LDRH (immediate)
        case 0b01100: {
          const place = (r[middle] + ((opcode >> 4) & 0x7c) - RAM) | 0;
          if (place < 0 || place >= RAM_BYTES || place & 3) {
            break run;
          }
          words[place >> 2] = r[low];
          cycles = 2;
          break;
        }
        case 0b01101: {
          const place = (r[middle] + ((opcode >> 4) & 0x7c) - RAM) | 0;
          if (place < 0 || place >= RAM_BYTES || place & 3) {
            break run;
          }
          r[low] = words[place >> 2];
          cycles = 2;
          break;
        }
        case 0b01110: {
          const place = (r[middle] + ((opcode >> 6) & 31) - RAM) | 0;
          if (place < 0 || place >= RAM_BYTES) {
            break run;
          }
          bytes[place] = r[low];
          cycles = 2;
          break;
        }
        case 0b01111: {
          const place = (r[middle] + ((opcode >> 6) & 31) - RAM) | 0;
          if (place < 0 || place >= RAM_BYTES) {
            break run;
          }
          r[low] = bytes[place];
          cycles = 2;
          break;
        }
        case 0b10000: {
          const place = (r[middle] + ((opcode >> 5) & 62) - RAM) | 0;
          if (place < 0 || place >= RAM_BYTES || place & 1) {
            break run;
          }
          halves[place >> 1] = r[low];
          cycles = 2;
          break;
        }
        case 0b10001: {
          const place = (r[middle] + ((opcode >> 5) & 62) - RAM) | 0;
          if (place < 0 || place >= RAM_BYTES || place & 1) {
            break run;
          }
          r[low] = halves[place >> 1];
          cycles = 2;
          break;
        }
        // STR, LDR (relative to SP)
        case 0b10010: {
          const place = (r[SP] + ((opcode & 0xff) << 2) - RAM) | 0;
          if (place < 0 || place >= RAM_BYTES) {
            break run;
          }
          words[place >> 2] = r[(opcode >> 8) & 7];
          cycles = 2;
          break;
        }
        case 0b10011: {
          const place = (r[SP] + ((opcode & 0xff) << 2) - RAM) | 0;
          if (place < 0 || place >= RAM_BYTES) {
            break run;
          }
          r[(opcode >> 8) & 7] = words[place >> 2];
          cycles = 2;
          break;
        }
        // ADR, ADD (SP plus immediate)
        case 0b10100:
          r[(opcode >> 8) & 7] = (pc & ~3) + 4 + ((opcode & 0xff) << 2);
          break;
        case 0b10101:
          r[(opcode >> 8) & 7] = r[SP] + ((opcode & 0xff) << 2);
          break;
        case 0b10110:
          switch ((opcode >> 6) & 31) {
            case 0b00000: // ADD (to SP)
            case 0b00001:
              r[SP] += (opcode & 0x7f) << 2;
              break;
            case 0b00010: // SUB (from SP)
            case 0b00011:
              r[SP] -= (opcode & 0x7f) << 2;
              break;
            case 0b01000: // SXTH, SXTB, UXTH, UXTB
              r[low] = (r[middle] << 16) >> 16;
              break;
            case 0b01001:
              r[low] = (r[middle] << 24) >> 24;
              break;
            case 0b01010:
              r[low] = r[middle] & 0xffff;
              break;
            case 0b01011:
              r[low] = r[middle] & 0xff;
              break;
            case 0b10000: // PUSH
            case 0b10001:
            case 0b10010:
            case 0b10011:
            case 0b10100:
            case 0b10101:
            case 0b10110:
            case 0b10111: {
              let count = 0;
              for (let list = opcode & 0x1ff; list !== 0; list &= list - 1) {
                count++;
              }
              let place = (r[SP] - RAM - 4 * count) | 0;
              if (place < 0 || place + 4 * count > RAM_BYTES) {
                break run;
              }
              r[SP] -= 4 * count;
              for (let i = 0; i < 8; i++) {
                if (opcode & (1 << i)) {
                  words[place >> 2] = r[i];
                  place += 4;
                  cycles++;
                }
              }
              if (opcode & 0x100) {
                words[place >> 2] = r[LR];
              }
              break;
            }
            default:
              break run;
          }
          break;
        case 0b10111: {
          if ((opcode & 0x600) !== 0x400) {
            break run;
          }
          // POP
          let count = 0;
          for (let list = opcode & 0x1ff; list !== 0; list &= list - 1) {
            count++;
          }
          let place = (r[SP] - RAM) | 0;
          if (place < 0 || place + 4 * count > RAM_BYTES) {
            break run;
          }
          if (opcode & 0x100) {
            const target = words[(place >> 2) + count - 1];
            if (target >>> 28 === 15) {
              break run;
            }
            next = target & ~1;
            cycles += 2;
          }
          for (let i = 0; i < 8; i++) {
            if (opcode & (1 << i)) {
              r[i] = words[place >> 2];
              place += 4;
              cycles++;
            }
          }
          r[SP] += 4 * count;
          break;
        }
        // STM, LDM
        case 0b11000:
        case 0b11001: {
          const base = (opcode >> 8) & 7;
          let place = (r[base] - RAM) | 0;
          if (place < 0 || place + 32 > RAM_BYTES || place & 3) {
            break run;
          }
          for (let i = 0; i < 8; i++) {
            if (opcode & (1 << i)) {
              if (opcode & 0x800) {
                r[i] = words[place >> 2];
              } else {
                words[place >> 2] = r[i];
              }
              place += 4;
              cycles++;
            }
          }
          if (!(opcode & (1 << base))) {
            r[base] = place + RAM;
          }
          break;
        }
        // B (conditional)
        case 0b11010:
        case 0b11011: {
          let taken;
          switch ((opcode >> 9) & 7) {
            case 0b000:
              taken = zero === 0;
              break;
            case 0b001:
              taken = carry;
              break;
            case 0b010:
              taken = negative < 0;
              break;
            case 0b011:
              taken = overflow;
              break;
            case 0b100:
              taken = carry && zero !== 0;
              break;
            case 0b101:
              taken = negative < 0 === overflow;
              break;
            case 0b110:
              taken = negative < 0 === overflow && zero !== 0;
              break;
            default:
              break run; // SVC, UDF
          }
          if (taken !== ((opcode & 0x100) !== 0)) {
            next = pc + 4 + ((opcode << 24) >> 23);
            cycles = 2;
          }
          break;
        }
        // B
        case 0b11100:
          next = pc + 4 + ((opcode << 21) >> 20);
          cycles = 2;
          break;
        // BL
        case 0b11110: {
          const second = halves[(at >> 1) + 1];
          if ((second & 0xd000) !== 0xd000) {
            break run;
          }
          const sign = (opcode << 21) >> 31;
          const j1 = ~((second >> 13) ^ sign) & 1;
          const j2 = ~((second >> 11) ^ sign) & 1;
          r[LR] = (pc + 4) | 1;
          next = pc + 4 + ((sign << 24) | (j1 << 23) | (j2 << 22) | ((opcode & 0x3ff) << 12) | ((second & 0x7ff) << 1));
          cycles = 3;
          break;
        }
        default:
          break run;
      }
      pc = next;
      total += cycles;
      nanos += cycles * nanosPerCycle;
    }

    clock.nanosCounter = nanos;
    r[PC] = pc;
    core.N = negative < 0;
    core.Z = zero === 0;
    core.C = carry;
    core.V = overflow;
    return total;
  }
}
