import type { Flat } from "./polygons";

/** Values of square cells of the ground, row by row from the south, in a row from the west. */
export interface GroundGrid {
  /** The south-west corner. */
  west: number;
  south: number;
  cell: number;
  columns: number;
  rows: number;
  /** A number for each cell; NaN where there is none. */
  values: Float32Array;
}

const MOST_CELLS_ALONG = 200;

/**
 * How many of the footprints cover each cell of the ground.
 *
 * Cells that none covers count where the footprints surround them, inside of their convex hull, and have no number
 * elsewhere. Null without footprints.
 */
export function overlapOf(footprints: readonly (readonly Flat[])[]): GroundGrid | null {
  const hull = convexHull(footprints.flat());
  if (hull.length < 3) return null;
  const grid = gridAround(hull, MOST_CELLS_ALONG);
  paint(grid, hull, (old) => (Number.isNaN(old) ? 0 : old));
  for (const footprint of footprints) paint(grid, footprint, (old) => (Number.isNaN(old) ? 1 : old + 1));
  return grid;
}

/** The value at a place; NaN where there is none. */
export function valueAt(grid: GroundGrid, [x, y]: Flat): number {
  const [column, row] = [Math.floor((x - grid.west) / grid.cell), Math.floor((y - grid.south) / grid.cell)];
  if (column < 0 || row < 0 || column >= grid.columns || row >= grid.rows) return Number.NaN;
  return grid.values[row * grid.columns + column] as number;
}

/** The share of cells with a number for which a condition holds. */
export function shareOf(grid: GroundGrid, condition: (value: number) => boolean): number {
  const known = grid.values.filter((value) => !Number.isNaN(value));
  return known.length ? known.filter(condition).length / known.length : 0;
}

/**
 * The convex hull of the cells within a reach of a place that hang together with its own, in which a condition holds.
 *
 * Null where it does not hold at the place. Without the reach, a gap along the border would be the whole map.
 */
export function gapAt(
  grid: GroundGrid,
  place: Flat,
  condition: (value: number) => boolean,
  reach: number,
): Flat[] | null {
  const start = [
    Math.floor((place[0] - grid.west) / grid.cell),
    Math.floor((place[1] - grid.south) / grid.cell),
  ];
  if (!condition(valueAt(grid, place))) return null;
  const waiting = [start as [number, number]];
  const found = new Set<number>();
  while (waiting.length) {
    const [column, row] = waiting.pop() as [number, number];
    const index = row * grid.columns + column;
    if (column < 0 || row < 0 || column >= grid.columns || row >= grid.rows || found.has(index)) continue;
    if (!condition(grid.values[index] as number)) continue;
    const [x, y] = [column - (start[0] as number), row - (start[1] as number)];
    if (Math.hypot(x, y) * grid.cell > reach) continue;
    found.add(index);
    waiting.push([column + 1, row], [column - 1, row], [column, row + 1], [column, row - 1]);
  }
  return convexHull(
    [...found].flatMap((index): Flat[] => {
      const x = grid.west + (index % grid.columns) * grid.cell;
      const y = grid.south + Math.floor(index / grid.columns) * grid.cell;
      const { cell } = grid;
      return [[x, y], [x + cell, y], [x, y + cell], [x + cell, y + cell]]; // biome-ignore format: one cell
    }),
  );
}

/** Cells over the bounds of points, without numbers. */
export function gridAround(points: readonly Flat[], cellsAlong: number, cell?: number): GroundGrid {
  const xs = points.map((point) => point[0]);
  const ys = points.map((point) => point[1]);
  const [west, south] = [Math.min(...xs), Math.min(...ys)];
  const [width, height] = [Math.max(...xs) - west, Math.max(...ys) - south];
  const side = Math.max(cell ?? 0, width / cellsAlong, height / cellsAlong, 1e-9);
  const [columns, rows] = [Math.ceil(width / side) + 1, Math.ceil(height / side) + 1];
  const values = new Float32Array(columns * rows).fill(Number.NaN);
  return { west: west - side / 2, south: south - side / 2, cell: side, columns, rows, values };
}

function paint(grid: GroundGrid, polygon: readonly Flat[], change: (old: number) => number): void {
  const xs = polygon.map((point) => (point[0] - grid.west) / grid.cell);
  const ys = polygon.map((point) => (point[1] - grid.south) / grid.cell);
  const firstRow = Math.max(0, Math.floor(Math.min(...ys)));
  const lastRow = Math.min(grid.rows - 1, Math.ceil(Math.max(...ys)));
  for (let row = firstRow; row <= lastRow; row++) {
    const middle = row + 0.5;
    const crossings: number[] = [];
    xs.forEach((x, i) => {
      const next = (i + 1) % xs.length;
      const [y, nextX, nextY] = [ys[i] as number, xs[next] as number, ys[next] as number];
      if (y > middle !== nextY > middle) crossings.push(x + ((nextX - x) * (middle - y)) / (nextY - y));
    });
    crossings.sort((a, b) => a - b);
    for (let i = 0; i + 1 < crossings.length; i += 2) {
      const from = Math.max(0, Math.ceil((crossings[i] as number) - 0.5));
      const to = Math.min(grid.columns - 1, Math.ceil((crossings[i + 1] as number) - 0.5) - 1);
      for (let column = from; column <= to; column++) {
        const index = row * grid.columns + column;
        grid.values[index] = change(grid.values[index] as number);
      }
    }
  }
}

/** The corners of the smallest convex polygon around points, counter-clockwise (Andrew's monotone chain). */
export function convexHull(points: readonly Flat[]): Flat[] {
  const sorted = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = (ordered: Flat[]): Flat[] => {
    const chain: Flat[] = [];
    for (const point of ordered) {
      while (chain.length >= 2) {
        const [a, b] = [chain.at(-2) as Flat, chain.at(-1) as Flat];
        if ((b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0]) > 0) break;
        chain.pop();
      }
      chain.push(point);
    }
    return chain.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}
