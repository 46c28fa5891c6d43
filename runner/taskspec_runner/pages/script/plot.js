/* A chart over time: lines of signals, what is expected of them, stages and events, cursors. */

/** Width of a letter of the bold text, at most [px]; the least height of a stretch of values chosen [share]. */
const BOLD = 6.9, LEAST = 1e-6;

class Plot extends Chart {
  constructor(figure) {
    super(figure, 22);
    const data = run.charts[figure.dataset.chart];
    Object.assign(this, data, { chosen: null });
    this.traces = data.traces.map((t) => ({ ...t, ...samples[t.sample], shown: true, shared: run.linked && t.style === "reference" }));
    this.box.classList.add("timed");
    this.cursors = ["cursor", "cursor pinned", "cursor pinned"].map((name) => this.layer(name));
    this.choice = this.layer("choice");
    this.name("; left and right move the cursor, Enter sets it, + and - zoom time, up and down zoom values, 0 shows all");
  }

  /** The stages of its run. */
  get stays() { return this.visits ?? run.stages; }

  upright(value) { return this.log ? Math.log10(value) : value; }

  /** The range of values to show: what was chosen, or what is drawn in the window and bounds that are near to it. */
  range() {
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

  draw() {
    super.draw();
    this.point(mark, pins);
  }

  measure() { [this.x, this.y] = [view, this.range()]; }

  inside() { return this.grounds() + this.grid() + this.bounds() + this.lines() + this.uprights() + this.names(); }

  beside() { return this.stages(); }

  /** A value as it stands on the axis, as pixels. */
  rowOf(value) { return this.row(this.upright(value)); }

  /** Left and right of a piece in view; one of a single tick is as wide as can be seen. */
  span(piece) {
    const to = this.column(piece.end), right = LEFT + this.inner.width;
    const from = piece.end - piece.start < 1.5 * run.period ? Math.min(this.column(piece.start), to - 9) : this.column(piece.start);
    return to < LEFT + 0.01 || from > right - 0.01 ? null : [Math.max(from, LEFT - 10), Math.min(to, right + 10)];
  }

  /** The ground of each stage, and of the time of each fault. */
  grounds() {
    const ground = (piece, kind) => {
      const at = this.span(piece);
      return at ? `<rect class="ground ${kind}" x="${px(at[0])}" y="${this.top}" width="${px(at[1] - at[0])}" height="${this.inner.height}"/>` : "";
    };
    return this.stays.map((s) => ground(s, `ink${s.tint}`)).join("") + (run.faults ?? []).map((f) => ground(f, "fault")).join("");
  }

  /** A strip in each stage's colour above the chart, with its name where there is room. */
  stages() {
    return this.stays.map((s) => {
      const from = Math.max(this.column(s.start), LEFT), to = Math.min(this.column(s.end), LEFT + this.inner.width);
      if (to <= from) return "";
      const name = to - from > 6.6 * s.name.length + 6 ? `<text x="${px(from + 1)}" y="${this.top - 7}">${escaped(s.name)}</text>` : "";
      return `<rect class="ink${s.tint}" x="${px(from)}" y="${this.top - 3}" width="${px(to - from)}" height="3"/>${name}`;
    }).join("");
  }

  marksAcross() {
    const marks = super.marksAcross();
    if (marks.length) marks[marks.length - 1].text += " s";
    return marks;
  }

  /** Expected bands, limits, and values at rest. */
  bounds() {
    let drawn = "";
    for (const b of this.bands) {
      const at = this.span(b);
      if (!at) continue;
      const kind = judged(b), rows = [b.high, b.low].map((v) => (v === null ? null : this.rowOf(v)));
      drawn += `<path class="band ${kind}" d="${this.area(at, rows, kind)}"/>`;
      for (const y of rows) if (y !== null) drawn += `<path class="edge ${kind}" d="M${px(at[0])} ${px(y)}H${px(at[1])}"/>`;
    }
    for (const b of this.levels) {
      const at = this.span(b);
      if (at) drawn += `<path class="level ${b.kind} ${b.look}" d="M${px(at[0])} ${px(this.rowOf(b.value))}H${px(at[1])}"/>`;
    }
    return drawn;
  }

  /** The allowed area of a band, of one with a single bound a strip of it; of one that was missed, what is not allowed. */
  area([left, right], [high, low], kind) {
    const end = this.foot + 10, strip = 12, box = (top, foot) => `M${px(left)} ${px(top)}H${px(right)}V${px(Math.max(foot, top))}H${px(left)}Z`;
    if (kind !== "bad") return box(high ?? low - strip, low ?? high + strip);
    return (high === null ? "" : box(this.top - 10, high)) + (low === null ? "" : box(low, end));
  }

  lines() {
    return this.traces.map((t) => (t.shown ? `<path class="trace ${t.style}" style="stroke:var(--${t.role})" d="${this.way(t)}"/>` : "")).join("");
  }

  /** Path data of a trace in view: every point, or of each column of pixels the lowest and the highest. */
  way({ x, y }) {
    const first = Math.max(before(x, view[0]), 0), last = Math.min(before(x, view[1]) + 1, x.length - 1);
    const all = last - first < 3 * this.inner.width, step = this.inner.width / (view[1] - view[0]);
    const across = (i) => LEFT + (x[i] - view[0]) * step;
    const parts = [];
    let pen = "M", column = null, low = 0, high = 0;
    const put = (i) => { parts.push(pen, px(across(i)), " ", px(this.rowOf(y[i]))); pen = "L"; };
    const flush = () => {
      if (column === null) return;
      put(Math.min(low, high));
      if (low !== high) put(Math.max(low, high));
      column = null;
    };
    for (let i = first; i <= last; i++) {
      if (!Number.isFinite(y[i])) { flush(); pen = "M"; continue; }
      if (all) { put(i); continue; }
      const at = Math.floor(across(i));
      if (at !== column) { flush(); column = at; low = high = i; continue; }
      if (y[i] < y[low]) low = i;
      if (y[i] > y[high]) high = i;
    }
    flush();
    return parts.join("");
  }

  /** Events that are in view. */
  inSight() {
    return run.events.filter((e) => { const x = this.column(e.at) - LEFT; return x >= -1 && x <= this.inner.width + 1; });
  }

  uprights() {
    return this.inSight().map((e) => `<path class="upright ${e.kind}" d="M${px(this.column(e.at))} ${this.top}V${this.foot}"/>`).join("");
  }

  /** Whether one of the bounds here is that of an expectation. */
  holds(text) { return this.bands.some((b) => b.text === text) || this.traces.some((t) => t.label === text); }

  /**
   * What bounds and uprights are, beside them. A name goes where it covers no other, and is left to the legend where
   * there is no such place.
   */
  names() {
    const taken = [], right = LEFT + this.inner.width;
    const put = (text, kind, places) => {
      const letter = /bad|stop|broken/.test(kind) ? BOLD : LETTER;
      for (const { x, y, to } of places) {
        const room = to === "end" ? x - LEFT - 4 : right - x - 4, long = letter * text.length;
        if (long > room) continue;
        const box = [to === "end" ? x - long : x, y - 10, to === "end" ? x : x + long, y + 3];
        if (box[1] < this.top || box[3] > this.foot || taken.some((t) => box[0] < t[2] && box[2] > t[0] && box[1] < t[3] && box[3] > t[1])) continue;
        taken.push(box);
        return `<text class="name ${kind}${to === "end" ? " end" : ""}" x="${px(x)}" y="${px(y)}">${escaped(text)}</text>`;
      }
      return "";
    };
    const beside = (x) => [14, 28, 42, 56].map((y) => this.top + y).flatMap((y) => [{ x: x + 5, y, to: "start" }, { x: x - 5, y, to: "end" }]);
    const along = (piece, value) => {
      const at = this.span(piece), y = this.rowOf(value);
      if (!at) return [];
      const [from, to] = [Math.max(at[0], LEFT) + 5, Math.min(at[1], right) - 5];
      return [y - 5, y + 12].flatMap((row) => [{ x: to, y: row, to: "end" }, { x: from, y: row, to: "start" }])
        .filter(() => y >= this.top && y <= this.foot);
    };
    let drawn = "";
    for (const e of this.inSight()) {
      if (e.kind === "event") continue;
      const text = e.kind === "broken" && this.holds(e.of) ? e.text : e.short ?? e.text;
      const places = beside(this.column(e.at));
      // Of an event for which there is no room, its time and what it is are enough.
      drawn += put(text, e.kind, places) || put(text.split(", ")[0], e.kind, places);
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
    return share < 0 || share > 1 ? null : view[0] + share * (view[1] - view[0]);
  }

  /** The value at a height of the screen, as it stands on the axis. */
  valueAtRow(clientY) {
    const share = (clientY - this.box.getBoundingClientRect().top - this.top) / this.inner.height;
    return this.y[1] - Math.min(Math.max(share, 0), 1) * (this.y[1] - this.y[0]);
  }

  /** Shows a stretch of values as they stand on the axis; null shows what there is. */
  stretch(values) {
    this.chosen = values && values[1] - values[0] > LEAST * (this.y[1] - this.y[0]) ? values : null;
    this.draw();
  }

  /** Puts the cursor at a time, and the set ones at theirs; null takes one away. */
  point(time, pins) {
    [time, ...pins].forEach((at, i) => {
      const inside = this.inner && at !== null && at >= view[0] && at <= view[1];
      this.cursors[i].style.display = inside ? "block" : "none";
      if (inside) this.cursors[i].style.left = `${this.column(at)}px`;
    });
    for (let i = 1 + pins.length; i < this.cursors.length; i++) this.cursors[i].style.display = "none";
    const at = pins[1] ?? time ?? pins[0] ?? null, from = pins.length && at !== pins[0] ? pins[0] : null;
    const inside = at !== null && at >= view[0] && at <= view[1];
    for (const t of this.traces) if (t.reading) t.reading.textContent = inside ? this.reading(t, at, from) : "";
  }

  /** A value at a time, with what it has changed by since another. */
  reading(trace, time, from) {
    if (!trace.shown) return "";
    const at = valueAt(trace, time);
    const text = this.log ? (v) => (Number.isFinite(v) ? String(Number(v.toPrecision(3))) : "–") : (v) => shownNumber(v, this.y);
    if (from !== null) return `${text(at)}  Δ ${text(at - valueAt(trace, from))}`;
    const wanted = trace.reference && !this.log ? valueAt(trace.reference, time) : NaN;
    return Number.isFinite(wanted) ? `${text(at)}  (${text(wanted)})` : text(at);
  }

  /** Shows the window that is being chosen between two times, and two heights of the chart itself; or none. */
  choose(from, to, rows = null) {
    this.choice.style.display = from === null ? "none" : "block";
    if (from === null) return;
    const [a, b] = [from, to].sort((x, y) => x - y);
    this.choice.style.left = `${this.column(a)}px`;
    this.choice.style.width = `${this.column(b) - this.column(a)}px`;
    const [top, foot] = rows ? rows.map((v) => this.row(v)).sort((x, y) => x - y) : [this.top, this.foot];
    this.choice.style.top = `${top}px`;
    this.choice.style.height = `${foot - top}px`;
  }
}

/** The class of a band; several runs are held against one that has not been judged. */
function judged(band) { return band.passed === null ? "open" : band.passed ? "good" : "bad"; }
