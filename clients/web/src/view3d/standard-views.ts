import type { SnapshotCameras } from "../api/artifacts";
import type { Camera } from "../geometry/frames";
import { add, cross, dot, length, minus, rotate, times } from "../geometry/vectors";
import type { Content } from "./content";
import type { Lens } from "./lens";
import { across, forwardOf, framing, fromAbove, lookAt, move, turn, type Viewpoint } from "./viewpoint";

/** A step behind the first photograph, which looks at what was photographed; before a model from the south. */
export function firstView(
  content: Content,
  cameras: SnapshotCameras | null,
  frustum: number,
  lens: Lens,
): Viewpoint {
  const first = cameras?.views[0];
  if (first) {
    const camera = turningView(
      { position: first.position, orientation: first.orientation_wxyz },
      content,
      frustum,
    );
    return move(turn(camera, 0, 0, content.up), [0, 0, -2 * frustum]);
  }
  const { up, north } = content;
  return wholeView(content, lookAt([0, 0, 0], add(north ?? across(up), times(up, -0.6)), up), lens);
}

/** The sphere around a box has air in its corners. */
const TIGHT = 0.75;

/** Everything, in the direction of a camera. */
export function wholeView({ centre, radius }: Content, camera: Camera, lens: Lens): Viewpoint {
  return framing(camera, centre, radius * TIGHT, halfAngle(lens));
}

/** Everything from above, north at the top where it is known; else what was on the right stays there. */
export function topView({ up, north, centre, radius }: Content, camera: Camera, lens: Lens): Viewpoint {
  const right = north ? cross(north, up) : rotate(camera.orientation, [1, 0, 0]);
  const level = length(minus(right, times(up, dot(right, up)))) > 1e-3 ? right : across(up);
  return fromAbove(centre, (radius * TIGHT) / Math.sin(halfAngle(lens)), level, up);
}

/** The viewpoint of a camera, which turns about what is ahead of it as far away as the middle of the model. */
export function turningView(camera: Camera, content: Content, least: number): Viewpoint {
  const depth = dot(minus(content.centre, camera.position), forwardOf(camera));
  return { ...camera, distance: Math.max(depth, least) };
}

/** Half the angle of view across the narrower side of a camera's image. */
export function halfAngle({ frame, fx, fy }: Lens): number {
  return Math.min(Math.atan(frame.width / (2 * fx)), Math.atan(frame.height / (2 * fy)));
}
