/* Numbers: what the page was given, marks of axes, values as text. */

const run = JSON.parse(document.getElementById("run-data").textContent);
const whole = [run.start, Math.max(run.end, run.start + run.period)];
const STEPS = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array };

const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

/**
 * Times and values of a signal. Rows come as steps between them, or not at all where every tick is there; values as
 * 32 bit floats. A line is broken before each of the rows in `gaps`.
 */
function decoded(sample) {
  const values = new Float32Array(bytes(sample.values).buffer), count = values.length;
  const steps = sample.kind === "all" ? null : new STEPS[sample.kind](bytes(sample.rows).buffer);
  const x = new Float64Array(count + sample.gaps.length), y = new Float32Array(count + sample.gaps.length);
  for (let i = 0, row = 0, gap = 0, at = 0; i < count; i++, at++) {
    row += steps ? steps[i] : i > 0 ? 1 : 0;
    x[at] = sample.start + run.period * row;
    if (i === sample.gaps[gap]) { y[at++] = NaN; x[at] = x[at - 1]; gap++; }
    y[at] = values[i];
  }
  return { x, y };
}

const samples = run.samples.map(decoded);

/** The last place of a sorted array whose value is not above a time; -1 before the first. */
function before(x, time) {
  let low = -1, high = x.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (x[middle] <= time) low = middle; else high = middle - 1;
  }
  return low;
}

function valueAt({ x, y }, time) {
  const at = before(x, time);
  return at < 0 || time > x[x.length - 1] + run.period ? NaN : y[at];
}

const minus = (text) => text.replace(/^-(?=.*[1-9])/, "−").replace(/^-/, "");

/** A number to a thousandth of the range of values in view. */
function shownNumber(value, range) {
  if (!Number.isFinite(value)) return "–";
  const digits = Math.min(Math.max(3 - Math.floor(Math.log10(range[1] - range[0])), 0), 9);
  return minus(value.toFixed(digits));
}

/** Round values between two others, about so many, with their texts. */
function ticks(low, high, about) {
  const raw = (high - low) / about, power = 10 ** Math.floor(Math.log10(raw));
  const step = power * ([1, 2, 5].find((s) => s * power >= raw * 0.999) ?? 10);
  const digits = Math.min(Math.max(-Math.floor(Math.log10(step) + 1e-9), 0), 12);
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n++) {
    found.push({ at: n * step, text: minus((n * step).toFixed(digits)) });
  }
  return found;
}

const RAISED = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };
const power = (n) => `10${[...String(n)].map((c) => RAISED[c]).join("")}`;

/** Marks between two logarithms: powers of ten, with 2 and 5 times them where they are few. */
function decades(low, high) {
  const found = [];
  for (let n = Math.floor(low); n <= high; n++) {
    for (const m of high - low < 2.5 ? [1, 2, 5] : [1]) {
      const at = n + Math.log10(m);
      if (at >= low && at <= high) found.push({ at, text: m === 1 ? power(n) : `${m}·${power(n)}` });
    }
  }
  return found;
}
