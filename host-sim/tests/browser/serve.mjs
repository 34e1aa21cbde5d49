// Uses the page of `thermyo serve` in headless Chromium like a person at a bench, and prints its findings as JSON.
//
//     node serve.mjs CHROMIUM ADDRESS SCREENSHOTS THERMYO PLACE SERVER
//
// THERMYO is the command, PLACE the temporary folder in which the emulated board is plugged in,
// SERVER the process of the server, which is killed in the end.
import { execFileSync } from "node:child_process";
import { writeFileSync } from "node:fs";
import { findings } from "./accessibility.mjs";
import { drives, launched, text, type, until, wide } from "./pages.mjs";

const [executablePath, address, screenshots, thermyo, place, server] = process.argv.slice(2);
const { browser, open, problems } = await launched(executablePath, address);
// Pause before a screenshot, about which nothing is asserted.
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
// Waits until a pressure is held, and returns the reading. Both come from one look: on the way there each pulse of the
// inlet moves the reading by several kPa.
async function reaches(page, set) {
  const held = await until(page, (set) => {
    const kpa = parseFloat(document.getElementById("r-pressure").textContent);
    return document.getElementById("mode").textContent.startsWith("pressure, held") && Math.abs(kpa - set) < 2 && kpa;
  }, set);
  return held.jsonValue();
}

const page = await open(wide);
await until(page, () => !document.getElementById("own").hidden && !document.getElementById("own").disabled);
await page.screenshot({ path: `${screenshots}-fresh.png`, fullPage: true });
await page.click("#own");
await until(page, () => document.getElementById("configure").hidden && !document.querySelector("#arm .main").disabled);
// The first limit is the one of docs/reference/board.md; a limit beyond the muscle's is refused at the field.
const most = [await page.$eval("#most", (field) => field.value)];
await type(page, "most", "1500");
await page.click("#arm .main");
most.push(await page.$eval("#most", (field) => field.validationMessage));
await type(page, "most", "4bar");
await page.click("#arm .main");
await until(page, () => document.getElementById("armed").textContent.startsWith("armed") && !document.querySelector("#steer .main").disabled);
const first = { armed: (await text(page, "armed")).startsWith("armed up to"), readings: /\d/.test(await text(page, "r-gas")) };
// Invalid values are reported at their field.
const refused = [];
for (const value of ["abc", "-3"]) {
  await type(page, "first", value);
  await page.click("#steer .main");
  refused.push(await page.$eval("#first", (field) => field.validationMessage));
}
await page.click("#record-button");
// A limit that was deleted stays so until another one is typed, whatever the board reports meanwhile.
await page.click("#most", { count: 3 });
await page.keyboard.press("Delete");
const recorded = await text(page, "record-text");
await until(page, (before) => document.getElementById("record-text").textContent !== before, recorded);
await page.type("#most", "400");
most.push(await page.$eval("#most", (field) => field.value));
await type(page, "first", "150");
await page.click("#steer .main");
const reached_kpa = await reaches(page, 150);
for (const kpa of ["260", "180", "330"]) {
  await type(page, "first", kpa);
  await page.keyboard.press("Enter");
  await reaches(page, parseFloat(kpa));
}
const plot = await page.$("#plot-pressure .plot");
const legend = () => page.$eval("#plot-pressure ul", (list) => list.textContent);
const not_hovered = await legend();
// On a busy machine the board has existed only for seconds, which are at the right end of the plot; and the plot may
// shift as the page grows: so its present position is used.
let hovered = not_hovered;
for (let back = 4; back < 400 && (hovered === not_hovered || !hovered.includes("kPa")); back += 12) {
  const box = await plot.boundingBox();
  await page.mouse.move(box.x + box.width - back, box.y + 60);
  await pause(200);
  hovered = await legend();
}

