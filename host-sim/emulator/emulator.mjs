// Runs the firmware's image on an emulated RP2040, one exchange with the host per request on
// standard input. All numbers little-endian.
//
// request:  u32 nanoseconds to run; u16 sums of eight conversions of ADC0, ADC1, ADC2; u16 codes of the
//           digital sensors of pressure, gas, and gas of a joint's muscle b, and u16 reading of its encoder
//           (0xffff: no magnet); u8 inputs (1: run line high, 2: converter stalled, 4: a fault of the processor at the beginning, 8: USB cable plugged in, 16: its port open, and times 32: fault of a digital sensor, as
//           in board.mjs); u8 place and u32 number of the instruction there that hangs (0: control, 1: thread,
//           2: other interrupts; number 0: none); u32 number of the flash operation in which power fails
//           (0: none, 0xffffffff: at once) and u16 fraction of its time that has passed, in 1/65535;
//           u16 counts of bytes for the UART and for USB; u8 1: the program at the USB port does not read, 2: the stack
//           overflows at the beginning; these bytes
// response: u32 nanoseconds that the coils of inlet and outlet, of muscle a and of b, were powered; u32 cycles in which the
//           core did not sleep; u32 restarts by the watchdog so far; u32 reads of flash; u32 of them that
//           missed its cache; u32 times that power returned so far; u32 operations of the flash
//           so far; u32 violations of its rules so far; u32 bytes of the stack that no step since the last start has used; u16 duties that these
//           coils are set to, in 1/65535; u8 state (1: fault output, 2: LED, 4: a hang is still to
//           come, 8: in the boot loader, 16: a joint's brake is released); u16 count and bytes each from the UART, from USB, of the USB
//           identity for each time it was plugged in (one line each), and of the log (defmt over RTT)
//
// The first argument is the image, the optional second one the file that keeps the content of the
// flash. The first response is sent without a request, when the image is loaded.

import { readSync, writeSync } from 'node:fs';
import { Board } from './board.mjs';
import { load } from './image.mjs';
import { Kept } from './kept.mjs';

const HEAD_BYTES = 57;

const flash = new Uint8Array(16 * 1024 * 1024).fill(0xff);
const kept = new Kept(process.argv[3]);
try {
  load(process.argv[2], flash);
  kept.load(flash);
} catch (error) {
  process.stderr.write(`${error.message}\n`);
  process.exit(2);
}
const board = new Board(flash);
respond();

const head = Buffer.alloc(35);
let until = 0;
while (fill(head)) {
  until += head.readUInt32LE(0);
  for (let channel = 0; channel < 3; channel++) {
    board.sums[channel] = head.readUInt16LE(4 + 2 * channel);
  }
  board.codes = [10, 12, 14, 16].map((at) => head.readUInt16LE(at));
  const inputs = head[18];
  board.setRunLine(!!(inputs & 1));
  board.stallAdc(!!(inputs & 2));
  board.setParts(inputs >> 5);
  if (inputs & 4) {
    board.fault();
  }
  const instructions = head.readUInt32LE(20);
  if (instructions > 0) {
    board.armHang(head[19], instructions);
  }
  board.setCable(!!(inputs & 8), !!(inputs & 16), !!(head[34] & 1));
  if (head[34] & 2) {
    board.overflowStack();
  }
  const operation = head.readUInt32LE(24);
  if (operation > 0) {
    board.store.armCut(operation, head.readUInt16LE(28) / 65535);
  }
  const [forUart, forUsb] = [30, 32].map((at) => Buffer.alloc(head.readUInt16LE(at)));
  if (!fill(forUart) || !fill(forUsb)) {
    break;
  }
  board.uart.feed(forUart);
  board.usb.feed(forUsb);
  board.run(until);
  kept.save(board.store);
  respond();
}

/** Fills the buffer from standard input; false when the host is gone. */
function fill(buffer) {
  let filled = 0;
  while (filled < buffer.length) {
    const count = readSync(0, buffer, filled, buffer.length - filled, null);
    if (count === 0) {
      return false;
    }
    filled += count;
  }
  return true;
}

function respond() {
  const identities = Buffer.from(board.identities.map((identity) => `${identity}\n`).join(''));
  const parts = [board.uartBytes, board.usbBytes, identities, board.takeLog()];
  board.uartBytes = [];
  board.usbBytes = [];
  board.identities = [];
  const bytes = parts.reduce((length, part) => length + 2 + part.length, HEAD_BYTES);
  const response = Buffer.alloc(bytes);
  board.coils.forEach((coil, i) => response.writeUInt32LE(Math.round(coil.total), 4 * i));
  response.writeUInt32LE(board.busyCycles >>> 0, 16);
  response.writeUInt32LE(board.resets, 20);
  response.writeUInt32LE(board.flashReads >>> 0, 24);
  response.writeUInt32LE(board.flashMisses >>> 0, 28);
  response.writeUInt32LE(board.powerCuts, 32);
  response.writeUInt32LE(board.store.operations, 36);
  response.writeUInt32LE(board.flashViolations + board.store.violations, 40);
  response.writeUInt32LE(board.chip.stackUnused(), 44);
  board.duties.forEach((duty, i) => response.writeUInt16LE(Math.round(duty * 65535), 48 + 2 * i));
  response[56] = board.pins | (board.hang === null ? 0 : 4) | (board.bootLoader ? 8 : 0);
  let at = HEAD_BYTES;
  for (const part of parts) {
    response.writeUInt16LE(part.length, at);
    response.set(part, at + 2);
    at += 2 + part.length;
  }
  board.busyCycles = 0;
  board.flashReads = 0;
  board.flashMisses = 0;
  let written = 0;
  while (written < response.length) {
    written += writeSync(1, response, written);
  }
}
