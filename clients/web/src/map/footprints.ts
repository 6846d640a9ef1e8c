import type { PinholeIntrinsics, Triple } from "../api/artifacts";
import type { Camera } from "../geometry/frames";
import { rotate } from "../geometry/vectors";
import { type Ground, meetsGround } from "./ground";
import type { Flat } from "./polygons";

/** Rays towards the horizon end at this many heights above the ground. */
const MOST_HEIGHTS = 5;
/** How many rays go through each side of an image. */
const RAYS = 4;

/**
 * The part of the ground that a camera sees, as corners around it; null for a camera in the ground, or one that sees
 * only what is above its horizon.
 *
 * What hides the ground is not considered. Far ground is left out: beyond five heights of the camera above it.
 */
export function footprintOf(camera: Camera, lens: PinholeIntrinsics, ground: Ground): Flat[] | null {
  const [x, y, z] = camera.position;
  const above = z - (ground.heightAt(x, y) ?? ground.typical);
  if (above <= 0) return null;
  const farthest = MOST_HEIGHTS * above;
  const corners: Flat[] = [];
  let seen = false;
  for (const [u, v] of around(lens)) {
    const ray: Triple = [(u - lens.cx_px) / lens.fx_px, (v - lens.cy_px) / lens.fy_px, 1];
    const direction = rotate(camera.orientation, ray);
    const met = meetsGround(camera.position, direction, ground, farthest);
    if (met !== null) corners.push([met[0], met[1]]);
    else {
      const level = Math.hypot(direction[0], direction[1]);
      if (level > 0)
        corners.push([x + (farthest * direction[0]) / level, y + (farthest * direction[1]) / level]);
    }
    seen ||= met !== null;
  }
  return seen && corners.length >= 3 ? corners : null;
}

/** Places in px around the border of an image. */
function around({ width_px: w, height_px: h }: PinholeIntrinsics): [number, number][] {
  const corners: [number, number][] = [
    [0, 0],
    [w, 0],
    [w, h],
    [0, h],
  ];
  return corners.flatMap(([u, v], i) => {
    const [nextU, nextV] = corners[(i + 1) % 4] as [number, number];
    return Array.from({ length: RAYS }, (_, step): [number, number] => [
      u + ((nextU - u) * step) / RAYS,
      v + ((nextV - v) * step) / RAYS,
    ]);
  });
}

/** A lens for images of another size, of which the focal length is known. */
export function lensOf(width_px: number, height_px: number, focal_length_px: number): PinholeIntrinsics {
  return {
    width_px,
    height_px,
    fx_px: focal_length_px,
    fy_px: focal_length_px,
    cx_px: width_px / 2,
    cy_px: height_px / 2,
  };
}
