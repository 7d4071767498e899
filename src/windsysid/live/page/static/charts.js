// Charts, drawn by the plots of the report pages (reports/static/plots.js), each with a table of its values.
/* global plots */

import { h, table } from "/static/dom.js";
import { digits, scaled, when } from "/static/words.js";

const MAX_ROWS = 300;
const COLOURS = ["estimate", "error", "other", "reference", "measured"];

export class Chart {
  constructor(id) {
    this.caption = h("figcaption", {});
    this.box = h("div", { class: "plot" });
    this.empty = h("p", { class: "empty", hidden: true }, "No values in this range.");
    this.twin = h("div", {});
    this.details = h("details", { ontoggle: () => this.fillTwin() }, h("summary", { id: `table-${id}` }, "Show as a table"), this.twin);
    this.element = h("figure", {}, this.caption, this.empty, this.box, this.details);
  }

  close() { this.plot?.close(); }

  // The specification of a plot, with a sentence `about` it.
  update(spec) {
    this.spec = spec;
    this.caption.replaceChildren(h("h3", {}, spec.title), spec.about ? h("p", {}, spec.about) : "");
    const empty = !spec.cells?.y.length && spec.curves.every((one) => one.values.every((v) => v === null));
    this.empty.hidden = !empty;
    this.box.hidden = this.details.hidden = empty;
    if (!empty && this.plot) this.plot.update(spec);
    else if (!empty) this.plot = plots.draw(this.box, spec);
    this.fillTwin();
  }

  // The table is made when it is opened.
  fillTwin() {
    if (!this.details.open || !this.spec) return;
    const { x, curves, title, x_axis: axis } = this.spec;
    const columns = [[axis.say ? "Window" : axis.label, !axis.say]];
    const cells = [];
    for (const one of curves) {
      columns.push([one.name, true]);
      cells.push((i) => digits(one.values[i]));
      if (!one.low) continue;
      columns.push([`${one.name}, 95 % interval`, true]);
      cells.push((i) => (one.low[i] === null ? "–" : `${digits(one.low[i])} … ${digits(one.high[i])}`));
    }
    const all = x.map((_, i) => i);
    const rows = axis.say ? all.slice(-MAX_ROWS).reverse() : all;
    const order = !axis.say ? "" : x.length > MAX_ROWS ? `, newest ${MAX_ROWS} of ${x.length} windows: choose a shorter range for others` : ", newest first";
    this.twin.replaceChildren(table(`${title}${order}`, columns, rows.map((i) => [axis.say ? when(1000 * x[i]) : digits(x[i]), ...cells.map((cell) => cell(i))])));
  }
}

// The specification of a plot over time.
//   title, unit, about (a sentence), windows [ms], range [ms], logarithmic
//   points: [{ name, values, low, high, hollow }]   dots with whiskers; hollow ones have grade C
//   lines:  [{ name, values, low, high, dashed }]
//   marks:  [{ from, to }]                          jumps
//   overlay: { name, unit, values }                 on the right axis
export function overTime({ title, unit, factor, about, windows, range, logarithmic, points = [], lines = [], marks = [], overlay }) {
  const values = [...lines, ...points].flatMap((one) => one.values).filter((v) => v !== null);
  const by = factor ? { factor, unit } : scaled(unit, Math.max(...values.map(Math.abs), 0));
  const scale = (some) => some.map((v) => (v === null ? null : v * by.factor));
  const curve = (one, i, look) => ({
    name: one.name, look, colour: one.colour ?? COLOURS[i % COLOURS.length], dashed: Boolean(one.dashed), values: scale(one.values),
    ...(one.low ? { low: scale(one.low), high: scale(one.high) } : {}),
  });
  const curves = [...points.map((one, i) => curve(one, i, one.hollow ? "rings" : "dots")), ...lines.map((one, i) => curve(one, i, "line"))];
  const label = !by.unit || by.unit === "1" ? "" : `[${by.unit}]`;
  return {
    title, about, x: windows.map((ms) => ms / 1000), words: `${title}: ${inWords(lines, points, windows, by)} The table below has the values.`,
    curves: overlay ? [...curves, { name: overlay.name, look: "line", colour: "other", dashed: false, values: overlay.values, right: `${overlay.name} [${overlay.unit}]` }] : curves,
    x_axis: timeAxis(range), y_axis: { label, log: Boolean(logarithmic), names: [], limits: extent(curves, logarithmic) },
    marks: marks.map((one) => ({ at: (one.from + one.to) / 2000, name: "▲", colour: "error", group: "jump", across: false })),
    spans: marks.map((one) => ({ start: one.from / 1000, end: one.to / 1000, colour: "error", group: "" })), link: "time",
  };
}

export const timeAxis = (range) => ({ label: "", log: false, dates: true, limits: range.map((ms) => ms / 1000), names: [], say: (seconds) => when(1000 * seconds) });

function inWords(lines, points, windows, by) {
  const one = lines.find((line) => !line.dashed) ?? points[0];
  const known = one ? one.values.map((v, i) => [v, i]).filter(([v]) => v !== null) : [];
  if (!known.length) return "no values.";
  const say = ([v, i]) => `${digits(v * by.factor)} ${by.unit} on ${when(windows[i])}`;
  return `${one.name} from ${say(known[0])} to ${say(known.at(-1))}.`;
}

// Limits of the level's intervals and of 98 % of the points: a single outlier does not set the scale.
function extent(curves, logarithmic) {
  const known = (some) => some.filter((v) => v !== null);
  const all = known(curves.flatMap((one) => (one.look !== "line" || one.dashed ? [] : [...one.values, ...(one.low ?? []), ...(one.high ?? [])])));
  for (const one of curves.filter((some) => some.look === "dots")) {
    const sorted = known(one.values).sort((a, b) => a - b);
    if (sorted.length) all.push(sorted[Math.floor(0.01 * (sorted.length - 1))], sorted[Math.ceil(0.99 * (sorted.length - 1))]);
  }
  if (!all.length) return null;
  let [least, most] = [Math.min(...all), Math.max(...all)];
  if (logarithmic) return [least / 1.3, most * 1.3];
  for (const one of curves.filter((some) => some.dashed)) {
    const near = known(one.values);
    if (near.length && Math.max(...near) < 1.6 * most && Math.min(...near) > 0.4 * least) [least, most] = [Math.min(least, ...near), Math.max(most, ...near)];
  }
  const margin = 0.12 * (most - least) || 0.05 * Math.abs(most) || 1;
  return [least - margin, most + margin];
}
