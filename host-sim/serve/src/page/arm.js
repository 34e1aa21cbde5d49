// The arm on its pulley at its angle, both muscles in the colours of their gas, and the reference, dashed.
import { air, colour, flowing, gradients, make, scale } from "./muscle.js";

const WIDTH = 860, HEIGHT = 300, AXIS = [500, 150], PULLEY = 46, ARM = 128, ROOT = 150, REACH = 190, THICK = 19;
/** Way of a muscle's end at the farther stop, and along the pulley for a radian. */
const FARTHEST = 60;

/** Point at a distance from the axis and an angle [rad], which grows upwards. */
const at = (distance, angle) => [AXIS[0] + distance * Math.cos(angle), AXIS[1] - distance * Math.sin(angle)].map((x) => x.toFixed(1));
const spoke = (from, to, angle) => `M${at(from, angle).join(" ")}L${at(to, angle).join(" ")}`;
const radians = (degrees) => degrees / 180 * Math.PI;

export class Arm {
  constructor(place) {
    const svg = make("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": "The arm at its angle, and both muscles in the colours of their gas" }, place);
    gradients(svg, "-arm");
    this.muscles = [-1, 1].map((side) => this.muscle(svg, AXIS[1] + side * PULLEY, side));
    this.range = make("path", { fill: "none", stroke: "#5d5c6c", "stroke-width": 2 }, svg);
    this.labels = ["start", "start", "start"].map((anchor) => make("text", { "text-anchor": anchor, class: "fine" }, svg));
    make("circle", { cx: AXIS[0], cy: AXIS[1], r: PULLEY, fill: "#23222e", stroke: "#8d8c9c", "stroke-width": 3 }, svg);
    this.arm = make("path", { stroke: "#e8e6f0", "stroke-width": 12, "stroke-linecap": "round" }, svg);
    this.reference = make("path", { stroke: "#ffb86b", "stroke-width": 3, "stroke-dasharray": "7 6", fill: "none" }, svg);
    make("circle", { cx: AXIS[0], cy: AXIS[1], r: 9, fill: "#8d8c9c" }, svg);
    scale(svg, "-arm");
  }

  /** A muscle and its tendon at a height; a side of -1 is above the axis. */
  muscle(svg, y, side) {
    const tendon = make("path", { stroke: "#8d8c9c", "stroke-width": 3 }, svg);
    const body = make("rect", { x: ROOT, rx: THICK }, svg), shade = make("rect", { x: ROOT, rx: THICK, fill: "url(#round-arm)" }, svg);
    make("rect", { x: ROOT - 16, y: y - 13, width: 22, height: 26, rx: 3, fill: "#5d5c6c" }, svg);
    const fitting = make("rect", { y: y - 10, width: 20, height: 20, rx: 3, fill: "#5d5c6c" }, svg);
    const name = make("text", { y: y + 5, "text-anchor": "middle" }, svg, side < 0 ? "a" : "b");
    name.style.cssText = "fill:#fff;font-weight:600;paint-order:stroke;stroke:#0009;stroke-width:3px";
    // Air enters above the port, and leaves below it.
    const inlet = make("path", { d: `M70 ${y - 13}h48m-9-7l9 7l-9 7` }, svg), outlet = make("path", { d: `M118 ${y + 13}h-48m9-7l-9 7l9 7` }, svg);
    for (const arrow of [inlet, outlet]) air(arrow);
    for (const [text, height] of [["in", y - 8], ["out", y + 18]]) make("text", { x: 60, y: height, "text-anchor": "end", class: "fine" }, svg, text);
    return { y, side, tendon, body, shade, fitting, name, inlet, outlet };
  }

  /** Draws the present state: angles in degrees, gas temperatures in K, openings in %. */
  draw(now, joint) {
    const angle = radians(now.angle), [low, high] = joint ? [joint.minimum_rad, joint.maximum_rad] : [-1, 1];
    const way = Math.min(PULLEY, FARTHEST / Math.max(Math.abs(low), Math.abs(high)));
    this.arm.setAttribute("d", spoke(0, ARM, angle));
    this.reference.setAttribute("d", Number.isFinite(now.angleSet) ? spoke(PULLEY, ARM + 14, radians(now.angleSet)) : "");
    const arc = Array.from({ length: 49 }, (_, i) => at(ARM + 10, low + (high - low) * i / 48).join(" ")).join("L");
    this.range.setAttribute("d", `M${arc}${[low, 0, high].map((stop) => spoke(ARM + 5, ARM + 15, stop)).join("")}`);
    [low, 0, high].forEach((stop, i) => {
      const [x, y] = at(ARM + 22, stop);
      this.labels[i].setAttribute("x", x);
      this.labels[i].setAttribute("y", +y + 4);
      this.labels[i].textContent = `${(stop / Math.PI * 180).toFixed(0)}°`;
    });
    this.muscles.forEach((muscle, i) => this.place(muscle, way * angle, now.kelvin[i], ["a", "b"].map((side) => [now[`inlet_${side}`], now[`outlet_${side}`]])[i]));
  }

  /** Muscle a, above, is shorter by the way of the pulley, and muscle b longer. */
  place({ y, side, tendon, body, shade, fitting, name, inlet, outlet }, way, gas_k, [opens_in, opens_out]) {
    const long = REACH + side * way, thick = THICK - side * way * .1, end = ROOT + long;
    for (const part of [body, shade]) for (const [key, value] of Object.entries({ y: y - thick, width: long, height: 2 * thick })) part.setAttribute(key, value);
    body.setAttribute("fill", colour(gas_k));
    fitting.setAttribute("x", end - 4);
    tendon.setAttribute("d", `M${end + 16} ${y}H${AXIS[0]}`);
    name.setAttribute("x", ROOT + long / 2);
    inlet.style.opacity = flowing(opens_in);
    outlet.style.opacity = flowing(opens_out);
  }
}
