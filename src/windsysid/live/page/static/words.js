// Numbers, times and verdicts as text.

export const VERDICTS = {
  moved: ["▲", "changed"], sensor: ["◆", "sensor fault"], silent: ["■", "no data"], unsure: ["?", "uncertain"],
  learning: ["…", "learning"], waiting: ["○", "waiting"], steady: ["●", "unchanged"],
};

export const SEVERITIES = { alarm: ["▲", "alarm"], warning: ["◆", "warning"], notice: ["●", "notice"] };

export const KINDS = { structure: "structure", sensor: "sensor", data: "data" };

const RPM = 30 / Math.PI;

export const rpm = (speed) => (speed === null ? "not known" : `${digits(speed * RPM)} rpm`);

export function digits(value, count = 4) {
  if (value === null || value === undefined) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(count - 2).replace("e+", "e").replace("-", "−");
  const places = Math.max(0, count - 1 - Math.floor(Math.log10(size)));
  return value.toFixed(Math.min(places, 8)).replace("-", "−");
}

// Prefix of a unit for readable values: 1 787 260 N/m is 1.787 MN/m.
export function scaled(unit, size) {
  if (!/^(N|W|Pa)/.test(unit) || !size) return { factor: 1, unit };
  const [factor, prefix] = size >= 1e9 ? [1e-9, "G"] : size >= 1e6 ? [1e-6, "M"] : size >= 1e3 ? [1e-3, "k"] : [1, ""];
  return { factor, unit: prefix + unit };
}

// A value with its interval, rounded to two digits of the interval.
export function withBand(value, low, high, unit) {
  if (value === null || value === undefined) return "not known";
  const by = scaled(unit, Math.abs(value));
  const half = ((high - low) / 2) * by.factor;
  const shown = unit === "1" ? "" : ` ${by.unit}`;
  if (!(half > 0)) return `${digits(value * by.factor)}${shown}`;
  const places = Math.min(8, Math.max(0, 1 - Math.floor(Math.log10(half))));
  const text = (value * by.factor).toFixed(places).replace("-", "−");
  return `${text} ± ${half.toFixed(places)}${shown}`;
}

// A value followed by its grade.
export const graded = (text, grade) => (grade ? `${text}, grade ${grade}` : text);

// Values without those of grade C, and those of grade C alone.
export const usable = (values, grades) => values.map((v, i) => (grades[i] === "C" ? null : v));
export const unusable = (values, grades) => values.map((v, i) => (grades[i] === "C" ? v : null));

// Count of usable values of an estimate: 5 of 8.
export function usableOf(grades) {
  const all = Object.values(grades).filter((grade) => grade);
  return `${all.filter((grade) => grade !== "C").length} of ${plural(all.length, "value")}`;
}

export const percent = (share, count = 2) => (share === null ? "–" : `${digits(100 * share, count)} %`);

// A signed change, rounded by its interval: 0.0312 ± 0.008 → +3.1 ± 0.8 %.
export function change(share, half) {
  const places = half > 0 ? Math.min(4, Math.max(0, -Math.floor(Math.log10(100 * half)))) : 2;
  const text = (100 * share).toFixed(places).replace("-", "−");
  return `${share > 0 ? "+" : ""}${text} ± ${(100 * half).toFixed(places)} %`;
}

const local = new Intl.DateTimeFormat("en-GB", { day: "numeric", month: "short", hour: "2-digit", minute: "2-digit" });
const localYear = new Intl.DateTimeFormat("en-GB", {
  day: "numeric", month: "short", year: "numeric", hour: "2-digit", minute: "2-digit",
});
const utc = new Intl.DateTimeFormat("en-GB", { timeZone: "UTC", hour: "2-digit", minute: "2-digit" });
const utcDay = new Intl.DateTimeFormat("en-GB", {
  timeZone: "UTC", day: "numeric", month: "short", hour: "2-digit", minute: "2-digit",
});

// Local time of the browser, followed by UTC if it differs.
export function when(ms) {
  if (ms === null || ms === undefined) return "not known";
  const at = new Date(ms);
  const here = (at.getFullYear() === new Date().getFullYear() ? local : localYear).format(at);
  if (at.getTimezoneOffset() === 0) return `${here} UTC`;
  const there = at.getUTCDate() === at.getDate() ? utc.format(at) : utcDay.format(at);
  return `${here} (${there} UTC)`;
}

export function span(ms) {
  const s = Math.max(0, ms / 1000);
  if (s < 90) return `${Math.round(s)} s`;
  if (s < 5400) return `${Math.round(s / 60)} min`;
  if (s < 172800) return `${Math.round(s / 3600)} h`;
  return `${Math.round(s / 86400)} days`;
}

export const zone = () => Intl.DateTimeFormat().resolvedOptions().timeZone || "local time";

export const plural = (count, one, many = `${one}s`) => `${count} ${count === 1 ? one : many}`;
