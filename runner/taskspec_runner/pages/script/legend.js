/* Legends: what each line is, whether it is shown, and its value under the cursor. */

function stroke(trace) { return `<path class="trace ${trace.style}" style="stroke:var(--${trace.role})" d="M0 5H24"/>`; }

function legend(plot) {
  const { list } = plot;
  for (const trace of plot.traces) {
    if (trace.reference_of) continue;
    trace.reference = plot.traces.find((t) => t.reference_of === trace.label);
    const item = document.createElement("li"), button = document.createElement("button");
    button.type = "button";
    button.title = "click: this line alone, or all again; with Shift: this line off or on";
    button.setAttribute("aria-pressed", "true");
    button.innerHTML = sample((trace.reference ? stroke(trace.reference) : "") + stroke(trace));
    button.append(trace.label);
    trace.reading = document.createElement("output");
    if (trace.reference) trace.reading.className = "pair";
    button.append(trace.reading);
    trace.button = button;
    button.addEventListener("click", (event) => (event.shiftKey || event.ctrlKey || event.metaKey ? toggle : isolate)(plot, trace));
    item.append(button);
    list.append(item);
  }
  if (plot.traces.some((t) => t.reference_of)) entry(list, "", "wide and pale: the reference, (in brackets)");
  const [low, high] = plot.range(), within = (v) => v !== null && plot.upright(v) >= low && plot.upright(v) <= high;
  const about = (b) => b.low !== null && b.high !== null && plot.upright(b.low) < low && plot.upright(b.high) > high;
  for (const band of distinct(plot.bands.filter((b) => within(b.low) || within(b.high) || about(b)), (b) => b.text)) {
    const kind = judged(band), missed = kind === "bad" ? ", missed" : "";
    const drawn = kind === "bad" ? `<path class="band bad" d="M0 0H24V5H0Z"/><path class="edge bad" d="M0 5H24"/>`
      : `<path class="band ${kind}" d="M0 .5H24V9.5H0Z"/><path class="edge ${kind}" d="M0 .5H24M0 9.5H24"/>`;
    entry(list, drawn, band.text + missed);
  }
  for (const level of distinct(plot.levels.filter((b) => within(b.value)), (b) => b.text)) entry(list, `<path class="level ${level.kind} ${level.look}" d="M0 5H24"/>`, level.text);
  for (const each of distinct(run.events, (e) => e.kind)) entry(list, `<path class="upright ${each.kind}" d="M12 0V10"/>`, UPRIGHTS[each.kind]);
}

const UPRIGHTS = { event: "a stage ends", broken: "an expectation is broken", stop: "the run stops", fault: "a fault begins or ends" };

const distinct = (list, key) => list.filter((a, i) => list.findIndex((b) => key(a) === key(b)) === i);

/** The charts that a legend's click is about, and the traces of a chart that go by a name. */
const linked = (plot, trace) => (run.linked && !trace.shared ? charts : [plot]);
const shows = (plot, each, trace) => (each === plot && !run.linked ? (t) => t === trace : (t) => t.label === trace.label);

function turn(traces, shown) {
  for (const t of traces) {
    t.shown = shown;
    if (t.reference) t.reference.shown = shown;
    t.button?.setAttribute("aria-pressed", String(shown));
  }
}

function toggle(plot, trace) {
  const shown = !trace.shown;
  for (const each of linked(plot, trace)) turn(each.traces.filter(shows(plot, each, trace)), shown);
  redraw();
}

/** Shows one line alone; all of them if it is alone already. A reference that several lines share stays. */
function isolate(plot, trace) {
  const others = (each) => each.traces.filter((t) => !t.reference_of && !t.shared && !shows(plot, each, trace)(t));
  const alone = trace.shown && !others(plot).some((t) => t.shown);
  for (const each of linked(plot, trace)) {
    turn(others(each), alone);
    turn(each.traces.filter(shows(plot, each, trace)), true);
  }
  redraw();
}

function redraw() {
  drawAll();
  aim();
}
