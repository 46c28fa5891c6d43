/* Live params: a slider requests a value, and shows the one that is and the one it goes to. */

const refused = place("refused");
/** After a move the page's own place counts for so long [ms]: older messages are still on the way. */
const OWN = 300;
const written = (v, unit) => `${String(Number(v.toPrecision(4))).replace("-", "\u2212")} ${unit}`.trim();
const near = (a, b, s) => Math.abs(a - b) < 1e-6 * (s.high - s.low || 1);

const sliders = new Map(run.sliders.map((s) => {
  const row = document.querySelector(`[data-param="${s.name}"]`), control = row.querySelector("input");
  const its = { ...s, control, now: row.querySelector(".now"), goes: row.querySelector(".goes"), moved: -Infinity, next: null, busy: false, target: s.value, present: s.value };
  control.addEventListener("input", () => {
    const place = Number((Number(control.value) * s.step).toPrecision(12));
    its.target = Math.min(Math.max(place, s.low), s.high);
    its.next = its.target;
    its.moved = performance.now();
    drawn(its);
    requested(its);
  });
  return [s.name, its];
}));

/** Shows a param; the slider stands where it goes to. */
function drawn(s) {
  s.now.textContent = written(s.present, s.unit);
  s.goes.textContent = near(s.present, s.target, s) ? "" : `\u2192 ${written(s.target, s.unit)}`;
  s.control.setAttribute("aria-valuetext", written(s.target, s.unit));
}

/** Requests the last value, one request after the other, so that none overtakes another. */
async function requested(s) {
  if (s.busy) return;
  s.busy = true;
  while (s.next !== null) {
    const value = s.next / s.factor;
    s.next = null;
    try {
      const answer = await fetch("set", {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ name: s.name, value }),
      });
      refused.textContent = answer.ok ? "" : `${s.name} was not set: ${(await answer.json()).error}`;
    } catch {
      refused.textContent = `${s.name} was not set: no connection to the run`;
    }
  }
  s.busy = false;
  s.moved = performance.now();
}

source.addEventListener("rows", (event) => {
  for (const [name, [present, target]] of Object.entries(JSON.parse(event.data).live)) {
    const s = sliders.get(name);
    s.present = present * s.factor;
    if (!s.busy && performance.now() - s.moved > OWN) {
      s.target = target * s.factor;
      s.control.value = Math.round(s.target / s.step);
    }
    drawn(s);
  }
});
source.addEventListener("closed", () => {
  for (const s of sliders.values()) s.control.disabled = true;
});
