/* Charts of worlds. What succeeded and what did not also differ in form. */

/** Room for worlds without a margin; a point is met by a pointer within so much [px]. */
const LANE = 24, NEAR = 16;
/** From so many worlds on, points are small and pale. */
const MANY = 3000;
/** Values of a column that are so few are places of their own on a map. */
const PLACES = 12;
/** The narrowest cell of a map whose number does not touch the next one. */
const CELL = 32;

/** From the least to the largest of some numbers, with a little room; of one number, about it. */
function spread(values, room) {
  let low = Infinity, high = -Infinity;
  for (const v of values) { if (v < low) low = v; if (v > high) high = v; }
  if (low > high) return [0, 1];
  const size = high - low || Math.abs(high) || 1;
  return [low - room * size, high + room * size];
}

/* ---- the least margin over a parameter ---- */

/** The margins that charts show: all, but of few that are far below the others no more than that they are. */
const margins = (() => {
  const known = margin ? [...margin.values].filter(Number.isFinite).sort((a, b) => a - b) : [];
  if (!known.length) return { range: [-1, 1], below: 0 };
  const high = Math.max(known[known.length - 1], 0), most = known[Math.floor(0.02 * known.length)];
  const far = high - known[0] > 4 * (high - most), low = Math.min(far ? most - 0.2 * (high - most) : known[0], 0);
  const room = 0.06 * (high - low || 1);
  return { range: [low - room, high + room], least: low, below: known.filter((v) => v < low).length };
})();
const ended = margin ? margin.values.every(Number.isFinite) : false;

class Scatter extends Chart {
  constructor(figure) {
    super(figure, 10, ended ? BOTTOM : BOTTOM + LANE);
    this.data = columnOf(figure.dataset.chart);
    this.x = spread(this.data.values, 0.03);
    this.y = margins.range;
    this.box.classList.add("points");
    this.box.classList.toggle("many", count >= MANY);
    this.name(" and the least margin: left and right go from world to world, Enter shows it in the table");
    this.tip = this.layer("tip");
    entry(this.list, `<path class="good-dot" stroke-linecap="round" stroke-width="6" d="M12 5h0"/>`, "succeeded");
    entry(this.list, `<path class="bad-cross" d="M8.5 1.5l7 7m0-7l-7 7"/>`, "did not");
    if (margins.below) figure.querySelector(".note").append(`; ${margins.below} far below at the lower edge`);
  }

  /** Where the point of a world is; null of one without a value. */
  place(i) {
    const value = this.data.values[i];
    if (!Number.isFinite(value)) return null;
    const y = margin ? margin.values[i] : NaN;
    return [this.column(value), Number.isFinite(y) ? this.row(Math.max(y, margins.least)) : this.foot + LANE / 2 + 2];
  }

  inside() { return this.grid(); }

  beside() {
    const size = count < 400 ? 3 : count < MANY ? 2.2 : 1.6, { top, foot } = this, parts = [[], []], zero = this.row(0);
    this.places = [];
    for (let i = 0; i < count; i++) {
      const at = this.places[i] = this.place(i);
      if (!at) continue;
      const [x, y] = at.map(px);
      parts[success[i]].push(success[i] ? `M${x} ${y}h0` : `M${px(at[0] - size)} ${px(at[1] - size)}l${2 * size} ${2 * size}m0-${2 * size}l-${2 * size} ${2 * size}`);
    }
    const lane = ended ? "" : `<rect class="lane" x="${LEFT}" y="${foot + 4}" width="${this.inner.width}" height="${LANE - 4}"/><text class="end" x="${LEFT - 8}" y="${foot + LANE / 2 + 6}">no end</text>`;
    const just = zero > top && zero < foot ? `<path class="zero just" d="M${LEFT} ${px(zero)}h${px(this.inner.width)}"/>` : "";
    return `${just}${lane}<path class="bad-cross" d="${parts[0].join("")}"/><path class="good-dot" stroke-linecap="round" stroke-width="${2 * size}" d="${parts[1].join("")}"/><g class="aimed"></g>`;
  }

