// Uses the page of `thermyo playground` in headless Chromium, from a plain web server, and prints its findings as JSON.
//
//     node playground.mjs CHROMIUM FOLDER SCREENSHOTS
import { createServer } from "node:http";
import { mkdtemp, readFile, rename, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { findings } from "./accessibility.mjs";
import { launch } from "./browser.mjs";

const [executablePath, folder, screenshots] = process.argv.slice(2);
const TYPES = { html: "text/html", js: "text/javascript", css: "text/css" };
const server = createServer(async ({ url }, response) => {
  const name = new URL(url, "http://localhost").pathname.slice(1) || "index.html";
  try {
    const content = await readFile(join(folder, name));
    // The module as sent by a host that does not know its type.
    response.writeHead(200, { "content-type": TYPES[name.split(".").at(-1)] ?? "application/octet-stream" });
    response.end(content);
  } catch {
    response.writeHead(404);
    response.end();
  }
});
await new Promise((done) => server.listen(0, "127.0.0.1", done));
const address = `http://127.0.0.1:${server.address().port}/`;

const browser = await launch(executablePath);
const page = await browser.newPage();
const problems = [];
page.on("console", (message) => {
  if (["error", "warn"].includes(message.type())) problems.push(message.text());
});
page.on("pageerror", (error) => problems.push(String(error)));
page.on("request", (request) => {
  if (!request.url().startsWith(address) && !/^(data|blob):/.test(request.url())) problems.push(`fetches ${request.url()}`);
});
page.on("response", (response) => {
  if (response.status() >= 400) problems.push(`${response.status()} ${response.url()}`);
});

const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const until = (what, ...values) => page.waitForFunction(what, { polling: 50 }, ...values);
const number = (id) => page.$eval(`#${id}`, (node) => parseFloat(node.textContent));
const text = (id) => page.$eval(`#${id}`, (node) => node.textContent);
const choose = (name, value) => page.$eval(`[name=${name}][value="${value}"]`, (radio) => radio.click());
async function slide(key, value) {
  await page.$eval(`[id="${key}"]`, (input, to) => {
    input.value = to;
    input.dispatchEvent(new Event("input", { bubbles: true }));
  }, value);
}
const legend = (plot) => page.$eval(`#${plot} ul`, (list) => list.textContent);

await page.setViewport({ width: 1280, height: 900 });
await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "light" }]);
await page.goto(address);
const downloads = await mkdtemp(join(tmpdir(), "thermyo-playground-"));
const session = await page.createCDPSession();
await session.send("Page.setDownloadBehavior", { behavior: "allow", downloadPath: downloads });
async function download(button, name, folder = downloads) {
  await page.click(`#${button}`);
  for (let i = 0; i < 200; i++) {
    const content = await readFile(join(folder, name), "utf8").catch(() => "");
    if (content) return join(folder, name);
    await pause(50);
  }
  throw new Error(`no ${name} was saved`);
}

await until(() => parseFloat(document.getElementById("time").textContent) > 0);
// The shipped cycle, before any change: the saved scenario is that of `thermyo run`.
const shipped = { scenario: await download("export", "scenario.toml") };
shipped.trace = await download("trace", "trace.csv");

// A set point, and the pressure that follows.
await page.select("#choice", await page.$eval("#choice", (list) => list.options[1].value));
await choose("rate", 10);
await until(() => parseFloat(document.getElementById("time").textContent) > 5);
const held_kpa = await number("r-pressure");
await slide("drive.pressure_pa", 400);
const turned_s = await number("time");
await until((from) => parseFloat(document.getElementById("time").textContent) > from + 6, turned_s);
const followed_kpa = await number("r-pressure");
// A lag that differs from the core's configuration.
const before = await legend("plot-temperature");
await slide("sensor.gas.time_constant_s", 10);
await slide("load.force_n", 250);
await slide("heat.scale", 2);
await slide("supply.pressure_pa", 600);
await pause(700);
const knobs = await text("knobs");
const nameless = (await page.accessibility.snapshot()).children.filter(({ role, name }) => role === "slider" && !name).length;
const changed = (await legend("plot-temperature")) !== before;
const unconfigured = await page.$eval("#exported", (node) => node.textContent.includes("starts with them"));

