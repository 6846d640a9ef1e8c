import { convexHull, type GroundGrid, gridAround } from "./ground-grid";
import { areaOf, type Flat } from "./polygons";

const MOST_CELLS_ALONG = 150;

/** What is not known over the ground: in each cell a share, from 0 for the best known sample to 1 for the least. */
export interface ForecastGrid {
  grid: GroundGrid;
  unit: "variance" | "dB";
  /** The samples' values at the shares 0 and 1. */
  best: number;
  worst: number;
}

/** One view, or place, of a forecast. */
export interface Sample {
  at: Flat;
  variance: number;
  psnr_db: number | null;
}

/** Samples as cells about as large as their distance; in dB where all have it. Null for fewer than three. */
export function forecastGrid(samples: readonly Sample[]): ForecastGrid | null {
  if (samples.length < 3) return null;
  const calibrated = samples.every((one) => one.psnr_db !== null);
  const values = samples.map((one) => (calibrated ? (one.psnr_db as number) : one.variance));
  const [least, most] = [Math.min(...values), Math.max(...values)];
  const [best, worst] = calibrated ? [most, least] : [least, most];
  const places = samples.map((one) => one.at);
  const grid = gridAround(places, MOST_CELLS_ALONG, spacingOf(places));
  const counts = new Uint16Array(grid.values.length);
  const sums = new Float64Array(grid.values.length);
  places.forEach(([x, y], i) => {
    const column = Math.floor((x - grid.west) / grid.cell);
    const index = Math.floor((y - grid.south) / grid.cell) * grid.columns + column;
    counts[index] = (counts[index] as number) + 1;
    sums[index] = (sums[index] as number) + ((values[i] as number) - best) / (worst - best || 1);
  });
  counts.forEach((count, index) => {
    if (count) grid.values[index] = (sums[index] as number) / count;
  });
  fillBetween(grid);
  return { grid, unit: calibrated ? "dB" : "variance", best, worst };
}

/** The value of a share. */
export function forecastValue({ best, worst }: ForecastGrid, share: number): number {
  return best + share * (worst - best);
}

/** The distance of samples that lie evenly in their hull. */
function spacingOf(places: readonly Flat[]): number {
  const cells = (Math.sqrt(places.length) - 1) ** 2;
  return Math.sqrt(areaOf(convexHull(places)) / Math.max(1, cells));
}

/** Give cells without a sample the mean of three or more neighbours. */
function fillBetween({ values, columns, rows }: GroundGrid): void {
  const before = values.slice();
  before.forEach((value, index) => {
    if (!Number.isNaN(value)) return;
    const [column, row] = [index % columns, Math.floor(index / columns)];
    const around = [
      [-1, 0],
      [1, 0],
      [0, -1],
      [0, 1],
    ].flatMap(([dx, dy]) => {
      const [x, y] = [column + (dx as number), row + (dy as number)];
      const inside = x >= 0 && y >= 0 && x < columns && y < rows;
      const found = inside ? (before[y * columns + x] as number) : Number.NaN;
      return Number.isNaN(found) ? [] : [found];
    });
    if (around.length >= 3) values[index] = around.reduce((sum, one) => sum + one, 0) / around.length;
  });
}
