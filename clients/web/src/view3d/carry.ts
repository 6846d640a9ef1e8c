import type { SnapshotCameras, Triple } from "../api/artifacts";
import { add, conjugate, length, minus, multiply, rotate, times } from "../geometry/vectors";
import type { Viewpoint } from "./viewpoint";

/**
 * The viewpoint in the frame of the next model from which it shows what it showed in the one before.
 *
 * Models may differ by a similarity. It goes along with the nearest camera that both have; null when they share fewer than
 * two.
 */
export function carried(view: Viewpoint, before: SnapshotCameras, next: SnapshotCameras): Viewpoint | null {
  const byImage = new Map(next.views.map((one) => [one.image, one]));
  const shared = before.views.flatMap((one) => {
    const other = byImage.get(one.image);
    return other ? [{ from: one, to: other }] : [];
  });
  if (shared.length < 2) return null;
  const scale = spread(shared.map(({ to }) => to.position)) / spread(shared.map(({ from }) => from.position));
  if (!Number.isFinite(scale) || scale === 0) return null;
  const away = ({ from }: (typeof shared)[number]) => length(minus(from.position, view.position));
  const { from, to } = shared.reduce((best, one) => (away(one) < away(best) ? one : best));
  const turn = multiply(to.orientation_wxyz, conjugate(from.orientation_wxyz));
  return {
    position: add(to.position, times(rotate(turn, minus(view.position, from.position)), scale)),
    orientation: multiply(turn, view.orientation),
    distance: view.distance * scale,
  };
}

/** The mean distance of positions from their mean. */
function spread(positions: readonly Triple[]): number {
  const mean = times(positions.reduce(add), 1 / positions.length);
  return positions.reduce((sum, one) => sum + length(minus(one, mean)), 0) / positions.length;
}
