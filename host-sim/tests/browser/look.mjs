// Opens a report in headless Chromium, uses it like a reader, and prints its findings as JSON.
//
//     node look.mjs CHROMIUM PAGE.html SCREENSHOTS
import { pathToFileURL } from "node:url";
import { findings } from "./accessibility.mjs";
import { launch } from "./browser.mjs";

const [executablePath, file, screenshots] = process.argv.slice(2);
const browser = await launch(executablePath);
const problems = [];

async function open(viewport, script = true) {
  const page = await browser.newPage();
  page.on("console", (message) => {
    if (["error", "warn"].includes(message.type())) problems.push(message.text());
  });
  page.on("pageerror", (error) => problems.push(String(error)));
  page.on("request", (request) => {
    if (!request.url().startsWith("file:")) problems.push(`fetches ${request.url()}`);
  });
  await page.setViewport(viewport);
  await page.setJavaScriptEnabled(script);
  await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: "light" }]);
  await page.goto(pathToFileURL(file).href);
  return page;
}

const figures = (page) => page.$$eval("figure", (all) => all.map((figure) => ({
  id: figure.id,
  drawn: figure.querySelectorAll(".plot svg path").length > 0,
  live: Boolean(figure.querySelector(".plot.live")),
})));
/** The drawing in sight. */
const drawn = (figure) => figure.$eval(".plot", (plot) => [...plot.querySelectorAll("svg.chart")].filter((svg) => svg.checkVisibility())
  .map((svg) => [...svg.querySelectorAll("text")].map((text) => text.textContent).join()).join());
// Not by `$$eval`, which makes a handle of every element.
const ticks = (figure) => figure.evaluate((node) => [...node.querySelectorAll(".x-tick")].map((tick) => tick.textContent));
const wide = { width: 1280, height: 900 };

/** One chart, looked into. */
async function used(page, id) {
  const figure = await page.$(`#${id}`);
  const plot = await figure.$(".plot");
  let box;
  const inSight = async () => {
    await plot.evaluate((node) => node.scrollIntoView({ block: "center" }));
    box = await plot.boundingBox();
  };
  await inSight();
  const at = (share) => [box.x + box.width * share, box.y + Math.min(box.height / 2, 120)];
  const whole = await ticks(figure);
  await page.mouse.move(...at(0.5));
  const readout = await figure.$eval(".readout", (node) => (node.hidden ? null :
    [...node.querySelectorAll("dt:not(.of)")].map((term) => [term.textContent, term.nextElementSibling.textContent])));
  const hair = await figure.evaluate((node) => node.querySelectorAll(".hair").length);
  // The downloads, intercepted at their link.
  const saved = await figure.evaluate((node) => {
    const links = [], click = HTMLAnchorElement.prototype.click;
    HTMLAnchorElement.prototype.click = function () { links.push([this.download, decodeURIComponent(this.href.split(",").slice(1).join(","))]); };
    for (const kind of ["csv", "svg"]) node.querySelector(`[aria-label="Download as ${kind.toUpperCase()}"]`).click();
    HTMLAnchorElement.prototype.click = click;
    return links;
  });
  // The downloaded drawing by itself: labels that its edge cuts, and traces that it names.
  const file = await page.evaluate((svg) => {
    const place = document.createElement("div");
    place.innerHTML = svg;
    document.body.append(place);
    const { left, right, top, bottom } = place.firstElementChild.getBoundingClientRect();
    const texts = [...place.querySelectorAll("text")], contents = texts.map((text) => text.textContent);
    const cut = texts.filter((text) => {
      const box = text.getBoundingClientRect();
      return box.left < left || box.right > right || box.top < top || box.bottom > bottom;
    }).map((text) => text.textContent);
    place.remove();
    return { cut, contents };
  }, saved[1][1]);
  const unnamed = await figure.$$eval("button.trace", (all, contents) => all.map((trace) => trace.childNodes[1].textContent)
    .filter((name) => !contents.includes(name)), file.contents);
  const table = saved[0][1].trim().split("\n");
  const downloads = { names: saved.map(([name]) => name.split(".").at(-1)), rows: table.length, head: table[0], svg: saved[1][1].slice(0, 4), cut: file.cut, unnamed };
  await page.mouse.move(...at(0.4));
  await page.mouse.down();
  await page.mouse.move(...at(0.5), { steps: 4 });
  await page.mouse.up();
  const zoomed = await ticks(figure);
  const linked = await page.$$eval("figure .plot.zoomed", (all) => all.map((node) => node.closest("figure").id));
  // Charts without a visible point or line.
  const empty = await page.$$eval("figure .plot.live", (all) => all.filter((node) => {
    const area = node.querySelector(":scope > svg:not(.still)").getBoundingClientRect();
    return ![...node.querySelectorAll(":scope > svg:not(.still) > svg path:not(.reference)")].some((path) => {
      const { left, right, top, bottom } = path.getBoundingClientRect();
      return path.getAttribute("d") && left <= area.right && right >= area.left && top <= area.bottom && bottom >= area.top;
    });
  }).map((node) => node.closest("figure").id));
  await page.keyboard.press("ArrowRight");
  const panned = await ticks(figure);
  await page.mouse.move(...at(0.5));
  await page.mouse.click(...at(0.5), { count: 2 });
  const back = await ticks(figure);
  const lines = () => figure.evaluate((node) => node.querySelectorAll(".plot svg svg path").length);
  const before = await lines();
  const trace = await figure.$("button.trace");
  let without = null, again = null, struck = "none";
  if (trace) {
    await trace.click();
    without = await lines();
    await page.emulateMediaType("print");
    struck = await trace.evaluate((node) => getComputedStyle(node).textDecorationLine);
    await page.emulateMediaType("screen");
    await trace.click();
    again = await lines();
  }
  // Labels that the edge of the drawing cuts.
  const cut = await figure.$eval(".plot > svg:not(.still)", (svg) => {
    const { left, right } = svg.getBoundingClientRect();
    return [...svg.querySelectorAll("text")].filter((text) => {
      const box = text.getBoundingClientRect();
      return getComputedStyle(svg).overflow !== "visible" && (box.left < left || box.right > right);
    }).map((text) => text.textContent);
  });
  // With a finger: the values stay when it lifts.
  await inSight();
  await page.touchscreen.tap(...at(0.5));
  const touched = await figure.$eval(".readout", (node) => !node.hidden);
  await page.touchscreen.tap(2, 2);
  const left = await figure.$eval(".readout", (node) => !node.hidden);
  // With the keyboard.
  await plot.focus();
  await page.keyboard.press("ArrowRight");
  const keyed = await figure.$eval(".readout", (node) => !node.hidden);
  // Although it is zoomed, the chart is printed whole.
  await page.keyboard.press("+");
  await page.emulateMediaType("print");
  const printed = await drawn(figure);
  await page.emulateMediaType("screen");
  // As far as it goes.
  for (let i = 0; i < 22; i++) await page.keyboard.press("+");
  const deep = await ticks(figure);
  await page.keyboard.press("Escape");
  return { id, downloads, whole, readout, hair, zoomed, linked, empty, printed, deep, panned, back, touched, left, keyed, struck, cut, traces: [before, without, again] };
}

