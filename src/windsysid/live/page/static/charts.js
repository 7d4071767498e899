// Charts over time: windows as points, what is known as a line with its band, jumps as marks; each has a table twin.

import { h, table } from "/static/dom.js";
import { digits, scaled, when } from "/static/words.js";

const MOST_ROWS = 300;
const WHISKERS = 400; // points that are shown with their own bands

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

const PALETTE = ["--accent", "--warning", "--good", "--notice", "--alarm"];

// What a chart shows:
//   title, unit, about (a sentence), windows [ms]
//   points: [{ name, values, low, high, hollow }]   dots with whiskers; hollow ones are not to be used
//   lines:  [{ name, values, low, high, dashed }]
//   marks:  [{ from, to, text }]             jumps
//   logarithmic
export class Chart {
  constructor(id, onZoom) {
    this.plot = null;
    this.place = h("div", {});
    this.readout = h("p", { class: "readout quiet", "aria-hidden": "true" });
    this.caption = h("figcaption", {});
    this.keys = h("ul", { class: "keys" });
    this.twin = h("div", {});
    this.details = h("details", { ontoggle: () => this.fillTwin() }, h("summary", { id: `table-${id}` }, "Show as a table"), this.twin);
    this.figure = h("figure", {}, this.caption, this.keys, this.place, this.readout, this.details);
    this.onZoom = onZoom;
    this.width = 0;
    this.observer = new ResizeObserver(() => this.fit());
    this.observer.observe(this.place);
  }

  close() {
    this.observer.disconnect();
    this.plot?.destroy();
    this.plot = null;
  }

  fit() {
    const width = Math.floor(this.place.clientWidth);
    if (this.plot && width && width !== this.width) {
      this.width = width;
      this.plot.setSize({ width, height: 220 });
    }
  }

  update(shown, range) {
    this.shown = shown;
    const values = [...(shown.lines ?? []), ...(shown.points ?? [])].flatMap((one) => one.values).filter((v) => v !== null);
    const by = shown.factor ? { factor: shown.factor, unit: shown.unit } : scaled(shown.unit, Math.max(...values.map(Math.abs), 0));
    this.factor = by.factor;
    this.unit = by.unit;
    const unit = by.unit === "1" || !by.unit ? "" : ` [${by.unit}]`;
    this.caption.replaceChildren(h("h3", {}, shown.title + unit), shown.about ? h("p", {}, shown.about) : "");
    this.keys.replaceChildren(...this.legend());
    this.plot?.destroy();
    this.plot = null;
    if (!values.length) {
      this.place.replaceChildren(h("p", { class: "empty" }, "There is nothing to show in this range."));
    } else {
      this.place.replaceChildren();
      this.draw(range);
    }
    this.fillTwin();
  }

  legend() {
    const marks = this.shown.marks?.length ? [h("li", {}, key("--alarm"), "found to have moved")] : [];
    const named = (one, i) => h("li", {}, key(one.colour ?? PALETTE[i % PALETTE.length], one.dashed), one.name + (one.low && !one.dashed ? " ± 2σ" : ""));
    return [
      ...(this.shown.lines ?? []).map(named),
      ...(this.shown.points ?? []).map((one) => h("li", {}, h("span", { "aria-hidden": "true" }, one.hollow ? "○ " : "• "), `${one.name}${one.low ? " ± 2σ" : ""}`)),
      ...marks,
    ];
  }

