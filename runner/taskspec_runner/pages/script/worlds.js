/* The worlds of the page: their numbers and words, and the relations that choose among them. */

const sweep = JSON.parse(document.getElementById("run-data").textContent);
const count = sweep.worlds.length;
const coded = ({ names, of }) => ({ names, of: new Uint32Array(bytes(of).buffer) });
const success = bytes(sweep.success), verdicts = coded(sweep.verdicts), why = coded(sweep.why);
for (const each of sweep.expectations) each.met = bytes(each.met);
for (const each of sweep.columns) each.values = new Float32Array(bytes(each.values).buffer);
const columnOf = (key) => sweep.columns.find((c) => c.key === key);
const margin = columnOf("margin");

const verdictOf = (i) => verdicts.names[verdicts.of[i]];
const whyOf = (i) => why.names[why.of[i]];
const commandOf = (i) => sweep.command + sweep.worlds[i];
/** Four digits, without a power of ten where a number is of a usual size. */
const shown = (value) => (Number.isFinite(value) ? minus(String(Number(value.toPrecision(4)))) : "–");
const withUnit = (column, i) => `${shown(column.values[i])}${column.unit && ` ${column.unit}`}`;

const RELATIONS = {
  "<": (a, b) => a < b, "<=": (a, b) => a <= b, ">": (a, b) => a > b, ">=": (a, b) => a >= b, "=": (a, b) => a === Math.fround(b),
};
const RELATION = /^(.+?)\s*(<=|>=|<|>|=)\s*(-?\d*\.?\d+(?:e[-+]?\d+)?)\s*(.*)$/i;
const plainUnit = (text) => text.replace(/\s+/g, "").replace(/[µμ]/g, "u").replace(/·/g, "*");

/** The columns that a name can mean: one that has it, or all that end or go on with it. */
function named(name) {
  const low = name.toLowerCase(), is = (text) => text.toLowerCase();
  const tests = [(c) => is(c.key) === low || is(c.label) === low, (c) => is(c.key).endsWith(`.${low}`), (c) => is(c.key).includes(low)];
  for (const test of tests) {
    const found = sweep.columns.filter(test);
    if (found.length) return found;
  }
  return [];
}

/** What a filter asks of a world, and what of it is not understood. */
function parsed(text) {
  const tests = [];
  const terms = text.replace(/[−–]/g, "-").replace(/≤/g, "<=").replace(/≥/g, ">=").split(/\s+and\s+|[,;&]+/i);
  for (const term of terms.map((t) => t.trim()).filter(Boolean)) {
    const found = RELATION.exec(term);
    if (!found) {
      if (/[<>=]/.test(term)) return { wrong: `no number after the sign in “${term}”` };
      const low = term.toLowerCase();
      tests.push((i) => `${verdictOf(i)} ${whyOf(i)}`.toLowerCase().includes(low) || String(sweep.worlds[i]) === low || `world ${sweep.worlds[i]}` === low);
      continue;
    }
    const [, name, sign, number, unit] = found, relation = RELATIONS[sign], bound = Number(number);
    if (name.toLowerCase() === "world") {
      tests.push((i) => relation(sweep.worlds[i], bound));
      continue;
    }
    const columns = named(name), [column] = columns;
    if (!columns.length) return { wrong: `there is no column “${name}”` };
    if (columns.length > 1) return { wrong: `“${name}” is ${columns.map((c) => c.label).join(" or ")}` };
    if (unit && plainUnit(unit) !== plainUnit(column.unit)) return { wrong: `${column.label} is in ${column.unit || "plain numbers"}, not “${unit}”` };
    tests.push((i) => relation(column.values[i], bound));
  }
  return { test: (i) => tests.every((t) => t(i)) };
}
