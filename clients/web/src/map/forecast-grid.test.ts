import { describe, expect, it } from "vitest";
import { forecastGrid, forecastValue } from "./forecast-grid";
import { valueAt } from "./ground-grid";
import type { Flat } from "./polygons";

const PLACES = [0, 10, 20].flatMap((x) => [0, 10, 20].map((y): Flat => [x, y]));

describe("a forecast over the ground", () => {
  it("has a cell for each sample of a grid", () => {
    const samples = PLACES.map((at, i) => ({ at, variance: 0.1 + 0.1 * i, psnr_db: null }));
    const found = forecastGrid(samples);
    if (found === null) throw new Error("no grid");
    expect([found.unit, found.grid.columns, found.grid.rows]).toEqual(["variance", 3, 3]);
    for (const { at, variance } of samples)
      expect(forecastValue(found, valueAt(found.grid, at))).toBeCloseTo(variance, 6);
  });
  it("is in dB where all samples have it, of which less is worse", () => {
    const found = forecastGrid(PLACES.map((at, i) => ({ at, variance: 0.5, psnr_db: 20 + i })));
    expect(found && [found.unit, found.best, found.worst]).toEqual(["dB", 28, 20]);
    expect(found && valueAt(found.grid, [0, 0])).toBe(1);
  });
  it("fills holes between samples, and only those", () => {
    const found = forecastGrid(
      PLACES.filter((_, i) => i !== 4).map((at) => ({ at, variance: at[0] / 20, psnr_db: null })),
    );
    expect(found && valueAt(found.grid, [10, 10])).toBeCloseTo(0.5, 6);
    expect(found && valueAt(found.grid, [40, 10])).toBeNaN();
  });
  it("needs three samples", () => {
    expect(forecastGrid([{ at: [0, 0], variance: 1, psnr_db: null }])).toBeNull();
  });
});
