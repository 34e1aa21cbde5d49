// The playground's warnings of a scenario, on standard output.
//
//     node playground_warnings.mjs PLAYGROUND SCENARIO
import { readFile } from "node:fs/promises";
import { basename } from "node:path";

const [folder, scenario] = process.argv.slice(2);
// Loaded as text, as in playground_trace.mjs.
const script = await readFile(`${folder}/simulation.js`);
const { Simulation } = await import(`data:text/javascript;base64,${script.toString("base64")}`);
const simulation = await Simulation.load(await readFile(`${folder}/thermyo.wasm`));
simulation.start(await readFile(scenario, "utf8"), basename(scenario));
process.stdout.write(simulation.warnings());
