(() => {
  "use strict";
  const run = JSON.parse(document.getElementById("run-data").textContent);
  const LEFT = 62, RIGHT = 16, TOP = 22, BOTTOM = 26;
  const whole = [run.start, Math.max(run.end, run.start + run.period)];
  let view = whole.slice();
  let colours = null;

  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const STEPS = { u1: Uint8Array, u2: Uint16Array, u4: Uint32Array };

  function decoded(trace) {
    const steps = new STEPS[trace.kind](bytes(trace.rows).buffer);
    const x = new Float64Array(steps.length);
    for (let i = 0, row = 0; i < steps.length; i++) {
      row += steps[i];
      x[i] = (trace.start ?? run.start) + run.period * row;
    }
    return { x, y: new Float32Array(bytes(trace.values).buffer) };
  }

  const charts = [...document.querySelectorAll("[data-chart]")].map((figure) => {
    const data = run.charts[figure.dataset.chart];
    const traces = data.traces.map((t) => ({ ...t, ...decoded(t), shown: true }));
    return { ...data, figure, traces, plot: figure.querySelector(".plot"), fixedY: null };
  });

  function readColours() {
    const style = getComputedStyle(document.documentElement);
    const memo = {};
    colours = (name) => (memo[name] ??= style.getPropertyValue("--" + name).trim());
  }

  function faded(hex, alpha) {
    const n = parseInt(hex.slice(1), 16);
    return `rgba(${n >> 16}, ${(n >> 8) & 255}, ${n & 255}, ${alpha})`;
  }

  /* ---- numbers ---- */

  /** A number to a thousandth of the range of values in view. */
  function shownNumber(value, range) {
    if (!Number.isFinite(value)) return "–";
    const digits = Math.min(Math.max(3 - Math.floor(Math.log10(range[1] - range[0])), 0), 9);
    return value.toFixed(digits).replace(/^-(?=.*[1-9])/, "−").replace(/^-/, "");
  }

  function valueAt(trace, time) {
    const { x, y } = trace;
    let low = 0, high = x.length - 1;
    if (high < 0 || time < x[0] || time > x[high] + run.period) return NaN;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (x[middle] <= time) low = middle; else high = middle - 1;
    }
    return y[low];
  }

  /** The range of values to show: what is drawn in the window, and bounds that are near to it. */
  function rangeOfValues(chart) {
    if (chart.fixedY) return chart.fixedY;
    const upright = chart.log ? Math.log10 : (v) => v;
    let low = Infinity, high = -Infinity;
    const take = (v) => { if (v < low) low = v; if (v > high) high = v; };
    for (const { x, y, shown } of chart.traces) {
      if (!shown) continue;
      for (let i = 0; i < x.length; i++) {
        if (x[i] >= view[0] && x[i] <= view[1] && Number.isFinite(y[i])) take(upright(y[i]));
      }
    }
    if (low > high) [low, high] = [-1, 1];
    const near = 0.75 * Math.max(high - low, 1e-9);
    const nearby = (v) => { if (v !== null && v >= low - near && v <= high + near) return v; return null; };
    const bounds = [];
    const inView = (b) => b.end > view[0] && b.start < view[1];
    for (const b of chart.bands.filter(inView)) bounds.push(b.low, b.high);
    for (const b of chart.limits.filter(inView)) bounds.push(b.value);
    bounds.map(nearby).forEach((v) => { if (v !== null) take(v); });
    chart.always.forEach(take);
    const middle = (low + high) / 2, least = 1e-3 * Math.max(1, Math.abs(middle));
    if (high - low < least) [low, high] = [middle - least / 2, middle + least / 2];
    const room = 0.06 * (high - low);
    return [low - room, high + room];
  }

  /* ---- drawing ---- */

  function line(trace) {
    const colour = colours(trace.role);
    switch (trace.style) {
      case "halo": return { color: faded(colour, 0.28), width: 6 };
      case "reference": return { color: colour, width: 1.4, dash: "4px,3px" };
      case "loopless": return { color: colour, width: 1.6, dash: "7px,3px" };
      case "faint": return { color: faded(colour, 0.45), width: 1.2 };
      default: return { color: colour, width: 1.6 };
    }
  }

  function plotted(chart) {
    const lines = chart.traces.map((t) => ({
      type: "scatter", mode: "lines", x: t.x, y: t.y, line: { ...line(t), simplify: false }, hoverinfo: "skip",
      visible: t.shown, connectgaps: false,
    }));
    // Invisible points along each event's line, for its hover text.
    const along = [0, 0.12, 0.25, 0.37, 0.5, 0.62, 0.75, 0.87, 1];
    const text = (e) => e.text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/\n/g, "<br>");
    lines.push({
      type: "scatter", mode: "markers", yaxis: "y2", marker: { size: 8, opacity: 0 },
      x: run.events.flatMap((e) => along.map(() => e.at)), y: run.events.flatMap(() => along),
      hovertext: run.events.flatMap((e) => along.map(() => text(e))), hoverinfo: "text",
    });
    return lines;
  }

  /** The colour of a band; several runs are held against one that has not been judged. */
  function judged(band) {
    return band.passed === null ? "muted" : band.passed ? "good" : "bad";
  }

  function shapes(chart, values) {
    const far = 10 * (values[1] - values[0]);
    const found = [];
    for (const s of run.stages) {
      const colour = colours("tint" + s.tint);
      const x = { type: "rect", x0: s.start, x1: s.end, yref: "paper", line: { width: 0 }, layer: "below" };
      found.push({ ...x, y0: 0, y1: 1, fillcolor: faded(colour, colours("wash")) });
      found.push({ ...x, yanchor: 1, ysizemode: "pixel", y0: 0, y1: 3, fillcolor: colour });
    }
    for (const b of chart.bands) {
      const colour = colours(judged(b));
      const low = b.low ?? values[0] - far, high = b.high ?? values[1] + far;
      found.push({ type: "rect", x0: b.start, x1: b.end, y0: low, y1: high, line: { width: 0 }, fillcolor: faded(colour, 0.2), layer: "below" });
      for (const y of [b.low, b.high]) {
        if (y !== null) found.push({ type: "line", x0: b.start, x1: b.end, y0: y, y1: y, line: { color: colour, width: 1 }, layer: "below" });
      }
    }
    for (const b of chart.limits) {
      found.push({ type: "line", x0: b.start, x1: b.end, y0: b.value, y1: b.value, line: { color: colours("bad"), width: 1.2, dash: "6px,3px" } });
    }
    for (const e of run.events) {
      const look = e.stopped ? { color: colours("bad"), width: 2 } : { color: colours("soft"), width: 1, dash: "1px,3px" };
      found.push({ type: "line", x0: e.at, x1: e.at, yref: "paper", y0: 0, y1: 1, line: look });
    }
    return found;
  }

  /** Names above the stages, where there is room for them. */
  function names(width) {
    const inner = Math.max(width - LEFT - RIGHT, 1), perSecond = inner / (view[1] - view[0]);
    return run.stages.flatMap((s) => {
      const from = Math.max(s.start, view[0]), to = Math.min(s.end, view[1]);
      if ((to - from) * perSecond < 6.6 * s.name.length + 8) return [];
      return [{
        text: s.name.replace(/&/g, "&amp;").replace(/</g, "&lt;"), x: from, y: 1, yref: "paper", xanchor: "left", yanchor: "bottom",
        yshift: 2, showarrow: false, font: { size: 11, color: colours("soft") }, borderpad: 0, xshift: -1,
      }];
    });
  }

  /** A logarithmic axis between two logarithms: powers of ten, with 2 and 5 between them where few. */
  function decades([low, high]) {
    const axis = { type: "log", tickvals: [], ticktext: [] };
    for (let n = Math.floor(low); n <= high; n++) {
      for (const m of high - low < 2.5 ? [1, 2, 5] : [1]) {
        axis.tickvals.push(m * 10 ** n);
        axis.ticktext.push((m * 10 ** n).toFixed(Math.min(Math.max(-n, 0), 9)));
      }
    }
    return axis;
  }

  function layout(chart) {
    const values = chart.values = rangeOfValues(chart);
    const width = chart.plot.clientWidth;
    const family = getComputedStyle(document.body).fontFamily;
    const axis = { gridcolor: colours("grid"), linecolor: colours("line"), zerolinecolor: colours("line"), tickfont: { size: 11 }, exponentformat: "none" };
    return {
      width, height: chart.plot.clientHeight,
      margin: { l: LEFT, r: RIGHT, t: TOP, b: BOTTOM, pad: 0 },
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { family, size: 12, color: colours("soft") },
      showlegend: false, hovermode: "closest", dragmode: "zoom",
      hoverlabel: { bgcolor: colours("card"), bordercolor: colours("line"), font: { family, color: colours("ink"), size: 13 }, align: "left" },
      xaxis: { ...axis, range: view.slice(), showgrid: false, zeroline: false, ticksuffix: " s", showticksuffix: "last", nticks: Math.max(4, Math.round(width / 90)), ticks: "outside", tickcolor: colours("line") },
      yaxis: { ...axis, range: values, nticks: 7, ...(chart.log ? decades(values) : {}) },
      yaxis2: { overlaying: "y", range: [0, 1], visible: false, fixedrange: true },
      shapes: shapes(chart, values),
      annotations: names(width),
    };
  }

  const config = { displayModeBar: false, showTips: false, doubleClick: false, responsive: false };

  function draw(chart) {
    const first = !chart.drawn;
    const done = Plotly.react(chart.plot, plotted(chart), layout(chart), config);
    if (first) {
      chart.drawn = true;
      const cursor = document.createElement("div");
      cursor.className = "cursor";
      chart.plot.append(cursor);
      chart.cursor = cursor;
      chart.plot.on("plotly_relayout", (change) => zoomed(chart, change));
      chart.plot.on("plotly_doubleclick", () => show(whole));
    }
    return done;
  }

  function drawAll() {
    readColours();
    charts.forEach((c) => { legend(c); draw(c); });
  }

  /* ---- one time window for all ---- */

  function show(window_) {
    view = window_.slice();
    for (const c of charts) { c.fixedY = null; draw(c); }
    markWindow();
  }

  function zoomed(source, change) {
    const from = change["xaxis.range[0]"], to = change["xaxis.range[1]"];
    const low = change["yaxis.range[0]"], high = change["yaxis.range[1]"];
    if (from === undefined && low === undefined) return;
    if (low !== undefined) source.fixedY = [low, high];
    if (from !== undefined) {
      view = [Math.max(Number(from), whole[0]), Math.min(Number(to), whole[1])];
      for (const c of charts) if (c !== source) c.fixedY = null;
      charts.forEach(draw);
      markWindow();
    }
  }

  const windows = [...document.querySelectorAll("[data-start]")];
  const windowOf = (b) => (b.dataset.start === "" ? whole : [Number(b.dataset.start), Number(b.dataset.end)]);

  function markWindow() {
    for (const b of windows) b.classList.toggle("on", windowOf(b).every((v, i) => Math.abs(v - view[i]) < 1e-9));
  }

  for (const b of windows) b.addEventListener("click", () => show(windowOf(b)));

  /* ---- legends and the cursor ---- */

  function sample(trace, reference) {
    const strokes = [reference, trace].filter(Boolean).map((t) => {
      const { color, width, dash } = line(t);
      const dashes = dash ? ` stroke-dasharray="4 3"` : "";
      return `<path d="M0 5H20" stroke="${color}" stroke-width="${Math.max(width, 2)}"${dashes}/>`;
    });
    return `<svg viewBox="0 0 20 10" aria-hidden="true">${strokes.join("")}</svg>`;
  }

  function reading(trace, time, range, log) {
    if (!trace.shown) return "";
    const at = valueAt(trace, time);
    if (log) return Number.isFinite(at) ? String(Number(at.toPrecision(3))) : "–";
    const value = shownNumber(at, range);
    const wanted = trace.reference ? valueAt(trace.reference, time) : NaN;
    return Number.isFinite(wanted) ? `${value}  (${shownNumber(wanted, range)})` : value;
  }

  function legend(chart) {
    const list = chart.figure.querySelector(".legend");
    list.replaceChildren();
    for (const trace of chart.traces) {
      if (trace.reference_of) continue;
      const reference = chart.traces.find((t) => t.reference_of === trace.label);
      const item = document.createElement("li"), button = document.createElement("button");
      button.type = "button";
      button.setAttribute("aria-pressed", String(trace.shown));
      button.innerHTML = sample(trace, reference);
      button.append(trace.label);
      trace.reading = document.createElement("output");
      if (reference) trace.reading.className = "pair";
      button.append(trace.reading);
      trace.reference = reference;
      trace.button = button;
      button.addEventListener("click", () => {
        const shown = !trace.shown;
        for (const c of run.linked && !trace.own ? charts : [chart]) {
          for (const t of c.traces.filter((t) => c === chart ? t === trace : t.label === trace.label)) {
            t.shown = shown;
            if (t.reference) t.reference.shown = shown;
            t.button.setAttribute("aria-pressed", String(shown));
          }
          c.fixedY = null;
          draw(c);
        }
      });
      item.append(button);
      list.append(item);
    }
    if (chart.traces.some((t) => t.reference_of)) {
      const item = document.createElement("li");
      item.className = "static";
      item.append("wide and pale: the reference, (in brackets)");
      list.append(item);
    }
    const told = new Set();
    for (const b of chart.bands) {
      if (told.has(b.text)) continue;
      told.add(b.text);
      const colour = colours(judged(b));
      const item = document.createElement("li");
      item.className = "static";
      item.innerHTML = `<svg viewBox="0 0 20 10" aria-hidden="true"><path d="M0 .5H20V9.5H0Z" fill="${faded(colour, 0.2)}"/><path d="M0 .5H20M0 9.5H20" stroke="${colour}"/></svg>`;
      item.append(b.text);
      list.append(item);
    }
  }

  const clock = document.querySelector(".bar output");

  function point(event) {
    const plot = event.currentTarget, box = plot.getBoundingClientRect();
    const inner = plot.clientWidth - LEFT - RIGHT;
    const share = (event.clientX - box.left - LEFT) / inner;
    if (share < 0 || share > 1) return leave();
    const time = view[0] + share * (view[1] - view[0]);
    const stage = run.stages.find((s) => time >= s.start && time < s.end);
    clock.textContent = `${time.toFixed(3)} s` + (stage ? `, ${stage.name} + ${(time - stage.start).toFixed(3)} s` : "");
    for (const c of charts) {
      c.cursor.style.display = "block";
      c.cursor.style.left = `${LEFT + share * inner}px`;
      for (const t of c.traces) if (t.reading) t.reading.textContent = reading(t, time, c.values, c.log);
    }
  }

  function leave() {
    clock.textContent = "";
    for (const c of charts) {
      c.cursor.style.display = "none";
      for (const t of c.traces) if (t.reading) t.reading.textContent = "";
    }
  }

  /* ---- the page around ---- */

  function crowd() {
    for (const b of document.querySelectorAll(".timeline button")) {
      b.classList.toggle("crowded", b.firstElementChild.offsetWidth > b.clientWidth);
    }
  }

  let wait = 0;
  addEventListener("resize", () => { clearTimeout(wait); wait = setTimeout(() => { charts.forEach(draw); crowd(); }, 80); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
  matchMedia("print").addEventListener("change", drawAll);

  drawAll();
  markWindow();
  crowd();
  for (const c of charts) {
    c.plot.addEventListener("pointermove", point);
    c.plot.addEventListener("pointerleave", leave);
  }
})();
