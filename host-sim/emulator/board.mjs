// A Raspberry Pi Pico: the chip, its flash, and the devices at its pins.

import { GPIOPinState } from 'rp2040js';
import { Chip } from './chip.mjs';
import { FlashChip } from './flash_chip.mjs';
import { As5600, connectI2c, Max31865, MAX31865_PINS, Mpr } from './parts.mjs';
import { PacedUart } from './uart.mjs';
import { UsbHost } from './usb.mjs';

const UART0 = { slot: 0x40034, irq: 20 };
const CONTROL_EXCEPTION = 16 + 27; // SWI_IRQ_1, the control task's executor
const HARD_FAULT = 3; // exception number
const ROM_END = 0x4000;
const OVERSAMPLING = 8;
const ADC_NANOS = 2000;
const BRANCH_TO_ITSELF = 0xe7fe;
/** Inlet and outlet of muscle a, and of a joint's muscle b. */
const COILS = [16, 17, 18, 19];
/** GPIO function (datasheet 2.19.2) and enable bit of the PWM slices. */
const FUNCTION_PWM = 4;
const PWM_ENABLE = 1;
/** Override of a pad's output (GPIO control register, datasheet 2.19.6.1): held low. */
const OVERRIDE_LOW = 2;
const RUN_LINE = 14;
const FAULT_OUTPUT = 15;
const BRAKE_RELEASE = 20; // of a joint
const LED = 25;
const RAM = 0x20000000;
/** Reasons for which the chip stops. */
const [TIME_IS_UP, WATCHDOG_BITES, POWER_FAILS] = [0, 1, 2];
/** Places of an injected hang: the control task, the thread's tasks, other interrupts. */
const PLACES = [
  (exception) => exception === CONTROL_EXCEPTION,
  (exception) => exception === 0,
  (exception) => exception !== 0 && exception !== CONTROL_EXCEPTION,
];

export class Board {
  /** `flash`: bytes of the image, 16 MiB as in rp2040js. */
  constructor(flash) {
    this.store = new FlashChip(flash);
    this.sums = [0, 0, 0, 0, 0];
    this.codes = [0, 0, 0, 0]; // of the digital sensors: pressure, gas, gas of a joint's muscle b; its encoder's reading
    this.conversions = [0, 0, 0, 0, 0];
    this.runLine = false;
    this.adcStalled = false;
    this.partFault = 0; // 1, 2: the gas sensor's bus is unplugged, or it does not convert; 3, 4: the same for the pressure sensor; 5: the encoder's bus is unplugged
    this.hang = null; // pending hang: { is: one of PLACES, instructions: number left until it occurs }
    this.uartBytes = [];
    this.usbBytes = [];
    this.identities = []; // USB identity, for each time that the board was plugged in
    this.cable = { plugged: false, open: false, deaf: false };
    this.bootLoader = false;
    this.resets = 0;
    this.powerCuts = 0;
    this.busyCycles = 0;
    this.flashReads = 0;
    this.flashMisses = 0;
    this.flashViolations = 0;
    this.nanos = 0; // since power-up
    this.start();
  }

  /** Starts after a reset; `sram` is the content of memory. */
  start(sram) {
    const chip = new Chip(this.store.content);
    this.store.attach(chip, () => {
      this.bootLoader = true;
      this.restart = true;
    });
    chip.boot(sram);
    const followClock = (hertz) => (this.nanosPerCycle = 1e9 / hertz);
    followClock(chip.clkSys);
    chip.addClockListener(followClock);

    this.uart = new PacedUart(chip, 'UART0', UART0.irq, (byte) => this.uartBytes.push(byte));
    chip.uart[0] = this.uart;
    chip.peripherals[UART0.slot] = this.uart;

    this.usb = new UsbHost(
      chip,
      (byte) => this.usbBytes.push(byte),
      (identity) => this.identities.push(identity),
    );
    this.usb.set(this.cable.plugged, this.cable.open, this.cable.deaf);
    this.restart = false;
    const watchdog = chip.peripherals[0x40058];
    watchdog.onWatchdogTrigger = () => {
      this.restart = true;
      watchdog.alarm.enable = false; // otherwise it would fire again and again at this instant
    };

    chip.adc.onADCRead = (channel) => this.convert(channel);
    this.conversion = chip.clock.createAlarm(() => chip.adc.completeADCRead(this.code, false));
    // The firmware polls the converter. A poll that would last until the end of the conversion
    // takes that time at once: the same time passes in a few instructions instead of fifty.
    const readAdc = chip.adc.readUint32.bind(chip.adc);
    chip.adc.readUint32 = (offset) => {
      if (offset === 0 && chip.adc.busy && !this.adcStalled) {
        chip.clock.tick(Math.max(0, this.conversion.nanos - chip.clock.nanos));
      }
      return readAdc(offset);
    };

    this.coils = COILS.map((pin) => {
      const coil = { high: false, since: 0, total: 0 };
      chip.gpio[pin].addListener((state) => this.coilChanged(coil, state === GPIOPinState.High));
      return coil;
    });
    this.max31865 = MAX31865_PINS.map((pins) => new Max31865(chip, pins));
    Max31865.connect(chip, this.max31865);
    this.mpr = new Mpr(chip);
    this.as5600 = new As5600(chip);
    connectI2c(chip, [this.mpr, this.as5600]);
    this.setParts(this.partFault);
    this.rtt = -1;
    this.started = this.nanos;
    this.chip = chip;
    chip.gpio[RUN_LINE].setInputValue(this.runLine);
  }

