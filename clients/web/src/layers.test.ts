import { readdirSync, readFileSync } from "node:fs";
import { dirname, join, relative } from "node:path";
import { expect, it } from "vitest";

/** Folders and files of `src`, the highest first: each imports from those below its own line, and from itself. */
const LAYERS = [
  ["main"],
  ["app"],
  ["scenes"],
  ["scene"],
  ["view3d", "map"],
  ["selection"],
  ["views"],
  ["plans", "photographs", "work"],
  ["candidates"],
  ["components"],
  ["store"],
  ["geometry", "router", "theme"],
  ["api"],
  ["strings"],
];

const IMPORT = /(?:from|import\(?)\s*"(\.[^"]+)"/g;
const partOf = (path: string) => (path.split("/")[0] as string).replace(/\.tsx?$/, "");
const layerOf = (path: string) => LAYERS.findIndex((layer) => layer.includes(partOf(path)));

const sources = readdirSync("src", { recursive: true, encoding: "utf8" }).filter(
  (path) => /\.tsx?$/.test(path) && !/\.(test|d)\.ts$/.test(path),
);

it("Every folder has a layer", () => {
  expect(sources.filter((path) => layerOf(path) < 0)).toEqual([]);
});

it("Imports point down", () => {
  const wrong = sources.flatMap((path) => {
    const imported = [...readFileSync(join("src", path), "utf8").matchAll(IMPORT)].map(([, to]) =>
      relative("src", join("src", dirname(path), to as string)),
    );
    return imported
      .filter((to) => !to.endsWith(".css") && partOf(to) !== partOf(path) && layerOf(to) <= layerOf(path))
      .map((to) => `${path} imports ${to}`);
  });
  expect(wrong).toEqual([]);
});