  draw(range) {
    const { windows, points = [], lines = [], logarithmic } = this.shown;
    const scale = (values) => values.map((v) => (v === null ? null : v * this.factor));
    const data = [windows.map((ms) => ms / 1000)];
    const series = [{}];
    const bands = [];
    points.forEach((one, i) => {
      data.push(scale(one.values));
      const paint = colour(one.colour ?? (points.length > 1 ? PALETTE[i % PALETTE.length] : "--point"));
      const many = windows.length > WHISKERS && lines.length > 0;
      const size = one.hollow ? 6 : many ? 3 : 4;
      series.push({ stroke: paint, width: 0, alpha: many ? 0.55 : 1, points: { show: true, size, fill: one.hollow ? colour("--page") : paint, stroke: paint }, paths: () => null });
    });
    lines.forEach((one, i) => {
      const paint = colour(one.colour ?? PALETTE[i % PALETTE.length]);
      data.push(scale(one.values));
      series.push({ stroke: paint, width: one.dashed ? 1.2 : 2, dash: one.dashed ? [6, 4] : undefined, points: { show: !one.dashed && windows.length < 30 }, spanGaps: false });
      if (one.low) {
        const at = data.length;
        data.push(scale(one.high), scale(one.low));
        const edge = { stroke: "transparent", width: 0, points: { show: false } };
        series.push(edge, edge);
        bands.push({ series: [at, at + 1], fill: colour("--band") });
      }
    });
    this.data = data;
    const axis = { stroke: colour("--ink"), grid: { stroke: colour("--rule"), width: 1 }, ticks: { stroke: colour("--rule"), width: 1 }, font: "12px system-ui, sans-serif" };
    this.width = Math.floor(this.place.clientWidth) || 320;
    this.plot = new uPlot({
      width: this.width, height: 220, legend: { show: false }, padding: [8, 24, 0, 0],
      scales: {
        x: { time: true, range: () => [range[0] / 1000, range[1] / 1000] },
        y: { distr: logarithmic ? 3 : 1, range: (_, low, high) => this.extent(low, high, logarithmic) },
      },
      axes: [{ ...axis, size: 42, values: TIME_VALUES }, { ...axis, size: 64, values: (_, ticks) => ticks.map((v) => (v === null ? "" : digits(v, 5).replace(/(\.\d*?)0+$/, "$1").replace(/\.$/, ""))) }],
      series, bands,
      cursor: { sync: { key: "time" }, drag: { x: true, y: false, setScale: false }, points: { size: 7 } },
      hooks: {
        drawClear: [(u) => this.drawMarks(u)],
        drawSeries: [(u, i) => i > 0 && i <= points.length && this.drawWhiskers(u, points[i - 1], series[i].stroke)],
        setCursor: [(u) => this.read(u.cursor.idx)],
        setSelect: [(u) => this.zoom(u)],
      },
    }, data, this.place);
    const box = this.plot.root;
    box.setAttribute("role", "img");
    box.setAttribute("aria-label", `${this.shown.title}: ${this.inWords()} The table below has the values.`);
  }

  inWords() {
    const one = (this.shown.lines ?? []).find((line) => !line.dashed) ?? this.shown.points?.[0];
    const known = one ? one.values.map((v, i) => [v, i]).filter(([v]) => v !== null) : [];
    if (!known.length) return "no values.";
    const [first, last] = [known[0], known.at(-1)];
    const say = ([v, i]) => `${digits(v * this.factor)} ${this.unit} on ${when(this.shown.windows[i])}`;
    return `${one.name} from ${say(first)} to ${say(last)}.`;
  }

  // What most points and all bands of the level need: one wild window does not hide the rest.
  extent(low, high, logarithmic) {
    const { points = [], lines = [] } = this.shown;
    const all = lines.flatMap((one) => (one.dashed ? [] : [...one.values, ...(one.low ?? []), ...(one.high ?? [])])).filter((v) => v !== null);
    for (const one of points.filter((some) => !some.hollow)) {
      const sorted = one.values.filter((v) => v !== null).sort((a, b) => a - b);
      if (sorted.length) all.push(sorted[Math.floor(0.01 * (sorted.length - 1))], sorted[Math.ceil(0.99 * (sorted.length - 1))]);
    }
    if (!all.length) return low === null ? [0, 1] : [low, high];
    let [least, most] = [Math.min(...all) * this.factor, Math.max(...all) * this.factor];
    if (logarithmic) return [least / 1.3, most * 1.3];
    for (const one of lines.filter((line) => line.dashed)) {
      const near = one.values.filter((v) => v !== null).map((v) => v * this.factor);
      if (near.length && Math.max(...near) < 1.6 * most && Math.min(...near) > 0.4 * least) {
        least = Math.min(least, ...near);
        most = Math.max(most, ...near);
      }
    }
    const pad = 0.12 * (most - least) || 0.05 * Math.abs(most) || 1;
    return [least - pad, most + pad];
  }

