/* One chart as SVG. Colours are classes and variables of the style sheet, so that dark pages and paper need no
   drawing anew. */

const LEFT = 62, RIGHT = 16, TOP = 22, BOTTOM = 26;
/** Widths of a letter of the small text, plain and bold, at most [px]; the least height of a stretch of values chosen [share]. */
const LETTER = 6.1, BOLD = 6.9, LEAST = 1e-6;

class Plot {
  constructor(figure) {
    const data = run.charts[figure.dataset.chart];
    Object.assign(this, data, { figure, box: figure.querySelector(".plot"), chosen: null });
    this.title = figure.querySelector("h3").textContent.trim();
    this.traces = data.traces.map((t) => ({ ...t, ...samples[t.sample], shown: true }));
    this.svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    this.svg.setAttribute("aria-hidden", "true");
    this.cursors = ["cursor", "cursor pinned", "cursor pinned"].map((name) => this.layer(name));
    this.choice = this.layer("choice");
    this.box.prepend(this.svg);
    this.box.setAttribute("aria-label", `${this.title}; left and right move the cursor, Enter sets it, + and - zoom time, `
      + "up and down zoom values, 0 shows all");
  }

  layer(name) {
    const made = document.createElement("div");
    made.className = name;
    this.box.append(made);
    return made;
  }

  upright(value) { return this.log ? Math.log10(value) : value; }

  /** The range of values to show: what was chosen, or what is drawn in the window and bounds that are near to it. */
  range(view) {
    if (this.chosen) return this.chosen;
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
    this.svg.innerHTML = `<svg ${frame}>${this.grounds()}${this.grid(false)}${this.bounds()}${this.lines()}${this.uprights()}${this.names()}</svg>`
      + this.stages() + this.grid(true) + this.axis();
  }

  /** Pixels from the left of the inside. */
  column(time) { return ((time - this.view[0]) / (this.view[1] - this.view[0])) * this.inner.width; }

  /** Pixels from the top of the inside, for a value as it stands on the axis. */
  row(upright) {
    const at = ((this.values[1] - upright) / (this.values[1] - this.values[0])) * this.inner.height;
    return Math.min(Math.max(at, -1e4), 1e4);
  }

  /** Left and right of a piece in view; one of a single tick is as wide as can be seen. */
  span(piece) {
    const to = this.column(piece.end), width = this.inner.width;
    const from = piece.end - piece.start < 1.5 * run.period ? Math.min(this.column(piece.start), to - 9) : this.column(piece.start);
    return to < 0.01 || from > width - 0.01 ? null : [Math.max(from, -10), Math.min(to, width + 10)];
  }

