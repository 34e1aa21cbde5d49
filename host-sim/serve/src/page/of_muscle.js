// Part of the page for one muscle.
import { band, dashed, line } from "./live.js";
import { Muscle } from "./muscle.js";
import { digits, put, shownIn, symbol } from "./quantities.js";

/** In messages. */
export const words = { what: "muscle", vents: "the muscle vents", alone: "vents" };
/** It is calibrated, tuned and measured on the page, and its records are studied. */
export const studied = true;
/** Limit for the first arming, as in docs/reference/board.md [Pa]. */
export const first_pa = 1.5e5;

/** Data and axes that have a unit to choose. */
export const scaled = {
  Pa: { chart: "plot-pressure", least: 1e4, columns: ["pressure", "pressureSet"], fields: ["most", "tune-most"], mode: "pressure" },
  K: { chart: "plot-temperature", least: 2, columns: ["gas", "low", "high", "sensor"], fields: [] },
};

export const columns = ["pressure", "pressureSet", "gas", "low", "high", "sensor", "wall", "length", "contraction", "contractionSet", "inlet", "outlet"];
export const charts = [
  ["plot-pressure", { label: "Pressure, absolute", unit: "kPa", digits: 1, least: 10 },
    [line("measured", "measured", "pressure"), dashed("set point", "set-point", "pressureSet")]],
  ["plot-temperature", { label: "Gas temperature", unit: "K", digits: 2, least: 2 },
    [line("sensor", "sensor", "sensor"), line("estimate", "estimate", "gas"), band("± 2 sd", "estimate", "low", "high")]],
  ["plot-length", { label: "Contraction", unit: "%", digits: 2, least: 2 },
    [line("measured", "measured", "contraction"), dashed("set point", "set-point", "contractionSet")]],
  ["plot-duty", { label: "Valve openings", unit: "%", digits: 0, range: [-3, 103] },
    [line("inlet", "inlet", "inlet"), line("outlet", "outlet", "outlet")]],
];

/** Temperatures of the last row, whose colours do not depend on the chosen unit [K]. */
const kelvin = {};

/** A row of the server in displayed units. */
export function row([time, pressure_pa, length_m, sensor_k, gas_k, sd_k, wall_k, inlet, outlet, pressure_set_pa, contraction_set], configuration) {
  const rest = configuration?.rest_length_m;
  Object.assign(kelvin, { gas: gas_k, sensor: sensor_k });
  return {
    time, pressure: shownIn("Pa", pressure_pa), pressureSet: shownIn("Pa", pressure_set_pa),
    gas: shownIn("K", gas_k), low: shownIn("K", gas_k - 2 * sd_k), high: shownIn("K", gas_k + 2 * sd_k),
    sensor: shownIn("K", sensor_k), wall: wall_k,
    length: length_m * 1e3, contraction: rest ? (1 - length_m / rest) * 100 : NaN, contractionSet: contraction_set * 100,
    inlet: inlet * 100, outlet: outlet * 100,
  };
}

const $ = (id) => document.getElementById(id);
let muscle = null;

export function showReadings(now, configuration) {
  muscle ??= new Muscle($("muscle"));
  muscle.draw({ ...now, ...kelvin }, configuration);
  put("r-pressure", now.pressure.toFixed(digits("Pa")), symbol("Pa"));
  put("r-gas", now.gas.toFixed(2), `± ${(now.high - now.gas).toFixed(2)} ${symbol("K")}`);
  put("r-sensor", now.sensor.toFixed(2), symbol("K"));
  const contracted = Number.isFinite(now.contraction);
  $("r-length-name").textContent = contracted ? "Length, contraction" : "Length";
  put("r-length", now.length.toFixed(1), contracted ? `mm, ${now.contraction.toFixed(1)} %` : "mm");
  put("r-duty", `${now.inlet.toFixed(0)}, ${now.outlet.toFixed(0)}`, "%");
}

/** Fields of gas temperatures, and whether each is to be relied on. */
export const gases = (valid) => [["r-gas", valid]];

/** For each mode: its values with their SI symbols, and the order. */
export const modes = {
  pressure: { first: ["Pressure", "Pa"], set: ([pressure_pa]) => ({ set: { Pressure: { pressure_pa } } }) },
  contraction: { first: ["Contraction", ""], set: ([contraction]) => ({ set: { Contraction: { contraction } } }) },
  flow: { first: ["In and out", "kg/s"], second: ["period", "s"], unchecked: true, set: ([flow_kg_s, period_s]) => ({ set: { MassFlowCycle: { flow_kg_s, period_s } } }) },
  duty: { first: ["Inlet", ""], second: ["outlet", ""], set: ([inlet, outlet]) => ({ set: { Duty: { inlet, outlet } } }) },
};
export const kept = { pressure: ["130", ""], contraction: ["5", ""], flow: ["0.36", "5"], duty: ["0", "100"] };

/** Range of the first value, in SI; the board checks flows itself. */
export function limits(mode, { ambient_pa, working_limit_pa, contractions }, armed_pa) {
  if (mode === "pressure") return [ambient_pa, Math.min(armed_pa ?? working_limit_pa, working_limit_pa)];
  if (mode === "contraction") return contractions;
  return mode === "duty" ? [0, 1] : [0, .002];
}

export const secondLimits = (mode) => (mode === "duty" ? [0, 1] : undefined);

export const showState = () => {};

export const facts = () => [];

export function hint(mode, range) {
  return mode === "flow" ? "The working cycle: half of the period in, half out." : mode === "duty" ? "Fixed openings." : `From ${range}${mode === "pressure" ? ", absolute" : ""}.`;
}
