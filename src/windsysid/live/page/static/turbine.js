// One turbine: current estimates, spectra and history.

import { alarmList } from "/static/alarms.js";
import { ask, turbinePath } from "/static/api.js";
import { Chart, overTime, timeAxis } from "/static/charts.js";
import { badge, h, show, table } from "/static/dom.js";
import { Panels } from "/static/panels.js";
import { VERDICTS, change, digits, graded, percent, plural, rpm, span, unusable, usable, usableOf, when, withBand, zone } from "/static/words.js";

const HOUR = 3600e3;
const RANGES = [["6 h", 6 * HOUR], ["1 day", 24 * HOUR], ["7 days", 168 * HOUR], ["30 days", 720 * HOUR], ["all", null]];
const RPM = 30 / Math.PI;
const REST = 400; // ms after a zoom, before its range is read

export class TurbineView {
  constructor(main, name, role) {
    this.main = main;
    this.name = name;
    this.role = role;
    this.length = 168 * HOUR; // null: all
    this.chosen = false; // until then, at most the range of the data
    this.end = null; // null: the newest
    this.charts = new Map();
    this.head = h("div", {});
    this.known = h("div", {});
    this.rangeLine = h("div", {});
    this.groups = h("div", {});
    this.panels = new Panels(this.groups);
    this.channel = ""; // of the waterfall: the first
    this.spectrumBefore = null; // null: the newest
    this.overlay = ""; // name of a condition
    this.rest = h("div", {});
    this.built = false;
    this.texts = new Map();
    this.ended = new AbortController();
    const on = (event, act) => addEventListener(event, ({ detail }) => detail.link === "time" && act(detail.x), { signal: this.ended.signal });
    on("plot-view", ([from, to]) => {
      clearTimeout(this.zooming);
      this.zooming = setTimeout(() => this.go(1000 * (to - from), 1000 * to), REST);
    });
    on("plot-click", (x) => this.showSpectrum(1000 * x));
  }

  close() {
    this.ended.abort();
    clearTimeout(this.zooming);
    for (const chart of this.charts.values()) chart.close();
    this.closed = true;
  }

  async read(changes) {
    const ours = changes.all || changes.results.includes(this.name);
    this.page = await ask(turbinePath(this.name));
    if (ours || !this.built) await this.readHistory();
    if (this.closed) return;
    if (!this.built) {
      show(this.main, this.head, this.known, h("h2", { id: "history" }, "Spectra and history"), this.rangeLine, this.groups, this.rest);
      this.built = true;
      this.drawCharts();
    } else if (ours) this.drawCharts();
    this.put(this.head, this.headPart());
    this.put(this.known, this.knownPart());
    this.put(this.rangeLine, this.rangePart());
    this.put(this.rest, this.restPart());
  }

  // Replace a part of the page if it has changed.
  put(place, children) {
    const made = h("div", {}, children);
    if (this.texts.get(place) === made.innerHTML) return;
    this.texts.set(place, made.innerHTML);
    const open = [...place.querySelectorAll("details[open]")].map((one) => one.id);
    show(place, [...made.childNodes]);
    for (const id of open) if (id) document.getElementById(id)?.setAttribute("open", "");
  }

  get range() {
    const newest = this.page.summary.until ?? this.page.at;
    const end = this.end ?? newest;
    if (this.length === null) return [this.results?.windows[0] ?? end - 24 * HOUR, end];
    const first = this.results?.windows[0];
    if (!this.chosen && first !== undefined) return [Math.max(end - this.length, Math.min(first, end - HOUR)), end];
    return [end - this.length, end];
  }

  async readHistory() {
    const to = this.end ?? this.page.summary.until ?? this.page.at;
    const query = this.length === null ? "" : `?since=${Math.max(0, to - this.length)}&until=${to + 1}`;
    [this.levels, this.results, this.alarms] = await Promise.all([
      ask(turbinePath(this.name, `/levels${query}`)), ask(turbinePath(this.name, `/results${query}`)),
      ask(`/api/alarms?turbine=${encodeURIComponent(this.name)}`), this.readSpectrum(), this.readWaterfall(query),
    ]);
  }

