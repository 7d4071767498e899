// Panels that a reader arranges and folds; the browser keeps the order and the state.

import { h } from "/static/dom.js";

const KEY = "windsysid-panels";

function stored() {
  try {
    return { order: [], folded: {}, ...JSON.parse(localStorage.getItem(KEY) ?? "{}") };
  } catch {
    return { order: [], folded: {} }; // no storage, or not ours
  }
}

function store(changes) {
  try {
    localStorage.setItem(KEY, JSON.stringify({ ...stored(), ...changes }));
  } catch { /* no storage: the order lasts as long as the page */ }
}

export class Panels {
  constructor(container) { this.container = container; }

  // A panel that folds, with buttons that move it; `content` stands in it.
  add(id, name, open, content, onOpen) {
    const button = (by, sign, where) => h("button", { type: "button", title: `Move ${where}`, "aria-label": `Move ${name} ${where}`, onclick: (event) => this.move(panel, by, event.currentTarget) }, sign);
    const folded = stored().folded[id] ?? !open;
    const details = h("details", { class: "group", id, open: !folded }, h("summary", { id: `${id}-title` }, name), content);
    const panel = h("section", { class: "panel", "data-panel": id, "aria-label": name }, h("div", { class: "panel-tools" }, button(-1, "▲", "up"), button(1, "▼", "down")), details);
    details.addEventListener("toggle", () => {
      store({ folded: { ...stored().folded, [id]: !details.open } });
      onOpen();
    });
    this.container.append(panel);
    this.sort();
    return details;
  }

  all() { return [...this.container.querySelectorAll(":scope > .panel")]; }

  sort() {
    const { order } = stored();
    const place = (panel) => (order.includes(panel.dataset.panel) ? order.indexOf(panel.dataset.panel) : order.length);
    this.container.append(...this.all().sort((a, b) => place(a) - place(b)));
  }

  move(panel, by, button) {
    const panels = this.all(), from = panels.indexOf(panel), to = from + by;
    if (to < 0 || to >= panels.length) return;
    panels[to][by < 0 ? "before" : "after"](panel);
    const order = this.all().map((one) => one.dataset.panel);
    store({ order: [...order, ...stored().order.filter((id) => !order.includes(id))] });
    button.focus();
    panel.scrollIntoView({ block: "nearest" });
    document.getElementById("status").textContent = `${panel.getAttribute("aria-label")}: panel ${to + 1} of ${panels.length}`;
  }
}
