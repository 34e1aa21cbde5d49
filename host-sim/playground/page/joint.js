// Side view of a joint: two muscles in the colours of their gas, pulling on a pulley against each other, and the arm
// that they turn. Lengths, pulley and angle are to scale; the arm is drawn relative to gravity, which points down.
import { air, braidRadius, colour, flowing, gradients, make, outline, scale } from "./muscle.js";

const WIDTH = 860, HEIGHT = 270, AXIS = 135, LEFT = 118, LONGEST = 400, PLAIN_RADIUS = 16, FITTING = 7, ARM = 96, WEIGHT = 13;

export class Joint {
  constructor(place) {
    const svg = make("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": "Both muscles in the colours of their gas, and the arm" }, place);
    gradients(svg, "-joint");
    make("path", { d: `M${LEFT - 20} ${AXIS - 74}v148`, stroke: "#5d5c6c", "stroke-width": 10, "stroke-linecap": "round" }, svg);
    this.stops = make("path", { fill: "none", stroke: "#8d8c9c", "stroke-width": 3, "stroke-linecap": "round" }, svg);
    this.reference = make("path", { fill: "none", stroke: "#e8e6f0", "stroke-width": 3, "stroke-dasharray": "5 5" }, svg);
    this.muscles = [-1, 1].map((side) => new Side(svg, side));
    this.pulley = make("circle", { cy: AXIS, fill: "#3a3947", stroke: "#8d8c9c", "stroke-width": 3 }, svg);
    this.arm = make("path", { fill: "none", stroke: "#e8e6f0", "stroke-width": 7, "stroke-linecap": "round" }, svg);
    this.weight = make("circle", { r: WEIGHT, fill: "#e8e6f0" }, svg);
    this.hub = make("circle", { cy: AXIS, r: 5, fill: "#0b0a14" }, svg);
    make("text", { x: WIDTH - 8, y: HEIGHT - 12, "text-anchor": "end", class: "fine" }, svg, "dashed: reference; marks: stops");
    scale(svg, "-joint");
  }

  /** Draws the present state: angles in deg, lengths in mm, temperatures in K, openings in %. */
  draw(now, { radius_m, lengths_m, stops_rad, hangs_rad, braids }) {
    const px = LONGEST / Math.max(...lengths_m);
    const radius = Math.min(60, Math.max(22, radius_m * px));
    const x = LEFT + LONGEST + 40 + radius;
    // A growing angle turns anticlockwise, as muscle a, above, pulls.
    const along = (rad, from, to) => {
      const [right, down] = [Math.sin(rad - hangs_rad), Math.cos(rad - hangs_rad)];
      return `M${(x + from * right).toFixed(1)} ${(AXIS + from * down).toFixed(1)}L${(x + to * right).toFixed(1)} ${(AXIS + to * down).toFixed(1)}`;
    };
    const rad = now.angle * Math.PI / 180;
    for (const circle of [this.pulley, this.hub]) circle.setAttribute("cx", x);
    this.pulley.setAttribute("r", radius);
    this.stops.setAttribute("d", stops_rad.map((stop) => along(stop, ARM + 18, ARM + 28)).join(""));
    this.reference.setAttribute("d", Number.isFinite(now.angleSet) ? along(now.angleSet * Math.PI / 180, radius, ARM + 26) : "");
    this.arm.setAttribute("d", along(rad, 0, ARM));
    this.weight.setAttribute("cx", x + ARM * Math.sin(rad - hangs_rad));
    this.weight.setAttribute("cy", AXIS + ARM * Math.cos(rad - hangs_rad));
    this.muscles.forEach((side, i) => {
      const { [`${"ab"[i]}_gas`]: gas, [`${"ab"[i]}_length`]: length, [`${"ab"[i]}_inlet`]: inlet, [`${"ab"[i]}_outlet`]: outlet } = now;
      side.draw({ gas, length: length / 1e3, inlet, outlet }, { px, radius, x, braid: braids[i] });
    });
  }
}

/** One muscle, above the axis or below it. */
class Side {
  constructor(svg, side) {
    this.side = side;
    this.tendon = make("path", { fill: "none", stroke: "#8d8c9c", "stroke-width": 3 }, svg);
    this.gas = make("path", {}, svg);
    this.shade = make("path", { fill: "url(#round-joint)" }, svg);
    this.fittings = [0, 1].map(() => make("rect", { width: 18, height: 2 * FITTING + 4, rx: 3, fill: "url(#metal-joint)" }, svg));
    this.name = make("text", { "text-anchor": "middle" }, svg, side < 0 ? "a" : "b");
    this.name.style.cssText = "fill:#fff;paint-order:stroke;stroke:#0008;stroke-width:3px";
    this.inlet = make("path", {}, svg);
    this.outlet = make("path", {}, svg);
    for (const arrow of [this.inlet, this.outlet]) air(arrow, 3);
    this.words = ["in", "out"].map((word) => make("text", { "text-anchor": "end", class: "fine" }, svg, word));
  }

  draw({ gas, length, inlet, outlet }, { px, radius, x, braid }) {
    const y = AXIS + this.side * radius, long = length * px, end = LEFT + long;
    // Neither muscle may reach over the axis.
    const thick = Math.min(radius - 3, braid ? braidRadius(braid, length) * px : PLAIN_RADIUS);
    const body = outline([LEFT, y], long, thick, FITTING);
    this.gas.setAttribute("d", body);
    this.gas.setAttribute("fill", colour(gas));
    this.shade.setAttribute("d", body);
    this.fittings.forEach((fitting, i) => {
      fitting.setAttribute("x", i ? end - 4 : LEFT - 14);
      fitting.setAttribute("y", y - FITTING - 2);
    });
    this.tendon.setAttribute("d", `M${end + 10} ${y}H${x}`);
    this.name.setAttribute("x", LEFT + long / 2);
    this.name.setAttribute("y", y + 4);
    this.inlet.setAttribute("d", `M46 ${y - 10}h38m-8-6l8 6l-8 6`);
    this.outlet.setAttribute("d", `M84 ${y + 10}h-38m8-6l-8 6l8 6`);
    this.words.forEach((word, i) => {
      word.setAttribute("x", 38);
      word.setAttribute("y", y + (i ? 14 : -6));
    });
    this.inlet.style.opacity = flowing(inlet);
    this.outlet.style.opacity = flowing(outlet);
  }
}
