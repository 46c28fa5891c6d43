/* A run as it goes on: its rows come as messages, and the charts show its last seconds. */

const place = (id) => document.getElementById(id);
const shownTime = place("time"), shownStage = place("stage"), shownSpeed = place("speed");
for (const p of charts) {
  for (const t of p.traces) [t.x, t.y] = [[], []];
  p.figure.hidden = true;
}
let due = false, stageOf = null, ended = false;

/* The arm is where it was under the cursor, else where it is now. */
const poses = [], place_ = document.querySelector(".arm");
let arm = null, largest = 0;
/** Of the arrow for the largest force so far [m]; below this force [N] there is none. */
const ARROW = 0.16, LEAST_FORCE = 0.2;

function pose(time) {
  if (!arm || !poses.length) return;
  const { values, stage } = (time === null ? null : poses.findLast((p) => p.time <= time)) ?? poses[poses.length - 1];
  const part = (from, to) => values.slice(from, to).map((v) => v ?? NaN), w = arm.width;
  arm.show({ q: part(0, w), point: part(w, w + 3), axes: part(w + 3, w + 7), force: part(w + 7, w + 10), kinds: arm.kinds[stage] ?? {} });
}

/** The scene, moved by messages. */
function staged(scene, lib) {
  const made = lib.create(place_.querySelector(".view"), scene), follow = place_.querySelector(".follow");
  arm = { width: scene.width, kinds: scene.kinds, show: made.show, scale: made.scale, path: made.path };
  const following = (on) => { follow.setAttribute("aria-pressed", on); made.follow(on); };
  follow.addEventListener("click", () => following(follow.getAttribute("aria-pressed") !== "true"));
  place_.querySelector(".reset").addEventListener("click", () => { following(false); made.reset(); });
  followers.push(pose);
  refresh();
}

if (place_) {
  Promise.all([unpacked("live-scene"), unpacked("scene-code")])
    .then(([data, code]) => staged(JSON.parse(data), new Function(`${code};return taskspecScene;`)()))
    .catch(() => { place_.hidden = true; });
}

/** The path of the last seconds, and how long the arrow of a force is. */
function traced() {
  if (!arm) return;
  const w = arm.width, known = poses.filter((p) => p.values[w] !== null);
  arm.path("actual", known.flatMap((p) => p.values.slice(w, w + 3)));
  for (const p of known) largest = Math.max(largest, Math.hypot(...p.values.slice(w + 7, w + 10)));
  arm.scale(largest > LEAST_FORCE ? ARROW / largest : 0);
}

/** Draws at the next frame. */
function refresh() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    due = false;
    traced();
    show(...view);
  });
}

function enter(name, time) {
  stageOf = name;
  const before = run.stages.find((s) => s.name === name);
  run.stages.push({ name, tint: before ? before.tint : new Set(run.stages.map((s) => s.name)).size % 8, start: time, end: time });
}

function take({ rows, speed }) {
  const follows = view.every((v, i) => v === whole[i]);
  for (const { time, stage, values, arm: of } of rows) {
    if (of) poses.push({ time, stage, values: of });
    const name = run.names[stage], anew = name !== stageOf;
    if (anew) enter(name, time);
    run.stages[run.stages.length - 1].end = time;
    for (const p of charts) {
      for (const t of p.traces) {
        // What is counted in the frame of a stage does not run on into the next.
        if (anew) { t.x.push(time); t.y.push(NaN); }
        t.x.push(time);
        t.y.push(values[t.number] ?? NaN);
        if (values[t.number]) p.figure.hidden = false;
      }
    }
  }
  const now = rows[rows.length - 1].time, from = Math.max(now - run.last, 0);
  [whole[0], whole[1]] = [from, from + run.last];
  for (const p of charts) for (const t of p.traces) {
    const old = Math.max(before(t.x, from), 0);
    t.x.splice(0, old);
    t.y.splice(0, old);
  }
  while (poses[0]?.time < from) poses.shift();
  shownTime.textContent = `${now.toFixed(2)} s`;
  shownStage.textContent = stageOf;
  shownSpeed.textContent = speed;
  if (follows) view = whole.slice();
  refresh();
}

const source = new EventSource("events");
source.addEventListener("rows", (event) => take(JSON.parse(event.data)));
source.addEventListener("verdict", (event) => {
  const { box, expectations, over } = JSON.parse(event.data);
  place("verdict").innerHTML = box;
  if (expectations !== undefined) place("expectations").innerHTML = expectations;
  ended = over;
});
source.addEventListener("error", () => {
  if (ended) source.close(); else shownSpeed.textContent = "no connection to the run";
});
