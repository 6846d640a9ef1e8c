import type { Terrain, Triple } from "../api/artifacts";
import { heightIn, isHole } from "../geometry/terrain";
import type { MapFrame } from "./map-frame";

/** The height of the ground in the frame of the map. */
export interface Ground {
  /** The height at a place; null where it is not known. */
  heightAt: (x: number, y: number) => number | null;
  /** A height that is typical of it, where one place is not known. */
  typical: number;
}

/** Ground that is level. */
export function levelGround(height: number): Ground {
  return { heightAt: () => height, typical: height };
}

/** The ground of a terrain; null when it has holes only, or the map is not on Earth. */
export function groundOf(terrain: Terrain, frame: MapFrame): Ground | null {
  const { enu } = frame;
  const known = terrain.heights_m.filter((height) => !isHole(height)).sort((a, b) => a - b);
  const middle = known[known.length >> 1];
  if (enu === null || middle === undefined) return null;
  const base = enu.origin.altitude_m;
  return {
    typical: middle - base,
    heightAt: (x, y) => {
      const height = heightIn(terrain, enu.toGeodetic([x, y, middle - base]));
      return height === null ? null : height - base;
    },
  };
}

/**
 * Where a ray from above meets the ground; null when it goes up or meets it beyond `farthest` on the level.
 *
 * It meets level ground at the height below it, again and again, which finds gentle slopes in a few rounds.
 */
export function meetsGround(
  from: Triple,
  direction: Triple,
  ground: Ground,
  farthest: number,
): Triple | null {
  if (direction[2] >= 0) return null;
  let height = ground.typical;
  let point: Triple = from;
  for (let round = 0; round < 8; round++) {
    const along = (height - from[2]) / direction[2];
    point = [from[0] + along * direction[0], from[1] + along * direction[1], height];
    if (along <= 0 || Math.hypot(point[0] - from[0], point[1] - from[1]) > farthest) return null;
    const found = ground.heightAt(point[0], point[1]) ?? ground.typical;
    if (Math.abs(found - height) < 1e-3) break;
    height = found;
  }
  return point;
}