  /** The watchdog resets everything but itself and its scratch registers; memory keeps its content. */
  watchdogRestart() {
    const { reason, scratchData } = this.chip.peripherals[0x40058];
    this.startAgain(this.chip.sram);
    const watchdog = this.chip.peripherals[0x40058];
    watchdog.reason = reason;
    watchdog.scratchData.set(scratchData);
    this.resets++;
  }

  /** Power failed: only the content of the flash is left. */
  powerCut() {
    this.startAgain(undefined);
    this.powerCuts++;
  }

  startAgain(sram) {
    this.settleCoils();
    const totals = this.coils.map((coil) => coil.total);
    this.nanos = this.now();
    this.start(sram);
    this.coils.forEach((coil, i) => (coil.total = totals[i]));
  }

  now() {
    return this.started + this.chip.clock.nanosCounter;
  }

  convert(channel) {
    if (this.adcStalled) {
      return;
    }
    // Eight conversions add up to the host's sum, whichever of them is first.
    const n = this.conversions[channel]++ % OVERSAMPLING;
    const sum = this.sums[channel];
    this.code = Math.floor((sum * (n + 1)) / OVERSAMPLING) - Math.floor((sum * n) / OVERSAMPLING);
    this.conversion.schedule(ADC_NANOS);
  }

  coilChanged(coil, high) {
    const now = this.now();
    if (coil.high) {
      coil.total += now - coil.since;
    }
    coil.high = high;
    coil.since = now;
  }

  /** A stalled converter finishes nothing; afterwards it finishes the pending conversion. */
  stallAdc(stalled) {
    const resumed = this.adcStalled && !stalled;
    this.adcStalled = stalled;
    if (resumed && this.chip.adc.busy) {
      this.convert(this.chip.adc.activeChannel);
    }
  }

  /** The processor executes an undefined instruction. */
  fault() {
    this.chip.core.waiting = false;
    this.chip.core.exceptionEntry(HARD_FAULT);
  }

  /** The next word that is pushed is below the stack. */
  overflowStack() {
    this.chip.core.waiting = false;
    this.chip.core.SP = RAM;
  }

  /** Replaces the N-th instruction that is executed at a place from now on by an endless loop. */
  armHang(place, instructions) {
    this.hang = { is: PLACES[place], instructions };
  }

  /** Called before each instruction while a hang is armed. The boot ROM, which is not firmware, is left out. */
  countToHang() {
    const { core } = this.chip;
    if (this.hang.is(core.IPSR) && --this.hang.instructions <= 0 && core.PC >= ROM_END) {
      // At a handler's first instruction the PC still has the vector's lowest bit.
      this.chip.writeUint16(core.PC & ~1, BRANCH_TO_ITSELF);
      this.hang = null;
    }
  }

  countFlashReads() {
    const { reads, misses } = this.chip.cache.takeReads();
    this.flashReads += reads;
    this.flashMisses += misses;
    this.flashViolations += this.chip.violations;
    this.chip.violations = 0;
  }

  settleCoils() {
    for (const coil of this.coils) {
      this.coilChanged(coil, coil.high);
    }
  }

  setRunLine(high) {
    this.runLine = high;
    this.chip.gpio[RUN_LINE].setInputValue(high);
  }

