import { expect, it } from "vitest";
import { Frames } from "../geometry/frames";
import type { Drawing } from "../store/scene";
import { drawingVolume, fenceParameter } from "./drawing-volume";

const ORIGIN = { latitude_deg: 47.3977, longitude_deg: 8.5456, altitude_m: 480 };
const ALIGNMENT = {
  status: "aligned" as const,
  source: "positions" as const,
  scale: 2,
  rotation_wxyz: [1, 0, 0, 0] as [number, number, number, number],
  translation: [10, 0, 5] as [number, number, number],
  rms_m: 0.1,
  inliers: 9,
  positions: 9,
  takeoff_altitude_m: null,
};
const FRAMES = new Frames(ALIGNMENT, ORIGIN);
const DRAWING: Drawing = {
  id: "1",
  use: "area",
  corners: [
    { latitude_deg: 47.3977, longitude_deg: 8.5456 },
    { latitude_deg: 47.4005, longitude_deg: 8.5501 },
    { latitude_deg: 47.4005, longitude_deg: 8.5456 },
  ],
  radius_m: 15,
  lower_m: 20,
  upper_m: 60,
};

it("An area is a prism in the world, between its heights above the origin", () => {
  const volume = drawingVolume(DRAWING, FRAMES);
  if (volume.kind !== "prism") throw new Error(volume.kind);
  expect([volume.lower, volume.upper]).toEqual([20, 60]);
  expect(volume.corners[0]?.map((part) => Math.round(part * 100))).toEqual([0, 0, 0]);
  const [east, north] = volume.corners[1] as [number, number, number];
  expect(east).toBeCloseTo(339.711, 2);
  expect(north).toBeCloseTo(311.333, 2);
});

it("A corridor is a tube at the middle of its heights", () => {
  const volume = drawingVolume({ ...DRAWING, use: "corridor" }, FRAMES);
  if (volume.kind !== "corridor") throw new Error(volume.kind);
  expect(volume.radius).toBe(15);
  expect(volume.path[0]?.[2]).toBeCloseTo(40, 6);
});

it("There is no volume while the model is not on Earth", () => {
  expect(() => drawingVolume(DRAWING, new Frames({ ...ALIGNMENT, status: "model" }, ORIGIN))).toThrow(
    "aligned",
  );
});

it("A fence is written as missions take it", () => {
  expect(fenceParameter(DRAWING)).toBe("47.3977000,8.5456000;47.4005000,8.5501000;47.4005000,8.5456000");
});
