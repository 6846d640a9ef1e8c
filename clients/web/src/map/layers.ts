import { signal } from "@preact/signals";

export const LAYERS = [
  "photographs",
  "footprints",
  "overlap",
  "forecast",
  "candidates",
  "plan",
  "visits",
  "drawings",
] as const;
export type Layer = (typeof LAYERS)[number];

/** The layers that are shown. */
export const shownLayers = signal<ReadonlySet<Layer>>(new Set(LAYERS.filter((layer) => layer !== "overlap")));

export function toggleLayer(layer: Layer): void {
  const shown = new Set(shownLayers.value);
  if (!shown.delete(layer)) shown.add(layer);
  shownLayers.value = shown;
}
