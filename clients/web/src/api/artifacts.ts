import { artifactPath } from "./paths";
import { bytes, type Schemas } from "./service";

export type SnapshotCameras = Schemas["SnapshotCameras"];
export type PinholeIntrinsics = Schemas["PinholeIntrinsics"];
export type Triple = SnapshotCameras["centre"];
/** A unit quaternion, w first. */
export type Quaternion = SnapshotCameras["views"][number]["orientation_wxyz"];
/** Heights of the ground on a grid: rows from south to north, columns from west to east. */
export type Terrain = Schemas["Terrain"];

/** Load `cameras.json` of a snapshot. Throws `ServiceError`. */
export function loadCameras(snapshotId: string): Promise<SnapshotCameras> {
  return load<SnapshotCameras>(snapshotId, "cameras.json");
}

/** Load `terrain.json` of a snapshot; null where it has none. Throws `ServiceError`. */
export async function loadTerrain(snapshot: Schemas["Snapshot"]): Promise<Terrain | null> {
  const has = snapshot.artifacts.some(({ name }) => name === "terrain.json");
  return has ? load<Terrain>(snapshot.id, "terrain.json") : null;
}

async function load<T>(snapshotId: string, name: string): Promise<T> {
  const file = await bytes(artifactPath(snapshotId, name));
  return JSON.parse(await file.text()) as T;
}