// The colours of the muscle mean the same throughout.
const ends = [await page.$$eval("#muscle svg > text", (all) => all.map((text) => text.textContent))];
const watcher = await open(wide, "dark");
await until(watcher, () => document.getElementById("watching").hidden === false);
const watching = await watcher.$eval("#steer .main", (button) => button.disabled);
// A page that is opened later shows the pressure for which the board is armed.
await until(watcher, () => document.getElementById("most").value !== "");
most.push(await watcher.$eval("#most", (field) => field.value));
await watcher.close();
// Other units, of readings and fields alike.
await page.select("#unit-Pa", "bar");
await page.select("#unit-K", "degC");
await until(page, () => document.getElementById("r-pressure").textContent.endsWith("bar") && !document.getElementById("r-gas").textContent.endsWith("K"));
const in_bar = { pressure: parseFloat(await text(page, "r-pressure")), field: await page.$eval("#first", (field) => field.value), gas: parseFloat(await text(page, "r-gas")), armed: await text(page, "armed") };
await page.select("#unit-Pa", "kPa");
await page.select("#unit-K", "K");
await page.bringToFront();
await page.screenshot({ path: `${screenshots}-1280-light.png`, fullPage: true });
await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "dark" }]);
await pause(400);
await page.screenshot({ path: `${screenshots}-1280-dark.png`, fullPage: true });
await page.mouse.move(5, 5);
await page.setViewport({ width: 390, height: 844, deviceScaleFactor: 2 });
await until(page, () => innerWidth === 390);
await pause(600);
// Phone width, and the full page.
await page.screenshot({ path: `${screenshots}-390-hand.png` });
const serious = await findings(page);
const narrow_px = await page.evaluate(() => document.documentElement.scrollWidth);
// The gas temperature stands above the events.
const temperature_above = await page.evaluate(() =>
  document.getElementById("plot-temperature").getBoundingClientRect().top < document.querySelector(".events").getBoundingClientRect().top);
await page.screenshot({ path: `${screenshots}-390-dark.png`, fullPage: true });
await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "light" }]);
await pause(400);
await page.screenshot({ path: `${screenshots}-390-light.png`, fullPage: true });
await page.setViewport(wide);
await pause(300);

