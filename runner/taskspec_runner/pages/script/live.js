/* A run as it goes on: its rows come as messages, and the charts show its last seconds. */

const place = (id) => document.getElementById(id);
const shownTime = place("time"), shownStage = place("stage"), shownSpeed = place("speed");
for (const p of charts) {
  for (const t of p.traces) [t.x, t.y] = [[], []];
  p.figure.hidden = true;
}
let due = false, stageOf = null, ended = false;

/** Draws at the next frame. */
function refresh() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    due = false;
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
  for (const [time, stage, ...values] of rows) {
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
  const now = rows[rows.length - 1][0], from = Math.max(now - run.last, 0);
  [whole[0], whole[1]] = [from, from + run.last];
  for (const p of charts) for (const t of p.traces) {
    const old = Math.max(before(t.x, from), 0);
    t.x.splice(0, old);
    t.y.splice(0, old);
  }
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
