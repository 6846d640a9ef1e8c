import type { Quaternion, Triple } from "../api/artifacts";
import type { Schemas } from "../api/service";
import { anglesOf, Enu, type Geodetic, isGeodetic, orientationOf } from "./earth";
import { add, conjugate, minus, multiply, rotate, times } from "./vectors";

/** A camera's centre and orientation, frame_from_camera of an OpenCV camera (x right, y down, z forward). */
export interface Camera {
  position: Triple;
  orientation: Quaternion;
}

/** The frames of a snapshot: its model, the world that it is aligned with, and Earth. */
export class Frames {
  /** The ENU frame; null where the scene has no origin on Earth. */
  readonly enu: Enu | null;

  constructor(
    readonly alignment: Schemas["Alignment"],
    origin: Geodetic | null,
  ) {
    this.enu = origin && new Enu(origin);
  }

  /** Whether lengths of the world are metres on Earth. */
  get georeferenced(): boolean {
    return this.enu !== null && this.alignment.status !== "model";
  }

  /** The upward direction of the model; `cameras` is that of its cameras, which counts where nothing tells more. */
  modelUp(cameras: Triple): Triple {
    const { status, rotation_wxyz } = this.alignment;
    return status === "model" ? cameras : rotate(conjugate(rotation_wxyz), [0, 0, 1]);
  }

  worldFromModel(point: Triple): Triple {
    const { scale, rotation_wxyz, translation } = this.alignment;
    return add(times(rotate(rotation_wxyz, point), scale), translation);
  }

  modelFromWorld(point: Triple): Triple {
    const { scale, rotation_wxyz, translation } = this.alignment;
    return times(rotate(conjugate(rotation_wxyz), minus(point, translation)), 1 / scale);
  }

  /** Where a point of the model is on Earth; null where the scene has no place there. */
  geodeticFromModel(point: Triple): Geodetic | null {
    return this.enu?.toGeodetic(this.worldFromModel(point)) ?? null;
  }

  /** The point of the model at a place on Earth; null where the scene has no place there. */
  modelFromGeodetic(place: Geodetic): Triple | null {
    return this.enu && this.modelFromWorld(this.enu.fromGeodetic(place));
  }

  /** The camera of a pose of any frame, in the model frame; null for a place on Earth in a scene without one. */
  cameraInModel(pose: Schemas["FramePose"] | Schemas["VehiclePose"]): Camera | null {
    if (isGeodetic(pose)) {
      const position = this.modelFromGeodetic(pose);
      return position && { position, orientation: this.fromWorld(orientationOf(pose)) };
    }
    if (pose.frame === "model") return { position: pose.position, orientation: pose.orientation_wxyz };
    return {
      position: this.modelFromWorld(pose.position),
      orientation: this.fromWorld(pose.orientation_wxyz),
    };
  }

  /** A camera of the model frame as a vehicle's place and angles; null in a scene without a place on Earth. */
  vehicleOf(camera: Camera): (Geodetic & ReturnType<typeof anglesOf>) | null {
    const place = this.geodeticFromModel(camera.position);
    return place && { ...place, ...anglesOf(multiply(this.alignment.rotation_wxyz, camera.orientation)) };
  }

  private fromWorld(orientation: Quaternion): Quaternion {
    return multiply(conjugate(this.alignment.rotation_wxyz), orientation);
  }
}

/** The pose of a sample of a forecast. A place of the surface has no direction: any does. */
export function poseOf({
  pose,
  position,
}: Schemas["ForecastSample"]): Schemas["FramePose"] | Schemas["VehiclePose"] {
  if (pose) return pose;
  if (position && "latitude_deg" in position) return { ...position, yaw_deg: 0, pitch_deg: 0 };
  const { frame, position: place } = position as Schemas["FramePosition"];
  return { frame: frame === "model" ? "model" : "world", position: place, orientation_wxyz: [1, 0, 0, 0] };
}
