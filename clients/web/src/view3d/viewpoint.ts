import type { Quaternion, Triple } from "../api/artifacts";
import type { Camera } from "../geometry/frames";
import {
  add,
  conjugate,
  cross,
  dot,
  length,
  minus,
  multiply,
  quaternionOf,
  rotate,
  times,
  unit,
} from "../geometry/vectors";

/** From where the operator looks: a camera of the model frame, and how far away is what it turns about. */
export interface Viewpoint extends Camera {
  distance: number;
}

const STEEPEST = (89.9 * Math.PI) / 180;

export const forwardOf = (camera: Camera): Triple => rotate(camera.orientation, [0, 0, 1]);

/** What a viewpoint turns about. */
export function targetOf(view: Viewpoint): Triple {
  return add(view.position, times(forwardOf(view), view.distance));
}

/** The rotation about a unit axis. */
export function about(axis: Triple, angle: number): Quaternion {
  const sine = Math.sin(angle / 2);
  return [Math.cos(angle / 2), axis[0] * sine, axis[1] * sine, axis[2] * sine];
}

/** Any unit vector across a unit vector. */
export function across(vector: Triple): Triple {
  const away: Triple = Math.abs(vector[0]) < 0.7 ? [1, 0, 0] : [0, 1, 0];
  return unit(cross(vector, away));
}

/** The orientation that looks at an elevation over the horizon, with a level right side. */
function looking(right: Triple, elevation: number, up: Triple): Quaternion {
  const ahead = cross(up, right);
  const forward = add(times(ahead, Math.cos(elevation)), times(up, Math.sin(elevation)));
  return quaternionOf(right, cross(forward, right), forward);
}

/** The level right side of a camera and the elevation at which it looks. */
function heading(camera: Camera, up: Triple): { right: Triple; elevation: number } {
  const forward = forwardOf(camera);
  const steepness = dot(forward, up);
  let right = cross(forward, up);
  if (length(right) < 1e-3) {
    const aside = rotate(camera.orientation, [1, 0, 0]);
    right = minus(aside, times(up, dot(aside, up)));
  }
  return { right: unit(right), elevation: Math.asin(Math.max(-1, Math.min(1, steepness))) };
}

/** A viewpoint at a position that looks at a target. */
export function lookAt(position: Triple, target: Triple, up: Triple): Viewpoint {
  const forward = minus(target, position);
  let right = cross(forward, up);
  if (length(right) < 1e-6 * length(forward)) right = across(up);
  const elevation = Math.asin(Math.max(-1, Math.min(1, dot(unit(forward), up))));
  return { position, orientation: looking(unit(right), elevation, up), distance: length(forward) };
}

/** Turn about the target, clockwise as seen from above and upwards, in radians. */
export function orbit(view: Viewpoint, yaw: number, pitch: number, up: Triple): Viewpoint {
  const turned = turn(view, yaw, pitch, up);
  return { ...turned, position: minus(targetOf(view), times(forwardOf(turned), view.distance)) };
}

/** Turn on the spot. */
export function turn(view: Viewpoint, yaw: number, pitch: number, up: Triple): Viewpoint {
  const { right, elevation } = heading(view, up);
  const steep = Math.max(-STEEPEST, Math.min(STEEPEST, elevation + pitch));
  return { ...view, orientation: looking(rotate(about(up, -yaw), right), steep, up) };
}

/** Move, in the camera's axes: right, down, forward. */
export function move(view: Viewpoint, by: Triple): Viewpoint {
  return { ...view, position: add(view.position, rotate(view.orientation, by)) };
}

/** Come closer to the target, or go away from it, by a factor of the distance. */
export function zoom(view: Viewpoint, factor: number): Viewpoint {
  const target = targetOf(view);
  const distance = view.distance * factor;
  return { ...view, distance, position: minus(target, times(forwardOf(view), distance)) };
}

/** The viewpoint with the same direction that has a sphere in view. */
export function framing(view: Camera, centre: Triple, radius: number, halfAngle: number): Viewpoint {
  const distance = radius / Math.sin(halfAngle);
  return {
    orientation: view.orientation,
    distance,
    position: minus(centre, times(forwardOf(view), distance)),
  };
}

/** Straight down at a target; `right` is to the right. */
export function fromAbove(target: Triple, distance: number, right: Triple, up: Triple): Viewpoint {
  const level = unit(minus(right, times(up, dot(right, up))));
  return {
    position: add(target, times(up, distance)),
    orientation: looking(level, -STEEPEST, up),
    distance,
  };
}

/** On the way from one viewpoint to another, from 0 to 1. */
export function between(from: Viewpoint, to: Viewpoint, share: number): Viewpoint {
  return {
    position: add(from.position, times(minus(to.position, from.position), share)),
    orientation: slerp(from.orientation, to.orientation, share),
    distance: from.distance * (to.distance / from.distance) ** share,
  };
}

function slerp(from: Quaternion, to: Quaternion, share: number): Quaternion {
  const [w, x, y, z] = multiply(conjugate(from), to);
  const sign = w < 0 ? -1 : 1;
  const sine = Math.hypot(x, y, z);
  if (sine < 1e-9) return to;
  const angle = 2 * Math.atan2(sine, w * sign) * share;
  return multiply(from, about(times([x, y, z], sign / sine), angle));
}
