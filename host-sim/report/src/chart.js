// Interactive charts for reports, the live page and the playground: a crosshair with the values of all traces, zoom
// and pan, traces on and off. Charts over the same quantity share window and cursor.

const HEAD = 28, FOOT = 42, ROW = 15, CHARACTER = 6.7, CLIP = 3;
/** Margins of a growing record, whose title stands outside. */
const LIVE_HEAD = 8, LIVE_FOOT = 22, LIVE_TITLE = 28;
/** Height of a row of the legend, and width of a sample with its gap, in a downloaded drawing. */
const LEGEND = 18, SAMPLE = 33;
const SMALLEST = 1e-6; // of the whole window
const NARROW = 520;
/** Marks from the lowest: a line through dense dots stays visible. */
const STACK = ["line wide", "band", "dots", "line dashed", "line"];

/** First index of a sorted list whose value is at least `value`. */
function lowerBound(list, value) {
  let low = 0, high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (list[middle] < value) low = middle + 1;
    else high = middle;
  }
  return low;
}

const minus = (text) => text.replace(/-/g, "−");
function fixed(value, decimals) {
  let text = value.toFixed(decimals);
  if (Number(text) === 0) text = (0).toFixed(decimals);
  const [whole, rest] = text.split(".");
  const grouped = whole.replace("-", "").length > 4 ? whole.replace(/\B(?=(\d{3})+$)/g, "\u202f") : whole;
  return minus(grouped + (rest ? "." + rest : ""));
}
/** A value with enough digits to tell it from its neighbours; `step` is the size of a pixel. */
function shown(value, step) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e6)) return minus(value.toExponential(3));
  // At most six digits: the stored points are no finer.
  const digits = size === 0 ? 6 : 5 - Math.floor(Math.log10(size));
  const decimals = Math.max(0, Math.min(6, digits, Math.ceil(-Math.log10(Math.max(step, 1e-9)))));
  return fixed(value, decimals);
}
const withUnit = (text, unit) => (unit ? text + "\u202f" + unit : text);
const title = ({ label, unit }) => (unit ? `${label} [${unit}]` : label);

class Scale {
  constructor([low, high], [from, to], log) {
    Object.assign(this, { low, high, from, to, log });
  }
  position(value) {
    const along = this.log
      ? Math.log(value / this.low) / Math.log(this.high / this.low)
      : (value - this.low) / (this.high - this.low);
    return Math.max(-1e4, Math.min(1e4, this.from + along * (this.to - this.from)));
  }
  value(position) {
    const along = (position - this.from) / (this.to - this.from);
    return this.log
      ? this.low * Math.pow(this.high / this.low, along)
      : this.low + along * (this.high - this.low);
  }
  shows(value) {
    return Number.isFinite(value) && (!this.log || value > 0);
  }
  ticks(count) {
    const out = [];
    if (this.log) {
      const decades = Math.log10(this.high / this.low);
      const multiples = decades < 2.5 ? [1, 2, 5] : [1];
      for (let e = Math.floor(Math.log10(this.low)); e <= Math.ceil(Math.log10(this.high)); e++) {
        for (const m of multiples) {
          const value = m * Math.pow(10, e);
          if (value < this.low * (1 - 1e-9) || value > this.high * (1 + 1e-9)) continue;
          out.push([value, e >= -3 && e <= 4 ? fixed(value, Math.max(0, -e)) : minus(value.toExponential(0))]);
        }
      }
      return out;
    }
    const raw = (this.high - this.low) / Math.max(1, count);
    const decade = Math.pow(10, Math.floor(Math.log10(raw)));
    const step = decade * [[Math.SQRT2, 1], [Math.sqrt(10), 2], [Math.sqrt(50), 5], [Infinity, 10]]
      .find(([upTo]) => raw / decade <= upTo)[1];
    const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    const last = Math.floor(this.high / step + 1e-9), most = Math.max(Math.abs(this.low), Math.abs(this.high));
    const plain = decimals <= 6 && most < 1e6;
    // As many digits as tell one from the next.
    const digits = Math.min(15, Math.max(2, Math.floor(Math.log10(most)) - Math.floor(Math.log10(step) + 1e-9)));
    for (let i = Math.ceil(this.low / step - 1e-9); i <= last; i++) {
      const value = i * step;
      out.push([value, plain ? fixed(value, decimals) : minus(value.toExponential(digits))]);
    }
    return out;
  }
}

const NAMESPACE = "http://www.w3.org/2000/svg";

