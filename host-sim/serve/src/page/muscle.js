// Side view of the muscle, coloured by temperature: the wall around the gas, and the sensor in it.
// Length and diameter follow from the measured length.
import palette from "./palette.js";

const SVG = "http://www.w3.org/2000/svg";
const WIDTH = 860, HEIGHT = 190, AXIS = 92, LEFT = 150, LONGEST = 520, PLAIN_RADIUS = 36, FITTING = 15, TAPER = 46, WALL = 9;
/** Ends of the colours [K], the same in every session: 5 and 45 °C. */
const SCALE_K = [278, 318];
const STEPS = 48, THREADS = 26;

export function make(name, attributes, parent, text) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== undefined) node.textContent = text;
  parent.append(node);
  return node;
}

/** Colour of a temperature [K]. */
export const colour = (kelvin) => palette[Math.round(Math.min(1, Math.max(0, (kelvin - SCALE_K[0]) / (SCALE_K[1] - SCALE_K[0]))) * (palette.length - 1))];

/** Draws the scale of the colours. */
export function bar(svg) {
  const shades = make("linearGradient", { id: "bar", x1: 0, x2: 0, y1: 1, y2: 0 }, make("defs", {}, svg));
  palette.forEach((shade, i) => make("stop", { offset: i / (palette.length - 1), "stop-color": shade }, shades));
  make("rect", { x: 786, y: 24, width: 12, height: 132, fill: "url(#bar)", rx: 2 }, svg);
  [156, 24].forEach((y, i) => make("text", { x: 804, y: y + 4 }, svg, SCALE_K[i]));
  make("text", { x: 786, y: 178, class: "fine" }, svg, "K");
}

export class Muscle {
  constructor(place) {
    const svg = make("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": "The muscle in the colours of its temperatures" }, place);
    const defs = make("defs", {}, svg);
    const round = make("linearGradient", { id: "round", x1: 0, x2: 0, y1: 0, y2: 1 }, defs);
    for (const [offset, colour, opacity] of [[0, "#000", .62], [.2, "#000", .16], [.36, "#fff", .2], [.52, "#fff", 0], [.78, "#000", .2], [1, "#000", .7]]) {
      make("stop", { offset, "stop-color": colour, "stop-opacity": opacity }, round);
    }
    const metal = make("linearGradient", { id: "metal", x1: 0, x2: 0, y1: 0, y2: 1 }, defs);
    for (const [offset, colour] of [[0, "#23222e"], [.3, "#8d8c9c"], [.45, "#5d5c6c"], [1, "#191822"]]) make("stop", { offset, "stop-color": colour }, metal);
    const blur = make("filter", { id: "glow", x: "-10%", width: "120%", y: "-60%", height: "220%" }, defs);
    make("feGaussianBlur", { stdDeviation: 12 }, blur);