  /** Sets the readings of the digital sensors, from their codes, and their fault. */
  setParts(fault) {
    this.partFault = fault;
    const [pressure, ...gases] = this.codes;
    this.mpr.set(pressure >> 1, fault === 3, fault === 4);
    this.as5600.set(gases.pop(), fault === 5, fault === 7);
    this.max31865.forEach((part, i) => {
      // A fault affects muscle a's sensor.
      const wrong = i === 0 ? fault : 0;
      part.set(gases[i] >> 1, (gases[i] & 1) === 1, wrong === 1, wrong === 2, wrong === 6);
    });
  }

  /** Plugs or unplugs the USB cable; opens or closes its port; whether the program there does not read. */
  setCable(plugged, open, deaf) {
    this.cable = { plugged, open, deaf };
    this.usb.set(plugged, open, deaf);
  }

  pin(number) {
    return this.chip.gpio[number].value === GPIOPinState.High;
  }

  /** Duty of a coil according to the timer's registers. */
  duty(number) {
    const channel = this.chip.pwm.channels[(number >> 1) & 7];
    if (this.chip.gpio[number].outputOverride === OVERRIDE_LOW) {
      return 0;
    }
    if (this.chip.gpio[number].functionSelect !== FUNCTION_PWM || !(channel.csr & PWM_ENABLE)) {
      return this.pin(number) ? 1 : 0;
    }
    const compare = number & 1 ? channel.cc >>> 16 : channel.cc & 0xffff;
    return Math.min(1, compare / (channel.top + 1));
  }

  get duties() {
    return COILS.map((number) => this.duty(number));
  }

  get pins() {
    return (this.pin(FAULT_OUTPUT) ? 1 : 0) | (this.pin(LED) ? 2 : 0) | (this.pin(BRAKE_RELEASE) ? 16 : 0);
  }

  /** Runs until this time since power-up [ns]. */
  run(until) {
    for (const coil of this.coils) {
      coil.total = 0;
    }
    for (;;) {
      const end = this.runChip(until);
      this.countFlashReads();
      if (end === TIME_IS_UP) {
        break;
      } else if (end === POWER_FAILS) {
        this.powerCut();
      } else {
        this.watchdogRestart();
      }
    }
    this.settleCoils();
  }

  /** Returns the reason for which the chip stopped. */
  runChip(until) {
    const { clock, core } = this.chip;
    const end = until - this.started;
    this.chip.until = end;
    if (this.bootLoader) {
      clock.tick(end - clock.nanosCounter);
      return TIME_IS_UP;
    }
    while (clock.nanosCounter < end) {
      if (core.waiting || this.chip.lockedUp) {
        const next = clock.nextAlarm === null ? end : Math.min(clock.nextAlarm.nanos, end);
        clock.tick(next - clock.nanosCounter);
      } else {
        this.busyCycles += this.execute(end);
        if (clock.nextAlarm !== null && clock.nextAlarm.nanos <= clock.nanosCounter) {
          clock.tick(0);
        }
      }
      if (this.restart) {
        return WATCHDOG_BITES;
      }
      if (this.store.takeCut()) {
        return POWER_FAILS;
      }
    }
    return TIME_IS_UP;
  }

  /** Executes instructions, at most until this time [ns] or the next event; returns their cycles. */
  execute(end) {
    const { cache, clock, core, thumb } = this.chip;
    if (this.hang !== null) {
      this.countToHang();
    } else {
      const alarm = clock.nextAlarm === null ? end : Math.min(clock.nextAlarm.nanos, end);
      const cycles = thumb.run(Math.min(alarm, this.store.cutAt), this.nanosPerCycle);
      if (cycles > 0) {
        return cycles;
      }
    }
    const cycles = core.executeInstruction() + cache.takeStalled();
    clock.nanosCounter += cycles * this.nanosPerCycle;
    return cycles;
  }

  /** Takes the log of the firmware out of the ring buffer of its first RTT channel. */
  takeLog() {
    const { sram, sramView } = this.chip;
    if (this.rtt < 0) {
      this.rtt = Buffer.from(sram.buffer).indexOf('SEGGER RTT');
      if (this.rtt < 0) {
        return Buffer.alloc(0);
      }
    }
    const word = (offset) => sramView.getUint32(this.rtt + offset, true);
    const [start, size, write, read] = [word(28) - RAM, word(32), word(36), word(40)];
    if (write === read || size === 0) {
      return Buffer.alloc(0);
    }
    const ring = Buffer.from(sram.buffer, start, size);
    const bytes =
      write > read
        ? Buffer.from(ring.subarray(read, write))
        : Buffer.concat([ring.subarray(read), ring.subarray(0, write)]);
    sramView.setUint32(this.rtt + 40, write, true);
    return bytes;
  }
}