function element(name, attributes, text) {
  const node = document.createElementNS(NAMESPACE, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== undefined) node.textContent = text;
  return node;
}
function html(name, className, text) {
  const node = document.createElement(name);
  node.className = className;
  if (text !== undefined) node.textContent = text;
  return node;
}
const px = (value) => String(Math.round(value * 10) / 10);
const width = (text) => text.length * CHARACTER;

/** A layer as it looks in a legend. */
function sample({ colour, mark }) {
  const svg = element("svg", { class: colour, width: 26, height: 10, "aria-hidden": true });
  svg.append(mark === "band" ? element("rect", { class: mark, x: 1, width: 24, height: 10 })
    : element("path", { class: mark, d: mark === "dots" ? "M4 5h0M13 5h0M22 5h0" : "M1 5h24" }));
  return svg;
}

/** A bar of buttons, and the function that adds one. */
function toolbar() {
  const bar = html("div", "tools");
  const button = (text, what, act) => {
    const node = html("button", "tool", text);
    node.type = "button";
    node.title = what;
    node.setAttribute("aria-label", what);
    node.addEventListener("click", act);
    bar.append(node);
  };
  return { bar, button };
}

/** Properties that style sheets give a drawing. */
const INHERENT = ["fill", "fill-opacity", "stroke", "stroke-width", "stroke-opacity", "stroke-dasharray", "stroke-linecap", "stroke-linejoin", "opacity", "font-family", "font-size", "font-weight", "text-anchor", "display"];

/** A copy of a drawing with the properties that style sheets give it. */
function styled(drawing) {
  const copy = drawing.cloneNode(true);
  const [from, to] = [drawing, copy].map((svg) => [svg, ...svg.querySelectorAll("*")]);
  from.forEach((node, i) => {
    const style = getComputedStyle(node);
    for (const name of INHERENT) to[i].style.setProperty(name, style.getPropertyValue(name));
  });
  return copy;
}

/** The charts that share a window: those over the same quantity. */
const linkedTo = (key) => charts.filter((chart) => chart.key === key);
const charts = [];
/** The chart with the cursor, and the cursor's place in it. */
let cursor = null;

function redraw(some) {
  for (const chart of some) chart.draw();
  if (cursor && some.includes(cursor.chart)) cursor.chart.hover(cursor.place);
}

export class Chart {
  /**
   * `plot` is {name, x, window, panels: [{y, height, layers, references}], markers}. An axis is {label, unit, log,
   * range, words}; a layer is {name, colour, mark, rising, x, y} with an array of x and one or two of y, in which NaN
   * is a gap. A growing record sets `live`: labels of time count back from the end, the legend shows values, and
   * panels fill the box. `tools` takes the buttons.
   */
  constructor(figure, plot, tools) {
    this.plot = plot;
    this.box = figure.querySelector(".plot");
    this.whole = this.window = plot.window;
    this.key = title(plot.x);
    this.off = new Set();
    this.pointers = new Map();
    this.layers = plot.panels.flatMap((panel, i) =>
      panel.layers.map((layer) => Object.assign(layer, { panel: i, id: `${layer.name}|${layer.colour}|${layer.mark}` })));
    this.reach = this.extent();
    this.legend(figure);
    if (tools) this.tools(tools);
    if (plot.live) {
      const { bar, button } = toolbar();
      this.downloads(button, `: ${plot.name}`);
      figure.querySelector(".figure-title").append(bar);
    }
    this.readout = html("div", "readout");
    this.readout.setAttribute("role", "status");
    this.readout.hidden = true;
    // The drawing without script remains for printing.
    this.box.querySelector("svg")?.classList.add("still");
    this.svg = element("svg", { class: "chart", role: "img", "aria-label": plot.name });
    this.box.append(this.svg, this.readout);
    this.box.classList.add("live");
    this.listen();
    charts.push(this);
    // Not measured in each drawing: the browser would lay out the page for every chart.
    const measured = () => [this.box.clientWidth, this.box.clientHeight];
    this.size = measured();
    this.draw();
    new ResizeObserver(() => {
      const [wide, high] = measured();
      if (Math.abs(wide - this.size[0]) <= 1 && (!plot.live || Math.abs(high - this.size[1]) <= 1)) return;
      this.size = [wide, high];
      redraw([this]);
    }).observe(this.box);
  }

  /** The window with all data. */
  extent() {
    const ends = (which) => this.layers.filter((layer) => layer.rising).map((layer) => layer.x.at(which)).filter(Number.isFinite);
    return [Math.min(this.whole[0], ...ends(0)), Math.max(this.whole[1], ...ends(-1))];
  }

