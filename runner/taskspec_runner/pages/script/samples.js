/* Signals over time, as the page was given them, and their values. */

const run = JSON.parse(document.getElementById("run-data").textContent);
const whole = [run.start, Math.max(run.end, run.start + run.period)];
const STEPS = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array };

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

/** A number to a thousandth of the range of values in view. */
function shownNumber(value, range) {
  if (!Number.isFinite(value)) return "–";
  const digits = Math.min(Math.max(3 - Math.floor(Math.log10(range[1] - range[0])), 0), 9);
  return minus(value.toFixed(digits));
}