  marksUp() { return super.marksUp().map((m) => ({ ...m, text: `${m.text} %` })); }

  /** The world whose point is nearest to a place of the screen; -1 without one near. */
  near(event) {
    const box = this.box.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
    let best = -1, least = NEAR * NEAR;
    this.places.forEach((at, i) => {
      const apart = at ? (at[0] - x) ** 2 + (at[1] - y) ** 2 : Infinity;
      if (apart < least) { least = apart; best = i; }
    });
    return best;
  }

  /** Marks a world's point, and says what it is if the pointer is in this chart. */
  aim(i, here) {
    const at = i < 0 ? null : this.places?.[i], mark = this.svg.querySelector(".aimed");
    if (mark) mark.innerHTML = at ? `<circle class="ring" cx="${px(at[0])}" cy="${px(at[1])}" r="7"/>` : "";
    this.tip.textContent = at && here ? [`world ${sweep.worlds[i]}, ${verdictOf(i)}`, withUnit(this.data, i), margin && Number.isFinite(margin.values[i]) ? `margin ${withUnit(margin, i)}` : ""].filter(Boolean).join(": ") : "";
    if (!this.tip.textContent) return;
    const right = at[0] > this.width / 2;
    this.tip.style.left = right ? "" : `${at[0] + 12}px`;
    this.tip.style.right = right ? `${this.width - at[0] + 12}px` : "";
    this.tip.style.top = `${Math.max(at[1] - 12, 0)}px`;
  }

  /** The next world to the left or right of one. */
  next(i, way) {
    const order = this.order ??= [...sweep.worlds.keys()].filter((j) => this.places[j]).sort((a, b) => this.data.values[a] - this.data.values[b]);
    const at = order.indexOf(i);
    return order[at < 0 ? (way > 0 ? 0 : order.length - 1) : Math.min(Math.max(at + way, 0), order.length - 1)];
  }
}

/* ---- success over two parameters ---- */

/** How a cell is filled in which all worlds succeed, or none. */
const swatchOf = (share) => `<path class="cell ${share ? "good" : "bad"}" d="M4 .5H20V9.5H4Z"/>`;

/** Pieces of a column: a piece for each value where there are few, else so many of the same width. */
function pieces(column, most) {
  const values = [...new Set(column.values)].filter(Number.isFinite).sort((a, b) => a - b);
  if (values.length <= PLACES) {
    const edges = values.slice(1).map((v, i) => (v + values[i]) / 2);
    const of = (v) => edges.findIndex((e) => v < e);
    return { count: values.length, of: (v) => (of(v) < 0 ? values.length - 1 : of(v)), marks: values.map((v, i) => ({ at: i + 0.5, text: shown(v) })) };
  }
  const [low, high] = [values[0], values[values.length - 1]], part = (v) => ((v - low) / (high - low)) * most;
  const marks = ticks(low, high, most).map(({ at, text }) => ({ at: part(at), text }));
  return { count: most, of: (v) => Math.min(Math.floor(part(v)), most - 1), marks };
}

class SuccessMap extends Chart {
  constructor(figure) {
    super(figure, 22, BOTTOM + 18);
    entry(this.list, swatchOf(1), "all succeed");
    entry(this.list, swatchOf(0), "none succeeds");
    entry(this.list, `<path class="cell none" d="M4 .5H20V9.5H4Z"/>`, "no world");
    this.choices = Object.fromEntries([...document.querySelectorAll("[data-axis]")].map((s) => [s.dataset.axis, s]));
    for (const s of Object.values(this.choices)) s.addEventListener("change", () => this.draw());
    this.box.removeAttribute("tabindex");
  }

