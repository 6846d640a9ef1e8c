import { type Schemas, send } from "../api/service";
import { Enu, type Geodetic } from "../geometry/earth";
import { length, minus } from "../geometry/vectors";
import {
  isFlown,
  type MissionCall,
  type MissionForm,
  type MissionMaterial,
  missionCall,
} from "./mission-form";

/** A view that a mission leaves out, and why; the service gives the first reasons only. */
export interface LeftOut {
  id: string;
  reason: string;
}

/** A file of a mission: the whole one, or a part that one battery flies. */
export interface MissionFile {
  name: string;
  content: Blob;
  parts: number;
  leftOut: readonly LeftOut[];
}

/** A file with what is flown with it; null where the format has no route. */
export interface MissionPart extends MissionFile {
  route: Route | null;
}

export interface Route {
  views: number;
  length_m: number;
}

/** All files of a mission, in order: those of each vehicle of a plan. Throws `ServiceError` and `FormError`. */
export async function missionParts(
  form: MissionForm,
  material: MissionMaterial,
  signal: AbortSignal,
): Promise<MissionPart[]> {
  const vehicles = form.source === "plan" && form.vehicle === "" ? flying(material.plan) : [];
  if (vehicles.length < 2)
    return partsOfOne({ ...form, vehicle: vehicles[0] ?? form.vehicle }, material, signal);
  const files: MissionPart[] = [];
  for (const vehicle of vehicles) {
    const parts = await partsOfOne({ ...form, vehicle }, material, signal);
    files.push(...parts.map((part) => ({ ...part, name: `vehicle-${vehicle}-${part.name}` })));
  }
  return files;
}

/** The numbers of the vehicles that a plan needs. */
export function flying(plan: Schemas["Plan"] | null): string[] {
  const tours = plan?.tours.filter(({ stops }) => stops.length > 0) ?? [];
  return tours.map(({ vehicle }) => String(vehicle));
}

/** The views that files leave out, each once. */
export function allLeftOut(files: readonly MissionFile[]): LeftOut[] {
  const byId = new Map(files.flatMap(({ leftOut }) => leftOut).map((one) => [one.id, one]));
  return [...byId.values()];
}

async function partsOfOne(
  form: MissionForm,
  material: MissionMaterial,
  signal: AbortSignal,
): Promise<MissionPart[]> {
  const parts: MissionPart[] = [];
  for (let part = 1; part <= (parts[0]?.parts ?? 1); part++) {
    const file = await missionFile(missionCall(form, material, part), signal);
    const route = isFlown(form.format) ? await missionRoute(form, material, part, signal) : null;
    parts.push({ ...file, route });
  }
  return parts;
}

async function missionFile(call: MissionCall, signal: AbortSignal): Promise<MissionFile> {
  const response = await send(call.path, {
    signal,
    ...(call.body && {
      method: "POST",
      headers: { "Content-Type": "application/json" },
      body: JSON.stringify(call.body),
    }),
  });
  const { headers } = response;
  return {
    name: fileName(headers.get("Content-Disposition")),
    content: await response.blob(),
    parts: Number(headers.get("Mission-Parts") ?? 1),
    leftOut: leftOutOf(headers),
  };
}

/** The name of a file in a header; `mission` where there is none. */
export function fileName(disposition: string | null): string {
  return /filename="([^"]+)"/.exec(disposition ?? "")?.[1] ?? "mission";
}

/** The views that headers name as left out. */
export function leftOutOf(headers: Headers): LeftOut[] {
  const ids = headers.get("Left-Out")?.split(",") ?? [];
  const reasons = JSON.parse(headers.get("Left-Out-Reasons") ?? "[]") as string[];
  return ids.map((id, index) => ({ id, reason: reasons[index] ?? "" }));
}

/** The route of a part, from the same mission as GeoJSON. */
async function missionRoute(
  form: MissionForm,
  material: MissionMaterial,
  part: number,
  signal: AbortSignal,
): Promise<Route> {
  const datum = form.home && form.altitude ? ("takeoff" as const) : ("" as const);
  const call = missionCall({ ...form, format: "geojson", aboveGround: false, datum }, material, part);
  const { content } = await missionFile(call, signal);
  return routeOf(JSON.parse(await content.text()) as MissionMap, form.finish === "return");
}

/** A mission as GeoJSON, as far as its route needs it. */
export interface MissionMap {
  features: readonly {
    geometry: { coordinates: readonly unknown[] };
    properties: { kind: string; altitude_m?: number; altitude_datum?: Schemas["AltitudeDatum"] };
  }[];
}

/** The length of a flight over its waypoints, from home and, if it returns, back to it. */
export function routeOf(map: MissionMap, returns: boolean): Route {
  const places = map.features
    .filter(({ properties }) => properties.altitude_m !== undefined)
    .map(({ geometry, properties }) => placeOf(geometry.coordinates, properties.altitude_m ?? 0));
  const views = map.features.filter(({ properties }) => properties.kind === "view").length;
  const home = map.features.find(({ properties }) => properties.kind === "home");
  const first = places[0];
  if (!first) return { views, length_m: 0 };
  const aboveHome = map.features.some(({ properties }) => properties.altitude_datum === "takeoff");
  const last = places.at(-1) ?? first;
  const ground = (altitude_m: number) =>
    home ? [placeOf(home.geometry.coordinates, aboveHome ? 0 : altitude_m)] : [];
  const way = [...ground(first.altitude_m), ...places, ...(returns ? ground(last.altitude_m) : [])];
  const enu = new Enu(first);
  const points = way.map((place) => enu.fromGeodetic(place));
  const length_m = points
    .slice(1)
    .reduce((sum, point, index) => sum + length(minus(point, points[index] ?? point)), 0);
  return { views, length_m };
}

function placeOf(coordinates: readonly unknown[], altitude_m: number): Geodetic {
  const [longitude_deg, latitude_deg] = coordinates as [number, number];
  return { latitude_deg, longitude_deg, altitude_m };
}

/** How long a route takes at a speed, with the time for which each view is held. */
export function flightTime(route: Route, speed_m_s: number, hold_s: number): number {
  return route.length_m / speed_m_s + route.views * hold_s;
}
