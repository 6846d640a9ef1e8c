import type { Terrain } from "../api/artifacts";
import type { Geodetic } from "./earth";

/** Heights below this are holes. */
const LOWEST_M = -12_000;

/** Whether a height stands for one that is not known. */
export function isHole(height_m: number): boolean {
  return height_m < LOWEST_M;
}

/** The bilinear height of a terrain at a place, above its datum; null beside a hole and outside. */
export function heightIn(
  terrain: Terrain,
  { latitude_deg, longitude_deg }: Omit<Geodetic, "altitude_m">,
): number | null {
  const { columns, heights_m } = terrain;
  const row = (latitude_deg - terrain.south_deg) / terrain.latitude_step_deg;
  const east_deg = ((longitude_deg - terrain.west_deg + 450) % 360) - 90;
  const column = east_deg / terrain.longitude_step_deg;
  const [south, west] = [Math.floor(row), Math.floor(column)];
  if (south < 0 || west < 0 || west >= columns - 1 || (south + 2) * columns > heights_m.length) return null;
  const [up, right] = [row - south, column - west];
  const at = south * columns + west;
  const corners = [at, at + 1, at + columns, at + columns + 1].map((index) => heights_m[index] as number);
  if (corners.some(isHole)) return null;
  const [sw, se, nw, ne] = corners as [number, number, number, number];
  return (1 - up) * ((1 - right) * sw + right * se) + up * ((1 - right) * nw + right * ne);
}
