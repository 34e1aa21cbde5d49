// Runs the firmware's image on an emulated RP2040, one exchange with the host per request on standard
// input. All numbers little end first.
//
// request:  u32 nanoseconds to run; u16 sums of eight conversions of ADC0, ADC1, ADC2; u8 inputs
//           (1: run line high, 2: converter stalled, 4: a fault of the processor at the beginning); u8 place and u32 number of the instruction there
//           that is to hang (0: control, 1: thread, 2: other interrupts; number 0: none); u16 count
//           and bytes for the UART
// response: u32 nanoseconds that the inlet's and the outlet's coil were powered; u32 cycles in which the
//           core did not sleep; u32 restarts by the watchdog so far; u16 duties that inlet's and outlet's
//           coil are set to, in 1/65535; u8 state (1: fault output, 2: LED, 4: a hang is still to
//           come); u16 count and bytes from the UART; u16 count and bytes of the log (defmt over RTT)
//
// The first response comes of its own accord, when the image is in place.

import { readSync, writeSync } from 'node:fs';
import { Board } from './board.mjs';
import { load } from './image.mjs';

const flash = new Uint8Array(16 * 1024 * 1024).fill(0xff);
try {
  load(process.argv[2], flash);
} catch (error) {
  process.stderr.write(`${error.message}\n`);
  process.exit(2);
}
const board = new Board(flash);
respond();

const head = Buffer.alloc(18);
let until = 0;
while (fill(head)) {
  until += head.readUInt32LE(0);
  for (let channel = 0; channel < 3; channel++) {
    board.sums[channel] = head.readUInt16LE(4 + 2 * channel);
  }
  const inputs = head[10];
  board.setRunLine(!!(inputs & 1));
  board.stallAdc(!!(inputs & 2));
  if (inputs & 4) {
    board.fault();
  }
  const instructions = head.readUInt32LE(12);
  if (instructions > 0) {
    board.armHang(head[11], instructions);
  }
  const bytes = Buffer.alloc(head.readUInt16LE(16));
  if (!fill(bytes)) {
    break;
  }
  board.uart.feed(bytes);
  board.run(until);
  respond();
}

/** Whether the buffer was filled; no when the host is gone. */
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
  const uart = board.uartBytes;
  board.uartBytes = [];
  const log = board.takeLog();
  const response = Buffer.alloc(21 + 2 + uart.length + 2 + log.length);
  board.coils.forEach((coil, i) => response.writeUInt32LE(Math.round(coil.total), 4 * i));
  response.writeUInt32LE(board.busyCycles >>> 0, 8);
  response.writeUInt32LE(board.resets, 12);
  board.duties.forEach((duty, i) => response.writeUInt16LE(Math.round(duty * 65535), 16 + 2 * i));
  response[20] = board.pins | (board.hang === null ? 0 : 4);
  response.writeUInt16LE(uart.length, 21);
  response.set(uart, 23);
  response.writeUInt16LE(log.length, 23 + uart.length);
  log.copy(response, 25 + uart.length);
  board.busyCycles = 0;
  let written = 0;
  while (written < response.length) {
    written += writeSync(1, response, written);
  }
}
