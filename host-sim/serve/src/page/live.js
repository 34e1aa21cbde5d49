// Charts over the last seconds, for the pages of `thermyo serve` and `thermyo playground`.
import { Chart } from "./chart.js";

const $ = (id) => document.getElementById(id);
/** A line does not bridge a longer gap [s]. */
const GAP_S = .5;

const layer = (mark) => (name, colour, ...columns) => ({ name, colour: `c-${colour}`, mark, rising: true, columns });
export const line = layer("line"), dashed = layer("line dashed"), wide = layer("line wide"), band = layer("band");

/** The last seconds of a record. The page has buttons for the time shown, and to pause. */
export class Live {
  /** `names` of columns beside time; `kept_s` of data are kept, and up to `spare` rows more. */
  constructor(names, kept_s, spare) {
    Object.assign(this, { kept_s, spare, paused: false, shown: 0, span: 20, charts: [], axes: {} });
    this.columns = Object.fromEntries(["time", ...names].map((name) => [name, []]));
    for (const radio of document.querySelectorAll("[name=span]")) radio.addEventListener("change", () => {
      this.span = +radio.value;
      this.draw();
    });
    $("pause").addEventListener("click", () => {
      this.paused = !this.paused;
      $("pause").setAttribute("aria-pressed", String(this.paused));
      $("pause").textContent = this.paused ? "Go on" : "Pause";
      this.draw();
    });
  }

  get end() {
    return this.columns.time.at(-1) ?? 0;
  }

  /** Values of the last row by name. */
  get now() {
    return this.columns.time.length ? Object.fromEntries(Object.entries(this.columns).map(([name, values]) => [name, values.at(-1)])) : null;
  }

  /** `axis` is {label, unit, digits, and a least range or a range}. The first chart has the buttons of all. */
  chart(id, axis, layers) {
    const figure = $(id), heading = document.createElement("div"), name = document.createElement("span"), plot = document.createElement("div");
    heading.className = "figure-title";
    name.textContent = `${axis.label} [${axis.unit}]`;
    heading.append(name);
    plot.className = "plot";
    plot.tabIndex = 0;
    figure.append(heading, plot);
    for (const layer of layers) {
      layer.x = this.columns.time;
      layer.y = layer.columns.map((name) => this.columns[name]);
    }
    const x = { label: "Time", unit: "s", words: [] };
    const panels = [{ y: axis, layers, references: [] }];
    this.axes[id] = { axis, name };
    const tools = this.charts.length ? null : $("tools");
    this.charts.push(new Chart(figure, { name: axis.label, live: true, x, window: [-this.span, 0], panels, markers: [] }, tools));
  }

  /** Changes the unit of a chart's axis, and by `convert` the values of columns. */
  rescale(id, changes, names, convert) {
    const { axis, name } = this.axes[id];
    Object.assign(axis, changes);
    name.textContent = `${axis.label} [${axis.unit}]`;
    for (const column of names) this.columns[column].forEach((value, i, all) => (all[i] = convert(value)));
  }

  /** Adds a row; columns that it lacks have a gap. */
  push(row) {
    const put = (cells) => { for (const [name, values] of Object.entries(this.columns)) values.push(cells[name] ?? NaN); };
    if (row.time - this.end > GAP_S) put({ time: row.time });
    put(row);
  }

  /** Drops the oldest rows, in large pieces: removing from the front moves everything. */
  trim() {
    const surplus = this.columns.time.findIndex((time) => time > this.end - this.kept_s);
    if (surplus > this.spare) for (const values of Object.values(this.columns)) values.splice(0, surplus);
  }

  clear() {
    for (const values of Object.values(this.columns)) values.length = 0;
  }

  /** Draws the last seconds. A paused chart ends where it was. */
  draw() {
    if (!this.paused) this.shown = this.end;
    Chart.follow(this.charts, [this.shown - this.span, this.shown]);
  }
}
