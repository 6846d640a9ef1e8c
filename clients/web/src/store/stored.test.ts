import { expect, it } from "vitest";
import { stored } from "./stored";

function storageWith(text: string | null): Storage {
  return { getItem: () => text } as unknown as Storage;
}

it("What is stored comes back", () => {
  expect(stored(storageWith('["a"]'), "x", [])).toEqual(["a"]);
  expect(stored(storageWith('{"a": 1}'), "x", {})).toEqual({ a: 1 });
});

it.each([null, "{", "null", "7", '{"a": 1}', ""])("%o is no list", (text) => {
  expect(stored(storageWith(text), "x", ["usual"])).toEqual(["usual"]);
});
