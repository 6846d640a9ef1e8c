import type { Triple } from "../api/artifacts";
import type { Schemas } from "../api/service";
import type { Frames } from "../geometry/frames";
import type { Drawing } from "../store/scene";
import { strings } from "../strings";

/**
 * The volume of a drawing in the world frame: a prism of its corners, for a corridor a tube around its line.
 *
 * The tube's line is at the middle of the drawing's heights. Throws where the world has no place on Earth.
 */
export function drawingVolume(drawing: Drawing, frames: Frames): Schemas["Prism"] | Schemas["Corridor"] {
  const { use, radius_m, lower_m, upper_m } = drawing;
  if (use === "corridor")
    return { kind: "corridor", path: corners(drawing, frames, (lower_m + upper_m) / 2), radius: radius_m };
  return { kind: "prism", corners: corners(drawing, frames, 0), lower: lower_m, upper: upper_m };
}

/** A fence as missions take it: `latitude,longitude;latitude,longitude;…`, in degrees. */
export function fenceParameter(drawing: Drawing): string {
  return drawing.corners
    .map(({ latitude_deg, longitude_deg }) => `${latitude_deg.toFixed(7)},${longitude_deg.toFixed(7)}`)
    .join(";");
}

function corners(drawing: Drawing, frames: Frames, height_m: number): Triple[] {
  const enu = frames.georeferenced ? frames.enu : null;
  if (enu === null) throw new Error(strings.map.notAligned);
  const altitude_m = enu.origin.altitude_m + height_m;
  return drawing.corners.map((corner) => enu.fromGeodetic({ ...corner, altitude_m }));
}
