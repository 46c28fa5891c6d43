/* Numbers: what the page was given, marks of axes, values as text. */

const run = JSON.parse(document.getElementById("run-data").textContent);
const whole = [run.start, Math.max(run.end, run.start + run.period)];
const STEPS = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array };

const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

/** Times and values of a trace, which come as steps between rows and as 32 bit floats. */
function decoded(trace) {
  const steps = new STEPS[trace.kind](bytes(trace.rows).buffer);
  const x = new Float64Array(steps.length);
  for (let i = 0, row = 0; i < steps.length; i++) {
    row += steps[i];
    x[i] = (trace.start ?? run.start) + run.period * row;
  }
  return { x, y: new Float32Array(bytes(trace.values).buffer) };
}

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

/** Marks between two logarithms: powers of ten, with 2 and 5 between them where they are few. */
function decades(low, high) {
  const found = [];
  for (let n = Math.floor(low); n <= high; n++) {
    for (const m of high - low < 2.5 ? [1, 2, 5] : [1]) {
      const at = n + Math.log10(m);
      if (at >= low && at <= high) found.push({ at, text: (m * 10 ** n).toFixed(Math.min(Math.max(-n, 0), 9)) });
    }
  }
  return found;
}
