import { expect, it } from "vitest";
import type { Drawing } from "../store/scene";
import { formatPlace, fromGeoJson, parsePlace, toGeoJson } from "./places";

const CORNERS = [
  { latitude_deg: 47.1, longitude_deg: 8.5 },
  { latitude_deg: 47.2, longitude_deg: 8.5 },
  { latitude_deg: 47.2, longitude_deg: 8.6 },
];
const DRAWINGS: Drawing[] = [
  { id: "1", use: "no-fly", corners: CORNERS, radius_m: 5, lower_m: -10, upper_m: 80 },
  { id: "2", use: "corridor", corners: CORNERS, radius_m: 12, lower_m: 30, upper_m: 30 },
];

it.each(["47.1, 8.5", "47.1 8.5", " 47.1°,8.5° "])("%o is a place", (text) => {
  expect(parsePlace(text)).toEqual(CORNERS[0]);
});

it.each(["47.1", "north, 8", "91, 8", "1, 2, 3", ""])("%o is none", (text) => {
  expect(parsePlace(text)).toBeNull();
});

it("A place is written as it is read", () => {
  expect(parsePlace(formatPlace(CORNERS[2] as Drawing["corners"][number]))).toEqual(CORNERS[2]);
});

it("Drawings come back from GeoJSON with their heights", () => {
  expect(fromGeoJson(toGeoJson(DRAWINGS))).toEqual(DRAWINGS.map(({ id, ...drawing }) => drawing));
});

it("Polygons of others are areas, and what is no GeoJSON gives nothing", () => {
  const ring = [[8, 47], [9, 47], [9, 48], [8, 47]]; // biome-ignore format: one ring
  const found = fromGeoJson(JSON.stringify({ type: "Polygon", coordinates: [ring] }));
  expect(found.map(({ use, corners }) => [use, corners.length])).toEqual([["area", 3]]);
  expect(fromGeoJson("<kml/>")).toEqual([]);
  expect(fromGeoJson('{"type": "Polygon", "coordinates": [[["a", 1]]]}')).toEqual([]);
  expect(fromGeoJson('{"type": "FeatureCollection", "features": [null, 7, {"geometry": null}]}')).toEqual([]);
  expect(fromGeoJson('{"type": "MultiPolygon", "coordinates": {"a": 1}}')).toEqual([]);
  expect(fromGeoJson('{"type": "MultiPolygon", "coordinates": [null, 7]}')).toEqual([]);
});
