// Part of the page for a joint: two muscles against each other, a and b.
import { Arm } from "./arm.js";
import { band, dashed, line } from "./live.js";
import { digits, format, put, shownIn, symbol } from "./quantities.js";

/** In messages. */
export const words = { what: "joint", vents: "both muscles vent", alone: "vents" };
export const studied = false;
/** Limit for the first arming, as in docs/how-to/joint.md [Pa]. */
export const first_pa = 2e5;

const SIDES = ["a", "b"];
/** Shown names of both muscles' columns. */
const both = (...names) => names.flatMap((name) => SIDES.map((side) => `${name}_${side}`));

/** Data and axes that have a unit to choose. */
export const scaled = {
  Pa: { chart: "plot-pressure", least: 1e4, columns: both("pressure"), fields: ["most"], mode: "pressures" },
  K: { chart: "plot-temperature", least: 2, columns: both("gas", "low", "high", "sensor"), fields: [] },
};

export const columns = ["angle", "angleSet", "stiffness", "stiffnessSet", "torque", ...both("pressure", "gas", "low", "high", "sensor", "inlet", "outlet")];
export const charts = [
  ["plot-angle", { label: "Angle", unit: "°", digits: 2, least: 2 },
    [line("measured", "measured", "angle"), dashed("reference", "set-point", "angleSet")]],
  ["plot-stiffness", { label: "Stiffness", unit: "N m/rad", digits: 1, least: 2 },
    [line("measured", "measured", "stiffness"), dashed("set point", "set-point", "stiffnessSet")]],
  ["plot-pressure", { label: "Pressures, absolute", unit: "kPa", digits: 1, least: 10 },
    [line("a", "blue", "pressure_a"), line("b", "vermillion", "pressure_b")]],
  ["plot-temperature", { label: "Gas temperatures", unit: "K", digits: 2, least: 2 },
    [line("a", "blue", "gas_a"), band("± 2 sd", "blue", "low_a", "high_a"), line("b", "vermillion", "gas_b"), band("± 2 sd", "vermillion", "low_b", "high_b")]],
  ["plot-duty", { label: "Valve openings", unit: "%", digits: 0, range: [-3, 103] },
    [line("inlet a", "blue", "inlet_a"), line("outlet a", "sky", "outlet_a"), line("inlet b", "vermillion", "inlet_b"), line("outlet b", "orange", "outlet_b")]],
];

/** Gas temperatures of the last row, whose colours do not depend on the chosen unit [K]. */
let kelvin = [NaN, NaN];

/** A row of the server in displayed units. */
export function row([time, angle_rad, angle_set_rad, stiffness, stiffness_set, torque, pressures_pa, gases_k, sds_k, sensors_k, inlets, outlets]) {
  kelvin = gases_k;
  const shown = { time, angle: shownIn("rad", angle_rad), angleSet: shownIn("rad", angle_set_rad), stiffness, stiffnessSet: stiffness_set, torque };
  SIDES.forEach((side, i) => Object.assign(shown, {
    [`pressure_${side}`]: shownIn("Pa", pressures_pa[i]),
    [`gas_${side}`]: shownIn("K", gases_k[i]),
    [`low_${side}`]: shownIn("K", gases_k[i] - 2 * sds_k[i]),
    [`high_${side}`]: shownIn("K", gases_k[i] + 2 * sds_k[i]),
    [`sensor_${side}`]: shownIn("K", sensors_k[i]),
    [`inlet_${side}`]: inlets[i] * 100,
    [`outlet_${side}`]: outlets[i] * 100,
  }));
  return shown;
}

let arm = null;

export function showReadings(now, configuration) {
  arm ??= new Arm(document.getElementById("arm-scene"));
  arm.draw({ ...now, kelvin }, configuration?.joint);
  put("r-angle", now.angle.toFixed(2), symbol("rad"));
  put("r-reference", Number.isFinite(now.angleSet) ? now.angleSet.toFixed(2) : "–", Number.isFinite(now.angleSet) ? symbol("rad") : "");
  put("r-stiffness", now.stiffness.toFixed(1), symbol("N m/rad"));
  put("r-torque", now.torque.toFixed(2), symbol("N m"));
  for (const side of SIDES) {
    put(`r-pressure-${side}`, now[`pressure_${side}`].toFixed(digits("Pa")), symbol("Pa"));
    const gas = now[`gas_${side}`];
    put(`r-gas-${side}`, gas.toFixed(2), `± ${(now[`high_${side}`] - gas).toFixed(2)} ${symbol("K")}`);
    put(`r-duty-${side}`, `${now[`inlet_${side}`].toFixed(0)}, ${now[`outlet_${side}`].toFixed(0)}`, "%");
  }
}

/** Fields of gas temperatures, and whether each is to be relied on. */
export const gases = (valid) => SIDES.map((side, i) => [`r-gas-${side}`, valid[i]]);

const STIFFNESS = ["stiffness", "N m/rad"];
/** Largest torque and stiffness that the core takes, in SI. */
const LARGEST = 1e6;
/** For each mode: its values with their SI symbols, and the order. */
export const modes = {
  angle: {
    first: ["Angle", "rad"], second: STIFFNESS,
    set: ([angle_rad, stiffness_n_m_rad]) => ({ set_joint: { Angle: { angle_rad, speed_rad_s: 0, acceleration_rad_s2: 0, stiffness_n_m_rad } } }),
  },
  torque: {
    first: ["Torque", "N m"], second: STIFFNESS, plain: true,
    set: ([torque_n_m, stiffness_n_m_rad]) => ({ set_joint: { Torque: { torque_n_m, stiffness_n_m_rad } } }),
  },
  pressures: {
    first: ["Muscle a", "Pa"], second: ["muscle b", "Pa"],
    set: (pressure_pa) => ({ set_joint: { Pressures: { pressure_pa } } }),
  },
};
/** A small first movement, as in docs/how-to/joint.md. */
export const kept = { angle: ["5", "6"], torque: ["0", "6"], pressures: ["150", "150"] };

/** Range of the first value, in SI. */
export function limits(mode, { ambient_pa, working_limit_pa, joint }, armed_pa) {
  if (mode === "pressures") return [ambient_pa, Math.min(armed_pa ?? working_limit_pa, working_limit_pa)];
  return mode === "angle" ? [joint.minimum_rad, joint.maximum_rad] : [-LARGEST, LARGEST];
}

export const secondLimits = (mode, first) => (mode === "pressures" ? first : [0, LARGEST]);

export function hint(mode, range) {
  if (mode === "pressures") return `From ${range}, absolute. Angle and stiffness follow from them.`;
  return mode === "angle" ? `From ${range}. Where pressures are at their limit, the stiffness gives way.` : "Positive towards growing angles. The angle is left to the arm.";
}

/** What only the state of a joint's board shows. */
export function showState({ configuration: { joint } }) {
  document.getElementById("locks").hidden = !joint.lock_s;
  document.getElementById("lock-text").textContent = `All valves shut, for ${joint.lock_s} s at most; then both vent.`;
  words.alone = joint.lock_s ? "locks, and then vents" : "vents";
}

export const facts = ({ joint }) => [
  ["Stops", `${format("rad", joint.minimum_rad)} to ${format("rad", joint.maximum_rad)} ${symbol("rad")}`],
  ["Lock", joint.lock_s ? `${joint.lock_s} s at most` : "never"],
];
