import { artifactPath } from "./paths";
import { bytes } from "./service";

export type Triple = [number, number, number];
/** A unit quaternion, w first. */
export type Quaternion = [number, number, number, number];

/** A pinhole camera, in px. */
export interface PinholeIntrinsics {
  width_px: number;
  height_px: number;
  fx_px: number;
  fy_px: number;
  cx_px: number;
  cy_px: number;
}

/** A registered image and its camera's pose, model_from_camera (OpenCV: x right, y down, z forward). */
export interface SnapshotView {
  image: string;
  name: string;
  position: Triple;
  orientation_wxyz: Quaternion;
  counted_share: number;
}

/** The artifact `cameras.json`, in the model frame. */
export interface SnapshotCameras {
  camera: PinholeIntrinsics;
  views: SnapshotView[];
  centre: Triple;
  up: Triple;
  lower: Triple;
  upper: Triple;
}

/** Load `cameras.json` of a snapshot. Throws `ServiceError`. */
export async function loadCameras(snapshotId: string): Promise<SnapshotCameras> {
  const file = await bytes(artifactPath(snapshotId, "cameras.json"));
  return JSON.parse(await file.text()) as SnapshotCameras;
}
