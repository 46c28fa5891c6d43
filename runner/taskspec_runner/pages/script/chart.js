/* What all charts share: a place on the page, two axes, and an SVG that is drawn anew in any size. Colours are classes
   and variables of the style sheet, so that dark pages and paper need no drawing anew. */

const LEFT = 62, RIGHT = 16, BOTTOM = 26;
/** Letters of the small text are at most so wide [px]. */
const LETTER = 6.1;
const charts = [];

class Chart {
  /** `top` and `bottom` are the room above and below the inside [px]. */
  constructor(figure, top = 10, bottom = BOTTOM) {
    this.svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    this.svg.setAttribute("aria-hidden", "true");
    Object.assign(this, { figure, top, bottom, box: figure.querySelector(".plot"), title: figure.querySelector("h3").textContent.trim() });
    this.list = figure.querySelector(".legend");
    this.box.prepend(this.svg);
    charts.push(this);
  }

  name(text) { this.box.setAttribute("aria-label", `${this.title}${text}`); }

  /** A layer above the drawing, such as a cursor. */
  layer(name) {
    const made = document.createElement("div");
    made.className = name;
    this.box.append(made);
    return made;
  }

  /** Draws it as large as its place is; nothing where that is not seen. `x` and `y` are the ends of its axes. */
  draw() {
    const width = this.width = this.box.clientWidth, height = this.box.clientHeight;
    if (!width) return;
    this.inner = { width: Math.max(width - LEFT - RIGHT, 1), height: Math.max(height - this.top - this.bottom, 1) };
    this.foot = this.top + this.inner.height;
    this.measure();
    const frame = `${LEFT} ${this.top} ${this.inner.width} ${this.inner.height}`, [x, y, w, h] = frame.split(" ");
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.svg.innerHTML = `<svg x="${x}" y="${y}" width="${w}" height="${h}" viewBox="${frame}">${this.inside()}</svg>${this.beside()}${this.axes()}`;
  }

  /** Finds the ends of the axes. */
  measure() {}

  /** What is drawn beside the inside. */
  beside() { return ""; }

  marksUp() { return (this.log ? decades : ticks)(...this.y, Math.max(3, Math.round(this.inner.height / 32))); }

  marksAcross() { return ticks(...this.x, Math.max(3, Math.round(this.inner.width / 75))); }

  column(x) { return LEFT + ((x - this.x[0]) / (this.x[1] - this.x[0])) * this.inner.width; }

  row(y) {
    const at = this.top + ((this.y[1] - y) / (this.y[1] - this.y[0])) * this.inner.height;
    return Math.min(Math.max(at, -1e4), 1e4);
  }

  grid() {
    return this.marksUp().map(({ at }) => `<path class="${at === 0 && !this.log ? "zero" : "grid"}" d="M${LEFT} ${px(this.row(at))}h${this.inner.width}"/>`).join("");
  }

  axes() {
    const up = this.marksUp().map(({ at, text }) => `<text class="end" x="${LEFT - 8}" y="${px(this.row(at) + 4)}">${text}</text>`);
    const across = this.marksAcross().map(({ at, text }) => {
      const x = this.column(at), over = x + (LETTER * text.length) / 2 > this.width - 2;
      // At the right edge a text ends where the chart does.
      const place = over ? `class="mid last" text-anchor="end" x="${px(this.width - 2)}"` : `class="mid" x="${px(x)}"`;
      return `<path class="tick" d="M${px(x)} ${this.box.clientHeight - BOTTOM}v4"/><text ${place} y="${this.box.clientHeight - BOTTOM + 17}">${text}</text>`;
    });
    return [...up, ...across].join("");
  }
}

/* ---- the page around ---- */

function drawAll() { for (const chart of charts) chart.draw(); }

let wait = 0;
addEventListener("resize", () => { clearTimeout(wait); wait = setTimeout(drawAll, 80); });
matchMedia("print").addEventListener("change", drawAll);
const shut = [...document.querySelectorAll("details:not([open], .screen)")];
for (const [event, open] of [["beforeprint", true], ["afterprint", false]]) {
  addEventListener(event, () => { for (const d of shut) d.open = open; drawAll(); });
}
for (const d of document.querySelectorAll("details")) if (d.querySelector("[data-chart]")) d.addEventListener("toggle", drawAll);
for (const b of document.querySelectorAll("[data-save]")) {
  b.addEventListener("click", () => save(charts.find((c) => c.figure === b.closest("figure")), b.dataset.save));
}
