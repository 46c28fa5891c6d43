/* The table of worlds: chosen by a verdict and a filter, sorted by a column, and made row by row as it is scrolled. */

/** Rows that are made at once: fewer where each is a card of its own. */
const atOnce = () => (matchMedia("(max-width: 640px)").matches ? 10 : 50);
const list = document.querySelector(".list"), table = list.querySelector("table"), further = list.querySelector(".further");
const query = document.querySelector(".query input"), order = document.querySelector(".order select");
const told = document.querySelector(".filter output"), kinds = [...document.querySelectorAll("[data-verdict]")];
const state = { verdict: "", key: margin ? "margin" : "world", down: false };
let chosen = [], made = 0;

const valuesOf = (key) => {
  if (key === "world") return sweep.worlds;
  const expected = /^expect (.*)$/.exec(key);
  return expected ? sweep.expectations.find((e) => e.name === expected[1]).met : columnOf(key).values;
};
/** What does not come to its end has no margin, and comes before the worst. */
const ranked = (value) => (Number.isFinite(value) ? value : -Infinity);

/* ---- its head ---- */

function head() {
  const row = table.tHead.rows[0];
  const add = (key, name, below, kind, title) => {
    const cell = document.createElement("th"), button = document.createElement("button"), text = document.createElement("span");
    cell.dataset.key = key;
    cell.scope = "col";
    if (kind) cell.className = kind;
    button.type = "button";
    button.title = title;
    text.className = "name";
    text.textContent = name;
    button.append(text);
    const unit = document.createElement("small");
    unit.textContent = below || " ";
    button.append(unit);
    button.addEventListener("click", () => sort(key, state.key === key ? !state.down : false));
    cell.append(button);
    row.append(cell);
  };
  add("world", "World", "", "", "sort by number");
  for (const c of front) add(c.key, c.label, c.unit, "n", `sort by ${c.key}`);
  for (const e of sweep.expectations) add(`expect ${e.name}`, `met ${e.name}`, "", "", e.text);
  for (const c of rest) add(c.key, c.label, c.unit, "n", `sort by ${c.key}`);
}

/** What is judged comes first, then what the world is, then what became of it. */
const front = sweep.columns.filter((c) => c.kind === "margin");
const rest = sweep.columns.filter((c) => c.kind !== "margin");

/* ---- its rows ---- */

const SIGNS = { good: "M3 8.5 6.5 12 13 4.5", bad: "M4 4l8 8M12 4l-8 8", unknown: "M4 8h8" };
const WORDS = { good: "met", bad: "missed", unknown: "not judged" };
const signOf = (kind, name) => `<svg class="mark" viewBox="0 0 16 16" role="img" aria-label="${name}"><path d="${SIGNS[kind]}"/></svg>`;

function rowsOf(i) {
  const world = sweep.worlds[i], good = success[i] ? "good" : "bad", report = sweep.reports[world];
  const number = (c) => `<td class="n" data-label="${escaped(c.label)}">${shown(c.values[i])}${c.unit && Number.isFinite(c.values[i]) ? `<small class="unit"> ${escaped(c.unit)}</small>` : ""}</td>`;
  const met = sweep.expectations.map((e) => {
    const kind = ["bad", "good", "unknown"][e.met[i]];
    return `<td class="met ${kind}" data-label="${escaped(e.text)}">${signOf(kind, WORDS[kind])}</td>`;
  });
  const cells = `<td class="id">${signOf(good, success[i] ? "succeeded" : "did not succeed")}${world}<small>${escaped(verdictOf(i))}</small></td>${front.map(number).join("")}${met.join("")}${rest.map(number).join("")}`;
  // So that a line is broken between words, not after a hyphen.
  const words = commandOf(i).split(" ").map((word) => `<span>${escaped(word)}</span>`).join(" ");
  const body = document.createElement("tbody");
  body.className = good;
  body.dataset.world = world;
  body.innerHTML = `<tr>${cells}</tr><tr class="how"><td colspan="${1 + front.length + met.length + rest.length}"><div><span class="why">${escaped(whyOf(i))}</span><span class="again"><code>${words}</code>`
    + `<button type="button" aria-label="copy the command of world ${world}">copy</button>${report ? `<a href="${escaped(report)}">report</a>` : ""}</span></div></td></tr>`;
  return body;
}

/** Makes more rows, of those that are chosen. */
function more() {
  const last = Math.min(made + atOnce(), chosen.length);
  table.append(...chosen.slice(made, last).map(rowsOf));
  made = last;
  further.hidden = made === chosen.length;
  further.textContent = `${chosen.length - made} more worlds`;
}

/** Chooses and sorts the worlds anew, and makes the first rows. */
function refresh() {
  const { test, wrong } = parsed(query.value), values = valuesOf(state.key), way = state.down ? -1 : 1;
  query.setAttribute("aria-invalid", String(Boolean(wrong)));
  told.classList.toggle("wrong", Boolean(wrong));
  if (wrong) { told.textContent = wrong; return; }
  chosen = [...sweep.worlds.keys()].filter((i) => (!state.verdict || verdictOf(i) === state.verdict) && test(i));
  const compare = (a, b) => { const [x, y] = [ranked(values[a]), ranked(values[b])]; return x === y ? 0 : x < y ? -way : way; };
  chosen.sort((a, b) => compare(a, b) || a - b);
  told.textContent = chosen.length === count ? `${count} worlds` : `${chosen.length} of ${count} worlds`;
  for (const body of [...table.tBodies]) body.remove();
  made = 0;
  more();
  list.scrollTop = 0;
  for (const cell of table.tHead.rows[0].cells) {
    if (cell.dataset.key === state.key) cell.setAttribute("aria-sort", state.down ? "descending" : "ascending"); else cell.removeAttribute("aria-sort");
  }
  for (const b of kinds) b.setAttribute("aria-pressed", String(b.dataset.verdict === state.verdict));
  order.value = state.key;
  turn.textContent = state.down ? "↓" : "↑";
}

function sort(key, down) {
  state.key = key;
  state.down = down;
  refresh();
}

/** Shows the worlds that a filter chooses, wherever on the page it was asked for. */
function choose(text) {
  state.verdict = "";
  query.value = text;
  refresh();
  document.querySelector(".worlds").scrollIntoView({ block: "start", behavior: "instant" });
}

/* ---- what is pressed ---- */

const turn = document.querySelector(".turn");
table.addEventListener("click", (event) => {
  const button = event.target.closest(".how button");
  if (button) copy(button, button.previousElementSibling.textContent);
});
further.addEventListener("click", more);
list.addEventListener("scroll", () => {
  if (made < chosen.length && list.scrollTop + 2 * list.clientHeight > list.scrollHeight) more();
});
query.addEventListener("input", refresh);
order.addEventListener("change", () => sort(order.value, false));
turn.addEventListener("click", () => sort(state.key, !state.down));
for (const b of kinds) b.addEventListener("click", () => { state.verdict = b.dataset.verdict; refresh(); });
for (const b of document.querySelectorAll("[data-filter]")) b.addEventListener("click", () => choose(b.dataset.filter));

head();
refresh();
