/* One window of time for all charts, chosen with mouse, finger, keys or buttons. */

let view = whole.slice(), mark = null;
const plots = [...document.querySelectorAll("[data-chart]")].map((figure) => new Plot(figure));
const clock = document.querySelector(".bar output");
const windows = [...document.querySelectorAll("[data-start]")];
const windowOf = (b) => (b.dataset.start === "" ? whole : [Number(b.dataset.start), Number(b.dataset.end)]);

function show(from, to) {
  const least = Math.min(5 * run.period, whole[1] - whole[0]);
  const width = Math.min(Math.max(to - from, least), whole[1] - whole[0]);
  const start = Math.min(Math.max((from + to - width) / 2, whole[0]), whole[1] - width);
  view = [start, start + width];
  for (const p of plots) p.draw(view);
  for (const b of windows) b.classList.toggle("on", windowOf(b).every((v, i) => Math.abs(v - view[i]) < 1e-9));
  point(mark);
}

/** Makes the window so many times as wide, about the cursor or its middle; moves it by a share of itself. */
function scale(factor, share = 0) {
  const width = view[1] - view[0], inside = mark !== null && mark >= view[0] && mark <= view[1];
  const about = inside ? mark : (view[0] + view[1]) / 2;
  show(about - (about - view[0]) * factor + share * width, about + (view[1] - about) * factor + share * width);
}

/** Puts the cursor of all charts at a time; null takes it away. */
function point(time) {
  mark = time;
  for (const p of plots) p.point(time);
  if (time === null) { clock.textContent = ""; return; }
  const stage = run.stages.find((s) => time >= s.start && time < s.end);
  const near = run.events.find((e) => Math.abs(e.at - time) < 0.004 * (view[1] - view[0]));
  const inStage = stage ? `${stage.name} + ${(time - stage.start).toFixed(3)} s` : "";
  clock.textContent = near ? near.text : [`${time.toFixed(3)} s`, inStage].filter(Boolean).join(", ");
}

/* ---- mouse and finger ---- */

let pressed = null;

function within(plot, event) {
  const box = plot.box.getBoundingClientRect();
  return plot.timeAt(Math.min(Math.max(event.clientX, box.left + LEFT), box.left + LEFT + plot.inner.width));
}

function listen(plot) {
  const { box } = plot;
  box.addEventListener("pointerdown", (event) => {
    const time = plot.timeAt(event.clientX);
    if (time === null || event.button) return;
    pressed = { plot, time, x: event.clientX };
    if (event.pointerType === "mouse") box.setPointerCapture(event.pointerId);
  });
  box.addEventListener("pointermove", (event) => {
    point(pressed ? within(plot, event) : plot.timeAt(event.clientX));
    if (pressed) for (const p of plots) p.choose(pressed.time, within(plot, event));
  });
  box.addEventListener("pointerup", (event) => {
    const from = pressed, to = within(plot, event);
    drop();
    if (from && Math.abs(event.clientX - from.x) > 5) show(...[from.time, to].sort((a, b) => a - b));
    else point(plot.timeAt(event.clientX));
  });
  // A finger that begins to scroll the page takes the pointer away.
  box.addEventListener("pointercancel", drop);
  box.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse" && !pressed) point(null); });
  box.addEventListener("dblclick", () => show(...whole));
  box.addEventListener("keydown", (event) => { if (!event.ctrlKey && !event.metaKey && typed(event)) event.preventDefault(); });
}

function drop() {
  pressed = null;
  for (const p of plots) p.choose(null);
}

/* ---- keys and buttons ---- */

function typed(event) {
  const width = view[1] - view[0], way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (way && event.shiftKey) scale(1, way / 4);
  else if (way) {
    const from = mark ?? (view[0] + view[1]) / 2;
    point(Math.min(Math.max(from + (way * width) / 200, view[0]), view[1]));
  } else if (event.key === "+" || event.key === "=") scale(0.5);
  else if (event.key === "-") scale(2);
  else if (event.key === "0" || event.key === "Escape") { show(...whole); point(null); }
  else return false;
  return true;
}

const ACTIONS = { "earlier": () => scale(1, -0.5), "later": () => scale(1, 0.5), "in": () => scale(0.5), "out": () => scale(2) };
for (const b of document.querySelectorAll("[data-zoom]")) b.addEventListener("click", ACTIONS[b.dataset.zoom]);
for (const b of windows) b.addEventListener("click", () => show(...windowOf(b)));

/* ---- the page around ---- */

/** Takes names away from pieces of the time line that have no room for them. */
function crowd() {
  for (const b of document.querySelectorAll(".timeline button")) {
    b.classList.toggle("crowded", b.firstElementChild.offsetWidth > b.clientWidth);
  }
}

function fit() { show(...view); crowd(); }

let wait = 0;
addEventListener("resize", () => { clearTimeout(wait); wait = setTimeout(fit, 80); });
const closed = [...document.querySelectorAll("details:not([open])")];
addEventListener("beforeprint", () => { for (const d of closed) d.open = true; fit(); });
addEventListener("afterprint", () => { for (const d of closed) d.open = false; fit(); });
matchMedia("print").addEventListener("change", fit);

for (const p of plots) { legend(p); listen(p); }
fit();
