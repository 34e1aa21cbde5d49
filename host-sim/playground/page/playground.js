// The page: core and plant run, knobs change the plant, plots show the result.
import { Plot } from "./plot.js";
import { Muscle, scaleAround } from "./muscle.js";
import { Simulation } from "./simulation.js";
import scenarios from "./scenarios.js";

const $ = (id) => document.getElementById(id);
/** Seconds of data kept; steps between two points; computing time per frame [ms]. */
const KEPT_S = 620, EVERY = 20, MOST_MS = 14;

/** Displayed quantities, and their columns in the trace. */
const SHOWN = {
  time: "time_s", pressure: "pressure_pa", length: "length_m", gas: "gas_temperature_k", wall: "wall_temperature_k",
  sensor: "sensor_gas_k", estimate: "estimate_k", sd: "estimate_sd_k", inlet: "duty_in", outlet: "duty_out", wanted: "set_point",
};
const columns = Object.fromEntries([...Object.keys(SHOWN), "contraction", "pressureSet", "contractionSet"].map((name) => [name, []]));
const shared = { time: columns.time, columns, span: 20, end: 0, back: null, paused: false, point };

// Knobs

/** Key, name, unit, factor from SI, least, most, digits; where it applies. */
const loaded = (settings) => settings.plant.kind !== "vessel";
const isotonic = (settings) => loaded(settings) && settings.load.kind === "isotonic";
const lifted = (settings) => loaded(settings) && settings.load.kind === "mass";
const driven = (kind) => (settings) => settings.drive.kind === kind && !settings.drive.profile_csv;
const KNOBS = [
  ["drive.pressure_pa", "Set point", "kPa", 1e-3, 110, 600, 0, driven("pressure")],
  ["drive.contraction", "Set point", "%", 100, 0, 22, 1, driven("contraction")],
  ["drive.flow_kg_s", "Set point: flow in and out", "g/s", 1e3, .02, .5, 2, driven("mass-flow")],
  ["drive.period_s", "Period of a stroke", "s", 1, .5, 10, 1, driven("mass-flow")],
  ["supply.pressure_pa", "Supply", "kPa", 1e-3, 150, 1000, 0, () => true],
  ["load.force_n", "Load", "N", 1, 0, 400, 0, isotonic],
  ["load.mass_kg", "Load", "kg", 1, 0, 40, 1, lifted],
  ["heat.scale", "Heat transfer, gas to wall", "×", 1, .1, 4, 2, () => true],
  ["sensor.gas.time_constant_s", "Sensor lag", "s", 1, 0, 15, 2, () => true],
];

let simulation = null, text = "", settings = null, muscleFacts = null;
/** Changed keys and values; and whether one changed only the plant, not the core. */
let turned = new Map(), unconfigured = false;
const number = (key) => key.split(".").reduce((place, name) => place?.[name], settings);

function makeKnobs() {
  const made = KNOBS.filter((knob) => knob[7](settings)).map(([key, name, unit, factor, least, most, digits]) => {
    const label = document.createElement("label");
    const value = document.createElement("output"), slide = document.createElement("input");
    Object.assign(slide, { type: "range", id: key, step: "any", min: least, max: most });
    const show = () => {
      value.textContent = `${(number(key) * factor).toFixed(digits)} ${unit}`;
      label.classList.toggle("turned", turned.has(key));
    };
    slide.value = number(key) * factor;
    slide.addEventListener("input", () => turn(key, +(+slide.value).toFixed(digits) / factor, show));
    label.append(name, value, slide);
    show();
    return label;
  });
  $("knobs").replaceChildren(...made);
}

function turn(key, value, show) {
  attempt(() => {
    // 250 kPa are 250000 Pa, and not 250000.00000000003.
    const rounded = Number(value.toPrecision(12));
    simulation.turn(key, rounded);
    settings = simulation.settings();
    turned.set(key, rounded);
    unconfigured = true;
  });
  show();
  showExport();
}

function showExport() {
  $("exported").textContent = unconfigured
    ? "The present values, for thermyo run scenario.toml: the run starts with them, and its core is configured as here. The trace is bit-identical to that of such a run."
    : "The scenario of this page, for thermyo run scenario.toml. The trace is bit-identical to that of such a run.";
}

/** Shows the reason in the message line if an action is refused. */
function attempt(what) {
  try {
    what();
    wrong("");
    return true;
  } catch (error) {
    wrong(error.message);
    return false;
  }
}

