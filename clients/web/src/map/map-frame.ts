import type { Quaternion, Triple } from "../api/artifacts";
import type { Schemas } from "../api/service";
import { Enu, type Geodetic, isGeodetic, orientationOf } from "../geometry/earth";
import { type Camera, Frames } from "../geometry/frames";
import { cross, dot, length, multiply, rotate, unit } from "../geometry/vectors";

type Pose = Schemas["FramePose"] | Schemas["VehiclePose"];
const UPRIGHT: Quaternion = [1, 0, 0, 0];

/**
 * The frame of the map, whose x and y are level and z is up.
 *
 * On Earth it is the scene's ENU frame, in metres, also before there is a model. Elsewhere it is the world frame or,
 * where there is none, the model frame turned upright.
 */
export class MapFrame {
  readonly enu: Enu | null;
  /** Whether lengths are metres. */
  readonly metric: boolean;
  private readonly upright: Quaternion;

  /** `up` is the upward direction of the model, null before there is one. */
  constructor(
    private readonly frames: Frames | null,
    private readonly origin: Geodetic | null,
    up: Triple | null,
  ) {
    const aligned = frames !== null && frames.alignment.status !== "model";
    this.enu = origin && new Enu(origin);
    this.metric = this.enu !== null || aligned;
    this.upright = aligned || up === null ? UPRIGHT : turnFrom(unit(up), [0, 0, 1]);
  }

  /** Where a camera of the model is; null while the model has no place on Earth. */
  ofModel(camera: Camera, frames: Frames | null = this.frames): Camera | null {
    if (frames === null || (this.enu !== null && !frames.georeferenced)) return null;
    return {
      position: rotate(this.upright, frames.worldFromModel(camera.position)),
      orientation: multiply(this.upright, multiply(frames.alignment.rotation_wxyz, camera.orientation)),
    };
  }

  /** Where a pose is; `alignment` is that of its snapshot. Null for one that has no place on this map. */
  ofPose(pose: Pose, alignment: Schemas["Alignment"] | null = null): Camera | null {
    if (isGeodetic(pose)) {
      const position = this.ofPlace(pose);
      return position && { position, orientation: orientationOf(pose) };
    }
    const frames = alignment ? new Frames(alignment, this.origin) : this.frames;
    const camera = { position: pose.position, orientation: pose.orientation_wxyz };
    if (pose.frame === "model") return this.ofModel(camera, frames);
    if (this.enu !== null && !frames?.georeferenced) return null;
    return {
      position: rotate(this.upright, camera.position),
      orientation: multiply(this.upright, camera.orientation),
    };
  }

  /** Where a point of the world is; null while the world has no place on this map. */
  ofWorld(point: Triple): Triple | null {
    return this.enu !== null && !this.frames?.georeferenced ? null : rotate(this.upright, point);
  }

  ofPlace(place: Geodetic): Triple | null {
    return this.enu?.fromGeodetic(place) ?? null;
  }

  /** The place on Earth of a point; null where the scene has none. */
  placeOf(point: Triple): Geodetic | null {
    return this.enu?.toGeodetic(point) ?? null;
  }
}

/** The shortest rotation from one direction to another. */
function turnFrom(from: Triple, to: Triple): Quaternion {
  const axis = cross(from, to);
  const half = Math.atan2(length(axis), dot(from, to)) / 2;
  if (length(axis) < 1e-9) return half < 1 ? UPRIGHT : [0, 1, 0, 0];
  const [x, y, z] = unit(axis);
  const sine = Math.sin(half);
  return [Math.cos(half), x * sine, y * sine, z * sine];
}