  measure() {
    const [across, up] = ["x", "y"].map((axis) => columnOf(this.choices[axis].value));
    // So many that a cell has some six worlds, if they are spread evenly.
    const most = Math.min(Math.max(Math.round(Math.sqrt(count / 6)), 3), 10);
    const [a, b] = [pieces(across, Math.min(most, Math.max(Math.floor(this.inner.width / CELL), 3))), pieces(up, most)], good = new Uint32Array(a.count * b.count), all = good.slice();
    for (let i = 0; i < count; i++) {
      const [x, y] = [across.values[i], up.values[i]];
      if (!Number.isFinite(x) || !Number.isFinite(y)) continue;
      const cell = a.of(x) + a.count * b.of(y);
      all[cell]++;
      good[cell] += success[i];
    }
    this.x = [0, a.count];
    this.y = [0, b.count];
    Object.assign(this, { a, b, good, all });
    const named = (c) => `${c.label}${c.unit && ` [${c.unit}]`}`;
    this.ends = [across, up].map(named);
    this.name(` over ${across.label} and ${up.label}`);
  }

  inside() {
    const { a, b, good, all } = this, width = this.inner.width / a.count, height = this.inner.height / b.count;
    let drawn = "";
    all.forEach((n, cell) => {
      const x = LEFT + (cell % a.count) * width, y = this.row(Math.floor(cell / a.count) + 1), share = n ? good[cell] / n : 0;
      const box = `x="${px(x)}" y="${px(y)}" width="${px(width)}" height="${px(height)}"`;
      const kinds = n ? [["good", share], ["bad", 1 - share]] : [["none", 1]];
      drawn += kinds.map(([kind, part]) => `<rect ${box} class="cell ${kind}" opacity="${part.toFixed(3)}"/>`).join("");
      drawn += `<rect ${box} class="cell over"><title>${good[cell]} of ${n} worlds succeed</title></rect>`;
      if (!n) return;
      const middle = px(x + width / 2), below = height > 36 && width > 44;
      drawn += `<text class="percent" x="${middle}" y="${px(y + height / 2 + (below ? 0 : 4))}">${Math.round(100 * share)}</text>`;
      if (below) drawn += `<text class="few" x="${middle}" y="${px(y + height / 2 + 13)}">${good[cell]} of ${n}</text>`;
    });
    return drawn;
  }

  /** The names of both axes, at their ends. */
  beside() {
    const [across, up] = this.ends.map(escaped);
    return `<text x="2" y="13">${up}</text><text class="end" x="${px(this.width - RIGHT)}" y="${px(this.foot + 38)}">${across}</text>`;
  }

  marksUp() { return this.b.marks; }

  /** Below the cells, with the room for the name under them. */
  axes() {
    const up = this.b.marks.map(({ at, text }) => `<text class="end" x="${LEFT - 8}" y="${px(this.row(at) + 4)}">${text}</text>`);
    const across = this.a.marks.map(({ at, text }) => `<text class="mid" x="${px(this.column(at))}" y="${px(this.foot + 17)}">${text}</text>`);
    return [...up, ...across].join("");
  }
}

/* ---- how many worlds have which peak ---- */

/** Up to where a histogram shows values: what is far above all worlds that succeed is counted at its end. */
function edgeOf(values) {
  const [low, high] = spread(values.filter((v, i) => Number.isFinite(v) && success[i]), 0), most = high + 2 * (high - low || Math.abs(high) || 1);
  return success.includes(1) && values.some((v) => v > most) ? most : Infinity;
}

