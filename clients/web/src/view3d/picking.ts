import type { Camera } from "../geometry/frames";
import { add, times } from "../geometry/vectors";
import type { Layer, Marker } from "./content";
import { type Lens, project } from "./lens";
import { forwardOf } from "./viewpoint";

const REACH_PX = 14;

/**
 * The marker at a place of the canvas: of those within reach the nearest there, of equal ones the nearest to the eye.
 *
 * A frustum of depth `size` is picked at its tip, in its middle and in the middle of its image.
 */
export function pick(
  markers: readonly Marker[],
  shown: ReadonlySet<Layer>,
  size: number,
  view: Camera,
  lens: Lens,
  at: readonly [number, number],
): Marker | null {
  let best: Marker | null = null;
  let least = Number.POSITIVE_INFINITY;
  for (const marker of markers) {
    if (!shown.has(marker.layer)) continue;
    for (const point of pointsOf(marker, size)) {
      const place = project(point, view, lens);
      if (!place) continue;
      const away = Math.hypot(place[0] - at[0], place[1] - at[1]);
      if (away > REACH_PX) continue;
      // Within a few pixels, what is in front hides what is behind.
      const cost = Math.round(away / 5) * 1e9 + place[2];
      if (cost < least) {
        least = cost;
        best = marker;
      }
    }
  }
  return best;
}

function pointsOf(marker: Marker, size: number) {
  if (!marker.orientation) return [marker.position];
  const ahead = forwardOf({ position: marker.position, orientation: marker.orientation });
  return [0, 0.5, 1].map((share) => add(marker.position, times(ahead, size * share)));
}

/** Markers on the canvas in the order of the keyboard: as they are listed, those that can be selected. */
export function pickable(
  markers: readonly Marker[],
  shown: ReadonlySet<Layer>,
  view: Camera,
  lens: Lens,
  width: number,
  height: number,
): Marker[] {
  return markers.filter((marker) => {
    if (!marker.selects || !shown.has(marker.layer)) return false;
    const place = project(marker.position, view, lens);
    return place !== null && place[0] >= 0 && place[0] <= width && place[1] >= 0 && place[1] <= height;
  });
}