  /** Legend with a switch for each trace. */
  legend(figure) {
    const named = [...new Map(this.layers.filter((layer) => layer.name).map((layer) => [layer.id, layer])).values()];
    const list = html("ul", "legend");
    this.latest = new Map();
    for (const layer of named) {
      const button = html("button", "trace"), value = html("span", "latest"), item = html("li", "");
      button.type = "button";
      button.title = "Shows or hides this trace";
      button.setAttribute("aria-pressed", "true");
      button.append(sample(layer), layer.name, value);
      button.addEventListener("click", () => {
        if (!this.off.delete(layer.id)) this.off.add(layer.id);
        button.setAttribute("aria-pressed", String(!this.off.has(layer.id)));
        redraw([this]);
      });
      item.append(button);
      list.append(item);
      this.latest.set(layer.id, value);
    }
    figure.querySelector(".legend")?.remove();
    if (named.length) this.box.before(list);
  }

  tools(place) {
    const { bar, button } = toolbar();
    const middle = () => (this.window[0] + this.window[1]) / 2;
    button("+", "Zoom in; or draw over the part to see", () => this.zoom(0.5, middle()));
    button("−", "Zoom out", () => this.zoom(2, middle()));
    button("◂", "Earlier; or drag with Shift", () => this.pan(-0.5));
    button("▸", "Later; or drag with Shift", () => this.pan(0.5));
    button("whole", "Back to the whole; or double-click", () => this.back());
    if (!this.plot.live) this.downloads(button);
    place.append(bar);
  }

  /** Adds buttons that download the chart; `of` ends their names. */
  downloads(button, of = "") {
    for (const kind of ["csv", "svg", "png"]) button(kind, `Download as ${kind.toUpperCase()}${of}`, () => this.save(kind));
  }

