import { useEffect, useState } from "preact/hooks";
import { SelectionCard } from "../selection/selection-card";
import type { SceneProps } from "../store/scene";
import { strings } from "../strings";
import { BasemapBelow } from "./basemap-below";
import { DrawingFiles } from "./drawing-files";
import { DrawingForm } from "./drawing-form";
import { DrawingTools } from "./drawing-tools";
import { GapCard } from "./gap-card";
import { LayerList } from "./layer-list";
import "./map.css";
import { MapCanvas } from "./map-canvas";
import { MapFooter } from "./map-footer";
import { MapState } from "./map-state";

/** The scene from above: photographs, footprints, candidates, plans, and what the operator draws. */
export function MapView({ store }: SceneProps) {
  const [map] = useState(() => new MapState(store));
  useEffect(() => () => map.contents.close(), [map]);
  const { frame, everything } = map.contents;
  const { enu, metric } = frame.value;
  const texts = strings.map;
  return (
    <div class="map">
      <BasemapBelow map={map} />
      <MapCanvas map={map} />
      <p id="map-keys" class="visually-hidden">
        {texts.keys}
      </p>
      <div class="map-left">
        {store.scene.value && enu === null && everything.value.length > 0 && (
          <p class="map-card" role="status">
            {metric ? texts.planMetric : texts.plan} <span class="hint">{texts.planHint}</span>
          </p>
        )}
        {store.scene.value && !everything.value.length && (
          <p class="map-card" role="status">
            {texts.empty}
          </p>
        )}
        {enu !== null && <DrawingTools map={map} />}
        {enu !== null && <DrawingFiles map={map} />}
        <DrawingForm map={map} />
        <GapCard map={map} />
        <SelectionCard store={store} />
      </div>
      <div class="map-right">
        <div class="map-buttons">
          <button type="button" onClick={() => map.fit()} title={texts.fit}>
            {texts.fitShort}
          </button>
          <button type="button" onClick={() => map.zoom(1.5)} title={texts.zoomIn} aria-label={texts.zoomIn}>
            +
          </button>
          <button
            type="button"
            onClick={() => map.zoom(1 / 1.5)}
            title={texts.zoomOut}
            aria-label={texts.zoomOut}
          >
            −
          </button>
        </div>
        <LayerList map={map} />
      </div>
      <MapFooter map={map} />
    </div>
  );
}
