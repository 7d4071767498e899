// Page of oma: shapes that move, drawn as SVG, and modes that are marked by hand and saved to a file.
(() => {
  "use strict";
  const NS = "http://www.w3.org/2000/svg";
  const SIZE = 360, MARGIN = 50, PERIOD = 1600; // pixels, and milliseconds of a cycle

  const project = ([x, y, z], turn) => {
    const a = (turn * Math.PI) / 180, across = x * Math.cos(a) + y * Math.sin(a), away = y * Math.cos(a) - x * Math.sin(a);
    return [across, 0.3 * away - z];
  };

  const animate = (figure) => {
    const spec = JSON.parse(figure.querySelector("script").textContent);
    const svg = figure.querySelector("svg"), choice = figure.querySelector("select");
    const turn = figure.querySelector("input"), button = figure.querySelector("button");
    let playing = !matchMedia("(prefers-reduced-motion: reduce)").matches, phase = 0, before = null;

    const place = (point, at) => {
      const shape = spec.modes[choice.selectedIndex].motion[point];
      const follow = (k) => shape[k][0] * Math.cos(at) - shape[k][1] * Math.sin(at);
      return spec.points[point].map((v, k) => v + 0.2 * spec.span * follow(k));
    };

    const draw = () => {
      const angle = Number(turn.value), rest = spec.points.map((p) => project(p, angle));
      const [left, top] = [0, 1].map((k) => Math.min(...rest.map((p) => p[k])));
      const wide = Math.max(...[0, 1].map((k) => Math.max(...rest.map((p) => p[k])) - Math.min(...rest.map((p) => p[k]))), 1e-9);
      const onPage = (p) => p.map((v, k) => MARGIN + ((v - [left, top][k]) * (SIZE - 2 * MARGIN)) / wide);
      const still = rest.map(onPage), moved = spec.points.map((_, i) => onPage(project(place(i, phase), angle)));
      const line = (points, [i, j], name) => `<line class="${name}" x1="${points[i][0]}" y1="${points[i][1]}" x2="${points[j][0]}" y2="${points[j][1]}"/>`;
      svg.innerHTML = spec.lines.map((one) => line(still, one, "still") + line(moved, one, "moved")).join("")
        + moved.map((p, i) => `<line class="way" x1="${still[i][0]}" y1="${still[i][1]}" x2="${p[0]}" y2="${p[1]}"/><circle class="${spec.measured[i] ? "read" : "other"}" cx="${p[0]}" cy="${p[1]}" r="4"/>`).join("");
    };

    const step = (now) => {
      if (!playing) return;
      if (before !== null) phase += (2 * Math.PI * (now - before)) / PERIOD;
      before = now;
      draw();
      requestAnimationFrame(step);
    };
    const show = () => { button.textContent = playing ? "Pause" : "Play"; before = null; if (playing) requestAnimationFrame(step); else draw(); };
    button.addEventListener("click", () => { playing = !playing; show(); });
    choice.addEventListener("change", draw);
    turn.addEventListener("input", draw);
    svg.setAttribute("viewBox", `0 0 ${SIZE} ${SIZE}`);
    svg.setAttribute("xmlns", NS);
    figure.classList.add("live");
    show();
  };

  const marks = (form) => {
    const list = form.querySelector("ol"), [low, high] = form.querySelectorAll("input[type=number]"), said = form.querySelector("output");
    const added = [];
    const show = () => {
      list.replaceChildren(...added.map(([a, b], i) => {
        const item = document.createElement("li"), button = document.createElement("button");
        button.type = "button";
        button.textContent = "remove";
        button.setAttribute("aria-label", `Remove the range from ${a} to ${b} Hz`);
        button.addEventListener("click", () => { added.splice(i, 1); show(); });
        item.append(`${a} to ${b} Hz `, button);
        return item;
      }));
    };
    form.querySelector("button.add").addEventListener("click", () => {
      const range = [Number(low.value), Number(high.value)];
      if (low.value === "" || high.value === "" || !(range[0] >= 0 && range[1] > range[0])) { said.textContent = "Give two rising frequencies."; return; }
      said.textContent = "";
      added.push(range);
      low.value = high.value = "";
      show();
    });
    // A click in the picture gives the lower end, the next one the higher.
    addEventListener("plot-click", (event) => {
      if (event.detail.link !== "frequency") return;
      const value = Number(event.detail.x.toPrecision(5));
      if (low.value === "" || high.value !== "" || value <= Number(low.value)) { low.value = value; high.value = ""; } else high.value = value;
    });
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const removed = [...form.querySelectorAll("input[type=checkbox]:checked")].map((box) => box.value);
      const text = `# ${form.dataset.record}: modes added and removed by hand; windsysid oma RECORD --modes modes.toml\n`
        + `add = [${added.map(([a, b]) => `[${a}, ${b}]`).join(", ")}]\nremove = [${removed.join(", ")}]\n`;
      plots.download("modes.toml", "application/toml", text);
      said.textContent = `Saved modes.toml: ${added.length} added, ${removed.length} removed.`;
    });
    show();
  };

  const begin = () => {
    document.querySelectorAll("figure.moving").forEach(animate);
    document.querySelectorAll("form.marks").forEach(marks);
  };
  if (document.readyState === "loading") addEventListener("DOMContentLoaded", begin);
  else begin();
})();
