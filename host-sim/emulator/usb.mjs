// A USB host with one serial port (CDC-ACM) at the chip's device controller. rp2040js has one too,
// but clears the AVAILABLE bit of a buffer as soon as the firmware sets it
// (dist/esm/peripherals/usb.js, DPRAMUpdated). The driver of embassy-rp waits for that bit: an
// endpoint would receive 64 old bytes at once, again and again. Here the bit stays until the end of
// the packet, which takes time on a bus at full speed, and a host without data makes the device
// wait.

const SIE_STATUS = 0x50;
const SUSPENDED = 1 << 4;

// Buffer control and endpoint control (RP2040 datasheet 4.1.2.5).
const AVAILABLE = 1 << 10;
const STALL = 1 << 11;
const FULL = 1 << 15;
const LENGTH = 0x3ff;
const ENABLED = 1 << 31;
const BUFFER_CONTROL = 0x80;
const BUFFER_CONTROL_END = 0x100;
const EP0_BUFFER = 0x100;
const EP0_PACKET = 64;

/** Overhead of a bulk transaction: sync, PIDs, address, CRCs, turnaround (USB 2.0, table 5-9). */
const OVERHEAD_BYTES = 13;
const SETUP_BYTES = 8;
const NANOS_PER_BYTE = 8e9 / 12e6;
/** An idle bus is suspended (USB 2.0, 7.1.7.6). */
const SUSPEND_NANOS = 3e6;
/** A device that has not answered after this time is reset and enumerated again. */
const PATIENCE_NANOS = 50e6;
const AFTER_RESET_NANOS = 1e6;
const BETWEEN_REQUESTS_NANOS = 100e3;

const DESCRIPTOR = { device: 1, configuration: 2, string: 3, interface: 4, endpoint: 5 };
const DEVICE_BYTES = 18;
const CONFIGURATION_BYTES = 9;
const CLASS_DATA = 0x0a;
const ENGLISH = 0x0409;

const request = (type, code, value, index, length) => ({
  setup: Uint8Array.from([type, code, value, value >> 8, index, index >> 8, length, length >> 8]),
});
const setAddress = request(0x00, 5, 1, 0, 0);
const configure = request(0x00, 9, 1, 0, 0);
const descriptor = (kind, number, length) =>
  request(0x80, 6, (kind << 8) | number, kind === DESCRIPTOR.string ? ENGLISH : 0, length);
const setLineCoding = { ...request(0x21, 0x20, 0, 0, 7), out: [0x00, 0x10, 0x0e, 0x00, 0, 0, 8] }; // 921 600 baud
const setControlLineState = (open) => request(0x21, 0x22, open ? 3 : 0, 0, 0);

export class UsbHost {
  /** `received` is called with every byte from the device, `ready` with its identity. */
  constructor(chip, received, ready) {
    this.chip = chip;
    this.usb = chip.usbCtrl;
    this.received = received;
    this.ready = ready;
    this.plugged = false;
    this.open = false; // whether a program has the port open
    this.deaf = false; // ... and does not read it
    this.announced = false; // ... as last reported to the device
    this.pulledUp = false; // whether the device is present
    this.armed = new Map(); // buffers that the firmware gave the controller: endpoint and direction, control word
    this.bus = chip.clock.createAlarm(() => this.transact());
    this.next = chip.clock.createAlarm(() => this.startControl());
    this.patience = chip.clock.createAlarm(() => this.reset());
    this.suspend = chip.clock.createAlarm(() => this.setSuspended(true));
    this.forget();
    this.usb.onUSBEnabled = () => {
      this.pulledUp = true;
      this.cableChanged();
    };
    this.usb.onResetReceived = () => this.enumerate();
    this.usb.DPRAMUpdated = (offset, value) => this.bufferWritten(offset, value);
    // rp2040js does not let the firmware clear this bit.
    const write = this.usb.writeUint32.bind(this.usb);
    this.usb.writeUint32 = (offset, value) => {
      if (offset === SIE_STATUS) {
        this.usb.sieStatus &= ~(this.usb.rawWriteValue & SUSPENDED);
      }
      write(offset, value);
    };
  }