  drawMarks(u) {
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    for (const mark of this.shown.marks ?? []) {
      const [from, to] = [mark.from, mark.to].map((ms) => u.valToPos(ms / 1000, "x", true));
      ctx.fillStyle = colour("--jump");
      ctx.fillRect(from, bbox.top, Math.max(to - from, 4), bbox.height);
      ctx.fillStyle = colour("--alarm");
      ctx.fillRect((from + to) / 2 - 1, bbox.top, 2, bbox.height);
      ctx.font = `${12 * devicePixelRatio}px system-ui, sans-serif`;
      ctx.fillText("▲", (from + to) / 2 - 5 * devicePixelRatio, bbox.top + 12 * devicePixelRatio);
    }
    ctx.restore();
  }

  drawWhiskers(u, one, stroke) {
    const [from, to] = [u.scales.x.min * 1000, u.scales.x.max * 1000];
    const { windows } = this.shown;
    const inside = windows.map((_, i) => i).filter((i) => windows[i] >= from && windows[i] <= to);
    if (!one.low || inside.length > WHISKERS) return;
    const { ctx, bbox } = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.globalAlpha = 0.45;
    ctx.strokeStyle = typeof stroke === "function" ? stroke() : stroke;
    ctx.lineWidth = devicePixelRatio;
    ctx.beginPath();
    for (const i of inside.filter((at) => one.low[at] !== null)) {
      const x = u.valToPos(windows[i] / 1000, "x", true);
      ctx.moveTo(x, u.valToPos(one.low[i] * this.factor, "y", true));
      ctx.lineTo(x, u.valToPos(one.high[i] * this.factor, "y", true));
    }
    ctx.stroke();
    ctx.restore();
  }

  read(i) {
    const { windows, points = [], lines = [] } = this.shown;
    if (i === null || i === undefined) {
      this.readout.textContent = "";
      return;
    }
    const said = [...lines, ...points].filter((one) => one.values[i] !== null && one.values[i] !== undefined)
      .map((one) => `${one.name} ${digits(one.values[i] * this.factor)}`);
    this.readout.textContent = `${when(windows[i])}: ${said.join(", ") || "nothing"}`;
  }

  zoom(u) {
    const { left, width } = u.select;
    if (width < 8) return;
    const [from, to] = [left, left + width].map((x) => 1000 * u.posToVal(x, "x"));
    u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
    this.onZoom(from, to);
  }

  // The table is made when it is asked for.
  fillTwin() {
    if (!this.details.open || !this.shown) return;
    const { windows, points = [], lines = [], title } = this.shown;
    const columns = [["Window"]];
    const cells = [];
    for (const one of [...lines, ...points]) {
      columns.push([one.name, true]);
      cells.push((i) => digits(scaledBy(one.values[i], this.factor)));
      if (one.low && !one.dashed) {
        columns.push([`${one.name}, −2σ … +2σ`, true]);
        cells.push((i) => (one.low[i] === null ? "–" : `${digits(one.low[i] * this.factor)} … ${digits(one.high[i] * this.factor)}`));
      }
    }
    const rows = windows.map((_, i) => i).slice(-MOST_ROWS).reverse();
    const cut = windows.length > MOST_ROWS ? `, the newest ${MOST_ROWS} of ${windows.length} windows: choose a shorter range for others` : ", the newest first";
    this.twin.replaceChildren(table(`${title}${this.unit && this.unit !== "1" ? ` [${this.unit}]` : ""}${cut}`, columns,
      rows.map((i) => [when(windows[i]), ...cells.map((cell) => cell(i))])));
  }
}

const scaledBy = (value, factor) => (value === null ? null : value * factor);

const key = (name, dashed) => {
  const element = h("span", { class: `key ${dashed ? "dashed" : ""}`, "aria-hidden": "true" });
  element.style.borderColor = `var(${name})`;
  return element;
};

const hours = new Intl.DateTimeFormat("en-GB", { hour: "2-digit", minute: "2-digit" });
const days = new Intl.DateTimeFormat("en-GB", { day: "numeric", month: "short" });

function TIME_VALUES(u, ticks) {
  const long = ticks.length > 1 && ticks[1] - ticks[0] >= 86400;
  return ticks.map((s, i) => {
    const at = new Date(1000 * s);
    const day = days.format(at);
    if (long) return day;
    const fresh = i === 0 || day !== days.format(new Date(1000 * ticks[i - 1]));
    return fresh ? `${hours.format(at)}\n${day}` : hours.format(at);
  });
}
