// Headless Chromium for the tests of pages.
import puppeteer from "puppeteer-core";

/** Pages of the browser itself, which it prepares for a user, and which would take seconds of the processor. */
const unused = ["WebUIOmniboxPopup", "WebUIOmniboxAimPopup", "PreloadTopChromeWebUI"];
const args = ["--no-sandbox", "--disable-gpu", "--disable-extensions", `--disable-features=${unused.join()}`];

/** Starts the browser; waits `timeout` [ms] for it. */
export const launch = (executablePath, timeout) => puppeteer.launch({ executablePath, timeout, args });
