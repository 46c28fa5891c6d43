/* One chart as SVG. Colours are classes and variables of the style sheet, so that dark pages and paper need no
   drawing anew. */

const LEFT = 62, RIGHT = 16, TOP = 22, BOTTOM = 26;

const escaped = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/"/g, "&quot;");
const px = (value) => value.toFixed(1);

class Plot {
  constructor(figure) {
    const data = run.charts[figure.dataset.chart];
    Object.assign(this, data, { figure, box: figure.querySelector(".plot") });
    this.title = figure.querySelector("h3").textContent.trim();
    this.traces = data.traces.map((t) => ({ ...t, ...decoded(t), shown: true }));
    this.svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    this.svg.setAttribute("aria-hidden", "true");
    this.cursor = document.createElement("div");
    this.cursor.className = "cursor";
    this.choice = document.createElement("div");
    this.choice.className = "choice";
    this.box.append(this.svg, this.cursor, this.choice);
    this.box.setAttribute("aria-label", `${this.title}; arrow keys move, + and - zoom, 0 shows the whole run`);
  }

  upright(value) { return this.log ? Math.log10(value) : value; }

  /** The range of values to show: what is drawn in the window, and bounds that are near to it. */
  range(view) {
    let low = Infinity, high = -Infinity;
    const take = (v) => { if (v < low) low = v; if (v > high) high = v; };
    for (const { x, y, shown } of this.traces) {
      if (!shown) continue;
      const last = before(x, view[1]);
      for (let i = Math.max(before(x, view[0]), 0); i <= last; i++) if (Number.isFinite(y[i])) take(this.upright(y[i]));
    }
    if (low > high) [low, high] = [-1, 1];
    const near = 0.75 * Math.max(high - low, 1e-9), from = low - near, to = high + near;
    const inView = (b) => b.end > view[0] && b.start < view[1];
    const bounds = [...this.bands.filter(inView).flatMap((b) => [b.low, b.high]), ...this.levels.filter(inView).map((b) => b.value)];
    for (const v of bounds.filter((v) => v !== null).map((v) => this.upright(v))) if (v >= from && v <= to) take(v);
    for (const b of this.bands.filter((b) => b.passed === false && inView(b))) [b.low, b.high].forEach((v) => v !== null && take(this.upright(v)));
    this.always.forEach(take);
    const middle = (low + high) / 2, least = 1e-3 * Math.max(1, Math.abs(middle));
    if (high - low < least) [low, high] = [middle - least / 2, middle + least / 2];
    const room = 0.06 * (high - low);
    return [low - room, high + room];
  }

  draw(view) {
    this.view = view;
    this.values = this.range(view);
    const width = this.width = this.box.clientWidth, height = this.box.clientHeight;
    this.inner = { width: Math.max(width - LEFT - RIGHT, 1), height: Math.max(height - TOP - BOTTOM, 1) };
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const frame = `x="${LEFT}" y="${TOP}" width="${this.inner.width}" height="${this.inner.height}"`;
    this.svg.innerHTML = `<svg ${frame}>${this.grounds()}${this.grid(false)}${this.bounds()}${this.lines()}${this.uprights()}</svg>`
      + this.stages() + this.grid(true) + this.axis();
  }

  /** Pixels from the left of the inside. */
  column(time) { return ((time - this.view[0]) / (this.view[1] - this.view[0])) * this.inner.width; }

  /** Pixels from the top of the inside, for a value as it stands on the axis. */
  row(upright) {
    const at = ((this.values[1] - upright) / (this.values[1] - this.values[0])) * this.inner.height;
    return Math.min(Math.max(at, -1e4), 1e4);
  }

  span(piece) {
    const from = this.column(piece.start), to = this.column(piece.end), width = this.inner.width;
    return to < 0.01 || from > width - 0.01 ? null : [Math.max(from, -10), Math.min(to, width + 10)];
  }

  grounds() {
    return run.stages.map((s) => {
      const at = this.span(s);
      return at ? `<rect class="ground ink${s.tint}" x="${px(at[0])}" y="0" width="${px(at[1] - at[0])}" height="100%"/>` : "";
    }).join("");
  }

  /** A strip in each stage's colour above the chart, with its name where there is room. */
  stages() {
    return run.stages.map((s) => {
      const from = Math.max(this.column(s.start), 0), to = Math.min(this.column(s.end), this.inner.width);
      if (to <= from) return "";
      const name = to - from > 6.6 * s.name.length + 6 ? `<text x="${px(LEFT + from + 1)}" y="${TOP - 7}">${escaped(s.name)}</text>` : "";
      return `<rect class="ink${s.tint}" x="${px(LEFT + from)}" y="${TOP - 3}" width="${px(to - from)}" height="3"/>${name}`;
    }).join("");
  }

  grid(texts) {
    const marks = this.log ? decades(...this.values) : ticks(...this.values, Math.max(3, Math.round(this.inner.height / 32)));
    return marks.map(({ at, text }) => {
      const y = this.row(at);
      if (texts) return `<text class="end" x="${LEFT - 8}" y="${px(TOP + y + 4)}">${text}</text>`;
      return `<path class="${at === 0 && !this.log ? "zero" : "grid"}" d="M0 ${px(y)}H${this.inner.width}"/>`;
    }).join("");
  }

