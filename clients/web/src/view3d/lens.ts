import type { PinholeIntrinsics, Triple } from "../api/artifacts";
import type { Camera } from "../geometry/frames";
import { conjugate, minus, rotate } from "../geometry/vectors";

/** How a camera's view lies on a canvas, in px of it: focal lengths, the principal point, and the image's frame. */
export interface Lens {
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  frame: { left: number; top: number; width: number; height: number };
}

/** A camera for scenes that have no model yet. */
export const DEFAULT_INTRINSICS: PinholeIntrinsics = {
  width_px: 640,
  height_px: 480,
  fx_px: 480,
  fy_px: 480,
  cx_px: 320,
  cy_px: 240,
};

/** The lens that shows a camera's whole image as large as a canvas allows, in its middle. */
export function fitted(camera: PinholeIntrinsics, width: number, height: number): Lens {
  const scale = Math.min(width / camera.width_px, height / camera.height_px);
  const frame = {
    left: (width - camera.width_px * scale) / 2,
    top: (height - camera.height_px * scale) / 2,
    width: camera.width_px * scale,
    height: camera.height_px * scale,
  };
  return {
    fx: camera.fx_px * scale,
    fy: camera.fy_px * scale,
    cx: frame.left + camera.cx_px * scale,
    cy: frame.top + camera.cy_px * scale,
    frame,
  };
}

/** Where a point is on the canvas, and its depth; null behind the camera. */
export function project(point: Triple, camera: Camera, lens: Lens): [number, number, number] | null {
  const [x, y, depth] = rotate(conjugate(camera.orientation), minus(point, camera.position));
  if (depth <= 1e-9) return null;
  return [lens.cx + (lens.fx * x) / depth, lens.cy + (lens.fy * y) / depth, depth];
}

/** The projection matrix of OpenGL, by rows, for a camera that looks along -z with y up. */
export function projectionMatrix(
  lens: Lens,
  width: number,
  height: number,
  near: number,
  far: number,
): number[] {
  return [
    [(2 * lens.fx) / width, 0, 1 - (2 * lens.cx) / width, 0],
    [0, (2 * lens.fy) / height, (2 * lens.cy) / height - 1, 0],
    [0, 0, -(far + near) / (far - near), (-2 * far * near) / (far - near)],
    [0, 0, -1, 0],
  ].flat();
}

/** The corners of a camera's image at a depth, in the frame of its pose: top left, then clockwise. */
export function imageCorners(camera: Camera, intrinsics: PinholeIntrinsics, depth: number): Triple[] {
  const { width_px, height_px, fx_px, fy_px, cx_px, cy_px } = intrinsics;
  const pixels = [
    [0, 0],
    [width_px, 0],
    [width_px, height_px],
    [0, height_px],
  ] as const;
  return pixels.map(([u, v]) => {
    const ray: Triple = [(depth * (u - cx_px)) / fx_px, (depth * (v - cy_px)) / fy_px, depth];
    const turned = rotate(camera.orientation, ray);
    return turned.map((part, axis) => part + (camera.position[axis] as number)) as Triple;
  });
}