  /** Downloads the points within the window, or the drawing. */
  save(kind) {
    const offer = (href) => {
      const link = html("a", "");
      link.href = href;
      link.download = `${this.plot.name.toLowerCase().replace(/[^a-z0-9]+/g, "-")}.${kind}`;
      link.click();
    };
    if (kind === "csv") return offer(`data:text/csv;charset=utf-8,${encodeURIComponent(this.table())}`);
    const drawing = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(this.drawing())}`;
    if (kind === "svg") return offer(drawing);
    const image = new Image();
    image.onload = () => {
      const canvas = document.createElement("canvas");
      // Twice the size on the screen, for print.
      [canvas.width, canvas.height] = [2 * image.width, 2 * image.height];
      canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
      offer(canvas.toDataURL("image/png"));
    };
    image.src = drawing;
  }

  /** Visible layers as a table: a row for each x, a column for each edge. */
  table() {
    const layers = this.layers.filter(({ id }) => !this.off.has(id)), rows = new Map();
    const columns = layers.flatMap((layer) => layer.y.map((values, edge) => ({ layer, values, edge })));
    columns.forEach(({ layer, values }, column) => layer.x.forEach((x, i) => {
      if (!(x >= this.window[0] && x <= this.window[1]) || Number.isNaN(values[i])) return;
      if (!rows.has(x)) rows.set(x, []);
      rows.get(x)[column] = values[i];
    }));
    const name = ({ layer, edge }) => {
      const { y } = this.plot.panels[layer.panel], bound = layer.y.length > 1 ? [" low", " high"][edge] : "";
      return `${y.label}${layer.name && layer.name !== y.label ? `, ${layer.name}` : ""}${bound}${y.unit ? ` [${y.unit}]` : ""}`;
    };
    const quoted = (text) => `"${text.replaceAll('"', '""')}"`;
    const head = [title(this.plot.x), ...columns.map(name)].map(quoted);
    const body = [...rows].sort(([a], [b]) => a - b).map(([x, cells]) => [x, ...columns.map((_, column) => cells[column] ?? "")]);
    return [head, ...body].map((cells) => cells.join(",")).join("\n") + "\n";
  }

  /** The drawing as a file of its own, with the colours of the page. */
  drawing() {
    const copy = styled(this.svg), [wide, high] = ["width", "height"].map((name) => Number(copy.getAttribute(name)));
    const head = this.head(wide), top = -head.height;
    // Labels may reach over the edge of the drawing.
    const labels = [...this.svg.querySelectorAll("text")].map((label) => label.getBBox());
    const left = Math.floor(Math.min(0, ...labels.map(({ x }) => x)));
    const right = Math.ceil(Math.max(wide, ...labels.map(({ x, width }) => x + width)));
    const size = { width: right - left, height: high - top };
    for (const [name, value] of Object.entries(size)) copy.setAttribute(name, value);
    copy.setAttribute("viewBox", `${left} ${top} ${size.width} ${size.height}`);
    const fill = getComputedStyle(document.body).backgroundColor;
    copy.prepend(element("rect", { x: left, y: top, width: "100%", height: "100%", fill }), ...head.parts);
    return new XMLSerializer().serializeToString(copy);
  }

  /** Legend, and title of a growing record, above a drawing of this width: both are outside of it on the page. */
  head(wide) {
    const { fontFamily, color } = getComputedStyle(this.box), { from } = this.x, parts = [];
    const font = { "font-family": fontFamily, "font-size": 13, fill: color };
    const text = (x, y, weight, content) => parts.push(element("text", { x: px(x), y, ...font, "font-weight": weight }, content));
    const seen = [...this.latest].filter(([id]) => !this.off.has(id)).map(([id, value]) => [id.split("|")[0], value.parentElement]);
    let x = from, y = 0;
    if (this.plot.live) text(x, y += LIVE_TITLE - 8, 600, title(this.plot.panels[0].y));
    if (seen.length) y += LEGEND;
    for (const [name, trace] of seen) {
      const entry = SAMPLE + width(name);
      if (x + entry > wide && x > from) [x, y] = [from, y + LEGEND];
      const line = styled(trace.querySelector("svg"));
      line.setAttribute("x", px(x));
      line.setAttribute("y", y - 9);
      parts.push(line);
      text(x + SAMPLE, y, 400, name);
      x += entry + LEGEND;
    }
    const height = y && y + 8;
    for (const part of parts) part.setAttribute("y", Number(part.getAttribute("y")) - height);
    return { parts, height };
  }

  /** Moves the whole to `window`, which a zoomed chart does not show until it is back. */
  static follow(some, window) {
    for (const chart of some) {
      if (chart.isWhole()) chart.window = window;
      chart.whole = window;
      chart.reach = chart.extent();
    }
    redraw(some);
  }

  show([from, to]) {
    const [low, high] = this.reach;
    const least = (high - low) * SMALLEST;
    const span = Math.min(Math.max(to - from, least), high - low);
    const start = Math.min(Math.max(from, low), high - span);
    const window = [start, start + span];
    const shown = linkedTo(this.key).filter((chart) => chart === this || chart.hasData(window));
    for (const chart of shown) chart.window = window;
    redraw(shown);
  }
  zoom(factor, about) {
    const [from, to] = this.window;
    this.show([about - (about - from) * factor, about + (to - about) * factor]);
  }
  pan(share) {
    const [from, to] = this.window;
    this.show([from + share * (to - from), to + share * (to - from)]);
  }
  back() {
    const all = linkedTo(this.key);
    for (const chart of all) chart.window = chart.whole;
    redraw(all);
  }
  isWhole() {
    return this.window[0] === this.whole[0] && this.window[1] === this.whole[1];
  }

  /** Whether a trace has a point in the window, or passes through it between two points. */
  hasData([from, to]) {
    return this.layers.some(({ id, x, y: [edge], mark, rising }) => {
      if (this.off.has(id)) return false;
      const inside = (value, i) => x[i] >= from && x[i] <= to && Number.isFinite(value);
      if (!rising) return edge.some(inside);
      const next = lowerBound(x, from);
      for (let i = next; x[i] <= to; i++) if (inside(edge[i], i)) return true;
      return mark !== "dots" && x[next] > to && Number.isFinite(edge[next]) && Number.isFinite(edge[next - 1]);
    });
  }

  /** Rows of a layer in a window, and the next on either side. */
  rows({ x, rising }, [from, to] = this.window) {
    if (!rising) return [0, x.length];
    return [Math.max(0, lowerBound(x, from) - 1), Math.min(x.length, lowerBound(x, to) + 2)];
  }

  /** The range of a panel that shows all visible points. */
  range({ y: axis, references }, index) {
    if (axis.range) return axis.range;
    let low = Infinity, high = -Infinity;
    const take = (value) => {
      if (!Number.isFinite(value) || (axis.log && value <= 0)) return;
      low = Math.min(low, value);
      high = Math.max(high, value);
    };
    for (const layer of this.layers) {
      if (layer.panel !== index || this.off.has(layer.id)) continue;
      const [from, to] = this.rows(layer);
      for (let i = from; i < to; i++) {
        if (layer.x[i] >= this.window[0] && layer.x[i] <= this.window[1]) for (const edge of layer.y) take(edge[i]);
      }
      if (low > high) for (let i = from; i < to; i++) for (const edge of layer.y) take(edge[i]);
    }
    references.forEach(([value]) => take(value));
    if (low > high) return axis.log ? [0.1, 1] : [0, 1];
    if (axis.log) {
      if (high <= low * (1 + 1e-9)) return [low / 2, high * 2];
      const room = Math.pow(high / low, 0.06);
      return [low / room, high * room];
    }
    if (axis.least) {
      const room = Math.max(0, axis.least - (high - low)) / 2 + 0.06 * Math.max(high - low, axis.least);
      return [low - room, high + room];
    }
    if (high - low <= 1e-9 * Math.abs(high)) {
      const room = low === 0 ? 1 : 0.005 * Math.abs(low);
      return [low - room, high + room];
    }
    const room = 0.06 * (high - low);
    return [low >= 0 && low < 0.2 * high ? 0 : low - room, high + room];
  }

  draw() {
    const { plot } = this, [wide, high] = this.size;
    const total = Math.max(240, wide), narrow = total < NARROW;
    const [head, foot] = plot.live ? [LIVE_HEAD, LIVE_FOOT] : [HEAD, FOOT];
    const panels = plot.panels.map((panel, i) => {
      const height = plot.live ? Math.max(40, high - head - foot) : panel.height;
      const range = this.range(panel, i);
      const ticks = new Scale(range, [0, 1], panel.y.log).ticks(height / (plot.live ? 28 : 45));
      return { height, range, ticks };
    });
    const widest = Math.max(0, ...panels.flatMap(({ ticks }) => ticks.map(([, label]) => width(label))));
    const beside = Math.max(0, ...plot.panels.flatMap(({ references }) => references.map(([, label]) => width(label))));
    const left = Math.max(narrow && !plot.live ? 36 : 48, widest + 12);
    const right = total - Math.max(18, narrow ? 0 : beside + 10);
    const x = this.x = new Scale(this.window, [left, right], plot.x.log);
    const markers = this.markers(x, total);
    const top = this.top = head + markers.rows * ROW;
    let next = top;
    this.areas = panels.map(({ height, range }, i) => {
      const area = { left, right, top: next, bottom: next + height };
      next += height + head + 8;
      area.y = new Scale(range, [area.bottom, area.top], plot.panels[i].y.log);
      return area;
    });
    const bottom = this.bottom = this.areas.at(-1)?.bottom ?? top;
    const height = bottom + foot;
    for (const [key, value] of Object.entries({ width: total, height, viewBox: `0 0 ${total} ${height}` })) {
      this.svg.setAttribute(key, value);
    }
    const parts = document.createDocumentFragment();
    const xTicks = this.xTicks((right - left) / (narrow ? 60 : 90));
    plot.panels.forEach((panel, i) => this.panel(parts, panel, i, xTicks, panels[i].ticks, narrow));
    for (const [at, middle, row, label] of markers.placed) {
      parts.append(element("path", { class: "marker", d: `M${px(at)} ${px(top)}V${px(bottom)}` }));
      parts.append(element("text", { class: "small", x: px(middle), y: px(top - 5 - row * ROW), "text-anchor": "middle" }, label));
    }
    for (const [value, label] of xTicks) {
      parts.append(element("text", { class: "tick x-tick", x: px(x.position(value)), y: px(bottom + 18), "text-anchor": "middle" }, label));
    }
    if (!plot.live) parts.append(element("text", { class: "axis", x: px((left + right) / 2), y: px(bottom + 36), "text-anchor": "middle" }, title(plot.x)));
    this.hair = element("g", { class: "crosshair" });
    parts.append(this.hair);
    this.svg.replaceChildren(parts);
    this.box.classList.toggle("zoomed", !this.isWhole());
    if (plot.live) this.showLatest(this.window[1]);
  }

  xTicks(count) {
    const { words } = this.plot.x, [from, to] = this.window;
    if (words.length) return [...words.entries()].filter(([i]) => i >= from && i <= to);
    if (!this.plot.live) return this.x.ticks(count);
    const [, now] = this.whole;
    return new Scale([from - now, to - now], [0, 1], false).ticks(count)
      .map(([value, label]) => [value + now, Math.abs(value) < 1e-9 ? "now" : withUnit(label, this.plot.x.unit)]);
  }

  markers(x, total) {
    const ends = [], placed = [];
    const seen = this.plot.markers.filter(([v]) => v >= this.window[0] && v <= this.window[1]).sort((a, b) => a[0] - b[0]);
    for (const [value, label] of seen) {
      const at = x.position(value), half = width(label) / 2 + 4;
      const middle = Math.max(half, Math.min(at, total - half));
      let row = ends.findIndex((end) => end <= middle - half);
      if (row < 0) row = ends.length;
      ends[row] = middle + half;
      placed.push([at, middle, row, label]);
    }
    return { placed, rows: ends.length };
  }

  panel(parts, panel, index, xTicks, yTicks, narrow) {
    const { left, right, top, bottom, y } = this.areas[index];
    if (!this.plot.live) parts.append(element("text", { class: "axis", x: 0, y: px(top - 12) }, title(panel.y)));
    const grid = xTicks.map(([v]) => `M${px(this.x.position(v))} ${px(top)}V${px(bottom)}`)
      .concat(yTicks.map(([v]) => `M${px(left)} ${px(y.position(v))}H${px(right)}`)).join("");
    parts.append(element("path", { class: "grid", d: grid }));
    for (const [value, label] of yTicks) {
      parts.append(element("text", { class: "tick", x: px(left - 7), y: px(y.position(value) + 4), "text-anchor": "end" }, label));
    }
    parts.append(element("path", { class: "frame", d: `M${px(left)} ${px(bottom)}H${px(right)}` }));
    const [x0, y0, w, h] = [left - CLIP, top - CLIP, right - left + 2 * CLIP, bottom - top + 2 * CLIP];
    const clip = element("svg", { x: px(x0), y: px(y0), width: px(w), height: px(h), viewBox: [x0, y0, w, h].map(px).join(" ") });
    const stacked = this.layers.filter((layer) => layer.panel === index && !this.off.has(layer.id))
      .sort((a, b) => STACK.indexOf(a.mark) - STACK.indexOf(b.mark));
    for (const layer of stacked) {
      clip.append(element("path", { class: `${layer.colour} ${layer.mark}`, d: this.path(layer, y) }));
    }
    let free = -Infinity;
    const inSight = panel.references.filter(([v]) => v >= y.low && v <= y.high)
      .map(([v, label]) => [y.position(v), label]).sort((a, b) => a[0] - b[0]);
    for (const [at, label] of inSight) {
      clip.append(element("path", { class: "reference", d: `M${px(left)} ${px(at)}H${px(right)}` }));
      const place = Math.max(at, free);
      free = place + ROW;
      parts.append(narrow
        ? element("text", { class: "small", x: px(right), y: px(place - 4), "text-anchor": "end" }, label)
        : element("text", { class: "small", x: px(right + 6), y: px(place + 4) }, label));
    }
    parts.append(clip);
  }

  /** Path data of a layer; if it has more points than pixels, only the extremes of each pixel. */
  path(layer, y) {
    const runs = this.runs(layer, y);
    const points = (edge, run) => this.thin(layer, edge, run).map((i) => `${px(this.x.position(layer.x[i]))} ${px(y.position(edge[i]))}`);
    const [low, high] = layer.y;
    if (high) return runs.map((run) => `M${points(low, run).concat(points(high, run).reverse()).join("L")}z`).join("");
    const dots = (list) => list.map((point) => `M${point}h0`).join("");
    return runs.map((run) => layer.mark === "dots" || run.length === 1 ? dots(points(low, run)) : `M${points(low, run).join("L")}`).join("");
  }

  /** Visible rows, broken at gaps; of a dense layer, only at gaps that can be seen. */
  runs(layer, y) {
    const { x } = layer, [from, to] = this.rows(layer);
    const runs = [], dense = this.isDense(layer);
    let last = -1, place = 0;
    for (let i = from; i < to; i++) {
      if (!this.x.shows(x[i]) || !layer.y.every((edge) => y.shows(edge[i]))) continue;
      const before = place;
      place = this.x.position(x[i]);
      if (last < 0 || (i > last + 1 && !(dense && place - before < CLIP))) runs.push([]);
      runs.at(-1).push(last = i);
    }
    return runs;
  }

  isDense(layer) {
    const [from, to] = this.rows(layer);
    return layer.rising && to - from > 4 * (this.x.to - this.x.from);
  }

  /** The rows of a run that show its extremes. */
  thin(layer, edge, run) {
    if (!this.isDense(layer)) return run;
    const [from, to] = this.rows(layer), out = [];
    const rows = (to - from) / (2 * (this.x.to - this.x.from));
    for (let begin = 0; begin < run.length; begin += rows) {
      let low = run[Math.floor(begin)], high = low;
      for (const i of run.slice(Math.floor(begin), Math.floor(begin + rows))) {
        if (edge[i] < edge[low]) low = i;
        if (edge[i] > edge[high]) high = i;
      }
      out.push(Math.min(low, high));
      if (low !== high) out.push(Math.max(low, high));
    }
    return out;
  }

  listen() {
    const { box } = this;
    const at = (event) => {
      const bounds = this.svg.getBoundingClientRect();
      const scale = this.size[0] ? Math.max(240, this.size[0]) / bounds.width : 1;
      return [(event.clientX - bounds.left) * scale, (event.clientY - bounds.top) * scale];
    };
    const inside = ([x, y]) => x >= this.x.from && x <= this.x.to && y >= this.top && y <= this.bottom;
    box.addEventListener("pointerdown", (event) => {
      const place = at(event);
      if (event.button !== 0 || !inside(place)) return;
      this.pointers.set(event.pointerId, place[0]);
      const touch = event.pointerType === "touch";
      this.drag = { from: place[0], window: this.window, pan: event.shiftKey || (touch && !this.isWhole()), touch };
      if (!touch) {
        box.setPointerCapture(event.pointerId);
        box.focus({ preventScroll: true });
      }
      this.hover(place);
    });
    box.addEventListener("pointermove", (event) => {
      const place = at(event);
      const before = new Map(this.pointers);
      if (this.pointers.has(event.pointerId)) this.pointers.set(event.pointerId, place[0]);
      if (this.pointers.size === 2) return this.pinch([...before.values()], [...this.pointers.values()]);
      const { drag } = this;
      if (drag && drag.pan) {
        const scale = (drag.window[1] - drag.window[0]) / (this.x.to - this.x.from);
        const shift = (drag.from - place[0]) * scale;
        return this.show([drag.window[0] + shift, drag.window[1] + shift]);
      }
      if (drag && !drag.touch) return this.select(drag.from, place[0]);
      if (inside(place)) this.hover(place);
      else this.leave();
    });
    const end = (event) => {
      const { drag } = this;
      this.pointers.delete(event.pointerId);
      this.drag = null;
      if (!drag || drag.pan || drag.touch || event.type !== "pointerup") return;
      const [a, b] = [drag.from, at(event)[0]].map((p) => Math.max(this.x.from, Math.min(p, this.x.to))).sort((m, n) => m - n);
      this.leave();
      if (b - a > 6) this.show([this.x.value(a), this.x.value(b)]);
    };
    box.addEventListener("pointerup", end);
    box.addEventListener("pointercancel", end);
    // Values stay when a finger lifts, until it touches elsewhere.
    box.addEventListener("pointerleave", (event) => { if (!this.drag && event.pointerType !== "touch") this.leave(); });
    document.addEventListener("pointerdown", ({ target }) => {
      if (cursor?.chart === this && !box.contains(target)) this.leave();
    });
    box.addEventListener("dblclick", () => this.back());
    box.addEventListener("wheel", (event) => {
      const place = at(event);
      if (!(event.ctrlKey || event.metaKey) || !inside(place)) return;
      event.preventDefault();
      this.zoom(Math.exp(event.deltaY * 0.002), this.x.value(place[0]));
    }, { passive: false });
    box.addEventListener("keydown", (event) => {
      const middle = (this.window[0] + this.window[1]) / 2;
      const cursorMoves = event.shiftKey || this.isWhole();
      const way = (sign) => (cursorMoves ? this.step(sign) : this.pan(0.2 * sign));
      const act = {
        ArrowLeft: () => way(-1), ArrowRight: () => way(1),
        "+": () => this.zoom(0.5, middle), "-": () => this.zoom(2, middle),
        0: () => this.back(), Escape: () => { this.back(); this.leave(); },
      }[event.key];
      if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      act();
    });
    box.addEventListener("blur", () => { if (cursor?.keys) this.leave(); });
  }

  pinch(before, now) {
    if (before.length !== 2) return;
    const [a, b] = before.map((p) => this.x.value(p));
    const scale = (a - b) / (now[0] - now[1] || 1);
    const from = a - (now[0] - this.x.from) * scale;
    this.show([from, from + Math.abs(scale) * (this.x.to - this.x.from)]);
  }

  select(from, to) {
    const [a, b] = [from, to].map((p) => Math.max(this.x.from, Math.min(p, this.x.to))).sort((m, n) => m - n);
    this.leave();
    this.hair.replaceChildren(element("rect", {
      class: "selection", x: px(a), y: px(this.top), width: px(b - a), height: px(this.bottom - this.top),
    }));
  }

  /** Moves the cursor by a hundredth of the window, from the middle at first. */
  step(sign) {
    const { from, to } = this.x, [{ top }] = this.areas;
    const at = cursor?.chart === this ? cursor.place[0] : (from + to) / 2;
    this.hover([Math.max(from, Math.min(to, at + sign * (to - from) / 100)), top]);
    cursor.keys = true;
  }

  /** The row of a layer nearest to `value`, or none. */
  nearest(layer, value, place) {
    const { x, y: [edge] } = layer;
    let best = -1;
    if (layer.rising) {
      const after = lowerBound(x, value);
      for (const i of [after - 1, after]) {
        if (i >= 0 && i < x.length && Number.isFinite(edge[i]) &&
          (best < 0 || Math.abs(x[i] - value) < Math.abs(x[best] - value))) best = i;
      }
      // There is no value beyond a trace's ends, and between single points.
      const beside = value < x[0] || value > x[x.length - 1] || layer.mark === "dots";
      const reach = 8 * (this.window[1] - this.window[0]) / (this.x.to - this.x.from);
      if (best >= 0 && beside && Math.abs(x[best] - value) > reach) return -1;
    } else {
      const { y } = this.areas[layer.panel];
      let distance = Infinity;
      for (let i = 0; i < x.length; i++) {
        const d = Math.hypot(this.x.position(x[i]) - place[0], y.position(edge[i]) - place[1]);
        if (d < distance) [distance, best] = [d, i];
      }
    }
    return best;
  }

  /** The value of a layer in a row, with its unit. */
  text(layer, i) {
    const { y: axis } = this.plot.panels[layer.panel], { y, top, bottom } = this.areas[layer.panel];
    if (i < 0) return "–";
    const step = (y.high - y.low) / ((bottom - top) * 4);
    const number = (value) => (axis.digits === undefined ? shown(value, step) : fixed(value, axis.digits));
    return withUnit(layer.y.map((edge) => number(edge[i])).join(" to "), axis.unit);
  }

  hover(place) {
    const at = this.x.value(place[0]);
    cursor = { chart: this, place };
    for (const chart of linkedTo(this.key)) {
      chart.readout.hidden = true;
      if (at >= chart.window[0] && at <= chart.window[1]) chart.cross(at, place);
      else chart.hair.replaceChildren();
    }
    if (!this.plot.live) this.showReadout(at, place);
  }

  /** Values in the legend: a growing record has no readout in the way. */
  showLatest(at, place) {
    for (const layer of this.layers) {
      const value = this.latest.get(layer.id);
      if (value) value.textContent = this.text(layer, this.nearest(layer, at, place));
    }
  }

  showReadout(at, place) {
    const list = html("dl", "");
    const row = (name, text, layer) => {
      const term = html("dt", "");
      if (layer) term.append(sample(layer));
      term.append(name);
      list.append(term, html("dd", "", text));
    };
    const pixel = (this.window[1] - this.window[0]) / (this.x.to - this.x.from);
    const { words, label, unit } = this.plot.x;
    row(label, words.length ? words[Math.round(at)] ?? "–" : withUnit(shown(at, pixel), unit));
    let before = -1;
    for (const layer of this.layers) {
      const i = this.off.has(layer.id) ? -1 : this.nearest(layer, at, place);
      if (i < 0) continue;
      const { y, layers } = this.plot.panels[layer.panel];
      // With several panels, each has a heading for its own traces.
      if (this.plot.panels.length > 1 && layer.panel !== before && layers.length > 1) list.append(html("dt", "of", y.label));
      before = layer.panel;
      row(layer.name || y.label, this.text(layer, i), layer);
    }
    const { readout } = this;
    readout.replaceChildren(list);
    readout.hidden = false;
    const room = this.box.clientWidth - readout.offsetWidth;
    const beside = place[0] < this.box.clientWidth / 2 ? place[0] + 14 : place[0] - readout.offsetWidth - 14;
    readout.style.left = px(Math.max(0, Math.min(room, beside))) + "px";
    readout.style.top = px(this.top + 4) + "px";
  }

  cross(at, place) {
    const x = this.x.position(at);
    const parts = [element("path", { class: "hair", d: `M${px(x)} ${px(this.top)}V${px(this.bottom)}` })];
    for (const layer of this.layers) {
      if (this.off.has(layer.id) || layer.y.length > 1) continue;
      const i = this.nearest(layer, at, place);
      const { y } = this.areas[layer.panel];
      const value = i < 0 ? NaN : layer.y[0][i];
      if (!y.shows(value)) continue;
      parts.push(element("circle", {
        class: `${layer.colour} point`, cx: px(this.x.position(layer.x[i])), cy: px(y.position(value)), r: 3.5,
      }));
    }
    this.hair.replaceChildren(...parts);
    if (this.plot.live) this.showLatest(at, place);
  }

  leave() {
    cursor = null;
    for (const chart of linkedTo(this.key)) {
      chart.hair.replaceChildren();
      chart.readout.hidden = true;
      if (chart.plot.live) chart.showLatest(chart.window[1]);
    }
  }
}
