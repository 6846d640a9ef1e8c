import type { Triple } from "../api/artifacts";
import type { MapFrame } from "./map-frame";

/** The height of the ground in the frame of the map. */
export interface Ground {
  /** The height at a place; null where it is not known. */
  heightAt: (x: number, y: number) => number | null;
  /** A height that is typical of it, where one place is not known. */
  typical: number;
}

/** The artifact `terrain.json`: heights on a grid, rows from south to north, columns from west to east. */
export interface Terrain {
  south_deg: number;
  west_deg: number;
  latitude_step_deg: number;
  longitude_step_deg: number;
  columns: number;
  heights_m: number[];
}

/** Heights below this are holes. */
const LOWEST_M = -12_000;

/** Ground that is level. */
export function levelGround(height: number): Ground {
  return { heightAt: () => height, typical: height };
}

/** The ground of a terrain; null when it has holes only, or the map is not on Earth. */
export function groundOf(terrain: Terrain, frame: MapFrame): Ground | null {
  const { enu } = frame;
  const known = terrain.heights_m.filter((height) => height >= LOWEST_M).sort((a, b) => a - b);
  const middle = known[known.length >> 1];
  if (enu === null || middle === undefined) return null;
  const base = enu.origin.altitude_m;
  return {
    typical: middle - base,
    heightAt: (x, y) => {
      const { latitude_deg, longitude_deg } = enu.toGeodetic([x, y, middle - base]);
      const height = heightIn(terrain, latitude_deg, longitude_deg);
      return height === null ? null : height - base;
    },
  };
}

/** The bilinear height of a terrain; null in a hole and outside. */
function heightIn(terrain: Terrain, latitude_deg: number, longitude_deg: number): number | null {
  const { columns, heights_m } = terrain;
  const row = (latitude_deg - terrain.south_deg) / terrain.latitude_step_deg;
  const east_deg = ((longitude_deg - terrain.west_deg + 450) % 360) - 90;
  const column = east_deg / terrain.longitude_step_deg;
  const [south, west] = [Math.floor(row), Math.floor(column)];
  if (south < 0 || west < 0 || west >= columns - 1 || (south + 2) * columns > heights_m.length) return null;
  const [up, right] = [row - south, column - west];
  const at = south * columns + west;
  const corners = [at, at + 1, at + columns, at + columns + 1].map((index) => heights_m[index] as number);
  if (corners.some((height) => height < LOWEST_M)) return null;
  const [sw, se, nw, ne] = corners as [number, number, number, number];
  return (1 - up) * ((1 - right) * sw + right * se) + up * ((1 - right) * nw + right * ne);
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
