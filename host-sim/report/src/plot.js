// Makes the page's charts interactive: a crosshair with the values of all traces, zoom and pan,
// traces on and off. Charts over the same quantity share their window.
(() => {
  "use strict";
  const source = document.getElementById("plots");
  const { arrays, figures } = JSON.parse(source.textContent);
  const HEAD = 28, FOOT = 42, ROW = 15, CHARACTER = 6.7, CLIP = 3;
  const SMALLEST = 1e-6; // of the whole window
  const NARROW = 520;

  const decoded = new Map();
  /** Decodes an array; gaps are NaN. */
  function values(index) {
    if (!decoded.has(index)) {
      const { bits, low, span, data } = arrays[index];
      const text = atob(data);
      const bytes = Uint8Array.from(text, (c) => c.charCodeAt(0));
      const view = new DataView(bytes.buffer);
      const width = bits / 8, gap = 2 ** bits - 1;
      const out = new Float64Array(bytes.length / width);
      for (let i = 0; i < out.length; i++) {
        const code = bits === 16 ? view.getUint16(2 * i, true) : view.getUint32(4 * i, true);
        out[i] = code === gap ? NaN : low + (code / (gap - 1)) * span;
      }
      decoded.set(index, out);
    }
    return decoded.get(index);
  }

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
      const last = Math.floor(this.high / step + 1e-9);
      for (let i = Math.ceil(this.low / step - 1e-9); i <= last; i++) {
        const value = i * step;
        const plain = decimals <= 6 && Math.max(Math.abs(this.low), Math.abs(this.high)) < 1e6;
        out.push([value, plain ? fixed(value, decimals) : minus(value.toExponential(2))]);
      }
      return out;
    }
  }

  function element(name, attributes, text) {
    const node = document.createElementNS(Chart.namespace, name);
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

  class Chart {
    static all = [];
    static namespace = "";

    constructor(figure, plot) {
      this.plot = plot;
      this.box = figure.querySelector(".plot");
      const still = this.box.querySelector("svg");
      Chart.namespace = still.namespaceURI;
      this.name = still.getAttribute("aria-label");
      this.whole = plot.window;
      this.window = plot.window;
      this.key = title(plot.x);
      this.off = new Set();
      this.pointers = new Map();
      this.layers = plot.panels.flatMap((panel, i) =>
        panel.layers.map((layer) => Object.assign(layer, { panel: i, id: `${layer.name}|${layer.colour}|${layer.mark}` })));
      const rising = this.layers.filter((layer) => layer.rising);
      this.reach = rising.length
        ? [Math.min(this.whole[0], ...ends(rising, 0)), Math.max(this.whole[1], ...ends(rising, -1))]
        : this.whole;
      this.legend(figure);
      this.tools(figure);
      this.readout = html("div", "readout");
      this.readout.hidden = true;
      this.box.append(this.readout);
      this.box.classList.add("live");
      this.listen();
      this.draw();
      new ResizeObserver(() => {
        if (Math.abs(this.box.clientWidth - this.drawnWidth) > 1) this.draw();
      }).observe(this.box);
      Chart.all.push(this);
    }

    /** Makes the entries of the legend switches. */
    legend(figure) {
      const named = [...new Map(this.layers.filter((l) => l.name)
        .sort((a, b) => a.panel - b.panel).map((l) => [l.id, l])).values()];
      for (const item of figure.querySelectorAll(".legend li")) {
        const sample = item.querySelector("svg");
        const layer = named.find((l) => l.name === item.textContent.trim() &&
          sample.classList.contains(l.colour) && sample.firstElementChild.getAttribute("class") === l.mark);
        if (!layer) continue;
        const button = html("button", "trace");
        button.type = "button";
        button.title = "Shows or hides this trace";
        button.setAttribute("aria-pressed", "true");
        button.append(...item.childNodes);
        button.addEventListener("click", () => {
          if (!this.off.delete(layer.id)) this.off.add(layer.id);
          button.setAttribute("aria-pressed", String(!this.off.has(layer.id)));
          this.draw();
        });
        item.append(button);
      }
    }

    tools(figure) {
      const bar = html("div", "tools");
      const button = (text, what, act) => {
        const node = html("button", "tool", text);
        node.type = "button";
        node.title = what;
        node.setAttribute("aria-label", what);
        node.addEventListener("click", act);
        bar.append(node);
        return node;
      };
      const middle = () => (this.window[0] + this.window[1]) / 2;
      button("+", "Zoom in; or draw over the part to see", () => this.zoom(0.5, middle()));
      button("−", "Zoom out", () => this.zoom(2, middle()));
      button("◂", "Earlier; or drag with Shift", () => this.pan(-0.5));
      button("▸", "Later; or drag with Shift", () => this.pan(0.5));
      button("whole", "Back to the whole; or double-click", () => this.back());
      figure.querySelector(".figure-title").append(bar);
    }

    /** Charts over the same quantity. */
    linked() {
      return Chart.all.filter((chart) => chart.key === this.key);
    }
    show([from, to]) {
      const [low, high] = this.reach;
      const least = (high - low) * SMALLEST;
      let span = Math.min(Math.max(to - from, least), high - low);
      let start = Math.min(Math.max(from, low), high - span);
      for (const chart of this.linked()) {
        chart.window = [start, start + span];
        chart.draw();
      }
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
      for (const chart of this.linked()) {
        chart.window = chart.whole;
        chart.draw();
      }
    }
    isWhole() {
      return this.window[0] === this.whole[0] && this.window[1] === this.whole[1];
    }

    /** Rows of a layer in sight, and the next on either side. */
    rows(layer) {
      const x = values(layer.x);
      if (!layer.rising) return [0, x.length];
      return [Math.max(0, lowerBound(x, this.window[0]) - 1), Math.min(x.length, lowerBound(x, this.window[1]) + 2)];
    }
    /** The range of a panel that shows all visible points. */
    range(panel, index) {
      const log = panel.y.log;
      if (panel.y.range) return panel.y.range;
      let low = Infinity, high = -Infinity;
      const take = (value) => {
        if (!Number.isFinite(value) || (log && value <= 0)) return;
        low = Math.min(low, value);
        high = Math.max(high, value);
      };
      for (const layer of this.layers) {
        if (layer.panel !== index || this.off.has(layer.id)) continue;
        const x = values(layer.x), [from, to] = this.rows(layer);
        const edges = layer.y.map(values);
        for (let i = from; i < to; i++) {
          if (x[i] >= this.window[0] && x[i] <= this.window[1]) for (const edge of edges) take(edge[i]);
        }
        if (low > high) for (let i = from; i < to; i++) for (const edge of edges) take(edge[i]);
      }
      panel.references.forEach(([value]) => take(value));
      if (low > high) return log ? [0.1, 1] : [0, 1];
      if (log) {
        if (high <= low * (1 + 1e-9)) return [low / 2, high * 2];
        const room = Math.pow(high / low, 0.06);
        return [low / room, high * room];
      }
      if (high - low <= 1e-9 * Math.abs(high)) {
        const room = low === 0 ? 1 : 0.005 * Math.abs(low);
        return [low - room, high + room];
      }
      const room = 0.06 * (high - low);
      return [low >= 0 && low < 0.2 * high ? 0 : low - room, high + room];
    }

    draw() {
      const total = Math.max(240, this.box.clientWidth);
      this.drawnWidth = this.box.clientWidth;
      const narrow = total < NARROW;
      const { plot } = this;
      const ranges = plot.panels.map((panel, i) => this.range(panel, i));
      const tickCount = (panel) => panel.height / 45;
      let widest = 0, beside = 0;
      plot.panels.forEach((panel, i) => {
        const scale = new Scale(ranges[i], [0, 1], panel.y.log);
        for (const [, label] of scale.ticks(tickCount(panel))) widest = Math.max(widest, width(label));
        for (const [, label] of panel.references) beside = Math.max(beside, width(label));
      });
      const left = Math.max(narrow ? 36 : 48, widest + 12);
      const right = total - Math.max(18, narrow ? 0 : beside + 10);
      const x = new Scale(this.window, [left, right], plot.x.log);
      const markers = this.markers(x, total);
      const top = HEAD + markers.rows * ROW;
      const svg = element("svg", { class: "chart", role: "img", "aria-label": this.name });
      let next = top;
      this.areas = plot.panels.map((panel, i) => {
        const area = { left, right, top: next, bottom: next + panel.height };
        next += panel.height + HEAD + 8;
        area.y = new Scale(ranges[i], [area.bottom, area.top], panel.y.log);
        return area;
      });
      this.x = x;
      const bottom = this.areas.length ? this.areas[this.areas.length - 1].bottom : top;
      const height = bottom + FOOT;
      for (const [key, value] of Object.entries({ width: total, height, viewBox: `0 0 ${total} ${height}` })) {
        svg.setAttribute(key, value);
      }
      const xTicks = plot.x.words.length
        ? [...plot.x.words.entries()].filter(([i]) => i >= this.window[0] && i <= this.window[1])
        : x.ticks((right - left) / (narrow ? 60 : 90));
      plot.panels.forEach((panel, i) => this.panel(svg, panel, i, xTicks, tickCount(panel), narrow));
      for (const [at, middle, row, label] of markers.placed) {
        svg.append(element("path", { class: "marker", d: `M${px(at)} ${px(top)}V${px(bottom)}` }));
        svg.append(element("text", { class: "small", x: px(middle), y: px(top - 5 - row * ROW), "text-anchor": "middle" }, label));
      }
      for (const [value, label] of xTicks) {
        svg.append(element("text", { class: "tick x-tick", x: px(x.position(value)), y: px(bottom + 18), "text-anchor": "middle" }, label));
      }
      svg.append(element("text", { class: "axis", x: px((left + right) / 2), y: px(bottom + 36), "text-anchor": "middle" }, title(plot.x)));
      this.hair = element("g", { class: "crosshair" });
      svg.append(this.hair);
      this.top = top;
      this.bottom = bottom;
      this.svg = svg;
      this.box.querySelector("svg.chart").replaceWith(svg);
      this.box.classList.toggle("zoomed", !this.isWhole());
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

    panel(svg, panel, index, xTicks, tickCount, narrow) {
      const { left, right, top, bottom, y } = this.areas[index];
      svg.append(element("text", { class: "axis", x: 0, y: px(top - 12) }, title(panel.y)));
      const yTicks = y.ticks(tickCount);
      const grid = xTicks.map(([v]) => `M${px(this.x.position(v))} ${px(top)}V${px(bottom)}`)
        .concat(yTicks.map(([v]) => `M${px(left)} ${px(y.position(v))}H${px(right)}`)).join("");
      svg.append(element("path", { class: "grid", d: grid }));
      for (const [value, label] of yTicks) {
        svg.append(element("text", { class: "tick", x: px(left - 7), y: px(y.position(value) + 4), "text-anchor": "end" }, label));
      }
      svg.append(element("path", { class: "frame", d: `M${px(left)} ${px(bottom)}H${px(right)}` }));
      const [x0, y0, w, h] = [left - CLIP, top - CLIP, right - left + 2 * CLIP, bottom - top + 2 * CLIP];
      const clip = element("svg", { x: px(x0), y: px(y0), width: px(w), height: px(h), viewBox: [x0, y0, w, h].map(px).join(" ") });
      for (const layer of this.layers) {
        if (layer.panel !== index || this.off.has(layer.id)) continue;
        clip.append(element("path", { class: `${layer.colour} ${layer.mark}`, d: this.path(layer, y) }));
      }
      let free = -Infinity;
      const inSight = panel.references.filter(([v]) => v >= y.low && v <= y.high)
        .map(([v, label]) => [y.position(v), label]).sort((a, b) => a[0] - b[0]);
      for (const [at, label] of inSight) {
        clip.append(element("path", { class: "reference", d: `M${px(left)} ${px(at)}H${px(right)}` }));
        const place = Math.max(at, free);
        free = place + ROW;
        svg.append(narrow
          ? element("text", { class: "small", x: px(right), y: px(place - 4), "text-anchor": "end" }, label)
          : element("text", { class: "small", x: px(right + 6), y: px(place + 4) }, label));
      }
      svg.append(clip);
    }

    /** Path data of a layer; if it has more points than pixels, only the extremes of each pixel. */
    path(layer, y) {
      const x = values(layer.x), [from, to] = this.rows(layer);
      const edges = layer.y.map(values);
      const dots = layer.mark === "dots";
      const pixels = this.x.to - this.x.from;
      const drawn = (edge) => {
        const runs = [[]];
        const many = layer.rising && to - from > 4 * pixels;
        const add = (i) => runs[runs.length - 1].push([this.x.position(x[i]), y.position(edge[i])]);
        const present = (i) => this.x.shows(x[i]) && y.shows(edge[i]);
        if (!many) {
          for (let i = from; i < to; i++) {
            if (present(i)) add(i);
            else if (runs[runs.length - 1].length) runs.push([]);
          }
          return runs;
        }
        const width = (to - from) / (2 * pixels);
        for (let begin = from; begin < to; begin += width) {
          let low = -1, high = -1, gap = false;
          for (let i = Math.floor(begin); i < Math.min(to, Math.floor(begin + width)); i++) {
            if (!present(i)) { gap = true; continue; }
            if (low < 0 || edge[i] < edge[low]) low = i;
            if (high < 0 || edge[i] > edge[high]) high = i;
          }
          if (low < 0) { if (gap && runs[runs.length - 1].length) runs.push([]); continue; }
          add(Math.min(low, high));
          if (low !== high) add(Math.max(low, high));
        }
        return runs;
      };
      const points = (list) => list.map(([a, b]) => `${px(a)} ${px(b)}`);
      if (layer.y.length === 2) {
        const [low, high] = edges.map(drawn);
        return low.map((run, i) => run.length ? "M" + points(run.concat([...(high[i] || [])].reverse())).join("L") + "z" : "").join("");
      }
      return drawn(edges[0]).map((run) => dots
        ? points(run).map((p) => `M${p}h0`).join("")
        : run.length > 1 ? "M" + points(run).join("L") : points(run).map((p) => `M${p}h0`).join("")).join("");
    }

    listen() {
      const { box } = this;
      const at = (event) => {
        const bounds = this.svg.getBoundingClientRect();
        const scale = this.drawnWidth ? Math.max(240, this.drawnWidth) / bounds.width : 1;
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
        if (b - a > 6) this.show([this.x.value(a), this.x.value(b)]);
        this.leave();
      };
      box.addEventListener("pointerup", end);
      box.addEventListener("pointercancel", end);
      box.addEventListener("pointerleave", () => { if (!this.drag) this.leave(); });
      box.addEventListener("dblclick", () => this.back());
      box.addEventListener("wheel", (event) => {
        const place = at(event);
        if (!(event.ctrlKey || event.metaKey) || !inside(place)) return;
        event.preventDefault();
        this.zoom(Math.exp(event.deltaY * 0.002), this.x.value(place[0]));
      }, { passive: false });
      box.addEventListener("keydown", (event) => {
        const middle = (this.window[0] + this.window[1]) / 2;
        const act = {
          ArrowLeft: () => this.pan(-0.2), ArrowRight: () => this.pan(0.2),
          "+": () => this.zoom(0.5, middle), "-": () => this.zoom(2, middle),
          0: () => this.back(), Escape: () => this.back(),
        }[event.key];
        if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
        event.preventDefault();
        act();
      });
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
      this.hair.replaceChildren(element("rect", {
        class: "selection", x: px(a), y: px(this.top), width: px(b - a), height: px(this.bottom - this.top),
      }));
      this.readout.hidden = true;
    }

    /** The row of a layer nearest to `value`, or none. */
    nearest(layer, value, place) {
      const x = values(layer.x), edge = values(layer.y[0]);
      let best = -1;
      if (layer.rising) {
        const after = lowerBound(x, value);
        for (const i of [after - 1, after]) {
          if (i >= 0 && i < x.length && Number.isFinite(edge[i]) &&
            (best < 0 || Math.abs(x[i] - value) < Math.abs(x[best] - value))) best = i;
        }
        // Beyond a trace's ends, and between single points, there is no value.
        const beside = value < x[0] || value > x[x.length - 1] || layer.mark === "dots";
        const reach = 8 * (this.window[1] - this.window[0]) / (this.x.to - this.x.from);
        if (best >= 0 && beside && Math.abs(x[best] - value) > reach) return -1;
      } else {
        const y = this.areas[layer.panel].y;
        let distance = Infinity;
        for (let i = 0; i < x.length; i++) {
          const d = Math.hypot(this.x.position(x[i]) - place[0], y.position(edge[i]) - place[1]);
          if (d < distance) [distance, best] = [d, i];
        }
      }
      return best;
    }

    hover(place) {
      const at = this.x.value(place[0]);
      for (const chart of this.linked()) {
        if (at >= chart.window[0] && at <= chart.window[1]) chart.cross(at, place);
        else chart.hair.replaceChildren();
        if (chart !== this) chart.readout.hidden = true;
      }
      const list = html("dl", "");
      const row = (name, text, colour, mark) => {
        const term = html("dt", colour || "");
        if (mark) term.append(html("span", `swatch ${mark}`));
        term.append(name);
        list.append(term, html("dd", "", text));
      };
      const pixel = (this.window[1] - this.window[0]) / (this.x.to - this.x.from);
      const { words, label, unit } = this.plot.x;
      row(label, words.length ? words[Math.round(at)] ?? "–" : withUnit(shown(at, pixel), unit));
      let before = -1;
      for (const layer of this.layers.slice().sort((a, b) => a.panel - b.panel)) {
        if (this.off.has(layer.id)) continue;
        const i = this.nearest(layer, at, place);
        if (i < 0) continue;
        // With several panels, each heads its own traces.
        if (this.plot.panels.length > 1 && layer.panel !== before && this.plot.panels[layer.panel].layers.length > 1) {
          list.append(html("dt", "of", this.plot.panels[layer.panel].y.label));
        }
        before = layer.panel;
        const panel = this.plot.panels[layer.panel], { y } = this.areas[layer.panel];
        const step = (y.high - y.low) / (panel.height * 4);
        const text = layer.y.map((edge) => shown(values(edge)[i], step)).join(" to ");
        row(layer.name || panel.y.label, withUnit(text, panel.y.unit), layer.colour, layer.mark);
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
        const value = i < 0 ? NaN : values(layer.y[0])[i];
        if (!y.shows(value)) continue;
        parts.push(element("circle", {
          class: `${layer.colour} point`, cx: px(this.x.position(values(layer.x)[i])), cy: px(y.position(value)), r: 3.5,
        }));
      }
      this.hair.replaceChildren(...parts);
    }

    leave() {
      for (const chart of this.linked()) {
        chart.hair.replaceChildren();
        chart.readout.hidden = true;
      }
    }
  }

  /** The first (0) or last (-1) x of layers. */
  function ends(layers, which) {
    return layers.map((layer) => values(layer.x).at(which)).filter(Number.isFinite);
  }

  for (const [id, plot] of Object.entries(figures)) new Chart(document.getElementById(id), plot);
})();
