// All turbines, worst first.

import { badge, h, table } from "/static/dom.js";
import { VERDICTS, plural, rpm, span, usableOf, when } from "/static/words.js";

export const pathOf = (name) => `#/turbine/${encodeURIComponent(name)}`;

const COMPILING = "Equations are being compiled: this takes seconds if this machine has compiled them before, otherwise minutes. Estimates are delayed, samples are stored.";

const TROUBLES = {
  failed: ["bad", "A source failed and will be restarted within a minute"],
  trying: ["warn", "A source cannot be reached; the service keeps trying"],
  ended: ["", "A source has ended; its estimates remain"],
};

export function overviewPage(overview) {
  const { turbines } = overview;
  const sources = [
    overview.store ? h("p", { class: "note bad", role: "alert" }, `The store accepts no blocks: ${overview.store}. New blocks wait.`) : null,
    ...overview.sources.filter((one) => one.state in TROUBLES).map(trouble),
    ...overview.sources.filter((one) => one.refused).map(refusals),
  ];
  if (!turbines.length) {
    return [h("h1", {}, "Turbines"), sources, overview.service?.compiling ? h("p", { class: "note", role: "status" }, COMPILING) : null, h("p", { class: "note" },
      "No turbine has sent data yet. A turbine is listed after its first block of samples; its first estimate follows the end of its first window.")];
  }
  const counts = Object.entries(VERDICTS)
    .map(([verdict, said]) => [verdict, said, turbines.filter((one) => one.verdict === verdict).length])
    .filter(([, , count]) => count);
  const steady = turbines.every((one) => one.verdict === "steady");
  const columns = [
    ["Turbine"], ["Verdict"], ["Rotor"], ["Newest estimate"], ["Sensors"], ["Newest block"],
  ];
  return [
    h("h1", {}, steady ? `${plural(turbines.length, "turbine")}, unchanged` : plural(turbines.length, "turbine")),
    sources,
    overview.service?.compiling ? h("p", { class: "note", role: "status" }, COMPILING) : null,
    overview.note ? h("p", { class: "note" }, overview.note) : null,
    h("ul", { class: "summary", "aria-label": "Number of turbines by verdict" },
      counts.map(([verdict, [shape, word], count]) => h("li", {}, badge([shape, `${count} ${word}`], verdict)))),
    table("Current state, worst first. The page of a turbine has its history.", columns,
      turbines.map((one) => row(one, overview.at)), { stacked: true, kind: "turbines" }),
  ];
}

function trouble(source) {
  const [tone, what] = TROUBLES[source.state];
  const why = source.text ? `: ${source.text}` : "";
  return h("p", { class: `note ${tone}`, role: "status" }, `${what}. ${source.name}${why}`);
}

function refusals(source) {
  return h("p", { class: "note warn", role: "status" }, `${plural(source.refused, "block")} refused, the last: ${source.refusal}. ${source.name}`);
}

function row(one, now) {
  return [
    [h("a", { class: "name", href: pathOf(one.name), id: `turbine-${one.name}` }, one.name), " ", badge(VERDICTS[one.verdict], one.verdict)],
    h("div", { class: "answer" }, one.answer, moreAlarms(one)),
    [h("div", {}, one.state), one.rotor_speed === null ? null : h("div", { class: "quiet nowrap" }, rpm(one.rotor_speed))],
    estimate(one),
    one.faults.length
      ? one.faults.map((fault) => h("div", {}, "◆\u00a0", fault.channel, ": ", fault.state))
      : one.received === null ? "no data yet" : "no fault",
    stream(one, now),
  ];
}

function moreAlarms(one) {
  const waiting = one.alarms.filter((alarm) => alarm.acknowledged === null).length;
  if (!one.alarms.length) return null;
  const text = waiting ? `${plural(waiting, "alarm")} to acknowledge` : "acknowledged";
  return h("div", { class: "quiet" }, text);
}

function estimate(one) {
  if (one.until === null) return "none yet";
  const trust = one.trusted ? "trusted" : Object.keys(one.grades).length ? `${usableOf(one.grades)} usable` : "no estimate";
  return [h("div", {}, trust), h("div", { class: "quiet nowrap" }, when(one.until))];
}

function stream(one, now) {
  if (one.received === null) return "no data yet";
  const parts = [h("div", {}, `${span(now - one.received)} ago`)];
  if (one.behind !== null && one.behind >= 1) parts.push(h("div", { class: "quiet" }, `${span(1000 * one.behind)} delay`));
  if (one.windows_waiting > 1) parts.push(h("div", { class: "quiet" }, `${one.windows_waiting} windows waiting`));
  return parts;
}
