/* Legends: what each line is, whether it is shown, and its value under the cursor. */

function sample(paths) { return `<svg viewBox="0 0 20 10" aria-hidden="true">${paths}</svg>`; }

function stroke(trace) { return `<path class="trace ${trace.style}" style="stroke:var(--${trace.role})" d="M0 5H20"/>`; }

function told(list, paths, text) {
  const item = document.createElement("li");
  item.className = "static";
  item.innerHTML = sample(paths);
  item.append(text);
  list.append(item);
}

function legend(plot) {
  const list = plot.figure.querySelector(".legend");
  for (const trace of plot.traces) {
    if (trace.reference_of) continue;
    trace.reference = plot.traces.find((t) => t.reference_of === trace.label);
    const item = document.createElement("li"), button = document.createElement("button");
    button.type = "button";
    button.setAttribute("aria-pressed", "true");
    button.innerHTML = sample((trace.reference ? stroke(trace.reference) : "") + stroke(trace));
    button.append(trace.label);
    trace.reading = document.createElement("output");
    if (trace.reference) trace.reading.className = "pair";
    button.append(trace.reading);
    trace.button = button;
    button.addEventListener("click", () => toggle(plot, trace));
    item.append(button);
    list.append(item);
  }
  if (plot.traces.some((t) => t.reference_of)) told(list, "", "wide and pale: the reference, (in brackets)");
  for (const band of distinct(plot.bands, (b) => b.text)) {
    const kind = judged(band), missed = kind === "bad" ? ", missed" : "";
    told(list, `<path class="band ${kind}" d="M0 .5H20V9.5H0Z"/><path class="edge ${kind}" d="M0 .5H20M0 9.5H20"/>`, band.text + missed);
  }
  for (const level of distinct(plot.levels, (b) => b.text)) told(list, `<path class="level ${level.kind}" d="M0 5H20"/>`, level.text);
  for (const each of distinct(plot.moments, (b) => b.text)) told(list, `<path class="upright ${each.kind}" d="M10 0V10"/>`, each.text);
}

const distinct = (list, key) => list.filter((a, i) => list.findIndex((b) => key(a) === key(b)) === i);

function toggle(plot, trace) {
  const shown = !trace.shown;
  for (const each of run.linked && !trace.own ? plots : [plot]) {
    for (const t of each.traces.filter((t) => (each === plot ? t === trace : t.label === trace.label))) {
      t.shown = shown;
      if (t.reference) t.reference.shown = shown;
      t.button?.setAttribute("aria-pressed", String(shown));
    }
    each.draw(view);
  }
}