const page = await open(wide);
const all = await figures(page);
const charts = [];
for (const { id, live } of all) if (live) charts.push(await used(page, id));

const serious = await findings(page);

const still = await open(wide, false);
const without_script = await figures(still);
for (const chart of charts) chart.still = await drawn(await still.$(`#${chart.id}`));

const phone = await open({ width: 390, height: 844, isMobile: true, hasTouch: true, deviceScaleFactor: 2 });
serious.push(...await findings(phone));
const narrow = await phone.evaluate(() => ({
  page_px: document.documentElement.scrollWidth,
  // Elements wider than their container, by figure or table.
  cut: [...document.querySelectorAll(".plot, .table")].filter((node) => node.scrollWidth > node.clientWidth + 1)
    .map((node) => (node.closest("figure") || node).id || node.textContent.slice(0, 40)),
  smallest_text_px: Math.min(...[...document.querySelectorAll(".plot .chart text")].filter((text) => text.checkVisibility()).map((text) =>
    parseFloat(getComputedStyle(text).fontSize) * text.ownerSVGElement.getBoundingClientRect().width /
    text.ownerSVGElement.viewBox.baseVal.width)),
}));

// A4 less the margins of print.
const sheet = await open({ width: 672, height: 980 });
await sheet.emulateMediaType("print");
const beyond_paper = await sheet.$$eval(".table", (all) => all.filter((node) => node.scrollWidth > node.clientWidth + 1)
  .map((node) => node.textContent.slice(0, 40)));
// Drawings of half a width that take a page each.
const stacked = await sheet.$$eval(".figures", (all) => all.filter(({ children: [first, second] }) => second &&
  first.getBoundingClientRect().top !== second.getBoundingClientRect().top).map((node) => node.textContent.slice(0, 40)));
// Parts that are folded, and take paper all the same.
const unfolded = await sheet.$$eval("details:not([open]) pre", (all) => all.filter((node) => node.checkVisibility({ contentVisibilityAuto: true }))
  .map((node) => node.textContent.slice(0, 40)));

for (const [name, viewport] of [["1280", wide], ["390", { width: 390, height: 844, deviceScaleFactor: 2 }]]) {
  const shot = await open(viewport);
  for (const scheme of ["light", "dark"]) {
    await shot.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
    await shot.screenshot({ path: `${screenshots}-${name}-${scheme}.png`, fullPage: true });
  }
  await shot.close();
}
await browser.close();
console.log(JSON.stringify({ problems, figures: all, charts, without_script, narrow, beyond_paper, stacked, unfolded, serious }));
