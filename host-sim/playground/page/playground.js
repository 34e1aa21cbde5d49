// The page: core and plant run, knobs change the plant, plots show the result.
import { Live } from "./live.js";
import { Simulation } from "./simulation.js";
import { VIEWS } from "./views.js";
import scenarios from "./scenarios.js";

const $ = (id) => document.getElementById(id);
/** Seconds of data kept; steps between two points; computing time per frame, and least time between two drawings [ms]. */
const KEPT_S = 620, EVERY = 20, MOST_MS = 14, DRAWN_MS = 30;
/** Elements that a view may hide. */
const HIDEABLE = ["plot-length", "muscle", "r-length-row"];

// Knobs

/** The scenario as it was read, and its file's name for messages. */
let text = "", file = "";
let simulation = null, settings = null;
/** The view of the running scenario, and what its drawing has to know of it. */
let view = VIEWS.muscle, facts = null;
/** Changed keys and values; and whether one changed only the plant, not the core. */
let turned = new Map(), unconfigured = false;
const number = (key) => key.split(".").reduce((place, name) => place?.[name], settings);

function makeKnobs() {
  const made = view.knobs.filter((knob) => knob[7](settings)).map(([key, name, unit, factor, least, most, digits]) => {
    const label = document.createElement("label");
    const value = document.createElement("output"), slide = document.createElement("input");
    // Otherwise the label would belong to its first control, the output.
    label.htmlFor = key;
    Object.assign(slide, { type: "range", id: key, step: "any", min: least, max: most });
    const show = () => {
      value.textContent = `${(number(key) * factor).toFixed(digits)} ${unit}`;
      label.classList.toggle("turned", turned.has(key));
    };
    slide.value = number(key) * factor;
    slide.addEventListener("input", () => {
      // A refused value is not shown as if it were taken.
      if (!turn(key, +(+slide.value).toFixed(digits) / factor, show)) slide.value = number(key) * factor;
    });
    label.append(name, value, slide);
    show();
    return label;
  });
  $("knobs").replaceChildren(...made);
}

/** Turns keys together. */
function turnAll(keys, configured) {
  simulation.turn(keys, configured);
  turned = new Map([...turned, ...keys]);
}

/** Returns whether the value is taken. */
function turn(key, value, show) {
  const taken = attempt(() => {
    // 250 kPa are 250000 Pa, and not 250000.00000000003.
    const rounded = Number(value.toPrecision(12));
    turnAll([[key, rounded]], false);
    settings = simulation.settings();
    unconfigured = true;
  });
  show();
  showExport();
  showAddress();
  return taken;
}

function showExport() {
  $("exported").textContent = unconfigured
    ? "The present values, for thermyo run scenario.toml: the run starts with them, and its core is configured as here. The trace is bit-identical to that of such a run."
    : "The scenario of this page, for thermyo run scenario.toml. The trace is bit-identical to that of such a run.";
}

