import { addProtocol, setWorkerUrl, Map as TileMap } from "maplibre-gl";
import workerUrl from "maplibre-gl/dist/maplibre-gl-worker.mjs?url";
import { PMTiles, Protocol, TileType } from "pmtiles";
import type { Schemas } from "../api/service";
import type { Theme } from "../theme";
import { rasterStyle, vectorStyle } from "./basemap-style";
import type { MapFrame } from "./map-frame";
import { fromScreen, type Viewport } from "./viewport";

/** The circumference of the Earth in tiles of zoom 0, which are 512 px wide. */
const WORLD_PX = 512;

let protocol: Protocol | null = null;

/** Tiles below the map, which follow its view. */
export interface Basemap {
  show: (view: Viewport, frame: MapFrame) => void;
  setTheme: (theme: Theme) => void;
  remove: () => void;
}

/**
 * Open the operator's tiles in an element. Throws where there is no WebGL.
 *
 * `onTiles` is called whenever tiles arrive, and `onFailure` whenever they do not.
 */
export async function openBasemap(
  container: HTMLElement,
  basemap: Schemas["Basemap"],
  theme: Theme,
  onTiles: () => void,
  onFailure: () => void,
): Promise<Basemap> {
  setWorkerUrl(workerUrl); // a file of ours: the Content Security Policy forbids blob: URLs
  const styleOf = await styles(basemap);
  const map = new TileMap({
    container,
    style: styleOf(theme),
    interactive: false,
    attributionControl: false,
    fadeDuration: 0,
    maxZoom: 24,
  });
  map.on("error", onFailure);
  map.on("sourcedata", (event) => {
    if (event.tile) onTiles();
  });
  return {
    show: (view, frame) => {
      const camera = cameraOf(view, frame);
      if (camera) map.jumpTo(camera);
    },
    setTheme: (now) => map.setStyle(styleOf(now)),
    remove: () => map.remove(),
  };
}

async function styles(
  basemap: Schemas["Basemap"],
): Promise<(theme: Theme) => ReturnType<typeof rasterStyle>> {
  if (basemap.kind === "raster-tiles")
    return (theme) => rasterStyle({ type: "raster", tiles: [basemap.url], tileSize: 256 }, theme);
  const url = new URL(basemap.url, location.href).href;
  const archive = new PMTiles(url);
  const { tileType, maxZoom } = await archive.getHeader();
  if (protocol === null) {
    protocol = new Protocol();
    addProtocol("pmtiles", protocol.tile);
  }
  protocol.add(archive);
  const source = { url: `pmtiles://${url}`, maxzoom: maxZoom };
  return tileType === TileType.Mvt
    ? (theme) => vectorStyle({ type: "vector", ...source }, theme)
    : (theme) => rasterStyle({ type: "raster", tileSize: 256, ...source }, theme);
}

/** The view in Web Mercator: it is measured between places of the screen, since metres are not those of the Earth there. */
function cameraOf(view: Viewport, frame: MapFrame) {
  const { width, height } = view;
  const mercator = (u: number, v: number): [number, number] | null => {
    const place = frame.placeOf([...fromScreen(view, [u, v]), 0] as [number, number, number]);
    if (place === null) return null;
    const latitude = (place.latitude_deg * Math.PI) / 180;
    return [place.longitude_deg / 360, Math.log(Math.tan(Math.PI / 4 + latitude / 2)) / (2 * Math.PI)];
  };
  const [west, east] = [mercator(0, height / 2), mercator(width, height / 2)];
  const [north, south] = [mercator(width / 2, 0), mercator(width / 2, height)];
  const centre = frame.placeOf([...view.centre, 0] as [number, number, number]);
  if (!west || !east || !north || !south || !centre) return null;
  const [dx, dy] = [east[0] - west[0], east[1] - west[1]];
  const perPx =
    (Math.hypot(dx, dy) / width + Math.hypot(north[0] - south[0], north[1] - south[1]) / height) / 2;
  return {
    center: [centre.longitude_deg, centre.latitude_deg] as [number, number],
    zoom: Math.log2(1 / (WORLD_PX * perPx)),
    bearing: (Math.atan2(-dy, dx) * 180) / Math.PI,
  };
}
