// Findings of axe-core on a page.
import axe from "axe-core";

/** Serious and critical findings, as "rule: place, place"; a page's own policy does not stop the script. */
export async function findings(page) {
  // Colours during a transition between two schemes do not count.
  await page.evaluate(() => Promise.allSettled(document.getAnimations().map(({ finished }) => finished)));
  const violations = await page.evaluate(`${axe.source}; axe.run().then(({ violations }) =>
    violations.map(({ id, impact, nodes }) => ({ id, impact, places: nodes.map(({ target }) => target.join(" ")) })))`);
  const serious = violations.filter(({ impact }) => ["serious", "critical"].includes(impact));
  return serious.map(({ id, places }) => `${id}: ${places.join(", ")}`);
}