    this.rest = make("path", { fill: "none", stroke: "#e8e6f0", "stroke-opacity": .35, "stroke-dasharray": "3 4" }, svg);
    this.glow = make("path", { filter: "url(#glow)", opacity: .4 }, svg);
    this.wall = make("path", {}, svg);
    this.gas = make("path", {}, svg);
    this.threads = make("path", { fill: "none", stroke: "#000", "stroke-opacity": .3, "stroke-width": 1.5 }, svg);
    this.shade = make("path", { fill: "url(#round)" }, svg);
    this.fittings = [0, 1].map(() => make("rect", { y: AXIS - FITTING - 3, width: 34, height: 2 * FITTING + 6, rx: 4, fill: "url(#metal)" }, svg));
    this.closed = make("path", { fill: "none", stroke: "#8d8c9c", "stroke-width": 5, "stroke-linecap": "round" }, svg);
    make("path", { d: `M36 ${AXIS}H${LEFT - 30}`, stroke: "#5d5c6c", "stroke-width": 12, "stroke-linecap": "round" }, svg);
    // Air enters above the port, and leaves below it.
    this.inlet = make("path", { d: `M36 ${AXIS - 30}h62m-11-9l11 9l-11 9` }, svg);
    this.outlet = make("path", { d: `M98 ${AXIS + 30}h-62m11-9l-11 9l11 9` }, svg);
    for (const [text, y] of [["in", AXIS - 46], ["out", AXIS + 56]]) make("text", { x: 67, y, "text-anchor": "middle", class: "fine" }, svg, text);
    for (const arrow of [this.inlet, this.outlet]) {
      for (const [key, value] of Object.entries({ fill: "none", stroke: "#84cbf5", "stroke-width": 4, "stroke-linecap": "round", "stroke-linejoin": "round" })) arrow.setAttribute(key, value);
    }
    this.sensor = make("circle", { cy: AXIS, r: 8, stroke: "#fff", "stroke-width": 2 }, svg);
    this.labels = make("g", { class: "fine", "text-anchor": "middle" }, svg);
    this.length = make("text", { y: HEIGHT - 12, "text-anchor": "middle" }, this.labels);
    this.named = make("text", { y: AXIS - 15, fill: "#fff", "text-anchor": "middle" }, this.labels, "sensor");
    this.named.style.cssText = "fill:#fff;paint-order:stroke;stroke:#0008;stroke-width:3px";
    bar(svg);
  }

  /** Draws the present state: length in mm, temperatures in K, openings in %. */
  draw(now, configuration) {
    const { rest_length_m: rest, braid } = configuration || {};
    const longest = braid ? Math.min(braid.thread_length_m * .98, rest * 1.06) : rest || now.length / 1e3 || 1;
    const px = LONGEST / longest;
    const metres = now.length / 1e3;
    const length = Math.min(Math.max(metres, longest * .3), longest) * px;
    const radiusAt = (long_m) => braid
      ? Math.min(62, Math.sqrt(Math.max(0, braid.thread_length_m ** 2 - long_m ** 2)) / (2 * Math.PI * braid.turns) * px * 1.6)
      : PLAIN_RADIUS;
    const outline = (long, radius) => {
      const at = (s) => FITTING + (radius - FITTING) * Math.sin(Math.min(s, long - s, TAPER) / TAPER * Math.PI / 2);
      const points = [];
      for (let i = 0; i <= STEPS; i++) points.push([LEFT + long * i / STEPS, at(long * i / STEPS)]);
      const half = (list, side) => list.map(([x, r]) => `${x.toFixed(1)} ${(AXIS + side * Math.max(r, 1)).toFixed(1)}`);
      return `M${half(points, -1).concat(half(points.reverse(), 1)).join("L")}Z`;
    };
    const radius = radiusAt(metres);
    const body = outline(length, radius);
    this.rest.setAttribute("d", rest ? outline(rest * px, radiusAt(rest)) : "");
    for (const path of [this.glow, this.wall, this.shade]) path.setAttribute("d", body);
    this.gas.setAttribute("d", outline(length, Math.max(FITTING, radius - WALL)));
    this.glow.setAttribute("fill", colour(now.gas));
    this.wall.setAttribute("fill", colour(now.wall));
    this.gas.setAttribute("fill", colour(now.gas));
    this.sensor.setAttribute("fill", colour(now.sensor));
    let threads = "";
    const lean = length / THREADS * 3;
    for (let i = 0; i < THREADS; i++) {
      const x = LEFT + length * (i + .5) / THREADS, r = radius * .86;
      if (x - lean < LEFT + TAPER / 2 || x + lean > LEFT + length - TAPER / 2) continue;
      for (const side of [1, -1]) threads += `M${(x - lean).toFixed(1)} ${(AXIS - side * r).toFixed(1)}L${(x + lean).toFixed(1)} ${(AXIS + side * r).toFixed(1)}`;
    }
    this.threads.setAttribute("d", threads);
    const end = LEFT + length;
    this.fittings[0].setAttribute("x", LEFT - 26);
    this.fittings[1].setAttribute("x", end - 8);
    this.closed.setAttribute("d", `M${end + 26} ${AXIS}h30`);
    this.sensor.setAttribute("cx", LEFT + length / 2);
    this.named.setAttribute("x", LEFT + length / 2);
    this.length.setAttribute("x", LEFT + length / 2);
    this.length.textContent = `${now.length.toFixed(1)} mm` + (braid && rest ? `, at rest ${(rest * 1e3).toFixed(0)} mm (dashed)` : "");
    this.inlet.style.opacity = .12 + .88 * Math.min(1, now.inlet * .015);
    this.outlet.style.opacity = .12 + .88 * Math.min(1, now.outlet * .015);
  }
}
