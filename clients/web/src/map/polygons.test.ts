import { describe, expect, it } from "vitest";
import { areaOf, crossesItself, distanceToSegment, type Flat, isInside, lengthOf } from "./polygons";

const SQUARE: Flat[] = [
  [0, 0],
  [10, 0],
  [10, 10],
  [0, 10],
];

describe("a polygon", () => {
  it("has an area, whichever way around it goes", () => {
    expect(areaOf(SQUARE)).toBe(100);
    expect(areaOf([...SQUARE].reverse())).toBe(100);
  });
  it("has an inside", () => {
    expect(isInside([5, 5], SQUARE)).toBe(true);
    expect(isInside([11, 5], SQUARE)).toBe(false);
  });
  const crossing: [string, Flat[], boolean][] = [
    ["square", SQUARE, false],
    ["triangle", SQUARE.slice(0, 3), false],
    ["bow tie", [SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]] as Flat[], true],
    ["polygon with a corner on an edge of its own", [...SQUARE, [5, 0] as Flat], true],
    ["polygon that turns back on itself", [[0, 0], [10, 0], [4, 0], [4, 5]] as Flat[], true], // biome-ignore format: one row
    ["polygon with an arm", [[0, 0], [10, 0], [10, 10], [9, 1], [0, 10]] as Flat[], false], // biome-ignore format: one row
  ];
  it.each(crossing)("that is a %s crosses itself or not", (_, corners, crosses) => {
    expect(crossesItself(corners)).toBe(crosses);
  });
});

it("A line has a length, and distances to its parts", () => {
  expect(lengthOf(SQUARE)).toBe(30);
  expect(distanceToSegment([5, 3], [0, 0], [10, 0])).toBe(3);
  expect(distanceToSegment([13, 4], [0, 0], [10, 0])).toBe(5);
});
