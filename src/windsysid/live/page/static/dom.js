// DOM elements from text: answers are never parsed as HTML.

export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

// Replace the children of an element; the focus is restored by id.
export function show(container, ...children) {
  const focused = container.contains(document.activeElement) ? document.activeElement.id : "";
  container.replaceChildren(...children.flat(Infinity).filter((child) => child));
  if (focused) document.getElementById(focused)?.focus({ preventScroll: true });
}

export function badge([shape, word], kind) {
  return h("span", { class: `badge ${kind}` }, h("span", { "aria-hidden": "true" }, `${shape} `), word);
}

const label = (text) => (text.endsWith("?") ? text : `${text}:`);

// Explicit roles: browsers drop those of a table that a phone shows as cards.
// Columns: [heading, is number]; rows: lists of text or elements, the first a heading of its row.
export function table(caption, columns, rows, { stacked = false, kind = "" } = {}) {
  const cell = (content, i) =>
    i === 0
      ? h("th", { scope: "row", role: "rowheader" }, content)
      : h("td", { role: "cell", class: columns[i][1] ? "number" : null, "data-label": stacked ? label(columns[i][0]) : null }, content);
  const made = h("table", { role: "table", class: `${kind} ${stacked ? "stacked" : ""}` },
    h("caption", {}, caption),
    h("thead", { role: "rowgroup" }, h("tr", { role: "row" },
      columns.map(([text, number]) => h("th", { scope: "col", role: "columnheader", class: number ? "number" : null }, text)))),
    h("tbody", { role: "rowgroup" }, rows.map((row) => h("tr", { role: "row" }, row.map(cell)))));
  return h("div", { class: "scroll", tabindex: stacked ? null : "0", role: stacked ? null : "region", "aria-label": stacked ? null : caption }, made);
}