  axis() {
    const marks = ticks(this.view[0], this.view[1], Math.max(3, Math.round(this.inner.width / 90)));
    const foot = TOP + this.inner.height;
    return marks.map(({ at, text }, i) => {
      const x = LEFT + this.column(at), unit = i === marks.length - 1 ? " s" : "";
      return `<path class="tick" d="M${px(x)} ${foot}v4"/><text class="mid" x="${px(x)}" y="${foot + 17}">${text}${unit}</text>`;
    }).join("");
  }

  /** Expected bands, limits, and what was predicted. */
  bounds() {
    let drawn = "";
    for (const b of this.bands) {
      const at = this.span(b);
      if (!at) continue;
      const kind = judged(b), rows = [b.high, b.low].map((v) => (v === null ? null : this.row(this.upright(v))));
      const top = rows[0] ?? -10, foot = rows[1] ?? this.inner.height + 10;
      drawn += `<rect class="band ${kind}" x="${px(at[0])}" y="${px(top)}" width="${px(at[1] - at[0])}" height="${px(Math.max(foot - top, 0))}"/>`;
      for (const y of rows) if (y !== null) drawn += `<path class="edge ${kind}" d="M${px(at[0])} ${px(y)}H${px(at[1])}"/>`;
    }
    for (const b of this.levels) {
      const at = this.span(b);
      if (at) drawn += `<path class="level ${b.kind}" d="M${px(at[0])} ${px(this.row(this.upright(b.value)))}H${px(at[1])}"/>`;
    }
    return drawn;
  }

  lines() {
    return this.traces.map((t) => (t.shown ? `<path class="trace ${t.style}" style="stroke:var(--${t.role})" d="${this.way(t)}"/>` : "")).join("");
  }

  /** Path data of a trace in view: every point, or of each column of pixels the lowest and the highest. */
  way({ x, y }) {
    const first = Math.max(before(x, this.view[0]), 0), last = Math.min(before(x, this.view[1]) + 1, x.length - 1);
    const all = last - first < 3 * this.inner.width, step = this.inner.width / (this.view[1] - this.view[0]);
    const parts = [];
    let pen = "M", column = null, low = 0, high = 0;
    const put = (i) => { parts.push(pen, px((x[i] - this.view[0]) * step), " ", px(this.row(this.upright(y[i])))); pen = "L"; };
    const flush = () => {
      if (column === null) return;
      put(Math.min(low, high));
      if (low !== high) put(Math.max(low, high));
      column = null;
    };
    for (let i = first; i <= last; i++) {
      if (!Number.isFinite(y[i])) { flush(); pen = "M"; continue; }
      if (all) { put(i); continue; }
      const at = Math.floor((x[i] - this.view[0]) * step);
      if (at !== column) { flush(); column = at; low = high = i; continue; }
      if (y[i] < y[low]) low = i;
      if (y[i] > y[high]) high = i;
    }
    flush();
    return parts.join("");
  }

  /** Events of the run, and moments of this chart alone. */
  uprights() {
    return [...run.events, ...this.moments].map((e) => {
      const x = this.column(e.at);
      return x < -1 || x > this.inner.width + 1 ? "" : `<path class="upright ${e.kind}" d="M${px(x)} 0V${this.inner.height}"/>`;
    }).join("");
  }

  /** The time at a place of the screen, null beside the inside. */
  timeAt(clientX) {
    const share = (clientX - this.box.getBoundingClientRect().left - LEFT) / this.inner.width;
    return share < 0 || share > 1 ? null : this.view[0] + share * (this.view[1] - this.view[0]);
  }

  point(time) {
    const inside = time !== null && time >= this.view[0] && time <= this.view[1];
    this.cursor.style.display = inside ? "block" : "none";
    if (inside) this.cursor.style.left = `${LEFT + this.column(time)}px`;
    for (const t of this.traces) if (t.reading) t.reading.textContent = inside ? this.reading(t, time) : "";
  }

  reading(trace, time) {
    if (!trace.shown) return "";
    const at = valueAt(trace, time);
    if (this.log) return Number.isFinite(at) ? String(Number(at.toPrecision(3))) : "–";
    const value = shownNumber(at, this.values);
    const wanted = trace.reference ? valueAt(trace.reference, time) : NaN;
    return Number.isFinite(wanted) ? `${value}  (${shownNumber(wanted, this.values)})` : value;
  }

  /** Shows the window that is being chosen between two times, or none. */
  choose(from, to) {
    this.choice.style.display = from === null ? "none" : "block";
    if (from === null) return;
    const [a, b] = [from, to].sort((x, y) => x - y);
    this.choice.style.left = `${LEFT + this.column(a)}px`;
    this.choice.style.width = `${this.column(b) - this.column(a)}px`;
  }
}

/** The class of a band; several runs are held against one that has not been judged. */
function judged(band) { return band.passed === null ? "open" : band.passed ? "good" : "bad"; }
