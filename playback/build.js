// Bundles src/main.js into ../src/colift/visualization/playback.js, or into the file that is named; the same input, the same bytes.
import { readFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = (path) => fileURLToPath(new URL(path, import.meta.url));
const licence = (name) => readFileSync(here(`node_modules/${name}/LICENSE`), "utf8").trim();

await build({
  absWorkingDir: here("."),
  entryPoints: ["src/main.js"],
  outfile: process.argv[2] ?? here("../src/colift/visualization/playback.js"),
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  charset: "ascii",
  legalComments: "none", // the whole texts are in the banner
  loader: { ".css": "text" },
  banner: { js: `/* colift's playback. It contains three.js:\n\n${licence("three")}\n\nand uPlot:\n\n${licence("uplot")}\n*/` },
});
