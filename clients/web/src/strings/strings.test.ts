import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { expect, it } from "vitest";
import { strings } from ".";

const ALIAS = /const (\w+) = ((?:strings|texts)(?:\.\w+)*);/g;
const COMMENT = /\/\*[\s\S]*?\*\/|\/\/.*/g;
const QUOTED = /"[^"\n]*"/g;
const PARTS = /const \{ ([^}]*) \} = ((?:strings|texts)(?:\.\w+)*);/g;

/** The chains of names by which a source reads texts, such as `strings.views.form.rank`, without those of other names for them. */
function usesIn(text: string): string[] {
  const source = text.replace(COMMENT, "").replace(QUOTED, '""');
  const names = new Map([["strings", ["strings"]]]);
  const know = (name: string, of: string) => {
    const [root, ...rest] = of.split(".");
    const full = (names.get(root as string) ?? []).map((one) => [one, ...rest].join("."));
    names.set(name, [...(names.get(name) ?? []), ...full]);
  };
  for (const [, name, of] of source.matchAll(ALIAS)) know(name as string, of as string);
  for (const [, parts, of] of source.matchAll(PARTS))
    for (const part of (parts as string).split(", ")) {
      const [from, to = from] = part.split(": ");
      know(to as string, `${of}.${from}`);
    }
  const used = source.replace(ALIAS, "").replace(PARTS, "");
  return [...names].flatMap(([name, full]) =>
    [...used.matchAll(new RegExp(`(?<![\\w.])${name}((?:\\s*\\.\\w+)*)`, "g"))].flatMap(([, rest]) =>
      full.map((one) => one + (rest as string).replace(/\s/g, "")),
    ),
  );
}

function leavesOf(value: unknown, path: string): string[] {
  if (typeof value !== "object" || value === null || Array.isArray(value)) return [path];
  return Object.entries(value).flatMap(([name, part]) => leavesOf(part, `${path}.${name}`));
}

it("Every text is used", () => {
  const sources = readdirSync("src", { recursive: true, encoding: "utf8" }).filter(
    (path) => /\.tsx?$/.test(path) && !/\.(test|d)\.ts$|^strings/.test(path),
  );
  const uses = new Set(sources.flatMap((path) => usesIn(readFileSync(join("src", path), "utf8"))));
  uses.delete("strings");
  // A use of a group, such as `strings.stage[id]`, is one of all its texts.
  const isUsed = (path: string) =>
    path.split(".").some((_, end, names) => uses.has(names.slice(0, end + 1).join("."))) ||
    [...uses].some((use) => use.startsWith(`${path}.`));
  expect(leavesOf(strings, "strings").filter((path) => !isUsed(path))).toEqual([]);
});
