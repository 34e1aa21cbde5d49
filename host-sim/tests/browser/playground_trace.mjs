// The trace that the playground's module computes of a scenario, without a browser, on standard output.
//
//     node playground_trace.mjs PLAYGROUND SCENARIO
import { readFile } from "node:fs/promises";

const [folder, scenario] = process.argv.slice(2);
// Loaded as text: the folder is no package, so Node would have to guess the type of `.js` files.
const script = await readFile(`${folder}/simulation.js`);
const { Simulation } = await import(`data:text/javascript;base64,${script.toString("base64")}`);
const simulation = await Simulation.load(await readFile(`${folder}/thermyo.wasm`));
process.stdout.write(simulation.trace(await readFile(scenario, "utf8")));