function wrong(message) {
  $("wrong").textContent = message;
  $("wrong").hidden = !message;
}

// From time zero

function begin(scenario) {
  const done = attempt(() => {
    simulation.start(scenario);
    text = scenario;
    turned = new Map();
  });
  if (done) fresh();
  return done;
}

function again() {
  const done = attempt(() => {
    simulation.start(text);
    for (const [key, value] of turned) simulation.turn(key, value, true);
  });
  if (done) fresh();
}

function fresh() {
  settings = simulation.settings();
  unconfigured = false;
  stopped = false;
  due_s = 0;
  for (const values of Object.values(columns)) values.length = 0;
  const { kind } = settings.plant;
  const { rest_length_m, thread_length_m, turns } = settings.muscle;
  muscleFacts = kind === "muscle" ? { rest_length_m, braid: { thread_length_m, turns } } : null;
  $("plot-length").hidden = !muscleFacts;
  // A vessel has neither length nor braid.
  $("muscle").hidden = $("r-length-row").hidden = kind === "vessel";
  plots[1].traces[0].name = kind;
  const warnings = simulation.warnings();
  $("warnings").textContent = warnings;
  $("warnings").hidden = !warnings;
  makeKnobs();
  showExport();
}

// Simulation loop

let rate = 1, before = 0, due_s = 0, stopped = false, measured = { from: 0, simulated_s: 0 };

function frame(now) {
  requestAnimationFrame(frame);
  const passed_s = Math.min(.1, (now - before) / 1e3);
  before = now;
  if (!shared.paused && !stopped && simulation) {
    due_s += passed_s * rate;
    const { step_s } = settings.run;
    const started = performance.now();
    let done = 0;
    while (due_s >= step_s && performance.now() - started < MOST_MS) {
      const steps = Math.min(Math.floor(due_s / step_s + 1e-9), 500);
      if (!attemptAdvance(steps)) break;
      due_s -= steps * step_s;
      done += steps * step_s;
    }
    // A slow machine does not catch up.
    due_s = Math.min(due_s, passed_s * rate);
    measure(now, done);
  }
  draw();
}

function attemptAdvance(steps) {
  try {
    take(simulation.advance(steps, EVERY));
    return true;
  } catch (error) {
    stopped = true;
    wrong(`${error.message}. Start again.`);
    return false;
  }
}

function measure(now, simulated_s) {
  measured.simulated_s += simulated_s;
  if (now - measured.from < 500) return;
  const times = measured.simulated_s / (now - measured.from) * 1e3;
  $("speed").textContent = `${times.toFixed(times < 10 ? 1 : 0)} times real time`;
  measured = { from: now, simulated_s: 0 };
  const [mode, faults] = simulation.state();
  $("mode").textContent = faults ? `${mode}: ${faults}` : mode;
  $("mode").className = faults ? "chip bad" : "chip good";
  $("time").textContent = `${(columns.time.at(-1) ?? 0).toFixed(0)} s`;
}

let places = null;
function take(cells) {
  places ??= Object.entries(SHOWN).map(([name, column]) => [columns[name], simulation.columns.indexOf(column)]);
  const { kind } = settings.drive, rest = muscleFacts?.rest_length_m;
  for (let row = 0; row < cells.length; row += simulation.columns.length) {
    for (const [values, place] of places) values.push(cells[row + place]);
    columns.contraction.push(rest ? 1 - columns.length.at(-1) / rest : null);
    columns.pressureSet.push(kind === "pressure" ? columns.wanted.at(-1) : null);
    columns.contractionSet.push(kind === "contraction" ? columns.wanted.at(-1) : null);
  }
  const surplus = columns.time.findIndex((time) => time > columns.time.at(-1) - KEPT_S);
  // In large pieces: removing from the front moves everything.
  if (surplus > 5000) for (const values of Object.values(columns)) values.splice(0, surplus);
  shared.end = columns.time.at(-1) ?? 0;
}

// Display