/** Shows the reason in the message line if an action is refused; otherwise why the run has stopped, if it has. */
function attempt(what) {
  try {
    what();
    wrong(stopped);
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

// The address: scenario, changed keys, and whether they apply to the core too

/** Name of the running scenario; none for a file of the user's own, which an address cannot hold. */
let shipped = null;

function showAddress() {
  const fields = new URLSearchParams();
  if (shipped) {
    fields.set("run", shipped);
    for (const [key, value] of turned) fields.set(key, value);
    if (turned.size) fields.set("core", unconfigured ? "before" : "updated");
  }
  const text = fields.toString();
  history.replaceState(null, "", text ? `#${text}` : location.pathname + location.search);
}

/** Starts what the address describes; the first scenario where it describes none. */
function fromAddress() {
  const fields = new URLSearchParams(location.hash.slice(1));
  const index = Math.max(0, scenarios.findIndex(({ name }) => name === fields.get("run")));
  const values = [...fields].map(([key, text]) => [key, Number(text)]).filter(([, value]) => Number.isFinite(value));
  start(index, values, fields.get("core") === "updated");
}

/** Starts a scenario of the list with keys turned, of the core too where it is configured with them. */
function start(index, keys, configured) {
  $("choice").selectedIndex = index;
  if (!run(index)) return false;
  // An address may have keys of another kind of scenario.
  const applies = ([key]) => view.knobs.some((knob) => knob[0] === key && knob[7](settings));
  attempt(() => turnAll(keys.filter(applies), configured));
  settings = simulation.settings();
  unconfigured = turned.size > 0 && !configured;
  makeKnobs();
  showExport();
  showAddress();
  return true;
}

/** Starts a scenario of the list. */
function run(index) {
  const { name, text: scenario, own } = scenarios[index];
  if (!begin(scenario, own ? name : undefined)) return false;
  shipped = own ? null : name;
  showAddress();
  return true;
}

// The tour

/** Text, and the changes of a step: the scenario it starts, the keys it turns, and whether the core gets them. */
const TOUR = [
  { text: "The muscle is filled for 2.5 s, then emptied for 2.5 s. The gas (wide line) swings with every stroke; the sensor, with a lag of 3 s, shows little of it. The estimate follows from pressure, length and that slow sensor.", run: 0, turn: {} },
  { text: "Heat transfer is tripled, in the muscle only: the core still believes the old value. Watch the estimate: wrong by kelvins at first, as its band says, until it has found the new value after some strokes.", run: 0, turn: { "heat.scale": 3 } },
  { text: "Now the core is configured with the same value, and starts again. It knows what it had to find before: the error is small from the first stroke on.", run: 0, turn: { "heat.scale": 3 }, configured: true },
  { text: "A slow sensor, with a lag of 12 s, and the core knows it. The sensor's error is as large as the swing itself; the estimate hardly needs the sensor from stroke to stroke.", run: 0, turn: { "sensor.gas.time_constant_s": 12 }, configured: true },
  { text: "The controller at work: it holds 400 kPa. The gas jumps with the inflow and cools at the wall, and the valves make up for that. Now turn anything.", run: 1, turn: { "drive.pressure_pa": 4e5 } },
];
let step = -1;

function tour(to) {
  step = to;
  const { text: words, run: index, turn: keys, configured } = TOUR[step];
  if (!start(index, Object.entries(keys), configured)) return;
  $("tour-title").textContent = `Step ${step + 1} of ${TOUR.length}`;
  $("tour-text").textContent = words;
  $("tour-next").textContent = step + 1 < TOUR.length ? "Next" : "From the start";
  $("tour-back").hidden = step === 0;
}

// From time zero

function begin(scenario, name = "scenario.toml") {
  const done = attempt(() => {
    simulation.start(scenario, name);
    [text, file] = [scenario, name];
    turned = new Map();
  });
  if (done) fresh();
  return done;
}

function again() {
  const done = attempt(() => {
    simulation.start(text, file);
    turnAll([...turned], true);
  });
  if (done) fresh();
  showAddress();
}

function fresh() {
  settings = simulation.settings();
  unconfigured = false;
  wrong(stopped = "");
  due_s = 0;
  live.clear();
  show();
  const warnings = simulation.warnings();
  $("warnings").textContent = warnings;
  $("warnings").hidden = !warnings;
  makeKnobs();
  showExport();
}

/** Shows the view of the scenario. */
function show() {
  view = settings.joint ? VIEWS.joint : VIEWS.muscle;
  facts = view.facts(settings);
  places = Object.entries(view.columns).map(([name, [column, factor]]) => [name, simulation.columns.indexOf(column), factor]);
  for (const node of document.querySelectorAll("[data-view]")) node.hidden = VIEWS[node.dataset.view] !== view;
  const hidden = view.hidden(settings);
  for (const id of HIDEABLE) $(id).hidden = hidden.includes(id);
  $("trace").textContent = `Save ${view.trace}`;
}

// Simulation loop

let places = [], rate = 1, before = 0, drawn = 0, due_s = 0, stopped = "", measured = { from: 0, simulated_s: 0 };

function frame(now) {
  requestAnimationFrame(frame);
  const passed_s = Math.min(.1, (now - before) / 1e3);
  before = now;
  if (!live.paused && !stopped && simulation) {
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
  if (now - drawn < DRAWN_MS) return;
  drawn = now;
  draw();
}

function attemptAdvance(steps) {
  try {
    take(simulation.advance(steps, EVERY));
    return true;
  } catch (error) {
    wrong(stopped = `${error.message}. Start again.`);
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
  $("time").textContent = `${live.end.toFixed(0)} s`;
}

function take(cells) {
  for (let first = 0; first < cells.length; first += simulation.columns.length) {
    const row = Object.fromEntries(places.map(([name, place, factor]) => [name, cells[first + place] * factor]));
    view.derive(row, settings, facts);
    live.push(row);
  }
  live.trim();
}

// Display

const names = Object.values(VIEWS).flatMap(({ columns, derived }) => [...Object.keys(columns), ...derived]);
const live = new Live(names.filter((name) => name !== "time"), KEPT_S, 5000);
for (const { charts } of Object.values(VIEWS)) for (const chart of charts) live.chart(...chart);
for (const each of Object.values(VIEWS)) {
  const [id, Drawing] = each.drawing;
  each.drawn = new Drawing($(id));
}

function put(id, value, unit) {
  const small = document.createElement("span");
  small.textContent = unit ? ` ${unit}` : "";
  $(id).replaceChildren(value, small);
}

/** Root-mean-square difference of two columns, over the time shown. */
function rms(one, other) {
  const { time, [one]: a, [other]: b } = live.columns, from = live.shown - live.span;
  let squares = 0, count = 0;
  for (let i = time.length - 1; i >= 0 && time[i] >= from; i--) {
    if (time[i] > live.shown || !Number.isFinite(b[i])) continue;
    squares += (a[i] - b[i]) ** 2;
    count++;
  }
  return Math.sqrt(squares / count);
}

function draw() {
  live.draw();
  const { now } = live;
  if (!now) return;
  const [id] = view.drawing;
  if (!$(id).hidden) view.drawn.draw(now, facts);
  for (const reading of view.readings(now, view.errors.map(([one, other]) => rms(one, other)))) put(...reading);
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
$("trace").addEventListener("click", () => attempt(() => save(view.trace, simulation.trace(simulation.scenario()), "text/csv")));
$("again").addEventListener("click", again);
$("shipped").addEventListener("click", () => { if (begin(text, file)) showAddress(); });
$("choice").addEventListener("change", () => run($("choice").selectedIndex));
$("tour-next").addEventListener("click", () => tour((step + 1) % TOUR.length));
$("tour-back").addEventListener("click", () => tour(step - 1));
addEventListener("hashchange", fromAddress);
$("file").addEventListener("change", async ({ target }) => {
  const [chosen] = target.files;
  target.value = "";
  if (!chosen || !begin(await chosen.text(), chosen.name)) return;
  scenarios.push({ name: file, text, own: true });
  $("choice").append(new Option(file));
  $("choice").selectedIndex = scenarios.length - 1;
  shipped = null;
  showAddress();
});
for (const radio of document.querySelectorAll("[name=rate]")) radio.addEventListener("change", () => (rate = +radio.value));
$("pause").addEventListener("click", () => {
  // The old speed does not apply to a paused page.
  $("speed").textContent = "";
  measured = { from: performance.now(), simulated_s: 0 };
});

try {
  const module = await fetch("thermyo.wasm");
  if (!module.ok) throw new Error(`thermyo.wasm: ${module.status} ${module.statusText}`);
  simulation = await Simulation.load(await module.arrayBuffer());
  $("choice").append(...scenarios.map(({ name }) => new Option(name)));
  fromAddress();
  requestAnimationFrame((now) => { before = measured.from = now; frame(now); });
} catch (error) {
  $("mode").textContent = "not loaded";
  wrong(`Core and plant could not be loaded: ${error.message}`);
}
