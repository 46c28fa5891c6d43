/* A chart as a picture of its own: SVG with its colours written out, or PNG drawn from that. */

const LOOKS = ["fill", "stroke", "stroke-width", "stroke-dasharray", "stroke-linejoin", "stroke-linecap", "opacity", "fill-opacity", "font-family", "font-size", "font-weight", "text-anchor", "paint-order"];

/** A copy of an element in which the style sheet's looks are attributes. */
function styled(element) {
  const copy = element.cloneNode(true), from = [element, ...element.querySelectorAll("*")];
  [copy, ...copy.querySelectorAll("*")].forEach((each, i) => {
    const look = getComputedStyle(from[i]);
    each.removeAttribute("style");
    each.removeAttribute("class");
    if (each.localName !== "svg") for (const name of LOOKS) each.setAttribute(name, look.getPropertyValue(name));
  });
  return copy;
}

/** The chart with its title above and its legend below, as text of an SVG file. */
function picture(plot) {
  const look = getComputedStyle(document.body), ink = look.color, paper = getComputedStyle(plot.figure).backgroundColor;
  const { width } = plot, height = plot.box.clientHeight, head = 30, row = 18;
  const chart = styled(plot.svg);
  chart.setAttribute("y", head);
  chart.setAttribute("width", width);
  chart.setAttribute("height", height);
  let x = 16, y = head + height + 16, entries = "";
  for (const item of plot.figure.querySelectorAll(".legend li")) {
    if (item.querySelector('[aria-pressed="false"]')) continue;
    const texts = [...(item.querySelector("button") ?? item).childNodes].filter((n) => n.nodeType === Node.TEXT_NODE);
    const text = texts.map((n) => n.textContent).join(""), wide = 36 + 7 * text.length;
    if (x > 16 && x + wide > width) { x = 16; y += row; }
    const drawn = styled(item.querySelector("svg"));
    for (const [name, value] of Object.entries({ x, y: y - 9, width: 24, height: 10 })) drawn.setAttribute(name, value);
    entries += `${new XMLSerializer().serializeToString(drawn)}<text x="${x + 30}" y="${y}" fill="${ink}">${escaped(text)}</text>`;
    x += wide;
  }
  const font = look.fontFamily.replace(/"/g, "'");
  return `<svg xmlns="http://www.w3.org/2000/svg" width="${width}" height="${y + 12}" viewBox="0 0 ${width} ${y + 12}" font-family="${font}" font-size="12">`
    + `<rect width="100%" height="100%" fill="${paper}"/><text x="16" y="20" fill="${ink}" font-size="15" font-weight="600">${escaped(plot.title)}</text>`
    + `${new XMLSerializer().serializeToString(chart)}${entries}</svg>`;
}

/** The same as PNG, with two pixels for each of the page. */
async function pixels(text) {
  const image = new Image();
  image.setAttribute("src", `data:image/svg+xml;charset=utf-8,${encodeURIComponent(text)}`);
  await image.decode();
  const canvas = document.createElement("canvas");
  canvas.width = 2 * image.width;
  canvas.height = 2 * image.height;
  canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
  return new Promise((done) => canvas.toBlob(done, "image/png"));
}

async function save(plot, form) {
  const text = picture(plot);
  const blob = form === "svg" ? new Blob([text], { type: "image/svg+xml" }) : await pixels(text);
  const link = document.createElement("a"), name = `${document.title.split(":")[0]} ${plot.title}`;
  const address = URL.createObjectURL(blob);
  link.setAttribute("href", address);
  link.download = `${name.replace(/[^\p{L}\p{N}]+/gu, "-")}.${form}`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}