// The answer to an invalid file; the simulation continues.
const wrong = join(downloads, "wrong.toml");
await writeFile(wrong, "[supply]\npressure_pa = -1\n");
await (await page.$("#file")).uploadFile(wrong);
await until(() => !document.getElementById("wrong").hidden);
const refused = await text("wrong");
const refused_s = await number("time");
await until((from) => parseFloat(document.getElementById("time").textContent) > from + 2, refused_s);
await choose("rate", 1);
await page.click("#again");
await until(() => document.getElementById("wrong").hidden && parseFloat(document.getElementById("time").textContent) < 4);

// A joint: saved as shipped; then gravity that the core does not have, another stiffness, and an angle that is held.
const bench = await mkdtemp(join(tmpdir(), "thermyo-playground-"));
await session.send("Page.setDownloadBehavior", { behavior: "allow", downloadPath: bench });
await page.select("#choice", await page.$eval("#choice", (list) => list.options[4].value));
await until(() => parseFloat(document.getElementById("time").textContent) > 3);
const joint = {
  scenario: await download("export", "scenario.toml", bench), trace: await download("trace", "joint_trace.csv", bench),
  error_deg: await number("r-angle-error"),
};
for (const [scheme, width] of [["light", 1280], ["dark", 1280], ["light", 390]]) {
  await page.setViewport(width < 400 ? { width, height: 844, deviceScaleFactor: 2 } : { width, height: 900 });
  await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
  await pause(1500);
  joint.narrow_px = await page.evaluate(() => document.documentElement.scrollWidth);
  await page.screenshot({ path: `${screenshots}-joint-${width}-${scheme}.png`, fullPage: true });
}
const seriously = await findings(page);
await page.setViewport({ width: 1280, height: 900 });
await slide("drive.stiffness_n_m_rad", 20);
// An angle beyond the stops is refused, and its knob stays where the arm is: it swings by 20 deg about 0.
await slide("drive.angle_rad", 40);
joint.refused = [await text("wrong"), await page.$eval("[id='drive.angle_rad']", (input) => +input.value)];
// Values that are allowed together, though not in the order in which their knobs were first turned.
await slide("drive.angle_rad", 5);
await slide("drive.amplitude_rad", 0);
await slide("drive.angle_rad", 30);
await page.click("#again");
joint.again = [await text("wrong"), await text("exported")];
// The message of a run that has stopped stays while knobs are turned, until it starts again.
await page.evaluate(async () => {
  const { Simulation } = await import("/simulation.js"), { advance } = Simulation.prototype;
  Simulation.prototype.advance = () => {
    Simulation.prototype.advance = advance;
    throw new Error("the plant diverged at 3 s");
  };
});
await until(() => !document.getElementById("wrong").hidden);
await slide("drive.angle_rad", 10);
joint.stopped = [await text("wrong")];
await page.click("#again");
joint.stopped.push(await text("wrong"));
await slide("joint.gravity_n_m", 3);
await slide("joint.inertia_kg_m2", .03);
const slid_s = await number("time");
await until((from) => parseFloat(document.getElementById("time").textContent) > from + 4, slid_s);
joint.stiffness = await number("r-stiffness");
joint.held_deg = await number("r-angle");
joint.nameless = (await page.accessibility.snapshot()).children.filter(({ role, name }) => role === "slider" && !name).length;
joint.views = await page.$$eval("[data-view]:not([hidden])", (all) => [...new Set(all.map(({ dataset }) => dataset.view))]);
await rename(joint.scenario, join(bench, "shipped.toml"));
joint.scenario = join(bench, "shipped.toml");
joint.turned = await download("export", "scenario.toml", bench);
joint.speed = await number("speed");

