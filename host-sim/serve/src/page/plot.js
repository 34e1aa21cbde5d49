// One plot over the last seconds, on a canvas. All plots share time and pointer.

const LEFT = 54, RIGHT = 8, TOP = 8, FOOT = 20;

/** A tick distance of 1, 2 or 5 times a power of ten. */
function step(span, count) {
  const rough = span / count, power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].find((m) => m * power >= rough) * power;
}

/** Index of the first element that is not below `value`. */
function place(sorted, value) {
  let low = 0, high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle] < value) low = middle + 1; else high = middle;
  }
  return low;
}

export class Plot {
  /**
   * `traces`: {name, column, colour, factor, dashed, band}; a band is the column of a deviation, of which two are
   * drawn to either side. `shared` has `time`, `columns`, `span`, `end` and the pointer's time `at`.
   */
  constructor(figure, title, unit, digits, traces, least, shared) {
    Object.assign(this, { figure, unit, digits, traces, least, shared });
    const caption = document.createElement("figcaption");
    const name = document.createElement("b");
    name.textContent = unit ? `${title} [${unit}]` : title;
    const legend = document.createElement("ul");
    this.values = traces.map((trace) => {
      const item = document.createElement("li");
      item.style.setProperty("--c", `var(--${trace.colour})`);
      if (trace.dashed) item.className = "dashed";
      legend.append(item);
      return item;
    });
    caption.append(name, legend);
    this.canvas = document.createElement("canvas");
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("aria-label", title);
    figure.append(caption, this.canvas);
    this.canvas.addEventListener("pointermove", (event) => this.point(event.offsetX));
    this.canvas.addEventListener("pointerdown", (event) => this.point(event.offsetX));
    this.canvas.addEventListener("pointerleave", () => this.shared.point(null));
    this.canvas.addEventListener("keydown", (event) => {
      const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!way) return;
      event.preventDefault();
      const { end, span } = this.shared;
      const back = this.shared.back ?? span / 2;
      this.shared.point(Math.min(span, Math.max(0, back - way * span / 100)), end);
    });
  }

  point(x) {
    const share = (x - LEFT) / (this.canvas.clientWidth - LEFT - RIGHT);
    this.shared.point(share >= 0 && share <= 1 ? (1 - share) * this.shared.span : null);
  }

  draw() {
    const { canvas, shared } = this;
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width) return;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const g = canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, width, height);
    const style = getComputedStyle(canvas);
    const css = (name) => style.getPropertyValue(`--${name}`).trim();
    const { time, columns, end, span } = shared;
    const from = place(time, end - span), to = place(time, end + 1e-9);
    const right = width - RIGHT, bottom = height - FOOT;

    let low = Infinity, high = -Infinity;
    for (const { column, factor, band } of this.traces) {
      const values = columns[column], deviations = band && columns[band];
      for (let i = from; i < to; i++) {
        if (values[i] === null) continue;
        const room = deviations ? 2 * deviations[i] : 0;
        if ((values[i] - room) * factor < low) low = (values[i] - room) * factor;
        if ((values[i] + room) * factor > high) high = (values[i] + room) * factor;
      }
    }
    if (!(low <= high)) [low, high] = [0, 1];
    if (this.fixed) [low, high] = this.fixed;
    else {
      const room = Math.max(0, this.least - (high - low)) / 2 + .06 * Math.max(high - low, this.least);
      low -= room;
      high += room;
    }
    const x = (t) => LEFT + (t - end + span) / span * (right - LEFT);
    const y = (v) => bottom - (v - low) / (high - low) * (bottom - TOP);

    g.font = "11px system-ui, sans-serif";
    g.lineWidth = 1;
    g.strokeStyle = css("grid");
    g.fillStyle = css("soft");
    g.textBaseline = "middle";
    g.textAlign = "right";
    const vertical = step(high - low, Math.max(3, (bottom - TOP) / 28));
    const decimals = Math.max(0, -Math.floor(Math.log10(vertical) + 1e-9));
    for (let v = Math.ceil(low / vertical) * vertical; v <= high + vertical * 1e-6; v += vertical) {
      g.beginPath();
      g.moveTo(LEFT, Math.round(y(v)) + .5);
      g.lineTo(right, Math.round(y(v)) + .5);
      g.stroke();
      g.fillText(v.toFixed(decimals), LEFT - 6, y(v));
    }
    g.textAlign = "center";
    g.textBaseline = "top";
    const horizontal = step(span, Math.max(2, (right - LEFT) / 90));
    for (let back = 0; back < span + 1e-9; back += horizontal) {
      const at = x(end - back);
      g.beginPath();
      g.moveTo(Math.round(at) + .5, TOP);
      g.lineTo(Math.round(at) + .5, bottom);
      g.stroke();
      g.textAlign = at > right - 16 ? "right" : at < LEFT + 16 ? "left" : "center";
      g.fillText(back ? `−${+back.toFixed(2)} s` : "now", at, bottom + 5);
    }
    if (shared.paused) {
      g.textAlign = "right";
      g.fillText("paused", right - 4, TOP + 2);
    }

    g.save();
    g.beginPath();
    g.rect(LEFT, 0, right - LEFT, bottom + 1);
    g.clip();
    g.lineJoin = "round";
    for (const trace of this.traces) {
      const values = columns[trace.column];
      const colour = css(trace.colour);
      if (trace.band) {
        const deviations = columns[trace.band];
        g.fillStyle = colour;
        g.globalAlpha = .2;
        for (const [a, b] of this.stretches(values, from, to)) {
          g.beginPath();
          for (let i = a; i < b; i++) g.lineTo(x(time[i]), y((values[i] + 2 * deviations[i]) * trace.factor));
          for (let i = b - 1; i >= a; i--) g.lineTo(x(time[i]), y((values[i] - 2 * deviations[i]) * trace.factor));
          g.fill();
        }
        g.globalAlpha = 1;
      }
      g.strokeStyle = colour;
      g.lineWidth = 1.6;
      g.setLineDash(trace.dashed ? [5, 4] : []);
      for (const [a, b] of this.stretches(values, from, to)) {
        g.beginPath();
        this.line(g, x, y, values, trace.factor, a, b);
        g.stroke();
      }
    }
    g.setLineDash([]);
    let shown = to - 1;
    if (shared.back !== null && to > from) {
      const wanted = end - shared.back;
      shown = Math.min(to - 1, Math.max(from, place(time, wanted)));
      if (shown > from && wanted - time[shown - 1] < time[shown] - wanted) shown--;
      g.strokeStyle = css("soft");
      g.beginPath();
      g.moveTo(x(time[shown]), TOP);
      g.lineTo(x(time[shown]), bottom);
      g.stroke();
      for (const trace of this.traces) {
        const value = columns[trace.column][shown];
        if (value === null) continue;
        g.fillStyle = css(trace.colour);
        g.beginPath();
        g.arc(x(time[shown]), y(value * trace.factor), 3.5, 0, 7);
        g.fill();
      }
    }
    g.restore();
    this.traces.forEach((trace, i) => {
      const value = columns[trace.column][shown], deviation = trace.band && columns[trace.band][shown];
      const text = value === undefined || value === null ? "–" :
        `${(value * trace.factor).toFixed(this.digits)}${deviation ? ` ± ${(2 * deviation * trace.factor).toFixed(2)}` : ""} ${this.unit}`;
      this.values[i].textContent = `${trace.name} ${text}`;
    });
  }

  /** Index ranges without a gap. */
  stretches(values, from, to) {
    const { time } = this.shared;
    const found = [];
    let begin = -1;
    for (let i = from; i <= to; i++) {
      const breaks = i === to || values[i] === null || (begin >= 0 && i > begin && time[i] - time[i - 1] > .5);
      if (breaks && begin >= 0) found.push([begin, i]);
      if (breaks) begin = -1;
      if (begin < 0 && i < to && values[i] !== null) begin = i;
    }
    return found;
  }

  /** Least and largest value of every pixel that has more than one. */
  line(g, x, y, values, factor, from, to) {
    const { time } = this.shared;
    let column = null, low = 0, high = 0;
    for (let i = from; i < to; i++) {
      const at = Math.round(x(time[i]) * 2) / 2, value = values[i] * factor;
      if (at !== column) {
        if (column !== null && high > low) { g.lineTo(column, y(low)); g.lineTo(column, y(high)); }
        g.lineTo(at, y(value));
        [column, low, high] = [at, value, value];
      } else {
        low = Math.min(low, value);
        high = Math.max(high, value);
      }
    }
    if (to > from) g.lineTo(x(time[to - 1]), y(values[to - 1] * factor));
  }
}
