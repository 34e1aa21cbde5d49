// Pages of a local server in headless Chromium, for scripts that use them like a person.
import { launch } from "./browser.mjs";

// A limit against hanging, not a target.
// On a busy machine an emulated board is many times slower than a real one.
const timeout = 300000;
export const wide = { width: 1280, height: 900 };

/** The browser; opens pages of an address, and lists their problems: errors, warnings, and what they fetch elsewhere. */
export async function launched(executablePath, address) {
  const browser = await launch(executablePath, timeout);
  const problems = [];
  async function open(viewport, scheme = "light") {
    // With a renderer of its own, as on another computer: pages of one site share one, in which the first does not
    // answer while the second loads.
    const page = await (await browser.createBrowserContext()).newPage();
    page.setDefaultTimeout(timeout);
    page.on("console", (message) => {
      if (["error", "warn"].includes(message.type())) problems.push(message.text());
    });
    page.on("pageerror", (error) => problems.push(String(error)));
    page.on("request", (request) => {
      if (!/^(http|ws|data):/.test(request.url()) || (request.url().startsWith("http") && !request.url().startsWith(address))) {
        problems.push(`fetches ${request.url()}`);
      }
    });
    await page.setViewport(viewport);
    await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
    await page.goto(address);
    return page;
  }
  return { browser, open, problems };
}

export const text = (page, id) => page.$eval(`#${id}`, (node) => node.textContent);

/** Waits until `what` is true in the page. Reports the page's events if that does not happen. */
export async function until(page, what, ...values) {
  try {
    return await page.waitForFunction(what, { polling: 50 }, ...values);
  } catch (error) {
    const shown = await page.evaluate(() => ["armed", "mode", "events"].map((id) => document.getElementById(id)?.innerText));
    throw new Error(`${what}\nis not true: ${shown.join("; ")}`, { cause: error });
  }
}

export async function type(page, id, value) {
  await page.click(`#${id}`, { count: 3 });
  await page.type(`#${id}`, value);
}

const armed = async (page) => (await text(page, "armed")).startsWith("armed");

/** Arms the board of a live page, unless it is armed. */
export async function arms(page) {
  // Where the page has just connected again, it steers nothing yet.
  await until(page, () => !document.querySelector("#arm .main").disabled);
  if (!await armed(page)) await page.click("#arm .main");
  await until(page, () => document.getElementById("armed").textContent.startsWith("armed") && !document.querySelector("#steer .main").disabled);
}

/** Arms, gives an order, and waits until `reached` returns something in the live page. */
export async function drives(page, order, reached, ...values) {
  // If the machine pauses for longer than the link's timeout, or than a page may be silent, the board vents by itself.
  for (const end = Date.now() + 600000; Date.now() < end;) {
    await arms(page);
    await order();
    for (const again = Date.now() + 60000; await armed(page) && Date.now() < again;) {
      const found = await page.evaluate(reached, ...values);
      if (found) return found;
      await new Promise((done) => setTimeout(done, 50));
    }
  }
  throw new Error(`${reached}\nis not reached: ${await text(page, "events")}`);
}
