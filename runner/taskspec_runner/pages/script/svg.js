/* Pieces of SVG that charts and legends of all pages are made of. */

const escaped = (text) => text.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/"/g, "&quot;");
const px = (value) => value.toFixed(1);

/** A sample of what is drawn, beside its name in a legend. */
function sample(paths) { return `<svg viewBox="0 0 24 10" aria-hidden="true">${paths}</svg>`; }

function entry(list, paths, text) {
  const item = document.createElement("li");
  item.className = "static";
  item.innerHTML = sample(paths);
  item.append(text);
  list.append(item);
}
