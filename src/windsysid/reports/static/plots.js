// Interactive plots of report pages, drawn with uPlot from the JSON that the page embeds (reports/interactive/plot.py).
//
// Every <figure class="plot"> with a <script type="application/json"> becomes a plot: drag to zoom, shift and drag to
// pan, double click to reset, keys + − ← → 0, a legend that switches curves, log or linear axes, PNG and CSV.
// Other scripts of a page may call plots.draw(figure, spec), which returns a figure with update(spec) and close(),
// plots.colour(name) and plots.download(name, type, content). "plot-click" and "plot-view" tell what a reader does.
// A spec of a script may also have: curves on a right axis (`right`), cells (a spectrum over time), words (its
// description), and x_axis.say (a moment as text).
const plots = (() => {
  "use strict";
  const HEIGHT = 280;
  const MAX_WHISKERS = 400;
  const NAME_ROWS = 3; // of names of marks above a plot
  const links = new Map(); // plots that zoom together

  const colour = (name, alpha) => {
    const value = getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim() || "#777";
    return alpha === undefined ? value : value + Math.round(255 * alpha).toString(16).padStart(2, "0");
  };

  const make = (tag, attributes = {}, ...children) => {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
      else if (value !== null && value !== undefined) element.setAttribute(name, value);
    }
    element.append(...children);
    return element;
  };

  const digits = (value, count = 4) => {
    if (value === null || value === undefined) return "–";
    const size = Math.abs(value);
    if (size !== 0 && (size >= 1e6 || size < 1e-3)) return value.toExponential(count - 1).replace(/\.?0+e/, "e").replace("e+", "e");
    return String(Number(value.toPrecision(count)));
  };

  const download = (name, type, content) => {
    const address = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type }));
    const anchor = make("a", { href: address, download: name });
    document.body.append(anchor);
    anchor.click();
    anchor.remove();
    setTimeout(() => URL.revokeObjectURL(address), 1000);
  };

  const moment = (seconds) => `${new Date(1000 * seconds).toISOString().slice(0, 19)}Z`;

  const ticksIn = (timeZone) => {
    const [hours, days, months] = [{ hour: "2-digit", minute: "2-digit" }, { day: "numeric", month: "short" }, { month: "short", year: "numeric" }]
      .map((parts) => new Intl.DateTimeFormat("en-GB", { ...parts, timeZone }));
    return (u, ticks) => ticks.map((seconds, i) => {
      const at = 1000 * seconds, step = ticks.length > 1 ? ticks[1] - ticks[0] : 0, day = days.format(at);
      if (step >= 86400) return step >= 28 * 86400 ? months.format(at) : day;
      return i === 0 || day !== days.format(1000 * ticks[i - 1]) ? `${hours.format(at)}\n${day}` : hours.format(at);
    });
  };

  // A tick of a logarithmic axis: powers of ten that are long as such.
  const power = (value) => {
    const n = Math.round(Math.log10(value));
    return n > -4 && n < 6 ? digits(value) : `10${String(n).replace(/./g, (sign) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(sign)])}`;
  };

  const cell = (text) => (/[",\n]/.test(text) ? `"${String(text).replaceAll('"', '""')}"` : String(text));

  class Figure {
    constructor(figure, spec) {
      this.figure = figure;
      this.hidden = new Set();
      this.ended = new AbortController();
      this.legend = make("div", { class: "plot-legend", role: "group", "aria-label": `Curves of ${spec.title}` });
      this.tools = make("div", { class: "plot-tools", role: "group", "aria-label": `Tools of ${spec.title}` });
      this.place = make("div", { class: "plot-canvas", tabindex: "0", role: "img", onkeydown: (event) => this.key(event) });
      this.readout = make("p", { class: "plot-readout", "aria-hidden": "true" });
      figure.append(this.legend, this.place, this.readout, this.tools);
      figure.classList.add("live");
      if (spec.link) links.set(spec.link, [...(links.get(spec.link) ?? []), this]);
      this.update(spec);
      this.observer = new ResizeObserver(() => this.fit());
      this.observer.observe(this.place);
      for (const media of ["(prefers-color-scheme: dark)", "print"]) matchMedia(media).addEventListener("change", () => this.draw(), { signal: this.ended.signal });
    }

    zoomed() {
      const start = this.positive([...this.start], this.log.x), width = start[1] - start[0];
      return this.view.y !== null || this.view.x.some((v, i) => Math.abs(v - start[i]) > 1e-6 * width);
    }

    // New values; what the reader switched off, and a zoom, stay.
    update(spec) {
      this.log ??= { x: spec.x_axis.log, y: spec.y_axis.log };
      const kept = this.view && this.zoomed() ? this.view : null;
      this.spec = spec;
      this.longest = Math.max(0, ...spec.x_axis.names.map((one) => one.length));
      this.whole = this.extent(spec.x);
      this.start = spec.x_axis.limits ?? this.whole;
      this.view = kept ?? { x: this.positive([...this.start], this.log.x), y: null };
      this.place.setAttribute("aria-label", `${this.inWords()} Keys: plus and minus zoom, arrows pan, 0 resets.`);
      this.fillLegend();
      this.fillTools();
      this.draw();
    }

    close() {
      this.ended.abort();
      this.observer.disconnect();
      links.set(this.spec.link, (links.get(this.spec.link) ?? []).filter((one) => one !== this));
      this.plot.destroy();
      this.figure.remove();
    }

    inWords() {
      const { title, curves, x_axis: x, y_axis: y, words } = this.spec;
      return words ?? `${title}: ${curves.map((c) => c.name).join(", ")}; ${y.label} over ${x.label}.`;
    }

    extent(values) {
      if (this.spec.x_axis.names.length) return [-0.5, this.spec.x_axis.names.length - 0.5];
      const known = values.filter((v) => v !== null);
      const [low, high] = known.length ? [known[0], known.at(-1)] : [0, 1];
      return high > low ? [low, high] : [low - 0.5, high + 0.5];
    }

    positive([low, high], log) {
      if (!log || low > 0) return [low, high];
      const least = this.spec.x.find((v) => v > 0) ?? 1e-3;
      return [least, Math.max(high, 2 * least)];
    }

    switches() {
      const { curves, marks, spans } = this.spec;
      const found = curves.map((c, i) => ({ key: `c${i}`, name: c.name + (c.low && c.look !== "area" ? ", 95 %" : ""), colour: c.colour, kind: c.look + (c.dashed ? " dashed" : "") }));
      for (const [kind, all] of [["mark", marks], ["span", spans]]) {
        for (const group of new Set(all.map((one) => one.group).filter(Boolean))) {
          found.push({ key: group, name: group, colour: all.find((one) => one.group === group).colour, kind });
        }
      }
      return found;
    }

    fillLegend() {
      const shown = this.switches(), keys = shown.map((one) => JSON.stringify(one)).join();
      if (keys === this.keys) return;
      this.keys = keys;
      this.legend.replaceChildren(...shown.map(({ key, name, colour: paint, kind }) => {
        const sign = make("span", { class: `sign ${kind}`, "aria-hidden": "true" });
        sign.style.setProperty("--sign", `var(--${paint})`);
        const button = make("button", { type: "button", "aria-pressed": String(!this.hidden.has(key)) }, sign, name);
        button.addEventListener("click", () => {
          if (!this.hidden.delete(key)) this.hidden.add(key);
          button.setAttribute("aria-pressed", String(!this.hidden.has(key)));
          this.draw();
        });
        return button;
      }));
    }

    fillTools() {
      const tool = (text, title, act, pressed) => make("button", { type: "button", title, "aria-label": title, "aria-pressed": pressed, onclick: (event) => act(event.currentTarget) }, text);
      const flip = (side) => (button) => {
        this.log[side] = !this.log[side];
        button.setAttribute("aria-pressed", String(this.log[side]));
        this.view = { x: this.positive(this.view.x, this.log.x), y: null };
        this.draw();
      };
      const { x_axis: x, y_axis: y, curves } = this.spec;
      if (this.tools.childElementCount) return;
      const above = (values) => values.some((v) => v > 0) && values.every((v) => v === null || v >= 0);
      this.tools.replaceChildren(
        tool("+", "Zoom in", () => this.zoomBy(0.5)), tool("−", "Zoom out", () => this.zoomBy(2)),
        tool("reset", "Reset the zoom (double click)", () => this.reset()),
        ...(y.names.length || !curves.every((c) => above([...c.values, ...(c.low ?? [])])) ? [] : [tool("log y", "Logarithmic vertical axis", flip("y"), String(this.log.y))]),
        ...(x.dates || x.names.length || !above(this.spec.x) ? [] : [tool("log x", "Logarithmic horizontal axis", flip("x"), String(this.log.x))]),
        tool("PNG", "Save the picture as PNG", () => this.savePng()), tool("CSV", "Save the shown values as CSV", () => this.saveCsv()),
      );
    }

    height() { return (this.spec.tall ? 1.7 : 1) * HEIGHT + this.nameHeight; }

    shown(i) { return !this.hidden.has(`c${i}`); }

    fit() {
      const width = Math.floor(this.place.clientWidth);
      if (!this.plot || !width || width === this.width) return;
      if (this.longest || this.spec.end_names) this.draw();
      else this.plot.setSize({ width: this.width = width, height: this.height() });
    }

    // Vertical limits of the curves that are shown within the horizontal ones, of the left axis or the right one.
    heights(right = false) {
      const { x, y_axis: y, curves, marks } = this.spec;
      if (!right && this.view.y) return this.view.y;
      if (!right && y.limits && this.log.y === y.log) return y.limits;
      const log = !right && this.log.y;
      let [low, high] = [Infinity, -Infinity];
      const take = (v) => { if (v !== null && (v > 0 || !log)) { low = Math.min(low, v); high = Math.max(high, v); } };
      curves.forEach((c, i) => {
        if (!this.shown(i) || Boolean(c.right) !== right) return;
        for (let k = 0; k < x.length; k++) {
          if (x[k] < this.view.x[0] || x[k] > this.view.x[1]) continue;
          for (const values of [c.values, c.low, c.high]) if (values) take(values[k]);
        }
      });
      if (!right) marks.filter((m) => m.across).forEach((m) => take(m.at));
      if (low > high) return log ? [0.1, 1] : [0, 1];
      if (log) return [low / 1.5, high * 1.5];
      const margin = 0.06 * (high - low) || 0.05 * Math.abs(high) || 1;
      return [low - margin, high + margin];
    }

    draw() {
      const { spec, log } = this;
      const paint = (name, alpha) => colour(name, alpha);
      const data = [spec.x], series = [{}], bands = [];
      spec.curves.forEach((c, i) => {
        const show = this.shown(i), none = { show: false }, scale = c.right ? "right" : "y";
        if (c.look !== "area") {
          data.push(c.values);
          const dots = c.look === "dots" || c.look === "rings", dot = spec.x.length > 400 ? 3 : spec.x.length > 60 ? 5 : 8, drawn = dots || c.look === "bars";
          series.push({ show, scale, stroke: paint(c.colour), width: drawn ? 0 : 1.4, dash: c.dashed ? [6, 4] : undefined, spanGaps: false,
            points: dots ? { show: true, size: dot, fill: paint(c.look === "rings" ? "page" : c.colour), stroke: paint(c.colour) } : none, ...(drawn ? { paths: () => null } : {}) });
        }
        if (c.low && c.look !== "dots" && c.look !== "bars") {
          data.push(c.high, c.low);
          const edge = { show, scale, stroke: c.look === "area" ? paint(c.colour) : "transparent", width: c.look === "area" ? 0.7 : 0, points: none };
          series.push(edge, edge);
          bands.push({ series: [data.length - 2, data.length - 1], fill: paint(c.colour, c.look === "area" ? 0.9 : 0.22) });
        }
      });
      const axis = (side, more) => ({ stroke: paint("ink"), grid: { stroke: paint("rule"), width: 1 }, ticks: { stroke: paint("rule"), width: 1 },
        font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif", label: spec[`${side}_axis`].label || undefined, labelSize: 20, ...more });
      const name = (values) => values.map((v) => (v === null ? "" : digits(v, 6)));
      // Powers of ten, as many as there is room for; of a short axis 1, 2 and 5 times these.
      const named = (ticks, decades) => ticks.map((v) => {
        const n = Math.floor(Math.log10(v) + 1e-9), first = Math.round(v / 10 ** n);
        return decades > 1.5 ? (first === 1 && n % Math.ceil(decades / 9) === 0 ? power(v) : "") : ticks.length < 5 || [1, 2, 5].includes(first) ? digits(v, 3) : "";
      });
      const splits = (u, axis, min, max) => {
        const found = [];
        for (let n = Math.floor(Math.log10(min)); n <= Math.log10(max); n++) for (let k = 1; k < 10; k++) found.push(k * 10 ** n);
        const inside = found.filter((v) => v >= min && v <= max);
        return inside.length > 1 ? inside : [0.1, 0.5, 0.9].map((share) => min + share * (max - min));
      };
      const values = (side) => (u, ticks) => (log[side] ? named(ticks, Math.log10(u.scales[side].max / u.scales[side].min)) : name(ticks));
      const every = (side) => (log[side] ? { splits, filter: (u, ticks) => ticks } : {});
      const names = spec.x_axis.names;
      const right = spec.curves.find((c) => c.right);
      this.plot?.destroy();
      this.width = Math.floor(this.place.clientWidth) || 320;
      const flat = names.length * (8 + 7 * this.longest) < this.width - 76;
      this.nameHeight = !names.length ? 0 : flat ? 30 : Math.min(130, 20 + 5.2 * this.longest);
      const byName = { splits: () => names.map((_, i) => i), values: () => names, rotate: flat ? 0 : 50, size: this.nameHeight, grid: { show: false } };
      const ends = spec.end_names ? Math.min(0.3 * this.width, 10 + 6.5 * Math.max(...spec.curves.map((c) => c.name.length))) : 14;
      this.plot = new uPlot({
        width: this.width, height: this.height(), legend: { show: false }, padding: [spec.marks.some((one) => one.name && !one.across) ? 6 + 13 * NAME_ROWS : 10, ends, 0, 0],
        scales: {
          x: { time: spec.x_axis.dates, distr: log.x ? 3 : 1, range: () => this.view.x },
          y: { distr: log.y ? 3 : 1, range: () => this.heights() },
          ...(right ? { right: { range: () => this.heights(true) } } : {}),
        },
        // Moments of a report are in UTC, those of a page that says them itself in the reader's zone.
        ...(spec.x_axis.say ? {} : { tzDate: (seconds) => uPlot.tzDate(new Date(1000 * seconds), "Etc/UTC") }),
        axes: [axis("x", names.length ? byName : spec.x_axis.dates ? { size: 44, values: ticksIn(spec.x_axis.say ? undefined : "UTC") } : { size: 34, values: values("x"), ...every("x") }), axis("y", { size: 62, values: values("y"), ...every("y") }),
          ...(right ? [axis("y", { scale: "right", side: 1, size: 56, label: right.right, grid: { show: false }, stroke: paint(right.colour), values: (u, ticks) => name(ticks) })] : [])],
        series, bands,
        cursor: {
          drag: { x: true, y: true, uni: 40, dist: 5, setScale: false }, points: { size: 6 },
          bind: {
            mousedown: (u, target, take) => (event) => (event.shiftKey || event.button === 1 ? this.pan(u, event) : take(event)),
            dblclick: () => () => { this.reset(); return null; },
          },
        },
        hooks: {
          drawClear: [(u) => { this.drawCells(u); this.drawSpans(u); this.drawWhiskers(u); }],
          draw: [(u) => { this.drawMarks(u); if (spec.end_names) this.drawEnds(u); }],
          setCursor: [(u) => this.read(u.cursor.idx, u)],
          setSelect: [(u) => this.zoomTo(u)],
        },
      }, data, this.place);
      const { plot } = this;
      plot.over.addEventListener("mousedown", (down) => plot.over.addEventListener("click", (up) => {
        if (Math.abs(up.clientX - down.clientX) > 4) return;
        dispatchEvent(new CustomEvent("plot-click", { detail: { link: spec.link, x: plot.posToVal(up.offsetX, "x") } }));
      }, { once: true }));
    }

    within(u, act) {
      const { ctx, bbox } = u;
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      act(ctx, bbox);
      ctx.restore();
    }

    drawSpans(u) {
      this.within(u, (ctx, box) => {
        for (const span of this.spec.spans.filter((one) => !this.hidden.has(one.group))) {
          const [from, to] = [span.start, span.end].map((at) => u.valToPos(this.log.x ? Math.max(at, this.view.x[0]) : at, "x", true));
          ctx.fillStyle = colour(span.colour, 0.18);
          ctx.fillRect(from, box.top, Math.max(to - from, uPlot.pxRatio), box.height);
        }
      });
    }

    // A colour from the page's own to the ink, by way of its accent.
    shade(share) {
      const [from, to, part] = share < 0.6 ? ["page", "accent", share / 0.6] : ["accent", "ink", (share - 0.6) / 0.4];
      const parts = (name) => colour(name).slice(1).replace(/^(.)(.)(.)$/, "$1$1$2$2$3$3").match(/../g).map((two) => parseInt(two, 16));
      const end = parts(to);
      return `rgb(${parts(from).map((v, i) => Math.round(v + part * (end[i] - v))).join(" ")})`;
    }

    drawCells(u) {
      const { cells } = this.spec;
      if (!cells?.y.length) return;
      const { low, high, width } = cells;
      const shades = Array.from({ length: 65 }, (_, i) => this.shade(i / 64));
      const middle = (values, i) => (i === 0 ? values[0] : i === values.length ? values.at(-1) : 0.5 * (values[i - 1] + values[i]));
      const rows = cells.y.concat(0).map((_, i) => u.valToPos(middle(cells.y, i), "y", true));
      this.within(u, (ctx) => cells.values.forEach((column, k) => {
        const [left, right] = [cells.x[k] - 0.5 * width, cells.x[k] + 0.5 * width].map((at) => Math.round(u.valToPos(at, "x", true)));
        column.forEach((value, i) => {
          if (value === null) return;
          ctx.fillStyle = shades[Math.round(64 * Math.min(Math.max((value - low) / (high - low || 1), 0), 1))];
          ctx.fillRect(left, Math.floor(rows[i + 1]), right - left, Math.ceil(rows[i]) - Math.floor(rows[i + 1]));
        });
      }));
    }

    drawWhiskers(u) {
      const [from, to] = this.view.x;
      const count = this.spec.x.filter((at) => at >= from && at <= to).length;
      if (count > MAX_WHISKERS) return;
      this.within(u, (ctx) => this.spec.curves.forEach((c, i) => {
        const bars = c.look === "bars";
        if (!(bars || c.look === "dots") || !c.low || !this.shown(i)) return;
        ctx.strokeStyle = colour(c.colour, bars ? 0.3 : count > 60 ? 0.35 : 0.8);
        ctx.lineWidth = (bars ? 11 : count > 60 ? 1.3 : 2) * uPlot.pxRatio;
        ctx.beginPath();
        this.spec.x.forEach((at, k) => {
          if (c.low[k] === null || c.high[k] === null) return;
          const x = u.valToPos(at, "x", true);
          ctx.moveTo(x, u.valToPos(c.low[k], c.right ? "right" : "y", true));
          ctx.lineTo(x, u.valToPos(c.high[k], c.right ? "right" : "y", true));
        });
        ctx.stroke();
      }));
    }

    drawMarks(u) {
      const { ctx, bbox } = u, ratio = uPlot.pxRatio;
      const marks = this.spec.marks.filter((one) => !this.hidden.has(one.group)).sort((a, b) => a.at - b.at);
      this.within(u, () => {
        ctx.lineWidth = ratio;
        ctx.setLineDash([3 * ratio, 3 * ratio]);
        for (const mark of marks) {
          ctx.strokeStyle = colour(mark.colour);
          ctx.beginPath();
          const at = u.valToPos(mark.at, mark.across ? "y" : "x", true);
          if (mark.across) { ctx.moveTo(bbox.left, at); ctx.lineTo(bbox.left + bbox.width, at); } else { ctx.moveTo(at, bbox.top); ctx.lineTo(at, bbox.top + bbox.height); }
          ctx.stroke();
        }
      });
      ctx.save();
      ctx.font = `${11 * ratio}px system-ui, sans-serif`;
      const rows = Array(NAME_ROWS).fill(-Infinity);
      ctx.textAlign = "left";
      for (const mark of marks.filter((one) => one.name && one.across)) {
        ctx.fillStyle = colour(mark.colour);
        ctx.fillText(mark.name, bbox.left + 4 * ratio, u.valToPos(mark.at, "y", true) - 5 * ratio);
      }
      ctx.textAlign = "center";
      for (const mark of marks.filter((one) => one.name && !one.across && one.at >= this.view.x[0] && one.at <= this.view.x[1])) {
        const half = 0.5 * ctx.measureText(mark.name).width + 3 * ratio;
        const at = Math.min(Math.max(u.valToPos(mark.at, "x", true), half), ctx.canvas.width - half);
        const row = rows.findIndex((end) => at - half >= end);
        if (row < 0) continue;
        ctx.fillStyle = colour(mark.colour);
        ctx.fillText(mark.name, at, bbox.top - (5 + 13 * row) * ratio);
        rows[row] = at + half;
      }
      ctx.restore();
    }

    // Names of lines at their right ends, from the highest down, each below the one before; of lines that end before,
    // at their last points.
    drawEnds(u) {
      const { ctx, bbox } = u, ratio = uPlot.pxRatio, ends = [], { x, curves } = this.spec;
      const last = x.findLastIndex((at) => at <= this.view.x[1]);
      ctx.save();
      ctx.font = `${11 * ratio}px system-ui, sans-serif`;
      [ctx.textAlign, ctx.textBaseline] = ["left", "middle"];
      curves.forEach((c, i) => {
        if (c.look !== "line" || !this.shown(i)) return;
        const end = c.values.findLastIndex((v, k) => k <= last && v !== null);
        if (end < 0) return;
        const at = u.valToPos(c.values[end], "y", true);
        if (x[last] - x[end] < 0.01 * (this.view.x[1] - this.view.x[0])) { ends.push([at, c]); return; }
        ctx.fillStyle = colour(c.colour);
        ctx.fillText(c.name, u.valToPos(x[end], "x", true) + 5 * ratio, Math.max(at, bbox.top + 7 * ratio));
      });
      const named = ends.filter(([at]) => at >= bbox.top && at <= bbox.top + bbox.height).sort(([a], [b]) => a - b);
      let [above, below] = [-Infinity, bbox.top + bbox.height + 6 * ratio];
      for (const one of named) above = one[0] = Math.max(one[0], above + 12 * ratio);
      for (const one of named.reverse()) {
        one[0] = Math.min(one[0], below);
        below = one[0] - 12 * ratio;
        ctx.fillStyle = colour(one[1].colour);
        ctx.fillText(one[1].name, bbox.left + bbox.width + 5 * ratio, one[0]);
      }
      ctx.restore();
    }

    at(value) {
      const { x_axis: axis } = this.spec;
      if (axis.names.length) return axis.names[value] ?? "";
      if (axis.say) return axis.say(value);
      return axis.dates ? new Date(1000 * value).toISOString().slice(0, 16).replace("T", " ") : digits(value, 5);
    }

    // The cell at a point: its row, and the value as text.
    cellAt(u) {
      const { cells } = this.spec;
      if (!cells?.y.length || !(u?.cursor.left >= 0)) return "";
      const [x, y] = [u.posToVal(u.cursor.left, "x"), u.posToVal(u.cursor.top, "y")];
      const column = cells.x.findLastIndex((at) => Math.abs(x - at) <= 0.5 * cells.width);
      const row = cells.y.reduce((best, at, i) => (Math.abs(at - y) < Math.abs(cells.y[best] - y) ? i : best), 0);
      const value = cells.values[column]?.[row];
      return value === undefined || value === null ? "" : `, ${digits(10 ** value, 3)} ${cells.label} at ${digits(y, 3)} Hz`;
    }

    read(index, u) {
      if (index === null || index === undefined) { this.readout.textContent = ""; return; }
      const said = this.spec.curves.filter((_, i) => this.shown(i)).map((c) => {
        const [low, high] = [c.low?.[index], c.high?.[index]];
        const range = low === null || low === undefined ? "" : ` ${digits(low, 3)} … ${digits(high, 3)}`;
        return c.look === "area" ? `${c.name}${range}` : `${c.name} ${digits(c.values[index])}${range && ` (${range.trim()})`}`;
      });
      this.readout.textContent = `${this.at(this.spec.x[index])}: ${said.join(", ")}${this.cellAt(u)}`;
    }

    show(x, y = null, linked = true) {
      this.view = { x: this.positive(x, this.log.x), y };
      const [min, max] = this.view.x;
      this.plot.batch(() => {
        this.plot.setScale("x", { min, max });
        const [least, most] = this.heights();
        this.plot.setScale("y", { min: least, max: most });
      });
      if (linked) dispatchEvent(new CustomEvent("plot-view", { detail: { link: this.spec.link, x: this.view.x } }));
      if (linked) for (const other of links.get(this.spec.link) ?? []) if (other !== this) other.show(x, null, false);
    }

    zoomTo(u) {
      const { left, width, top, height } = u.select;
      u.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
      const wide = width > 5 && width < u.over.clientWidth - 1, tall = height > 5 && height < u.over.clientHeight - 1;
      if (!wide && !tall) return;
      const x = wide ? [left, left + width].map((at) => u.posToVal(at, "x")) : this.view.x;
      this.show(x, tall ? [top + height, top].map((at) => u.posToVal(at, "y")) : null);
    }

    between([low, high], log, act) {
      const to = log ? Math.log : (v) => v, from = log ? Math.exp : (v) => v;
      return act(to(low), to(high)).map(from);
    }

    zoomBy(factor) {
      this.show(this.between(this.view.x, this.log.x, (low, high) => {
        const centre = 0.5 * (low + high), half = 0.5 * factor * (high - low);
        return [centre - half, centre + half];
      }).map((v, i) => (factor > 1 ? Math[i ? "min" : "max"](v, this.whole[i]) : v)));
    }

    panBy(share) { this.show(this.between(this.view.x, this.log.x, (low, high) => [low + share * (high - low), high + share * (high - low)]), this.view.y); }

    // The first reset goes back to the limits of the start, another one shows everything.
    reset() {
      this.show(this.zoomed() ? [...this.start] : [...this.whole]);
    }

    pan(u, event) {
      event.preventDefault();
      const from = [event.clientX, event.clientY], view = { x: this.view.x, y: this.view.y ?? this.heights() };
      const move = (now) => {
        const shift = [(from[0] - now.clientX) / u.over.clientWidth, (now.clientY - from[1]) / u.over.clientHeight];
        const moved = ["x", "y"].map((side, i) => this.between(view[side], this.log[side], (low, high) => [low, high].map((v) => v + shift[i] * (high - low))));
        this.show(...moved);
      };
      const end = () => { removeEventListener("mousemove", move); removeEventListener("mouseup", end); };
      addEventListener("mousemove", move);
      addEventListener("mouseup", end);
      return null;
    }

    key(event) {
      const act = { "+": () => this.zoomBy(0.5), "=": () => this.zoomBy(0.5), "-": () => this.zoomBy(2), 0: () => this.reset(), ArrowLeft: () => this.panBy(-0.2), ArrowRight: () => this.panBy(0.2) }[event.key];
      if (!act || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      act();
    }

    fileName(ending) { return `${this.spec.title.replace(/[^\p{L}\p{N}]+/gu, "_").slice(0, 60)}.${ending}`; }

    savePng() {
      const source = this.plot.ctx.canvas, ratio = uPlot.pxRatio, canvas = document.createElement("canvas");
      canvas.width = source.width;
      canvas.height = source.height + 44 * ratio;
      const ctx = canvas.getContext("2d");
      ctx.fillStyle = colour("page");
      ctx.fillRect(0, 0, canvas.width, canvas.height);
      ctx.fillStyle = colour("ink");
      ctx.font = `600 ${14 * ratio}px system-ui, sans-serif`;
      ctx.fillText(this.spec.title, 12 * ratio, 18 * ratio);
      ctx.font = `${12 * ratio}px system-ui, sans-serif`;
      let left = 12 * ratio;
      for (const one of this.switches().filter(({ key }) => !this.hidden.has(key))) {
        ctx.fillStyle = colour(one.colour);
        ctx.fillRect(left, 32 * ratio, 14 * ratio, 3 * ratio);
        ctx.fillStyle = colour("ink");
        ctx.fillText(one.name, left + 19 * ratio, 37 * ratio);
        left += 34 * ratio + ctx.measureText(one.name).width;
      }
      ctx.drawImage(source, 0, 44 * ratio);
      canvas.toBlob((blob) => download(this.fileName("png"), "image/png", blob));
    }

    csv() {
      const { x, x_axis: axis, y_axis: y, curves, cells } = this.spec;
      if (cells) return this.cellRows(cells, axis);
      const chosen = curves.filter((_, i) => this.shown(i));
      const columns = chosen.flatMap((c) => [...(c.look === "area" ? [] : [[c.right ?? `${c.name}, ${y.label}`, c.values]]), ...(c.low ? [[`${c.name}, low`, c.low], [`${c.name}, high`, c.high]] : [])]);
      const rows = x.map((_, k) => k).filter((k) => x[k] >= this.view.x[0] && x[k] <= this.view.x[1]);
      const first = (k) => (axis.names.length ? this.at(x[k]) : axis.dates ? moment(x[k]) : x[k]);
      return [[axis.dates ? "time [UTC]" : axis.label, ...columns.map(([name]) => name)], ...rows.map((k) => [first(k), ...columns.map(([, values]) => values[k] ?? "")])]
        .map((row) => row.map(cell).join(",")).join("\n") + "\n";
    }

    cellRows(cells, axis) {
      const dated = axis.dates;
      const kept = cells.x.map((_, k) => k).filter((k) => cells.x[k] >= this.view.x[0] && cells.x[k] <= this.view.x[1]);
      return [[dated ? "time [UTC]" : axis.label, ...cells.y.map((at) => `${digits(at, 5)} Hz, log10 of ${cells.label}`)], ...kept.map((k) => [dated ? moment(cells.x[k]) : cells.x[k], ...cells.values[k].map((v) => v ?? "")])]
        .map((row) => row.map(cell).join(",")).join("\n") + "\n";
    }

    saveCsv() { download(this.fileName("csv"), "text/csv;charset=utf-8", this.csv()); }
  }

  const draw = (figure, spec) => new Figure(figure, spec);
  const drawAll = () => {
    for (const figure of document.querySelectorAll("figure.plot")) {
      const spec = JSON.parse(figure.querySelector("script").textContent);
      const folded = figure.closest("details:not([open])");
      if (folded) folded.addEventListener("toggle", () => { if (!figure.classList.contains("live")) draw(figure, spec); });
      else draw(figure, spec);
    }
  };
  if (document.readyState === "loading") addEventListener("DOMContentLoaded", drawAll);
  else drawAll();
  return { draw, colour, download, digits };
})();
