import { describe, expect, it } from "vitest";
import type { PinholeIntrinsics, Quaternion, Triple } from "../api/artifacts";
import { fitted, imageCorners, project, projectionMatrix } from "./lens";

const CAMERA: PinholeIntrinsics = {
  width_px: 640,
  height_px: 480,
  fx_px: 416,
  fy_px: 420,
  cx_px: 310,
  cy_px: 250,
};
const POSE = { position: [1, 2, 3] as Triple, orientation: [0.5, -0.5, 0.5, -0.5] as Quaternion };

describe("a lens", () => {
  it("shows the whole image in the middle of a wide canvas", () => {
    const lens = fitted(CAMERA, 1280, 480);
    expect(lens.frame).toEqual({ left: 320, top: 0, width: 640, height: 480 });
    expect([lens.fx, lens.cx, lens.cy]).toEqual([416, 630, 250]);
  });

  it("projects as the camera does: x right, y down", () => {
    const lens = fitted(CAMERA, 640, 480);
    const identity = { position: [0, 0, 0] as Triple, orientation: [1, 0, 0, 0] as Quaternion };
    expect(project([0, 0, 2], identity, lens)).toEqual([310, 250, 2]);
    const [x, y] = project([1, 1, 2], identity, lens) as Triple;
    expect([x, y]).toEqual([310 + 208, 250 + 210]);
    expect(project([0, 0, -1], identity, lens)).toBeNull();
  });

  it("is the inverse of the rays through the image's corners", () => {
    const lens = fitted(CAMERA, 900, 600);
    const corners = imageCorners(POSE, CAMERA, 0.7).map((corner) => project(corner, POSE, lens) as Triple);
    const { left, top, width, height } = lens.frame;
    const expected = [
      [left, top],
      [left + width, top],
      [left + width, top + height],
      [left, top + height],
    ];
    corners.forEach(([x, y, depth], index) => {
      expect(x).toBeCloseTo(expected[index]?.[0] as number, 6);
      expect(y).toBeCloseTo(expected[index]?.[1] as number, 6);
      expect(depth).toBeCloseTo(0.7, 9);
    });
  });

  it("is the same in OpenGL's clip space", () => {
    const [width, height] = [900, 600];
    const lens = fitted(CAMERA, width, height);
    const rows = projectionMatrix(lens, width, height, 0.1, 100);
    const point = [0.3, -0.2, 1.7] as const; // x right, y down, z forward
    const eye = [point[0], -point[1], -point[2], 1];
    const clip = [0, 1, 2, 3].map((row) =>
      eye.reduce((sum, part, column) => sum + part * (rows[row * 4 + column] as number), 0),
    ) as [number, number, number, number];
    const identity = { position: [0, 0, 0] as Triple, orientation: [1, 0, 0, 0] as Quaternion };
    const [x, y] = project([...point], identity, lens) as Triple;
    expect((clip[0] / clip[3] + 1) * (width / 2)).toBeCloseTo(x, 6);
    expect((1 - clip[1] / clip[3]) * (height / 2)).toBeCloseTo(y, 6);
    expect(Math.abs(clip[2] / clip[3])).toBeLessThan(1);
  });
});
