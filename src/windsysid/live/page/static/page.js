// Selection and refresh of the pages.

import { alarmsPage, prepareDialog } from "/static/alarms.js";
import { ask, listen } from "/static/api.js";
import { h, show } from "/static/dom.js";
import { overviewPage } from "/static/overview.js";
import { TurbineView } from "/static/turbine.js";

const REST = 1000; // ms between two requests of the same data
const SLOW = 15000; // ms after which the overview is requested without an event

const main = document.getElementById("main");
let role = "reader";
let overview = null;
let view = null; // of a turbine
let announced = null; // keys of announced alarms
let shown = "";

function route() {
  const [page, name] = location.hash.replace(/^#\/?/, "").split("/");
  if (page === "turbine" && name) return { page, name: decodeURIComponent(name) };
  return { page: page === "alarms" ? "alarms" : "overview", name: "" };
}

async function open() {
  if (location.hash === "#main") {
    main.focus();
    return;
  }
  const { page, name } = route();
  view?.close();
  view = page === "turbine" ? new TurbineView(main, name, () => role) : null;
  for (const [id, current] of [["nav-turbines", page === "overview"], ["nav-alarms", page === "alarms"]]) {
    const link = document.getElementById(id);
    if (current) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  document.title = `${page === "turbine" ? name : page === "alarms" ? "Alarms" : "Turbines"} · windsysid live`;
  shown = "";
  await read({ all: true });
}

async function read(changes) {
  try {
    overview = await ask("/api/overview");
    role = overview.role;
    const { page } = route();
    if (view !== null) await view.read(changes);
    else if (page === "alarms") render(alarmsPage(await ask("/api/alarms"), role));
    else render(overviewPage(overview));
    around();
  } catch (error) {
    if (error.status === 401) logIn();
    else if (!(error instanceof TypeError)) show(main, h("h1", {}, "The page cannot be shown"), h("p", { class: "note bad", role: "alert" }, `${error.message}.`));
    throw error;
  }
}

// Leave an unchanged page as it is, so that a selection stays.
function render(children) {
  const made = h("div", {}, children);
  if (made.innerHTML === shown) return;
  shown = made.innerHTML;
  show(main, [...made.childNodes]);
}

function around() {
  const waiting = overview.turbines.flatMap((one) => one.alarms).filter((alarm) => alarm.acknowledged === null);
  const count = document.getElementById("alarm-count");
  count.hidden = !waiting.length;
  count.textContent = waiting.length;
  count.setAttribute("aria-label", `${waiting.length} to acknowledge`);
  const known = new Set(waiting.map((alarm) => alarm.key));
  const fresh = announced === null ? [] : waiting.filter((alarm) => !announced.has(alarm.key));
  announced = known;
  if (fresh.length) {
    document.getElementById("announcement").textContent = fresh.map((alarm) => `New ${alarm.severity} of ${alarm.turbine}: ${alarm.text}.`).join(" ");
  }
  document.getElementById("logout").hidden = !overview.login;
  const service = overview.service;
  const pace = service?.blocks_per_second ? ` · ${service.blocks_per_second.toFixed(1)} blocks a second` : "";
  document.getElementById("version").textContent = `windsysid ${overview.version} · ${role}${pace}`;
}

function logIn() {
  main.hidden = true;
  document.getElementById("login").hidden = false;
  document.getElementById("login-failed").hidden = location.hash !== "#login-failed";
  document.getElementById("connection").textContent = "not logged in";
  document.getElementById("token").focus();
}

// Combine the changes that arrive during a request.
let pending = null;
let busy = false;

async function changed(changes) {
  pending = pending === null ? changes : {
    turbines: [...pending.turbines, ...changes.turbines], results: [...pending.results, ...changes.results],
    alarms: [...pending.alarms, ...changes.alarms], all: pending.all || changes.all,
  };
  if (busy) return;
  busy = true;
  while (pending !== null) {
    const now = pending;
    pending = null;
    await read(now).catch(() => {});
    await new Promise((resolve) => setTimeout(resolve, REST));
  }
  busy = false;
}

// Failures of sources cause no event: request the overview regularly.
setInterval(() => {
  if (!main.hidden && !document.hidden && overview !== null && route().page === "overview") changed({ turbines: [], results: [], alarms: [], all: false });
}, SLOW);

function connected(is) {
  const line = document.getElementById("connection");
  line.textContent = is ? "live" : "no connection: trying again …";
  line.classList.toggle("lost", !is);
}

async function start() {
  prepareDialog(() => changed({ turbines: [], results: [], alarms: [], all: true }));
  window.addEventListener("hashchange", () => open().then(() => main.focus({ preventScroll: true }), () => {}));
  try {
    await open();
  } catch (error) {
    if (error.status === 401) return;
    connected(false);
    setTimeout(() => location.reload(), 5000);
    return;
  }
  listen(overview.event, changed, connected);
  setInterval(() => changed({ turbines: [], results: [], alarms: [], all: false }), 30000); // ages grow
}

start();
