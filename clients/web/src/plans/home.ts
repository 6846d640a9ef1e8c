import { artifactPath } from "../api/paths";
import { bytes, type Schemas } from "../api/service";
import type { Place } from "../store/scene";

const HOLE = -32768;

/** The ground of a snapshot by its points. Throws `ServiceError` where it has none. */
export async function loadTerrain(snapshotId: string): Promise<Schemas["Terrain"]> {
  const file = await bytes(artifactPath(snapshotId, "terrain.json"));
  return JSON.parse(await file.text()) as Schemas["Terrain"];
}

/** The height of a terrain at its grid's nearest place, in its datum; null outside of it and in holes. */
export function heightAt(terrain: Schemas["Terrain"], place: Place): number | null {
  const row = Math.round((place.latitude_deg - terrain.south_deg) / terrain.latitude_step_deg);
  const column = Math.round((place.longitude_deg - terrain.west_deg) / terrain.longitude_step_deg);
  if (column < 0 || column >= terrain.columns) return null;
  const height = terrain.heights_m[row * terrain.columns + column];
  return height === undefined || height === HOLE ? null : height;
}
