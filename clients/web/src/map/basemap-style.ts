import type { LayerSpecification, SourceSpecification, StyleSpecification } from "maplibre-gl";
import type { Theme } from "../theme";

const COLOURS = {
  light: {
    land: "#f1efe9",
    green: "#d5e6c9",
    built: "#e4dfd6",
    water: "#aacbe0",
    building: "#cfc8bc",
    road: "#ffffff",
    highway: "#f0c983",
    path: "#b8a88f",
    border: "#9a8fa5",
  },
  dark: {
    land: "#1b1f23",
    green: "#1f2c22",
    built: "#23272b",
    water: "#17303f",
    building: "#30353a",
    road: "#4a5158",
    highway: "#6e5a33",
    path: "#44484c",
    border: "#5f556b",
  },
} satisfies Record<Theme, Record<string, string>>;

/** Raster tiles, such as satellite images, less bright in the dark. */
export function rasterStyle(source: SourceSpecification, theme: Theme): StyleSpecification {
  const paint = theme === "dark" ? { "raster-brightness-max": 0.75, "raster-saturation": -0.2 } : {};
  return {
    version: 8,
    sources: { tiles: source },
    layers: [
      { id: "background", type: "background", paint: { "background-color": COLOURS[theme].land } },
      { id: "tiles", type: "raster", source: "tiles", paint },
    ],
  };
}

/** Vector tiles in the schema of Protomaps' basemaps, without names: those need fonts. */
export function vectorStyle(source: SourceSpecification, theme: Theme): StyleSpecification {
  const colours = COLOURS[theme];
  const fill = (layer: string, colour: string, kinds?: string[]): LayerSpecification => ({
    id: `${layer}-${kinds?.[0] ?? "all"}`,
    type: "fill",
    source: "tiles",
    "source-layer": layer,
    ...(kinds && { filter: ["in", ["get", "kind"], ["literal", kinds]] }),
    paint: { "fill-color": colour },
  });
  const line = (layer: string, colour: string, widest: number, kinds?: string[]): LayerSpecification => ({
    id: `${layer}-${kinds?.[0] ?? "all"}`,
    type: "line",
    source: "tiles",
    "source-layer": layer,
    ...(kinds && { filter: ["in", ["get", "kind"], ["literal", kinds]] }),
    paint: {
      "line-color": colour,
      "line-width": ["interpolate", ["exponential", 1.6], ["zoom"], 8, 0.5, 20, widest],
    },
  });
  return {
    version: 8,
    sources: { tiles: source },
    layers: [
      { id: "background", type: "background", paint: { "background-color": colours.land } },
      fill("landcover", colours.green, ["forest", "grassland", "scrub", "farmland"]),
      fill("landuse", colours.green, [
        "park",
        "forest",
        "wood",
        "grass",
        "meadow",
        "nature_reserve",
        "golf_course",
      ]),
      fill("landuse", colours.built, [
        "residential",
        "industrial",
        "commercial",
        "school",
        "hospital",
        "aerodrome",
      ]),
      fill("water", colours.water),
      fill("buildings", colours.building),
      line("roads", colours.path, 3, ["path", "other"]),
      line("roads", colours.road, 12, ["minor_road"]),
      line("roads", colours.road, 18, ["major_road"]),
      line("roads", colours.highway, 24, ["highway"]),
      line("roads", colours.border, 3, ["rail"]),
      line("boundaries", colours.border, 3),
    ],
  };
}
