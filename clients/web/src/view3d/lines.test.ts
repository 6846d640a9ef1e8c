import { describe, expect, it } from "vitest";
import type { Triple } from "../api/artifacts";
import { dot } from "../geometry/vectors";
import type { Content, Marker } from "./content";
import { DEFAULT_INTRINSICS, fitted } from "./lens";
import { edgesOf, frustumSize, groundHeight, groundOf } from "./lines";
import { pick, pickable } from "./picking";

function marker(position: Triple, changes: Partial<Marker> = {}): Marker {
  return {
    layer: "images",
    position,
    orientation: [1, 0, 0, 0],
    paint: { kind: "registered" },
    label: "",
    selects: { kind: "image", digest: String(position) },
    ...changes,
  };
}

function content(markers: Marker[]): Content {
  const up: Triple = [0, 0, 1];
  return {
    intrinsics: DEFAULT_INTRINSICS,
    up,
    north: [0, 1, 0],
    metres: 2,
    centre: [1, 1, 0],
    radius: 10,
    markers,
    routes: [],
  };
}

describe("frusta", () => {
  it("look along z with the roof on the upper side", () => {
    const edges = edgesOf(marker([1, 2, 3]), DEFAULT_INTRINSICS, 0.5);
    expect(edges.filter(([from]) => from.join() === "1,2,3")).toHaveLength(4);
    const ends = edges.flat().map((point) => point[1]);
    expect(edges.flat().every((point) => point[2] === 3 || point[2] === 3.5)).toBe(true);
    // y is down: the roof reaches further up than the image does down.
    expect(2 - Math.min(...ends)).toBeGreaterThan(Math.max(...ends) - 2);
  });

  it("are crosses where a direction is not known", () => {
    expect(edgesOf(marker([0, 0, 0], { orientation: null }), DEFAULT_INTRINSICS, 1)).toHaveLength(3);
  });

  it("are as large as their distances allow", () => {
    const row = [0, 1, 2, 3].map((x) => marker([x, 0, 0]));
    expect(frustumSize(content(row))).toBeCloseTo(0.45, 6);
    expect(frustumSize(content([marker([0, 0, 0])]))).toBeCloseTo(0.8, 6);
    const dense = [0, 1, 2].map((x) => marker([x * 1e-4, 0, 0]));
    expect(frustumSize(content(dense))).toBeCloseTo(0.1, 6);
  });
});

describe("the ground", () => {
  it("has lines at round distances in metres, across the vertical", () => {
    const { spacing, lines } = groundOf(content([]), -1.5);
    expect(spacing * 2).toBe(2); // a fifth of the radius is 4 m
    for (const [from, to] of lines) expect([from[2], to[2]]).toEqual([-1.5, -1.5]);
    expect(lines.some(([from, to]) => dot([to[0] - from[0], to[1] - from[1], 0], [0, 1, 0]) > 10)).toBe(true);
  });

  it("is below nearly all points, not below all", () => {
    const heights = Array.from({ length: 200 }, (_, point) => [
      0,
      0,
      point === 7 ? -50 : 3 + (point % 10) * 0.1,
    ]);
    expect(groundHeight(new Float32Array(heights.flat()), [0, 0, 1])).toBeCloseTo(3, 5);
    expect(groundHeight(new Float32Array(0), [0, 0, 1])).toBeNull();
  });
});

describe("picking", () => {
  const lens = fitted(DEFAULT_INTRINSICS, 640, 480);
  const eye = {
    position: [0, 0, 0] as Triple,
    orientation: [1, 0, 0, 0] as [number, number, number, number],
  };
  const near = marker([0, 0, 2]);
  const behind = marker([0.001, 0, 4]);
  const aside = marker([1, 0, 2], { layer: "candidates" });
  const shown = new Set(["images", "candidates"] as const);

  it("takes what is in front, and at any part of a frustum", () => {
    expect(pick([behind, near, aside], shown, 0.1, eye, lens, [322, 241])).toBe(near);
    expect(pick([behind, near, aside], shown, 0.1, eye, lens, [560, 240])).toBe(aside);
    const turned = marker([0, 0, 2], { orientation: [Math.SQRT1_2, 0, Math.SQRT1_2, 0] });
    const tip = 320 + (480 * 0.5) / 2;
    expect(pick([turned], shown, 0.5, eye, lens, [tip, 240])).toBe(turned);
    expect(pick([near], shown, 0.1, eye, lens, [400, 240])).toBeNull();
    expect(pick([marker([0, 0, -2])], shown, 0.1, eye, lens, [320, 240])).toBeNull();
  });

  it("leaves out what is hidden", () => {
    expect(pick([aside], new Set(["images"] as const), 0.1, eye, lens, [560, 240])).toBeNull();
    expect(pickable([near, aside, marker([9, 0, 2])], shown, eye, lens, 640, 480)).toEqual([near, aside]);
    expect(pickable([marker([0, 0, 2], { selects: null })], shown, eye, lens, 640, 480)).toEqual([]);
  });
});
