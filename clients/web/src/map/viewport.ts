import { roundLength } from "../components/format";
import type { Flat } from "./polygons";

/** Room around what is shown; the tools lie over the upper edge. */
const MARGIN_PX = 48;
const UPPER_MARGIN_PX = 72;

/** The part of the plane that the map shows: its middle, and how many px a unit has. North is up. */
export interface Viewport {
  centre: Flat;
  pxPerUnit: number;
  width: number;
  height: number;
}

export function toScreen(view: Viewport, [x, y]: Flat): Flat {
  return [
    view.width / 2 + (x - view.centre[0]) * view.pxPerUnit,
    view.height / 2 - (y - view.centre[1]) * view.pxPerUnit,
  ];
}

export function fromScreen(view: Viewport, [u, v]: Flat): Flat {
  return [
    view.centre[0] + (u - view.width / 2) / view.pxPerUnit,
    view.centre[1] - (v - view.height / 2) / view.pxPerUnit,
  ];
}

/** The view moved by px: what was under the pointer follows it. */
export function moved(view: Viewport, du: number, dv: number): Viewport {
  const [x, y] = view.centre;
  return { ...view, centre: [x - du / view.pxPerUnit, y + dv / view.pxPerUnit] };
}

/** The view magnified around a place of the screen, which keeps what it shows. */
export function zoomed(view: Viewport, factor: number, at: Flat): Viewport {
  const pxPerUnit = Math.min(1e5, Math.max(1e-4, view.pxPerUnit * factor));
  const before = fromScreen(view, at);
  const after = fromScreen({ ...view, pxPerUnit }, at);
  const centre: Flat = [view.centre[0] + before[0] - after[0], view.centre[1] + before[1] - after[1]];
  return { ...view, centre, pxPerUnit };
}

/** The view that shows all points, with a margin; at least `least` units of them. */
export function fitted(view: Viewport, points: readonly Flat[], least: number): Viewport {
  if (!points.length) return view;
  const xs = points.map((point) => point[0]);
  const ys = points.map((point) => point[1]);
  const [west, east] = [Math.min(...xs), Math.max(...xs)];
  const [south, north] = [Math.min(...ys), Math.max(...ys)];
  const along = Math.max(1, view.width - 2 * MARGIN_PX) / Math.max(least, east - west);
  const up = Math.max(1, view.height - UPPER_MARGIN_PX - MARGIN_PX) / Math.max(least, north - south);
  const pxPerUnit = Math.min(along, up);
  const lower = (UPPER_MARGIN_PX - MARGIN_PX) / 2 / pxPerUnit;
  return { ...view, centre: [(west + east) / 2, (south + north) / 2 + lower], pxPerUnit };
}

/** A round length that is at most `most` px long. */
export function scaleLength(view: Viewport, most: number): number {
  return roundLength(most / view.pxPerUnit);
}