const pressurised = () => drives(page, async () => {
  await type(page, "first", "150");
  await page.keyboard.press("Enter");
}, () => {
  const mode = document.getElementById("mode").textContent;
  return mode.startsWith("pressure") && mode;
});
// By the space key, with the focus anywhere; timed on the page's own clock, from the key to the mode that the board reports.
const vented_ms = [];
let driven;
for (let i = 0; i < 5; i++) {
  driven = await pressurised();
  await page.evaluate(() => {
    window.vented_ms = null;
    addEventListener("keydown", () => {
      const pressed = performance.now();
      const look = () => (document.getElementById("mode").textContent === "vent" ? (window.vented_ms = performance.now() - pressed) : setTimeout(look, 2));
      look();
    }, { once: true, capture: true });
  });
  await page.keyboard.press(" ");
  await until(page, () => window.vented_ms);
  vented_ms.push(await page.evaluate(() => window.vented_ms));
}
const vents = () => until(page, () => document.getElementById("mode").textContent === "vent");
// With a list open, and with the space of an input method.
const keys = await page.createCDPSession();
for (const vent of [
  async () => {
    await page.click("#unit-Pa");
    await page.keyboard.press(" ");
  },
  async () => {
    await page.focus("#first");
    await keys.send("Input.dispatchKeyEvent", { type: "rawKeyDown", key: "Process", code: "Space", windowsVirtualKeyCode: 229 });
  },
]) {
  await pressurised();
  await vent();
  await vents();
  await page.click("h1");
}
// A slide that is held meanwhile moves nothing when it is let go: the arming is the next event.
const colleague = await open(wide);
await page.bringToFront();
const let_go = [];
for (const [most, vent] of [["390", () => page.keyboard.press(" ")], ["380", () => colleague.$eval("#vent", (button) => button.click())]]) {
  await pressurised();
  const { x, y, height } = await (await page.$("#slide")).boundingBox();
  await page.mouse.move(x + 20, y + height / 2);
  await page.mouse.down();
  await page.mouse.move(x + 120, y + height / 2, { steps: 4 });
  await vent();
  await vents();
  await page.mouse.move(x + 140, y + height / 2);
  await page.mouse.up();
  await type(page, "most", most);
  await page.click("#arm .main");
  await until(page, (most) => document.getElementById("armed").textContent.includes(most), most);
  const events = await page.$$eval("#events li span", (all) => all.map((event) => event.textContent));
  let_go.push(...events.slice(0, events.indexOf("the muscle vents")));
}
await colleague.close();
// A browser that is set to keep nothing.
const forgetful = await browser.newPage();
await forgetful.evaluateOnNewDocument(() => {
  for (const name of ["localStorage", "sessionStorage"]) Object.defineProperty(window, name, { get() { throw new DOMException("denied", "SecurityError"); } });
});
await forgetful.goto(address);
await until(forgetful, () => document.getElementById("link").textContent === "connected");
await forgetful.close();
await page.bringToFront();
await type(page, "most", "400");
ends.push(await page.$$eval("#muscle svg > text", (all) => all.map((text) => text.textContent)));
await page.click("#record-button");
await until(page, () => document.querySelector("#results a"));
const report = await page.$eval("#results a", (link) => link.href);
// Estimate and sensor have their colours on every page.
const colours = (page) => page.evaluate(() => ["estimate", "sensor"].map((name) => {
  const drawn = document.querySelector(`.c-${name}`);
  return drawn && getComputedStyle(drawn).getPropertyValue("--c").trim();
}));
const palette = [await colours(page)];
const opened = await open(wide);
await opened.goto(report);
palette.push(await colours(opened));
if (!(await opened.$("figure .plot.live"))) problems.push("the report's charts are not live");
await opened.close();
await page.bringToFront();
await page.click("#guide-title");
serious.push(...await findings(page));
await page.click("[data-calibrate=pressure]");
await until(page, () => !document.getElementById("reference").hidden);
await page.screenshot({ path: `${screenshots}-guide.png`, fullPage: true });
// Takes the first point, in the page's unit, once the muscle has vented.
await until(page, () => parseFloat(document.getElementById("r-pressure").textContent) < 103);
await type(page, "reference-value", "101.3");
await page.keyboard.press("Enter");
await until(page, () => document.getElementById("guide-text").textContent.includes("second point"));
const calibrates = await text(page, "guide-text");
await page.click("#leave");
await until(page, () => document.getElementById("guided").hidden);
// A drawing is downloaded without a complaint of the browser.
const saved = await page.evaluate(() => {
  const hrefs = [], { click } = HTMLAnchorElement.prototype;
  HTMLAnchorElement.prototype.click = function () { hrefs.push(decodeURIComponent(this.href)); };
  document.querySelector("#plot-pressure [aria-label^='Download as SVG']").click();
  HTMLAnchorElement.prototype.click = click;
  return hrefs.join();
});
// With text of twice the size no legend lies on a button.
const covered = await page.evaluate(() => {
  document.documentElement.style.fontSize = "32px";
  const boxes = (figure, what) => [...figure.querySelectorAll(what)].map((node) => node.getBoundingClientRect());
  const lies = (a, b) => a.left < b.right && a.right > b.left && a.top < b.bottom && a.bottom > b.top;
  const all = [...document.querySelectorAll("figure")].filter((figure) => figure.checkVisibility() &&
    boxes(figure, ".tool").some((tool) => boxes(figure, ".trace").some((trace) => lies(tool, trace))));
  document.documentElement.style.fontSize = "";
  return all.map((figure) => figure.id);
});
// The table of a tuning fits its box, and no line of a long outcome is hidden.
const table_px = [];
for (const width of [1280, 390]) {
  await page.setViewport({ ...wide, width });
  await until(page, (width) => innerWidth === width, width);
  table_px.push(await page.evaluate(() => {
    const [guided, table] = ["guided", "guide-table"].map((id) => document.getElementById(id));
    table.tBodies[0].innerHTML = "<tr><th>friction.viscous_n_s_m</th><td>90.0 N s/m</td><td>101 ± 12 N s/m</td></tr>" +
      "<tr><th>valve.conductance_m3_s_pa</th><td>4.00×10⁻⁹ m³/(s Pa)</td><td>(3.79 ± 0.02)×10⁻⁹ m³/(s Pa)</td></tr>";
    guided.hidden = table.hidden = false;
    const long = document.getElementById("guide-text");
    long.textContent = "stop\n".repeat(60);
    const room = Math.min(document.getElementById("guide").clientWidth - table.scrollWidth, long.clientHeight - long.scrollHeight);
    guided.hidden = table.hidden = true;
    return room;
  }));
}
await page.setViewport(wide);
await until(page, () => innerWidth === 1280);