class Histogram extends Chart {
  constructor(figure) {
    super(figure);
    this.data = columnOf(figure.dataset.chart);
    this.hatch = `hatch-${figure.dataset.chart.replace(/\W/g, "-")}`;
    this.box.removeAttribute("tabindex");
    entry(this.list, `<path class="column-good" d="M4 0H20V10H4Z"/>`, "succeeded");
    entry(this.list, `<path class="hatch" fill="none" d="M6 9L12 1M12 9L18 1"/><path class="column-bad" fill="none" d="M4 .5H20V9.5H4Z"/>`, "did not");
    const known = this.data.values.filter(Number.isFinite), last = edgeOf(this.data.values), [low, high] = spread(known.map((v) => Math.min(v, last)), 0);
    const beyond = this.beyond = known.filter((v) => v > last).length;
    if (beyond) figure.querySelector(".note").append(`${beyond} far above in the last column`);
    const marks = ticks(low, high, Math.min(Math.max(2 * Math.sqrt(known.length), 8), 40));
    this.step = marks.length > 1 ? marks[1].at - marks[0].at : high - low || 1;
    this.first = Math.floor(low / this.step + 1e-9);
    this.counts = [];
    this.data.values.forEach((v, i) => {
      if (!Number.isFinite(v)) return;
      const at = Math.floor(Math.min(v, last) / this.step + 1e-9) - this.first;
      while (this.counts.length <= at) this.counts.push([0, 0]);
      this.counts[at][success[i]]++;
    });
    this.x = [this.first * this.step, (this.first + this.counts.length) * this.step];
    this.y = [0, 1.05 * Math.max(1, ...this.counts.map(([bad, good]) => bad + good))];
    this.name(`: in how many worlds it is how large, from ${shown(low)} to ${shown(high)} ${this.data.unit}`);
  }

  marksUp() { return super.marksUp().filter(({ at }) => Number.isInteger(Math.round(at * 1e6) / 1e6)); }

  inside() {
    const foot = this.row(0), width = this.inner.width / this.counts.length, gap = width > 6 ? 1 : 0;
    let drawn = `<defs><pattern id="${this.hatch}" width="6" height="6" patternUnits="userSpaceOnUse" patternTransform="rotate(45)"><path class="hatch" d="M0 0V6"/></pattern></defs>` + this.grid();
    this.counts.forEach(([bad, good], i) => {
      const x = LEFT + i * width + gap / 2, wide = Math.max(width - gap, 0.5), middle = this.row(good), top = this.row(good + bad);
      const from = shown((this.first + i) * this.step), to = shown((this.first + i + 1) * this.step);
      const upTo = this.beyond && i === this.counts.length - 1 ? `${from} and more` : `${from} to ${to}`;
      const title = `<title>${upTo} ${this.data.unit}: ${good} succeeded, ${bad} did not</title>`;
      if (good) drawn += `<rect class="column-good" x="${px(x)}" y="${px(middle)}" width="${px(wide)}" height="${px(foot - middle)}">${title}</rect>`;
      if (bad) drawn += `<rect class="column-bad" fill="url(#${this.hatch})" x="${px(x)}" y="${px(top)}" width="${px(wide)}" height="${px(middle - top)}">${title}</rect>`;
    });
    return drawn;
  }
}

/* ---- all of them ---- */

const KINDS = { scatter: Scatter, map: SuccessMap, histogram: Histogram };
for (const figure of document.querySelectorAll("[data-chart]")) new KINDS[sweep.charts[figure.dataset.chart]](figure);
const scatters = charts.filter((c) => c instanceof Scatter);

let aimed = -1;

/** Marks a world in every chart; -1 marks none. */
function aimAt(i, chart) {
  aimed = i;
  for (const c of scatters) c.aim(i, c === chart);
}

for (const c of scatters) {
  c.box.addEventListener("pointermove", (event) => aimAt(c.near(event), c));
  c.box.addEventListener("pointerleave", () => aimAt(-1, c));
  c.box.addEventListener("blur", () => aimAt(-1, c));
  c.box.addEventListener("click", (event) => { const i = c.near(event); if (i >= 0) choose(`world = ${sweep.worlds[i]}`); });
  c.box.addEventListener("keydown", (event) => {
    const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.ctrlKey || event.metaKey || (!way && event.key !== "Enter")) return;
    event.preventDefault();
    if (way) aimAt(c.next(aimed, way), c);
    else if (aimed >= 0) choose(`world = ${sweep.worlds[aimed]}`);
  });
}
drawAll();
