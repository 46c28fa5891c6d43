/* One window of time for all charts, chosen with mouse, finger, keys or buttons. */

let view = whole.slice(), mark = null, pins = [];
/** What else shows the time of the cursor: each takes it [s], or null where there is none. */
const followers = [];
/** The cursor of the page, as `scene.js` takes it. */
const cursor = { whole, window: () => view, point: (time) => point(time), follow: (f) => followers.push((time) => time !== null && f(time)) };
for (const figure of document.querySelectorAll("[data-chart]")) new Plot(figure);
const clock = document.querySelector(".bar output");
const windows = [...document.querySelectorAll("[data-start]")];
const windowOf = (b) => (b.dataset.start === "" ? whole : [Number(b.dataset.start), Number(b.dataset.end)]);

function show(from, to) {
  const least = Math.min(5 * run.period, whole[1] - whole[0]);
  const width = Math.min(Math.max(to - from, least), whole[1] - whole[0]);
  const start = Math.min(Math.max((from + to - width) / 2, whole[0]), whole[1] - width);
  view = [start, start + width];
  drawAll();
  for (const b of windows) b.classList.toggle("on", windowOf(b).every((v, i) => Math.abs(v - view[i]) < 1e-9));
  aim();
}

/** Shows a window with all of its values. */
function open(from, to) {
  for (const p of charts) p.chosen = null;
  show(from, to);
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
  aim();
}

/** Sets a cursor, then a second one; a third time takes both away. */
function pin(time) {
  if (time === null) return;
  pins = pins.length < 2 ? [...pins, time] : [];
  aim();
}

/** Draws the cursors and says where they are. */
function aim() {
  for (const p of charts) p.point(mark, pins);
  const time = pins[1] ?? mark ?? pins[0] ?? null;
  for (const follow of followers) follow(mark ?? time);
  if (time === null) { clock.textContent = ""; return; }
  const stage = run.stages.find((s) => time >= s.start && time < s.end);
  const near = run.events.find((e) => Math.abs(e.at - time) < 0.004 * (view[1] - view[0]));
  const inStage = stage ? `${stage.name} + ${(time - stage.start).toFixed(3)} s` : "";
  const apart = pins.length && time !== pins[0] ? time - pins[0] : null;
  const since = apart === null ? "" : `Δt ${minus(apart.toFixed(3))} s, ${(1 / Math.abs(apart)).toPrecision(3)} Hz`;
  clock.textContent = near && !since ? near.text : [`${time.toFixed(3)} s`, since || inStage].filter(Boolean).join(", ");
}

/* ---- mouse and finger ---- */

let pressed = null;

function within(plot, event) {
  const box = plot.box.getBoundingClientRect();
  return plot.timeAt(Math.min(Math.max(event.clientX, box.left + LEFT), box.left + LEFT + plot.inner.width));
}

/** Whether a drag of the mouse chooses times, values, or both. */
function chosen(event) {
  const x = Math.abs(event.clientX - pressed.x), y = Math.abs(event.clientY - pressed.y);
  const mouse = event.pointerType === "mouse";
  return { times: x > 5 && !(mouse && y > 2 * x), values: mouse && y > 8 && y > x / 2 };
}

/** Shows in all charts what is being chosen. */
function trace(plot, event) {
  const { times, values } = chosen(event), rows = [pressed.value, plot.valueAtRow(event.clientY)];
  for (const p of charts) {
    if (times || (values && p === plot)) p.choose(times ? pressed.time : view[0], times ? within(plot, event) : view[1], values && p === plot ? rows : null);
    else p.choose(null);
  }
}

function listen(plot) {
  const { box } = plot;
  box.addEventListener("pointerdown", (event) => {
    const time = plot.timeAt(event.clientX);
    if (time === null || event.button) return;
    pressed = { plot, time, value: plot.valueAtRow(event.clientY), x: event.clientX, y: event.clientY };
    if (event.pointerType === "mouse") box.setPointerCapture(event.pointerId);
  });
  box.addEventListener("pointermove", (event) => {
    point(pressed ? within(plot, event) : plot.timeAt(event.clientX));
    if (pressed) trace(plot, event);
  });
  box.addEventListener("pointerup", (event) => {
    const from = pressed, to = within(plot, event), choice = from ? chosen(event) : {};
    const value = from ? [from.value, plot.valueAtRow(event.clientY)].sort((a, b) => a - b) : null;
    drop();
    if (choice.values) plot.stretch(value);
    if (choice.times) show(...[from.time, to].sort((a, b) => a - b));
    else if (choice.values) aim();
    else if (from) pin(plot.timeAt(event.clientX));
  });
  // A finger that begins to scroll the page takes the pointer away.
  box.addEventListener("pointercancel", drop);
  box.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse" && !pressed) point(null); });
  box.addEventListener("dblclick", () => { pins = []; open(...whole); });
  box.addEventListener("keydown", (event) => { if (!event.ctrlKey && !event.metaKey && typed(event, plot)) event.preventDefault(); });
}

function drop() {
  pressed = null;
  for (const p of charts) p.choose(null);
}

/* ---- keys and buttons ---- */

function typed(event, plot) {
  const width = view[1] - view[0], way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (way && event.shiftKey) scale(1, way / 4);
  else if (way) {
    const from = mark ?? (view[0] + view[1]) / 2;
    point(Math.min(Math.max(from + (way * width) / 200, view[0]), view[1]));
  } else if (event.key === "+" || event.key === "=") scale(0.5);
  else if (event.key === "-") scale(2);
  else if (event.key === "ArrowUp" || event.key === "ArrowDown") {
    const [low, high] = plot.y, room = ((high - low) / 4) * (event.key === "ArrowUp" ? 1 : -2);
    plot.stretch([low + room, high - room]);
    aim();
  } else if (event.key === "Enter") pin(mark ?? (view[0] + view[1]) / 2);
  else if (event.key === "0" || event.key === "Escape") { pins = []; open(...whole); point(null); }
  else return false;
  return true;
}

const ACTIONS = { "earlier": () => scale(1, -0.5), "later": () => scale(1, 0.5), "in": () => scale(0.5), "out": () => scale(2) };
for (const b of document.querySelectorAll("[data-zoom]")) b.addEventListener("click", ACTIONS[b.dataset.zoom]);
for (const b of windows) b.addEventListener("click", () => open(...windowOf(b)));
for (const b of document.querySelectorAll(".look")) b.addEventListener("click", () => bring(charts[0].figure));
/** Scrolls until a figure is seen below the bar, if it is not seen as a whole. */
function bring(figure) {
  const bar = document.querySelector(".bar").offsetHeight, box = figure.getBoundingClientRect();
  if (box.top < bar || box.bottom > innerHeight) scrollBy({ top: box.top - bar - 8, behavior: "instant" });
}

/** Takes names away from pieces of the time line that have no room for them. */
function crowd() {
  for (const b of document.querySelectorAll(".timeline button")) {
    b.classList.toggle("crowded", b.firstElementChild.offsetWidth > b.clientWidth);
  }
}

const line = document.querySelector(".timeline");
if (line) new ResizeObserver(crowd).observe(line);
for (const p of charts) { legend(p); listen(p); }
show(...view);