  /** The ground of each stage, and of the time of each fault. */
  grounds() {
    const ground = (piece, kind) => {
      const at = this.span(piece);
      return at ? `<rect class="ground ${kind}" x="${px(at[0])}" y="0" width="${px(at[1] - at[0])}" height="100%"/>` : "";
    };
    return run.stages.map((s) => ground(s, `ink${s.tint}`)).join("") + (run.faults ?? []).map((f) => ground(f, "fault")).join("");
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
      const x = LEFT + this.column(at), shown = text + (i === marks.length - 1 ? " s" : "");
      // At the right edge a text ends where the chart does.
      const over = x + (LETTER * shown.length) / 2 > this.width - 2;
      const place = over ? `class="mid last" text-anchor="end" x="${px(this.width - 2)}"` : `class="mid" x="${px(x)}"`;
      return `<path class="tick" d="M${px(x)} ${foot}v4"/><text ${place} y="${foot + 17}">${shown}</text>`;
    }).join("");
  }

  /** Expected bands, limits, and values at rest. */
  bounds() {
    let drawn = "";
    for (const b of this.bands) {
      const at = this.span(b);
      if (!at) continue;
      const kind = judged(b), rows = [b.high, b.low].map((v) => (v === null ? null : this.row(this.upright(v))));
      drawn += `<path class="band ${kind}" d="${this.area(at, rows, kind)}"/>`;
      for (const y of rows) if (y !== null) drawn += `<path class="edge ${kind}" d="M${px(at[0])} ${px(y)}H${px(at[1])}"/>`;
    }
    for (const b of this.levels) {
      const at = this.span(b);
      if (at) drawn += `<path class="level ${b.kind} ${b.look}" d="M${px(at[0])} ${px(this.row(this.upright(b.value)))}H${px(at[1])}"/>`;
    }
    return drawn;
  }

  /** The allowed area of a band, of one with a single bound a strip of it; of one that was missed, what is not allowed. */
  area([left, right], [high, low], kind) {
    const end = this.inner.height + 10, strip = 12, box = (top, foot) => `M${px(left)} ${px(top)}H${px(right)}V${px(Math.max(foot, top))}H${px(left)}Z`;
    if (kind !== "bad") return box(high ?? low - strip, low ?? high + strip);
    return (high === null ? "" : box(-10, high)) + (low === null ? "" : box(low, end));
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

  /** Events of the run and moments of this chart alone that are in view. */
  inSight() {
    const inView = (e) => { const x = this.column(e.at); return x >= -1 && x <= this.inner.width + 1; };
    return [...run.events, ...this.moments].filter(inView);
  }

  uprights() {
    return this.inSight().map((e) => `<path class="upright ${e.kind}" d="M${px(this.column(e.at))} 0V${this.inner.height}"/>`).join("");
  }

  /** Whether one of the bounds here is that of an expectation. */
  holds(text) { return this.bands.some((b) => b.text === text) || this.traces.some((t) => t.label === text); }

  /**
   * What bounds and uprights are, beside them. A name goes where it covers no other, and is left to the legend where
   * there is no such place.
   */
  names() {
    const taken = [], { width, height } = this.inner;
    const put = (text, kind, places) => {
      const letter = /bad|stop|broken/.test(kind) ? BOLD : LETTER;
      for (const { x, y, to } of places) {
        const room = to === "end" ? x - 4 : width - x - 4, letters = Math.floor(room / letter);
        if (letters < Math.min(text.length, 12)) continue;
        const shown = text.length > letters ? `${text.slice(0, letters - 1)}…` : text;
        const long = letter * shown.length, box = [to === "end" ? x - long : x, y - 10, to === "end" ? x : x + long, y + 3];
        if (box[1] < 0 || box[3] > height || taken.some((t) => box[0] < t[2] && box[2] > t[0] && box[1] < t[3] && box[3] > t[1])) continue;
        taken.push(box);
        return `<text class="name ${kind}${to === "end" ? " end" : ""}" x="${px(x)}" y="${px(y)}">${escaped(shown)}</text>`;
      }
      return "";
    };
    const beside = (x) => [14, 28, 42, 56].flatMap((y) => [{ x: x + 5, y, to: "start" }, { x: x - 5, y, to: "end" }]);
    const along = (piece, value) => {
      const at = this.span(piece), y = this.row(this.upright(value));
      if (!at) return [];
      const [left, right] = [Math.max(at[0], 0) + 5, Math.min(at[1], width) - 5];
      return [y - 5, y + 12].flatMap((row) => [{ x: right, y: row, to: "end" }, { x: left, y: row, to: "start" }])
        .filter(() => y >= 0 && y <= height);
    };
    let drawn = "";
    for (const e of this.inSight()) {
      if (e.kind === "event") continue;
      const text = e.kind === "broken" && this.holds(e.of) ? e.text : e.short ?? e.text;
      drawn += put(text, e.kind, beside(this.column(e.at)));
    }
    const seen = new Set();
    const first = (key) => !seen.has(key) && seen.add(key);
    for (const b of [...this.bands].sort((p, q) => (p.passed === false ? 0 : 1) - (q.passed === false ? 0 : 1))) {
      const places = [b.high, b.low].filter((v) => v !== null).flatMap((v) => along(b, v));
      if (places.length && first(b.text)) drawn += put(b.text, judged(b), places);
    }
    for (const b of this.levels) {
      const places = along(b, b.value);
      if (places.length && first(b.text + Math.sign(b.value))) drawn += put(b.text, `${b.kind} ${b.look}`, places);
    }
    return drawn;
  }

  /** The time at a place of the screen, null beside the inside. */
  timeAt(clientX) {
    const share = (clientX - this.box.getBoundingClientRect().left - LEFT) / this.inner.width;
    return share < 0 || share > 1 ? null : this.view[0] + share * (this.view[1] - this.view[0]);
  }

  /** The value at a height of the screen, as it stands on the axis. */
  valueAtRow(clientY) {
    const share = (clientY - this.box.getBoundingClientRect().top - TOP) / this.inner.height;
    return this.values[1] - Math.min(Math.max(share, 0), 1) * (this.values[1] - this.values[0]);
  }

  /** Shows a stretch of values as they stand on the axis; null shows what there is. */
  stretch(values) {
    this.chosen = values && values[1] - values[0] > LEAST * (this.values[1] - this.values[0]) ? values : null;
    this.draw(this.view);
  }

  /** Puts the cursor at a time, and the set ones at theirs; null takes one away. */
  point(time, pins) {
    [time, ...pins].forEach((at, i) => {
      const inside = at !== null && at >= this.view[0] && at <= this.view[1];
      this.cursors[i].style.display = inside ? "block" : "none";
      if (inside) this.cursors[i].style.left = `${LEFT + this.column(at)}px`;
    });
    for (let i = 1 + pins.length; i < this.cursors.length; i++) this.cursors[i].style.display = "none";
    const at = pins[1] ?? time ?? pins[0] ?? null, from = pins.length && at !== pins[0] ? pins[0] : null;
    const inside = at !== null && at >= this.view[0] && at <= this.view[1];
    for (const t of this.traces) if (t.reading) t.reading.textContent = inside ? this.reading(t, at, from) : "";
  }

  /** A value at a time, with what it has changed by since another. */
  reading(trace, time, from) {
    if (!trace.shown) return "";
    const at = valueAt(trace, time);
    const text = this.log ? (v) => (Number.isFinite(v) ? String(Number(v.toPrecision(3))) : "–") : (v) => shownNumber(v, this.values);
    if (from !== null) return `${text(at)}  Δ ${text(at - valueAt(trace, from))}`;
    const wanted = trace.reference && !this.log ? valueAt(trace.reference, time) : NaN;
    return Number.isFinite(wanted) ? `${text(at)}  (${text(wanted)})` : text(at);
  }

  /** Shows the window that is being chosen between two times, and two heights of the chart itself; or none. */
  choose(from, to, rows = null) {
    this.choice.style.display = from === null ? "none" : "block";
    if (from === null) return;
    const [a, b] = [from, to].sort((x, y) => x - y);
    this.choice.style.left = `${LEFT + this.column(a)}px`;
    this.choice.style.width = `${this.column(b) - this.column(a)}px`;
    const [top, foot] = rows ? rows.map((v) => TOP + this.row(v)).sort((x, y) => x - y) : [TOP, TOP + this.inner.height];
    this.choice.style.top = `${top}px`;
    this.choice.style.height = `${foot - top}px`;
  }
}

/** The class of a band; several runs are held against one that has not been judged. */
function judged(band) { return band.passed === null ? "open" : band.passed ? "good" : "bad"; }