const trace = (name, column, colour, factor, more = {}) => ({ name, column, colour, factor, ...more });
const plots = [
  new Plot($("plot-temperature"), "Gas temperature", "K", 2, [
    trace("gas", "gas", "green", 1), trace("sensor", "sensor", "blue", 1),
    trace("estimate", "estimate", "vermillion", 1, { dashed: true, band: "sd" })], 2, shared),
  new Plot($("plot-pressure"), "Pressure, absolute", "kPa", 1, [
    trace("muscle", "pressure", "blue", 1e-3), trace("set point", "pressureSet", "vermillion", 1e-3, { dashed: true })], 10, shared),
  new Plot($("plot-length"), "Contraction", "%", 2, [
    trace("muscle", "contraction", "green", 100), trace("set point", "contractionSet", "vermillion", 100, { dashed: true })], 2, shared),
  new Plot($("plot-duty"), "Valve openings", "%", 0, [
    trace("inlet", "inlet", "blue", 100), trace("outlet", "outlet", "orange", 100)], 100, shared),
];
plots[3].fixed = [-3, 103];
const muscle = new Muscle($("muscle"));
let scale = [288, 308], scaleAt = -Infinity;

function point(back) {
  shared.back = back;
}

function put(id, value, unit) {
  const small = document.createElement("span");
  small.textContent = ` ${unit}`;
  $(id).replaceChildren(value, small);
}

function draw() {
  for (const plot of plots) plot.draw();
  const last = columns.time.length - 1;
  if (last < 0) return;
  const now = Object.fromEntries(Object.entries(columns).map(([name, values]) => [name, values[last]]));
  if (performance.now() - scaleAt > 1000) {
    scaleAt = performance.now();
    let low = Infinity, high = -Infinity;
    for (const name of ["gas", "sensor", "wall"]) {
      for (let i = Math.max(0, last - 1000); i <= last; i++) {
        low = Math.min(low, columns[name][i]);
        high = Math.max(high, columns[name][i]);
      }
    }
    scale = scaleAround(low, high);
  }
  if (!$("muscle").hidden) muscle.draw(now, muscleFacts, scale);
  put("r-pressure", (now.pressure / 1e3).toFixed(1), "kPa");
  put("r-gas", now.gas.toFixed(2), "K");
  put("r-sensor", now.sensor.toFixed(2), "K");
  put("r-estimate", now.estimate.toFixed(2), `± ${(2 * now.sd).toFixed(2)} K`);
  const contracted = now.contraction !== null;
  $("r-length-name").textContent = contracted ? "Length, contraction" : "Length";
  put("r-length", (now.length * 1e3).toFixed(1), contracted ? `mm, ${(now.contraction * 100).toFixed(1)} %` : "mm");
}

// User input

function save(name, content, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}

$("export").addEventListener("click", () => attempt(() => save("scenario.toml", simulation.scenario(), "application/toml")));
$("trace").addEventListener("click", () => attempt(() => save("trace.csv", simulation.trace(simulation.scenario()), "text/csv")));
$("again").addEventListener("click", again);
$("shipped").addEventListener("click", () => begin(text));
$("choice").addEventListener("change", () => begin(scenarios[$("choice").selectedIndex].text));
$("file").addEventListener("change", async ({ target }) => {
  const [file] = target.files;
  target.value = "";
  if (!file || !begin(await file.text())) return;
  scenarios.push({ name: file.name, text });
  $("choice").append(new Option(file.name));
  $("choice").selectedIndex = scenarios.length - 1;
});
for (const radio of document.querySelectorAll("[name=rate]")) radio.addEventListener("change", () => (rate = +radio.value));
for (const radio of document.querySelectorAll("[name=span]")) radio.addEventListener("change", () => (shared.span = +radio.value));
$("pause").addEventListener("click", () => {
  shared.paused = !shared.paused;
  $("pause").setAttribute("aria-pressed", String(shared.paused));
  $("pause").textContent = shared.paused ? "Go on" : "Pause";
  // The old speed does not apply to a page that stands still.
  $("speed").textContent = "";
  measured = { from: performance.now(), simulated_s: 0 };
});

try {
  const module = await fetch("thermyo.wasm");
  if (!module.ok) throw new Error(`thermyo.wasm: ${module.status} ${module.statusText}`);
  simulation = await Simulation.load(await module.arrayBuffer());
  $("choice").append(...scenarios.map(({ name }) => new Option(name)));
  begin(scenarios[0].text);
  requestAnimationFrame((now) => { before = measured.from = now; frame(now); });
} catch (error) {
  $("mode").textContent = "not loaded";
  wrong(`Core and plant could not be loaded: ${error.message}`);
}
