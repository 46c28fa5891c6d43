/* Numbers: as a page is given them, marks of axes, values as text. */

const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

const minus = (text) => text.replace(/^-(?=.*[1-9])/, "−").replace(/^-/, "");

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
