import type { SnapshotCameras } from "../api/artifacts";
import type { Camera } from "../geometry/frames";
import { carried } from "./carry";
import type { LastView } from "./view-state";

/** One pose in the frames of two snapshots: that of a photograph, or of a view; null where one of them has none. */
export function posesIn(
  before: SnapshotCameras,
  after: SnapshotCameras,
  image: string | null,
  seen: LastView | null,
): [Camera, Camera] | null {
  const found = seen?.cameras
    ? { view: seen.view, in: seen.cameras }
    : (ofImage(image, after) ?? ofImage(image, before));
  if (!found) return null;
  const [left, right] = [before, after].map((cameras) =>
    cameras === found.in ? found.view : carried({ ...found.view, distance: 1 }, found.in, cameras),
  );
  return left && right ? [left, right] : null;
}

function ofImage(
  image: string | null,
  cameras: SnapshotCameras,
): { view: Camera; in: SnapshotCameras } | null {
  const view = cameras.views.find((one) => one.image === image);
  return view ? { view: { position: view.position, orientation: view.orientation_wxyz }, in: cameras } : null;
}
