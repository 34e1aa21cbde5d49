// The views of one muscle and of a joint: columns of the trace, knobs, plots, readings and drawing.
import { Joint } from "./joint.js";
import { band, dashed, line, wide } from "./live.js";
import { Muscle } from "./muscle.js";

const DEG = 180 / Math.PI;
const always = () => true;

/** Key, name, unit, factor from SI, least, most, digits; where it applies. */
const SUPPLY = ["supply.pressure_pa", "Supply", "kPa", 1e-3, 150, 1000, 0, always];
const HEAT = ["heat.scale", "Heat transfer, gas to wall", "×", 1, .1, 4, 2, always];
const LAG = ["sensor.gas.time_constant_s", "Sensor lag", "s", 1, 0, 15, 2, always];

const loaded = (settings) => settings.plant.kind !== "vessel";
const isotonic = (settings) => loaded(settings) && settings.load.kind === "isotonic";
const lifted = (settings) => loaded(settings) && settings.load.kind === "mass";
const driven = (kind) => (settings) => settings.drive.kind === kind && !settings.drive.profile_csv;
const swings = (settings) => settings.drive.shape !== "constant";

/** The braid of a muscle with its rest length; none of a vessel or a cylinder. */
const braided = ({ plant, muscle: { rest_length_m, thread_length_m, turns } }) =>
  plant.kind === "muscle" ? { rest_length_m, braid: { thread_length_m, turns } } : null;

/** Adds the band of an estimate to a row; `of` begins the names. */
function withBand(row, of = "") {
  const estimate = row[`${of}estimate`], sd = row[`${of}sd`];
  row[`${of}low`] = estimate - 2 * sd;
  row[`${of}high`] = estimate + 2 * sd;
}

const temperatures = (of) => [
  wide("gas", "truth", `${of}gas`), line("sensor", "sensor", `${of}sensor`), line("estimate", "estimate", `${of}estimate`),
  band("± 2 sd", "estimate", `${of}low`, `${of}high`)];
const OPENINGS = { unit: "%", digits: 0, range: [-3, 103] };
const openings = (of) => [line("inlet", "inlet", `${of}inlet`), line("outlet", "outlet", `${of}outlet`)];

const MUSCLE = {
  trace: "trace.csv",
  /** Displayed quantities: column in the trace, factor from SI. */
  columns: {
    time: ["time_s", 1], pressure: ["pressure_pa", 1e-3], length: ["length_m", 1e3], gas: ["gas_temperature_k", 1],
    wall: ["wall_temperature_k", 1], sensor: ["sensor_gas_k", 1], estimate: ["estimate_k", 1], sd: ["estimate_sd_k", 1],
    inlet: ["duty_in", 100], outlet: ["duty_out", 100], wanted: ["set_point", 1],
  },
  knobs: [
    ["drive.pressure_pa", "Set point", "kPa", 1e-3, 110, 600, 0, driven("pressure")],
    ["drive.contraction", "Set point", "%", 100, 0, 22, 1, driven("contraction")],
    ["drive.flow_kg_s", "Set point: flow in and out", "g/s", 1e3, .02, .5, 2, driven("mass-flow")],
    ["drive.period_s", "Period of a cycle", "s", 1, .5, 10, 1, driven("mass-flow")],
    SUPPLY,
    ["load.force_n", "Load", "N", 1, 0, 400, 0, isotonic],
    ["load.mass_kg", "Load", "kg", 1, 0, 40, 1, lifted],
    HEAT,
    LAG,
  ],
  /** Further columns, which `derive` adds to a row. */
  derived: ["low", "high", "error", "least", "most", "contraction", "pressureSet", "contractionSet"],
  derive(row, { drive: { kind } }, muscle) {
    withBand(row);
    row.error = row.estimate - row.gas;
    row.least = -2 * row.sd;
    row.most = 2 * row.sd;
    if (muscle) row.contraction = 100 * (1 - row.length / 1e3 / muscle.rest_length_m);
    if (kind === "pressure") row.pressureSet = row.wanted / 1e3;
    if (kind === "contraction") row.contractionSet = row.wanted * 100;
  },
  charts: [
    ["plot-temperature", { label: "Gas temperature", unit: "K", digits: 2, least: 2 }, temperatures("")],
    ["plot-error", { label: "Error of the estimate", unit: "K", digits: 2, least: .5 },
      [line("estimate less truth", "estimate", "error"), band("± 2 sd", "estimate", "least", "most")]],
    ["plot-pressure", { label: "Pressure, absolute", unit: "kPa", digits: 1, least: 10 },
      [line("simulated", "measured", "pressure"), dashed("set point", "set-point", "pressureSet")]],
    ["plot-length", { label: "Contraction", unit: "%", digits: 2, least: 2 },
      [line("simulated", "measured", "contraction"), dashed("set point", "set-point", "contractionSet")]],
    ["plot-duty", { label: "Valve openings", ...OPENINGS }, openings("")],
  ],
  drawing: ["muscle", Muscle],
  facts: braided,
  /** Elements to hide: a vessel has neither length nor braid. */
  hidden: ({ plant: { kind } }) => [
    ...(kind === "muscle" ? [] : ["plot-length"]), ...(kind === "vessel" ? ["muscle", "r-length-row"] : [])],
  /** Pairs of columns whose RMS difference `readings` shows. */
  errors: [["estimate", "gas"], ["sensor", "gas"]],
  /** Name of an element, value, unit. */
  readings(now, [estimated, sensed]) {
    const contracted = Number.isFinite(now.contraction);
    return [
      ["r-pressure", now.pressure.toFixed(1), "kPa"],
      ["r-gas", now.gas.toFixed(2), "K"],
      ["r-sensor", now.sensor.toFixed(2), "K"],
      ["r-error", estimated.toFixed(2), `K, of the sensor ${sensed.toFixed(2)} K`],
      ["r-estimate", now.estimate.toFixed(2), `± ${(2 * now.sd).toFixed(2)} K`],
      ["r-length-name", contracted ? "Length, contraction" : "Length"],
      ["r-length", now.length.toFixed(1), contracted ? `mm, ${now.contraction.toFixed(1)} %` : "mm"],
    ];
  },
};

