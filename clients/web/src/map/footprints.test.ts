import { describe, expect, it } from "vitest";
import { orientationOf } from "../geometry/earth";
import { footprintOf, lensOf } from "./footprints";
import { type Ground, levelGround } from "./ground";
import { gapAt, overlapOf, shareOf, valueAt } from "./ground-grid";
import { areaOf, type Flat } from "./polygons";

const LENS = lensOf(400, 300, 500);
const NADIR = orientationOf({ yaw_deg: 0, pitch_deg: -90 });

function extent(corners: readonly Flat[]): number[] {
  const xs = corners.map((corner) => corner[0]);
  const ys = corners.map((corner) => corner[1]);
  return [Math.max(...xs) - Math.min(...xs), Math.max(...ys) - Math.min(...ys)];
}

describe("a footprint", () => {
  it("of a nadir camera at height h covers w h / f by its height", () => {
    const found = footprintOf({ position: [10, 20, 65], orientation: NADIR }, LENS, levelGround(5));
    const [width, height] = extent(found ?? []);
    expect(width).toBeCloseTo((400 * 60) / 500, 6);
    expect(height).toBeCloseTo((300 * 60) / 500, 6);
    expect(areaOf(found ?? [])).toBeCloseTo(48 * 36, 6);
  });
  it("follows ground that rises", () => {
    const slope: Ground = { typical: 0, heightAt: (x) => 0.1 * x };
    const found = footprintOf({ position: [0, 0, 50], orientation: NADIR }, LENS, slope) ?? [];
    // The ray to the east has x = 0.4 (50 - z) and meets z = 0.1 x.
    expect(Math.max(...found.map((corner) => corner[0]))).toBeCloseTo(20 / 1.04, 2);
    expect(Math.min(...found.map((corner) => corner[0]))).toBeCloseTo(-20 / 0.96, 2);
  });
  it("ends before the horizon", () => {
    const orientation = orientationOf({ yaw_deg: 90, pitch_deg: -10 });
    const found = footprintOf({ position: [0, 0, 10], orientation }, LENS, levelGround(0)) ?? [];
    const far = found.map(([x, y]) => Math.hypot(x, y));
    expect(Math.max(...far)).toBeCloseTo(50, 6);
    expect(Math.min(...found.map((corner) => corner[0]))).toBeGreaterThan(15);
  });
  it("is none for a camera that looks up, or is in the ground", () => {
    const up = orientationOf({ yaw_deg: 0, pitch_deg: 60 });
    expect(footprintOf({ position: [0, 0, 10], orientation: up }, LENS, levelGround(0))).toBeNull();
    expect(footprintOf({ position: [0, 0, 10], orientation: NADIR }, LENS, levelGround(11))).toBeNull();
  });
});

describe("overlap", () => {
  const square = (x: number, y: number): Flat[] => [[x, y], [x + 40, y], [x + 40, y + 40], [x, y + 40]]; // biome-ignore format: one square
  const ring = [0, 40, 80].flatMap((x) => [0, 40, 80].map((y) => square(x, y))).filter((_, i) => i !== 4);
  const grid = overlapOf([...ring, square(0, 0)]);
  if (grid === null) throw new Error("no grid");
  it("counts the photographs that see a place", () => {
    expect([valueAt(grid, [20, 20]), valueAt(grid, [60, 20]), valueAt(grid, [60, 60])]).toEqual([2, 1, 0]);
    expect(valueAt(grid, [150, 20])).toBeNaN();
    expect(shareOf(grid, (value) => value === 0)).toBeCloseTo(1 / 9, 1);
  });
  it("finds the gap at a place", () => {
    const gap = gapAt(grid, [60, 60], (value) => value < 1, 100) ?? [];
    extent(gap).forEach((side) => {
      expect(side).toBeGreaterThan(38);
      expect(side).toBeLessThan(42);
    });
    expect(gapAt(grid, [20, 20], (value) => value < 1, 100)).toBeNull();
  });
  it("ends a gap at a reach", () => {
    const around = gapAt(grid, [60, 10], (value) => value < 2, 30) ?? [];
    expect(Math.max(...around.map((corner) => Math.hypot(corner[0] - 60, corner[1] - 10)))).toBeLessThan(32);
  });
});
