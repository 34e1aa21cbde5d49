// Core and plant: the module that `host-sim/playground` is compiled to, its texts and rows as JavaScript has them.

export class Simulation {
  /** From the bytes of `thermyo.wasm`. */
  static async load(bytes) {
    const { instance } = await WebAssembly.instantiate(bytes, {});
    return new Simulation(instance.exports);
  }

  constructor(module) {
    this.module = module;
    module.columns();
    this.columns = this.text().split(",");
  }

  /** The text that came back. */
  text() {
    return new TextDecoder().decode(this.bytes());
  }

  bytes() {
    const { memory, text_place, text_length } = this.module;
    return new Uint8Array(memory.buffer, text_place(), text_length()).slice();
  }

  give(text) {
    const bytes = new TextEncoder().encode(text);
    // The memory may grow, and its buffer be another one, before it is written to.
    const place = this.module.text(bytes.length);
    new Uint8Array(this.module.memory.buffer, place, bytes.length).set(bytes);
  }

  good(is) {
    if (!is) throw new Error(this.text());
  }

  start(scenario) {
    this.give(scenario);
    this.good(this.module.start());
  }

  /** Sets a number of the plant; `configured` starts again, with a core that knows it too. */
  turn(key, value, configured = false) {
    this.give(key);
    this.good(this.module.turn(value, configured));
  }

  /** Goes on; gives the cells of every so many steps, row after row. */
  advance(steps, every) {
    this.good(this.module.advance(steps, every));
    return new Float64Array(this.module.memory.buffer, this.module.rows(), this.module.rows_length());
  }

  settings() {
    this.good(this.module.settings());
    return JSON.parse(this.text());
  }

  state() {
    this.good(this.module.state());
    return this.text().split("\n");
  }

  /** What `thermyo run` would warn of, a line each. */
  warnings() {
    this.good(this.module.warnings());
    return this.text();
  }

  scenario() {
    this.good(this.module.scenario());
    return this.text();
  }

  /** Bytes of the trace that `thermyo run` writes of a scenario. */
  trace(scenario) {
    this.give(scenario);
    this.good(this.module.trace());
    return this.bytes();
  }
}