  /** Plugs or unplugs the cable; opens or closes the port, whose program may not read. */
  set(plugged, open, deaf) {
    if (plugged !== this.plugged) {
      this.plugged = plugged;
      this.cableChanged();
    }
    this.open = open;
    if (!open) {
      this.queue = [];
    }
    this.sendLineState();
    if (deaf !== this.deaf) {
      this.deaf = deaf;
      this.kick();
    }
  }

  /** Bytes from the program: lost while the port is closed. */
  feed(bytes) {
    if (this.configured && this.open) {
      for (const byte of bytes) {
        this.queue.push(byte);
      }
      this.kick();
    }
  }

  forget() {
    this.configured = false;
    this.announced = false;
    this.controls = [];
    this.control = null;
    this.identity = [];
    this.queue = [];
    this.bulkIn = -1;
    this.bulkOut = -1;
    this.transaction = null;
    for (const alarm of [this.bus, this.next, this.patience, this.suspend]) {
      alarm.cancel();
    }
  }

  cableChanged() {
    if (!this.pulledUp) {
      return;
    }
    if (this.plugged) {
      this.reset();
    } else {
      this.forget();
      this.suspend.schedule(SUSPEND_NANOS);
    }
  }

  setSuspended(suspended) {
    this.usb.sieStatus = suspended ? this.usb.sieStatus | SUSPENDED : this.usb.sieStatus & ~SUSPENDED;
    this.usb.sieStatusUpdated();
  }

  reset() {
    this.forget();
    this.setSuspended(false);
    this.usb.resetDevice(); // takes 10 ms
  }

  enumerate() {
    if (!this.plugged) {
      return;
    }
    this.controls = [
      setAddress,
      descriptor(DESCRIPTOR.device, 0, DEVICE_BYTES),
      descriptor(DESCRIPTOR.configuration, 0, CONFIGURATION_BYTES),
    ];
    this.next.schedule(AFTER_RESET_NANOS);
    this.patience.schedule(PATIENCE_NANOS);
  }

  startControl() {
    const control = this.controls.shift();
    if (control === undefined) {
      this.patience.cancel();
      if (!this.configured) {
        this.configured = true;
        this.ready(this.identity.join(' '));
        this.sendLineState();
      }
      this.kick();
      return;
    }
    const { setup, out } = control;
    const length = setup[6] | (setup[7] << 8);
    this.control = { setup, out, length, in: !!(setup[0] & 0x80), data: [], stage: length === 0 ? 'status' : 'data' };
    this.usb.sendSetupPacket(setup);
    this.kick();
  }

  /** Reports to the device whether its port is open, once it has one. */
  sendLineState() {
    if (this.configured && this.announced !== this.open) {
      this.announced = this.open;
      this.controls.push(setControlLineState(this.open));
      if (this.control === null) {
        this.next.schedule(BETWEEN_REQUESTS_NANOS);
      }
    }
  }

  controlDone() {
    const { setup, data } = this.control;
    this.control = null;
    if (setup[1] === 6 && setup[0] === 0x80 && !this.take(setup[3], data)) {
      this.reset();
      return;
    }
    this.next.schedule(BETWEEN_REQUESTS_NANOS);
  }

  /** Parses a descriptor; returns whether it is of this kind. */
  take(kind, data) {
    if (data.length < 2 || data[1] !== kind) {
      return false;
    }
    const word = (at) => data[at] | (data[at + 1] << 8);
    const hex = (value) => value.toString(16).padStart(4, '0');
    if (kind === DESCRIPTOR.device) {
      this.identity.push(`${hex(word(8))}:${hex(word(10))}`);
      this.strings = [14, 15, 16].map((at) => data[at]).filter((number) => number > 0);
    } else if (kind === DESCRIPTOR.string) {
      this.identity.push(Buffer.from(data.slice(2)).toString('utf16le'));
    } else if (data.length < word(2)) {
      this.controls.push(descriptor(DESCRIPTOR.configuration, 0, word(2)));
    } else {
      this.findEndpoints(data);
      this.controls.push(...this.strings.map((number) => descriptor(DESCRIPTOR.string, number, 255)));
      this.controls.push(configure, setLineCoding);
    }
    return true;
  }