// Records: with the keyboard, and at both widths.
const record = (rows) => "time_s,pressure_pa,sensor_gas_k,length_m\n" + Array.from({ length: rows }, (_, i) =>
  `${i / 10},${2e5 + 1e4 * rows + 8e4 * Math.sin(i / 8)},${298 + 2 * Math.sin(i / 8 - 1)},${.22 - .01 * Math.sin(i / 8)}\n`).join("");
const chosen = [["first.csv", 300], ["second.csv", 200]].map(([name, rows]) => {
  writeFileSync(`${place}/${name}`, record(rows));
  return `${place}/${name}`;
});
await page.focus("#records summary");
await page.keyboard.press("Enter");
const sent = async (path) => (await page.$("#csv")).uploadFile(path);
for (const [i, path] of chosen.entries()) {
  await sent(path);
  await until(page, (count) => document.querySelectorAll("#compare-first option").length === count, i + 2);
}
const studied = (text) => until(page, (text) => document.getElementById("study-text").textContent.includes(text), text);
// A box is ticked by Enter, the forms are sent by their buttons; a record without duties cannot be used for
// identification.
await page.focus("#identify-keys input");
await page.keyboard.press("Enter");
const ticked = await page.$$eval("#identify-keys input", (boxes) => boxes.map((box) => box.checked));
await page.focus("#identify [type=submit]");
await page.keyboard.press("Enter");
await studied("second.csv: column ");
const not_identified = await text(page, "study-text");

await page.focus("#compare [type=submit]");
await page.keyboard.press("Enter");
await studied("second.csv less first.csv");
const compared = await text(page, "study-text");
await until(page, () => document.querySelector("#study-plot img").naturalWidth > 0);
const records_px = [];
for (const width of [1280, 390]) {
  await page.setViewport({ ...wide, width });
  await until(page, (width) => innerWidth === width, width);
  await pause(300);
  serious.push(...await findings(page));
  records_px.push(await page.evaluate(() => document.documentElement.scrollWidth));
  await page.screenshot({ path: `${screenshots}-records-${width}.png`, fullPage: true });
}
await page.setViewport(wide);
await until(page, () => innerWidth === 1280);

// The link is lost and restored, starting with the loss of the board.
const plugged = (how) => execFileSync(thermyo, ["board", "emulated", how, "--quiet"], { env: { ...process.env, TMPDIR: place } });
const link = async (shown) => {
  const from = Date.now();
  await until(page, (expected) => document.getElementById("link").textContent === expected, shown);
  return Math.max(1, Date.now() - from);
};
plugged("unplug");
const lost_ms = await link("link lost");
const lost_armed = await text(page, "armed");
await page.screenshot({ path: `${screenshots}-lost.png`, fullPage: true });
plugged("plug");
const back_ms = await link("connected");

// The server is killed: the page then claims and offers nothing.
if (await page.$eval("#leave", (button) => button.checkVisibility())) await page.click("#leave");
await until(page, () => !document.getElementById("configure").hidden && !document.getElementById("own").disabled);
await page.click("#own");
await until(page, () => document.getElementById("configure").hidden && !document.querySelector("#arm .main").disabled);
await page.click("#arm .main");
await until(page, () => document.getElementById("armed").textContent.startsWith("armed"));
const other = await open(wide);
await until(other, () => !document.getElementById("watching").hidden);
await page.bringToFront();
// The browser reports that the page finds no server later.
const found = [...problems];
process.kill(Number(server), "SIGKILL");
await link("no server");
await until(other, () => document.getElementById("link").textContent === "no server");
const killed = { other: await other.$eval("#watching", (banner) => !banner.hidden), armed: await text(page, "armed"), mode: await text(page, "mode"), set: await page.$eval("#steer .main", (button) => !button.disabled) };
await browser.close();
console.log(JSON.stringify({ problems: found, first, most, in_bar, refused, reached_kpa, hovered, not_hovered, watching, driven, vented_ms, let_go, lost_ms, lost_armed, back_ms, killed, report, narrow_px, temperature_above, ends, palette, calibrates, saved, covered, table_px, ticked, not_identified, compared, records_px, serious }));
