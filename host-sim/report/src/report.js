
// The report, in one script with chart.js: decodes the points of the page and draws its charts.
const { arrays, figures } = JSON.parse(document.getElementById("plots").textContent);

/** The values of a stored array; gaps are NaN. */
const decoded = arrays.map(({ bits, low, span, data }) => {
  const bytes = Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  const width = bits / 8, gap = 2 ** bits - 1;
  return Float64Array.from({ length: bytes.length / width }, (_, i) => {
    const code = bits === 16 ? view.getUint16(2 * i, true) : view.getUint32(4 * i, true);
    return code === gap ? NaN : low + (code / (gap - 1)) * span;
  });
});

for (const [id, plot] of Object.entries(figures)) {
  for (const layer of plot.panels.flatMap(({ layers }) => layers)) {
    layer.x = decoded[layer.x];
    layer.y = layer.y.map((index) => decoded[index]);
  }
  const figure = document.getElementById(id);
  plot.name = figure.querySelector(".plot svg").getAttribute("aria-label");
  new Chart(figure, plot, figure.querySelector(".figure-title"));
}