  findEndpoints(data) {
    let isData = false;
    for (let at = 0; at + 1 < data.length && data[at] >= 2; at += data[at]) {
      if (data[at + 1] === DESCRIPTOR.interface) {
        isData = data[at + 5] === CLASS_DATA;
      } else if (data[at + 1] === DESCRIPTOR.endpoint && isData) {
        const number = data[at + 2] & 15;
        if (data[at + 2] & 0x80) {
          this.bulkIn = number;
        } else {
          this.bulkOut = number;
        }
      }
    }
  }

  /** Called when the firmware has written a word of the controller's memory, which rp2040js has already stored. */
  bufferWritten(offset, value) {
    if (offset < BUFFER_CONTROL || offset >= BUFFER_CONTROL_END) {
      return;
    }
    const key = (offset - BUFFER_CONTROL) >> 2; // twice the endpoint, and one for OUT
    if (value & STALL && key <= 1 && this.control !== null) {
      this.reset();
    } else if (value & AVAILABLE) {
      this.armed.set(key, value);
      this.kick();
    } else {
      this.armed.delete(key);
    }
  }

  endpointControl(key) {
    return this.chip.usbDPRAMView.getUint32(4 * key, true);
  }

  /** The next armed buffer that the host can use, in turn; -1 for none. */
  wanted() {
    for (const key of this.armed.keys()) {
      const endpoint = key >> 1;
      const out = !!(key & 1);
      if (endpoint === 0) {
        if (this.control !== null && (this.control.stage === 'data') === (this.control.in !== out)) {
          return key;
        }
      } else if (this.configured && this.announced && this.endpointControl(key) & ENABLED) {
        if (out ? endpoint === this.bulkOut && this.queue.length > 0 : endpoint === this.bulkIn && !this.deaf) {
          return key;
        }
      }
    }
    return -1;
  }

  /** Starts the next transaction if the bus is free. */
  kick() {
    const key = this.transaction === null && this.plugged ? this.wanted() : -1;
    if (key < 0) {
      return;
    }
    const room = this.armed.get(key) & LENGTH;
    const bytes = key === 1 ? SETUP_BYTES : key & 1 ? Math.min(room, this.queue.length) : room;
    this.transaction = { key };
    this.bus.schedule((OVERHEAD_BYTES + bytes) * NANOS_PER_BYTE);
  }

  /** Ends a packet. */
  transact() {
    const { key } = this.transaction;
    this.transaction = null;
    if (this.armed.delete(key)) {
      const endpoint = key >> 1;
      const out = !!(key & 1);
      const { usbDPRAMView: view, usbDPRAM: memory } = this.chip;
      const at = BUFFER_CONTROL + 4 * key;
      const word = view.getUint32(at, true);
      const buffer = endpoint === 0 ? EP0_BUFFER : this.endpointControl(key) & 0xffc0;
      const length = word & LENGTH;
      if (out) {
        const data = endpoint > 0 ? this.queue.splice(0, length) : this.controlOut();
        memory.set(data, buffer);
        view.setUint32(at, ((word & ~(AVAILABLE | LENGTH)) | FULL | data.length) >>> 0, true);
      } else {
        const data = memory.slice(buffer, buffer + length);
        view.setUint32(at, (word & ~(AVAILABLE | FULL)) >>> 0, true);
        if (endpoint > 0) {
          data.forEach((byte) => this.received(byte));
        } else {
          this.control.data.push(...data);
        }
      }
      this.usb.indicateBufferReady(endpoint, out);
      if (endpoint === 0) {
        this.advanceControl(out, length);
      }
    }
    this.kick();
  }

  controlOut() {
    return this.control.stage === 'data' ? this.control.out : [];
  }

  advanceControl(out, length) {
    const { stage, data, length: wanted } = this.control;
    if (stage === 'status') {
      this.controlDone();
    } else if (out || data.length >= wanted || length < EP0_PACKET) {
      this.control.stage = 'status';
    }
  }
}
