import { saveAs } from "../components/download";
import { notify } from "../store/notices";
import { strings } from "../strings";
import { FAR_M } from "./drawing-tools";
import type { MapState } from "./map-state";
import { fromGeoJson, toGeoJson } from "./places";
import { refusalOf } from "./sketch";

const TYPE = "application/geo+json";

/** Saves what is drawn as GeoJSON, and adds what such a file has. */
export function DrawingFiles({ map }: { map: MapState }) {
  const { store, sketch } = map;
  const texts = strings.map;
  if (sketch.use.value !== null || store.chosenDrawing.value !== null) return null;
  const open = async (input: HTMLInputElement) => {
    const text = (await input.files?.[0]?.text()) ?? "";
    input.value = "";
    addAll(map, text);
  };
  return (
    <details class="map-card map-files">
      <summary>{texts.files}</summary>
      <label>
        {texts.importGeoJson}
        <input
          type="file"
          accept=".geojson,.json,application/geo+json"
          onChange={({ currentTarget }) => void open(currentTarget)}
        />
      </label>
      {store.drawings.value.length > 0 && (
        <button
          type="button"
          onClick={() =>
            saveAs(new Blob([toGeoJson(store.drawings.value)], { type: TYPE }), "drawings.geojson")
          }
        >
          {texts.exportGeoJson}
        </button>
      )}
    </details>
  );
}

function addAll(map: MapState, text: string): void {
  const texts = strings.map;
  const found = fromGeoJson(text).map((one) => ({ ...one, flat: map.contents.cornersOf(one.corners) }));
  const near = found.filter(
    ({ flat }) => flat.length && flat.every((corner) => Math.hypot(...corner) < FAR_M),
  );
  if (!near.length) notify("error", texts.notGeoJson);
  let added = 0;
  for (const { flat, use, corners: _, ...heights } of near) {
    const refusal = refusalOf(use, flat);
    if (refusal) notify("warning", refusal);
    else {
      map.sketch.keep(use, flat, heights);
      added++;
    }
  }
  if (added) notify("success", texts.imported(added));
  map.fit();
}