// The tour: the estimate's error grows when only the muscle changes, and is small again when the core changes too.
const tour = [];
await choose("rate", 10);
for (let i = 0; i < 5; i++) {
  await page.click("#tour-next");
  await until((step) => document.getElementById("tour-title").textContent.startsWith(`Step ${step} of 5`), i + 1);
  // The time of the step before is shown for half a second.
  await pause(700);
  await until(() => parseFloat(document.getElementById("time").textContent) > 15);
  tour.push({ error_k: await number("r-error"), address: await page.evaluate(() => decodeURIComponent(location.hash)), words: await text("tour-text") });
  if (i === 1) await page.screenshot({ path: `${screenshots}-tour.png`, fullPage: true });
}
// An address opens the same page elsewhere.
const other = await browser.newPage();
await other.goto(`${address}${await page.evaluate(() => location.hash)}`);
await other.waitForFunction(() => parseFloat(document.getElementById("time").textContent) > 0, { polling: 50 });
const elsewhere = { address: await other.evaluate(() => decodeURIComponent(location.hash)), knobs: await other.$eval("#knobs", (node) => node.textContent), here: await text("knobs") };
// Keys of an address are taken together or not at all; one that this scenario does not have is left out.
await other.evaluate(() => { location.hash = "#drive.angle_rad=0.3&heat.scale=3&supply.pressure_pa=-1"; });
await other.waitForFunction(() => !document.getElementById("wrong").hidden, { polling: 50 });
elsewhere.refused = [await other.$eval("#wrong", (node) => node.textContent), await other.$$eval("#knobs .turned", (all) => all.length)];
await other.close();
await page.bringToFront();
// A plot is downloaded.
const saved_plot = await page.evaluate(() => new Promise((done) => {
  HTMLAnchorElement.prototype.click = function () { done([this.download, decodeURIComponent(this.href).split("\n")[0]]); };
  document.querySelector('[aria-label="Download as CSV: Pressure, absolute"]').click();
}));

// Highest speed.
await page.select("#choice", await page.$eval("#choice", (list) => list.options[0].value));
await choose("rate", 100);
await choose("span", 20);
await pause(3000);
const at_100 = await number("speed");
await choose("rate", 1000);
await pause(2500);
const at_1000 = await number("speed");
await choose("rate", 1);
await choose("span", 20);

await page.click("#pause");
const box = await (await page.$("#plot-pressure .plot")).boundingBox();
const not_hovered = await legend("plot-pressure");
await page.mouse.move(box.x + box.width * .6, box.y + 60);
await pause(300);
const hovered = await legend("plot-pressure");
await page.screenshot({ path: `${screenshots}-1280-light.png`, fullPage: true });
await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "dark" }]);
await pause(300);
await page.screenshot({ path: `${screenshots}-1280-dark.png`, fullPage: true });
await page.mouse.move(5, 5);
await page.setViewport({ width: 390, height: 844, deviceScaleFactor: 2 });
await pause(600);
const narrow_px = await page.evaluate(() => document.documentElement.scrollWidth);
await page.screenshot({ path: `${screenshots}-390-dark.png`, fullPage: true });
await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "light" }]);
await pause(300);
await page.screenshot({ path: `${screenshots}-390-light.png`, fullPage: true });
const serious = [...seriously, ...await findings(page)];
await page.setViewport({ width: 1280, height: 900 });
await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "dark" }]);
await pause(300);
serious.push(...await findings(page));
const mode = await text("mode");
await browser.close();
server.close();
console.log(JSON.stringify({
  problems, shipped, held_kpa, followed_kpa, knobs, changed, unconfigured, refused, at_100, at_1000, hovered, not_hovered, narrow_px, mode, nameless, serious, tour, elsewhere, saved_plot, joint,
}));
