import type { Drawing } from "../store/scene";
import { USES } from "./sketch";

type Place = Drawing["corners"][number];

/** The latitude and longitude that a text gives, in degrees with a comma or spaces between; null for another text. */
export function parsePlace(text: string): Place | null {
  const parts = text
    .trim()
    .replace(/[°;]/g, " ")
    .split(/[\s,]+/)
    .filter(Boolean);
  const [latitude_deg, longitude_deg] = parts.map(Number);
  if (parts.length !== 2 || latitude_deg === undefined || longitude_deg === undefined) return null;
  const known = Math.abs(latitude_deg) <= 90 && Math.abs(longitude_deg) <= 180;
  return known ? { latitude_deg, longitude_deg } : null;
}

/** A place as a text that `parsePlace` reads, to a centimetre. */
export function formatPlace({ latitude_deg, longitude_deg }: Place): string {
  return `${latitude_deg.toFixed(7)}, ${longitude_deg.toFixed(7)}`;
}

/** Drawings as GeoJSON (RFC 7946): polygons, and a line for a corridor. */
export function toGeoJson(drawings: readonly Drawing[]): string {
  const features = drawings.map(({ use, corners, radius_m, lower_m, upper_m }) => {
    const line = corners.map(({ latitude_deg, longitude_deg }) => [longitude_deg, latitude_deg]);
    const geometry =
      use === "corridor"
        ? { type: "LineString", coordinates: line }
        : { type: "Polygon", coordinates: [[...line, line[0]]] };
    return { type: "Feature", properties: { use, radius_m, lower_m, upper_m }, geometry };
  });
  return JSON.stringify({ type: "FeatureCollection", features }, null, 1);
}

/** What GeoJSON has of a drawing: a `use` and heights where its properties give them. */
export type Imported = Pick<Drawing, "use" | "corners"> & Partial<Drawing>;

/** The polygons, without their holes, and lines of GeoJSON; none of a text that is something else. */
export function fromGeoJson(text: string): Imported[] {
  let document: unknown;
  try {
    document = JSON.parse(text);
  } catch {
    return [];
  }
  return featuresOf(document).flatMap((feature) => {
    const { geometry, properties } = feature ?? {};
    return ringsOf(geometry).flatMap((ring) => {
      const corners = cornersOf(ring);
      if (corners === null) return [];
      const line = geometry?.type === "LineString";
      if (!line) corners.pop(); // the first again
      const given = USES.find((use) => use === properties?.["use"] && (use === "corridor") === line);
      return [{ use: given ?? (line ? "corridor" : "area"), corners, ...numbersOf(properties) }];
    });
  });
}

function ringsOf(geometry: Feature["geometry"]): unknown[] {
  const { type, coordinates } = geometry ?? {};
  if (!Array.isArray(coordinates)) return [];
  if (type === "LineString") return [coordinates];
  if (type === "Polygon") return [coordinates[0]];
  if (type === "MultiPolygon") return coordinates.map((polygon: unknown[] | null) => polygon?.[0]);
  return [];
}

interface Feature {
  geometry?: { type?: string; coordinates?: unknown } | null;
  properties?: Record<string, unknown> | null;
}

function featuresOf(document: unknown): (Feature | null)[] {
  const { type, features } = (document ?? {}) as { type?: string; features?: unknown };
  if (type === "FeatureCollection" && Array.isArray(features)) return features as (Feature | null)[];
  if (type === "Feature") return [document as Feature];
  return [{ geometry: document as { type?: string; coordinates?: unknown } }];
}

function cornersOf(ring: unknown): Place[] | null {
  if (!Array.isArray(ring)) return null;
  const places = ring.map((point) => (Array.isArray(point) ? parsePlace(`${point[1]},${point[0]}`) : null));
  return places.includes(null) ? null : (places as Place[]);
}

function numbersOf(properties: Feature["properties"]): Partial<Drawing> {
  const names = ["radius_m", "lower_m", "upper_m"] as const;
  return Object.fromEntries(
    names.flatMap((name) => (Number.isFinite(properties?.[name]) ? [[name, properties?.[name]]] : [])),
  );
}
