import { expect, it } from "vitest";
import { targetOf } from "./virtual-list";

it("moves by the keys of lists, within the list", () => {
  expect(targetOf("ArrowDown", -1, 5, 20)).toBe(0);
  expect(targetOf("ArrowUp", -1, 5, 20)).toBe(19);
  expect(targetOf("ArrowDown", 19, 5, 20)).toBe(19);
  expect(targetOf("PageUp", 3, 5, 20)).toBe(0);
  expect(targetOf("End", 3, 5, 20)).toBe(19);
  expect(targetOf("a", 3, 5, 20)).toBeNull();
  expect(targetOf("Home", -1, 5, 0)).toBeNull();
});
