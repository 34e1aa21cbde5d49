// Calls a function on an emulated chip, whose stack pointer is set. Ends with exit code 1 if the function does not
// return, or does not restore registers and stack.

const RETURN = 0; // no function lies there: reaching it ends the call
const MOST_CYCLES = 20_000_000;

/** Result and cycles of a call with two arguments; an `interrupt` calls the function too. */
export function call(chip, address, values, interrupt) {
  const { clock, core, thumb } = chip;
  // Registers that a function must preserve: r4 to r11 and the stack pointer.
  for (let i = 4; i < 12; i++) {
    core.registers[i] = 0x9e3779b9 * (i + values[0]);
  }
  const kept = core.registers.slice(4, 14);
  core.registers[0] = values[0];
  core.registers[1] = values[1];
  core.LR = RETURN | 1;
  core.PC = address & ~1;
  let cycles = 0;
  for (let instructions = 0; core.PC !== RETURN; instructions++) {
    if (instructions === interrupt?.after) {
      const registers = core.registers.slice();
      const flags = core.APSR;
      call(chip, address, interrupt.arguments);
      core.registers.set(registers);
      core.APSR = flags;
    }
    if (cycles > MOST_CYCLES) {
      process.stderr.write(`the function at 0x${address.toString(16)} does not return\n`);
      process.exit(1);
    }
    // An interrupt comes after a number of instructions, so those before it are counted.
    const counted = instructions < interrupt?.after;
    cycles += (!counted && thumb.run(clock.nanosCounter + MOST_CYCLES, 1)) || core.executeInstruction();
  }
  for (const i of [4, 5, 6, 7, 8, 9, 10, 11, 13]) {
    if (core.registers[i] !== kept[i - 4]) {
      process.stderr.write(`the function at 0x${address.toString(16)} changes r${i}\n`);
      process.exit(1);
    }
  }
  return { result: core.registers[0], cycles };
}
