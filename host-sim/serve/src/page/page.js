// The page: shows the server's messages and sends the user's orders.
import { Live } from "./live.js";
import * as ofJoint from "./of_joint.js";
import * as ofMuscle from "./of_muscle.js";
import { chosen, digits, format, parse, shownIn, symbol, unit, units, withUnit } from "./quantities.js";

/** The part of what the board drives. */
const subject = document.documentElement.dataset.kind === "joint" ? ofJoint : ofMuscle;
const { scaled, modes, kept, words } = subject;
const $ = (id) => document.getElementById(id);
/** Seconds of data kept; time after which a quiet link is reported [ms]. */
const KEPT_S = 125, QUIET_MS = 700;

/** The browser's stores for units and for plots; none where it is set to keep nothing. */
const [unitStore, plotStore] = ["localStorage", "sessionStorage"].map((name) => {
  try {
    return window[name];
  } catch {
    return null;
  }
});

let socket = null, received = 0, heard = 0, open = false;
let state = null, own = { steers: false, pages: 1, lost_frames: 0 };
let due = false, rested = 0;

// Units

function choose(si, name) {
  const { chart, least, columns, fields, mode: own } = scaled[si], [, one, zero] = unit(si);
  const ofMode = ["first", "second"].filter((place) => own && modes[own][place]?.[1] === si);
  const texts = [...fields, ...(mode === own ? ofMode : [])].map((id) => $(id));
  const values = texts.map((field) => parse(field.value, si)), ofKept = ofMode.map((_, i) => parse(kept[own][i], si));
  chosen[si] = name;
  unitStore?.setItem(`unit ${si}`, name);
  live.rescale(chart, { unit: symbol(si), digits: digits(si), least: least / unit(si)[1] }, columns, (value) => shownIn(si, value * one + zero));
  texts.forEach((field, i) => { if (values[i] !== null) field.value = format(si, values[i]); });
  ofKept.forEach((value, i) => { if (value !== null) kept[own][i] = format(si, value); });
  for (const place of document.querySelectorAll(`[data-unit="${si}"]`)) place.textContent = symbol(si);
  if (state) showState();
  draw();
}

// The link

function connect() {
  const address = new URL("live", location.href);
  address.protocol = "ws:";
  socket = new WebSocket(address);
  received = 0;
  socket.onopen = () => { open = true; showLink(); };
  socket.onclose = () => {
    open = false;
    // Nothing can be vented or taken over now.
    $("watching").hidden = true;
    showLink();
    if (state) showState();
    setTimeout(connect, 500);
  };
  socket.onmessage = ({ data }) => {
    received += 1;
    const message = JSON.parse(data);
    if (message.kind === "frame") take(message);
    else if (message.kind === "state") { state = message; showState(); }
    else { own = message; showOwn(); }
    say({ seen: received });
  };
}

function say(word) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(word));
}

function order(what) {
  say({ order: what });
}

/** A value that the board does not have is a gap. */
const known = (cell) => (Array.isArray(cell) ? cell.map(known) : cell ?? NaN);

function take(frame) {
  heard = performance.now();
  for (const cells of frame.rows) live.push(subject.row(cells.map(known), state?.configuration));
  live.trim();
  showMode(frame);
  showLink();
  draw();
}

function draw() {
  if (due) return;
  due = true;
  setTimeout(() => requestAnimationFrame(() => {
    const start = performance.now();
    due = false;
    live.draw();
    showReadings();
    // For five times as long as it draws, a slow machine answers the server, which vents a page that does not.
    rested = 6 * performance.now() - 5 * start;
  }), rested - performance.now());
}

// Charts and readings

const live = new Live(subject.columns, KEPT_S, 500);
for (const chart of subject.charts) live.chart(...chart);

function showReadings() {
  if (live.now) subject.showReadings(live.now, state?.configuration);
}

// Messages of the server

let shownMode = "";
function showMode({ mode, limited, valid }) {
  // It may be another page's vent, or the board's own.
  if (mode === "vent" && !vented) letGo = true;
  vented = mode === "vent";
  shownMode = limited ? `${mode}, limited` : mode;
  for (const [id, relied] of subject.gases(valid)) {
    $(id).className = relied ? "" : "invalid";
    $(id).title = relied ? "" : "Not to be relied on: its deviation is large";
  }
}

