/* Builds `../bundle.js` of the sources beside this file, and states in it which these were. */

import { createHash } from "node:crypto";
import { readdirSync, readFileSync } from "node:fs";
import { build } from "esbuild";

const mark = createHash("sha256");
for (const name of readdirSync(".").filter((n) => /\.(js|json|mjs)$/.test(n)).sort()) {
  mark.update(`${name}\0`);
  mark.update(readFileSync(name));
}
const three = JSON.parse(readFileSync("node_modules/three/package.json")).version;
const licence = readFileSync("node_modules/three/LICENSE", "utf8").trim();
await build({
  entryPoints: ["scene.js"],
  outfile: "../bundle.js",
  bundle: true,
  minify: true,
  format: "iife",
  globalName: "taskspecScene",
  target: "es2020",
  legalComments: "none",
  banner: { js: `/* taskspec scene of sources ${mark.digest("hex")}\n\nContains three.js ${three}:\n\n${licence}\n*/` },
});
