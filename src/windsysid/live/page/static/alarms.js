// Alarms and their acknowledgement.

import { acknowledge } from "/static/api.js";
import { badge, h } from "/static/dom.js";
import { pathOf } from "/static/overview.js";
import { KINDS, SEVERITIES, when } from "/static/words.js";

const WORST = Object.keys(SEVERITIES);

export function alarmsPage(alarms, role) {
  const waiting = alarms.filter((one) => one.ended === null && one.acknowledged === null).sort((a, b) => WORST.indexOf(a.severity) - WORST.indexOf(b.severity));
  const rest = alarms.filter((one) => !waiting.includes(one));
  return [
    h("h1", {}, "Alarms"),
    h("h2", {}, "To acknowledge"),
    waiting.length ? alarmList(waiting, role) : h("p", { class: "note good" }, "No alarm to acknowledge."),
    h("h2", {}, "Acknowledged or ended"),
    rest.length ? alarmList(rest, role) : h("p", { class: "quiet" }, "None so far."),
  ];
}

export const alarmList = (alarms, role, named = true) =>
  h("ul", { class: "alarms" }, alarms.map((one) => item(one, role, named)));

function item(one, role, named) {
  const asked = one.acknowledged === null && role === "operator";
  return h("li", { class: `is-${one.severity} ${one.ended === null ? "" : "over"}` },
    h("p", {}, badge(SEVERITIES[one.severity], one.severity), " ",
      named ? [h("a", { href: pathOf(one.turbine), id: `of-${one.key}` }, h("strong", {}, one.turbine)), " · "] : null,
      KINDS[one.kind], one.title ? ` · ${one.title}` : ""),
    h("p", {}, one.text),
    h("p", { class: "quiet" }, happened(one), ` Found ${when(one.opened)}. `,
      one.ended === null ? "Still open." : `Ended ${when(one.ended)}.`),
    one.acknowledged === null ? null
      : h("p", { class: "quiet" }, `Acknowledged by ${one.by}, ${when(one.acknowledged)}${one.remark ? `: “${one.remark}”` : "."}`),
    asked ? h("button", { id: `acknowledge-${one.key}`, onclick: () => openDialog(one) },
      "Acknowledge", h("span", { class: "unseen" }, ` ${one.title || one.kind} of ${one.turbine}`)) : null,
    one.acknowledged === null && role !== "operator" ? h("p", { class: "quiet" }, "Acknowledging requires the operator's token.") : null);
}

const happened = (one) =>
  one.earliest === one.latest ? `Since ${when(one.earliest)}.` : `Happened between ${when(one.earliest)} and ${when(one.latest)}.`;

let asked = null;
let after = () => {};

export function prepareDialog(done) {
  after = done;
  const dialog = document.getElementById("acknowledge");
  const [by, remark, failed] = ["by", "remark", "acknowledge-failed"].map((id) => document.getElementById(id));
  document.getElementById("acknowledge-cancel").addEventListener("click", () => dialog.close());
  dialog.querySelector("form").addEventListener("submit", async (event) => {
    event.preventDefault();
    try {
      await acknowledge(asked.key, by.value.trim(), remark.value.trim());
      localStorage.setItem("windsysid-name", by.value.trim());
      dialog.close();
      after();
    } catch (error) {
      failed.textContent = `Not acknowledged: ${error.message}.`;
      failed.hidden = false;
    }
  });
}

function openDialog(alarm) {
  asked = alarm;
  document.getElementById("acknowledge-title").textContent = `Acknowledge: ${alarm.turbine}${alarm.title ? `, ${alarm.title}` : ""}`;
  document.getElementById("acknowledge-text").textContent = alarm.text;
  document.getElementById("by").value = localStorage.getItem("windsysid-name") || "";
  document.getElementById("remark").value = "";
  document.getElementById("acknowledge-failed").hidden = true;
  document.getElementById("acknowledge").showModal();
}