function showLink() {
  const quiet = performance.now() - heard > QUIET_MS;
  const { what, vents, alone } = words;
  const [text, why] = !open ? ["no server", `The server does not answer. A ${what} that was driven ${alone}.`]
    : state?.link === "ended" ? ["ended", `The server has ended, and ${vents}.`]
    : state?.link === "lost" ? ["link lost", `The link to the board is lost. A ${what} that was driven ${alone} by itself. It is tried again and again.`]
    : state?.link === "silent" || (state && quiet) ? ["link lost", `The board does not answer. A driven ${what} ${alone} by itself when the board gets no messages either.`]
    : [state ? "connected" : "connecting", ""];
  const link = $("link");
  link.textContent = text;
  link.className = `chip ${why ? "bad" : "good"}`;
  $("lost").textContent = why;
  $("lost").hidden = !why;
  // The present mode is not known then.
  showText("mode", shownMode && why ? `was ${shownMode}` : shownMode);
  document.body.classList.toggle("stale", Boolean(why));
}

function showOwn() {
  $("watching").hidden = own.steers;
  $("slow").textContent = own.lost_frames ? `This browser was too slow for ${own.lost_frames} frames; the recording was not.` : "";
  if (state) showState();
}

function showState() {
  const { configuration, armed_pa, faults, vents, recording, guide, board } = state;
  // Without the server nothing can be ordered, and the board's state is unknown.
  const configured = configuration.configured, steers = own.steers && open, busy = Boolean(guide && !guide.over);
  $("target").textContent = state.target;
  document.title = `${state.link === "connected" ? "" : "⚠ "}Thermyo: ${state.target}`;
  const armed = armed_pa !== null && open && state.link === "connected";
  $("armed").textContent = armed ? `armed up to ${withUnit("Pa", armed_pa)}` : armed_pa === null ? "not armed" : "was armed";
  $("armed").className = armed ? "chip good" : "chip";
  const wrong = faults.filter((fault) => !fault.endsWith("not configured"));
  $("faults").hidden = !wrong.length;
  $("faults-text").textContent = wrong.length ? `${wrong.join(", ")}${vents ? `: ${words.vents}. Remove the cause, clear, then arm.` : ""}` : "";

  $("configure").hidden = configured;
  $("own").hidden = !configuration.own;
  $("own").textContent = `Use ${configuration.own}`;
  for (const field of document.querySelectorAll(".controls button, .controls input, .controls select")) field.disabled = !steers;
  document.body.classList.toggle("watch", !steers);
  const able = steers && configured && !busy;
  for (const id of ["arm", "steer", "tune", "stops"]) for (const field of $(id).elements) field.disabled = !able;
  for (const button of document.querySelectorAll("[data-calibrate]")) button.disabled = !able || recording;
  for (const id of ["tune", "stops"]) $(id).elements[0].disabled ||= Boolean(recording);
  // A calibration's second point needs another pressure: arming and steering stay enabled.
  if (busy && guide.asks) for (const id of ["arm", "steer"]) for (const field of $(id).elements) field.disabled = !steers;
  for (const field of $("steer").elements) field.disabled ||= armed_pa === null && field.type !== "radio";
  $("clear").disabled = !steers;
  const [, reach_pa] = reached();
  const usual_pa = Math.min(4e5, Math.floor(reach_pa / 1e3) * 1e3), first_pa = armed_pa ?? Math.min(subject.first_pa, configuration.working_limit_pa);
  // A field that was emptied to be typed in stays empty.
  for (const [id, pa] of [["tune-most", usual_pa], ["stops-most", usual_pa], ["most", first_pa]]) if ($(id).value === "" && configured && document.activeElement !== $(id)) $(id).value = format("Pa", pa);
  $("back").hidden = !state.former;
  $("back").textContent = `Back to the configuration before, ${state.former || "without a name"}`;
  showRange();

  $("recording").hidden = !recording;
  const button = $("record-button");
  button.textContent = recording ? "Stop recording" : "Record";
  button.disabled ||= !configured || (busy && !recording);
  if (recording) {
    $("recording").textContent = `${recording.time_s.toFixed(0)} s`;
    $("record-text").textContent = `${recording.time_s.toFixed(1)} s, ${recording.rows} steps`;
  } else $("record-text").textContent = "Records every step, even if this page shows fewer.";
  showResults();
  if (subject.studied) {
    showGuide(guide);
    showRecords(steers && !busy);
    showStudy(state.study);
  }
  subject.showState(state);
  showEvents();

  const timing = state.timing;
  const facts = [
    ["Chip", board ? `${board.chip}, firmware ${board.firmware.join(".")}` : "–"],
    ["Configuration", `${configuration.name || "without a name"}, ${configuration.checksum.toString(16).padStart(8, "0")}, ${{ Defaults: "the core's defaults", Host: "not saved", Flash: "saved" }[configuration.source]}`],
    ["Limit", `${withUnit("Pa", configuration.working_limit_pa)}; supply ${withUnit("Pa", configuration.supply_pa)}`],
    ...subject.facts(configuration),
    ["Core step", timing ? `${(timing.step_mean_ns / 1e3).toFixed(0)} µs mean, ${timing.step_worst_us} µs worst, ${timing.missed_steps} missed` : "–"],
    ["Link", `telemetry of ${state.lost_steps} steps lost`],
    ["Pages", `${own.pages} open`],
  ];
  $("board-facts").replaceChildren(...facts.flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
}

function element(name, text, attributes = {}) {
  const node = document.createElement(name);
  node.textContent = text;
  Object.assign(node, attributes);
  return node;
}

let resultsShown = "";
function showResults() {
  const key = JSON.stringify(state.results);
  if (key === resultsShown) return;
  resultsShown = key;
  $("results").replaceChildren(...state.results.map(({ name, text }) => {
    const item = document.createElement("li");
    const link = element("a", name, { href: `results/${name}/report.html`, target: "_blank", rel: "noopener" });
    item.append(link, element("span", text));
    return item;
  }));
}

function showGuide(guide) {
  $("guide-choice").hidden = Boolean(guide);
  $("guided").hidden = !guide;
  $("guide-title").textContent = guide ? guide.title : "Calibrate, tune, measure";
  if (!guide) return;
  $("guide").open = true;
  showText("guide-text", guide.text);
  showTable("guide-table", guide.head, guide.table);
  $("guide-progress").hidden = guide.progress === null;
  if (guide.progress !== null) $("guide-progress").value = guide.progress;
  $("reference").hidden = !guide.asks;
  $("reference-unit").textContent = guide.asks ? symbol(guide.asks) : "";
  $("guide-result").hidden = !guide.result;
  $("guide-result").href = guide.result ? `results/${guide.result}/report.html` : "";
  $("leave").textContent = guide.chooses ? "Keep" : guide.over ? "Done" : "Cancel";
  $("leave").hidden = guide.progress !== null;
  $("go-back").hidden = !guide.chooses;
}

/** A changed text is read out; an unchanged one is left alone. */
function showText(id, text) {
  if ($(id).textContent !== text) $(id).textContent = text;
}

/** The last content of each table or list. */
const shownRows = {};
function changes(id, rows) {
  const key = JSON.stringify(rows);
  if (shownRows[id] === key) return false;
  shownRows[id] = key;
  return true;
}

function showTable(id, head, rows) {
  $(id).hidden = !rows.length;
  if (changes(`${id}-head`, head)) $(id).tHead.rows[0].replaceChildren(...head.map((name) => element("th", name, { scope: "col" })));
  if (changes(id, rows)) $(id).tBodies[0].replaceChildren(...rows.map(([name, ...values]) => {
    const row = document.createElement("tr");
    row.append(element("th", name, { scope: "row" }), ...values.map((value) => element("td", value)));
    return row;
  }));
}

// Records: files of this page, and recordings of the session

/** Files that the server keeps, and the size of the largest. */
const FILES = 4, LARGEST_MB = 64;
let files = [];

/** A record as the value of an option. */
const sourceOf = (record) => JSON.stringify(record);

function showRecords(able) {
  const recorded = state.results.filter(({ trace }) => trace).map(({ name }) => [sourceOf({ result: name }), name]);
  const records = [...files.map((file) => [sourceOf({ file }), file.name]), ...recorded], { offers, configured } = state.configuration;
  for (const id of ["identify-data", "compare-second", "compare-first"]) if (changes(id, records)) {
    const chosen = $(id).value;
    options(id, records);
    if (!chosen && id === "compare-first" && records.length > 1) $(id).selectedIndex = 1;
  }
  if (changes("identify-sought", offers)) {
    options("identify-sought", offers.map(({ kind, name }) => [kind, name]));
    showKeys();
  }
  const free = able && (!state.study || state.study.over);
  for (const id of ["identify", "compare"]) for (const field of $(id).elements) field.disabled = !free || !records.length || (id === "identify" && !configured);
  $("compare").elements[2].disabled ||= records.length < 2;
}

/** Fills a list, and keeps what was chosen. */
function options(id, all) {
  const before = $(id).value;
  $(id).replaceChildren(...all.map(([value, text]) => element("option", text, { value })));
  if (all.some(([value]) => value === before)) $(id).value = before;
}

function showKeys() {
  const offer = state.configuration.offers.find(({ kind }) => kind === $("identify-sought").value);
  $("identify-hint").textContent = offer?.hint ?? "";
  $("identify-keys").hidden = !offer?.keys.length;
  const boxes = (offer?.keys ?? []).map((key, i) => {
    const label = element("label", "");
    label.append(element("input", "", { type: "checkbox", name: "key", value: key, checked: i < offer.usual }), element("span", key));
    return label;
  });
  $("identify-keys").replaceChildren(element("legend", "Values"), ...boxes);
}

function showStudy(study) {
  $("study").hidden = !study;
  if (!study) return;
  $("records").open = true;
  $("study-title").textContent = study.title;
  showText("study-text", study.text);
  showTable("study-table", study.head, study.rows);
  $("study-progress").hidden = study.progress === null;
  if (study.progress !== null) $("study-progress").value = study.progress;
  const path = (file) => (study.result && file ? `results/${study.result}/${file}` : "");
  for (const [id, file] of [["study-result", "report.html"], ["study-scenario", study.scenario], ["study-plot", study.plot]]) {
    $(id).hidden = !path(file);
    if (path(file)) $(id).href = path(file);
  }
  if (changes("study-image", path(study.plot)) && study.plot) {
    Object.assign($("study-plot").firstElementChild, { src: path(study.plot), alt: `${study.title}: the records drawn over time. The table and the report have the values.` });
  }
  $("study-refused").hidden = !study.refused;
  showText("study-refused", study.refused ?? "");
  $("apply").hidden = !study.applies;
  $("close").textContent = study.chooses ? "Keep" : study.over ? "Done" : "Cancel";
  $("study-back").hidden = !study.chooses;
}

/** Sends files to the server, which answers with their numbers. */
async function add(list) {
  let refused = "";
  for (const file of list) {
    if (file.size > LARGEST_MB * 2 ** 20) {
      refused = `${file.name}: a file for this page may have ${LARGEST_MB} MiB; the command takes larger ones.`;
      continue;
    }
    try {
      const answer = await fetch("files", { method: "POST", body: file }), text = await answer.text();
      if (answer.ok) files = [{ number: +text, name: file.name }, ...files].slice(0, FILES);
      else refused = `${file.name}: ${text}`;
    } catch {
      refused = `${file.name}: it did not arrive.`;
    }
  }
  $("csv-refused").hidden = !refused;
  showText("csv-refused", refused);
  if (!state) return;
  showState();
  // Selects the latest file and the one before it.
  if (!refused) for (const [i, id] of ["identify-data", "compare-second", "compare-first"].entries()) $(id).selectedIndex = Math.min(+(i === 2), $(id).length - 1);
}

let eventsShown = "";
function showEvents() {
  const key = state.events.length && `${state.events[0].at_ms} ${state.events[0].text} ${state.events.length}`;
  if (key === eventsShown) return;
  eventsShown = key;
  $("events").replaceChildren(...state.events.map(({ at_ms, weight, text }) => {
    const item = document.createElement("li");
    item.className = weight;
    const time = new Date(at_ms);
    item.append(element("time", time.toLocaleTimeString([], { hour12: false }), { dateTime: time.toISOString() }), element("span", text));
    return item;
  }));
}

// The last two minutes, kept over a reload: in SI, since units may change meanwhile

addEventListener("pagehide", () => {
  const columns = Object.entries(live.columns).map(([name, values]) => {
    const si = Object.keys(scaled).find((si) => scaled[si].columns.includes(name)), [, one, zero] = si ? unit(si) : [name, 1, 0];
    return [name, values.map((value) => (Number.isFinite(value) ? +(value * one + zero).toPrecision(7) : null))];
  });
  try {
    plotStore?.setItem(location.pathname, JSON.stringify(Object.fromEntries(columns)));
  } catch {
    // Storage is full: the charts begin again.
  }
});

function restore() {
  const columns = JSON.parse(plotStore?.getItem(location.pathname) ?? "{}");
  for (const [name, values] of Object.entries(columns)) {
    const si = Object.keys(scaled).find((si) => scaled[si].columns.includes(name));
    live.columns[name]?.push(...values.map((value) => (value === null ? NaN : si ? shownIn(si, value) : value)));
  }
}

// Orders of the user

let mode = Object.keys(modes)[0];

/** Range of the pressure of an arming [Pa]. */
function armable() {
  const { ambient_pa, working_limit_pa } = state.configuration;
  return [ambient_pa, working_limit_pa];
}

/** Range of the pressure of a tuning [Pa]. */
function reached() {
  const { ambient_pa, supply_pa, working_limit_pa } = state.configuration;
  return [ambient_pa, Math.min(supply_pa, working_limit_pa)];
}

/** Range of the first value, in SI. */
const limits = () => subject.limits(mode, state.configuration, state.armed_pa);

function showRange() {
  const { first, second, plain } = modes[mode], [low, high] = limits().map((value) => shownIn(first[1], value));
  const slide = $("slide");
  slide.hidden = Boolean(plain);
  // Assigning an unchanged range would move the slide under the pointer.
  if (+slide.min !== low || +slide.max !== high) { slide.min = low; slide.max = high; slideToField(); }
  $("first-name").textContent = first[0];
  $("first-unit").textContent = symbol(first[1]);
  $("second-label").hidden = !second;
  $("second-name").textContent = second ? second[0] : "";
  $("second-unit").textContent = second ? symbol(second[1]) : "";
  const range = `${low.toFixed(digits(first[1]))} to ${high.toFixed(digits(first[1]))} ${symbol(first[1])}`;
  $("range").textContent = state.armed_pa === null && state.configuration.configured ? "Arm first: until then no set point is taken."
    : subject.hint(mode, range);
}

function slideToField() {
  const [, si] = modes[mode].first, value = read("first", si);
  if (value !== null) $("slide").value = shownIn(si, value);
}

/** SI value of a field; a field without one is marked. */
function read(id, si) {
  const value = parse($(id).value, si);
  $(id).setAttribute("aria-invalid", String(value === null));
  return value;
}

/** SI value of a field within its range in SI; otherwise the field shows what is allowed. */
function asked(id, si, [low, high] = [-Infinity, Infinity]) {
  // Values are compared at the displayed precision.
  const value = read(id, si), off = .5 * unit(si)[1] * 10 ** -digits(si);
  const names = units[si].map(([name]) => name).filter(Boolean).join(", ");
  const why = value === null ? `Type a number in ${symbol(si)}, or with its unit: ${names}.`
    : value < low - off || value > high + off ? `${withUnit(si, value)}: must be from ${format(si, low)} to ${withUnit(si, high)}.` : "";
  $(id).setCustomValidity(why);
  if (why) $(id).reportValidity();
  return why ? null : Math.min(Math.max(value, low), high);
}

function chooseMode(next) {
  kept[mode] = [$("first").value, $("second").value];
  for (const id of ["first", "second"]) $(id).setCustomValidity("");
  mode = next;
  [$("first").value, $("second").value] = kept[mode];
  if (state) showRange();
  slideToField();
}

function set() {
  const { first, second, set: setPoint, unchecked } = modes[mode];
  const ranges = unchecked ? [] : [limits(), subject.secondLimits(mode, limits())];
  const fields = [[first, "first"], [second, "second"]].filter(([quantity]) => quantity);
  const values = fields.map(([[, si], id], i) => asked(id, si, ranges[i]));
  if (values.every((value) => value !== null)) order(setPoint(values));
}

/** A slide that was held as a vent began moves nothing when it is let go. */
let letGo = false, vented = false;

function vent() {
  letGo = true;
  say("vent");
}

function on(id, event, action) {
  $(id).addEventListener(event, (happened) => {
    if (event === "submit") happened.preventDefault();
    action(happened);
  });
}

on("vent", "click", vent);
// Before the focused element gets the key: space vents, and buttons are pressed by Enter. While a text is composed
// by an input method, a key has its code alone.
addEventListener("keydown", (event) => {
  if (![event.key, event.code].some((key) => [" ", "Space", "Escape"].includes(key))) return;
  event.preventDefault();
  event.stopPropagation();
  if (!event.repeat) vent();
}, true);
addEventListener("keyup", (event) => { if (event.key === " ") event.preventDefault(); }, true);

addEventListener("input", ({ target }) => target.setCustomValidity(""));
on("arm", "submit", () => {
  const most_pa = asked("most", "Pa", armable());
  if (most_pa !== null) order({ arm: { most_pa } });
});
on("clear", "click", () => order("clear"));
on("steer", "submit", set);
for (const radio of document.querySelectorAll("[name=mode]")) radio.addEventListener("change", () => chooseMode(radio.value));
on("slide", "input", () => ($("first").value = (+$("slide").value).toFixed(digits(modes[mode].first[1]))));
for (const event of ["pointerdown", "keydown"]) on("slide", event, ({ repeat }) => { if (!repeat) letGo = false; });
on("slide", "change", () => { if (!letGo) set(); });
on("first", "input", slideToField);
on("lock", "click", () => order({ set_joint: "Lock" }));
on("record-button", "click", () => order(state.recording ? "finish" : "record"));
for (const button of document.querySelectorAll("[data-calibrate]")) button.addEventListener("click", () => order({ calibrate: button.dataset.calibrate }));
for (const task of ["tune", "stops"]) on(task, "submit", () => {
  const most_pa = asked(`${task}-most`, "Pa", reached());
  if (most_pa !== null) order({ [task]: { most_pa } });
});
on("csv", "change", async ({ target }) => {
  await add([...target.files]);
  target.value = "";
});
// Applies anywhere on the page: a file dropped beside the card would replace the page, and vent.
for (const event of ["dragover", "dragleave", "drop"]) addEventListener(event, (happened) => {
  happened.preventDefault();
  $("drop").classList.toggle("over", event === "dragover");
  if (event !== "drop" || $("csv").disabled || !subject.studied) return;
  $("records").open = true;
  add([...happened.dataTransfer.files]);
});
on("identify-sought", "change", showKeys);
// Space vents, so a box is ticked by Enter.
on("identify-keys", "keydown", (event) => {
  if (event.key !== "Enter" || event.target.type !== "checkbox") return;
  event.preventDefault();
  event.target.checked = !event.target.checked;
});
on("identify", "submit", () => {
  const keys = [...document.querySelectorAll("[name=key]:checked")].map(({ value }) => value);
  order({ identify: { data: JSON.parse($("identify-data").value), sought: $("identify-sought").value, keys } });
});
on("compare", "submit", () => order({ compare: ["compare-first", "compare-second"].map((id) => JSON.parse($(id).value)) }));
on("apply", "click", () => order("apply"));
on("close", "click", () => order("close"));
on("study-back", "click", () => order("back"));
on("reference", "submit", () => {
  const value = asked("reference-value", state.guide.asks);
  if (value === null) return;
  order({ reference: String(value) });
  $("reference-value").value = "";
});
on("leave", "click", () => order("leave"));
for (const id of ["back", "go-back"]) on(id, "click", () => order("back"));
on("take-over", "click", () => say("steer"));
on("save", "click", () => order("save"));
on("configure", "submit", () => order({ configure: null }));
for (const id of ["file", "other-file"]) on(id, "change", async ({ target }) => {
  const [file] = target.files;
  if (file) order({ configure: { name: file.name, text: await file.text() } });
  target.value = "";
});
setInterval(showLink, 100);
document.querySelector(`[name=mode][value=${mode}]`).checked = true;
[$("first").value, $("second").value] = kept[mode];
$("slide").value = kept[mode][0];
for (const si of Object.keys(scaled)) {
  const select = $(`unit-${si}`), before = unitStore?.getItem(`unit ${si}`);
  on(`unit-${si}`, "change", () => choose(si, select.value));
  if ([...select.options].some(({ value }) => value === before)) select.value = before;
  choose(si, select.value);
}
restore();
connect();