  async readSpectrum() {
    const query = this.spectrumBefore === null ? "" : `?until=${this.spectrumBefore}`;
    this.spectrum = await ask(turbinePath(this.name, `/spectrum${query}`));
  }

  async readWaterfall(query) {
    this.waterfallQuery = query;
    const channel = this.channel && `${query ? "&" : "?"}channel=${encodeURIComponent(this.channel)}`;
    this.waterfall = await ask(turbinePath(this.name, `/waterfall${query}${channel}`));
  }

  async showSpectrum(before) {
    this.spectrumBefore = before;
    await this.readSpectrum();
    this.drawCharts();
  }

  async showChannel(channel) {
    this.channel = channel;
    await this.readWaterfall(this.waterfallQuery);
    this.drawCharts();
  }

  async go(length, end) {
    this.length = length;
    this.end = end;
    this.chosen = true;
    await this.readHistory();
    this.drawCharts();
    this.put(this.known, this.knownPart());
    this.put(this.rangeLine, this.rangePart());
  }

  headPart() {
    const { summary, newest, at, counts } = this.page;
    const bad = Object.keys(summary.grades).filter((name) => summary.grades[name] === "C");
    const facts = [
      ["Trusted", summary.trusted === null ? "no estimate yet" : summary.trusted ? "yes (newest estimate)" : bad.length ? `${usableOf(summary.grades)} (newest estimate)` : "no (newest estimate)"],
      ["Rotor", [summary.state, summary.rotor_speed === null ? "" : `, ${rpm(summary.rotor_speed)}`]],
      ["Newest estimate", summary.until === null ? "none yet" : [h("span", { class: "quiet" }, "window until "), when(summary.until)]],
      ["Newest block", summary.received === null ? "none yet" : `${span(at - summary.received)} ago`],
      ["Delay", summary.behind === null ? "not known" : `${span(1000 * summary.behind)}${summary.windows_waiting ? `, ${plural(summary.windows_waiting, "window")} in progress` : ""}`],
      ["Sensors", summary.faults.length ? `${plural(summary.faults.length, "channel")} with a fault` : summary.received === null ? "no data yet" : "no fault found"],
    ];
    const tone = { steady: "good", moved: "bad", sensor: "warn", silent: "warn" }[summary.verdict] ?? "";
    return [
      h("p", {}, h("a", { href: "#/", id: "to-all" }, "← All turbines")),
      h("h1", {}, this.name, " ", badge(VERDICTS[summary.verdict], summary.verdict)),
      h("p", { class: `note ${tone}` }, summary.answer),
      summary.reasons.length && !summary.answer.includes(summary.reasons[0]) ? h("p", { class: "note" }, `Not trusted: ${summary.reasons.join("; ")}.`) : null,
      bad.length ? h("p", { class: "note" }, `Do not use (grade C): ${bad.join(", ")}.`) : null,
      h("dl", { class: "facts" }, facts.map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value)))),
      summary.alarms.length ? [h("h2", {}, plural(summary.alarms.length, "open alarm")), alarmList(summary.alarms, this.role(), false)] : null,
      newest === null ? h("p", { class: "note" }, `No estimate yet: the first follows the end of the first window${this.page.window_length ? ` (${span(1000 * this.page.window_length)})` : ""}.${counts.samples ? ` ${plural(counts.samples, "sample")} received so far.` : ""}`) : null,
    ];
  }

  knownPart() {
    const { newest } = this.page;
    if (newest === null) return null;
    const watched = this.levels.series.map((series) => this.seriesRow(series));
    const modes = newest.modes.map((mode) => [
      mode.name,
      graded(withBand(mode.frequency, mode.frequency_low, mode.frequency_high, "Hz"), mode.frequency_grade),
      mode.damping_ratio === null ? "not known" : graded(withBand(100 * mode.damping_ratio, 100 * mode.damping_ratio_low, 100 * mode.damping_ratio_high, "%"), mode.damping_ratio_grade),
      mode.nearest === null ? "rotor speed not known" : `${mode.nearest}: the mode is ${percent(Math.abs(mode.distance))} ${mode.distance > 0 ? "above" : "below"}`,
    ]);
    return [
      h("h2", {}, "Current estimates"),
      watched.length ? table("95 % intervals. The level combines all windows with grade A or B and follows slow changes. The change is that within the range shown below, after the learning phase.",
        [["Coefficient"], ["Level", true], ["Newest window", true], ["Change", true], ["Test for a jump"]], watched, { stacked: true }) : null,
      modes.length ? h("h3", { class: "spaced" }, "Modes of the newest window") : null,
      modes.length ? table("95 % intervals. Excitation: 1P and multiples of the blade-passing frequency.",
        [["Mode"], ["Frequency", true], ["Damping ratio", true], ["Nearest excitation"]], modes, { stacked: true }) : null,
    ];
  }

  seriesRow(series) {
    const known = series.level.map((v, i) => i).filter((i) => series.level[i] !== null);
    const watched = known.find((i) => series.statistic[i] > 0); // before, the level is learned
    const own = series.estimate.findLastIndex((v) => v !== null);
    const [first, last] = [watched, known.at(-1)];
    const at = series.statistic.findLastIndex((v) => v !== null && v > 0); // 0 while it learns
    const share = at < 0 ? null : series.statistic[at] / series.limit[at];
    const meter = share === null ? null : h("meter", { min: "0", max: "1", value: String(Math.min(share, 1)), "aria-hidden": "true" });
    return [
      series.title,
      last === undefined ? "not known yet" : withBand(series.level[last], series.level_low[last], series.level_high[last], series.unit),
      own < 0 ? "not estimated" : graded(withBand(series.estimate[own], series.low[own], series.high[own], series.unit), series.grade[own]),
      first === undefined || first === last ? "–" : this.changeOf(series, first, last),
      share === null ? "learning" : [meter, ` ${share >= 1 ? "above its limit" : `at ${Math.round(100 * share)} % of its limit`}`],
    ];
  }

  changeOf(series, first, last) {
    const by = (series.level[last] - series.level[first]) / series.level[first];
    const half = Math.hypot(series.level_high[last] - series.level_low[last], series.level_high[first] - series.level_low[first]) / 2;
    return change(by, half / Math.abs(series.level[first]));
  }

  rangePart() {
    const [from, to] = this.range;
    const width = to - from;
    const newest = this.page.summary.until ?? this.page.at;
    const button = (id, text, act, { pressed, off } = {}) =>
      h("button", { type: "button", id: `range-${id}`, "aria-pressed": pressed === undefined ? null : String(pressed), disabled: off, onclick: act }, text);
    const move = (by) => {
      const end = Math.min(newest, to + by * width);
      return this.go(width, end >= newest ? null : end);
    };
    const zoom = (by) => this.go(width * by, by < 1 && this.end === null ? null : Math.min(newest, (from + to + width * by) / 2) >= newest ? null : (from + to + width * by) / 2);
    return [
      h("div", { class: "ranges", role: "group", "aria-label": "Range of the charts" },
        RANGES.map(([text, length], i) => button(i, text, () => this.go(length, null), { pressed: this.length === length && this.end === null })),
        button("earlier", "◀ earlier", () => move(-0.5), { off: this.length === null || (!this.results.windows.length && this.end !== null) }),
        button("later", "later ▶", () => move(0.5), { off: this.end === null }),
        button("in", "zoom in", () => zoom(0.5), { off: width <= HOUR }),
        button("out", "zoom out", () => zoom(2))),
      this.overlayChoice(),
      h("p", { class: "quiet shown", "aria-live": "polite" }, `${when(from)} to ${when(to)}. Times are in ${zone()}. Drag over a chart to zoom; click in it for the spectrum of that time.`),
    ];
  }

  overlayChoice() {
    const known = this.results.conditions.filter((one) => one.mean.some((v) => v !== null));
    if (!known.length) return null;
    const change = (event) => {
      this.overlay = event.target.value;
      this.drawCharts();
    };
    return h("p", { class: "choice" }, h("label", { for: "overlay" }, "Overlay on the charts"),
      h("select", { id: "overlay", onchange: change }, [["", "none"], ...known.map((one) => [one.name, one.title])].map(([value, text]) => h("option", { value, selected: value === this.overlay }, text))));
  }

  // The chosen condition at windows [ms], in the units of engineers.
  overlayAt(windows) {
    const one = this.results.conditions.find(({ name }) => name === this.overlay);
    if (!one) return null;
    const [factor, unit] = { "rad/s": [RPM, "rpm"], rad: [180 / Math.PI, "deg"] }[one.unit] ?? [1, one.unit];
    let at = 0;
    const values = windows.map((window) => {
      while (at + 1 < this.results.windows.length && this.results.windows[at + 1] <= window) at += 1;
      const value = Math.abs(this.results.windows[at] - window) <= HOUR ? one.mean[at] : null;
      return value === null ? null : factor * value;
    });
    return { name: one.title, unit, values };
  }

  drawCharts() {
    if (!this.built || this.closed) return;
    const over = (charts) => charts.map((shown) => overTime({ ...shown, range: this.range, overlay: this.overlayAt(shown.windows) }));
    const groups = [
      ["spectrum", "Spectrum and model", this.spectrumCharts(), true],
      ["waterfall", "Spectrum over time", this.waterfallCharts(), true],
      ["stiffness-and-damping", "Stiffness and damping", over(this.coefficientCharts()), true],
      ["frequencies", "Frequencies and damping ratios", over(this.modeCharts()), true],
      ["rotor", "Rotor speed and excitation", over(this.rotorCharts()), true],
      ["loads", "Loads", over(this.loadCharts()), false],
      ["noise", "Sensor noise", over(this.noiseCharts()), false],
    ].filter(([, , charts]) => charts.length);
    for (const [id, name, charts, open] of groups) {
      let group = document.getElementById(id);
      if (!group || !this.groups.contains(group)) {
        const content = [h("div", { class: "controls" }), h("div", { class: "charts" })];
        group = this.panels.add(id, name, open, content, () => this.fillGroup(id));
      }
      group.charts = charts;
      this.put(group.querySelector(".controls"), { spectrum: () => this.spectrumControls(), waterfall: () => this.waterfallControls() }[id]?.() ?? []);
      this.fillGroup(id);
    }
    if (!groups.length) show(this.groups, h("p", { class: "note" }, "No history yet: charts begin with the first estimate."));
    else this.groups.querySelector(":scope > p")?.remove();
  }

  fillGroup(id) {
    const group = document.getElementById(id);
    if (!group?.open) return;
    group.charts.forEach((spec, i) => {
      const at = `${id}-${i}`;
      if (!this.charts.has(at)) {
        const chart = new Chart(at);
        this.charts.set(at, chart);
        group.querySelector(".charts").append(chart.element);
      }
      this.charts.get(at).update(spec);
    });
  }

  spectrumCharts() {
    const { window, plots } = this.spectrum;
    return plots.map((plot) => ({ ...plot, about: `Window from ${when(window)}${plot.caption ? `, ${plot.caption}` : ""}`, words: `${plot.title}: measured spectrum and model, ${plot.y_axis.label}, over frequency. The table below has the values.` }));
  }

  spectrumControls() {
    const { windows } = this.waterfall;
    const later = windows.find((window) => window > this.spectrum.window);
    const button = (id, text, act, off) => h("button", { type: "button", id: `spectrum-${id}`, disabled: off, onclick: act }, text);
    return h("div", { class: "ranges", role: "group", "aria-label": "Window of the spectrum" },
      button("earlier", "◀ earlier", () => this.showSpectrum(this.spectrum.window), windows.length > 0 && this.spectrum.window <= windows[0]),
      button("later", "later ▶", () => this.showSpectrum(later + 1), later === undefined),
      button("newest", "newest", () => this.showSpectrum(null), this.spectrumBefore === null));
  }

  waterfallCharts() {
    const { channel, windows, frequencies, density, unit, modes } = this.waterfall;
    if (windows.length < 2) return [];
    const steps = windows.slice(1).map((at, i) => at - windows[i]).sort((a, b) => a - b);
    const known = density.flat().filter((v) => v !== null).sort((a, b) => a - b);
    const [low, high] = [0.02, 0.998].map((share) => known[Math.floor(share * (known.length - 1))]);
    const top = this.spectrum.plots.find((plot) => plot.title === channel)?.x_axis.limits?.[1] ?? frequencies.at(-1);
    const label = unit.replace(/^PSD \[(.*)\]$/, "$1");
    return [{
      title: channel,
      about: ["Measured spectrum of the last window of each hour, with the modes. ", h("span", { class: "shades", "aria-hidden": "true" }), ` ${digits(10 ** low, 2)} to ${digits(10 ** high, 2)} ${label}`],
      words: `${channel}: measured spectrum over time, frequency [Hz] over time, with the frequencies of ${Object.keys(modes).join(", ")}. The table below has the frequencies, the CSV file the spectra.`,
      x: windows.map((ms) => ms / 1000), x_axis: timeAxis(this.range), y_axis: { label: "frequency [Hz]", log: false, names: [], limits: [0, top] },
      curves: Object.entries(modes).map(([name, values], i) => ({ name, look: "dots", colour: ["error", "other"][i % 2], dashed: false, values })),
      cells: { x: windows.map((ms) => ms / 1000), width: steps[steps.length >> 1] / 1000, y: frequencies, values: density, label, low, high },
      marks: [], spans: [], link: "time",
    }];
  }

  waterfallControls() {
    const { channels, channel } = this.waterfall;
    return h("p", { class: "choice" }, h("label", { for: "channel" }, "Channel"),
      h("select", { id: "channel", onchange: (event) => this.showChannel(event.target.value) }, channels.map((name) => h("option", { value: name, selected: name === channel }, name))));
  }

  marksOf(name) {
    return this.alarms.filter((one) => one.kind === "structure" && one.about === name).map((one) => ({ from: one.earliest, to: one.latest, text: one.text }));
  }

  seriesCharts(wanted) {
    return this.levels.series.filter(wanted).map((series) => ({
      title: capital(series.title), unit: series.unit, windows: this.levels.windows, marks: this.marksOf(series.name),
      points: pointsOf(series.estimate, series.low, series.high, series.grade),
      lines: [{ name: "level", values: series.level, low: series.level_low, high: series.level_high }],
    }));
  }

  coefficientCharts() {
    return this.seriesCharts((series) => series.kind !== "noise");
  }

  noiseCharts() {
    return this.seriesCharts((series) => series.kind === "noise");
  }

  modeCharts() {
    const { windows, modes } = this.results;
    const times100 = (values) => values.map((v) => (v === null ? null : 100 * v));
    return modes.flatMap((mode) => [
      { title: `Frequency, ${mode.name}`, unit: "Hz", windows, points: pointsOf(mode.frequency, mode.frequency_low, mode.frequency_high, mode.frequency_grade) },
      {
        title: `Damping ratio, ${mode.name}`, unit: "%", windows,
        points: pointsOf(times100(mode.damping_ratio), times100(mode.damping_ratio_low), times100(mode.damping_ratio_high), mode.damping_ratio_grade),
      },
    ]);
  }

  rotorCharts() {
    const { windows, modes, rotor_speed: speed, blades } = this.results;
    if (speed.every((v) => v === null)) return [];
    const charts = [{ title: "Rotor speed", unit: "rpm", factor: 1, windows, points: [{ name: "window", values: speed.map((v) => (v === null ? null : v * RPM)) }] }];
    if (blades && modes.length) {
      const most = 1.6 * Math.max(...modes.flatMap((mode) => mode.frequency));
      const orders = [1, ...[1, 2, 3, 4].map((k) => k * blades)];
      const lines = orders.map((n) => ({ name: `${n}P`, dashed: true, colour: "rule-strong", values: speed.map((v) => (v === null ? null : (n * v) / (2 * Math.PI))) }))
        .filter((line) => Math.min(...line.values.filter((v) => v !== null)) < most);
      charts.push({
        title: "Modes and rotor harmonics", unit: "Hz", windows, lines,
        about: "Dashed: rotor harmonics. Where one crosses a mode, the rotor excites it at resonance.",
        points: modes.map((mode) => ({ name: mode.name, values: usable(mode.frequency, mode.frequency_grade) })),
      });
    }
    return charts;
  }

  loadCharts() {
    const { windows, loads } = this.results;
    return loads.map((one) => ({ title: capital(one.title), unit: one.unit, windows, logarithmic: true, points: [{ name: "window", values: one.estimate, low: one.low, high: one.high }] }));
  }

  restPart() {
    const { channels, newest, counts, configurations } = this.page;
    return [
      h("h2", {}, "Sensors"),
      this.sensorTable(channels, newest?.channels ?? []),
      newest?.budget.length ? [h("h2", {}, "Sources of uncertainty"),
        table("Newest window: share by which the variance would fall if the source were known exactly.",
          [["Coefficient"], ["Estimate", true], ["Loads and noise", true], ["Instruments and masses", true], ["Rest: window length, prior", true], ["Informed by the data", true]],
          newest.budget.map((one) => [one.title, graded(withBand(one.estimate, one.low, one.high, one.unit), one.grade), percent(one.loads), percent(one.instruments), percent(one.rest), percent(one.informed)]), { stacked: true })] : null,
      newest ? this.windowPart(newest) : null,
      h("details", { id: "stream" }, h("summary", { id: "stream-title" }, "Stream since its first block"),
        table("Counts.", [["Quantity"], ["Count", true]], Object.entries(counts).map(([name, count]) => [name, count.toLocaleString("en").replaceAll(",", "\u202f")])),
        configurations.length ? table("Settings.", [["Since"], ["Settings"]], configurations.map((one) => [when(one.at), one.settings]), { stacked: true }) : null),
    ];
  }

  sensorTable(channels, statistics) {
    const names = [...new Set([...channels, ...statistics].map((one) => one.channel))];
    if (!names.length) return h("p", { class: "quiet" }, "No data of the channels yet.");
    const rows = names.map((name) => {
      const health = channels.find((one) => one.channel === name);
      const said = statistics.find((one) => one.channel === name);
      const good = !health || health.state === "good";
      return [
        name, good ? badge(["●", "no fault"], "steady") : badge(["◆", health.state], "sensor"),
        health ? when(health.since) : "the first block",
        said && said.mean !== null ? `${digits(said.mean)} ± ${digits(said.std, 2)} ${said.unit === "1" ? "" : said.unit}` : "–",
        said ? percent(said.missing) : "–", good ? "–" : health.text,
      ];
    });
    return table("State: from the newest samples. Mean, standard deviation and missing samples: newest window.",
      [["Channel"], ["State"], ["Since"], ["Mean ± std", true], ["Missing", true], ["Action"]], rows, { stacked: true });
  }

  windowPart(newest) {
    const lines = [
      newest.why, ...newest.reasons.map((text) => `Not trusted: ${text}`), ...newest.remarks, ...newest.notes,
      ...newest.health.map((one) => `${one.channel}: ${one.text}`),
    ].filter((text) => text);
    return h("details", { id: "window" }, h("summary", { id: "window-title" }, "Details of the newest window"),
      h("p", {}, `${when(newest.window)} to ${when(newest.until)}, ${digits(newest.samples ?? 0, 6)} samples at ${digits(newest.rate)} Hz, ${newest.formulation || "no estimate"}.`),
      h("ul", {}, lines.map((text) => h("li", {}, text))));
  }
}

// Windows with intervals; hollow and without intervals: those with grade C.
const pointsOf = (values, low, high, grades) => [
  { name: "window", colour: "measured", values: usable(values, grades), low: usable(low, grades), high: usable(high, grades) },
  ...(grades.includes("C") ? [{ name: "window of grade C", colour: "measured", hollow: true, values: unusable(values, grades) }] : []),
];

const capital = (text) => text.charAt(0).toUpperCase() + text.slice(1);