/** Columns of one muscle of a joint. */
const sided = (of) => Object.fromEntries(Object.entries({
  pressure: ["pressure_pa", 1e-3], length: ["length_m", 1e3], gas: ["gas_temperature_k", 1], sensor: ["sensor_gas_k", 1],
  estimate: ["estimate_k", 1], sd: ["estimate_sd_k", 1], inlet: ["duty_in", 100], outlet: ["duty_out", 100],
}).map(([name, [column, factor]]) => [`${of}${name}`, [`${of}${column}`, factor]]));

const JOINT = {
  trace: "joint_trace.csv",
  columns: {
    time: ["time_s", 1], angle: ["angle_rad", DEG], angleSet: ["angle_reference_rad", DEG],
    stiffness: ["stiffness_n_m_rad", 1], stiffnessSet: ["stiffness_reference_n_m_rad", 1], torque: ["torque_n_m", 1],
    ...sided("a_"), ...sided("b_"),
  },
  knobs: [
    ["drive.angle_rad", "Angle", "deg", DEG, -40, 40, 1, (settings) => !swings(settings)],
    ["drive.angle_rad", "Middle of the angle", "deg", DEG, -40, 40, 1, swings],
    ["drive.amplitude_rad", "Amplitude", "deg", DEG, 0, 40, 1, swings],
    ["drive.period_s", "Period", "s", 1, .3, 10, 2, swings],
    ["drive.stiffness_n_m_rad", "Stiffness", "N m/rad", 1, 6, 30, 1, always],
    ["drive.load_n_m", "Torque from outside", "N m", 1, -5, 5, 1, always],
    ["joint.gravity_n_m", "Gravity, arm held out", "N m", 1, 0, 10, 1, always],
    ["joint.inertia_kg_m2", "Inertia of the arm", "kg m²", 1, .005, .2, 3, always],
    ["joint.friction_n_m", "Dry friction of the bearing", "N m", 1, 0, 2, 2, always],
    SUPPLY,
    HEAT,
    LAG,
  ],
  derived: ["a_low", "a_high", "b_low", "b_high"],
  derive(row) {
    withBand(row, "a_");
    withBand(row, "b_");
  },
  charts: [
    ["plot-angle", { label: "Angle", unit: "deg", digits: 2, least: 2 },
      [line("simulated", "measured", "angle"), dashed("reference", "set-point", "angleSet")]],
    ["plot-stiffness", { label: "Stiffness", unit: "N m/rad", digits: 2, least: 2 },
      [line("simulated", "measured", "stiffness"), dashed("reference", "set-point", "stiffnessSet")]],
    ["plot-pressures", { label: "Pressures, absolute", unit: "kPa", digits: 1, least: 10 },
      [line("a", "blue", "a_pressure"), line("b", "vermillion", "b_pressure")]],
    ["plot-gas-a", { label: "Gas of a", unit: "K", digits: 1, least: 2 }, temperatures("a_")],
    ["plot-gas-b", { label: "Gas of b", unit: "K", digits: 1, least: 2 }, temperatures("b_")],
    ["plot-duty-a", { label: "Valves of a", ...OPENINGS }, openings("a_")],
    ["plot-duty-b", { label: "Valves of b", ...OPENINGS }, openings("b_")],
  ],
  drawing: ["joint", Joint],
  facts({ joint, b, ...a }) {
    const { radius_m, mid_length_a_m, mid_length_b_m, minimum_rad, maximum_rad, gravity_angle_rad } = joint;
    // The integral of the radius from angle 0 on.
    const way_m = (of, share, q) => radius_m * q * (share + q * (joint[`radius_${of}_per_rad`] / 2
      + q * (joint[`radius_${of}_per_rad2`] / 3 + q * joint[`radius_${of}_per_rad3`] / 4)));
    return {
      radius_m, stops_rad: [minimum_rad, maximum_rad], hangs_rad: gravity_angle_rad,
      lengths_m: [
        mid_length_a_m - way_m("a", 1, minimum_rad),
        mid_length_b_m + way_m("b", joint.radius_b_share, maximum_rad),
      ],
      braids: [a, b].map((muscle) => braided(muscle)?.braid),
    };
  },
  hidden: () => [],
  errors: [["angle", "angleSet"], ["a_estimate", "a_gas"], ["b_estimate", "b_gas"]],
  readings(now, [angle, a, b]) {
    const both = (name, digits) => ["a_", "b_"].map((of) => now[of + name].toFixed(digits)).join(", ");
    return [
      ["r-angle", `${now.angle.toFixed(1)}, ${now.angleSet.toFixed(1)}`, "deg"],
      ["r-stiffness", `${now.stiffness.toFixed(1)}, ${now.stiffnessSet.toFixed(1)}`, "N m/rad"],
      ["r-pressures", both("pressure", 0), "kPa"],
      ["r-torque", now.torque.toFixed(2), "N m"],
      ["r-angle-error", angle.toFixed(2), "deg"],
      ["r-gases", both("gas", 1), "K"],
      ["r-estimates", both("estimate", 1), "K"],
      ["r-errors", `${a.toFixed(2)}, ${b.toFixed(2)}`, "K"],
    ];
  },
};

export const VIEWS = { muscle: MUSCLE, joint: JOINT };
