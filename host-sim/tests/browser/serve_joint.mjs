// Uses the page of `thermyo serve` of a joint in headless Chromium, and prints its findings as JSON.
//
//     node serve_joint.mjs CHROMIUM ADDRESS SCREENSHOTS SCENARIO
//
// SCENARIO is the file with which the board is configured from the page.
import { findings } from "./accessibility.mjs";
import { arms, drives, launched, text, type, until, wide } from "./pages.mjs";

const [executablePath, address, screenshots, scenario] = process.argv.slice(2);
const { browser, open, problems } = await launched(executablePath, address);
const pause = (ms) => new Promise((done) => setTimeout(done, ms));

const page = await open(wide);
await until(page, () => !document.getElementById("configure").hidden && !document.getElementById("file").disabled);
await (await page.$("#file")).uploadFile(scenario);
await until(page, () => document.getElementById("configure").hidden && !document.querySelector("#arm .main").disabled);
// The cards for one muscle are not shown.
const hidden = await page.evaluate(() => ["guide", "records", "muscle", "plot-length", "lock"].filter((id) => document.getElementById(id).checkVisibility()));
const most = await page.$eval("#most", (field) => field.value);
await type(page, "most", "5bar");
await arms(page);
// Invalid values are reported at their field.
await type(page, "first", "90");
await page.click("#steer .main");
const refused = await page.$eval("#first", (field) => field.validationMessage);
await page.click("#record-button");
function reaches(degrees) {
  return drives(page, async () => {
    await type(page, "first", String(degrees));
    await type(page, "second", "14");
    await page.keyboard.press("Enter");
  }, (degrees) => {
    const angle = parseFloat(document.getElementById("r-angle").textContent);
    return document.getElementById("mode").textContent.startsWith("angle") && Math.abs(angle - degrees) < 1.5 && angle;
  }, degrees);
}
const reached = [];
for (const degrees of [20, -10, 25]) {
  reached.push(await reaches(degrees));
  await pause(1500);
}
const readings = await page.$$eval(".readings[data-of=joint] dd", (all) => all.map((dd) => dd.textContent));
// The drawn arm is at its angle: upwards, to the right.
const arm = await page.$eval("#arm-scene path[stroke-width='12']", (path) => path.getAttribute("d").match(/[-\d.]+/g).map(Number));
const drawn = Math.atan2(arm[1] - arm[3], arm[2] - arm[0]) * 180 / Math.PI;
const serious = [], narrow = [];
for (const scheme of ["light", "dark"]) {
  await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
  for (const width of [1280, 390]) {
    await page.setViewport(width === 390 ? { width, height: 844, deviceScaleFactor: 2 } : wide);
    await until(page, (width) => innerWidth === width, width);
    await pause(500);
    await page.screenshot({ path: `${screenshots}-${width}-${scheme}.png`, fullPage: true });
    serious.push(...await findings(page));
    narrow.push(await page.evaluate(() => document.documentElement.scrollWidth));
  }
}
await page.setViewport(wide);
await until(page, () => innerWidth === 1280);
// Text of twice the size is not cut.
const large = await page.evaluate(() => {
  const { documentElement: root } = document, scene = document.querySelector(".scene"), modes = document.querySelector(".modes[data-of=joint]");
  root.style.fontSize = "32px";
  const cut = [root, scene, modes].map((node) => node.scrollWidth - node.clientWidth);
  root.style.fontSize = "";
  return cut;
});
// A torque, then space with the focus in a field.
await drives(page, async () => {
  await page.evaluate(() => document.querySelector("[name=mode][value=torque]").click());
  await type(page, "first", "0.5");
  await type(page, "second", "10");
  await page.keyboard.press("Enter");
}, () => document.getElementById("mode").textContent.startsWith("torque"));
// Both pressures, in a unit other than the typed one.
await page.evaluate(() => document.querySelector("[name=mode][value=pressures]").click());
await type(page, "first", "200");
await type(page, "second", "9bar");
await page.keyboard.press("Enter");
const pressure = await page.$eval("#second", (field) => field.validationMessage);
await type(page, "second", "250");
await page.select("#unit-Pa", "bar");
const in_bar = await page.$$eval("#first, #second", (fields) => fields.map(({ value }) => value));
await drives(page, () => page.click("#steer .main"), () => document.getElementById("mode").textContent.startsWith("pressures") &&
  ["a", "b"].every((side, i) => Math.abs(parseFloat(document.getElementById(`r-pressure-${side}`).textContent) - [2, 2.5][i]) < .05));
await page.focus("#first");
await page.keyboard.press(" ");
await until(page, () => document.getElementById("mode").textContent === "vent");
await page.click("#record-button");
await until(page, () => document.querySelector("#results a"));
const events = await text(page, "events");
await browser.close();
console.log(JSON.stringify({ problems, hidden, most, refused, reached, readings, drawn, pressure, in_bar, serious, narrow, large, events }));
