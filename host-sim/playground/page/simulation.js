// Core and plant: wraps the module of `host-sim/playground`, with texts and rows as JavaScript
// values.

export class Simulation {
  /** Instantiates the bytes of `thermyo.wasm`. */
  static async load(bytes) {
    const { instance } = await WebAssembly.instantiate(bytes, {});
    return new Simulation(instance.exports);
  }

  constructor(module) {
    this.module = module;
    /** Names of the columns of the started scenario's rows. */
    this.columns = [];
  }

  /** The result of the last call. */
  text() {
    return new TextDecoder().decode(this.bytes());
  }

  bytes() {
    const { memory, text_place, text_length } = this.module;
    return new Uint8Array(memory.buffer, text_place(), text_length()).slice();
  }

  give(text) {
    const bytes = new TextEncoder().encode(text);
    // The call may grow the memory and so replace its buffer, so it comes before the write.
    const place = this.module.text(bytes.length);
    new Uint8Array(this.module.memory.buffer, place, bytes.length).set(bytes);
  }

  good(is) {
    if (!is) throw new Error(this.text());
  }

  /** Starts a scenario; messages name it by its file. */
  start(scenario, file) {
    this.give(file);
    this.good(this.module.name());
    this.give(scenario);
    this.good(this.module.start());
    this.good(this.module.columns());
    this.columns = this.text().split(",");
  }

  /** Sets numbers of the plant, all or none; `configured` starts again, with a core that is configured with them too. */
  turn(values, configured = false) {
    this.give(values.map(([key, value]) => `${key}=${value}`).join("\n"));
    this.good(this.module.turn(configured));
  }

  /** Runs `steps`; returns the cells of every `every`-th row, row after row. */
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

  /** Warnings of `thermyo run`, a line each. */
  warnings() {
    this.good(this.module.warnings());
    return this.text();
  }

  scenario() {
    this.good(this.module.scenario());
    return this.text();
  }

  /** Bytes of the trace that `thermyo run` writes for a scenario. */
  trace(scenario) {
    this.give(scenario);
    this.good(this.module.trace());
    return this.bytes();
  }
}
