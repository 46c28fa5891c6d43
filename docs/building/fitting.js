// What site.css needs for blocks and tables to fit a page: the columns of a block, and the heads of
// a table's cells, which on a phone stand beside them. Names in tables may break after underscores.
for (const code of document.querySelectorAll(".highlight pre > code")) {
  const widths = code.textContent.split("\n").map((line) => line.trimEnd().length);
  code.parentElement.style.setProperty("--columns", Math.max(1, ...widths));
}
for (const table of document.querySelectorAll("article table:not([class])")) {
  const heads = [...table.querySelectorAll("th")].map((head) => head.textContent.trim());
  for (const row of table.querySelectorAll("tbody tr")) {
    [...row.cells].forEach((cell, i) => { cell.dataset.head = heads[i] ?? ""; });
  }
  for (const name of table.querySelectorAll("a > code")) {
    const [first, ...others] = name.textContent.split("_");
    if (others.length) {
      name.replaceChildren(first, ...others.flatMap((part) => ["_", document.createElement("wbr"), part]));
    }
  }
}
